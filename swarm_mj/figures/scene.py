"""What flies around the body in a picture, in the body-fixed frame, from where to look at it, and which part of it to show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from numpy.typing import NDArray

from swarm_mj.figures.palette import BLACK, GREY
from swarm_mj.figures.style import SMALL_PT
from swarm_mj.figures.view import KM, View, draw_body, face_colours, first_hits, unit, views_of, visible_share
from swarm_mj.flight.fly import asteroid_attitudes
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind, looks_at_body
from swarm_mj.mission.target import TargetRegion
from swarm_mj.records.modes import LOST, modes_shown
from swarm_mj.records.passage import passage
from swarm_mj.scenarios.itinerary import last_arrival_s
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.typing import Array, Indices, Mask

#: Length of a +z axis that points at nothing near, as a share of the picture.
FREE_AXIS = 0.4


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What flies around the body, in A, or in A as it stands at the arrival, which is at rest.

    Attributes:
        times: Shape (t,) [s].
        turn: Attitude of A relative to the frame of the scene, shape (t, 3, 3).
        r_A: Positions, shape (t, n, 3) [m].
        z_A: Directions of +z, shape (t, n, 3).
        relays: Whether each spacecraft is a communications spacecraft then: sent as one, or pointing at Earth, shape (t, n).
        mode: What each tracks, or that it is lost, as `modes_shown` tells, shape (t, n).
        companion_A: Mesh of the body's companion at each time, corners in the frame of the scene; None: there is none.
    """

    times: Array
    turn: Array
    r_A: Array
    z_A: Array
    relays: Mask
    mode: NDArray[np.int8]
    companion_A: Callable[[int], ShapeModel] | None = None


def scene_from(plan: Plan, telemetry: xr.Dataset, *, at_rest: bool = False) -> Scene:
    """Turn telemetry into A, or into the inertial frame that A is at the arrival, in which body and target stand as then."""
    C_AN = asteroid_attitudes(telemetry)
    turn = np.broadcast_to(np.eye(3), C_AN.shape)
    if at_rest:
        at_arrival = plan.environment.C_AN(last_arrival_s(plan.scenario))
        turn, C_AN = C_AN @ at_arrival.T, np.broadcast_to(at_arrival, C_AN.shape)
    z_N = dcm(telemetry["sigma_BN"].values)[..., 2, :]
    mode, companion, times = modes_shown(telemetry), plan.environment.companion, telemetry["time"].values

    def moved(k: int) -> ShapeModel:
        assert companion is not None
        place_N = companion.shape.vertices @ companion.C_AN(times[k]) + companion.position(times[k])
        return ShapeModel(place_N @ C_AN[k].T, companion.shape.faces, companion.name)

    return Scene(
        times=times,
        turn=turn,
        r_A=np.einsum("kij,knj->kni", C_AN, telemetry["r_BN_N"].values),
        z_A=np.einsum("kij,knj->kni", C_AN, z_N),
        relays=(mode == TargetKind.EARTH) | (np.arange(plan.n) >= plan.n_observers),
        mode=mode,
        companion_A=None if companion is None else moved,
    )


def draw_bodies(ax: Axes, view: View, body: ShapeModel, colours: Array, scene: Scene, k: int) -> None:
    """Draw the body with the colours of its faces, and its companion as it stands at sample k, the farther one first."""
    drawn = [(body, colours)]
    if scene.companion_A is not None:
        other = scene.companion_A(k)
        drawn.insert(int(other.vertices.mean(axis=0) @ view.toward > 0.0), (other, face_colours(other, [])))
    for shape, faces in drawn:
        draw_body(ax, view, shape, faces)


def axis_tips(telemetry: xr.Dataset, scene: Scene, body: ShapeModel, k: int, free: float) -> Array:
    """Where to end the line along each +z: at the ground, as far as the spacecraft tracked, or after `free` [m].

    Shape (n, 3) [m]; those of lost spacecraft end where they begin.
    """
    r, z, mode, tracked = scene.r_A[k], scene.z_A[k], scene.mode[k], telemetry["tracked_spacecraft"].values[k]
    onto_A = scene.turn[k].T
    length = np.where(mode >= LOST, 0.0, free)
    down, other = looks_at_body(mode), mode == TargetKind.SPACECRAFT
    length[down] = first_hits(r[down] @ onto_A, z[down] @ onto_A, np.linalg.norm(r[down], axis=1), body)
    length[other] = np.linalg.norm(r[other] - r[tracked[other]], axis=1)
    return r + length[:, None] * z


