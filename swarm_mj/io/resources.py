"""The data files that travel with the package: shape model, shape harmonics and MJCF parts."""

from importlib.resources import files
from importlib.resources.abc import Traversable


def asset_path(name: str) -> Traversable:
    """Locate a packaged data file.

    Args:
        name: file name relative to the assets folder, e.g. `eros.obj` or `mjcf/scene.xml`.

    Returns:
        A readable resource; inside a checkout or an unpacked wheel it is a plain path.
    """
    return files("swarm_mj.assets") / name
