"""Flights of swarm_mj flown and read by other programs: python -m benchmarks.agreement.

The paper's flight and a fast flyby are flown, exported, and given to SciPy, Orekit, brahe, SPICE and Basilisk, each in a
process of its own; whatever of them is not installed is left out, and the page says so. Takes about five minutes.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.agreement.page import page
from benchmarks.agreement.programs import PROGRAMS, ask, installed
from benchmarks.measure import machine
from swarm_mj.io.atomic import write_text

PAGE = Path("docs/results/agreement.md")
#: The shorter control period that shows what gravity held over it costs.
SHORTER_PERIOD_S = 0.1


def main() -> None:
    """Fly, ask, compare, and write page and numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", type=Path, default=PAGE, metavar="FILE", help="the page (default: %(default)s)")
    parser.add_argument("--programs", nargs="*", default=list(PROGRAMS), choices=list(PROGRAMS), help="default: all")
    parser.add_argument("--page-only", action="store_true", help="write the page anew from the numbers beside it")
    arguments = parser.parse_args()
    numbers = arguments.markdown.with_suffix(".json")
    if arguments.page_only:
        results = json.loads(numbers.read_text(encoding="utf-8"))
    else:
        results = {"machine": machine(), **measure(arguments.programs)}
        write_text(numbers, json.dumps(results, indent=1) + "\n")
    write_text(arguments.markdown, page(results))
    print(f"wrote {arguments.markdown} and {numbers}")


def measure(names: list[str]) -> dict[str, Any]:
    """All numbers of the page."""
    from benchmarks.agreement.comparison import compare, distance, rounded
    from benchmarks.agreement.flights import MISSIONS, fly

    versions = {name: installed(name) for name in PROGRAMS}
    there = [name for name in names if versions[name]]
    results: dict[str, Any] = {"versions": versions, "flights": {}, "causes": {}, "failed": {}}
    for key, mission in MISSIONS.items():
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            report(f"{key}: flying")
            flown, answers = fly(mission, folder), {}
            for program in there:
                report(f"{key}: {program}")
                try:
                    answers[program] = ask(program, folder)
                except RuntimeError as error:
                    report(str(error))
                    results["failed"][program] = str(error).splitlines()[-1]
            rows = compare(flown, answers)
            results["flights"][key] = {
                "title": mission.title,
                "spacecraft": flown.states.plan.n,
                "samples": len(flown.states.times),
                "path_samples": len(flown.states.times[:: flown.stride]),
                "duration_s": float(flown.states.times[-1]),
                "timestep_s": flown.states.plan.scenario.physics.timestep_s,
                **rounded(flown, answers),
                "farthest_m": distance(flown.states.states_N[..., :3], 0.0),
                "rows": rows,
            }
            if "brahe" in answers:
                results["brahe_spk"] = str(answers["brahe"]["spk_error"])
    if "scipy" in there:
        results["causes"] = causes(results["flights"])
    return results


def causes(flights: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """Distances from SciPy of the paper's flight as it is, and flown otherwise where a difference is thought to come from."""
    name = "eros-config1"
    given = {row["quantity"]: row["difference"] for row in flights[name]["rows"] if row["program"] == "scipy"}
    shorter = again(name, {"control.period_s": SHORTER_PERIOD_S})
    kernel = again(name, {"physics.stepper": "kernel"})
    return {
        "hold": [
            {"period_s": 0.5, "path_m": given["path"]},
            {"period_s": SHORTER_PERIOD_S, "path_m": shorter["path"]},
        ],
        "steppers": [
            {"stepper": "mujoco", "attitude_urad": given["attitude"]},
            {"stepper": "kernel", "attitude_urad": kernel["attitude"]},
        ],
    }


def again(name: str, change: dict[str, Any]) -> dict[str, float]:
    """Differences from SciPy of a flight with one key changed, by quantity."""
    from benchmarks.agreement.comparison import compare
    from benchmarks.agreement.flights import MISSIONS, fly

    with tempfile.TemporaryDirectory() as folder:
        report(f"{name}: {change}")
        flown = fly(MISSIONS[name], Path(folder), change)
        rows = compare(flown, {"scipy": ask("scipy", Path(folder))})
    return {row["quantity"]: row["difference"] for row in rows}


def report(what: str) -> None:
    """Say what is being done."""
    print(what, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
