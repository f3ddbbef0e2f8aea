"""Trajectory finding: from the mothership to each visiting point in the time of flight (AAS 19-144, Figure 4)."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from swarm_mj.figures.behaviors import Frame
from swarm_mj.figures.box import box_around, draw_box, keep_inside
from swarm_mj.figures.framing import enlarge_small_body, frame_at_rest, frame_words, framed, near_arrival
from swarm_mj.figures.numbering import name_beside, number_beside
from swarm_mj.figures.operation import MAX_NUMBERED, TRAIL_POINTS
from swarm_mj.figures.palette import BLACK, BLUE, GREY, ORANGE, VERMILLION
from swarm_mj.figures.panels import draw_bars, legend_below, marker_handle
from swarm_mj.figures.scene import Scene, best_view, scene_from
from swarm_mj.figures.style import (
    caption,
    label,
    new_figure,
    note_of_omission,
    role,
    shown_spacecraft,
)
from swarm_mj.figures.units import instant, time_axis
from swarm_mj.figures.view import KM, draw_body, draw_line, draw_points, face_colours
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.records.summary import arrival_miss_m
from swarm_mj.scenarios.itinerary import last_arrival_s
from swarm_mj.typing import Indices

#: Misses below this are not told apart [mm].
LEAST_MISS_MM = 1e-3


def compose_trajectories(plan: Plan, telemetry: xr.Dataset, result: ObservationResult, frame: Frame = None) -> Figure:
    """The way of each spacecraft to its visiting point, and the velocity change that starts it.

    Args:
        plan: What was flown.
        telemetry: How.
        result: What was observed.
        frame: Of the paths, "A" or "N"; None: A, but N where the body turns far.
    """
    near = near_arrival(plan, telemetry)
    at_rest = frame_at_rest(plan, near, frame)
    scene = scene_from(plan, near, at_rest=at_rest)
    shown = shown_spacecraft(plan.n)
    figure = new_figure(5.4, f"Trajectories: {plan.scenario.name}{note_of_omission(plan.n, shown)}", width_in=11.0)
    space, bars = figure.subplots(1, 2, width_ratios=(1.35, 1.0))
    started = _draw_flight(space, plan, scene)
    time = instant(last_arrival_s(plan.scenario), time_axis(plan.scenario.duration_s))
    away = plan.mothership_distance / KM
    start = "" if started else f"; $r_0$, {away:,.0f} km away, is not shown"
    missed, residual = (_length(miss.max()) for miss in (arrival_miss_m(plan, telemetry), plan.deployment.miss_m))
    words = f"{frame_words(at_rest)}; time of flight $t_f$ = {time}{start}"
    caption(space, f"{words}\npoints missed in flight by {missed} at most")
    _draw_velocities(bars, plan, shown)
    caption(bars, f"from the mothership; solver's residual {residual}")
    handles: list[Line2D | Patch] = []
    if started:
        handles.append(marker_handle("mothership at deployment, $r_0$", BLACK, "s"))
    handles.append(marker_handle("observers at visiting points, $r_f$", VERMILLION, "o"))
    if plan.n > plan.n_observers:
        handles.append(marker_handle("communications spacecraft, mean of the points", BLUE, "D"))
    handles += [
        Line2D([], [], color=GREY, linewidth=1.6, label="until the arrival, $t_f$"),
        Line2D([], [], color=GREY, linewidth=1.1, linestyle=":", label="afterwards"),
        Patch(facecolor=ORANGE, label="target"),
    ]
    legend_below(figure, handles)
    return figure


def _colour(plan: Plan, j: int) -> str:
    return VERMILLION if j < plan.n_observers else BLUE


def _draw_flight(ax: Axes, plan: Plan, scene: Scene) -> bool:
    """The flight around the arrival; gives whether the mothership's place at deployment is in it."""
    mesh, region = plan.region.mesh, plan.region
    arrival = int(np.argmin(np.abs(scene.times - last_arrival_s(plan.scenario))))
    view = best_view(region, scene, (arrival, len(scene.times) - 1))
    inside, held = framed(plan, scene, arrival, onwards=True)
    first, last = max(held[0] - 1, 0), min(held[-1] + 1, len(scene.times) - 1)
    before = np.unique(np.linspace(first, arrival, TRAIL_POINTS).astype(int))
    after = np.unique(np.linspace(arrival, last, TRAIL_POINTS).astype(int))
    box, colours = box_around(inside), face_colours(mesh, [(region.target, ORANGE)])
    draw_box(ax, view, box)
    draw_body(ax, view, mesh, colours)
    width = 1.4 if plan.n <= MAX_NUMBERED else 0.5
    size = 6.5 if plan.n <= MAX_NUMBERED else 3.0
    for j in range(plan.n):
        colour, marker = _colour(plan, j), "o" if j < plan.n_observers else "D"
        draw_line(ax, view, mesh, scene.r_A[before, j], color=colour, linewidth=width)
        draw_line(ax, view, mesh, scene.r_A[after, j], color=colour, linewidth=0.8 * width, linestyle=":")
        place = scene.r_A[arrival, j : j + 1]
        draw_points(ax, view, mesh, place, marker=marker, markersize=size, color=colour, mec="white")
    started = bool(scene.times[held[0]] == 0.0)
    if started:
        draw_points(ax, view, mesh, scene.r_A[0, :1], marker="s", markersize=7, color=BLACK)
        name_beside(ax, view.project(scene.r_A[0, 0]), "$r_0$", (13.0, -5.0), BLACK)
    if plan.n <= MAX_NUMBERED:
        ways = [view.project(scene.r_A[samples, j]) for samples in (before, after) for j in range(plan.n)]
        number_beside(ax, view.project(scene.r_A[arrival]), [_colour(plan, j) for j in range(plan.n)], lines=ways)
    keep_inside(ax, view, box)
    enlarge_small_body(
        ax, view, mesh, colours, view.project(scene.r_A[np.union1d(before, after)].reshape(-1, 3)), low=False
    )
    return started


def _told(delta_v: float) -> str:
    """A velocity change [m/s] in as many digits as tell it from others."""
    return f"{delta_v:.2g}" if 5e-4 <= delta_v < 0.095 else f"{delta_v:.2f}"


def _draw_velocities(ax: Axes, plan: Plan, shown: Indices) -> None:
    """Deployment delta-v as bars."""
    delta_v = plan.deployment.delta_v[shown]
    top = float(delta_v.max()) if delta_v.max() > 1e-3 else 1.0
    names = [f"{plan.names[j]}: {role(plan, int(j))}" for j in shown]
    draw_bars(ax, delta_v, names, list(map(_told, delta_v)), [_colour(plan, int(j)) for j in shown], gap=0.02 * top)
    ax.set_xlim(0.0, 1.2 * top)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    label(ax, "deployment delta-v [m/s]")


def _length(length_m: float) -> str:
    if length_m >= 1.0:
        return f"{length_m:.3g} m"
    return f"{1e3 * length_m:.2g} mm" if 1e3 * length_m >= LEAST_MISS_MM else f"below {LEAST_MISS_MM:g} mm"
