"""Maps of the ground: the places below each spacecraft, and the footprints of the pictures with what was observed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.ndimage import gaussian_filter

from swarm_mj.figures.maps import (
    Ground,
    MapExtent,
    draw_places,
    draw_track,
    latitude_longitude,
    map_aspect,
    name_map,
    paint,
    survey,
    target_outlines,
    whole_body,
)
from swarm_mj.figures.numbering import number_beside
from swarm_mj.figures.palette import (
    BLACK,
    GREEN,
    GREY,
    ORANGE,
    SKY_BLUE,
    SPACECRAFT,
    Dashes,
    spacecraft_colours,
    spacecraft_styles,
)
from swarm_mj.figures.panels import legend_below, spacecraft_handles
from swarm_mj.figures.scene import scene_from
from swarm_mj.figures.style import HALO, caption, new_figure
from swarm_mj.figures.timescale import arrival_words, time_scale
from swarm_mj.figures.units import instant, note_of_omission, shown_spacecraft, time_axis
from swarm_mj.figures.view import HIDING_DEPTH, depth_of, face_colours, unit
from swarm_mj.flight.observe import ObservationResult, arrival_sample, arrival_samples, camera_from, flight_pictures
from swarm_mj.flight.plan import Plan
from swarm_mj.observation.camera import CameraModel, CameraPose
from swarm_mj.observation.coverage import percent_text
from swarm_mj.observation.raycast import tracer_of
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array, Indices, Mask

TRACK_COLUMNS = 720
#: Corners of a track; a flyby bends little.
TRACK_POINTS = 1000
#: A track is marked at about so many instants.
TIME_MARKS = 10
#: More spacecraft than these are not numbered: the numbers would cover each other.
MAX_NUMBERED = 12


def compose_ground_track(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """The places below each spacecraft, with the target and the ground in the light of the arrival."""
    scene, mesh = scene_from(plan, telemetry), plan.region.mesh
    arrival = arrival_sample(plan.scenario)
    time, axis = scene.times[arrival], time_axis(plan.scenario.duration_s)
    figure = new_figure(5.7, f"Ground track: {plan.scenario.name}")
    ax = figure.subplots()
    window = whole_body(plan.region.centre_longitude_deg)
    C_AN = plan.environment.C_AN(time)
    sun, earth = (unit(C_AN @ motion.at(time)) for motion in (plan.environment.sun, plan.environment.earth))
    ground = survey(mesh, window, TRACK_COLUMNS)
    paint(ax, ground, mesh, face_colours(mesh, []), sun)
    for outline in target_outlines(plan.region):
        draw_track(ax, outline, window.centre_longitude, color=BLACK, linewidth=1.8)
    step = mark_interval(plan.scenario.duration_s)
    marks = np.searchsorted(scene.times, np.arange(0.0, scene.times[-1], step) - 1e-6)
    track = time_scale(plan, telemetry).samples(scene.times, TRACK_POINTS)
    _draw_tracks(ax, scene.r_A, track, marks, arrival, window)
    draw_places(ax, sun[None], window.centre_longitude, marker="*", markersize=15, color=ORANGE, mec=BLACK, zorder=6)
    draw_places(ax, earth[None], window.centre_longitude, marker="P", markersize=9, color=GREEN, mec=BLACK, zorder=6)
    name_map(ax, window)
    caption(ax, f"circles and light: the arrival, t = {instant(time, axis)}; without cast shadows")
    legend_below(figure, _track_handles(plan, instant(step, axis)))
    return figure


def mark_interval(duration_s: float) -> float:
    """A round number of seconds or minutes between marks on a track [s]."""
    steps = [m * unit_s for unit_s in (1.0, 60.0, 3600.0, 86_400.0) for m in (1, 2, 5, 10, 20, 30)]
    return float(next((step for step in steps if step * TIME_MARKS >= duration_s), steps[-1]))


def _draw_tracks(ax: Axes, r_A: Array, track: Indices, marks: Indices, arrival: int, window: MapExtent) -> None:
    n = r_A.shape[1]
    many, centre = n > len(SPACECRAFT), window.centre_longitude
    for j, line in enumerate(spacecraft_styles(n)):
        style = {"color": line["color"], "zorder": 4}
        width, effects = (0.8, ()) if many else (1.8, HALO)
        draw_track(ax, r_A[track, j], centre, linewidth=width, path_effects=effects, zorder=4, **line)
        draw_places(ax, r_A[marks, j], centre, marker=".", markersize=3 if many else 6, **style)
        draw_places(ax, r_A[arrival, j : j + 1], centre, marker="o", markersize=4 if many else 7, mec="white", **style)
        draw_places(ax, r_A[-1:, j], centre, marker="s", markersize=3 if many else 6, mec="white", **style)
    if n <= MAX_NUMBERED:
        tracks = [np.stack(latitude_longitude(r_A[track, j], centre)[::-1], axis=1) for j in range(n)]
        number_places(ax, r_A[arrival], centre, spacecraft_colours(n), lines=tracks)


def number_places(
    ax: Axes,
    points_A: Array,
    centre_longitude: float,
    colours: list[str],
    *,
    numbers: Sequence[int] | None = None,
    lines: Sequence[Array] = (),
    marked: bool = True,
) -> None:
    """Put the number of each spacecraft beside its place (n, 3) on a map, as `number_beside` does."""
    latitude, longitude = latitude_longitude(points_A, centre_longitude)
    number_beside(ax, np.column_stack((longitude, latitude)), colours, numbers=numbers, lines=lines, marked=marked)


def _track_handles(plan: Plan, step: str) -> list[Line2D]:
    def mark(name: str, marker: str, size: float, colour: str = BLACK, edge: str | None = None) -> Line2D:
        return Line2D([], [], color=colour, marker=marker, markersize=size, mec=edge, linestyle="none", label=name)

    return [
        *spacecraft_handles(plan, np.arange(plan.n), 1.8, together=f"each of {plan.n} spacecraft"),
        mark(f"every {step}", ".", 6, GREY),
        mark("arrival", "o", 7, GREY, "white"),
        mark("end", "s", 6, GREY, "white"),
        *([Line2D([], [], color=BLACK, linewidth=1.8, label="target")] if target_outlines(plan.region) else []),
        mark("subsolar point", "*", 13, ORANGE, BLACK),
        mark("sub-Earth point", "P", 8, GREEN, BLACK),
    ]


#: Places along a parallel: on the map, about as many as the picture has points, and when looking for what it must hold.
COLUMNS, SEARCH_COLUMNS = 600, 120
#: Where the ground hides itself a margin jumps from place to place; so far it is smoothed [places].
SMOOTH = 0.8
#: Of what pictures hold together, every so many pictures come first: most places are then found soon. Side of the squares of
#: places that pictures are sought for [places], and how much wider than a picture they are sought.
STRIDE, SQUARE, WIDER = 61, 16, 1.2
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
        passage = [picture.pose for first in range(STRIDE) for picture in taken[first::STRIDE]]
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
    words = f"half-angle {camera.half_angle_deg:g}\N{DEGREE SIGN}; $P_{{TO}}$ = {percent_text(result.coverage.percent)}"
    caption(ax, f"outlines: {arrival_words(scenario, time_axis(scenario.duration_s))}; {words}")
    legend_below(figure, _handles(plan, result, {j: colours[j] for j in poses}, whole))
    return figure


def view_margin(camera: CameraModel, pose: CameraPose, ground: Ground, body: ShapeModel) -> Array:
    """How far inside a picture each place of a map lies: above zero where the picture holds it, shape (r, c).

    The lesser of two measures that cross zero where a footprint ends: the distance to the picture's edge over half its width,
    and the cosine of the emission angle. Below zero too where other ground of the body is in between.
    """
    flat = _margin_at(camera, pose, ground.points_A.reshape(-1, 3), ground.face.ravel(), body)
    return flat.reshape(ground.face.shape)


def _margin_at(camera: CameraModel, pose: CameraPose, points: Array, face: Indices, body: ShapeModel) -> Array:
    """`view_margin` at places (n, 3) [m] on faces of the body, shape (n,)."""
    away = points - pose.r_A
    x, y, z = pose.C_CA @ away.T
    across = (
        np.hypot(x, y)
        if camera.shape == "cone"
        else np.maximum(np.abs(x) / camera.sides[0], np.abs(y) / camera.sides[1])
    )
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
    mesh, centre = plan.region.mesh, plan.region.centre_longitude_deg
    coarse = survey(mesh, whole_body(centre), SEARCH_COLUMNS)
    if plan.region.is_wide:
        return whole_body(centre)
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
    lamp = region.facing_A + 0.5 * north - 0.4 * east
    if region.is_wide:
        paint(ax, ground, region.mesh, colours, None)
    else:
        paint(ax, ground, region.mesh, colours, lamp, relief=0.0)


def _draw_union(ax: Axes, poses: list[CameraPose], camera: CameraModel, mesh: ShapeModel, ground: Ground) -> bool:
    """Outline what the pictures of a passage hold together, from every other place; gives whether there is an outline."""
    ground = ground.every(2)
    margin = union_margin(camera, poses, ground, mesh)
    return bool(_outline(ax, ground, margin, color=BLACK, linewidth=1.2, linestyle=UNION_DASHES))


def union_margin(camera: CameraModel, poses: list[CameraPose], ground: Ground, body: ShapeModel) -> Array:
    """Above zero where one of the pictures holds a place of a map, as `view_margin` says, shape (r, c); -1 far from all."""
    points, face = ground.points_A.reshape(-1, 3), ground.face.ravel()
    rows, columns = np.indices(ground.face.shape) // SQUARE
    square = (rows * (columns.max() + 1) + columns).ravel()
    union, left = np.full(len(face), -1.0), np.flatnonzero(face >= 0)
    parts = [points[left[square[left] == k]] for k in range(square.max() + 1)]
    centres = np.array([part.mean(axis=0) if len(part) else np.full(3, np.nan) for part in parts])
    radii = [np.linalg.norm(part - c, axis=1).max(initial=0.0) for part, c in zip(parts, centres, strict=True)]
    for pose in poses:
        some = left[_reaches(camera, pose, centres, np.array(radii))[square[left]]]
        union[some] = np.maximum(union[some], _margin_at(camera, pose, points[some], face[some], body))
        left = left[union[left] <= 0.0]  # what one picture holds need not be looked for in others
    return union.reshape(ground.face.shape)


def _reaches(camera: CameraModel, pose: CameraPose, centres: Array, radii: Array) -> Mask:
    """Whether a cone somewhat wider than a picture comes to balls, centres (n, 3), shape (n,)."""
    cone = np.arctan(WIDER * camera.tan_half_angle * (1.0 if camera.shape == "cone" else np.sqrt(2.0)))
    x, y, z = pose.to_camera(centres).T
    return np.asarray(np.hypot(x, y) * np.cos(cone) - z * np.sin(cone) <= radii)


def _outline(
    ax: Axes, ground: Ground, margin: Array, *, color: str, linewidth: float, linestyle: Dashes
) -> list[Array]:
    """Draw where a margin is zero; returns the lines, each of shape (n, 2) [deg]."""
    if not margin.max() > 0.0 > margin.min():
        return []
    style: dict[str, Any] = {"colors": color, "linewidths": linewidth, "linestyles": [linestyle], "zorder": 4}
    smooth = gaussian_filter(margin, SMOOTH)
    lines = ax.contour(ground.longitudes, ground.latitudes, smooth, levels=[0.0], **style)
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
        centre, chosen = window.centre_longitude, [j for j, meets in zip(poses, met, strict=True) if meets]
        borders = [
            np.stack(latitude_longitude(border, centre)[::-1], axis=1) for border in target_outlines(plan.region)
        ]
        places, own = (start + depth[:, None] * ahead)[met], [colours[j] for j in chosen]
        number_places(ax, places, centre, own, numbers=chosen, lines=[*outlines, *borders], marked=False)


def _handles(plan: Plan, result: ObservationResult, colours: dict[int, str], union: bool) -> list[Line2D | Patch]:
    """Legend entries of what is on the map; `colours` are those of the spacecraft with an outline."""
    seen = result.coverage.seen
    handles: list[Line2D | Patch] = []
    if seen.any():
        handles.append(Patch(facecolor=SKY_BLUE, label="target, observed"))
    if not seen.all():
        handles.append(Patch(facecolor=ORANGE, label="target, not observed"))
    if target_outlines(plan.region):
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
