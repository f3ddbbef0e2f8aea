"""The operation at the visit and at the end: body, observed faces, spacecraft, trails (AAS 19-144, Figure 11).

Drawn in the body-fixed frame A, so that the target stays where it is and only the swarm moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from swarm_mj.attitude.mrp import dcm
from swarm_mj.flight import ObservationResult, asteroid_attitudes
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.output.figures.box import box_around, draw_box
from swarm_mj.output.figures.cells import draw_cells
from swarm_mj.output.figures.panels import legend_below
from swarm_mj.output.figures.style import (
    BLACK,
    BLUE,
    GREY,
    HALO,
    ORANGE,
    SKY_BLUE,
    TICK_PT,
    VERMILLION,
    instant,
    label,
    new_figure,
    tidy,
    time_axis,
)
from swarm_mj.output.figures.view import (
    View,
    draw_body,
    draw_line,
    draw_points,
    face_colours,
    first_hits,
    straight,
    unit,
    views_of,
    visible_area,
)
from swarm_mj.planning import Plan
from swarm_mj.smallbody.shape import ShapeModel

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
    figure = new_figure(8.2, f"Operation of the swarm: {plan.scenario.name}", width_in=11.0)
    visit = int(np.argmin(np.abs(scene.times - plan.scenario.design.time_of_flight_s)))
    view = _view(plan, scene)
    grid = figure.subplots(2, 2, height_ratios=(3.0, 1.0))
    for column, k in enumerate((visit, len(scene.times) - 1)):
        seen = np.nan_to_num(result.coverage.first_seen_s, nan=np.inf) <= scene.times[k]
        _draw_instant(grid[0, column], plan, telemetry, seen, scene, view, k)
        _draw_target(grid[1, column], plan, seen)
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
    """A view in which the target, the flight path and the axes of the communications spacecraft can all be made out."""
    path = scene.r_A.mean(axis=1)
    lengthwise = [path[-1] - path[0], *scene.z_A[-1, scene.relays]]

    def merit(view: View) -> float:
        turned = [float(np.linalg.norm(view.axes[:2] @ unit(line))) for line in lengthwise]
        return visible_area(view, plan.region) / plan.region.total_area + 0.6 * min(turned)

    return max(views_of(plan.region), key=merit)


def _draw_instant(
    ax: Axes, plan: Plan, telemetry: xr.Dataset, seen: NDArray[np.bool_], scene: Scene, view: View, k: int
) -> None:
    body, region = plan.region.mesh, plan.region
    trail = np.unique(np.linspace(0, k, TRAIL_POINTS).astype(int))
    inside = np.vstack((body.vertices, scene.r_A[trail].reshape(-1, 3)))
    extent = float(np.ptp(inside, axis=0).max())
    tips = _axis_tips(telemetry, scene, body, k, FREE_AXIS * extent)
    draw_box(ax, view, box_around(np.vstack((inside, tips))))
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
    percent = 100.0 * region.area[seen].sum() / region.total_area
    ax.set_title(f"t = {instant(scene.times[k], axis)}, observed: {percent:.1f} %", fontsize=TICK_PT + 1, loc="left")


def _draw_target(ax: Axes, plan: Plan, seen: NDArray[np.bool_]) -> None:
    """The target alone, so that what was observed of it can be made out."""
    region = plan.region
    draw_cells(ax, region, np.where(seen[:, None], to_rgb(SKY_BLUE), to_rgb(ORANGE)))
    tidy(ax)
    ax.grid(False)
    label(ax, "angle east [deg]", "angle north [deg]")
    ax.set_title("target, seen from the body's centre", fontsize=TICK_PT)


def _axis_tips(telemetry: xr.Dataset, scene: Scene, body: ShapeModel, k: int, free: float) -> Array:
    """Where to end the line along each +z: as far as what it tracks, shape (n, 3) [m]."""
    r, mode, tracked = scene.r_A[k], telemetry["mode"].values[k], telemetry["tracked_spacecraft"].values[k]
    length = np.full(len(r), free)
    asteroid, other = mode == TargetKind.ASTEROID, mode == TargetKind.SPACECRAFT
    length[asteroid] = first_hits(r[asteroid], scene.z_A[k, asteroid], np.linalg.norm(r[asteroid], axis=1), body)
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
        Line2D([], [], color=GREY, linewidth=0.9, alpha=0.7, label="path flown; pale: behind the body"),
        Line2D([], [], color=BLACK, marker="s", markersize=6, linestyle="none", label="mothership at deployment"),
    ]
