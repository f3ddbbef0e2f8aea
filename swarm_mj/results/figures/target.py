"""The target on the body and its visiting points (AAS 19-144, Figure 6)."""

from __future__ import annotations

from textwrap import shorten

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.results.figures.box import box_around, draw_box
from swarm_mj.results.figures.cells import angles, draw_cells
from swarm_mj.results.figures.panels import legend_below
from swarm_mj.results.figures.style import HALO, SMALL_PT, TICK_PT, caption, label, new_figure, plain, tidy
from swarm_mj.results.figures.view import draw_body, draw_line, draw_points, face_colours, views_of, visible_share
from swarm_mj.results.look import BLACK, ORANGE, VERMILLION
from swarm_mj.typing import Array

#: More points than these are not numbered: the numbers would cover each other.
MAX_NUMBERED = 150


def compose_target(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """The body with target and visiting points, and the target as seen from the body's centre."""
    return draw_target(plan)


def draw_target(plan: Plan) -> Figure:
    """The same of a plan, before it is flown."""
    figure = new_figure(5.2, f"Target region and visiting points: {plan.scenario.name}", width_in=10.5)
    overview, close_up = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_overview(overview, plan)
    _draw_close_up(close_up, plan)
    handles = [
        Patch(facecolor=ORANGE, label="target faces $F_T$"),
        Line2D([], [], marker="o", markersize=3.5, color=BLACK, linestyle="none", label="visiting points"),
        Line2D(
            [], [], marker="o", markersize=7, color=VERMILLION, linestyle="none", label="visited, with their numbers"
        ),
    ]
    legend_below(figure, handles)
    return figure


def visiting_points(plan: Plan) -> Array:
    """All visiting points in A, shape (n_T, 3) [m]."""
    design = plan.scenario.design
    return plan.region.visiting_points_A(design.imaging_altitude_m, projection=design.projection)


def geographic(latitude_deg: float, longitude_deg: float) -> str:
    """A place in words, for instance `12.5° S, 90° E`."""
    hemisphere = "N" if latitude_deg >= 0 else "S"
    return f"{abs(latitude_deg):g}\N{DEGREE SIGN} {hemisphere}, {longitude_deg % 360.0:g}\N{DEGREE SIGN} E"


def _draw_overview(ax: Axes, plan: Plan) -> None:
    region, points = plan.region, visiting_points(plan)
    view = max(views_of(region), key=lambda view: visible_share(view, region))
    chosen = np.unique(np.array(plan.scenario.design.visiting_points) - 1)
    draw_box(ax, view, box_around(np.vstack((region.vertices, points))))
    draw_body(ax, view, region.mesh, face_colours(region.mesh, [(region.target, ORANGE)]))
    for k in chosen:
        ground = region.vertices[region.visiting_vertex[k]]
        draw_line(ax, view, region.mesh, np.array([ground, points[k]]), color=VERMILLION, linewidth=0.9)
    draw_points(ax, view, region.mesh, points, marker="o", markersize=2.2, color=BLACK)
    draw_points(
        ax, view, region.mesh, points[chosen], marker="o", markersize=6, color=VERMILLION, markeredgecolor="white"
    )
    design, target = plan.scenario.design, plan.scenario.target
    caption(
        ax,
        f"{plain(shorten(plan.scenario.body.name, 30))}; target at {geographic(target.latitude_deg, target.longitude_deg)}, "
        f"half-angle {target.half_angle_deg:g}\N{DEGREE SIGN}\n{region.n_faces} faces, "
        f"{region.total_area / 1e6:.4g} km\N{SUPERSCRIPT TWO}; imaging altitude {design.imaging_altitude_m / 1e3:g} km",
    )


def _draw_close_up(ax: Axes, plan: Plan) -> None:
    region, points = plan.region, visiting_points(plan)
    design = plan.scenario.design
    draw_cells(ax, region, np.tile(to_rgb(ORANGE), (region.n_cells, 1)))
    flat = angles(points, region.axes_A)
    visited = np.isin(np.arange(len(flat)), np.array(design.visiting_points) - 1)
    ax.plot(*flat[~visited].T, "o", color=BLACK, markersize=2.5)
    ax.plot(*flat[visited].T, "o", color=VERMILLION, markersize=7, markeredgecolor="white")
    if len(flat) <= MAX_NUMBERED:
        for k, place in enumerate(flat):
            _number(ax, k + 1, place, bold=bool(visited[k]))
    tidy(ax)
    ax.grid(False)
    label(ax, "angle east of the target's centre [deg]", "angle north of the target's centre [deg]")
    caption(ax, f"the {region.n_visiting} visiting points, seen from the body's centre")


def _number(ax: Axes, number: int, place: Array, *, bold: bool) -> None:
    ax.annotate(
        str(number),
        (float(place[0]), float(place[1])),
        xytext=(0.0, 5.0 if not bold else 8.0),
        textcoords="offset points",
        ha="center",
        va="center_baseline",
        fontsize=TICK_PT + 1 if bold else SMALL_PT - 0.5,
        fontweight="bold" if bold else "normal",
        color=VERMILLION if bold else BLACK,
        path_effects=HALO,
        zorder=6 if bold else 4,
    )
