"""How well the formation is held: distance of each spacecraft from its place, and what that has cost."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from swarm_mj.figures.palette import BLACK, GREY, LIGHT_GREY, spacecraft_styles
from swarm_mj.figures.panels import legend_below
from swarm_mj.figures.style import label, new_figure, note_of_omission, shown_spacecraft, tidy
from swarm_mj.figures.timescale import time_scale
from swarm_mj.flight.formation import ERROR, RECORD
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan

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
        for edge in (record["start_s"], record["end_s"]):
            ax.axvline(edge / scale.axis.seconds, color=GREY, linewidth=1.0, linestyle=(0, (1, 2)))
        ax.axvspan(
            record["start_s"] / scale.axis.seconds,
            record["end_s"] / scale.axis.seconds,
            color=LIGHT_GREY,
            alpha=0.25,
            zorder=0,
        )
        tidy(ax)
    handles.append(Line2D([], [], color=GREY, linewidth=1.0, linestyle=(0, (1, 2)), label="held between"))
    label(upper, y="distance from place [m]")
    label(lower, y=r"$\Delta v$ by thrust [m/s]")
    scale.show(lower)
    scale.name(lower)
    lower.set_ylim(bottom=0.0)
    legend_below(figure, handles)
    return figure
