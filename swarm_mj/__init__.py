"""swarm_mj: CubeSat swarms that fly past small bodies and image their surface, in MuJoCo."""

import os
import sys
import tempfile
from importlib import import_module
from pathlib import Path

__version__ = "0.1.0"


def _give_numba_a_cache() -> None:
    """Name a folder for compiled code where neither the package nor the home folder can be written."""
    package, home = Path(__file__).parent, Path.home()
    if "NUMBA_CACHE_DIR" in os.environ or os.access(package, os.W_OK) or os.access(home, os.W_OK):
        return
    os.environ["NUMBA_CACHE_DIR"] = str(Path(tempfile.gettempdir()) / f"swarm_mj-{os.getuid()}")


_give_numba_a_cache()
if "gymnasium" in sys.modules:  # as in gymnasium.make("swarm_mj:SwarmObserve-v0"); it then learns the environments
    import_module("swarm_mj.envs")
