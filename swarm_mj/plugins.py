"""Plug-ins by name: controllers, gravity fields and behaviours, found through entry points or in files that are named.

A package adds its own by declaring, for example::

    [project.entry-points."swarm_mj.controllers"]
    my_law = "my_package.control:MyLaw"

and a scenario then says `control: {controller: my_law, parameters: {...}}`. Or it names a class in a file,
`control: {controller: "my_law.py:MyLaw"}`: that file is run, and no other.
"""

from __future__ import annotations

import importlib.util
import stat
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from inspect import Parameter, signature
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import PluginError, SwarmError

CONTROLLERS = "swarm_mj.controllers"
GRAVITY = "swarm_mj.gravity"
BEHAVIORS = "swarm_mj.behaviors"
#: What a plug-in of each group must have.
MEMBERS = {CONTROLLERS: ("torque",), GRAVITY: ("acceleration",), BEHAVIORS: ("targets", "dedicated_communications")}


def names(group: str) -> list[str]:
    """Names of the plug-ins of a group, sorted."""
    return sorted({entry.name for entry in _entries(group, tuple(sys.path))})


@cache
def _entries(group: str, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """What is declared for a group by the packages in the folders where modules are looked for; reading all takes a while."""
    return tuple(entry_points(group=group))


def find(group: str, name: str) -> Callable[..., Any]:
    """The class or factory that a plug-in name stands for, or `FILE.py:CLASS`.

    Raises:
        PluginError: The name is unknown, or its module cannot be imported.
    """
    if (place := file_of(name)) is not None:
        return _in_file(*place)
    found = [entry for entry in _entries(group, tuple(sys.path)) if entry.name == name]
    if not found:
        raise PluginError(
            f"{name!r}: unknown plug-in of {group}; available: {', '.join(names(group))}, or FILE.py:CLASS of your own"
        )
    try:
        return found[0].load()
    except (ImportError, AttributeError) as error:
        raise PluginError(f"{name!r} of {group}: cannot be loaded: {error}") from error


def file_of(name: str) -> tuple[Path, str] | None:
    """File and class of a plug-in that is named by them; None of one named by an entry point."""
    path, separator, attribute = name.rpartition(":")
    return (Path(path), attribute) if separator and path.endswith(".py") else None


def _in_file(path: Path, attribute: str) -> Callable[..., Any]:
    try:
        status = path.stat()
    except OSError as error:
        raise PluginError(f"'{path}:{attribute}': {path}: cannot be read ({error.strerror})") from None
    if not stat.S_ISREG(status.st_mode):
        raise PluginError(f"'{path}:{attribute}': {path}: is no regular file")
    # One file is one module however its folder is spelt; its own name stays: a link may lead to one without .py.
    whole = path.parent.resolve() / path.name
    try:
        module = _module(whole, status.st_mtime_ns)
    except Exception as error:
        at = [frame.lineno for frame in extract_tb(error.__traceback__) if frame.filename == str(whole)]
        line = f", line {at[-1]}" if at else ""
        raise PluginError(f"'{path}:{attribute}': {path}{line}: {type(error).__name__}: {in_words(error)}") from error
    if not callable(found := getattr(module, attribute, None)):
        own = [k for k, v in vars(module).items() if isinstance(v, type) and v.__module__ == module.__name__]
        raise PluginError(f"'{path}:{attribute}': {path} has no class {attribute!r}; it has {', '.join(own) or 'none'}")
    return cast(Callable[..., Any], found)


@cache
def _module(path: Path, _mtime_ns: int) -> ModuleType:
    """The module in a file, run once until the file changes; under a name that no other module has."""
    name = str(path)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None  # of a name that ends in .py
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


@contextmanager
def named(key: str) -> Iterator[None]:
    """Put the scenario's key before what is wrong with a plug-in."""
    try:
        yield
    except PluginError as error:
        raise PluginError(f"{key} = {error}") from error


def create(group: str, name: str, parameters: Mapping[str, Any], *context: Any) -> Any:
    """Build a plug-in from its scenario parameters; `context` is what the group hands to every plug-in first.

    Raises:
        PluginError: The name is unknown or the parameters do not fit.
    """
    factory = find(group, name)
    try:
        for place, argument in enumerate(signature(factory).parameters.values()):
            value = parameters.get(argument.name)
            if place >= len(context) and _needed(argument) and argument.name not in parameters:
                raise PluginError(f"{name!r} of {group}: parameters.{argument.name} is missing: must be given")
            if type(argument.default) in (int, float) and isinstance(value, str | bool):  # float() would take both
                raise ValueError(f"{argument.name} = {shown(value)}: must be a number")
        plugin = factory(*context, **parameters)
    except SwarmError:
        raise
    except Exception as error:
        raise PluginError(f"{name!r} of {group} with parameters {dict(parameters)}: {in_words(error)}") from error
    missing = [member for member in MEMBERS[group] if not hasattr(plugin, member)]
    if missing:
        raise PluginError(
            f"{name!r} of {group}: {name_of(plugin)} has no {missing[0]}, which every one of them must have"
        )
    return plugin


def _needed(argument: Parameter) -> bool:
    """Whether it must be given; one that takes any number of values need not."""
    return argument.default is Parameter.empty and argument.kind not in (
        Parameter.VAR_POSITIONAL,
        Parameter.VAR_KEYWORD,
    )


def call(plugin: object, role: str, method: str, *arguments: Any) -> Any:
    """Call a method of a plug-in.

    Raises:
        PluginError: It raised something; the error names the plug-in by its role, the method and the line.
        SwarmError: What it refused by an error of the project itself.
    """
    try:
        return getattr(plugin, method)(*arguments)
    except SwarmError:
        raise
    except Exception as error:
        raise failure_of(plugin, role, method, error) from error


def as_array(given: Any, shape: tuple[int, ...], kind: type, plugin: object, what: str) -> NDArray[Any]:
    """Numbers that a plug-in gave, as an array for compiled code.

    Args:
        given: The numbers.
        shape: What it must have.
        kind: `np.float64` or `np.int64`.
        plugin: Who gave it.
        what: Stands before "has shape ..." in the error, with {} for the plug-in's name.

    Raises:
        PluginError: It is no such array.
    """
    if type(given) is np.ndarray and given.dtype == kind and given.shape == shape and given.flags.c_contiguous:
        return given
    what = what.format(name_of(plugin))
    try:
        array = np.asarray(given)
    except ValueError:  # rows of different lengths
        raise PluginError(f"{what} is {shown(given)}: must be an array of shape {shape}") from None
    if array.shape != shape:
        raise PluginError(f"{what} has shape {array.shape}: must be {shape}")
    if array.dtype.kind not in ("biuf" if kind is np.float64 else "iu"):
        numbers = "numbers" if kind is np.float64 else "whole numbers"
        raise PluginError(f"{what} holds {array.dtype}: must be {numbers}")
    return np.ascontiguousarray(array, kind)


def failure_of(plugin: object, role: str, method: str, error: Exception) -> PluginError:
    """The project's error for what a plug-in raised: whose it is, and where."""
    last = extract_tb(error.__traceback__)[-1]
    return PluginError(
        f"the {role} {name_of(plugin)} failed in {method}: {type(error).__name__}: {in_words(error)} "
        f"({Path(last.filename).name}, line {last.lineno})"
    )


def name_of(plugin: object) -> str:
    """Module and class of a plug-in."""
    return f"{type(plugin).__module__}.{type(plugin).__qualname__}"


def in_words(error: Exception) -> str:
    """What an error says, in one line of bounded length."""
    return " ".join(str(error).split())[:300] or type(error).__name__


def shown(value: Any) -> str:
    """A value in one line of bounded length."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else f"{text[:77]}..."
