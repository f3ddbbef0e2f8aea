"""The command `design`: solve, write, and print a short table."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from swarm_mj.designer.study import EXTENSIONS, Growth, Study, growth, study_design
from swarm_mj.flight.plan import check_plugins
from swarm_mj.io.atomic import Result, atomic_folder
from swarm_mj.io.progress import progress_bars
from swarm_mj.results.design_files import write_design, write_growth
from swarm_mj.scenarios.schema import Scenario


def run_design(
    scenario: Scenario,
    folder: Path,
    *,
    pareto: bool = False,
    compare: bool = False,
    figures: bool = True,
    pdf: bool = False,
    quiet: bool = False,
    workers: int | None = None,
    asked_as: str | None = None,
) -> dict[str, Any]:
    """Design a swarm for a scenario into a folder that appears only when all is done; returns the record.

    `asked_as` is what leads `swarm-mj run` to the same scenario, for the hint at the end; default: its name.
    """
    console = Console()
    check_plugins(scenario)

    def tell_kept(names: Sequence[str]) -> None:
        words = f"{scenario.name}: kept in {folder}, but of the earlier design, not this one: {', '.join(names)}"
        console.print(words, soft_wrap=True, highlight=False, markup=False)

    with atomic_folder(folder, Result("design", scenario.name), tell_kept) as partial:
        with progress_bars(console, quiet) as bars:
            study = _solve(scenario, bars, pareto, workers)
            rows = _compare(scenario, bars, workers) if compare else []
        record = write_design(partial, study)
        if rows:
            write_growth(partial, rows)
        if figures:
            from swarm_mj.results.figures.design import draw_all

            draw_all(partial, study, pdf=pdf)
    console.print(design_table(record))
    if rows:
        console.print(growth_table(rows))
    console.print(f"{scenario.name}: files in {folder}", soft_wrap=True, highlight=False)
    design = shlex.quote(str(folder / "design.json"))
    hint = f"To fly it: swarm-mj run {asked_as or scenario.name} --design {design}"
    if not record["flyable"]:
        hint = (
            "No single scenario flies this design: its points belong to several targets, altitudes or times of flight"
        )
    console.print(hint, soft_wrap=True, highlight=False, markup=False)
    return record


def _solve(scenario: Scenario, bars: Progress, pareto: bool, workers: int | None) -> Study:
    task = bars.add_task(f"{scenario.name}: candidates' pictures", total=1.0)

    def stage(name: str) -> None:
        if name != "candidates":
            bars.update(task, completed=1.0, description=f"{scenario.name}: {name}")

    study = study_design(
        scenario,
        pareto=pareto,
        workers=workers,
        progress=lambda share: bars.update(task, completed=share),
        stage=stage,
    )
    bars.update(task, description=f"{scenario.name}: solved")
    return study


def _compare(scenario: Scenario, bars: Progress, workers: int | None) -> list[Growth]:
    task = bars.add_task("beyond the paper", total=len(EXTENSIONS))
    started: list[str] = []

    def stage(name: str) -> None:
        bars.update(task, completed=len(started), description=f"beyond the paper: {name}")
        started.append(name)

    rows = growth(scenario, workers=workers, stage=stage)
    bars.update(task, completed=len(EXTENSIONS), description="beyond the paper")
    return rows


def design_table(record: dict[str, Any]) -> Table:
    """Both answers side by side."""
    table = Table(title="Design", title_justify="left")
    for heading in ("", "observers", "P_TO [%]", "points", "explored", "seconds"):
        table.add_column(escape(heading), justify="left" if heading in ("", "points") else "right")
    proof = record["proof"]
    proven = "proven" if proof["status"] == "optimal" else f"at least {proof['lower_bound']:g}"
    table.add_row(
        proven, str(proof["minimum"]), f"{proof['covered_percent']:.2f}", _numbers(proof["visiting_points"]), "-",
        f"{proof['seconds']:.2f}",
    )  # fmt: skip
    names = {"repair": "GA, repair", "plain": "GA, plain"}
    for name, result in record["genetic"].items():
        table.add_row(
            names[name],
            str(result["n_observers"]),
            f"{result['covered_percent']:.2f}" + ("" if result["feasible"] else " (too little)"),
            _numbers(result["gene_map"][1:]),
            f"{result['designs_explored']:,}",
            f"{result['seconds']:.2f}",
        )
    gap = record["gap"]
    words = (
        "the genetic algorithm covers too little" if gap < 0 else f"gap of the genetic algorithm to the proof: {gap}"
    )
    table.caption = (
        f"{words}; selected: {_observers(record['n_observers'])} by the {record['selected_by']}. Criterion: "
        f"{record['criterion']['criterion']}, {record['camera']['half_angle_deg']:g} deg half-angle"
    )
    return table


def growth_table(rows: Sequence[Growth]) -> Table:
    """The proven minimum under each extension."""
    table = Table(title="Beyond the paper: the proven minimum", title_justify="left")
    for heading in ("change", "observers", "points, or why not"):
        table.add_column(heading, justify="right" if heading == "observers" else "left")
    for row in rows:
        table.add_row(escape(row.change), "-" if row.n_observers is None else str(row.n_observers), escape(row.note))
    return table


def _observers(count: int) -> str:
    return f"{count} observer" if count == 1 else f"{count} observers"


def _numbers(points: Sequence[int]) -> str:
    return " ".join(map(str, points))
