"""Observed share of the target, P_TO, over time and by spacecraft."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.observation.coverage import CoverageMap
from swarm_mj.results.figures.panels import every, legend_below
from swarm_mj.results.figures.style import (
    SMALL_PT,
    VISIT_DASHES,
    caption,
    label,
    name_time,
    new_figure,
    note_of_omission,
    show_time,
    shown_spacecraft,
    tidy,
)
from swarm_mj.results.look import BLACK, GREY, instant, spacecraft_colours, time_axis
from swarm_mj.typing import Array, Indices

CRITERION = {"passage": "whole passage", "visit": "instant of the visit only"}


def compose_coverage(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """P_TO over time, and what each observer saw of the target in the end."""
    coverage, criterion = result.coverage, plan.scenario.observation.criterion
    shown = shown_spacecraft(plan.n_observers)
    omission = note_of_omission(plan.n_observers, shown)
    figure = new_figure(4.4, f"Observed area of the target, {CRITERION[criterion]}: {plan.scenario.name}{omission}")
    history, bars = figure.subplots(1, 2, width_ratios=(2.6, 1.0))
    _draw_history(history, plan, telemetry, coverage, shown)
    _draw_bars(bars, plan, coverage, shown)
    handles = [
        Line2D([], [], color=BLACK, linewidth=3.4, label="whole swarm"),
        Line2D([], [], color=spacecraft_colours(len(shown))[0], linewidth=1.3, label="single spacecraft"),
        Line2D([], [], color=GREY, linewidth=1.0, linestyle=VISIT_DASHES, label="visit"),
    ]
    legend_below(figure, handles)
    return figure


def percent_over_time(coverage: CoverageMap, j: int, times: Array) -> Array:
    """Share of the target that spacecraft j has observed [%], shape of `times`."""
    own = CoverageMap(coverage.area, 1)
    own.first_seen_by_s[0] = coverage.first_seen_by_s[j]
    return own.percent_over_time(times)


def _draw_history(ax: Axes, plan: Plan, telemetry: xr.Dataset, coverage: CoverageMap, shown: Indices) -> None:
    times = telemetry["time"].values[every(telemetry.sizes["time"])]
    axis = time_axis(plan.scenario.duration_s)
    ax.step(times / axis.seconds, coverage.percent_over_time(times), where="post", color=BLACK, linewidth=3.4)
    for j, colour in zip(shown, spacecraft_colours(len(shown)), strict=True):
        ax.step(times / axis.seconds, percent_over_time(coverage, j, times), where="post", color=colour, linewidth=1.3)
    visit = plan.scenario.design.time_of_flight_s
    ax.axvline(visit / axis.seconds, color=GREY, linewidth=1.0, linestyle=VISIT_DASHES, zorder=1.5)
    show_time(ax, axis, plan.scenario.duration_s)
    ax.set_ylim(-2.0, 104.0)
    tidy(ax)
    name_time(ax, axis)
    label(ax, y=r"observed share of the target $P_{TO}$ [%]")
    caption(
        ax,
        f"$P_{{TO}}$ = {coverage.percent:.2f} % at the end, "
        f"{float(coverage.percent_over_time(visit)):.2f} % at the visit, t = {instant(visit, axis)}",
    )


def _draw_bars(ax: Axes, plan: Plan, coverage: CoverageMap, shown: Indices) -> None:
    percent = coverage.percent_by_spacecraft[shown]
    rows = np.arange(len(shown))
    ax.barh(rows, percent, color=spacecraft_colours(len(shown)), height=0.7)
    for row, value in zip(rows, percent, strict=True):
        ax.text(value + 2.0, float(row), f"{value:.1f}", va="center", fontsize=SMALL_PT)
    ax.set_yticks(rows, [plan.names[j] for j in shown])
    ax.set_ylim(len(shown) - 0.4, -0.6)
    ax.set_xlim(0.0, 130.0)
    ax.set_xticks((0, 50, 100))
    tidy(ax)
    ax.grid(False, axis="y")
    label(ax, "share [%]")
    caption(ax, "each spacecraft, at the end")
