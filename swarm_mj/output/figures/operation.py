"""The operation at the visit and at the end: body, observed faces, spacecraft, trails (AAS 19-144, Figure 11).

Drawn in the body-fixed frame A, so that the target stays where it is and only the swarm moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from swarm_mj.attitude.mrp import dcm
from swarm_mj.flight import ObservationResult, asteroid_attitudes
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.output.figures.box import box_around, draw_box
from swarm_mj.output.figures.panels import legend_below
from swarm_mj.output.figures.style import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    SKY_BLUE,
    TICK_PT,
    VERMILLION,
    instant,
    new_figure,
    time_axis,
)
from swarm_mj.output.figures.target import HALO
from swarm_mj.output.figures.view import (
    View,
    draw_body,
    draw_line,
    draw_points,
    face_colours,
    straight,
    unit,
)
from swarm_mj.planning import Plan

Array = NDArray[np.float64]

#: Corners of a trail; a flyby bends little.
TRAIL_POINTS = 120
#: More spacecraft than these are not numbered: the numbers would cover each other.
MAX_NUMBERED = 12
#: Length of a +z axis that points at nothing near, as a share of the picture.
FREE_AXIS = 0.3
DASHES = (0, (4, 2.5))


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What flies around the body, in A.

    Attributes:
        times: Shape (t,) [s].
        r_A: Positions, shape (t, n, 3) [m].
        z_A: Directions of +z, shape (t, n, 3).
        relays: Whether each spacecraft is, or at some time becomes, the communications spacecraft, shape (n,).
    """

    times: Array
    r_A: Array
    z_A: Array
    relays: NDArray[np.bool_]


