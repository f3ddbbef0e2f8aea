"""Attitude behaviours: what each spacecraft tracks inside and outside the imaging region (AAS 19-144, Figure 3).

In the body-fixed frame A the imaging region |r_j| <= R_im is a ball about the body's centre, as it is in the inertial frame.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from swarm_mj.flight.observe import ObservationResult, visit_sample
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.target import TargetRegion
from swarm_mj.results.figures.panels import every, legend_below
from swarm_mj.results.figures.scene import Scene, axis_tips, scene_from
from swarm_mj.results.figures.style import (
    HALO,
    SMALL_PT,
    TICK_PT,
    VISIT_DASHES,
    caption,
    label,
    name_time,
    new_figure,
    show_time,
    tidy,
)
from swarm_mj.results.figures.view import (
    KM,
    View,
    draw_body,
    draw_line,
    draw_points,
    face_colours,
    straight,
    unit,
    visible_share,
)
from swarm_mj.results.look import BLACK, GREY, ORANGE, instant, time_axis
from swarm_mj.results.modes import LOST, MODE_LOOKS, Run, modes_shown, runs
from swarm_mj.typing import Array, Indices

#: Corners of a path; a flyby bends little.
PATH_POINTS = 120
#: Length of a +z axis that points at nothing near, as a share of the imaging radius.
FREE_AXIS = 0.35
#: Half the width of the text that tells an instant, over that of the axes.
HALF_TEXT = 0.06
#: More spacecraft than these are drawn thin.
MANY = 12
DASHES = (0, (4, 2.5))


def compose_behaviors(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Paths and +z axes across the flight, and distances to the body's centre, coloured by what is tracked."""
    scene = scene_from(plan, telemetry)
    figure = new_figure(5.0, f"Attitude behaviours: {plan.scenario.name}", width_in=11.0)
    across, distance = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    _draw_across(across, plan, telemetry, scene)
    _draw_distances(distance, plan, telemetry, scene)
    shown = np.unique(modes_shown(telemetry))
    handles = [Line2D([], [], color=MODE_LOOKS[m].line_colour, linewidth=2.0, label=MODE_LOOKS[m].words) for m in shown]
    legend_below(
        figure,
        [
            *handles,
            Line2D([], [], color=GREY, linewidth=1.1, linestyle=DASHES, label="+z axis, at the visit and the end"),
            Line2D([], [], color=BLACK, linewidth=1.2, label="imaging region"),
            Line2D([], [], color=GREY, linewidth=1.0, linestyle=VISIT_DASHES, label="visit"),
        ],
    )
    return figure


def flight_plane(region: TargetRegion, scene: Scene, visit: int) -> View:
    """The view along the normal of the mean flight's plane, from the side that shows more of the target.

    The path is level and the visit above the body's centre.
    """
    path = scene.r_A.mean(axis=1)
    along = unit(path[-1] - path[0])
    above = path[visit] - (path[visit] @ along) * along
    if np.linalg.norm(above) < 1e-6 * np.linalg.norm(path[0]):  # a flight through the centre has no side
        above = np.cross(along, np.roll(along, 1) + [0.1, 0.2, 0.3])
    above = unit(above)
    sides = [View(np.array([right, above, np.cross(right, above)])) for right in (along, -along)]
    return max(sides, key=lambda view: visible_share(view, region))


def _draw_across(ax: Axes, plan: Plan, telemetry: xr.Dataset, scene: Scene) -> None:
    region, radius = plan.region, plan.scenario.behavior.imaging_radius_m
    visit = visit_sample(plan.scenario)
    view = flight_plane(region, scene, visit)
    ax.add_patch(Circle((0.0, 0.0), radius / KM, facecolor="#F6F6F6", edgecolor=BLACK, linewidth=1.2, zorder=0))
    draw_body(ax, view, region.mesh, face_colours(region.mesh, [(region.target, ORANGE)]))
    width = 1.3 if plan.n <= MANY else 0.6
    for j in range(plan.n):
        for run in runs(telemetry, j):
            path = scene.r_A[_samples(scene.times, run), j]
            draw_line(ax, view, region.mesh, path, color=MODE_LOOKS[run.mode].line_colour, linewidth=width)
    places = view.project(np.vstack((region.mesh.vertices, scene.r_A.reshape(-1, 3))))
    low, high = places.min(axis=0), places.max(axis=0)
    room = 0.12 * float((high - low).max())
    ax.set_xlim(low[0] - room, high[0] + room)
    ax.set_ylim(low[1] - room, high[1] + room)
    ax.set_aspect("equal")
    for k in (visit, len(scene.times) - 1):
        _draw_axes(ax, plan, telemetry, scene, view, k, width)
    tidy(ax)
    path = scene.r_A.mean(axis=1)
    if (path[-1] - path[0]) @ view.axes[0] < 0.0:  # the flight leads to the left, and still counts upwards
        ax.xaxis.set_major_formatter(lambda x, _: f"{-x + 0.0:g}".replace("-", "\N{MINUS SIGN}"))
    label(ax, "along the flight path [km]", "across the flight path [km]")
    caption(ax, "frame A, looking along the normal of the flight plane")


