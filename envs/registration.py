"""Registration with gymnasium without importing it, so that the command line stays quick.

gymnasium is told at once where it is already imported (`gym.make("swarm_mj:SwarmObserve-v0")` imports it first), and otherwise
by an import hook the moment a program imports it, whatever the order of the two imports.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType

#: Environments by name, and where their classes are: the single one and the vector one.
ENVIRONMENTS = {
    "SwarmObserve-v0": ("swarm_mj.envs.swarm_observe:SwarmObserveEnv", "swarm_mj.envs.vector:SwarmObserveVectorEnv")
}


def register_environments() -> None:
    """Tell gymnasium the environments that it does not know yet; imports gymnasium."""
    import gymnasium

    for name, (entry_point, vector) in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(id=name, entry_point=entry_point, vector_entry_point=vector)


def register_with_gymnasium() -> None:
    """Register now if gymnasium is imported, else as soon as it is."""
    if "gymnasium" in sys.modules:
        register_environments()
    elif not any(isinstance(finder, _GymnasiumFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _GymnasiumFinder())


class _GymnasiumFinder(MetaPathFinder):
    """Finds gymnasium as everybody else would, but registers the environments once it has run; then it is gone."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        if spec is not None and spec.loader is not None:
            _register_after(spec.loader)
        return spec


def _register_after(loader: object) -> None:
    execute = loader.exec_module  # type: ignore[attr-defined]

    def execute_and_register(module: ModuleType) -> None:
        delattr(loader, "exec_module")
        execute(module)
        register_environments()

    loader.exec_module = execute_and_register  # type: ignore[attr-defined]
