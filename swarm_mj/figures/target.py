"""The target on the body and its visiting points (AAS 19-144, Figure 6)."""

from __future__ import annotations

from textwrap import shorten
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from swarm_mj.figures.box import box_around, draw_box, keep_inside
from swarm_mj.figures.cells import draw_cells, flat_points
from swarm_mj.figures.numbering import POINTS_PER_INCH
from swarm_mj.figures.palette import BLACK, ORANGE, VERMILLION
from swarm_mj.figures.panels import legend_below
from swarm_mj.figures.scene import WIDER
from swarm_mj.figures.style import HALO, INSIDE, SMALL_PT, TICK_PT, annotate, caption, new_figure, plain
from swarm_mj.figures.view import draw_body, draw_line, draw_points, face_colours, views_of, visible_share
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.scenarios.itinerary import itinerary, target_text
from swarm_mj.typing import Array, Indices, Mask

#: More visiting points than these would cover the target; those that are visited are shown then.
MAX_SHOWN = 500
#: Room that a digit takes [pt].
NUMBER_PT = 8.0


def compose_target(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """The body with target and visiting points, and the target as seen from the body's centre."""
    return draw_target(plan)


def draw_target(plan: Plan) -> Figure:
    """The same of a plan, before it is flown."""
    figure = new_figure(5.2, f"Target region and visiting points: {plan.scenario.name}", width_in=10.5)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.set(rect=(0.0, 0.0, 1.0, 0.965))  # type: ignore[call-arg]
    overview, close_up = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_overview(overview, plan)
    numbered, others = _draw_close_up(close_up, plan)
    handles: list[Line2D | Patch] = [Patch(facecolor=ORANGE, label="target faces $F_T$")]
    if others:
        handles.append(_spot("visiting points", BLACK, 3.5))
    handles.append(_spot(f"visited{numbered}", VERMILLION, 7.0))
    legend_below(figure, handles)
    if engine is not None:
        engine.execute(figure)  # axes of equal scales shrink at a new place; their labels find room in a second round
    return figure


def _spot(name: str, colour: str, size: float) -> Line2D:
    return Line2D([], [], marker="o", markersize=size, color=colour, linestyle="none", label=name)


def visiting_points(plan: Plan, target: int = 0) -> Array:
    """All visiting points of a target in A, at the altitude of the first observer there or the common one, (n_T, 3) [m]."""
    design, part = plan.scenario.design, plan.region.targets[target]
    altitudes = [stop.altitude_m for stop in itinerary(plan.scenario) if stop.target == target]
    points = part.visiting_points_A(next(iter(altitudes), design.imaging_altitude_m), projection=design.projection)
    for stop, own in zip(itinerary(plan.scenario), plan.points_A, strict=True):
        if stop.target == target:
            points[stop.point - 1] = own
    return points


def _draw_overview(ax: Axes, plan: Plan) -> None:
    region, targets = plan.region, range(len(plan.region.targets))
    points = np.concatenate([visiting_points(plan, k) for k in targets])
    vertices = np.concatenate([target.visiting_vertex for target in region.targets])
    view = max(views_of(region), key=lambda view: visible_share(view, region))
    chosen = np.flatnonzero(np.concatenate([_visited(plan, k) for k in targets]))
    some = points if len(points) <= MAX_SHOWN else points[chosen]
    shown = np.vstack((region.corners_A.reshape(-1, 3), some))
    whole = np.vstack((region.mesh.vertices, some))
    near = np.ptp(whole, axis=0).max() > WIDER * np.ptp(shown, axis=0).max()  # on a large body they would be a speck
    box = box_around(shown if near else whole)
    draw_box(ax, view, box)
    draw_body(ax, view, region.mesh, face_colours(region.mesh, [(region.target, ORANGE)]))
    for k in chosen:
        ground = region.vertices[vertices[k]]
        draw_line(ax, view, region.mesh, np.array([ground, points[k]]), color=VERMILLION, linewidth=0.9)
    if len(points) <= MAX_SHOWN:
        draw_points(ax, view, region.mesh, points, marker="o", markersize=2.2, color=BLACK)
    draw_points(
        ax, view, region.mesh, points[chosen], marker="o", markersize=6, color=VERMILLION, markeredgecolor="white"
    )
    keep_inside(ax, view, box)
    design, target = plan.scenario.design, plan.scenario.target
    caption(
        ax,
        f"{plain(shorten(plan.scenario.body.name, 30))}; target: {plain(shorten(target_text(target), 60))}\n"
        f"{region.n_faces} faces, "
        f"{region.total_area / 1e6:.4g} km\N{SUPERSCRIPT TWO}; imaging altitude {design.imaging_altitude_m / 1e3:g} km",
    )


def _visited(plan: Plan, target: int) -> Mask:
    """Which visiting points of a target somebody is sent to, shape (n_T,)."""
    own = [stop.point for stop in itinerary(plan.scenario) if stop.target == target]
    return np.isin(np.arange(plan.region.targets[target].n_visiting) + 1, own)


def _draw_close_up(ax: Axes, plan: Plan) -> tuple[str, bool]:
    """The target from above; gives words on the numbers of the visited points, and whether there are others."""
    region, targets = plan.region, range(len(plan.region.targets))
    draw_cells(ax, region, np.tile(to_rgb(ORANGE), (region.n_cells, 1)))
    flat = np.concatenate([flat_points(region, k, visiting_points(plan, k)) for k in targets])
    visited = np.concatenate([_visited(plan, k) for k in targets])
    numbers = np.concatenate([np.arange(region.targets[k].n_visiting) + 1 for k in targets])
    words = f"the {len(flat)} visiting points, seen from the body's centre"
    if len(flat) > MAX_SHOWN:
        words = f"the visited of {len(flat)} visiting points"
        flat, numbers, visited = flat[visited], numbers[visited], visited[visited]
    ax.plot(*flat[~visited].T, "o", color=BLACK, markersize=2.5)
    ax.plot(*flat[visited].T, "o", color=VERMILLION, markersize=7, markeredgecolor="white")
    caption(ax, words)
    numbered = _number_points(ax, flat, visited, numbers)
    words = ", with their numbers" if numbered[visited].all() else ", numbered where there is room"
    return words if numbered[visited].any() else "", not visited.all()


def _number_points(ax: Axes, flat: Array, visited: Mask, numbers: Indices) -> Mask:
    """Number points (n, 2) where there is room, visited ones first; gives which are numbered, shape (n,)."""
    ax.apply_aspect()
    figure = ax.get_figure(root=True)
    assert figure is not None
    spots = ax.transData.transform(flat) * POINTS_PER_INCH / figure.dpi
    numbered = np.zeros(len(flat), bool)
    for k in (*np.flatnonzero(visited), *np.flatnonzero(~visited)):
        apart = np.abs(spots[numbered] - spots[k]) > (NUMBER_PT * len(str(numbers[k])), NUMBER_PT)
        if apart.any(axis=1).all():
            numbered[k] = True
            _number(ax, int(numbers[k]), flat[k], bold=bool(visited[k]))
    return numbered


def _number(ax: Axes, number: int, place: Array, *, bold: bool) -> None:
    style: dict[str, Any] = {"fontsize": SMALL_PT - 0.5, "color": BLACK, "zorder": 4}
    if bold:
        style = {"fontsize": TICK_PT + 1, "fontweight": "bold", "color": VERMILLION, "zorder": 6}
    offset_pt = (0.0, 8.0 if bold else 5.0)
    annotate(ax, str(number), place, offset_pt, va="center_baseline", path_effects=HALO, **style, **INSIDE)
