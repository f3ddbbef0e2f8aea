"""The page docs/results/mutants.md."""

from __future__ import annotations

from pathlib import Path

from scripts.mutants.faults import Fault
from scripts.mutants.findings import Finding
from scripts.mutants.trial import DIED, SURVIVED
from scripts.pages import RESULTS, ROOT

PAGE = RESULTS / "mutants.md"
__all__ = ["PAGE", "ROOT", "by_room", "page_of"]


def by_room(faults: list[Fault]) -> dict[str, list[Fault]]:
    """The same by the list that they stand in."""
    return {room: [fault for fault in faults if fault.room == room] for room in dict.fromkeys(f.room for f in faults)}


def page_of(faults: list[Fault], findings: dict[str, Finding], root: Path = ROOT) -> str:
    """The whole page.

    Args:
        faults: All that are listed.
        findings: What came of them, by name; of some nothing may be known, or what was before the code changed.
        root: Of the repository.
    """
    known = {fault.name: findings[fault.name] for fault in faults if fault.name in findings}
    today = {fault.name for fault in faults if fault.name in known and known[fault.name].holds(fault, root)}
    died = sum(known[name].outcome == DIED for name in today)
    lines = [
        "# Mutants",
        "",
        "Would the tests notice a fault? `make mutants` plants small ones in copies of the sources, one at a time (a sign,",
        "an index, a factor, a term left out, a limit), and runs the tests of that module. The faults are listed by hand in",
        "`scripts/mutants/faults`, by the parts of the program; they are no random sample, and the share says nothing about",
        "faults of other kinds. A fault that is no program does not count as noticed.",
        "",
        "Not all of these were run in one call: a finding is kept while the fault, the function that it stands in and the",
        "test that noticed it stay as they are, though others may change. `make mutants` runs all others,",
        "`make mutants ARGS=NAME` those of a list or a file, and `make mutants ARGS=--afresh` all again.",
        "",
        f"**{died} of {len(today)} died ({100 * died / max(1, len(today)):.1f} %).** {_of_others(faults, known, today)}",
    ]
    for room, some in by_room(faults).items():
        rows = [f"| `{f.file}` | {f.what} | {_end_of(f, known.get(f.name), f.name in today)} |" for f in some]
        lines += ["", f"## {room.capitalize()}", "", "| file | fault | noticed by |", "|---|---|---|", *rows]
    return "\n".join(lines) + "\n"


def _of_others(faults: list[Fault], known: dict[str, Finding], today: set[str]) -> str:
    lived = any(known[name].outcome == SURVIVED for name in today)
    said = ["What survived changes nothing that could be tested, for the reason given." if lived else "None survived."]
    if changed := len(known) - len(today):
        said.append(f"{changed} more were run before their code or their test changed last.")
    if never := len(faults) - len(known):
        said.append(f"{never} are listed and were not run yet.")
    return " ".join(said)


def _end_of(fault: Fault, finding: Finding | None, of_today: bool) -> str:
    if finding is None:
        return "not run yet"
    before = "" if of_today else "before the last change: "
    if finding.outcome == SURVIVED:
        return f"{before}**survived**: {fault.equivalent or 'no test notices'}"
    file, _, name = finding.test.partition("::")
    return f"{before}`{file}`: {name.partition('[')[0].removeprefix('test_').replace('_', ' ')}"
