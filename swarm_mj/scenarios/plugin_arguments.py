"""What a scenario may give to a plug-in: its arguments with type, default and meaning, from signature and docstring.

The page of plug-ins, `swarm-mj available` and the JSON schema are made of it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple, get_type_hints

import docstring_parser
from pydantic import PydanticUserError, TypeAdapter
from pydantic.errors import PydanticInvalidForJsonSchema

from swarm_mj import plugins
from swarm_mj.errors import PluginError


class PluginGroup(NamedTuple):
    """Where plug-ins of a kind stand in a scenario.

    Attributes:
        kind: What one of them is.
        title: Heading above all of them.
        section: Dotted path of the section that names one.
        key: Its key with the name of the plug-in; `parameters` beside it holds the arguments.
        given: How many arguments the program gives before those.
    """

    kind: str
    title: str
    section: str
    key: str
    given: int


#: The groups of entry points.
GROUPS = {
    plugins.CONTROLLERS: PluginGroup("control law", "Attitude control laws", "control", "controller", 0),
    plugins.GRAVITY: PluginGroup("gravity field", "Gravity fields", "body.gravity", "model", 1),
    plugins.BEHAVIORS: PluginGroup("behaviour", "Behaviours: who points at what", "behavior", "name", 2),
}


class Argument(NamedTuple):
    """One argument of a plug-in.

    Attributes:
        name: As `parameters` names it.
        default: As Python writes it; "required" where there is none.
        meaning: What the docstring says of it; empty if nothing.
        schema: JSON schema of its type; empty where the type says nothing to JSON.
    """

    name: str
    default: str
    meaning: str
    schema: dict[str, Any]


def installed(group: str) -> list[EntryPoint]:
    """The plug-ins of a group that installed packages declare, by name."""
    return sorted(entry_points(group=group), key=lambda entry: entry.name)


def summary_of(thing: Callable[..., Any]) -> str:
    """First sentence of a plug-in's docstring."""
    return first_sentence(inspect.getdoc(thing) or "")


def first_sentence(docstring: str) -> str:
    """What a docstring begins with; empty if there is nothing."""
    return docstring_parser.parse(docstring).short_description or ""


def arguments(thing: Callable[..., Any], given: int) -> list[Argument]:
    """Every argument that a scenario may give to a plug-in.

    Args:
        thing: The class or factory.
        given: How many arguments the program itself gives first.

    Raises:
        PluginError: It has no signature that Python can read.
    """
    try:
        found = list(inspect.signature(thing).parameters.values())[given:]
    except (TypeError, ValueError) as error:
        raise PluginError(f"{plugins.shown(thing)}: its arguments cannot be read: {plugins.in_words(error)}") from error
    owners = reversed(thing.__mro__) if isinstance(thing, type) else (thing,)  # a field may be told of in a base class
    words = {p.arg_name: p.description for owner in owners for p in docstring_parser.parse(owner.__doc__ or "").params}
    types = _types(thing)
    return [
        Argument(
            a.name, _default(a), " ".join((words.get(a.name) or "").split()), _schema(types.get(a.name), a.default)
        )
        for a in found
        if a.kind not in (a.VAR_POSITIONAL, a.VAR_KEYWORD)
    ]


def _default(argument: inspect.Parameter) -> str:
    return "required" if argument.default is argument.empty else repr(argument.default)


def _types(thing: Callable[..., Any]) -> dict[str, Any]:
    try:
        return get_type_hints(thing.__init__ if isinstance(thing, type) else thing)  # type: ignore[misc]
    except (NameError, TypeError, AttributeError):  # names that only a type checker sees
        return {}


def _schema(annotation: Any, default: Any) -> dict[str, Any]:
    if annotation is None:
        return {}
    try:
        schema = TypeAdapter(annotation).json_schema()
    except (PydanticUserError, PydanticInvalidForJsonSchema):
        return {}
    return schema if default is inspect.Parameter.empty or not _is_plain(default) else {**schema, "default": default}


def _is_plain(value: Any) -> bool:
    return value is None or isinstance(value, bool | int | float | str)
