"""Which part of a flight a picture in space shows, so that the body and the spacecraft near it can both be made out."""

from __future__ import annotations

from math import degrees

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from swarm_mj.figures.palette import BLACK, GREY
from swarm_mj.figures.scene import Scene
from swarm_mj.figures.style import SMALL_PT
from swarm_mj.figures.view import KM, View, draw_body
from swarm_mj.flight.plan import Plan
from swarm_mj.records.passage import passage
from swarm_mj.scenarios.itinerary import last_arrival_s
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array, Indices

#: Farther than this over the distance at the arrival, and over the body's radius, a flight leaves the picture.
FAR, FAR_RADII = 4.0, 20.0
#: A picture is at most this much wider than what it is about, to hold what is around it.
WIDER = 4.0
#: A body that turns farther than this [deg] makes curls of straight paths in its own frame.
MUCH_TURNED_DEG = 45.0
#: A body seen smaller than this share of the picture is drawn once more, larger, on this share of it.
SMALL, ENLARGED = 0.04, 0.2
#: Room between the larger picture and the border, as a share of the axes.
EDGE = 0.015
#: Samples that a path needs.
LEAST_SAMPLES = 3


def near_arrival(plan: Plan, telemetry: xr.Dataset, at_least_m: float = 0.0) -> xr.Dataset:
    """The telemetry from when the swarm comes near the body, before the arrival, until it leaves.

    Args:
        plan: What was flown.
        telemetry: How.
        at_least_m: Distance from the body's centre that counts as near in any case [m].
    """
    times, r_BN_N = telemetry["time"].values, telemetry["r_BN_N"].values
    reach = FAR, max(FAR_RADII * plan.region.mesh.max_radius, at_least_m)
    return telemetry.isel(time=passage(times, r_BN_N, last_arrival_s(plan.scenario), reach, LEAST_SAMPLES))


def turns_much(plan: Plan, telemetry: xr.Dataset) -> bool:
    """Whether the body turns so far during telemetry that paths are better drawn in a frame at rest."""
    seconds = float(telemetry["time"].values[-1] - telemetry["time"].values[0])
    return degrees(abs(plan.environment.spin_rate)) * seconds > MUCH_TURNED_DEG


def frame_at_rest(plan: Plan, telemetry: xr.Dataset, frame: str | None) -> bool:
    """Whether to draw in the frame at rest: as asked for by "N" or "A", else as it reads better.

    Raises:
        ValueError: Another frame is asked for.
    """
    if frame not in ("A", "N", None):
        raise ValueError(
            f"frame = {frame!r}: must be 'A' (body-fixed), 'N' (inertial) or None (whichever reads better)"
        )
    return turns_much(plan, telemetry) if frame is None else frame == "N"


def frame_words(at_rest: bool) -> str:
    """The frame of a picture in words."""
    return "frame N, with body and axes as at the arrival" if at_rest else "frame A"


def framed(plan: Plan, scene: Scene, k: int, *, onwards: bool = False) -> tuple[Array, Indices]:
    """What the picture of an instant holds: target and swarm, and as much of body and path as leaves these large enough.

    Args:
        plan: What was flown.
        scene: What flies.
        k: Sample of the instant.
        onwards: Whether the path after it is drawn too.

    Returns:
        Points that the picture holds, shape (n, 3) [m], and the samples of the path that it holds, in order.
    """
    inside = np.vstack((plan.region.corners_A.reshape(-1, 3), scene.r_A[k]))
    body = np.vstack((inside, plan.region.mesh.vertices))
    if _extent(body) <= WIDER * _extent(inside):
        inside = body
    limit, held = WIDER * _extent(inside), [k]
    for samples in (range(k - 1, -1, -1), range(k + 1, len(scene.times)) if onwards else ()):
        low, high = inside.min(axis=0), inside.max(axis=0)
        for sample in samples:
            low, high = np.minimum(low, scene.r_A[sample].min(axis=0)), np.maximum(high, scene.r_A[sample].max(axis=0))
            if (high - low).max() > limit:
                break
            held.append(sample)
    held.sort()
    return np.vstack((inside, scene.r_A[held].reshape(-1, 3))), np.array(held)


def _extent(points: Array) -> float:
    return float(np.ptp(points, axis=0).max())


def enlarge_small_body(
    ax: Axes, view: View, body: ShapeModel, colours: Array, taken: Array, *, low: bool = True
) -> None:
    """Ring a body too small to be made out, and draw it once more, larger, in the corner farthest from what is drawn.

    Args:
        ax: Axes whose limits are set.
        view: Where the picture is seen from.
        body: The mesh.
        colours: Of its faces, shape (F, 3).
        taken: What the corner has to keep clear of, shape (n, 2), in the axes' units.
        low: Whether the lower corners are free of scales.
    """
    flat = view.project(body.vertices)
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    size, page = float(np.ptp(flat, axis=0).max()), np.array([right - left, top - bottom])
    if size >= SMALL * float(page.max()):
        return
    share = ENLARGED * page.max() / page
    corners = [
        np.array([x, y]) for x in (EDGE, 1.0 - EDGE - share[0]) for y in (EDGE, 1.0 - EDGE - share[1])[not low :]
    ]
    places = (taken - (left, bottom)) / page
    x, y = max(corners, key=lambda corner: _clear(places, corner, share))
    inset = ax.inset_axes((x, y, share[0], share[1]), zorder=6)
    inset.set_xticks(())
    inset.set_yticks(())
    inset.set_aspect("equal")
    for spine in inset.spines.values():
        spine.set_color(GREY)
    draw_body(inset, view, body, colours)
    middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    inset.set_xlim(middle[0] - 0.65 * size, middle[0] + 0.65 * size)
    inset.set_ylim(middle[1] - 0.8 * size, middle[1] + 0.5 * size)
    words = f"{2.0 * body.max_radius / KM:.3g} km across"
    inset.text(0.5, 0.04, words, transform=inset.transAxes, ha="center", va="bottom", fontsize=SMALL_PT)
    ax.plot(*middle, "o", markersize=11, markerfacecolor="none", color=BLACK, markeredgewidth=0.9, zorder=6)


def _clear(places: Array, corner: Array, share: Array) -> float:
    """How far places (n, 2) stay away from a rectangle, in shares of the axes."""
    outside = np.maximum(np.maximum(corner - places, places - corner - share), 0.0)
    return float(np.linalg.norm(outside, axis=1).min())