def best_view(region: TargetRegion, scene: Scene, instants: Sequence[int]) -> View:
    """A view in which the target, the flight path and the axes of the communications spacecraft can all be made out."""
    path = scene.r_A.mean(axis=1)
    lengthwise = [path[-1] - path[0], *scene.z_A[-1, scene.relays.any(axis=0)]]

    def merit(view: View) -> float:
        turned = [float(np.linalg.norm(view.axes[:2] @ unit(line))) for line in lengthwise]
        clear = min(_clearance(view, scene, k) for k in instants)
        in_front = np.mean([view.before(scene.r_A[k], region.mesh).mean() for k in instants])
        return visible_share(view, region) + min(0.6, *turned) + 2.0 * min(0.05, clear) - 0.3 * float(in_front)

    return max(views_of(region), key=merit)


def _clearance(view: View, scene: Scene, k: int) -> float:
    """Least distance of a spacecraft from a relay's +z axis in the picture, as a share of its height."""
    flat = view.project(scene.r_A[k])
    height = float(np.ptp(view.project(scene.r_A[: k + 1].reshape(-1, 3)), axis=0).max()) or 1.0
    shares = [1.0]
    for j in np.flatnonzero(scene.relays.any(axis=0)):
        axis = view.project(scene.z_A[k, j]) * KM
        others = np.delete(flat, j, axis=0) - flat[j]
        ahead = others @ axis > 0.0
        across = np.abs(others @ np.array([-axis[1], axis[0]])) / max(float(np.linalg.norm(axis)), 1e-9)
        shares.extend(across[ahead] / height)
    return min(shares)


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

    Nearer to the body's centre than `at_least_m` [m] is near in any case.
    """
    times, r_BN_N = telemetry["time"].values, telemetry["r_BN_N"].values
    reach = FAR, max(FAR_RADII * plan.region.mesh.max_radius, at_least_m)
    return telemetry.isel(time=passage(times, r_BN_N, last_arrival_s(plan.scenario), reach, LEAST_SAMPLES))


def frame_at_rest(plan: Plan, telemetry: xr.Dataset, frame: str | None) -> bool:
    """Whether to draw in the frame at rest: as asked for by "N" or "A", else as it reads better.

    Raises:
        ValueError: Another frame is asked for.
    """
    if frame not in ("A", "N", None):
        raise ValueError(
            f"frame = {frame!r}: must be 'A' (body-fixed), 'N' (inertial) or None (whichever reads better)"
        )
    seconds = float(telemetry["time"].values[-1] - telemetry["time"].values[0])
    turns_far = degrees(abs(plan.environment.spin_rate)) * seconds > MUCH_TURNED_DEG
    return turns_far if frame is None else frame == "N"


def frame_words(at_rest: bool) -> str:
    """The frame of a picture in words."""
    return "frame N, with body and axes as at the arrival" if at_rest else "frame A"


def framed(plan: Plan, scene: Scene, k: int, *, onwards: bool = False) -> tuple[Array, Indices]:
    """What the picture of sample k holds: target and swarm, and as much of body and path as leaves these large enough.

    With `onwards` the path after it is drawn too.

    Returns:
        Points that the picture holds, shape (n, 3) [m], and the samples of the path that it holds, in order.
    """
    inside = np.vstack((plan.region.corners_A.reshape(-1, 3), scene.r_A[k]))
    beside = [] if scene.companion_A is None else [scene.companion_A(k).vertices]
    body = np.vstack((inside, plan.region.mesh.vertices, *beside))
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

    The limits of the axes must be set. The corner keeps clear of places `taken`, shape (n, 2) in their units; with `low` the
    lower corners are free of scales.
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
