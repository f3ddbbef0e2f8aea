"""Copies of the source tree in which faults are planted; the working tree is never touched.

Numba keeps machine code beside each source file and looks at the date of that file alone, so that a kernel that calls another
file's would go on with the code from before the fault. The copies therefore start from one tree whose tests have all been run,
without the machine code of every module that imports the faulty one, directly or not. All else stays compiled.
"""

from __future__ import annotations

import ast
import filecmp
import os
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

from scripts.mutants.faults import Fault

#: Packages that an installation maps to other folders.
MAPPED = {"swarm_mj/envs": "envs", "swarm_mj/assets": "assets"}


def copy_sources(root: Path, tree: Path) -> None:
    """Make a folder a copy of what git knows or would add, laid out so that the packages can be imported from there.

    Args:
        root: Of the repository.
        tree: The folder; what an earlier call left there is brought up to date.
    """
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=root,
        check=True,
        capture_output=True,
        text=True,
    )
    names = {name for name in listed.stdout.split("\0") if name and (root / name).is_file()}
    there = {path.relative_to(tree).as_posix() for path in tree.rglob("*") if path.is_file() and _is_source(path)}
    changed = {name for name in names & there if not filecmp.cmp(root / name, tree / name, shallow=False)}
    for name in changed | (there - names):
        _forget_compiled(tree, importers(tree, name))
    _import_graph.cache_clear()
    for name in there - names:
        (tree / name).unlink()
    for name in (names - there) | changed:
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(root / name, tree / name)
    for name, home in MAPPED.items():
        if not (tree / name).is_symlink():
            (tree / name).symlink_to(Path("..") / home)


def _is_source(path: Path) -> bool:
    return path.parent.name != "__pycache__"


def plant(fault: Fault, warm: Path, tree: Path) -> None:
    """Make a copy of a tree with a fault in it.

    Args:
        fault: See `Fault`.
        warm: Tree without faults whose tests have been run.
        tree: The new one.
    """
    # Without what the tests have kept on disk: it would hide the fault.
    kept = lambda folder, names: {"build"} & set(names) if Path(folder) == warm else set()  # noqa: E731
    shutil.copytree(warm, tree, symlinks=True, copy_function=os.link, ignore=kept)
    source = tree / fault.file
    text = source.read_text()
    source.unlink()  # all other files are those of the warm tree; this one is new, with a date of today
    source.write_text(text.replace(fault.old, fault.new))
    _forget_compiled(tree, importers(warm, fault.file))


def _forget_compiled(tree: Path, names: Iterable[str]) -> None:
    """Remove the machine code of sources."""
    for name in names:
        file = tree / name
        for compiled in file.parent.glob(f"__pycache__/{file.stem}.*.nb[ic]"):
            compiled.unlink()


def importers(root: Path, changed: str) -> set[str]:
    """A file and all files that import it, directly or through others; relative to the root."""
    imports = _import_graph(root)
    found, new = set[str](), {changed}
    while new:
        found |= new
        new = {name for name, needs in imports.items() if needs & new} - found
    return found


@cache
def _import_graph(root: Path) -> dict[str, set[str]]:
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
