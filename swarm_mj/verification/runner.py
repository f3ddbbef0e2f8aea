"""`swarm-mj validate`: run the checks with a progress bar, print their table, say whether all passed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from swarm_mj.errors import SwarmError
from swarm_mj.io import interruption
from swarm_mj.io.progress import progress_bars
from swarm_mj.verification import (  # noqa: F401, since they add their checks
    attitude,
    control,
    coverage,
    ephemerides,
    gravity,
    links,
    orbits,
    report,
    target,
)
from swarm_mj.verification.experiment import EXPERIMENTS, Bench, Check, Experiment

#: Groups of checks in the order in which they are run.
GROUPS = ("gravity", "orbit", "trajectories", "attitude", "control", "ephemeris", "target", "coverage", "links")
EXPERIMENTS.sort(key=lambda experiment: GROUPS.index(experiment.group))


def choose(only: Sequence[str]) -> list[Experiment]:
    """Checks by name or by group (the first word of a name), in the order of the table; all if none is named.

    Raises:
        SwarmError: A name is unknown; the message lists all.
    """
    known = {name for experiment in EXPERIMENTS for name in (experiment.name, experiment.group)}
    for name in only:
        if name not in known:
            close = get_close_matches(name, known, 1)
            guess = f"; did you mean {close[0]}?" if close else ""
            names = ", ".join(experiment.name for experiment in EXPERIMENTS)
            raise SwarmError(f"--only {name}: no such check{guess} Groups: {', '.join(GROUPS)}. Checks: {names}")
    return [e for e in EXPERIMENTS if not only or e.name in only or e.group in only]


def run_validation(
    only: Sequence[str] = (),
    json_path: Path | None = None,
    markdown_path: Path | None = None,
    quiet: bool = False,
) -> int:
    """Run the physics checks on the installed program.

    Args:
        only: Names of checks or groups; empty: all.
        json_path: Write the results here as JSON.
        markdown_path: Write the results here as a Markdown page.
        quiet: No progress bar.

    Returns:
        Exit status: 0 if no check failed, else 1. Checks that cannot be run here do not fail.

    Raises:
        SwarmError: A name is unknown, or a file cannot be written.
    """
    console, start = Console(), time.perf_counter()
    with progress_bars(console, quiet) as bars:
        checks = run_experiments(choose(only), bars)
    console.print(report.table(checks))
    console.print(f"{report.totals(checks)}; {time.perf_counter() - start:.1f} s", highlight=False)
    if json_path is not None:
        report.write_json(json_path, checks)
    if markdown_path is not None:
        report.write_markdown(markdown_path, checks)
    return int(any(check.passed is False for check in checks))


def run_experiments(experiments: Sequence[Experiment], bars: Progress | None = None) -> list[Check]:
    """Run checks one after another on a common bench; `bars` shows how far it is."""
    bench, checks = Bench(), list[Check]()
    task = None if bars is None else bars.add_task("validate", total=len(experiments))
    for experiment in experiments:
        if bars is not None and task is not None:
            bars.update(task, completed=len(checks), description=f"validate: {experiment.name}")
        checks.append(experiment.run(bench))
        interruption.check()
    if bars is not None and task is not None:
        bars.update(task, completed=len(checks), description="validate")
    return checks
