"""The page of plug-ins: every registered entry point with its arguments and defaults."""

from __future__ import annotations

from importlib.metadata import EntryPoint

from swarm_mj import plugins
from swarm_mj.scenarios.catalogue import GROUPS, PluginGroup, arguments, installed, summary_of


def page() -> str:
    """Markdown of the page."""
    return "\n".join([INTRODUCTION, *(_group(group, place) for group, place in GROUPS.items())])


def _group(group: str, place: PluginGroup) -> str:
    members = ", ".join(f"`{member}`" for member in plugins.MEMBERS[group])
    entries = [entry for entry in installed(group) if entry.value.startswith("swarm_mj.")]
    return (
        f"## {place.title}\n\nEntry points `{group}`; named by `{place.section}.{place.key}`, with arguments in "
        f"`{place.section}.parameters`. Each must have {members}.\n\n"
        + "\n".join(_entry(entry, place) for entry in entries)
    )


def _entry(entry: EntryPoint, place: PluginGroup) -> str:
    thing = entry.load()
    path = f"{thing.__module__}.{thing.__qualname__}"
    rows = [f"| `{a.name}` | {_code(a.default)} | {_cell(a.meaning)} |" for a in arguments(thing, place.given)]
    head = ["| argument | default | meaning |", "|---|---|---|"]
    table = "\n".join([*head, *rows]) + "\n" if rows else "It takes no arguments.\n"
    return f"### {entry.name}\n\n{summary_of(thing)} Reference: [`{path}`][{path}].\n\n{table}"


def _code(default: str) -> str:
    return default if default == "required" else f"`{default}`"


def _cell(words: str) -> str:
    return words.replace("|", "\\|")


INTRODUCTION = """# Plug-ins

Generated from the installed entry points when the site is built; `swarm-mj explain NAME` prints the same. A scenario names a
plug-in and gives its arguments; a package of one's own adds plug-ins by entry points: [your own body and
plug-ins](../how-to/body_and_plug_ins.md), [a control law of one's own](../how-to/control_law.md).
"""
