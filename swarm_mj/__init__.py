"""swarm_mj: CubeSat swarms that fly past small bodies and image their surface, in MuJoCo.

The public names are imported when they are first used, so that `import swarm_mj` is quick::

    import swarm_mj as sm

    flight = sm.fly("eros-config2", {"camera.half_angle_deg": 6})
    flight.coverage.percent
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swarm_mj.api.campaign import campaign, compare_classes, replay
    from swarm_mj.api.checks import score, validate
    from swarm_mj.api.design import Design, Sweeps, design, design_sweeps
    from swarm_mj.api.flight import Flight, fly
    from swarm_mj.api.ideas import Studied, compare_studies, open_study, requirement_keys, rerun_study, studies, study
    from swarm_mj.api.navigate import Navigation, navigate
    from swarm_mj.api.observe import Observation, observe
    from swarm_mj.api.results import open, open_design, report
    from swarm_mj.api.scenario import Scenario, available, explain, load, simulation, view
    from swarm_mj.errors import SwarmError
    from swarm_mj.scenarios.catalogue import json_schema
    from swarm_mj.scenarios.loading import packaged
    from swarm_mj.smallbody.shape_harmonics import build_shape
    from swarm_mj.smallbody.shape_io import load_shape, save_shape

__version__ = "0.2.0"

__all__ = [
    "Design",
    "Flight",
    "Navigation",
    "Observation",
    "Scenario",
    "Studied",
    "Sweeps",
    "SwarmError",
    "available",
    "build_shape",
    "campaign",
    "compare_classes",
    "compare_studies",
    "design",
    "design_sweeps",
    "explain",
    "fly",
    "json_schema",
    "load",
    "load_shape",
    "navigate",
    "observe",
    "open",
    "open_design",
    "open_study",
    "packaged",
    "replay",
    "report",
    "requirement_keys",
    "rerun_study",
    "save_shape",
    "score",
    "simulation",
    "studies",
    "study",
    "validate",
    "view",
]

#: Where each public name is defined.
_HOMES = {
    name: home
    for home, names in {
        "api.campaign": ("campaign", "compare_classes", "replay"),
        "api.checks": ("score", "validate"),
        "api.design": ("Design", "Sweeps", "design", "design_sweeps"),
        "api.flight": ("Flight", "fly"),
        "api.ideas": (
            "Studied",
            "compare_studies",
            "open_study",
            "requirement_keys",
            "rerun_study",
            "studies",
            "study",
        ),
        "api.navigate": ("Navigation", "navigate"),
        "api.observe": ("Observation", "observe"),
        "api.results": ("open", "open_design", "report"),
        "api.scenario": ("Scenario", "available", "explain", "load", "simulation", "view"),
        "errors": ("SwarmError",),
        "scenarios.catalogue": ("json_schema",),
        "scenarios.loading": ("packaged",),
        "smallbody.shape_harmonics": ("build_shape",),
        "smallbody.shape_io": ("load_shape", "save_shape"),
    }.items()
    for name in names
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'swarm_mj' has no attribute {name!r}; it offers {', '.join(__all__)}")
    value = getattr(import_module(f"swarm_mj.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, for completion."""
    return sorted({*__all__, *globals()})


def _give_numba_a_cache() -> None:
    """Let Numba keep machine code in a private folder until the program ends, where it could be kept nowhere else safely.

    Numba keeps it beside the sources if it can, otherwise in the user's cache folder. It runs what it finds there, so that
    nobody else may write into that, and no `.numba_config.yaml` of the current folder may name another one: the environment
    goes before it, an empty value too, which names none.
    """
    if os.environ.setdefault("NUMBA_CACHE_DIR", "") or os.access(Path(__file__).parent, os.W_OK):
        return
    cache = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "numba"
    if cache.is_absolute():  # without a home folder "~" stays as it is
        # Not Path.exists, which raises where a folder may not be entered.
        nearest = next(folder for folder in (cache, *cache.parents) if os.path.exists(folder))
        status = nearest.stat()
        if os.access(nearest, os.W_OK) and status.st_uid == os.getuid() and not status.st_mode & 0o022:
            return
    private = tempfile.mkdtemp(prefix="swarm_mj-")
    atexit.register(shutil.rmtree, private, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = private


_give_numba_a_cache()
if "gymnasium" in sys.modules:  # as in gymnasium.make("swarm_mj:SwarmObserve-v0"); it then learns the environments
    import_module("swarm_mj.envs")
