"""The API reference: one page for the public names, one for every room, from the docstrings."""

from __future__ import annotations

import ast
import re
import shutil
from collections.abc import Iterator, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
#: Where the sources are laid out as they are imported, for the reader of docstrings; see mkdocs.yml.
SOURCES = ROOT / "build" / "api"
#: Packages that stand beside the library and are imported as parts of it.
BESIDE = ("envs",)
#: What is said of a field beside it, or above it; the reader of docstrings knows only a string below it.
BESIDE_A_FIELD = re.compile(r"^( *)(\w+(?::| =) .+?)  #: (.+)$", re.MULTILINE)
ABOVE_A_FIELD = re.compile(r"^    #: (.+(?:\n    #: .+)*)\n(    \w+: .*[^(\[{\n])$", re.MULTILINE)


class Module(NamedTuple):
    """A module by its dotted name, with its code parsed."""

    name: str
    code: ast.Module

    @property
    def says(self) -> str:
        """Its docstring."""
        return ast.get_docstring(self.code) or ""

    @property
    def defines(self) -> bool:
        """Whether it has functions, classes or names of its own; many packages only say what they are and import names."""
        own = (ast.FunctionDef, ast.ClassDef, ast.AnnAssign)
        return any(isinstance(node, own) and not _name(node).startswith("_") for node in self.code.body)


def _name(node: ast.AST) -> str:
    return getattr(node, "name", "") or getattr(getattr(node, "target", None), "id", "")


def lay_out() -> None:
    """Copy the sources as `import swarm_mj` sees them, with `swarm_mj.envs` inside."""
    shutil.rmtree(SOURCES, ignore_errors=True)
    only_code = shutil.ignore_patterns("__pycache__", "*.yaml", "*.json", "*.nbi", "*.nbc")
    shutil.copytree(ROOT / "swarm_mj", SOURCES / "swarm_mj", ignore=only_code)
    for name in BESIDE:
        shutil.copytree(ROOT / name, SOURCES / "swarm_mj" / name, ignore=only_code)
    for path in SOURCES.rglob("*.py"):
        path.write_text(with_fields_described(path.read_text("utf-8")), "utf-8")


def with_fields_described(code: str) -> str:
    """Python code in which the `#:` comments of fields stand below them as docstrings."""

    def string(comment: str) -> str:
        says = " ".join(line.strip().removeprefix("#: ") for line in comment.split("\n"))
        return repr(f"{says[0].upper()}{says[1:]}.")

    code = ABOVE_A_FIELD.sub(lambda m: f"{m[2]}\n    {string(m[1])}", code)
    return BESIDE_A_FIELD.sub(lambda m: f"{m[1]}{m[2]}\n{m[1]}{string(m[3])}", code)


@cache
def rooms() -> dict[str, list[Module]]:
    """Modules of every room by its name; modules at the top of the package are rooms of one."""
    found: dict[str, list[Module]] = {}
    for module in sorted(_modules(), key=lambda module: module.name):
        if module.name not in ("swarm_mj", "swarm_mj.__main__"):
            found.setdefault(module.name.split(".")[1], []).append(module)
    return found


def _modules() -> Iterator[Module]:
    for folder, package in ((ROOT / "swarm_mj", "swarm_mj"), *((ROOT / name, f"swarm_mj.{name}") for name in BESIDE)):
        for path in folder.rglob("*.py"):
            inside = path.relative_to(folder).with_suffix("").parts
            name = ".".join((package, *(part for part in inside if part != "__init__")))
            yield Module(name, ast.parse(path.read_text("utf-8")))


def room_page(room: str, modules: Sequence[Module]) -> str:
    """Markdown of a room's page: what every module defines, in the order in which it stands there."""
    parts = [f"# swarm_mj.{room}\n"]
    for module in modules:
        if module.defines:
            parts.append(f"::: {module.name}\n    options:\n      show_submodules: false\n")
        else:
            heading = "" if module.name == f"swarm_mj.{room}" else f"## {module.name}\n\n"
            parts.append(f"{heading}{module.says}\n")
    return "\n".join(parts)


def public_page() -> str:
    """Markdown of the page of the names that `import swarm_mj as sm` offers, each where it is defined."""
    package = import_module("swarm_mj")
    parts = [
        "# Public API\n\n"
        "Everything here is reached by `import swarm_mj as sm`; a name is imported when it is first used. The modules that "
        "these names come from, and all others, are on the pages of the rooms.\n"
    ]
    for name in sorted(package.__all__, key=lambda name: (name[0].isupper(), name)):  # functions, then classes
        thing = getattr(package, name)
        place = f"{thing.__module__}.{thing.__qualname__}"
        parts.append(
            f"::: {place}\n    options:\n      heading: sm.{name}\n      toc_label: {name}\n      skip_local_inventory: true\n"
        )
    return "\n".join(parts)
