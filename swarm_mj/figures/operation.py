"""Pictures in space: the way to the visiting points, and the operation at the arrival and the end (AAS 19-144, Figures 4, 11).

The operation is drawn in the body-fixed frame A, so that the target stays where it is and only the swarm moves.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from swarm_mj.figures.behaviors import Frame
from swarm_mj.figures.box import box_around, draw_box, keep_inside
from swarm_mj.figures.cells import draw_cells
from swarm_mj.figures.numbering import name_beside, number_beside, on_page
from swarm_mj.figures.palette import BLACK, BLUE, GREY, MODE_STYLES, ORANGE, SKY_BLUE, VERMILLION
from swarm_mj.figures.panels import draw_bars, legend_below, marker_handle
from swarm_mj.figures.scene import (
    FREE_AXIS,
    Scene,
    axis_tips,
    best_view,
    draw_bodies,
    enlarge_small_body,
    frame_at_rest,
    frame_words,
    framed,
    near_arrival,
    scene_from,
)
from swarm_mj.figures.style import HALO, SMALL_PT, TICK_PT, annotate, caption, label, new_figure, role
from swarm_mj.figures.timescale import time_scale
from swarm_mj.figures.units import instant, note_of_omission, shown_spacecraft, time_axis
from swarm_mj.figures.view import (
    HIDDEN_ALPHA,
    KM,
    View,
    draw_line,
    draw_points,
    face_colours,
    straight,
    unit,
)
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.observation.coverage import percent_text
from swarm_mj.records.modes import LOST
from swarm_mj.records.summary import arrival_miss_m
from swarm_mj.scenarios.itinerary import last_arrival_s
from swarm_mj.typing import Array, Indices, Mask

#: Corners of a trail; a flyby bends little.
TRAIL_POINTS = 120
#: More spacecraft than these are not numbered: the numbers would cover each other.
MAX_NUMBERED = 12
DASHES = (0, (4, 2.5))
#: Distances and angles from an axis' end at which its name is tried [pt, rad], and half its size with a marker's [pt].
REACHES_PT, TURNS, WORDS_PT = (
    (5.0, 15.0, 25.0, 40.0, 60.0, 80.0),
    np.radians((0.0, 45.0, -45.0, 90.0, -90.0)),
    (23.0, 10.0),
)


def compose_operation(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """The swarm around the body at the time of flight and at the end, or when it leaves the body far behind."""
    scale = time_scale(plan, telemetry)
    telemetry = near_arrival(plan, telemetry)
    scene = scene_from(plan, telemetry)
    figure = new_figure(8.2, f"Operation of the swarm: {plan.scenario.name}", width_in=11.0)
    arrival = int(np.argmin(np.abs(scene.times - last_arrival_s(plan.scenario))))
    instants = (arrival, len(scene.times) - 1)
    view = best_view(plan.region, scene, instants)
    grid = figure.subplots(2, 2, height_ratios=(3.0, 1.0))
    seen_by_then = [np.nan_to_num(result.coverage.first_seen_s, nan=np.inf) <= scene.times[k] for k in instants]
    started = []
    for column, (k, seen) in enumerate(zip(instants, seen_by_then, strict=True)):
        percent = percent_text(100.0 * plan.region.weighted_area[seen].sum() / plan.region.total_weighted_area)
        words = f"t = {scale.instant(scene.times[k])}, $P_{{TO}}$ = {percent}"
        caption(grid[0, column], words, size=TICK_PT + 1)
        started.append(_draw_instant(grid[0, column], plan, telemetry, seen, scene, view, k))
        _draw_target(grid[1, column], plan, seen)
    legend_below(figure, _handles(scene, instants, seen_by_then, any(started), any(_hides(ax) for ax in grid[0])))
    return figure


def _draw_instant(ax: Axes, plan: Plan, telemetry: xr.Dataset, seen: Mask, scene: Scene, view: View, k: int) -> bool:
    """One picture; gives whether the mothership's place at deployment is in it."""
    body, region = plan.region.mesh, plan.region
    inside, held = framed(plan, scene, k)
    extent = float(np.ptp(inside, axis=0).max())
    tips = axis_tips(telemetry, scene, body, k, FREE_AXIS * extent)
    box = box_around(np.vstack((inside, tips)))
    trail = np.unique(np.linspace(max(held[0] - 1, 0), k, TRAIL_POINTS).astype(int))
    colours = face_colours(body, [(region.target, ORANGE), (region.target[seen], SKY_BLUE)])
    ax.set_anchor("N")
    draw_box(ax, view, box)
    draw_bodies(ax, view, body, colours, scene, k)
    faint = 0.55 if plan.n <= MAX_NUMBERED else 0.3
    for j in range(plan.n):
        colour, marker = _colour_and_marker(scene, j, k)
        draw_line(ax, view, body, scene.r_A[trail, j], color=colour, linewidth=0.9, alpha=faint)
        if scene.mode[k, j] < LOST:
            sight = straight(scene.r_A[k, j], tips[j])
            draw_line(ax, view, body, sight, color=colour, linewidth=1.0, linestyle=DASHES)
    started = bool(scene.times[held[0]] == 0.0) and not plan.scenario.initial_states
    if started:
        draw_points(ax, view, body, scene.r_A[0, :1], marker="s", markersize=6, color=BLACK)
    for j in range(plan.n):
        colour, marker = _colour_and_marker(scene, j, k)
        draw_points(ax, view, body, scene.r_A[k, j : j + 1], marker=marker, markersize=6.5, color=colour, mec="white")
    _name(ax, plan, scene, view, k, trail, tips)
    keep_inside(ax, view, box)
    swarm = view.project(np.vstack((scene.r_A[trail].reshape(-1, 3), tips)))
    enlarge_small_body(ax, view, body, colours, swarm, low=False)
    return started