def compose_operation(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """The swarm around the body at the time of flight and at the end."""
    scene = scene_from(plan, telemetry)
    figure = new_figure(6.0, f"Operation of the swarm - {plan.scenario.name}", width_in=11.0)
    visit = int(np.argmin(np.abs(scene.times - plan.scenario.design.time_of_flight_s)))
    view = _view(plan, scene)
    for ax, k in zip(figure.subplots(1, 2), (visit, len(scene.times) - 1), strict=True):
        _draw_instant(ax, plan, telemetry, result, scene, view, k)
    legend_below(figure, _handles(scene))
    return figure


def scene_from(plan: Plan, telemetry: xr.Dataset) -> Scene:
    """Turn telemetry into A."""
    C_AN = asteroid_attitudes(telemetry)
    z_N = dcm(telemetry["sigma_BN"].values)[..., 2, :]
    ever_earth = (telemetry["mode"].values == TargetKind.EARTH).any(axis=0)
    return Scene(
        times=telemetry["time"].values,
        r_A=np.einsum("kij,knj->kni", C_AN, telemetry["r_BN_N"].values),
        z_A=np.einsum("kij,knj->kni", C_AN, z_N),
        relays=ever_earth | (np.arange(plan.n) >= plan.n_observers),
    )


def _view(plan: Plan, scene: Scene) -> View:
    """A view that shows the target and the flight path broadside, from the side on which the body hides less of it."""
    up = plan.region.axes_A[2]
    path = scene.r_A.mean(axis=1)
    across = np.cross(path[-1] - path[0], up)
    if np.linalg.norm(across) < 1e-3 * np.linalg.norm(path[-1] - path[0]):  # straight towards or away from the target
        across = plan.region.axes_A[0]
    views = [View.from_direction(up + side * 1.3 * unit(across) + np.array([0.0, 0.0, 0.5])) for side in (1.0, -1.0)]
    some = scene.r_A[:: max(1, len(scene.times) // TRAIL_POINTS)].reshape(-1, 3)
    return min(views, key=lambda view: int(view.hidden(some, plan.region.mesh).sum()))


def _draw_instant(
    ax: Axes, plan: Plan, telemetry: xr.Dataset, result: ObservationResult, scene: Scene, view: View, k: int
) -> None:
    body, region, coverage = plan.region.mesh, plan.region, result.coverage
    trail = np.unique(np.linspace(0, k, TRAIL_POINTS).astype(int))
    inside = np.vstack((body.vertices, scene.r_A[trail].reshape(-1, 3)))
    extent = float(np.ptp(inside, axis=0).max())
    tips = _axis_tips(telemetry, scene, k, FREE_AXIS * extent)
    draw_box(ax, view, box_around(np.vstack((inside, tips))))
    seen = np.nan_to_num(coverage.first_seen_s, nan=np.inf) <= scene.times[k]
    draw_body(ax, view, body, face_colours(body, [(region.target, ORANGE), (region.target[seen], SKY_BLUE)]))
    for j in range(plan.n):
        colour = _colour(scene, j)
        draw_line(ax, view, body, scene.r_A[trail, j], color=colour, linewidth=0.9, alpha=0.55)
        draw_line(ax, view, body, straight(scene.r_A[k, j], tips[j]), color=colour, linewidth=1.0, linestyle=DASHES)
    draw_points(ax, view, body, scene.r_A[0, :1], marker="s", markersize=6, color=BLACK)
    for j in range(plan.n):
        draw_points(
            ax, view, body, scene.r_A[k, j : j + 1], marker="o", markersize=6.5, color=_colour(scene, j), mec="white"
        )
    if plan.n <= MAX_NUMBERED:
        _number_spacecraft(ax, view.project(scene.r_A[k]), scene)
    axis = time_axis(plan.scenario.duration_s)
    percent = float(coverage.percent_over_time(scene.times[k]))
    ax.set_title(f"t = {instant(scene.times[k], axis)}, observed: {percent:.1f} %", fontsize=TICK_PT + 1, loc="left")


def _axis_tips(telemetry: xr.Dataset, scene: Scene, k: int, free: float) -> Array:
    """Where to end the line along each +z: as far as what it tracks, shape (n, 3) [m]."""
    r, mode, tracked = scene.r_A[k], telemetry["mode"].values[k], telemetry["tracked_spacecraft"].values[k]
    length = np.full(len(r), free)
    asteroid, other = mode == TargetKind.ASTEROID, mode == TargetKind.SPACECRAFT
    length[asteroid] = np.linalg.norm(r[asteroid], axis=1)
    length[other] = np.linalg.norm(r[other] - r[tracked[other]], axis=1)
    return r + length[:, None] * scene.z_A[k]


def _colour(scene: Scene, j: int) -> str:
    return BLUE if scene.relays[j] else VERMILLION


def _number_spacecraft(ax: Axes, flat: Array, scene: Scene) -> None:
    """Put each number outside the swarm, as seen in the picture."""
    away = flat - flat.mean(axis=0)
    length = np.linalg.norm(away, axis=1, keepdims=True)
    away = np.where(length > 0.0, away / np.maximum(length, 1e-12), (0.0, 1.0))
    for j, (place, offset) in enumerate(zip(flat, 11.0 * away, strict=True)):
        ax.annotate(
            str(j + 1),
            (float(place[0]), float(place[1])),
            xytext=(float(offset[0]), float(offset[1])),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=TICK_PT,
            fontweight="bold",
            color=_colour(scene, j),
            path_effects=HALO,
            zorder=7,
        )


def _handles(scene: Scene) -> list[Line2D | Patch]:
    spot = {"marker": "o", "markersize": 7, "linestyle": "none"}
    handles: list[Line2D | Patch] = [
        Patch(facecolor=SKY_BLUE, label="target, observed so far"),
        Patch(facecolor=ORANGE, label="target, not yet observed"),
        Line2D([], [], color=VERMILLION, label="observing spacecraft", **spot),
    ]
    if scene.relays.any():
        handles.append(Line2D([], [], color=BLUE, label="communications spacecraft", **spot))
    return [
        *handles,
        Line2D([], [], color=GREY, linewidth=1.0, linestyle=DASHES, label="spacecraft +z axis"),
        Line2D([], [], color=GREY, linewidth=0.9, alpha=0.7, label="path flown"),
        Line2D([], [], color=BLACK, marker="s", markersize=6, linestyle="none", label="mothership at deployment"),
    ]
