"""Light on the target: incidence, emission and phase angles over time and, at the arrival, over its cells.

Incidence is the angle between a cell's normal and the direction to the Sun, emission that between the normal and the
direction to a spacecraft, phase that between the two directions. Cast shadows and obstacles are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from swarm_mj.figures.cells import finish_cells, flat_cells
from swarm_mj.figures.palette import BLACK, GREY, LIGHT_GREY, spacecraft_styles
from swarm_mj.figures.panels import legend_below, spacecraft_handles
from swarm_mj.figures.scene import scene_from
from swarm_mj.figures.style import SMALL_PT, TICK_PT, caption, label, new_figure
from swarm_mj.figures.timescale import TimeScale, time_scale
from swarm_mj.figures.units import instant, note_of_omission, shown_spacecraft, time_axis
from swarm_mj.figures.view import triangles
from swarm_mj.flight.observe import ObservationResult, arrival_sample
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.target import TargetRegion
from swarm_mj.typing import Array, Indices

#: Instants in a history; the angles change slowly.
MAX_INSTANTS = 240
#: Of the line of one spacecraft [pt].
WIDTH = 1.6
#: Cells in the mean of a history.
MAX_CELLS = 400
#: A palette whose lightness grows evenly, and which colour-blind readers see alike.
PALETTE = "cividis_r"


class Angles(NamedTuple):
    """Angles at cells [deg], each of shape (n,)."""

    incidence: Array
    emission: Array
    phase: Array


def compose_illumination(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Mean angles over the target by time, and the angles at its cells at the arrival."""
    shown = shown_spacecraft(plan.n_observers)
    title = f"Light on the target: {plan.scenario.name}{note_of_omission(plan.n_observers, shown)}"
    figure = new_figure(7.4, title, width_in=11.0)
    grid = figure.subplots(2, 3, height_ratios=(1.0, 1.15))
    scale = time_scale(plan, telemetry)
    _draw_histories(grid[0], plan, telemetry, shown, scale)
    _draw_maps(figure, grid[1], plan, telemetry)
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=BLACK, linewidth=1.8, label="mean over the target"),
        Patch(facecolor=LIGHT_GREY, label="all its cells"),
    ]
    handles += spacecraft_handles(plan, shown, WIDTH, together="mean, each spacecraft")
    legend_below(figure, [*handles, *scale.handles()])
    return figure


def cell_angles(centroid_A: Array, normal_A: Array, sun_A: Array, r_A: Array) -> Angles:
    """Incidence, emission and phase at cells, whose centroids (n, 3) [m] and outward unit normals (n, 3) are given in A.

    `sun_A` and `r_A` are the places of the Sun and of the spacecraft, shape (3,) [m].
    """
    to_sun, to_camera = (_unit(place - centroid_A) for place in (sun_A, r_A))
    return Angles(_between(normal_A, to_sun), _between(normal_A, to_camera), _between(to_sun, to_camera))


def best_angles(region: TargetRegion, sun_A: Array, r_A: Array) -> Angles:
    """Angles at every cell as the spacecraft that looks at it most steeply has them; `r_A` has shape (m, 3) [m]."""
    each = [cell_angles(region.centroid_A, region.normal_A, sun_A, r) for r in r_A]
    best = np.argmin([found.emission for found in each], axis=0)
    return Angles(*(np.array(values)[best, np.arange(region.n_cells)] for values in zip(*each, strict=True)))


def _between(a: Array, b: Array) -> Array:
    """Angle between unit vectors (..., 3) [deg]."""
    return np.degrees(np.arccos(np.clip(np.einsum("...i,...i", a, b), -1.0, 1.0)))


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _sun_A(plan: Plan, t: float) -> Array:
    return plan.environment.C_AN(t) @ plan.environment.sun.at(t)


def _draw_histories(
    row: NDArray[np.object_], plan: Plan, telemetry: xr.Dataset, shown: Indices, scale: TimeScale
) -> None:
    scene, region = scene_from(plan, telemetry), plan.region
    some = scale.samples(scene.times, MAX_INSTANTS)
    cells = slice(None, None, 1 + region.n_cells // MAX_CELLS)
    centroid, normal, weight = region.centroid_A[cells], region.normal_A[cells], region.area[cells]
    times = scene.times[some] / scale.axis.seconds
    suns = [_sun_A(plan, float(t)) for t in scene.times[some]]
    incidence = np.array([_between(normal, _unit(sun - centroid)) for sun in suns])
    row[0].fill_between(times, incidence.min(axis=1), incidence.max(axis=1), color=LIGHT_GREY, linewidth=0)
    row[0].plot(times, np.average(incidence, axis=1, weights=weight), color=BLACK, linewidth=1.8)
    for j, style in zip(shown, spacecraft_styles(len(shown)), strict=True):
        found = [cell_angles(centroid, normal, sun, scene.r_A[k, j]) for sun, k in zip(suns, some, strict=True)]
        for ax, values in zip(row[1:], ([a.emission for a in found], [a.phase for a in found]), strict=True):
            ax.plot(times, np.average(values, axis=1, weights=weight), linewidth=WIDTH, **style)
    for ax, name in zip(row, Angles._fields, strict=True):
        _finish_history(ax, name, scale)


def _finish_history(ax: Axes, name: str, scale: TimeScale) -> None:
    scale.draw(ax, zorder=2.0, brief=True)
    top = 30 * max(3, int(np.ceil(ax.dataLim.y1 / 30.0)))
    ax.set_ylim(0.0, top)
    ax.set_yticks(range(0, top + 1, 30))
    label(ax, y=f"{name} [deg]")
    unseen = {"incidence": "above 90\N{DEGREE SIGN}: night", "emission": "above 90\N{DEGREE SIGN}: out of sight"}
    caption(ax, f"{name} by time" + (f" ({unseen[name]})" if name in unseen else ""))


def _draw_maps(figure: Figure, row: NDArray[np.object_], plan: Plan, telemetry: xr.Dataset) -> None:
    region, arrival = plan.region, arrival_sample(plan.scenario)
    scene = scene_from(plan, telemetry.isel(time=[arrival]))
    time = float(scene.times[0])
    found = best_angles(region, _sun_A(plan, time), scene.r_A[0, : plan.n_observers])
    corners = flat_cells(region)
    when = instant(time, time_axis(plan.scenario.duration_s))
    words = ("incidence", "least emission of the swarm", "phase, same spacecraft")
    for ax, values, name in zip(row, found, words, strict=True):
        cells = triangles(corners, array=values, cmap=PALETTE, edgecolors="face", linewidths=0.2, rasterized=True)
        ax.add_collection(cells)
        ax.set_aspect("equal")
        ax.autoscale_view()
        finish_cells(ax, region, brief=True)
        mean = float(np.average(values, weights=region.area))
        caption(ax, f"{name}\nt = {when}, mean {mean:.1f}\N{DEGREE SIGN}")
        bar = figure.colorbar(cells, cax=ax.inset_axes((1.03, 0.0, 0.05, 1.0)))
        bar.ax.tick_params(labelsize=SMALL_PT, color=GREY, length=3)
        bar.set_label("[deg]", fontsize=TICK_PT)
        bar.outline.set_visible(False)
