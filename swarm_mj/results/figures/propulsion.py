"""What thrusters did over time: thrust, velocity gained, propellant used; drawn only where some were fired."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.results.figures.panels import legend_below
from swarm_mj.results.figures.style import (
    VISIT_DASHES,
    caption,
    label,
    new_figure,
    note_of_omission,
    shown_spacecraft,
    tidy,
)
from swarm_mj.results.figures.timescale import TimeScale, time_scale
from swarm_mj.results.look import GREY, SPACECRAFT, spacecraft_colours, spacecraft_dashes
from swarm_mj.typing import Array, Indices

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
    handles: list[Line2D] = []
    for ax, (name, values, how) in zip(axes, curves, strict=True):
        handles = _draw(ax, plan, times[some] / scale.axis.seconds, values, shown, how)
        _mark(ax, scale)
        top = 1.06 * float(values.max())
        ax.set_ylim(-0.04 * top, top)
        label(ax, y=name)
        tidy(ax)
    words = f"up to {gained[-1].max():.3g} m/s and {used.max() / MILLI:.3g} g of one spacecraft"
    caption(axes[0], f"{words}; {left[0].max() / MILLI:.4g} g in a full tank")
    scale.show(axes[-1])
    scale.name(axes[-1])
    visit = Line2D([], [], color=GREY, linewidth=1.0, linestyle=VISIT_DASHES, label="visit")
    legend_below(figure, [*handles, visit, *scale.handles()])
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


def _draw(ax: Axes, plan: Plan, times: Array, values: Array, shown: Indices, how: dict[str, Any]) -> list[Line2D]:
    """Lines of each spacecraft; with one legend entry for all where they cannot be told apart."""
    alone, lines = len(shown) <= len(SPACECRAFT), []
    for j, colour, dashes in zip(shown, spacecraft_colours(len(shown)), spacecraft_dashes(len(shown)), strict=True):
        name = plan.names[j] if alone else "each spacecraft"
        lines += ax.plot(times, values[:, j], color=colour, linewidth=1.4, linestyle=dashes, label=name, **how)
    return lines if alone else lines[:1]


def _mark(ax: Axes, scale: TimeScale) -> None:
    scale.draw_borders(ax)
    ax.axvline(scale.visit_s / scale.axis.seconds, color=GREY, linewidth=1.0, linestyle=VISIT_DASHES, zorder=1.5)
