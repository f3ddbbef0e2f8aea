"""`swarm-mj validate`: run the checks with a progress bar, print their table, say whether all passed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from swarm_mj.io.progress import progress_bars
from swarm_mj.verification.physics import report
from swarm_mj.verification.physics.experiment import Bench, Check, Experiment
from swarm_mj.verification.physics.registry import choose


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
    checks = run_experiments(choose(only), console, quiet)
    console.print(report.table(checks))
    console.print(f"{report.totals(checks)}; {time.perf_counter() - start:.1f} s", highlight=False)
    if json_path is not None:
        report.write_json(json_path, checks)
    if markdown_path is not None:
        report.write_markdown(markdown_path, checks)
    return int(any(check.passed is False for check in checks))


def run_experiments(experiments: Sequence[Experiment], console: Console, quiet: bool = False) -> list[Check]:
    """Run checks one after another on a common bench."""
    bench, checks = Bench(), []
    with progress_bars(console, quiet) as progress:
        task = progress.add_task("validate", total=len(experiments))
        for experiment in experiments:
            progress.update(task, description=f"validate: {experiment.name}")
            checks.append(experiment.run(bench))
            progress.advance(task)
        progress.update(task, description="validate")
    return checks
