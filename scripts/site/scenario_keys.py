"""The page of scenario keys: every key with type, unit, default, allowed values and meaning, from the schema."""

from __future__ import annotations

from pydantic import BaseModel

from swarm_mj.scenarios.keys import keys, sections
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_faults import FAULT_KINDS


def page() -> str:
    """Markdown of the page."""
    parts = [INTRODUCTION, "## Top level\n", _table(Scenario)]
    for path, section in sections(Scenario):
        parts += [f"## {path}\n", f"{_doc(section)}\n", _table(section)]
    parts.append(FAULTS)
    for kind, fault in FAULT_KINDS.items():
        parts += [f"### {kind}\n", f"{_doc(fault)}\n", _table(fault)]
    return "\n".join(parts)


def _doc(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split())


def _table(model: type[BaseModel]) -> str:
    rows = ["| key | type | unit | default | allowed | meaning |", "|---|---|---|---|---|---|"]
    for key in keys(model):
        cells = (f"`{key.name}`", *(_cell(part) for part in key[1:]))
        rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows) + "\n"


def _cell(words: str) -> str:
    """Text for a cell of a table; bars inside code need no escape."""
    return "`".join(part if k % 2 else part.replace("|", "\\|") for k, part in enumerate(words.split("`")))


INTRODUCTION = """# Scenario keys

Generated from the schema (`swarm_mj.scenarios.schema`) when the site is built. A scenario is a YAML file with these sections;
what it leaves out takes the default. `swarm-mj packaged eros-config1` prints a whole one to start from, `swarm-mj
json-schema` the schema for editors. Any value may be changed by its dotted key: `--set camera.half_angle_deg=6` on the
command line, `sm.load("eros-config1", {"camera.half_angle_deg": 6})` in Python. Unknown keys, values of the wrong type and
numbers outside of what is allowed are refused with an error that names the key, the value and what is allowed.
"""
FAULTS = """## Faults

`faults` is a list; each entry has a `kind` and the keys of that kind. The models behind them: [faults](../how-to/faults.md).
"""
