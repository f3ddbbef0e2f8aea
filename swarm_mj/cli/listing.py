"""Names and keys with what they mean, printed for the screen; without the heavy modules of results."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from swarm_mj.scenarios.catalogue import Named


def print_names(named: Sequence[Named], indent: str = "") -> None:
    """Names and descriptions, a line each."""
    width = max(len(one.name) for one in named)
    for one in named:
        print(f"{indent}{one.name:{width}}  {one.description}")


def print_keys(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """What `catalogue.explained` gives: a line for each key's form, and its meaning indented below."""
    found = [dict(zip(columns, row, strict=True)) for row in rows]
    if not found:
        print("  it takes no arguments")
    for row in found:
        facts = [row.get("type", ""), f"[{row['unit']}]" if row.get("unit") else "", _default_words(row["default"])]
        allowed = row.get("allowed", "").replace("`", "")
        print(f"{row['key']}: {', '.join(filter(None, [*facts, allowed]))}")
        print(textwrap.indent(textwrap.fill(row["meaning"], 100), "    "))


def _default_words(default: str) -> str:
    return "required" if default == "required" else f"default {default}"
