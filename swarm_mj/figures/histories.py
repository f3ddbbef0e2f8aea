"""Over time, one panel per spacecraft: tracking error (AAS 19-144, Figures 9, 10), pointing error, navigation, wheels."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from swarm_mj.figures.palette import BLACK, BLUE, COMPONENTS, DASHES, ORANGE, SKY_BLUE, VERMILLION
from swarm_mj.figures.panels import compose_panels
from swarm_mj.figures.timescale import time_scale
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.simulator.telemetry import longest_sigma
from swarm_mj.spacecraft.properties import RPM, SpacecraftProperties
from swarm_mj.typing import Array, Indices

#: Exponent of ten below which errors [deg] are rounding; zero has no place on a logarithmic axis.
FLOOR = -8
MILLI = 1e-3
#: Of the components x, y, z, or of the wheels, of which there may be a fourth.
COLOURS = (*COMPONENTS, SKY_BLUE)
#: How a limit is drawn.
LIMIT: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.1, "linestyle": (0, (6, 2))}


def compose_tracking_error(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """MRP tracking error sigma_BR of every spacecraft."""
    names = [rf"$\sigma_{{{k}}}$" for k in (1, 2, 3)]
    values = _after_release(telemetry, telemetry["sigma_BR"].values)
    reach = _reach(values, at_least=0.02)
    return compose_panels(
        plan,
        telemetry,
        title="MRP tracking errors",
        y_label=r"tracking error $\sigma_{B/R}$ [-]",
        draw=_components(plan, telemetry, values),
        limits=(-reach, reach),
        handles=_handles(names),
    )


def compose_wheel_speed(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Speeds of the wheels of every spacecraft and their limit."""
    values = telemetry["wheel_speed"].values / RPM
    limit = plan.properties.max_wheel_speed / RPM
    curves = _components(plan, telemetry, values)

    def draw(ax: Axes, j: int) -> None:
        curves(ax, j)
        for bound in (-limit, limit):
            ax.axhline(bound, **LIMIT)

    reach = max(1.08 * limit, _reach(values, at_least=0.0))
    bound = Line2D([], [], label=f"limit, {limit:,.0f} rpm", **LIMIT)
    return compose_panels(
        plan,
        telemetry,
        title="Reaction wheel speeds",
        y_label="wheel speed [rpm]",
        draw=draw,
        limits=(-reach, reach),
        handles=[*_handles([f"wheel {k}" for k in telemetry["wheel"].values]), bound],
    )


