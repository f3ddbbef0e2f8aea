"""The JSON schema of scenario files for editors: the sections' own, and the arguments of every installed plug-in."""

from __future__ import annotations

from typing import Any

from swarm_mj import plugins
from swarm_mj.errors import PluginError
from swarm_mj.scenarios.plugin_arguments import GROUPS, PluginGroup, arguments, installed
from swarm_mj.scenarios.schema import Scenario


def json_schema() -> dict[str, Any]:
    """Schema of a scenario file; where a plug-in is named, `parameters` beside it may hold its arguments and no others.

    A plug-in that cannot be imported leaves its parameters free.
    """
    schema = Scenario.model_json_schema()
    for group, place in GROUPS.items():
        section = _section(schema, place)
        named = [rule for entry in installed(group) if (rule := _rule(group, entry.name, place)) is not None]
        section["allOf"] = [*section.get("allOf", []), *named]
    return schema


def _section(schema: dict[str, Any], place: PluginGroup) -> dict[str, Any]:
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
