"""What came of the faults, kept between calls beside the page, and whether it still tells of the code as it is.

A finding rests on the fault, on the function or class at the top of its file that it stands in, and on the test that noticed it
(of one that survived: on the files of all its tests). Where any of these changes, the fault is run again.
"""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from scripts.mutants.faults import Fault
from scripts.mutants.trial import DIED, SURVIVED, Trial
from swarm_mj.io.atomic import write_text


@dataclass(frozen=True)
class Finding:
    """What came of a fault.

    Attributes:
        outcome: DIED or SURVIVED.
        test: The test that noticed; empty: none.
        state: Digest of what this rests on.
    """

    outcome: str
    test: str
    state: str

    def holds(self, fault: Fault, root: Path) -> bool:
        """Whether all that it rests on is as it was."""
        return self.state == _state(fault, self.test, root)


def finding_of(fault: Fault, trial: Trial, root: Path) -> Finding | None:
    """To be kept; None where a trial says nothing of the tests.

    Args:
        fault: That was planted.
        trial: What came of it.
        root: Of the sources that it was planted in a copy of.
    """
    if trial.outcome not in (DIED, SURVIVED):
        return None
    return Finding(trial.outcome, trial.test, _state(fault, trial.test, root))


def read_findings(file: Path) -> dict[str, Finding]:
    """Findings by the name of the fault; none where there is no file."""
    found = json.loads(file.read_text()) if file.is_file() else {}
    return {name: Finding(**given) for name, given in found.items()}


def write_findings(file: Path, findings: dict[str, Finding], faults: Iterable[Fault]) -> None:
    """Keep those of faults that are listed, a line each."""
    kept = [fault.name for fault in faults if fault.name in findings]
    lines = [f"{json.dumps(name)}: {json.dumps(asdict(findings[name]))}" for name in kept]
    write_text(file, "{\n" + ",\n".join(lines) + "\n}\n")


def _state(fault: Fault, test: str, root: Path) -> str:
    parts = [fault.file, fault.what, fault.old, fault.new, _around((root / fault.file).read_text(), fault.old)]
    parts += [_of_test(root, test)] if test else [(root / name.partition("::")[0]).read_text() for name in fault.tests]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


def _around(text: str, old: str) -> str:
    """The statements at the top of a module that a text stands in."""
    first = text.count("\n", 0, text.index(old)) + 1
    last = first + old.rstrip("\n").count("\n")
    return _lines(text, lambda node: _first_line(node) <= last and first <= (node.end_lineno or node.lineno))


def _of_test(root: Path, test: str) -> str:
    """The function or class of a test's id; empty: it is gone."""
    file, name = root / test.partition("::")[0], test.split("::")[1].partition("[")[0]
    return _lines(file.read_text(), lambda node: getattr(node, "name", "") == name) if file.is_file() else ""


def _lines(text: str, wanted: Callable[[ast.stmt], bool]) -> str:
    lines = text.splitlines()
    nodes = [node for node in ast.parse(text).body if wanted(node)]
    return "\n".join("\n".join(lines[_first_line(node) - 1 : node.end_lineno]) for node in nodes)


def _first_line(node: ast.stmt) -> int:
    return min([node.lineno, *(above.lineno for above in getattr(node, "decorator_list", []))])
