"""Attitude behaviours: what each spacecraft tracks inside and outside the imaging region (AAS 19-144, Figure 3).

In the body-fixed frame A the imaging region |r_j| <= R_im is a ball about the body's centre, as it is in the inertial frame.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.ticker import NullLocator

from swarm_mj.figures.palette import BLACK, GREY, MODE_STYLES, ORANGE
from swarm_mj.figures.panels import legend_below
from swarm_mj.figures.scene import (
    Scene,
    axis_tips,
    enlarge_small_body,
    frame_at_rest,
    frame_words,
    near_arrival,
    scene_from,
)
from swarm_mj.figures.style import HALO, SMALL_PT, annotate, caption, label, new_figure, tidy
from swarm_mj.figures.timescale import TimeScale, time_scale
from swarm_mj.figures.view import (
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
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.target import TargetRegion
from swarm_mj.records.modes import LOST, Run, modes_shown, runs
from swarm_mj.typing import Array, Indices

#: What is asked for as a frame.
Frame = Literal["A", "N"] | None
#: Corners of a path; a flyby bends little.
PATH_POINTS = 120
#: Length of a +z axis that points at nothing near, as a share of the imaging radius.
FREE_AXIS = 0.35
#: The paths are drawn to this many times the imaging radius at least; the shorter side of their diagram over the longer.
AROUND, LEAST_SIDE = 1.6, 0.5
#: Distances beyond this many times the imaging radius need a logarithmic axis.
LOGARITHMIC = 20.0
#: Half the width of the text that tells an instant, over that of the axes.
HALF_TEXT = 0.06
#: Height of the text and its distance from what it stands above, over that of the axes.
TEXT_ROOM = 0.12
#: More spacecraft than these are drawn thin.
MANY = 12
AXIS_DOTS = (0, (1.2, 1.6))


def compose_behaviors(plan: Plan, telemetry: xr.Dataset, result: ObservationResult, frame: Frame = None) -> Figure:
    """Paths and +z axes across the flight, and distances to the body's centre, coloured by what is tracked.

    Args:
        plan: What was flown.
        telemetry: How.
        result: What was observed.
        frame: Of the paths, "A" or "N"; None: A, but N where the body turns far.
    """
    scale = time_scale(plan, telemetry)
    near = near_arrival(plan, telemetry, AROUND * plan.scenario.behavior.imaging_radius_m)
    at_rest = frame_at_rest(plan, near, frame)
    figure = new_figure(5.0, f"Attitude behaviours: {plan.scenario.name}", width_in=11.0)
    across, distance = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    _draw_across(across, plan, near, scene_from(plan, near, at_rest=at_rest), scale)
    # One line of both would be wider than the diagram.
    between = ",\n" if at_rest else ", "
    caption(across, f"{frame_words(at_rest)}{between}looking along the normal of the flight plane")
    _draw_distances(distance, plan, telemetry, scale)
    styles = [MODE_STYLES[m] for m in np.unique(modes_shown(telemetry))]
    region = [Line2D([], [], color=BLACK, linewidth=1.2, label="imaging region")]
    legend_below(
        figure,
        [
            *(Line2D([], [], color=o.line_colour, linewidth=2.0, linestyle=o.dashes, label=o.words) for o in styles),
            Line2D([], [], color=GREY, linewidth=1.1, linestyle=AXIS_DOTS, label="+z axis, at the instants named"),
            *(region if _crossed(across, distance, plan.scenario.behavior.imaging_radius_m / KM) else []),
            *scale.handles(),
        ],
    )
    return figure


def _crossed(across: Axes, distance: Axes, radius_km: float) -> bool:
    """Whether the border of the imaging region is in one of the two diagrams."""
    corners = np.array([[x, y] for x in across.get_xlim() for y in across.get_ylim()])
    reach = np.linalg.norm(corners, axis=1)
    low, high = distance.get_ylim()
    return bool(low <= radius_km <= high or radius_km <= reach.max())


def flight_plane(region: TargetRegion, scene: Scene, arrival: int) -> View:
    """The view along the normal of the mean flight's plane, from the side that shows more of the target.

    The path is level and the arrival above the body's centre.
    """
    path = scene.r_A.mean(axis=1)
    along = unit(path[-1] - path[0])
    above = path[arrival] - (path[arrival] @ along) * along
    if np.linalg.norm(above) < 1e-6 * np.linalg.norm(path[0]):  # a flight through the centre has no side
        above = np.cross(along, np.roll(along, 1) + [0.1, 0.2, 0.3])
    above = unit(above)
    sides = [View(np.array([right, above, np.cross(right, above)])) for right in (along, -along)]
    return max(sides, key=lambda view: visible_share(view, region))


def _draw_across(ax: Axes, plan: Plan, telemetry: xr.Dataset, scene: Scene, scale: TimeScale) -> None:
    region, radius = plan.region, plan.scenario.behavior.imaging_radius_m
    arrival = int(np.argmin(np.abs(scene.times - scale.arrival_s)))
    view = flight_plane(region, scene, arrival)
    ax.add_patch(Circle((0.0, 0.0), radius / KM, facecolor="#F6F6F6", edgecolor=BLACK, linewidth=1.2, zorder=0))
    colours = face_colours(region.mesh, [(region.target, ORANGE)])
    draw_body(ax, view, region.mesh, colours)
    width = _width(plan)
    for j in range(plan.n):
        for run in runs(telemetry, j):
            path = scene.r_A[_samples(scene.times, run), j]
            style = MODE_STYLES[run.mode]
            draw_line(ax, view, region.mesh, path, color=style.line_colour, linewidth=width, linestyle=style.dashes)
    places = view.project(np.vstack((region.mesh.vertices, scene.r_A.reshape(-1, 3))))
    low, high = places.min(axis=0), places.max(axis=0)
    longest = float((high - low).max())
    room = np.maximum(0.12 * longest, 0.5 * (LEAST_SIDE * longest - (high - low)))
    (left, bottom), (right, top) = low - room, high + room
    ax.set_xlim(left, right)
    ax.set_ylim(bottom, top)
    ax.set_aspect("equal")
    for k in (arrival, len(scene.times) - 1):
        _draw_axes(ax, plan, telemetry, scene, view, k, scale)
    enlarge_small_body(ax, view, region.mesh, colours, view.project(scene.r_A.reshape(-1, 3)))
    tidy(ax)
    path = scene.r_A.mean(axis=1)
    if (path[-1] - path[0]) @ view.axes[0] < 0.0:  # the flight leads to the left, and still counts upwards
        ax.xaxis.set_major_formatter(lambda x, _: f"{-x + 0.0:g}".replace("-", "\N{MINUS SIGN}"))
    label(ax, "along the flight path [km]", "across the flight path [km]")


def _width(plan: Plan) -> float:
    return 1.3 if plan.n <= MANY else 0.6


def _samples(times: Array, run: Run) -> Indices:
    first, last = np.searchsorted(times, (run.start, run.end))
    return np.unique(np.linspace(first, last, PATH_POINTS).astype(int))


def _draw_axes(ax: Axes, plan: Plan, telemetry: xr.Dataset, scene: Scene, view: View, k: int, scale: TimeScale) -> None:
    mesh, width = plan.region.mesh, _width(plan)
    tips = axis_tips(telemetry, scene, mesh, k, FREE_AXIS * plan.scenario.behavior.imaging_radius_m)
    for j, mode in enumerate(modes_shown(telemetry)[k]):
        style = MODE_STYLES[mode]
        if mode < LOST:
            line = straight(scene.r_A[k, j], tips[j])
            draw_line(ax, view, mesh, line, color=style.line_colour, linewidth=0.9 * width, linestyle=AXIS_DOTS)
        look: dict[str, Any] = {"marker": "o", "markersize": 4.0 * width, "color": style.line_colour, "mec": "white"}
        draw_points(ax, view, mesh, scene.r_A[k, j : j + 1], **look)
    lines = np.vstack([straight(r_A, tip) for r_A, tip in zip(scene.r_A[k], tips, strict=True)])
    place = place_above(ax, view.project(scene.r_A[k]), view.project(np.vstack((lines, scene.r_A.reshape(-1, 3)))))
    when, size = scale.instant(scene.times[k]), SMALL_PT + 1
    annotate(ax, when, place, (0.0, 10.0), va="baseline", fontsize=size, path_effects=HALO, zorder=7)


def place_above(ax: Axes, points: Array, lines: Array) -> Array:
    """Where a short text stands above points (n, 2) and clear of lines (m, 2), all in the axes' units, shape (2,)."""
    left, right = ax.get_xlim()
    x = float(points[:, 0].mean())
    crossing = lines[np.abs(lines[:, 0] - x) < HALF_TEXT * (right - left)]
    above = float(np.max(np.concatenate((points, crossing))[:, 1]))
    bottom, top = ax.get_ylim()
    highest = top - TEXT_ROOM * (top - bottom)
    if above <= highest:
        return np.array([x, above])
    # Lines of sight leave the diagram upwards: the text stays in it, beside them.
    leaving = lines[lines[:, 1] > highest]
    beside = leaving[np.abs(leaving[:, 0] - x) < 2.0 * HALF_TEXT * (right - left)]
    return np.array([float(np.max(beside[:, 0], initial=x)) + HALF_TEXT * (right - left), highest])


