"""Import paths of version 0.1 that were documented: they work in 0.2 with a warning, and are gone in 0.3."""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

#: Old path and new path; modules inside follow their package.
MOVED = {
    "swarm_mj.attitude.controllers": "swarm_mj.spacecraft.control",
    "swarm_mj.attitude": "swarm_mj.spacecraft.attitude",
    "swarm_mj.campaign": "swarm_mj.campaigns",
    "swarm_mj.envs.evaluation": "swarm_mj.envs.policies.evaluation",
    "swarm_mj.envs.multi_agent": "swarm_mj.envs.observe.multi_agent",
    "swarm_mj.envs.policy": "swarm_mj.envs.policies.policy",
    "swarm_mj.envs.sb3": "swarm_mj.envs.training.sb3",
    "swarm_mj.envs.sb3_policy": "swarm_mj.envs.training.sb3_policy",
    "swarm_mj.planning": "swarm_mj.flight.plan",
}


def new_path(old: str) -> str | None:
    """Where a module of an old path is now; None: the path is none of the old ones."""
    for was, now in MOVED.items():
        if old == was or old.startswith(f"{was}."):
            return now + old.removeprefix(was)
    return None


def renamed(module: str, homes: dict[str, str], name: str) -> Any:
    """A name that a module no longer defines, from its new home, with a warning.

    Raises:
        AttributeError: The module never had it.
    """
    if name not in homes:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    warnings.warn(
        f"{module}.{name} is now {homes[name]}.{name}; the old path goes with version 0.3",
        DeprecationWarning,
        stacklevel=3,
    )
    return getattr(importlib.import_module(homes[name]), name)


class _Moved(MetaPathFinder, Loader):
    """Finds modules of old paths as those of the new ones."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return None if new_path(fullname) is None else ModuleSpec(fullname, self)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        now = new_path(spec.name)
        assert now is not None
        # Python leaves out the frames of its import system: level 2 is the import statement.
        warnings.warn(f"{spec.name} is now {now}; the old path goes with version 0.3", DeprecationWarning, stacklevel=2)
        return _Alias(spec.name, importlib.import_module(now))

    def exec_module(self, module: ModuleType) -> None:
        pass


class _Alias(ModuleType):
    """An old module: what is asked of it is answered by the new one."""

    def __init__(self, name: str, now: ModuleType) -> None:
        super().__init__(name, now.__doc__)
        self.__path__: list[str] = []  # so that modules inside are looked for
        self.__dict__["now"] = now

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__["now"], name)

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """Be `swarm_mj.campaign(...)`, whose place the import of `swarm_mj.campaign.store` takes."""
        return importlib.import_module("swarm_mj.api.campaign").campaign(*arguments, **keywords)


def warn_of_old_paths() -> None:
    """Let old paths be found; once."""
    if not any(isinstance(finder, _Moved) for finder in sys.meta_path):
        sys.meta_path.append(_Moved())
