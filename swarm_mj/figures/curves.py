"""Curves of all spacecraft over time: observed share of the target P_TO, propulsion, and how well a formation is held."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from swarm_mj.figures.palette import BLACK, GREY, LIGHT_GREY, spacecraft_colours, spacecraft_styles
from swarm_mj.figures.panels import draw_bars, legend_below, spacecraft_handles
from swarm_mj.figures.style import caption, label, new_figure, tidy
from swarm_mj.figures.timescale import TimeScale, time_scale
from swarm_mj.figures.units import instant, note_of_omission, shown_spacecraft
from swarm_mj.flight.formation import ERROR, RECORD
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.observation.coverage import CoverageMap, percent_digits, percent_text
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
    scale.draw(ax)
    ax.set_ylim(-2.0, 104.0)
    label(ax, y=r"observed share of the target $P_{TO}$ [%]")
    caption(
        ax,
        f"$P_{{TO}}$ = {percent_text(coverage.percent)} at the end, "
        f"{percent_text(float(coverage.percent_over_time(arrival)))} at the arrival, t = {instant(arrival, axis)}",
    )


def _draw_bars(ax: Axes, plan: Plan, coverage: CoverageMap, shown: Indices) -> None:
    percent = coverage.percent_by_spacecraft[shown]
    names, words = [plan.names[j] for j in shown], list(map(percent_digits, percent))
    draw_bars(ax, percent, names, words, spacecraft_colours(len(shown)), gap=2.0)
    ax.set_xlim(0.0, 130.0)
    ax.set_xticks((0, 50, 100))
    label(ax, "share [%]")
    caption(ax, "each spacecraft, at the end")


#: Newtons in a mN, kilograms in a g.
MILLI = 1e-3


def compose_propulsion(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Mean thrust between samples, velocity gained and propellant used so far of every spacecraft."""
    shown = shown_spacecraft(plan.n)
    figure = new_figure(7.4, f"Propulsion: {plan.scenario.name}{note_of_omission(plan.n, shown)}")
    axes = figure.subplots(3, 1, sharex=True)
    scale, times = time_scale(plan, telemetry), telemetry["time"].values
    some = scale.samples(times)
    gained, left = telemetry["delta_v_m_s"].values[some], telemetry["propellant_kg"].values[some]
    used = left[0] - left
    curves: tuple[tuple[str, Array, dict[str, Any]], ...] = (
        ("mean thrust [mN]", mean_thrust(telemetry, some) / MILLI, {"drawstyle": "steps-post"}),
        (r"$\Delta v$ so far [m/s]", gained, {}),
        ("propellant so far [g]", used / MILLI, {}),
    )
    handles = spacecraft_handles(plan, shown, 1.4, together="each spacecraft")
    for ax, (name, values, how) in zip(axes, curves, strict=True):
        for j, style in zip(shown, spacecraft_styles(len(shown)), strict=True):
            ax.plot(times[some] / scale.axis.seconds, values[:, j], linewidth=1.4, **style, **how)
        scale.draw_borders(ax)
        scale.draw_arrival(ax)
        top = 1.06 * float(values.max())
        ax.set_ylim(-0.04 * top, top)
        label(ax, y=name)
        tidy(ax)
    words = f"up to {gained[-1].max():.3g} m/s and {used.max() / MILLI:.3g} g of one spacecraft"
    caption(axes[0], f"{words}; {left[0].max() / MILLI:.4g} g in a full tank")
    scale.show(axes[-1])
    scale.name(axes[-1])
    legend_below(figure, [*handles, *scale.handles()])
    return figure


def mean_thrust(telemetry: xr.Dataset, some: Indices) -> Array:
    """Mean force from each of some samples to the next, by the velocity that was gained, shape (some, spacecraft) [N].

    Pulses between samples count too. After the last sample nothing is known, and it is 0.
    """
    times, mass = telemetry["time"].values[some], telemetry["mass_kg"].values[some]
    gained = np.diff(telemetry["delta_v_m_s"].values[some], axis=0)
    force = np.zeros_like(mass)
    force[:-1] = 0.5 * (mass[1:] + mass[:-1]) * gained / np.diff(times)[:, None]
    return force


#: Distances below it are drawn there [m]; zero has no place on a logarithmic axis.
FLOOR_M = 1e-2


def compose_formation(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Distance from the place in the formation, and velocity gained by thrust, of every spacecraft."""
    shown, record = shown_spacecraft(plan.n), json.loads(telemetry.attrs[RECORD])
    figure = new_figure(6.2, f"Formation: {plan.scenario.name}{note_of_omission(plan.n, shown)}")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.0))
    scale, times = time_scale(plan, telemetry), telemetry["time"].values
    sampled = scale.samples(times)
    t = times[sampled] / scale.axis.seconds
    error, spent = np.maximum(telemetry[ERROR].values, FLOOR_M), telemetry["delta_v_m_s"].values
    handles: list[Line2D] = []
    for j, line in zip(shown, spacecraft_styles(len(shown)), strict=True):
        handles += upper.plot(t, error[sampled, j], label=plan.names[j], linewidth=1.4, **line)
        lower.plot(t, spent[sampled, j], linewidth=1.4, **line)
    upper.set_yscale("log")
    upper.set_ylim(FLOOR_M, max(2.0 * float(error.max()), 10.0 * FLOOR_M))
    if record["dead_band_m"] > 0.0:
        style: dict[str, Any] = {"color": BLACK, "linewidth": 1.0, "linestyle": (0, (6, 2))}
        upper.axhline(record["dead_band_m"], **style)
        handles.append(Line2D([], [], label=f"dead band, {record['dead_band_m']:g} m", **style))
    for ax in (upper, lower):
        start, end = (record[key] / scale.axis.seconds for key in ("start_s", "end_s"))
        for edge in (start, end):
            ax.axvline(edge, color=GREY, linewidth=1.0, linestyle=(0, (1, 2)))
        ax.axvspan(start, end, color=LIGHT_GREY, alpha=0.25, zorder=0)
        tidy(ax)
    handles.append(Line2D([], [], color=GREY, linewidth=1.0, linestyle=(0, (1, 2)), label="held between"))
    label(upper, y="distance from place [m]")
    label(lower, y=r"$\Delta v$ by thrust [m/s]")
    scale.show(lower)
    scale.name(lower)
    lower.set_ylim(bottom=0.0)
    legend_below(figure, handles)
    return figure
