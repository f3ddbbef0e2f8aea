"""What a scenario can name: packaged scenarios, installed plug-ins, the keys and arguments of both, and the JSON schema of all.

Arguments of a plug-in are read off its signature and docstring. Listing loads no more than it must, so that its commands are
quick: a description is read from a file, and that of a plug-in of this package from the source of its module.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

import docstring_parser
from pydantic import PydanticUserError, TypeAdapter
from pydantic.errors import PydanticInvalidForJsonSchema

from swarm_mj import plugins
from swarm_mj.errors import PluginError
from swarm_mj.scenarios.bodies import packaged_files
from swarm_mj.scenarios.keys import Key, find_keys
from swarm_mj.scenarios.loading import parse_yaml
from swarm_mj.scenarios.schema import Scenario

#: The package whose own plug-ins are known to load.
OWN = "swarm_mj"


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
    """Every argument that a scenario may give to a class or factory, to which the program itself gives `given` first.

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
            name=a.name,
            default="required" if a.default is a.empty else repr(a.default),
            meaning=" ".join((words.get(a.name) or "").split()),
            schema=_schema(types.get(a.name), a.default),
        )
        for a in found
        if a.kind not in (a.VAR_POSITIONAL, a.VAR_KEYWORD)
    ]


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
    return {**schema, "default": default} if isinstance(default, int | float | str | None) else schema


class Named(NamedTuple):
    """Something with a name: what kind of thing, and what it is for in one line."""

    kind: str
    name: str
    description: str


def available() -> list[Named]:
    """What can be named: packaged scenarios and campaigns, installed plug-ins; one that cannot be loaded with the reason."""
    packaged = [
        Named(kind, name, _line(str(parse_yaml(file.read_text("utf-8"), name).get("description", ""))))
        for kind, folder in (("scenario", ""), ("campaign", "campaigns"))
        for name, file in packaged_files(folder).items()
    ]
    plug_ins = [
        Named(place.kind, entry.name, _line(_summary(group, entry)))
        for group, place in GROUPS.items()
        for entry in installed(group)
    ]
    return packaged + plug_ins


def explained(name: str = "") -> list[Key]:
    """Keys of a section, or all, by their whole names; or a plug-in's arguments, whose meaning says type, unit and bounds too.

    Raises:
        ScenarioError: There is no such section, key or plug-in.
        PluginError: The plug-in cannot be loaded.
    """
    for group, place in GROUPS.items():
        if name in plugins.names(group):
            return _arguments(group, name, place)
    return [key._replace(name=whole, default=key.default.strip("`")) for whole, key in find_keys(name)]


def _arguments(group: str, name: str, place: PluginGroup) -> list[Key]:
    known = arguments(plugins.find(group, name), place.given)
    return [Key(f"{place.section}.parameters.{a.name}", "", "", a.default, "", a.meaning) for a in known]


def _summary(group: str, entry: EntryPoint) -> str:
    docstring = _docstring_in_source(entry)
    if docstring is not None:
        return first_sentence(docstring)
    try:
        return summary_of(plugins.find(group, entry.name))
    except PluginError as error:
        return str(error)


def _docstring_in_source(entry: EntryPoint) -> str | None:
    """The docstring of a class or function of this package, read without importing its module; None of any other plug-in."""
    package, room, *rest = *entry.module.split("."), "", ""
    spec = find_spec(f"{package}.{room}") if package == OWN else None  # of one below, it would import all above
    if spec is None or spec.origin is None:
        return None
    path = Path(spec.origin).parent.joinpath(*filter(None, rest)).with_suffix(".py")
    kinds = (ast.ClassDef, ast.FunctionDef)
    top = ast.parse(path.read_text("utf-8")).body if path.is_file() else []
    return next((ast.get_docstring(node) for node in top if isinstance(node, kinds) and node.name == entry.attr), None)


def _line(words: str) -> str:
    return " ".join(words.split())


def json_schema() -> dict[str, Any]:
    """Schema of a scenario file; where a plug-in is named, `parameters` beside it may hold its arguments and no others.

    A plug-in that cannot be imported leaves its parameters free.
    """
    schema = Scenario.model_json_schema()
    for group, place in GROUPS.items():
        section = _naming_section(schema, place)
        named = [rule for entry in installed(group) if (rule := _rule(group, entry.name, place)) is not None]
        section["allOf"] = [*section.get("allOf", []), *named]
    return schema


def _naming_section(schema: dict[str, Any], place: PluginGroup) -> dict[str, Any]:
    """The definition of the section that names plug-ins of a group."""
    found: dict[str, Any] = schema
    for key in place.section.split("."):
        found = found["properties"][key]
        # A body may be a name too: of several forms the one with keys is meant.
        reference = next(form["$ref"] for form in (found, *found.get("anyOf", [])) if "$ref" in form)
        found = schema["$defs"][reference.rsplit("/", 1)[-1]]
    return found


def _rule(group: str, name: str, place: PluginGroup) -> dict[str, Any] | None:
    """If the section names this plug-in, its parameters are these."""
    try:
        thing = plugins.find(group, name)
        known = arguments(thing, place.given)
    except PluginError:
        return None
    properties = {a.name: {**a.schema, **({"description": a.meaning} if a.meaning else {})} for a in known}
    required = [a.name for a in known if a.default == "required"]
    parameters = {"properties": properties, "additionalProperties": False, "required": required}
    return {
        "if": {"properties": {place.key: {"const": name}}, "required": [place.key]},
        "then": {"properties": {"parameters": parameters}},
    }
