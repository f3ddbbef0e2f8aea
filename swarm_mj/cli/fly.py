"""The commands `fly`, `design` and `view`."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm_mj.cli.common import (
    DEFAULT_OUT,
    DEFAULT_SCENARIOS,
    add_command,
    add_common,
    add_overrides,
    add_scenario,
    bars_for,
    overrides_of,
    show_table,
    tell,
)
from swarm_mj.errors import OutputError
from swarm_mj.figures.drawing import prepare_drawing

if TYPE_CHECKING:
    from swarm_mj.scenarios.schema import Scenario


def add(commands: argparse._SubParsersAction) -> None:
    """Add the commands to the parser."""
    fly = add_command(
        commands,
        "fly",
        _fly,
        "fly one or more scenarios and write their results",
        "Fly scenarios: trajectories, attitude, observed area, telemetry and figures, one folder each.",
    )
    fly.add_argument(
        "scenario",
        nargs="*",
        default=list(DEFAULT_SCENARIOS),
        metavar="NAME_OR_FILE",
        help=f"packaged name or YAML file (default: {' '.join(DEFAULT_SCENARIOS)})",
    )
    fly.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"result folder (default: {DEFAULT_OUT}/NAME; of several scenarios: the folder that holds theirs)",
    )
    fly.add_argument(
        "--design", metavar="DESIGN", help="fly this design: a design.json of `swarm-mj design`, or a packaged name"
    )
    fly.add_argument(
        "--policy",
        metavar="NAME_OR_FILE",
        help="who points at what: sweep, greedy, greedy_ahead, trained (the packaged network), or a file as `swarm-mj score` "
        "takes them",
    )
    add_common(fly, seed_of="the random initial attitudes")
    fly.add_argument("--no-report", action="store_true", help="write no report.html")
    design = add_command(
        commands,
        "design",
        _design,
        "find the fewest spacecraft that see the whole target",
        "Design a swarm: the fewest observers that see the whole target, by genetic algorithm and with proof.",
    )
    add_scenario(design)
    design.add_argument("--out", type=Path, metavar="DIR", help=f"result folder (default: {DEFAULT_OUT}/NAME-design)")
    design.add_argument("--fold", type=int, metavar="K", help="every face must be seen by at least K spacecraft")
    design.add_argument(
        "--class",
        dest="quality_class",
        metavar="NAME",
        help="a face counts where the pictures of all together map it at this quality class, e.g. stereo",
    )
    design.add_argument(
        "--deliver-within",
        type=float,
        metavar="HOURS",
        help="the whole map must be on Earth HOURS past the epoch, with proof",
    )
    design.add_argument(
        "--probability",
        type=float,
        metavar="P",
        help="enough must be seen with this probability under the scenario's losses and dispersions, with proof",
    )
    design.add_argument(
        "--verify", type=int, metavar="N", help="with --probability: fly the design N times with other seeds"
    )
    design.add_argument(
        "--sweeps",
        action="store_true",
        help="the fewest spacecraft by planned sweeps of narrow cameras; their points are printed, no folder is written",
    )
    design.add_argument("--pareto", action="store_true", help="trade spacecraft against delta-v and area too (NSGA-II)")
    design.add_argument(
        "--compare", action="store_true", help="print how the minimum grows with demands beyond the paper"
    )
    design.add_argument("--workers", type=int, metavar="N", help="processes for the pictures (default: one per core)")
    design.add_argument(
        "--scheduler", metavar="ADDRESS", help="fly candidates on the Dask cluster there, e.g. tcp://host:8786"
    )
    add_common(design, seed_of="the genetic algorithm")
    what = "Fly a scenario in MuJoCo's viewer; needs a display."
    view = add_command(commands, "view", _view, "watch a scenario fly in MuJoCo's viewer", what)
    add_scenario(view)
    view.add_argument(
        "--speed", type=float, default=10.0, metavar="X", help="seconds of flight per second at the start (default 10)"
    )
    add_overrides(view)


def _fly(arguments: argparse.Namespace) -> int:
    if not arguments.no_figures:
        prepare_drawing()  # before anything heavy is imported: it takes the other process as long to get ready as this one
    from swarm_mj.api.flight import check, fly
    from swarm_mj.api.scenario import load
    from swarm_mj.cli.tables import results_tables

    overrides = overrides_of(arguments)
    scenarios = [load(name, overrides, design=arguments.design, policy=arguments.policy) for name in arguments.scenario]
    folders = _folders(arguments.out, [scenario.name for scenario in scenarios])
    for scenario, folder in zip(scenarios, folders, strict=True):
        check(scenario, folder)  # what is refused is so before another one is flown
    report, flown = not arguments.no_report, []
    with bars_for(arguments) as bars:
        for scenario, folder in zip(scenarios, folders, strict=True):
            flight = fly(
                scenario, out=folder, figures=not arguments.no_figures, pdf=arguments.pdf, report=report, progress=bars
            )
            flown.append((folder, flight.summary, flight.findings))
    for table in results_tables(bars.console, [summary for _, summary, _ in flown]):
        show_table(bars.console, table)
    for folder, summary, findings in flown:
        words = [*_notes(summary), *findings, f"files in {folder}"]
        tell(bars.console, *(f"{summary['scenario']}: {each}" for each in words))
    for folder, summary, _ in flown if report else ():
        tell(bars.console, f"{summary['scenario']}: report in {folder / 'report.html'}")
    return 0


def _folders(out: Path | None, names: Sequence[str]) -> list[Path]:
    """Where the results go; scenarios of one name are refused."""
    if out is not None and len(names) == 1:
        return [out]
    if len(set(names)) < len(names):
        raise OutputError("two scenarios have the same name; give them folders of their own with --out, one call each")
    return [(out or DEFAULT_OUT) / name for name in names]


def _notes(summary: dict[str, Any]) -> list[str]:
    notes = [summary["description"]] if summary["description"] else []
    return notes + ([summary["observer_note"]] if summary["observer"] != "faceid" else [])


def _design(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.design import design
    from swarm_mj.api.scenario import load
    from swarm_mj.cli.tables import certainty_table, design_table, growth_table, paths_table

    overrides = overrides_of(arguments)
    if arguments.fold is not None:
        overrides["designer.fold"] = arguments.fold
    if arguments.deliver_within is not None:
        overrides["designer.deliver_within_h"] = arguments.deliver_within
    if arguments.probability is not None:
        overrides["designer.probability"] = arguments.probability
    if arguments.quality_class is not None:
        overrides["designer.quality_class"] = arguments.quality_class
    scenario = load(arguments.scenario, overrides)
    if arguments.sweeps:
        return _design_sweeps(arguments, scenario)
    folder = arguments.out or DEFAULT_OUT / f"{scenario.name}-design"
    with bars_for(arguments) as bars:
        found = design(
            scenario,
            out=folder,
            pareto=arguments.pareto,
            compare=arguments.compare,
            verify=arguments.verify,
            workers=arguments.workers,
            scheduler=arguments.scheduler,
            figures=not arguments.no_figures,
            pdf=arguments.pdf,
            progress=bars,
        )
    show_table(bars.console, design_table(found.record))
    show_table(bars.console, paths_table(found.record))
    if found.record.get("certainty"):
        show_table(bars.console, certainty_table(found.record))
    if arguments.compare:
        show_table(bars.console, growth_table(found.compared))
    tell(bars.console, f"{scenario.name}: files in {folder}", _hint(arguments, folder, scenario))
    return 0


def _design_sweeps(arguments: argparse.Namespace, scenario: Scenario) -> int:
    """Print the fewest spacecraft by planned sweeps, and how to fly them."""
    from swarm_mj.api.design import design_sweeps
    from swarm_mj.observation.coverage import percent_text

    given = {
        "out": "--out",
        "pareto": "--pareto",
        "compare": "--compare",
        "verify": "--verify",
        "scheduler": "--scheduler",
    }
    for name, option in given.items():
        if getattr(arguments, name):
            raise OutputError(f"{option}: must be left out with --sweeps, which writes no folder")
    found = design_sweeps(scenario)
    proof = "proven" if found.proven else f"at least {found.bound} are needed"
    points = ", ".join(map(str, found.points))
    print(f"{scenario.name}: {len(found.points)} spacecraft, {proof}, visiting {points}; their plans show "
          f"{percent_text(found.covered_percent)} of the target if nothing fails")  # fmt: skip
    kept = [text for text in arguments.overrides if not text.startswith(("behavior.", "design."))]
    changes = [*kept, "behavior.name=planned_sweep", f"design.visiting_points=[{points}]"]
    words = shlex.join(word for text in changes for word in ("--set", text))
    print(f"To fly it: swarm-mj fly {shlex.quote(arguments.scenario)} {words}")
    return 0


def _hint(arguments: argparse.Namespace, folder: Path, scenario: Scenario) -> str:
    """How to fly the design, and have its class told."""
    overrides, designed = list(arguments.overrides), scenario.designed_class
    if designed is not None and not scenario.observation.classes:
        overrides.append(f"observation.classes=[{designed.name}]")
    asked = shlex.join([arguments.scenario, *(word for text in overrides for word in ("--set", text))])
    return f"To fly it: swarm-mj fly {asked} --design {shlex.quote(str(folder / 'design.json'))}"


def _view(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.scenario import view

    view(arguments.scenario, overrides_of(arguments), speed=arguments.speed)
    return 0
