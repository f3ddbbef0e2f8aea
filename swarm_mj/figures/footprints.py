"""Footprints of the pictures on a map, with the target outlined and what was observed of it."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.ndimage import gaussian_filter

from swarm_mj.figures.ground_track import MAX_NUMBERED, number_places
from swarm_mj.figures.maps import (
    Ground,
    MapExtent,
    draw_track,
    latitude_longitude,
    map_aspect,
    name_map,
    paint,
    survey,
    target_outlines,
    whole_body,
)
from swarm_mj.figures.palette import BLACK, ORANGE, SKY_BLUE, SPACECRAFT, Dashes, spacecraft_styles
from swarm_mj.figures.panels import legend_below
from swarm_mj.figures.style import caption, new_figure, note_of_omission, shown_spacecraft
from swarm_mj.figures.timescale import arrival_words
from swarm_mj.figures.units import time_axis
from swarm_mj.figures.view import HIDING_DEPTH, depth_of, face_colours, tracer_of, unit
from swarm_mj.flight.observe import ObservationResult, arrival_samples, camera_from, flight_pictures
from swarm_mj.flight.plan import Plan
from swarm_mj.observation.camera import CameraModel, CameraPose
from swarm_mj.observation.coverage import percent_text
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array, Indices

#: Places along a parallel: on the map, about as many as the picture has points, and when looking for what it must hold.
COLUMNS, SEARCH_COLUMNS = 600, 120
#: Where the ground hides itself a margin jumps from place to place; so far it is smoothed [places].
SMOOTH = 0.8
#: The pictures of a passage are thinned to so many; they overlap.
MAX_PICTURES = 90
UNION_DASHES: Dashes = (0.0, (3.0, 2.0))
#: Width of the map, and height of title, names and legend around it [in].
MAP_IN, FRAME_IN = 8.2, 2.0
#: Width of an outline that has its own colour.
SINGLE_PT = 2.0


def compose_footprints(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """What each picture holds at the arrival, and what all pictures of the passage hold together."""
    mesh, scenario = plan.region.mesh, plan.scenario
    camera = camera_from(scenario)
    shown = shown_spacecraft(plan.n_observers)
    arrivals_s = telemetry["time"].values[arrival_samples(scenario)]
    taken = list(flight_pictures(plan, telemetry))
    poses = {
        picture.spacecraft: picture.pose
        for picture in taken
        if picture.spacecraft in shown and picture.t == arrivals_s[picture.spacecraft]
    }
    window = _window(plan, camera, list(poses.values()))
    title = f"Footprints of the pictures: {scenario.name}{note_of_omission(plan.n_observers, shown)}"
    figure = new_figure(_height(window), title)
    ax = figure.subplots()
    ground = survey(mesh, window, COLUMNS)
    _paint_ground(ax, plan, result, ground)
    whole = False
    if scenario.observation.criterion == "passage":
        passage = [picture.pose for picture in taken[:: 1 + len(taken) // MAX_PICTURES]]
        whole = _draw_union(ax, passage, camera, mesh, ground)
    for border in target_outlines(plan.region):
        draw_track(ax, border, window.centre_longitude, color=BLACK, linewidth=2.2, zorder=3)
    lines = dict(zip(shown.tolist(), spacecraft_styles(len(shown)), strict=True))
    colours = {j: line["color"] for j, line in lines.items()}
    outlines: list[Array] = []
    for j, pose in poses.items():
        margin = view_margin(camera, pose, ground, mesh)
        width = SINGLE_PT if len(shown) <= len(SPACECRAFT) else 0.8
        outlines += _outline(ax, ground, margin, linewidth=width, **lines[j])
    name_map(ax, window)
    _number(ax, plan, poses, mesh, window, colours, outlines)
    axis = time_axis(scenario.duration_s)
    percent = result.coverage.percent
    caption(
        ax,
        f"outlines: {arrival_words(scenario, axis)}; "
        f"half-angle {camera.half_angle_deg:g}\N{DEGREE SIGN}; $P_{{TO}}$ = {percent_text(percent)}",
    )
    legend_below(figure, _handles(plan, result, {j: colours[j] for j in poses}, whole))
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
    flat = _margin_at(camera, pose, ground.points_A.reshape(-1, 3), ground.face.ravel(), body)
    return flat.reshape(ground.face.shape)


def _margin_at(camera: CameraModel, pose: CameraPose, points: Array, face: Indices, body: ShapeModel) -> Array:
    """`view_margin` at places (n, 3) [m] on faces of the body, shape (n,)."""
    away = points - pose.r_A
    x, y, z = pose.C_CA @ away.T
    across = np.hypot(x, y) if camera.shape == "cone" else np.maximum(np.abs(x), np.abs(y))
    with np.errstate(invalid="ignore", divide="ignore"):
        margin = np.where(z > 0.0, 1.0 - across / (z * camera.tan_half_angle), -1.0)
    margin = np.nan_to_num(np.clip(margin, -1.0, 1.0), nan=-1.0)
    held = np.flatnonzero(margin > 0.0)
    away, normal = away[held], body.face_normals[face[held]]
    distance = np.linalg.norm(away, axis=-1)
    margin[held] = np.minimum(margin[held], -np.einsum("...i,...i", away, normal) / distance)
    turned = margin[held] > 0.0
    held, away, distance = held[turned], away[turned], distance[turned]
    hit = tracer_of(body).first_hit(pose.r_A, away)
    depth = distance * depth_of(hit, pose.r_A, away, body)
    margin[held[(hit >= 0) & (depth < distance - HIDING_DEPTH * body.max_radius)]] *= -1.0
    return margin


def _window(plan: Plan, camera: CameraModel, poses: list[CameraPose]) -> MapExtent:
    """The target and the footprints of the arrival, with some room around."""
    mesh, centre = plan.region.mesh, plan.scenario.target.longitude_deg
    coarse = survey(mesh, whole_body(centre), SEARCH_COLUMNS)
    latitude, longitude = latitude_longitude(np.concatenate(target_outlines(plan.region)), centre)
    for pose in poses:
        row, column = np.nonzero(view_margin(camera, pose, coarse, mesh) > 0.0)
        latitude = np.append(latitude, coarse.latitudes[row])
        longitude = np.append(longitude, coarse.longitudes[column])
    room = 2.0 + 0.06 * min(float(np.ptp(latitude)), float(np.ptp(longitude)))
    return MapExtent(
        west=max(float(longitude.min()) - room, centre - 180.0),
        east=min(float(longitude.max()) + room, centre + 180.0),
        south=max(float(latitude.min()) - room, -90.0),
        north=min(float(latitude.max()) + room, 90.0),
    )


def _height(window: MapExtent) -> float:
    """Of a figure that a map fills, as far as a page goes [in]."""
    across = MAP_IN * (window.north - window.south) / (window.east - window.west)
    return float(np.clip(across / map_aspect(window) + FRAME_IN, 4.8, 7.4))


def _paint_ground(ax: Axes, plan: Plan, result: ObservationResult, ground: Ground) -> None:
    region, seen = plan.region, result.coverage.seen
    colours = face_colours(region.mesh, [(region.target, ORANGE), (region.target[seen], SKY_BLUE)])
    east, north, _ = region.axes_A
    lamp = unit(region.area @ region.normal_A) + 0.5 * north - 0.4 * east
    paint(ax, ground, region.mesh, colours, lamp, relief=0.0)


def _draw_union(ax: Axes, poses: list[CameraPose], camera: CameraModel, mesh: ShapeModel, ground: Ground) -> bool:
    """Outline what the pictures of a passage hold together, from every other place; gives whether there is an outline."""
    ground = ground.every(2)
    points, face = ground.points_A.reshape(-1, 3), ground.face.ravel()
    union, left = np.full(len(face), -1.0), np.flatnonzero(face >= 0)
    for pose in poses:
        union[left] = np.maximum(union[left], _margin_at(camera, pose, points[left], face[left], mesh))
        left = left[union[left] <= 0.0]  # what one picture holds need not be looked for in others
    margin = union.reshape(ground.face.shape)
    return bool(_outline(ax, ground, margin, color=BLACK, linewidth=1.2, linestyle=UNION_DASHES))


def _outline(
    ax: Axes, ground: Ground, margin: Array, *, color: str, linewidth: float, linestyle: Dashes
) -> list[Array]:
    """Draw where a margin is zero; returns the lines, each of shape (n, 2) [deg]."""
    if not margin.max() > 0.0 > margin.min():
        return []
    lines = ax.contour(
        ground.longitudes,
        ground.latitudes,
        gaussian_filter(margin, SMOOTH),
        levels=[0.0],
        colors=color,
        linewidths=linewidth,
        linestyles=[linestyle],
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
    window: MapExtent,
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
                *(
                    np.stack(latitude_longitude(border, window.centre_longitude)[::-1], axis=1)
                    for border in target_outlines(plan.region)
                ),
            ],
            marked=False,
        )


def _handles(plan: Plan, result: ObservationResult, colours: dict[int, str], union: bool) -> list[Line2D | Patch]:
    """Legend entries of what is on the map; `colours` are those of the spacecraft with an outline."""
    seen = result.coverage.seen
    handles: list[Line2D | Patch] = []
    if seen.any():
        handles.append(Patch(facecolor=SKY_BLUE, label="target, observed"))
    if not seen.all():
        handles.append(Patch(facecolor=ORANGE, label="target, not observed"))
    handles.append(Line2D([], [], color=BLACK, linewidth=2.2, label="outline of the target"))
    shown = len(shown_spacecraft(plan.n_observers))
    if shown <= len(SPACECRAFT):
        lines = spacecraft_styles(shown)
        handles += [Line2D([], [], linewidth=SINGLE_PT, label=plan.names[j], **lines[j]) for j in colours]
    elif colours:
        handles.append(Line2D([], [], color=next(iter(colours.values())), label="each spacecraft"))
    if union:
        words = "all pictures of the passage"
        handles.append(Line2D([], [], color=BLACK, linewidth=1.2, linestyle=UNION_DASHES, label=words))
    return handles
