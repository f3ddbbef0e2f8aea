"""The outcome of a validation as a table on the screen, as JSON and as a Markdown page."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from swarm_mj.errors import OutputError
from swarm_mj.verification.experiment import Check

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
    return f"{'>=' if check.at_least else '<='} {_with_unit(check.tolerance, check.unit)}"


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


def write_json(path: Path, checks: Sequence[Check]) -> None:
    """Write the checks and the versions of the libraries.

    Raises:
        OutputError: The file cannot be written.
    """
    content: dict[str, Any] = {"checks": [asdict(check) for check in checks], "versions": versions()}
    _write(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def write_markdown(path: Path, checks: Sequence[Check]) -> None:
    """Write the page that docs/results/validation.md is.

    Raises:
        OutputError: The file cannot be written.
    """
    rows = "\n".join(
        f"| `{c.name}` | {c.what} | {c.reference} | {tolerance(c)} | {measured(c)} | {_explained(c)} |" for c in checks
    )
    stated = ", ".join(f"{name} {number}" for name, number in versions().items())
    _write(path, _PAGE.format(rows=rows, totals=totals(checks), versions=f"Versions: {stated}"))


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


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error
