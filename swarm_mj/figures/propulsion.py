"""What thrusters did over time: thrust, velocity gained, propellant used; drawn only where some were fired."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from swarm_mj.figures.palette import spacecraft_styles
from swarm_mj.figures.panels import legend_below, spacecraft_handles
from swarm_mj.figures.style import (
    caption,
    label,
    new_figure,
    note_of_omission,
    shown_spacecraft,
    tidy,
)
from swarm_mj.figures.timescale import time_scale
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.typing import Array, Indices

#: Of the line of one spacecraft [pt].
WIDTH = 1.4
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
    handles = spacecraft_handles(plan, shown, WIDTH, together="each spacecraft")
    for ax, (name, values, how) in zip(axes, curves, strict=True):
        for j, style in zip(shown, spacecraft_styles(len(shown)), strict=True):
            ax.plot(times[some] / scale.axis.seconds, values[:, j], linewidth=WIDTH, **style, **how)
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
