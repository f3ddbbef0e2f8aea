"""Ground track: the places below each spacecraft on a map of the whole body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from swarm_mj.figures.maps import (
    MapExtent,
    draw_places,
    draw_track,
    latitude_longitude,
    name_map,
    paint,
    survey,
    target_outlines,
    whole_body,
)
from swarm_mj.figures.numbering import number_beside
from swarm_mj.figures.palette import BLACK, GREEN, GREY, ORANGE, SPACECRAFT, spacecraft_colours, spacecraft_styles
from swarm_mj.figures.panels import legend_below, spacecraft_handles
from swarm_mj.figures.scene import scene_from
from swarm_mj.figures.style import HALO, caption, new_figure
from swarm_mj.figures.timescale import time_scale
from swarm_mj.figures.units import instant, time_axis
from swarm_mj.figures.view import face_colours, unit
from swarm_mj.flight.observe import ObservationResult, arrival_sample
from swarm_mj.flight.plan import Plan
from swarm_mj.typing import Array, Indices

COLUMNS = 720
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
    window = whole_body(plan.scenario.target.longitude_deg)
    C_AN = plan.environment.C_AN(time)
    sun, earth = (unit(C_AN @ motion.at(time)) for motion in (plan.environment.sun, plan.environment.earth))
    ground = survey(mesh, window, COLUMNS)
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
    caption(
        ax,
        f"circles and light: the arrival, t = {instant(time, axis)}; without cast shadows",
    )
    legend_below(figure, _handles(plan, instant(step, axis)))
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


def _handles(plan: Plan, step: str) -> list[Line2D]:
    def mark(name: str, marker: str, size: float, colour: str = BLACK, edge: str | None = None) -> Line2D:
        return Line2D([], [], color=colour, marker=marker, markersize=size, mec=edge, linestyle="none", label=name)

    return [
        *spacecraft_handles(plan, np.arange(plan.n), 1.8, together=f"each of {plan.n} spacecraft"),
        mark(f"every {step}", ".", 6, GREY),
        mark("arrival", "o", 7, GREY, "white"),
        mark("end", "s", 6, GREY, "white"),
        Line2D([], [], color=BLACK, linewidth=1.8, label="target"),
        mark("subsolar point", "*", 13, ORANGE, BLACK),
        mark("sub-Earth point", "P", 8, GREEN, BLACK),
    ]
