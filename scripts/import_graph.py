"""Which source imports which, so that machine code goes that was compiled before a change.

Numba keeps machine code beside each source and looks at the date of that file alone: a kernel that calls one of another file
goes on with what that one was. `python -m scripts.import_graph` removes what is older than any source that it came from.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

#: Packages that an installation maps to other folders.
MAPPED = {"swarm_mj/envs": "envs", "swarm_mj/assets": "assets"}


def forget_stale(root: Path) -> set[str]:
    """Remove machine code of a checkout that is older than a source that it came from; returns whose."""
    graph = import_graph(root)
    changed = {name: (root / name).stat().st_mtime for name in graph}
    stale = set()
    for name in graph:
        kept = list(_compiled(root / name))
        if kept:
            oldest = min(path.stat().st_mtime for path in kept)
            if max(changed[source] for source in _reached(graph, name) & graph.keys()) > oldest:
                stale.add(name)
    forget_compiled(root, stale)
    return stale


def _compiled(file: Path) -> Iterator[Path]:
    yield from file.parent.glob(f"__pycache__/{file.stem}.*.nb[ic]")


def forget_compiled(tree: Path, names: Iterable[str]) -> None:
    """Remove the machine code of sources."""
    for name in names:
        for compiled in list(_compiled(tree / name)):
            compiled.unlink()


def importers(root: Path, changed: str) -> set[str]:
    """A file and all files that import it, directly or through others; relative to the root."""
    imported_by: dict[str, set[str]] = {}
    for name, needs in import_graph(root).items():
        for needed in needs:
            imported_by.setdefault(needed, set()).add(name)
    return _reached(imported_by, changed)


def _reached(edges: dict[str, set[str]], start: str) -> set[str]:
    found, new = set[str](), {start}
    while new:
        found |= new
        new = {other for each in new for other in edges.get(each, ())} - found
    return found


@cache
def import_graph(root: Path) -> dict[str, set[str]]:
    """What each source imports, relative to the root."""
    return {name: set(_imports(root, name)) for name in _sources(root)}


def _sources(root: Path) -> list[str]:
    return [
        path.relative_to(root).as_posix()
        for folder in ("swarm_mj", "envs", "assets", "tests")
        for path in sorted((root / folder).rglob("*.py"))
        if not path.is_symlink() and not any(path.is_relative_to(root / mapped) for mapped in MAPPED)
    ]


def _imports(root: Path, name: str) -> Iterator[str]:
    """Files that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse((root / name).read_text())):
        if isinstance(node, ast.Import):
            dotted = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            package = Path(name).parents[node.level - 1].as_posix().replace("/", ".") if node.level else ""
            base = ".".join(filter(None, (package, node.module)))
            dotted = [base, *(f"{base}.{alias.name}" for alias in node.names)]
        else:
            continue
        for module in dotted:
            path = module.replace(".", "/")
            for mapped, home in MAPPED.items():
                if path == mapped or path.startswith(f"{mapped}/"):
                    path = home + path.removeprefix(mapped)
            for candidate in (f"{path}.py", f"{path}/__init__.py"):
                if (root / candidate).is_file():
                    yield candidate


if __name__ == "__main__":
    gone = forget_stale(Path())
    if gone:
        print(f"machine code of {len(gone)} sources is older than what it came from: it will be compiled anew")
