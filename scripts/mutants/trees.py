"""Copies of the source tree in which faults are planted; the working tree is never touched.

Numba keeps machine code beside each source file and looks at the date of that file alone, so that a kernel that calls another
file's would go on with the code from before the fault. The copies therefore start from one tree whose tests have all been run,
without the machine code of every module that imports the faulty one, directly or not. All else stays compiled.
"""

from __future__ import annotations

import filecmp
import os
import shutil
import subprocess
from pathlib import Path

from scripts.import_graph import MAPPED, forget_compiled, import_graph, importers
from scripts.mutants.faults import Fault


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
        forget_compiled(tree, importers(tree, name))
    import_graph.cache_clear()
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
    forget_compiled(tree, importers(warm, fault.file))
