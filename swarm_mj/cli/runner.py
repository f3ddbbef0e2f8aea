"""The main job: fly scenarios with a progress bar, write their results and reports, print a short table."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import Progress, TaskID
from rich.table import Table

from swarm_mj.errors import OutputError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import add_coverage, observe_flight, picture_count
from swarm_mj.flight.plan import behavior_from, check_plugins, make_plan
from swarm_mj.io.atomic import Result, atomic_folder, check_place
from swarm_mj.io.progress import progress_bars
from swarm_mj.results.findings import near_collision_findings, remarks
from swarm_mj.results.report import REPORT_NAME
from swarm_mj.results.run_files import write_results, write_summary
from swarm_mj.results.summary import summarise, working
from swarm_mj.scenarios.schema import Scenario


class Stages:
    """Wall-clock seconds by stage, and a progress bar for each."""

    def __init__(self, progress: Progress, scenario: str) -> None:
        self.wall_s: dict[str, float] = {}
        self._progress, self._scenario = progress, scenario

    @contextmanager
    def stage(self, name: str, label: str, total: float | None = None) -> Iterator[Callable[[float], None]]:
        """Time a stage; gives the function that reports how much of `total` is done."""
        start = time.perf_counter()
        task: TaskID = self._progress.add_task(f"{self._scenario}: {label}", total=total)
        yield lambda done: self._progress.update(task, completed=done)
        size = total or 1.0
        self._progress.update(task, total=size, completed=size)
        self.wall_s[name] = time.perf_counter() - start


def run_many(
    scenarios: Sequence[Scenario],
    folders: Sequence[Path],
    *,
    figures: bool = True,
    pdf: bool = False,
    report: bool = True,
    quiet: bool = False,
) -> None:
    """Fly scenarios one after another, print a table of results and where their reports are.

    Raises:
        SwarmError: One cannot be flown; results of those before it stay.
    """
    if len(set(folders)) < len(folders):
        raise OutputError("two scenarios have the same name; give them folders of their own with --out, one call each")
    for scenario, folder in zip(scenarios, folders, strict=True):
        # What is refused is so before another one is flown.
        check_plugins(scenario)
        behavior_from(scenario)
        check_place(folder, Result("run", scenario.name))
    console = Console()
    summaries = []
    with progress_bars(console, quiet) as progress:
        for scenario, folder in zip(scenarios, folders, strict=True):
            summaries.append(run_one(scenario, folder, figures=figures, pdf=pdf, report=report, progress=progress))
    console.print(results_table(summaries))
    for summary, folder in zip(summaries, folders, strict=True):
        _print_notes(console, summary, folder)
    for summary, folder in zip(summaries, folders, strict=True) if report else ():
        console.print(f"{summary['scenario']}: report in {folder / REPORT_NAME}", soft_wrap=True, highlight=False)


def run_one(
    scenario: Scenario,
    folder: Path,
    *,
    figures: bool,
    pdf: bool = False,
    report: bool = False,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Fly one scenario into a folder that appears only when all is done, then report it; returns its summary."""
    progress = progress or progress_bars(Console(), quiet=True)
    stages = Stages(progress, scenario.name)

    def tell_kept(names: Sequence[str]) -> None:
        words = f"{scenario.name}: kept in {folder}, but of the earlier run, not this one: {', '.join(names)}"
        progress.console.print(words, soft_wrap=True, highlight=False, markup=False)

    with atomic_folder(folder, Result("run", scenario.name), tell_kept) as partial:
        with stages.stage("design", "trajectories (compiles on first use)"):
            plan = make_plan(scenario)
        with stages.stage("simulate", "flight", scenario.duration_s) as done:
            telemetry = simulate(plan, done)
        with stages.stage("coverage", "images", picture_count(plan, telemetry)) as done:
            result = observe_flight(plan, telemetry, done)
            add_coverage(telemetry, result)
        write_results(partial, plan, telemetry, result)
        if figures:
            from swarm_mj.results.figures import FIGURES

            with stages.stage("figures", "figures", len(FIGURES)) as done:
                for count, (name, draw) in enumerate(FIGURES.items()):
                    draw(partial / f"{name}.png", plan, telemetry, result, pdf=pdf)
                    done(count + 1)
        summary = summarise(plan, telemetry, result, {"figures": 0.0, **stages.wall_s})
        write_summary(partial, summary)
    if report:
        from swarm_mj.results.report.page import write_report

        with stages.stage("report", "report"):
            write_report([folder])
    return summary


def results_table(summaries: Sequence[dict[str, Any]]) -> Table:
    """A short table: one column a run."""
    table = Table(title="Results", title_justify="left")
    table.add_column("")
    for summary in summaries:
        table.add_column(summary["scenario"], justify="right")
    for label, cell in _ROWS.items():
        table.add_row(escape(label), *(cell(summary) for summary in summaries))
    return table


def _worst(errors: dict[str, float]) -> str:
    return f"{max(errors.values()):.3g}" if errors else "-"


def _crew(summary: dict[str, Any]) -> str:
    lost = f", {len(summary['lost'])} lost" if summary["lost"] else ""
    return f"{summary['spacecraft']} ({summary['observers']}){lost}"


_ROWS: dict[str, Callable[[dict[str, Any]], str]] = {
    "spacecraft (of them observers)": _crew,
    "target faces": lambda s: str(s["target_faces"]),
    "criterion, camera half-angle": lambda s: f"{s['criterion']}, {s['camera_half_angle_deg']:g} deg",
    "observed area P_TO [%]": lambda s: f"{s['coverage_percent']:.2f}",
    "the same, whole passage [%]": lambda s: f"{s['coverage_percent_passage']:.2f}",
    "pointing error before a switch, at most [deg]": lambda s: _worst(s["pointing_error_deg_before_switch"]),
    "pointing error at the end, at most [deg]": lambda s: _worst(working(s, "pointing_error_deg_final")),
    "wheel speed, at most [% of limit]": lambda s: f"{100 * s['max_wheel_speed_fraction']:.0f}",
    "links closed at the end": lambda s: f"{s['links_closed_final']} of {s['spacecraft']}",
    "deployment delta-v, at most [m/s]": lambda s: f"{max(s['deployment_delta_v_m_s'].values()):.2f}",
    "measured by": lambda s: s["observer"],
    "wall time [s]": lambda s: f"{sum(s['wall_s'].values()):.1f}",
}


def _print_notes(console: Console, summary: dict[str, Any], folder: Path) -> None:
    console.print(f"{summary['scenario']}: {summary['description']}", soft_wrap=True, highlight=False, markup=False)
    if summary["observer"] != "faceid":
        console.print(f"{summary['scenario']}: {summary['observer_note']}", soft_wrap=True, highlight=False)
    for remark in [*remarks(summary), *near_collision_findings(summary)]:
        console.print(f"{summary['scenario']}: {remark}", soft_wrap=True, highlight=False, markup=False)
    console.print(f"{summary['scenario']}: files in {folder}", soft_wrap=True, highlight=False)
