"""The page docs/results/mutants.md."""

from __future__ import annotations

from scripts.mutants.faults import Fault
from scripts.mutants.trial import DIED, SURVIVED, TIME_LIMIT, Trial
from scripts.pages import RESULTS, ROOT

PAGE = RESULTS / "mutants.md"
__all__ = ["PAGE", "ROOT", "faults_of", "page_of", "share_of"]


def share_of(trials: dict[Fault, Trial]) -> float:
    """Part of the faults that died, equivalent ones counted as survivors."""
    return sum(trial.outcome == DIED for trial in trials.values()) / max(1, len(trials))


def faults_of(trials: dict[Fault, Trial]) -> dict[str, dict[Fault, Trial]]:
    """The same by room."""
    rooms = dict.fromkeys(fault.room for fault in trials)
    return {room: {fault: trial for fault, trial in trials.items() if fault.room == room} for room in rooms}


def page_of(trials: dict[Fault, Trial]) -> str:
    """The whole page."""
    died = sum(trial.outcome == DIED for trial in trials.values())
    lines = [
        "# Mutants",
        "",
        "Would the tests notice a fault? `make mutants` plants small ones in copies of the sources, one at a time (a sign,",
        "an index, a factor, a term left out, a limit), and runs the tests of that module. The faults are listed by hand in",
        "`scripts/mutants/faults`, over physics, observation, design, faults of the spacecraft and the environment; they are",
        "no random sample, and the share says nothing about faults of other kinds. A fault that is no program does not count",
        "as noticed.",
        "",
        "Not all of these were made in one call: what is found is kept while fault, file and tests stay as they are, though",
        "other modules may change; `make mutants ARGS=--afresh` finds all again.",
        "",
        f"**{died} of {len(trials)} died ({100 * share_of(trials):.1f} %).** {_of_survivors(trials)}",
    ]
    for room, some in faults_of(trials).items():
        rows = [f"| `{f.file}` | {f.what} | {_end_of(f, t)} |" for f, t in some.items()]
        lines += ["", f"## {room.capitalize()}", "", "| file | fault | noticed by |", "|---|---|---|", *rows]
    return "\n".join(lines) + "\n"


def _of_survivors(trials: dict[Fault, Trial]) -> str:
    if all(trial.outcome != SURVIVED for trial in trials.values()):
        return "None survived."
    return "What survived changes nothing that could be tested, for the reason given."


def _end_of(fault: Fault, trial: Trial) -> str:
    if trial.outcome == SURVIVED:
        return f"**survived**: {fault.equivalent or 'no test notices'}"
    if trial.outcome == TIME_LIMIT:
        return f"{trial.words}"
    file, _, name = trial.test.partition("::")
    return f"`{file}`: {name.partition('[')[0].removeprefix('test_').replace('_', ' ')}"
