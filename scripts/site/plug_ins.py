"""The page of plug-ins: every registered entry point with its arguments and defaults."""

from __future__ import annotations

import inspect
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from griffe import Docstring

from swarm_mj import plugins

#: What stands about each group: the key that names a plug-in, and what it is given before its own parameters.
GROUPS = {
    plugins.CONTROLLERS: ("control.controller", "control.parameters", "Attitude control laws"),
    plugins.GRAVITY: ("body.gravity.model", "body.gravity.parameters", "Gravity fields"),
    plugins.BEHAVIORS: ("behavior.name", "behavior.parameters", "Behaviours: who points at what"),
}
#: Arguments that the program gives itself.
GIVEN = {"shape", "n_observers", "imaging_radius_m"}


def page() -> str:
    """Markdown of the page."""
    return "\n".join([INTRODUCTION, *(_group(group, *words) for group, words in GROUPS.items())])


def _group(group: str, key: str, parameters: str, title: str) -> str:
    members = ", ".join(f"`{member}`" for member in plugins.MEMBERS[group])
    entries = sorted((e for e in entry_points(group=group) if e.value.startswith("swarm_mj.")), key=lambda e: e.name)
    return (
        f"## {title}\n\nEntry points `{group}`; named by `{key}`, with arguments in `{parameters}`. "
        f"Each must have {members}.\n\n" + "\n".join(_entry(entry) for entry in entries)
    )


def _entry(entry: EntryPoint) -> str:
    thing = entry.load()
    place = f"{thing.__module__}.{thing.__qualname__}"
    words = inspect.getdoc(thing) or ""
    rows = [f"| `{name}` | {default} | {meaning} |" for name, default, meaning in arguments(thing)]
    head = ["| argument | default | meaning |", "|---|---|---|"]
    table = "\n".join([*head, *rows]) + "\n" if rows else "It takes no arguments.\n"
    return f"### {entry.name}\n\n{words.splitlines()[0]} Reference: [`{place}`][{place}].\n\n{table}"


def arguments(thing: Any) -> list[tuple[str, str, str]]:
    """Name, default and meaning of every argument that a scenario may give to a plug-in."""
    described = _described(inspect.getdoc(thing) or "")
    given = [a for a in inspect.signature(thing).parameters.values() if a.name not in GIVEN]
    return [(a.name, _default(a), described.get(a.name, "")) for a in given]


def _described(docstring: str) -> dict[str, str]:
    """What the sections on arguments and attributes of a docstring say, by name."""
    sections = Docstring(docstring, parser="google", parser_options={"warnings": False}).parsed
    items = [
        item for section in sections if section.kind.value in ("parameters", "attributes") for item in section.value
    ]
    return {item.name: " ".join(item.description.split()).replace("|", "\\|") for item in items}


def _default(argument: Any) -> str:
    return "required" if argument.default is inspect.Parameter.empty else f"`{argument.default!r}`"


INTRODUCTION = """# Plug-ins

Generated from the installed entry points when the site is built. A scenario names a plug-in and gives its arguments; a package
of one's own adds plug-ins by entry points: [your own body and plug-ins](../how-to/body_and_plug_ins.md), [a control law of
one's own](../how-to/control_law.md).
"""
