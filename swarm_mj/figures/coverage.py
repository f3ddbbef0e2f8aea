"""Observed share of the target, P_TO, over time and by spacecraft."""

from __future__ import annotations

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from swarm_mj.figures.palette import BLACK, spacecraft_colours, spacecraft_styles
from swarm_mj.figures.panels import draw_bars, legend_below, spacecraft_handles
from swarm_mj.figures.style import (
    caption,
    label,
    new_figure,
    note_of_omission,
    shown_spacecraft,
    tidy,
)
from swarm_mj.figures.timescale import TimeScale, time_scale
from swarm_mj.figures.units import instant
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.observation.coverage import CoverageMap, percent_text
from swarm_mj.typing import Array, Indices

#: Of the line of one spacecraft [pt].
WIDTH = 1.3
CRITERION = {"passage": "whole passage", "arrival": "instant of the arrival only"}


def compose_coverage(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """P_TO over time, and what each observer saw of the target in the end."""
    coverage, criterion = result.coverage, plan.scenario.observation.criterion
    shown = shown_spacecraft(plan.n_observers)
    omission = note_of_omission(plan.n_observers, shown)
    figure = new_figure(4.4, f"Observed area of the target, {CRITERION[criterion]}: {plan.scenario.name}{omission}")
    history, bars = figure.subplots(1, 2, width_ratios=(2.6, 1.0))
    scale = time_scale(plan, telemetry)
    _draw_history(history, scale, telemetry, coverage, shown)
    _draw_bars(bars, plan, coverage, shown)
    handles = [
        Line2D([], [], color=BLACK, linewidth=3.4, label="whole swarm"),
        *spacecraft_handles(plan, shown, WIDTH, together="each spacecraft"),
        *scale.handles(),
    ]
    legend_below(figure, handles)
    return figure


def percent_over_time(coverage: CoverageMap, j: int, times: Array) -> Array:
    """Share of the target that spacecraft j has observed [%], shape of `times`."""
    own = CoverageMap(coverage.area, 1)
    own.first_seen_by_s[0] = coverage.first_seen_by_s[j]
    return own.percent_over_time(times)


def _draw_history(ax: Axes, scale: TimeScale, telemetry: xr.Dataset, coverage: CoverageMap, shown: Indices) -> None:
    times, axis = telemetry["time"].values, scale.axis
    times = times[scale.samples(times)]
    ax.step(times / axis.seconds, coverage.percent_over_time(times), where="post", color=BLACK, linewidth=3.4)
    for j, style in zip(shown, spacecraft_styles(len(shown)), strict=True):
        share = percent_over_time(coverage, j, times)
        ax.step(times / axis.seconds, share, where="post", linewidth=WIDTH, **style)
    arrival = scale.arrival_s
    scale.draw_arrival(ax)
    scale.show(ax)
    scale.draw_borders(ax)
    ax.set_ylim(-2.0, 104.0)
    tidy(ax)
    scale.name(ax)
    label(ax, y=r"observed share of the target $P_{TO}$ [%]")
    caption(
        ax,
        f"$P_{{TO}}$ = {percent_text(coverage.percent)} at the end, "
        f"{percent_text(float(coverage.percent_over_time(arrival)))} at the arrival, t = {instant(arrival, axis)}",
    )


def _draw_bars(ax: Axes, plan: Plan, coverage: CoverageMap, shown: Indices) -> None:
    percent = coverage.percent_by_spacecraft[shown]
    names, words = [plan.names[j] for j in shown], [f"{value:.1f}" for value in percent]
    draw_bars(ax, percent, names, words, spacecraft_colours(len(shown)), gap=2.0)
    ax.set_xlim(0.0, 130.0)
    ax.set_xticks((0, 50, 100))
    label(ax, "share [%]")
    caption(ax, "each spacecraft, at the end")