def _draw_distances(ax: Axes, plan: Plan, telemetry: xr.Dataset, scale: TimeScale) -> None:
    unit, radius_km = scale.axis.seconds, plan.scenario.behavior.imaging_radius_m / KM
    times = telemetry["time"].values
    distance = np.linalg.norm(telemetry["r_BN_N"].values, axis=2) / KM
    drawn = scale.samples(times)
    for j in range(plan.n):
        for run in runs(telemetry, j):
            first, last = np.searchsorted(times, (run.start, run.end))
            part = np.union1d(drawn[(drawn > first) & (drawn < last)], (first, last))
            style, width = MODE_STYLES[run.mode], 1.6 if plan.n <= MANY else 0.7
            x, y = times[part] / unit, distance[part, j]
            ax.plot(x, y, color=style.line_colour, linewidth=width, linestyle=style.dashes)
            if run.start > 0.0:
                ax.plot(run.start / unit, distance[first, j], "o", color=BLACK, markersize=3.5, zorder=4)
    bottom, top = _distance_limits(ax, distance, radius_km)
    ax.axhspan(bottom, min(radius_km, top), color="#F6F6F6", zorder=0)
    if radius_km <= top:
        ax.axhline(radius_km, color=BLACK, linewidth=1.2, zorder=1.5)
    scale.draw(ax)
    label(ax, y="distance to the body's centre [km]")
    caption(ax, f"imaging radius $R_{{im}}$ = {radius_km:g} km; dots: switches")


def _distance_limits(ax: Axes, distance_km: Array, radius_km: float) -> tuple[float, float]:
    """Scale the vertical axis so that both the imaging region and the whole flight can be read."""
    least, most = float(distance_km.min()), float(distance_km.max())
    if most > LOGARITHMIC * max(radius_km, least) and least > 0.0:
        ax.set_yscale("log")
        ax.set_ylim(0.6 * min(least, radius_km), 1.5 * most)
        ax.yaxis.set_minor_locator(NullLocator())
    else:
        ax.set_ylim(0.0, 1.08 * max(most, radius_km if radius_km < 2.0 * most else 0.0))
    return ax.get_ylim()
