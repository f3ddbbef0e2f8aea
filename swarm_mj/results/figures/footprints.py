"""Footprints of the pictures on a map, with the target outlined and what was observed of it."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from swarm_mj.flight.observe import ObservationResult, camera_from, flight_pictures, visit_sample
from swarm_mj.flight.plan import Plan
from swarm_mj.observation.camera import CameraModel, CameraPose
from swarm_mj.results.figures.ground_track import MAX_NUMBERED, number_places
from swarm_mj.results.figures.maps import (
    Ground,
    Window,
    draw_track,
    latitude_longitude,
    name_map,
    paint,
    survey,
    target_outline,
    whole_body,
)
from swarm_mj.results.figures.panels import legend_below
from swarm_mj.results.figures.style import caption, new_figure, note_of_omission, shown_spacecraft
from swarm_mj.results.figures.view import HIDING_DEPTH, depth_of, face_colours, tracer_of, unit
from swarm_mj.results.look import BLACK, ORANGE, SKY_BLUE, SPACECRAFT, instant, spacecraft_colours, time_axis
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array

#: Places along a parallel: of the painted ground, of the outlines, and when looking for what the map must hold.
PAINTED_COLUMNS, OUTLINE_COLUMNS, SEARCH_COLUMNS = 540, 240, 120
#: The pictures of a passage are thinned to so many; they overlap.
MAX_PICTURES = 120
#: Width of an outline that has its own colour.
SINGLE_PT = 2.0


def compose_footprints(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """What each picture holds at the visit, and what all pictures of the passage hold together."""
    mesh, scenario = plan.region.mesh, plan.scenario
    camera = camera_from(scenario)
    shown = shown_spacecraft(plan.n_observers)
    visit_s = telemetry["time"].values[visit_sample(scenario)]
    taken = list(flight_pictures(plan, telemetry))
    poses = {
        picture.spacecraft: picture.pose for picture in taken if picture.t == visit_s and picture.spacecraft in shown
    }
    window = _window(plan, camera, list(poses.values()))
    figure = new_figure(7.0, f"Footprints of the pictures: {scenario.name}{note_of_omission(plan.n_observers, shown)}")
    ax = figure.subplots()
    _paint_ground(ax, plan, result, window)
    ground = survey(mesh, window, OUTLINE_COLUMNS)
    if scenario.observation.criterion == "passage":
        passage = [picture.pose for picture in taken[:: 1 + len(taken) // MAX_PICTURES]]
        _draw_union(ax, passage, camera, mesh, ground)
    draw_track(ax, target_outline(plan.region), window.centre_longitude, color=BLACK, linewidth=2.2, zorder=3)
    colours = dict(zip(shown.tolist(), spacecraft_colours(len(shown)), strict=True))
    outlines: list[Array] = []
    for j, pose in poses.items():
        margin = view_margin(camera, pose, ground, mesh)
        width = SINGLE_PT if len(shown) <= len(SPACECRAFT) else 0.8
        outlines += _outline(ax, ground, margin, color=colours[j], linewidth=width)
    name_map(ax, window)
    _number(ax, plan, poses, mesh, window, colours, outlines)
    axis = time_axis(scenario.duration_s)
    percent = result.coverage.percent
    caption(
        ax,
        f"outlines: the visit, t = {instant(scenario.design.time_of_flight_s, axis)}; "
        f"half-angle {camera.half_angle_deg:g}\N{DEGREE SIGN}; $P_{{TO}}$ = {percent:.2f} %",
    )
    legend_below(figure, _handles(plan, colours))
    return figure


def view_margin(camera: CameraModel, pose: CameraPose, ground: Ground, body: ShapeModel) -> Array:
    """How far inside a picture each place of a map lies: above zero where the picture holds it.

    Args:
        camera: The camera.
        pose: Where it is.
        ground: The places.
        body: The mesh that hides some of them.

    Returns:
        The lesser of two measures that cross zero where a footprint ends, shape (r, c): the distance to the picture's edge
        over half its width, and the cosine of the emission angle. Below zero too where other ground is in between.
    """
    points = ground.points_A
    x, y, z = np.moveaxis(pose.to_camera(points), -1, 0)
    across = np.hypot(x, y) if camera.shape == "cone" else np.maximum(np.abs(x), np.abs(y))
    with np.errstate(invalid="ignore", divide="ignore"):
        edge = np.where(z > 0.0, 1.0 - across / (z * camera.tan_half_angle), -1.0)
    away = points - pose.r_A
    distance = np.linalg.norm(away, axis=-1)
    facing = -np.einsum("...i,...i", away, body.face_normals[ground.face]) / distance
    margin = np.nan_to_num(np.clip(np.minimum(edge, facing), -1.0, 1.0), nan=-1.0)
    row, column = np.nonzero(margin > 0.0)
    hit = tracer_of(body).first_hit(pose.r_A, away[row, column])
    depth = distance[row, column] * depth_of(hit, pose.r_A, away[row, column], body)
    hidden = (hit >= 0) & (depth < distance[row, column] - HIDING_DEPTH * body.max_radius)
    margin[row[hidden], column[hidden]] *= -1.0
    return margin


def _window(plan: Plan, camera: CameraModel, poses: list[CameraPose]) -> Window:
    """The target and the footprints of the visit, with some room around."""
    mesh, centre = plan.region.mesh, plan.scenario.target.longitude_deg
    coarse = survey(mesh, whole_body(centre), SEARCH_COLUMNS)
    latitude, longitude = latitude_longitude(target_outline(plan.region), centre)
    for pose in poses:
        row, column = np.nonzero(view_margin(camera, pose, coarse, mesh) > 0.0)
        latitude = np.append(latitude, coarse.latitudes[row])
        longitude = np.append(longitude, coarse.longitudes[column])
    room = 2.0 + 0.06 * min(float(np.ptp(latitude)), float(np.ptp(longitude)))
    return Window(
        west=max(float(longitude.min()) - room, centre - 180.0),
        east=min(float(longitude.max()) + room, centre + 180.0),
        south=max(float(latitude.min()) - room, -90.0),
        north=min(float(latitude.max()) + room, 90.0),
    )


def _paint_ground(ax: Axes, plan: Plan, result: ObservationResult, window: Window) -> None:
    region, seen = plan.region, result.coverage.seen
    colours = face_colours(region.mesh, [(region.target, ORANGE), (region.target[seen], SKY_BLUE)])
    east, north, _ = region.axes_A
    lamp = unit(region.area @ region.normal_A) + 0.5 * north - 0.4 * east
    paint(ax, survey(region.mesh, window, PAINTED_COLUMNS), region.mesh, colours, lamp, relief=0.0)


def _draw_union(ax: Axes, poses: list[CameraPose], camera: CameraModel, mesh: ShapeModel, ground: Ground) -> None:
    """Outline what the pictures of a passage hold together."""
    union = np.full(ground.face.shape, -1.0)
    for pose in poses:
        np.maximum(union, view_margin(camera, pose, ground, mesh), out=union)
    _outline(ax, ground, union, color=BLACK, linewidth=1.2, dashed=True)


def _outline(
    ax: Axes, ground: Ground, margin: Array, *, color: str, linewidth: float, dashed: bool = False
) -> list[Array]:
    """Draw where a margin is zero; returns the lines, each of shape (n, 2) [deg]."""
    if not margin.max() > 0.0 > margin.min():
        return []
    lines = ax.contour(
        ground.longitudes,
        ground.latitudes,
        margin,
        levels=[0.0],
        colors=color,
        linewidths=linewidth,
        linestyles="dashed" if dashed else "solid",
        zorder=4,
    )
    if linewidth >= SINGLE_PT:
        lines.set(path_effects=[patheffects.withStroke(linewidth=linewidth + 1.0, foreground="white")])
    return [line for line in lines.allsegs[0] if len(line)]


def _number(
    ax: Axes,
    plan: Plan,
    poses: dict[int, CameraPose],
    body: ShapeModel,
    window: Window,
    colours: dict[int, str],
    outlines: list[Array],
) -> None:
    """Number each footprint where its line of sight meets the ground, clear of outlines."""
    if not poses or plan.n_observers > MAX_NUMBERED:
        return
    start = np.array([pose.r_A for pose in poses.values()])
    ahead = np.array([pose.C_CA[2] for pose in poses.values()])
    hit = tracer_of(body).first_hit(start, ahead)
    met, depth = hit >= 0, depth_of(hit, start, ahead, body)
    if met.any():
        chosen = [j for j, meets in zip(poses, met, strict=True) if meets]
        number_places(
            ax,
            (start + depth[:, None] * ahead)[met],
            window.centre_longitude,
            [colours[j] for j in chosen],
            numbers=chosen,
            lines=[
                *outlines,
                np.stack(latitude_longitude(target_outline(plan.region), window.centre_longitude)[::-1], axis=1),
            ],
            marked=False,
        )


def _handles(plan: Plan, colours: dict[int, str]) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Patch(facecolor=SKY_BLUE, label="target, observed"),
        Patch(facecolor=ORANGE, label="target, not observed"),
        Line2D([], [], color=BLACK, linewidth=2.2, label="outline of the target"),
    ]
    if len(colours) <= len(SPACECRAFT):
        handles += [Line2D([], [], color=c, linewidth=SINGLE_PT, label=plan.names[j]) for j, c in colours.items()]
    else:
        handles.append(Line2D([], [], color=next(iter(colours.values())), label="each spacecraft"))
    if plan.scenario.observation.criterion == "passage":
        handles.append(Line2D([], [], color=BLACK, linewidth=1.2, linestyle="--", label="all pictures of the passage"))
    return handles