def _name(ax: Axes, plan: Plan, scene: Scene, view: View, k: int, trail: Indices, tips: Array) -> None:
    """Number the spacecraft, and say which axes lead to Earth."""
    for relay in np.flatnonzero(scene.mode[k] == TargetKind.EARTH):
        name_earth(ax, view.project(scene.r_A[k, relay]), view.project(tips[relay]), view.project(scene.r_A[k]))
    if plan.n <= MAX_NUMBERED:
        flown = [view.project(scene.r_A[trail, j]) for j in range(plan.n)]
        sights = [view.project(np.stack(ends)) for ends in zip(scene.r_A[k], tips, strict=True)]
        colours = [_colour_and_marker(scene, j, k)[0] for j in range(plan.n)]
        number_beside(ax, view.project(scene.r_A[k]), colours, lines=[*flown, *sights])


def _hides(ax: Axes) -> bool:
    """Whether lines are drawn pale because they are behind the body."""
    return any((line.get_alpha() or 1.0) < HIDDEN_ALPHA for line in ax.lines if line.get_linestyle() == "-")


def _draw_target(ax: Axes, plan: Plan, seen: Mask) -> None:
    """The target alone, so that what was observed of it can be made out."""
    region = plan.region
    draw_cells(ax, region, np.where(seen[:, None], to_rgb(SKY_BLUE), to_rgb(ORANGE)), brief=True)
    ax.set_title("target, seen from the body's centre", fontsize=TICK_PT, y=1.0)


def _colour_and_marker(scene: Scene, j: int, k: int) -> tuple[str, str]:
    """Colour and marker of spacecraft j at sample k."""
    if scene.mode[k, j] == LOST:
        return MODE_STYLES[LOST].line_colour, "X"
    return (BLUE, "D") if scene.relays[k, j] else (VERMILLION, "o")


def name_earth(ax: Axes, start: Array, tip: Array, swarm: Array) -> None:
    """Say where an axis without a visible end leads, as near to its end as the words cover none of the swarm (n, 2)."""
    ahead, place, others = unit(tip - start), on_page(ax, tip), on_page(ax, swarm)
    across = np.array([-ahead[1], ahead[0]])
    trials = [reach * (np.cos(turn) * ahead + np.sin(turn) * across) for reach in REACHES_PT for turn in TURNS]
    centres = [place + trial + (np.copysign(WORDS_PT[0], trial[0]), 0.0) for trial in trials]
    offset = trials[np.argmin([(np.abs(others - centre) < WORDS_PT).all(axis=1).sum() for centre in centres])]
    side = "left" if offset[0] >= 0.0 else "right"
    annotate(ax, "to Earth", tip, offset, ha=side, fontsize=SMALL_PT, color=BLUE, path_effects=HALO, zorder=7)


