"""The list of faults: which text of which file becomes which, and the tests that should notice."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

LISTS = Path(__file__).parent / "faults"


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault to plant.

    Attributes:
        room: The list that it stands in, such as "physics".
        file: The source, relative to the root of the repository.
        what: The fault in words.
        old: Text that stands in the file exactly once.
        new: What takes its place.
        tests: Files or ids of the tests that are run.
        equivalent: Why no test can notice; empty: one should.
    """

    room: str
    file: str
    what: str
    old: str
    new: str
    tests: tuple[str, ...]
    equivalent: str = ""

    @property
    def name(self) -> str:
        """Where and what, for people."""
        return f"{self.file}: {self.what}"


def read_faults(root: Path, lists: Path = LISTS) -> list[Fault]:
    """All faults of all lists.

    Args:
        root: Of the repository.
        lists: Folder of TOML files: tables `module` with `file`, `tests` and tables `fault` with `what`, `old`, `new`, and
            optionally `tests` of its own and `equivalent`.

    Raises:
        ValueError: A text does not stand in its file exactly once, nothing changes, a test file is missing, or a fault is
            listed twice; the message names all such faults.
    """
    faults = [
        Fault(
            room=path.stem,
            file=module["file"],
            what=given["what"],
            old=given["old"],
            new=given["new"],
            tests=tuple(given["tests"] if "tests" in given else module["tests"]),
            equivalent=given.get("equivalent", ""),
        )
        for path in sorted(lists.glob("*.toml"))
        for module in tomllib.loads(path.read_text())["module"]
        for given in module["fault"]
    ]
    wrong = [f"{fault.name}: {why}" for fault in faults if (why := _wrong_with(fault, root))]
    twice = {fault.name for fault in faults if sum(other.name == fault.name for other in faults) > 1}
    wrong += [f"{name}: is listed twice" for name in sorted(twice)]
    if wrong:
        raise ValueError("\n".join(wrong))
    return faults


def _wrong_with(fault: Fault, root: Path) -> str:
    source = root / fault.file
    times = source.read_text().count(fault.old) if source.is_file() else 0
    if times != 1:
        return f"the text {fault.old!r} stands there {times} times; it must stand there exactly once"
    if fault.old == fault.new:
        return "old and new are the same"
    missing = [test for test in fault.tests if not (root / test.partition("::")[0]).is_file()]
    return f"there is no test {', '.join(missing)}" if missing or not fault.tests else ""
