"""The data files that travel with the package: shape model, shape harmonics and MJCF parts."""

from importlib.resources import files
from importlib.resources.abc import Traversable


def asset_path(name: str) -> Traversable:
    """A packaged data file by its name in the assets folder, e.g. `mjcf/scene.xml`; in a checkout or a wheel a plain path."""
    return files("swarm_mj.assets") / name
