"""swarm_mj: CubeSat swarms that fly past small bodies and image their surface, in MuJoCo.

The public names are imported when they are first used, so that `import swarm_mj` is quick::

    import swarm_mj as sm

    flight = sm.fly(sm.load("eros-config2", ["camera.half_angle_deg=6"]))
    flight.coverage.percent
"""

from __future__ import annotations

import os
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm_mj.moved import warn_of_old_paths

if TYPE_CHECKING:
    from swarm_mj.api.campaign import campaign, replay_row
    from swarm_mj.api.checks import bench, validate
    from swarm_mj.api.classes import compare_classes
    from swarm_mj.api.design import Design, design
    from swarm_mj.api.flight import Flight, fly
    from swarm_mj.api.navigate import Navigation, navigate
    from swarm_mj.api.observe import Observation, observe
    from swarm_mj.api.results import open, report
    from swarm_mj.api.scenario import Scenario, available, load
    from swarm_mj.api.score import score
    from swarm_mj.api.simulation import simulation, view
    from swarm_mj.errors import SwarmError
    from swarm_mj.smallbody.shape_io import load_shape

__version__ = "0.2.0"

__all__ = [
    "Design",
    "Flight",
    "Navigation",
    "Observation",
    "Scenario",
    "SwarmError",
    "available",
    "bench",
    "campaign",
    "compare_classes",
    "design",
    "explain",
    "fly",
    "load",
    "load_shape",
    "navigate",
    "observe",
    "open",
    "replay_row",
    "report",
    "score",
    "simulation",
    "validate",
    "view",
]

#: Where each public name is defined.
_HOMES = {
    "Design": "api.design",
    "Flight": "api.flight",
    "Navigation": "api.navigate",
    "Observation": "api.observe",
    "Scenario": "api.scenario",
    "SwarmError": "errors",
    "available": "api.scenario",
    "bench": "api.checks",
    "campaign": "api.campaign",
    "compare_classes": "api.classes",
    "design": "api.design",
    "explain": "api.scenario",
    "fly": "api.flight",
    "load": "api.scenario",
    "load_shape": "smallbody.shape_io",
    "navigate": "api.navigate",
    "observe": "api.observe",
    "open": "api.results",
    "replay_row": "api.campaign",
    "report": "api.results",
    "score": "api.score",
    "simulation": "api.simulation",
    "validate": "api.checks",
    "view": "api.simulation",
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
    """Name a folder for compiled code where neither the package nor the home folder can be written."""
    package, home = Path(__file__).parent, Path.home()
    if "NUMBA_CACHE_DIR" in os.environ or os.access(package, os.W_OK) or os.access(home, os.W_OK):
        return
    os.environ["NUMBA_CACHE_DIR"] = str(Path(tempfile.gettempdir()) / f"swarm_mj-{os.getuid()}")


_give_numba_a_cache()
warn_of_old_paths()
if "gymnasium" in sys.modules:  # as in gymnasium.make("swarm_mj:SwarmObserve-v0"); it then learns the environments
    import_module("swarm_mj.envs")
