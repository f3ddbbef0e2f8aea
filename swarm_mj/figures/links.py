"""What each spacecraft tracks and when its radio link is closed, as a timeline."""

from __future__ import annotations

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from swarm_mj.figures.modes import has_room, mode_handles, name_mode
from swarm_mj.figures.palette import BLACK, BLUE, MODE_STYLES
from swarm_mj.figures.panels import legend_below
from swarm_mj.figures.style import (
    TICK_PT,
    new_figure,
    note_of_omission,
    role,
    shown_spacecraft,
    tidy,
)
from swarm_mj.figures.timescale import TimeScale, arrival_handle, time_scale
from swarm_mj.figures.units import TimeAxis
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.records.modes import Run, intervals, runs
from swarm_mj.typing import Indices

#: Share of the time axis that half a mode's name takes at most.
NAME_SHARE = 0.03
#: Height of a row's two bars, in rows.
MODE_HEIGHT = 0.46
LINK_HEIGHT = 0.22


def compose_links(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Timeline of modes and closed links, one row per spacecraft."""
    shown = shown_spacecraft(plan.n)
    scale = time_scale(plan, telemetry)
    figure = new_figure(
        2.0 + 0.42 * len(shown),
        f"Modes and radio links: {plan.scenario.name}{note_of_omission(plan.n, shown)}",
    )
    ax = figure.subplots()
    for row, j in enumerate(shown):
        _draw_row(ax, telemetry, int(j), row, scale)
    scale.draw_arrival(ax, BLACK, zorder=2.0)
    tidy(ax)
    ax.grid(False, axis="y")
    scale.show(ax)
    scale.draw_borders(ax)
    ax.set_ylim(len(shown) - 0.5, -0.5)
    ax.set_yticks(range(len(shown)), [f"{plan.names[j]}: {role(plan, int(j))}" for j in shown])
    ax.tick_params(axis="y", length=0)
    scale.name(ax)
    _draw_totals(ax, telemetry, shown, scale.axis)
    closed = (telemetry["link_closed"].values[:, shown] == 1).any()
    link = [Patch(facecolor=BLUE, label="link closed")] if closed else []
    legend_below(figure, [*mode_handles(telemetry, shown), *link, arrival_handle(BLACK), *scale.border_handles()])
    return figure


def _draw_row(ax: Axes, telemetry: xr.Dataset, j: int, row: int, scale: TimeScale) -> None:
    unit = scale.axis.seconds
    for run in runs(telemetry, j):
        style, length = MODE_STYLES[run.mode], run.end - run.start
        bar = [(run.start / unit, length / unit)]
        ax.broken_barh(bar, (row - 0.36, MODE_HEIGHT), facecolor=style.colour, edgecolor="white", linewidth=1.0)
        if has_room(ax, run, scale):
            name_mode(ax, _beside(run, scale), scale, row - 0.36 + MODE_HEIGHT / 2)
    closed = intervals(telemetry["link_closed"].values[:, j] == 1, telemetry["time"].values)
    bars = [(start / unit, length / unit) for start, length in closed]
    ax.broken_barh(bars, (row - 0.36 + MODE_HEIGHT, LINK_HEIGHT), facecolor=BLUE, linewidth=0)


def _beside(run: Run, scale: TimeScale) -> Run:
    """The longer part of a stretch before or after the arrival whose mark would go through its name, else all of it."""
    mark = scale.arrival_s
    if abs(scale.share(scale.middle(run.start, run.end), mark)) > NAME_SHARE:
        return run
    before, after = Run(run.start, mark, run.mode), Run(mark, run.end, run.mode)
    return before if scale.share(run.start, mark) > scale.share(mark, run.end) else after


def _draw_totals(ax: Axes, telemetry: xr.Dataset, shown: Indices, axis: TimeAxis) -> None:
    """How long each link was closed, at the right of its row."""
    times = telemetry["time"].values
    right = ax.secondary_yaxis("right")
    totals = [sum(length for _, length in intervals(telemetry["link_closed"].values[:, j] == 1, times)) for j in shown]
    right.set_yticks(range(len(shown)), [f"{total / axis.seconds:.1f}" for total in totals])
    right.tick_params(labelsize=TICK_PT, length=0)
    right.set_ylabel(f"link closed [{axis.unit}]", fontsize=TICK_PT + 1)
    right.spines["right"].set_visible(False)
