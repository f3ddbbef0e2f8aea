"""What a study saves that begins with a like one: python -m benchmarks.warm_studies [CASE ...].

Each requirement is studied, and then others with finer and coarser resolutions: once beginning with it, once alone. Told is the
processor's time of `swarm-mj ideas`, start of the program included, over that of the study alone; candidates' flights are kept
nowhere.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import yaml

from swarm_mj.ideas.knowledge import KnowledgeBase

#: Requirements, and resolutions to study beside them [m].
CASES: dict[str, tuple[dict[str, Any], tuple[float, ...]]] = {
    "itokawa": (
        {
            "scenario": "itokawa-slow",
            "resolution_m": 0.05,
            "share_percent": 95,
            "limits": {"units": [3, 6], "spacecraft": 20},
        },
        (0.0475, 0.0525, 0.054),
    ),
    "bennu": (
        {
            "scenario": "bennu-slow",
            "resolution_m": 0.25,
            "share_percent": 99,
            "deliver_within_h": 240,
            "limits": {"units": [3, 6], "spacecraft": 20, "altitudes_m": [1000]},
        },
        (0.24, 0.27),
    ),
    "flyby": (
        {
            "scenario": "fast-flyby",
            "changes": {"mothership.position_A_m": [-8.3697e8, -8.7327e8, 0]},
            "resolution_m": 60,
            "share_percent": 60,
            "contact_h": 2,
            "listen_share": 0.25,
            "limits": {"spacecraft": 6},
        },
        (57,),
    ),
}


def studied(asked: dict[str, Any], folder: Path, base: str) -> tuple[float, str]:
    """Processor's time of a study [s], and its swarm."""
    with tempfile.TemporaryDirectory(dir=folder) as cache:
        file = Path(cache) / "asked.yaml"
        file.write_text(yaml.safe_dump(asked), encoding="utf-8")
        command = [sys.executable, "-m", "swarm_mj", "ideas", str(file), "--base", str(folder / base), "--quiet"]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        environment = os.environ | {"SWARM_MJ_CACHE": cache}
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    record = KnowledgeBase(folder / base).find(asked["name"]).record
    spacecraft = record["spacecraft"] or {"kind": "none"}
    took = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return took, f"{record['observers']} of {spacecraft['kind']}"


def main() -> None:
    """Study and print."""
    for name in sys.argv[1:] or CASES:
        asked, others = CASES[name]
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            studied({**asked, "name": "first"}, folder, "warm.sqlite")
            for metres in others:
                near = {**asked, "name": f"at-{metres:g}", "resolution_m": metres}
                kept = (folder / "warm.sqlite").read_bytes()
                warm, swarm = studied(near, folder, "warm.sqlite")
                alone, other = studied(near, folder, f"alone-{metres:g}.sqlite")
                (folder / "warm.sqlite").write_bytes(kept)
                same = "the same swarm" if swarm == other else f"{swarm}, but alone {other}"
                words = f"{name}: {metres:g} m after {asked['resolution_m']:g} m: {100.0 * warm / alone:.0f} %"
                print(f"{words} of {alone:.1f} s alone; {same}", flush=True)


if __name__ == "__main__":
    main()
