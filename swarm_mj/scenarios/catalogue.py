"""What a scenario can name: packaged scenarios, installed plug-ins, and the keys and arguments of both, as plain rows.

Nothing here loads more than it must, so that the commands that list things are quick: a description is read from a file, and
that of a plug-in of this package from the source of its module.
"""

from __future__ import annotations

import ast
from importlib import resources
from importlib.metadata import EntryPoint
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from swarm_mj import plugins
from swarm_mj.errors import PluginError
from swarm_mj.scenarios.keys import Key, find_keys
from swarm_mj.scenarios.loading import packaged_names, packaged_text, parse_yaml
from swarm_mj.scenarios.plugin_arguments import GROUPS, PluginGroup, arguments, first_sentence, installed, summary_of

#: The package whose own plug-ins are known to load.
OWN = "swarm_mj"


class Named(NamedTuple):
    """Something with a name: what kind of thing, and what it is for in one line."""

    kind: str
    name: str
    description: str


def available() -> list[Named]:
    """What can be named: packaged scenarios and campaigns, installed plug-ins; one that cannot be loaded with the reason."""
    scenarios = [Named("scenario", name, _description(packaged_text(name), name)) for name in packaged_names()]
    return [*scenarios, *_packaged_campaigns(), *_installed_plugins()]


def _packaged_campaigns() -> list[Named]:
    folder = resources.files("swarm_mj.scenarios") / "campaigns"
    texts = {file.name.removesuffix(".yaml"): file.read_text("utf-8") for file in folder.iterdir()}
    return [Named("campaign", name, _description(texts[name], name)) for name in sorted(texts)]


def _installed_plugins() -> list[Named]:
    return [
        Named(place.kind, entry.name, _line(_summary(group, entry)))
        for group, place in GROUPS.items()
        for entry in installed(group)
    ]


def explained(name: str = "") -> list[Key]:
    """Keys of a scenario by their whole names, or the arguments of a plug-in, whose type, unit and bounds are in their meaning.

    Args:
        name: A section, a key or a plug-in; empty: every key.

    Raises:
        ScenarioError: There is no such section, key or plug-in.
        PluginError: The plug-in cannot be loaded.
    """
    for group, place in GROUPS.items():
        if name in plugins.names(group):
            return _arguments(group, name, place)
    return [key._replace(name=whole, default=key.default.strip("`")) for whole, key in find_keys(name)]


def _description(text: str, name: str) -> str:
    return _line(str(parse_yaml(text, name).get("description", "")))


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
