"""`swarm-mj validate`: run the checks with a progress bar, print their table, say whether all passed; as JSON and Markdown."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Sequence
from dataclasses import asdict
from difflib import get_close_matches
from importlib.metadata import PackageNotFoundError, version
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from swarm_mj.errors import SwarmError
from swarm_mj.io import interruption
from swarm_mj.io.atomic import write_text
from swarm_mj.io.progress import progress_bars
from swarm_mj.io.records import writing
from swarm_mj.verification import (  # noqa: F401, since they add their checks
    attitude,
    control,
    coverage,
    ephemerides,
    gravity,
    links,
    orbits,
    target,
)
from swarm_mj.verification.experiment import EXPERIMENTS, Bench, Check, Experiment

#: Groups of checks in the order in which they are run.
GROUPS = ("gravity", "orbit", "trajectories", "attitude", "control", "ephemeris", "target", "coverage", "links")
EXPERIMENTS.sort(key=lambda experiment: GROUPS.index(experiment.group))

#: Packages whose versions are stated beside the results.
PACKAGES = ("swarm_mj", "mujoco", "numpy", "scipy", "numba", "embreex", "astropy", "shapely", "polyhedral-gravity")

_PAGE = """\
# Validation

Written by `swarm-mj validate --markdown docs/results/validation.md`. Every check compares what the installed program
computes with another way to the same number: a closed form, a conservation law, a published value, another integrator or
another program. It fails when the measured number leaves its tolerance. Whole flights beside Orekit, brahe, SPICE and Basilisk
are on the page [agreement](agreement.md).

| check | what is measured | independent reference | tolerance | measured | result |
|---|---|---|---:|---:|---|
{rows}

{totals}. {versions}.

Run it yourself with `swarm-mj validate`; `--only NAME` runs one check or group, `--json FILE` writes the numbers. Checks
against astropy, shapely and polyhedral_gravity need `pip install 'swarm_mj[dev]'` and are listed as not run without it. The
tests break the program on purpose, once for every check, and see the check fail.
"""


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
    """Run checks by their names or groups, print their table and write their results to files.

    Returns:
        Exit status: 0 if no check failed, else 1. Checks that cannot be run here do not fail.

    Raises:
        SwarmError: A name is unknown, or a file cannot be written.
    """
    console, start = Console(), time.perf_counter()
    with progress_bars(console, quiet) as bars:
        checks = run_experiments(choose(only), bars)
    console.print(table(checks))
    console.print(f"{totals(checks)}; {time.perf_counter() - start:.1f} s", highlight=False)
    for path, text_of in ((json_path, json_text), (markdown_path, markdown_page)):
        if path is not None:
            with writing(path, "choose another file"):
                path.parent.mkdir(parents=True, exist_ok=True)
                write_text(path, text_of(checks))
    return int(any(check.passed is False for check in checks))


def run_experiments(experiments: Sequence[Experiment], bars: Progress | None = None) -> list[Check]:
    """Run checks one after another on a common bench; `bars` shows how far it is."""
    bench, checks, bars = Bench(), list[Check](), bars or Progress(disable=True)
    task = bars.add_task("validate", total=len(experiments))
    for experiment in experiments:
        bars.update(task, completed=len(checks), description=f"validate: {experiment.name}")
        checks.append(experiment.run(bench))
        interruption.check()
    bars.update(task, completed=len(checks), description="validate")
    return checks


def table(checks: Sequence[Check]) -> Table:
    """A table for the screen, a section for every group; fits a terminal of 80 columns."""
    result = Table(title="Validation", title_justify="left", expand=True)
    result.add_column("check", min_width=max((len(check.name) for check in checks), default=0), ratio=3)
    result.add_column("independent reference", ratio=2)
    result.add_column("measured,\ntolerance", justify="right", no_wrap=True)
    result.add_column("result", no_wrap=True)
    for _, group in groupby(checks, lambda check: check.name.split("-")[0]):
        for check in group:
            lines = (f"[bold]{check.name}[/]", escape(check.what), *([escape(check.note)] if check.note else ()))
            numbers = escape(f"{measured(check)}\n{tolerance(check)}")
            result.add_row("\n".join(lines), escape(check.reference), numbers, _coloured(check))
        result.add_section()
    return result


def tolerance(check: Check) -> str:
    """The bound with its direction and unit."""
    return f"<= {_with_unit(check.tolerance, check.unit)}"


def measured(check: Check) -> str:
    """The measured number with its unit."""
    return "-" if check.measured is None else _with_unit(check.measured, check.unit)


def verdict(check: Check) -> str:
    """Passed, FAILED or not run."""
    return {True: "passed", False: "FAILED", None: "not run"}[check.passed]


def totals(checks: Sequence[Check]) -> str:
    """How many checks passed, failed and were not run."""
    counts = [sum(check.passed is state for check in checks) for state in (True, False, None)]
    return "{} passed, {} failed, {} not run".format(*counts)


def json_text(checks: Sequence[Check]) -> str:
    """The checks and the versions of the libraries as JSON."""
    content: dict[str, Any] = {"checks": [asdict(check) for check in checks], "versions": versions()}
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def markdown_page(checks: Sequence[Check]) -> str:
    """The page that docs/results/validation.md is."""
    rows = "\n".join(
        f"| `{c.name}` | {c.what} | {c.reference} | {tolerance(c)} | {measured(c)} | {_explained(c)} |" for c in checks
    )
    stated = ", ".join(f"{name} {number}" for name, number in versions().items())
    return _PAGE.format(rows=rows, totals=totals(checks), versions=f"Versions: {stated}")


def versions() -> dict[str, str]:
    """Versions of Python and of the libraries that are installed."""
    found = {"Python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _with_unit(number: float, unit: str) -> str:
    text = "0" if number == 0.0 else f"{number:.2g}"
    return text if unit == "1" else f"{text} {unit}"


def _explained(check: Check) -> str:
    note = check.note.removeprefix("not run: ").replace("|", "/")
    return f"{verdict(check)}: {' '.join(note.split())}" if note else verdict(check)


def _coloured(check: Check) -> str:
    colour = {True: "green", False: "bold red", None: "yellow"}[check.passed]
    return f"[{colour}]{escape(verdict(check))}[/]"