def _handles(
    scene: Scene, instants: tuple[int, int], seen_by_then: list[Mask], started: bool, hides: bool
) -> list[Line2D | Patch]:
    """Legend entries of what is in the pictures, given which cells were observed at each instant."""
    relays, lost = scene.relays[[*instants]], scene.mode[[*instants]] == LOST
    handles: list[Line2D | Patch] = []
    if any(seen.any() for seen in seen_by_then):
        handles.append(Patch(facecolor=SKY_BLUE, label="target, observed so far"))
    if not all(seen.all() for seen in seen_by_then):
        handles.append(Patch(facecolor=ORANGE, label="target, not yet observed"))
    if (~relays & ~lost).any():
        handles.append(marker_handle("observing spacecraft", VERMILLION, "o"))
    if (relays & ~lost).any():
        handles.append(marker_handle("communications spacecraft", BLUE, "D"))
    if lost.any():
        handles.append(marker_handle("lost spacecraft", MODE_STYLES[LOST].line_colour, "X"))
    path = "path flown" + ("; pale: behind the body" if hides else "")
    handles += [
        Line2D([], [], color=GREY, linewidth=1.0, linestyle=DASHES, label="spacecraft +z axis"),
        Line2D([], [], color=GREY, linewidth=0.9, alpha=0.7, label=path),
    ]
    return [*handles, marker_handle("mothership at deployment", BLACK, "s")] if started else handles


#: Misses below this are not told apart [mm].
LEAST_MISS_MM = 1e-3


def compose_trajectories(plan: Plan, telemetry: xr.Dataset, result: ObservationResult, frame: Frame = None) -> Figure:
    """The way of each spacecraft to its visiting point, and the delta-v that starts it; frames as of `compose_behaviors`.

    Of spacecraft that were on their way at the epoch the way alone.
    """
    near = near_arrival(plan, telemetry)
    at_rest = frame_at_rest(plan, near, frame)
    scene = scene_from(plan, near, at_rest=at_rest)
    shown = shown_spacecraft(plan.n)
    figure = new_figure(5.4, f"Trajectories: {plan.scenario.name}{note_of_omission(plan.n, shown)}", width_in=11.0)
    coming = bool(plan.scenario.initial_states)
    widths = (1.35,) if coming else (1.35, 1.0)
    space, *others = figure.subplots(1, len(widths), width_ratios=widths, squeeze=False)[0]
    started = _draw_flight(space, plan, scene)
    time = instant(last_arrival_s(plan.scenario), time_axis(plan.scenario.duration_s))
    away = plan.mothership_distance / KM
    start = "" if started or coming else f"; $r_0$, {away:,.0f} km away, is not shown"
    missed, residual = (_length(miss.max()) for miss in (arrival_miss_m(plan, telemetry), plan.deployment.miss_m))
    words = f"{frame_words(at_rest)}; {'arrival' if coming else 'time of flight'} $t_f$ = {time}{start}"
    caption(space, words if coming else f"{words}\npoints missed in flight by {missed} at most")
    for bars in others:
        _draw_velocities(bars, plan, shown)
        caption(bars, f"from the mothership; solver's residual {residual}")
    handles: list[Line2D | Patch] = []
    if started:
        handles.append(marker_handle("mothership at deployment, $r_0$", BLACK, "s"))
    where = "at the arrival" if coming else "at visiting points, $r_f$"
    handles.append(marker_handle(f"observers {where}", VERMILLION, "o"))
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
    draw_bodies(ax, view, mesh, colours, scene, arrival)
    width = 1.4 if plan.n <= MAX_NUMBERED else 0.5
    size = 6.5 if plan.n <= MAX_NUMBERED else 3.0
    for j in range(plan.n):
        colour, marker = _colour(plan, j), "o" if j < plan.n_observers else "D"
        draw_line(ax, view, mesh, scene.r_A[before, j], color=colour, linewidth=width)
        draw_line(ax, view, mesh, scene.r_A[after, j], color=colour, linewidth=0.8 * width, linestyle=":")
        place = scene.r_A[arrival, j : j + 1]
        draw_points(ax, view, mesh, place, marker=marker, markersize=size, color=colour, mec="white")
    started = bool(scene.times[held[0]] == 0.0) and not plan.scenario.initial_states
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