def _samples(times: Array, run: Run) -> Indices:
    first, last = np.searchsorted(times, (run.start, run.end))
    return np.unique(np.linspace(first, last, PATH_POINTS).astype(int))


def _draw_axes(ax: Axes, plan: Plan, telemetry: xr.Dataset, scene: Scene, view: View, k: int, width: float) -> None:
    mesh = plan.region.mesh
    tips = axis_tips(telemetry, scene, mesh, k, FREE_AXIS * plan.scenario.behavior.imaging_radius_m)
    for j, mode in enumerate(modes_shown(telemetry)[k]):
        look = MODE_LOOKS[mode]
        if mode != LOST:
            line = straight(scene.r_A[k, j], tips[j])
            draw_line(ax, view, mesh, line, color=look.line_colour, linewidth=0.9 * width, linestyle=DASHES)
        draw_points(
            ax,
            view,
            mesh,
            scene.r_A[k, j : j + 1],
            marker="o",
            markersize=4.0 * width,
            color=look.line_colour,
            mec="white",
        )
    when = instant(scene.times[k], time_axis(plan.scenario.duration_s))
    lines = np.vstack([straight(r_A, tip) for r_A, tip in zip(scene.r_A[k], tips, strict=True)])
    ax.annotate(
        when,
        _above(ax, view.project(scene.r_A[k]), view.project(np.vstack((lines, scene.r_A.reshape(-1, 3))))),
        xytext=(0.0, 10.0),
        textcoords="offset points",
        ha="center",
        fontsize=SMALL_PT + 1,
        path_effects=HALO,
        zorder=7,
    )


def _above(ax: Axes, points: Array, lines: Array) -> tuple[float, float]:
    """Where a short text stands above points and clear of lines, both in the axes' units, shape (n, 2)."""
    left, right = ax.get_xlim()
    x = float(points[:, 0].mean())
    crossing = lines[np.abs(lines[:, 0] - x) < HALF_TEXT * (right - left)]
    return x, float(np.max(np.concatenate((points, crossing))[:, 1]))


def _draw_distances(ax: Axes, plan: Plan, telemetry: xr.Dataset, scene: Scene) -> None:
    axis, radius = time_axis(plan.scenario.duration_s), plan.scenario.behavior.imaging_radius_m
    distance = np.linalg.norm(scene.r_A, axis=2) / KM
    step = every(len(scene.times)).step
    for j in range(plan.n):
        for run in runs(telemetry, j):
            first, last = np.searchsorted(scene.times, (run.start, run.end))
            part = slice(first, last + 1, step)
            ax.plot(
                scene.times[part] / axis.seconds,
                distance[part, j],
                color=MODE_LOOKS[run.mode].line_colour,
                linewidth=1.6 if plan.n <= MANY else 0.7,
            )
            if run.start > 0.0:
                ax.plot(run.start / axis.seconds, distance[first, j], "o", color=BLACK, markersize=3.5, zorder=4)
    top = 1.08 * max(float(distance.max()), radius / KM if radius / KM < 2.0 * distance.max() else 0.0)
    ax.axhspan(0.0, min(radius / KM, top), color="#F6F6F6", zorder=0)
    if radius / KM <= top:
        ax.axhline(radius / KM, color=BLACK, linewidth=1.2, zorder=1.5)
    ax.set_ylim(0.0, top)
    ax.axvline(
        plan.scenario.design.time_of_flight_s / axis.seconds,
        color=GREY,
        linewidth=1.0,
        linestyle=VISIT_DASHES,
        zorder=1.5,
    )
    show_time(ax, axis, plan.scenario.duration_s)
    tidy(ax)
    name_time(ax, axis)
    label(ax, y="distance to the body's centre [km]")
    ax.set_title(f"imaging radius $R_{{im}}$ = {radius / KM:g} km; dots: switches", fontsize=TICK_PT, loc="left")
