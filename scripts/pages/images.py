"""Redraw the pictures of README and docs with the program's own commands: `swarm-mj fly` and `swarm-mj design`.

Run as `python -m scripts.pages.images` or `make images`. The same versions of the libraries give the same bytes.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

from scripts.pages import IMAGES

#: What is run for the pictures: name of the result folder and the command that makes it.
COMMANDS = {
    "eros-config1": ("fly", "eros-config1"),
    "eros-config2": ("fly", "eros-config2"),
    "eros-literal": ("fly", "eros-literal"),
    "eros-faults": ("fly", "eros-faults"),
    "eros-hemispherical": ("fly", "eros-config1", "--set", "link.crosslink.antenna=hemispherical"),
    "eros-thrusters": (
        "fly",
        "eros-config1",
        "--set",
        "spacecraft.thrusters={}",
        "--set",
        "dispersions.deployment_velocity_m_s=0.1",
        "--set",
        "trajectory.corrections=[{after_release_s: 60}, {before_arrival_s: 120}]",
    ),
    "bennu-optical": ("fly", "bennu-slow", "--set", "navigation.mode=optical"),
    "eros-formation": (
        "fly",
        "eros-config2",
        "--set",
        "swarm={class: 1, formation: {reference: mean, start_s: 60}}",
        "--set",
        "spacecraft.thrusters={}",
        "--set",
        "dispersions.deployment_velocity_m_s=0.1",
    ),
    "eros-config1-design": ("design", "eros-config1", "--pareto"),
    "eros-safe-design": (
        "design",
        "eros-quick",
        "--probability",
        "0.9",
        "--set",
        "observation.criterion=arrival",
        "--set",
        "camera.half_angle_deg=5",
        "--set",
        "faults=[{kind: spacecraft_lost, spacecraft: all, probability: 0.05, between_s: [0, 600]}]",
        "--set",
        "designer.realisations=4",
        "--set",
        "designer.check_flights=16",
        "--set",
        "designer.time_limit_s=10",
        "--set",
        "telemetry.interval_s=10",
    ),
}

#: Result folder and figure of every picture; it is kept as FOLDER-FIGURE.png.
PICTURES = (
    ("eros-safe-design", "certainty"),
    ("eros-config1", "behaviors"),
    ("eros-config1", "trajectories"),
    ("eros-config1", "target"),
    ("eros-config1", "tracking_error"),
    ("eros-config1", "pointing_error"),
    ("eros-config1", "operation"),
    ("eros-config1", "coverage"),
    ("eros-config1", "ground_track"),
    ("eros-config1", "footprints"),
    ("eros-config1", "illumination"),
    ("eros-config1", "wheel_speed"),
    ("eros-config1", "wheel_momentum"),
    ("bennu-optical", "navigation"),
    ("eros-thrusters", "propulsion"),
    ("eros-formation", "formation"),
    ("eros-config1", "links"),
    ("eros-config1", "contacts"),
    ("eros-config1", "data"),
    ("eros-config1", "delivered_map"),
    ("eros-hemispherical", "contacts"),
    ("eros-hemispherical", "delivered_map"),
    ("eros-config2", "behaviors"),
    ("eros-config2", "tracking_error"),
    ("eros-config2", "operation"),
    ("eros-config2", "links"),
    ("eros-literal", "operation"),
    ("eros-faults", "pointing_error"),
    ("eros-config1-design", "gene_map"),
    ("eros-config1-design", "history"),
    ("eros-config1-design", "cover"),
    ("eros-config1-design", "pareto"),
)


def picture_name(folder: str, figure: str) -> str:
    """File name of a picture in docs/images."""
    return f"{folder}-{figure}.png"


def main() -> int:
    """Run the commands and copy the pictures; returns the exit status."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    from swarm_mj.cli.main import main as swarm_mj

    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as results:
        for folder, command in COMMANDS.items():
            print(f"swarm-mj {' '.join(command)}", flush=True)
            status = swarm_mj([*command, "--quiet", "--out", f"{results}/{folder}"])
            if status:
                return status
        for folder, figure in PICTURES:
            picture = IMAGES / picture_name(folder, figure)
            shutil.copyfile(Path(results) / folder / f"{figure}.png", picture)
            print(f"wrote {picture}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
