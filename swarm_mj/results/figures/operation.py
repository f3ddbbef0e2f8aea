"""The operation at the visit and at the end: body, observed faces, spacecraft, trails (AAS 19-144, Figure 11).

Drawn in the body-fixed frame A, so that the target stays where it is and only the swarm moves.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.results.figures.box import box_around, draw_box
from swarm_mj.results.figures.cells import draw_cells
from swarm_mj.results.figures.numbering import number_beside
from swarm_mj.results.figures.panels import legend_below
from swarm_mj.results.figures.scene import FREE_AXIS, Scene, axis_tips, best_view, scene_from
from swarm_mj.results.figures.style import HALO, SMALL_PT, TICK_PT, caption, label, new_figure, tidy
from swarm_mj.results.figures.view import View, draw_body, draw_line, draw_points, face_colours, straight, unit
from swarm_mj.results.look import BLACK, BLUE, GREY, ORANGE, SKY_BLUE, VERMILLION, instant, time_axis
from swarm_mj.results.modes import LOST, MODE_LOOKS
from swarm_mj.typing import Array, Mask

#: Corners of a trail; a flyby bends little.
TRAIL_POINTS = 120
#: More spacecraft than these are not numbered: the numbers would cover each other.
MAX_NUMBERED = 12
DASHES = (0, (4, 2.5))


def compose_operation(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """The swarm around the body at the time of flight and at the end."""
    scene = scene_from(plan, telemetry)
    figure = new_figure(8.2, f"Operation of the swarm: {plan.scenario.name}", width_in=11.0)
    visit = int(np.argmin(np.abs(scene.times - plan.scenario.design.time_of_flight_s)))
    view = best_view(plan.region, scene, (visit, len(scene.times) - 1))
    grid = figure.subplots(2, 2, height_ratios=(3.0, 1.0))
    for column, k in enumerate((visit, len(scene.times) - 1)):
        seen = np.nan_to_num(result.coverage.first_seen_s, nan=np.inf) <= scene.times[k]
        _draw_instant(grid[0, column], plan, telemetry, seen, scene, view, k)
        _draw_target(grid[1, column], plan, seen)
    legend_below(figure, _handles(scene))
    return figure


def _draw_instant(ax: Axes, plan: Plan, telemetry: xr.Dataset, seen: Mask, scene: Scene, view: View, k: int) -> None:
    body, region = plan.region.mesh, plan.region
    trail = np.unique(np.linspace(0, k, TRAIL_POINTS).astype(int))
    inside = np.vstack((body.vertices, scene.r_A[trail].reshape(-1, 3)))
    extent = float(np.ptp(inside, axis=0).max())
    tips = axis_tips(telemetry, scene, body, k, FREE_AXIS * extent)
    ax.set_anchor("N")
    draw_box(ax, view, box_around(np.vstack((inside, tips))))
    draw_body(ax, view, body, face_colours(body, [(region.target, ORANGE), (region.target[seen], SKY_BLUE)]))
    faint = 0.55 if plan.n <= MAX_NUMBERED else 0.3
    for j in range(plan.n):
        colour = _colour(scene, j, k)
        draw_line(ax, view, body, scene.r_A[trail, j], color=colour, linewidth=0.9, alpha=faint)
        if scene.mode[k, j] == LOST:
            continue
        draw_line(ax, view, body, straight(scene.r_A[k, j], tips[j]), color=colour, linewidth=1.0, linestyle=DASHES)
    draw_points(ax, view, body, scene.r_A[0, :1], marker="s", markersize=6, color=BLACK)
    for j in range(plan.n):
        draw_points(
            ax, view, body, scene.r_A[k, j : j + 1], marker="o", markersize=6.5, color=_colour(scene, j, k), mec="white"
        )
    for relay in np.flatnonzero(scene.mode[k] == TargetKind.EARTH):
        _name_earth(ax, view.project(scene.r_A[k, relay]), view.project(tips[relay]))
    if plan.n <= MAX_NUMBERED:
        flown = [view.project(scene.r_A[trail, j]) for j in range(plan.n)]
        sights = [view.project(np.stack(ends)) for ends in zip(scene.r_A[k], tips, strict=True)]
        colours = [_colour(scene, j, k) for j in range(plan.n)]
        number_beside(ax, view.project(scene.r_A[k]), colours, lines=[*flown, *sights])
    axis = time_axis(plan.scenario.duration_s)
    percent = 100.0 * region.area[seen].sum() / region.total_area
    caption(ax, f"t = {instant(scene.times[k], axis)}, $P_{{TO}}$ = {percent:.2f} %", size=TICK_PT + 1)


def _draw_target(ax: Axes, plan: Plan, seen: Mask) -> None:
    """The target alone, so that what was observed of it can be made out."""
    region = plan.region
    draw_cells(ax, region, np.where(seen[:, None], to_rgb(SKY_BLUE), to_rgb(ORANGE)))
    tidy(ax)
    ax.grid(False)
    label(ax, "angle east [deg]", "angle north [deg]")
    ax.set_title("target, seen from the body's centre", fontsize=TICK_PT)


def _colour(scene: Scene, j: int, k: int) -> str:
    """Colour of spacecraft j at sample k."""
    if scene.mode[k, j] == LOST:
        return MODE_LOOKS[LOST].line_colour
    return BLUE if scene.relays[j] else VERMILLION


def _name_earth(ax: Axes, start: Array, tip: Array) -> None:
    """Say where an axis without a visible end leads."""
    offset = 5.0 * unit(tip - start)
    ax.annotate(
        "to Earth",
        (float(tip[0]), float(tip[1])),
        xytext=(float(offset[0]), float(offset[1])),
        textcoords="offset points",
        ha="left" if offset[0] >= 0.0 else "right",
        va="center",
        fontsize=SMALL_PT,
        color=BLUE,
        path_effects=HALO,
        zorder=7,
    )


def _handles(scene: Scene) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Patch(facecolor=SKY_BLUE, label="target, observed so far"),
        Patch(facecolor=ORANGE, label="target, not yet observed"),
    ]
    if not scene.relays.all():
        handles.append(_spot("observing spacecraft", VERMILLION, "o"))
    if scene.relays.any():
        handles.append(_spot("communications spacecraft", BLUE, "o"))
    if (scene.mode[-1] == LOST).any():
        handles.append(_spot("lost spacecraft", MODE_LOOKS[LOST].line_colour, "o"))
    return [
        *handles,
        Line2D([], [], color=GREY, linewidth=1.0, linestyle=DASHES, label="spacecraft +z axis"),
        Line2D([], [], color=GREY, linewidth=0.9, alpha=0.7, label="path flown; pale: behind the body"),
        _spot("mothership at deployment", BLACK, "s"),
    ]


def _spot(name: str, colour: str, marker: str) -> Line2D:
    return Line2D([], [], color=colour, marker=marker, markersize=7, linestyle="none", label=name)
