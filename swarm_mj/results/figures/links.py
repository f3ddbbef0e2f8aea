"""What each spacecraft tracks and when its radio link is closed, as a timeline."""

from __future__ import annotations

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.results.figures.modes import has_room, mode_handles, name_mode
from swarm_mj.results.figures.panels import legend_below
from swarm_mj.results.figures.style import (
    TICK_PT,
    VISIT_DASHES,
    name_time,
    new_figure,
    note_of_omission,
    role,
    show_time,
    shown_spacecraft,
    tidy,
)
from swarm_mj.results.look import BLACK, BLUE, TimeAxis, time_axis
from swarm_mj.results.modes import MODE_LOOKS, Run, intervals, runs
from swarm_mj.typing import Indices

#: Share of the flight's length that half a mode's name takes at most.
NAME_SHARE = 0.03
#: Height of a row's two bars, in rows.
MODE_HEIGHT = 0.46
LINK_HEIGHT = 0.22


def compose_links(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Timeline of modes and closed links, one row per spacecraft."""
    shown = shown_spacecraft(plan.n)
    axis = time_axis(plan.scenario.duration_s)
    figure = new_figure(
        2.0 + 0.42 * len(shown),
        f"Modes and radio links: {plan.scenario.name}{note_of_omission(plan.n, shown)}",
    )
    ax = figure.subplots()
    for row, j in enumerate(shown):
        _draw_row(ax, telemetry, int(j), row, axis, plan.scenario.design.time_of_flight_s)
    visit = plan.scenario.design.time_of_flight_s / axis.seconds
    ax.axvline(visit, color=BLACK, linewidth=1.0, linestyle=VISIT_DASHES)
    tidy(ax)
    ax.grid(False, axis="y")
    show_time(ax, axis, plan.scenario.duration_s)
    ax.set_ylim(len(shown) - 0.5, -0.5)
    ax.set_yticks(range(len(shown)), [f"{plan.names[j]}: {role(plan, int(j))}" for j in shown])
    ax.tick_params(axis="y", length=0)
    name_time(ax, axis)
    _draw_totals(ax, telemetry, shown, axis)
    link = Patch(facecolor=BLUE, label="link closed")
    mark = Line2D([], [], color=BLACK, linewidth=1.0, linestyle=VISIT_DASHES, label="visit")
    legend_below(figure, [*mode_handles(telemetry), link, mark])
    return figure


def _draw_row(ax: Axes, telemetry: xr.Dataset, j: int, row: int, axis: TimeAxis, visit_s: float) -> None:
    stretches = runs(telemetry, j)
    whole = stretches[-1].end - stretches[0].start
    for run in stretches:
        look, length = MODE_LOOKS[run.mode], run.end - run.start
        bar = [(run.start / axis.seconds, length / axis.seconds)]
        ax.broken_barh(bar, (row - 0.36, MODE_HEIGHT), facecolor=look.colour, edgecolor="white", linewidth=1.0)
        if has_room(ax, run, whole):
            name_mode(ax, _beside(run, visit_s, whole), axis, row - 0.36 + MODE_HEIGHT / 2)
    closed = intervals(telemetry["link_closed"].values[:, j] == 1, telemetry["time"].values)
    bars = [(start / axis.seconds, length / axis.seconds) for start, length in closed]
    ax.broken_barh(bars, (row - 0.36 + MODE_HEIGHT, LINK_HEIGHT), facecolor=BLUE, linewidth=0)


def _beside(run: Run, mark_s: float, whole: float) -> Run:
    """The longer part of a stretch before or after a mark that would go through its name, else all of it."""
    if abs(0.5 * (run.start + run.end) - mark_s) > NAME_SHARE * whole:
        return run
    before, after = Run(run.start, mark_s, run.mode), Run(mark_s, run.end, run.mode)
    return before if mark_s - run.start > run.end - mark_s else after


def _draw_totals(ax: Axes, telemetry: xr.Dataset, shown: Indices, axis: TimeAxis) -> None:
    """How long each link was closed, at the right of its row."""
    times = telemetry["time"].values
    right = ax.secondary_yaxis("right")
    totals = [sum(length for _, length in intervals(telemetry["link_closed"].values[:, j] == 1, times)) for j in shown]
    right.set_yticks(range(len(shown)), [f"{total / axis.seconds:.1f}" for total in totals])
    right.tick_params(labelsize=TICK_PT, length=0)
    right.set_ylabel(f"link closed [{axis.unit}]", fontsize=TICK_PT + 1)
    right.spines["right"].set_visible(False)