def compose_wheel_momentum(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Angular momentum that the wheels hold, that of the turning body, and their sum, which only outer torques change."""
    body, wheels = angular_momenta_B(telemetry, plan.properties)
    limit = plan.properties.wheel_spin_inertia * plan.properties.max_wheel_speed / MILLI
    total, words = body + wheels, r"sum, $|J\omega + h_w|$"
    styles: list[tuple[Array, dict[str, Any]]] = [
        (body, {"color": ORANGE, "linewidth": 1.2, "linestyle": DASHES[1], "label": r"body, $|J\omega|$"}),
        (wheels, {"color": BLUE, "linewidth": 1.6, "label": "wheels, $|h_w|$"}),
        (total, {"color": BLACK, "linewidth": 1.2, "linestyle": (0, (2, 2)), "label": words}),
    ]
    curves = [(np.linalg.norm(part, axis=-1) / MILLI, style) for part, style in styles]
    some, times = _drawn(plan, telemetry)
    bound = {**LIMIT, "label": "limit of one wheel"}

    def draw(ax: Axes, j: int) -> None:
        for values, style in curves:
            ax.plot(times, values[some, j], **style)
        ax.axhline(limit, **bound)

    return compose_panels(
        plan,
        telemetry,
        title="Momentum of wheels and body",
        y_label="angular momentum [mN m s]",
        draw=draw,
        limits=(0.0, 1.08 * max(limit, *(float(values.max()) for values, _ in curves))),
        handles=[Line2D([], [], **style) for style in (*(style for _, style in curves), bound)],
    )


def angular_momenta_B(telemetry: xr.Dataset, properties: SpacecraftProperties) -> tuple[Array, Array]:
    """Angular momentum about the centre of mass in B, J omega of the body with locked wheels and h_w of the wheels' spin.

    Each of shape (time, spacecraft, 3) [N m s].
    """
    body = telemetry["omega_BN_B"].values @ properties.inertia_B.T
    wheels = properties.wheel_spin_inertia * telemetry["wheel_speed"].values @ properties.wheel_axes_B
    return body, wheels


def compose_pointing_error(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Angle between +z and the line of sight of every spacecraft, on a logarithmic axis."""
    error = np.maximum(np.degrees(_after_release(telemetry, telemetry["pointing_error"].values)), 10.0**FLOOR)
    some, times = _drawn(plan, telemetry)

    def draw(ax: Axes, j: int) -> None:
        ax.plot(times, error[some, j], color=BLUE, linewidth=1.2)

    floored = f" (drawn at $10^{{{FLOOR}}}$ deg where below)" if (error <= 10.0**FLOOR).any() else ""
    name = f"pointing error{floored}"
    low, high = np.log10(np.nanmin(error)) - 0.3, np.log10(max(np.nanmax(error), 1.0)) + 0.3
    return compose_panels(
        plan,
        telemetry,
        title="Pointing errors",
        y_label="angle between +z and line of sight [deg]",
        draw=draw,
        limits=(10.0**low, 10.0**high),
        handles=[Line2D([], [], color=BLUE, linewidth=1.2, label=name)],
        log=True,
    )


def compose_navigation(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """What navigation by pictures errs by and says it does, on a logarithmic axis, and the pictures that it had."""
    off = telemetry["r_BN_N_estimate"].values - telemetry["r_BN_N"].values
    error, sigma_3 = np.linalg.norm(off, axis=-1), 3.0 * longest_sigma(telemetry)
    some, times = _drawn(plan, telemetry)
    records = json.loads(telemetry.attrs["navigation"])
    seconds = time_scale(plan, telemetry).axis.seconds
    low, high = (float(f(each[some])) for f, each in ((np.nanmin, np.minimum(error, sigma_3)), (np.nanmax, sigma_3)))
    low, high = np.log10(max(low, 1e-3)) - 0.6, np.log10(max(high, float(error.max()), 1e-3)) + 0.3
    marks = {"centroid": "o", "limb": "s", "landmarks": "^", "range": "d"}

    def draw(ax: Axes, j: int) -> None:
        ax.plot(times, sigma_3[some, j], color=ORANGE, linewidth=1.6, linestyle=DASHES[1])
        ax.plot(times, np.maximum(error[some, j], 10.0**low), color=BLUE, linewidth=1.2)
        own = [one for one in records if plan.names[j] in one["spacecraft"].split("-")]
        for way, mark in marks.items():
            at = [one["t"] / seconds for one in own if one["kind"] == way and not one["why"]]
            ax.plot(at, np.full(len(at), 10.0 ** (low + 0.25)), mark, color=BLACK, markersize=4.5, fillstyle="none")
        at = [one["t"] / seconds for one in own if one["why"]]
        ax.plot(at, np.full(len(at), 10.0 ** (low + 0.25)), "x", color=VERMILLION, markersize=4.5)

    had = [way for way in marks if any(one["kind"] == way and not one["why"] for one in records)]
    return compose_panels(
        plan,
        telemetry,
        title="Navigation by pictures",
        y_label="error of the position [m]",
        draw=draw,
        limits=(10.0**low, 10.0**high),
        handles=[
            Line2D([], [], color=BLUE, linewidth=1.2, label="error"),
            Line2D([], [], color=ORANGE, linewidth=1.6, linestyle=DASHES[1], label="3 sigma, longest axis"),
            *(_mark(marks[way], BLACK, f"used: {way}") for way in had),
            *([_mark("x", VERMILLION, "not used")] if any(one["why"] for one in records) else []),
        ],
        log=True,
    )


def _mark(marker: str, colour: str, label: str) -> Line2D:
    return Line2D([], [], color=colour, marker=marker, linestyle="none", fillstyle="none", markersize=5, label=label)


def _components(plan: Plan, telemetry: xr.Dataset, values: Array) -> Callable[[Axes, int], None]:
    """A function that draws the components of one spacecraft; `values` has shape (time, spacecraft, 3 or 4)."""
    some, times = _drawn(plan, telemetry)

    def draw(ax: Axes, j: int) -> None:
        for component, colour, dashes in zip(values[some, j].T, COLOURS, DASHES, strict=False):
            ax.plot(times, component, color=colour, linewidth=1.2, linestyle=dashes)

    return draw


def _handles(names: list[str]) -> list[Line2D]:
    styles = zip(COLOURS, DASHES, names, strict=False)
    return [Line2D([], [], color=c, linewidth=1.6, linestyle=dashes, label=name) for c, dashes, name in styles]


def _after_release(telemetry: xr.Dataset, values: Array) -> Array:
    """The values, nan of spacecraft that are still aboard; shape (time, spacecraft, ...)."""
    if "released" not in telemetry:
        return values
    aboard = telemetry["released"].values == 0
    return np.where(aboard.reshape(aboard.shape + (1,) * (values.ndim - 2)), np.nan, values)


def _drawn(plan: Plan, telemetry: xr.Dataset) -> tuple[Indices, Array]:
    """Which samples are drawn, and their times in the unit of the axis."""
    scale, times = time_scale(plan, telemetry), telemetry["time"].values
    some = scale.samples(times)
    return some, times[some] / scale.axis.seconds


def _reach(values: Array, *, at_least: float) -> float:
    return max(1.08 * float(np.nanmax(np.abs(values))), at_least)
