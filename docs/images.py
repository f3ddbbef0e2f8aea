"""Redraw the pictures of README and docs: fly both configurations of the paper and keep what the texts show.

Run as `python -m docs.images` or `make docs`. The same versions of the libraries give the same bytes.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

IMAGES = Path(__file__).parent / "images"

#: Scenario and figure of every picture; it is kept as SCENARIO-FIGURE.png.
PICTURES = (
    ("eros-config1", "target"),
    ("eros-config1", "operation"),
    ("eros-config1", "tracking_error"),
    ("eros-config1", "pointing_error"),
    ("eros-config1", "coverage"),
    ("eros-config1", "wheel_speed"),
    ("eros-config1", "links"),
    ("eros-config2", "operation"),
    ("eros-config2", "tracking_error"),
    ("eros-config2", "links"),
)


def main() -> None:
    """Fly, draw and copy."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    from swarm_mj.runner import run_one
    from swarm_mj.scenarios.loading import load_scenario

    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for name in dict.fromkeys(scenario for scenario, _ in PICTURES):
            print(f"flying {name} ...", flush=True)
            run_one(load_scenario(name), Path(folder) / name, figures=True)
        for scenario, figure in PICTURES:
            picture = IMAGES / f"{scenario}-{figure}.png"
            shutil.copyfile(Path(folder) / scenario / f"{figure}.png", picture)
            print(f"wrote {picture}")


if __name__ == "__main__":
    main()
