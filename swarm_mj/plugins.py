"""Plug-ins by name: controllers, gravity fields and behaviours, found through entry points.

A package adds its own by declaring, for example::

    [project.entry-points."swarm_mj.controllers"]
    my_law = "my_package.control:MyLaw"

and a scenario then says `control: {controller: my_law, parameters: {...}}`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from typing import Any

from swarm_mj.errors import PluginError

CONTROLLERS = "swarm_mj.controllers"
GRAVITY = "swarm_mj.gravity"
BEHAVIORS = "swarm_mj.behaviors"


def names(group: str) -> list[str]:
    """Names of the plug-ins of a group, sorted."""
    return sorted({entry.name for entry in entry_points(group=group)})


def find(group: str, name: str) -> Callable[..., Any]:
    """The class or factory that a plug-in name stands for.

    Raises:
        PluginError: The name is unknown, or its module cannot be imported.
    """
    found = [entry for entry in entry_points(group=group) if entry.name == name]
    if not found:
        raise PluginError(f"{name!r}: unknown plug-in of {group}; available: {', '.join(names(group))}")
    try:
        return found[0].load()
    except (ImportError, AttributeError) as error:
        raise PluginError(f"{name!r} of {group}: cannot be loaded: {error}") from error


def create(group: str, name: str, parameters: Mapping[str, Any], *context: Any) -> Any:
    """Build a plug-in from its scenario parameters; `context` is what the group hands to every plug-in first.

    Raises:
        PluginError: The name is unknown or the parameters do not fit.
    """
    factory = find(group, name)
    try:
        return factory(*context, **parameters)
    except (TypeError, ValueError, ArithmeticError) as error:
        raise PluginError(f"{name!r} of {group} with parameters {dict(parameters)}: {error}") from error
