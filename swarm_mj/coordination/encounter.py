"""The encounter as planned: what each spacecraft can show of the target when, wherever it is aimed, and how fast it turns.

All spacecraft carry this table aboard. It is made from the planned paths; dispersions of some metres a second matter little
to pictures more than a kilometre wide.

How long a turn takes until pictures count is found by asking the flight's own control law for turns from rest to rest about
the axis of largest inertia, with the wheels' limits of torque and speed. What the real turn adds (other axes, a target that
moves on) is small for the angles between parts of one target.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import radians
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from swarm_mj.io.cache import cache_folder, hash_of, load_array, store_array
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraMotion, look_at
from swarm_mj.observation.capture import causes, incidence, keeps_limits, limits_of, lit_cells, sight
from swarm_mj.observation.coverage import Cause
from swarm_mj.observation.observer import Observer
from swarm_mj.scenarios.schema_imaging import Observation
from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Ints, Mask

#: Every cell lies within this share of a picture's half-width of an aim, from the farthest place where it can be pictured: what
#: any picture shows, that of some aim has in the field of view. With less, plans take longer and show little more.
COVER = 0.6
#: Most pictures that a table judges, and most cells of all of them: some minutes, and half a gigabyte.
MOST_PICTURES, MOST_ENTRIES = 200_000, 400_000_000
#: Kept tables together [bytes].
MAX_CACHE_BYTES = 256 * 2**20
#: Turns that are tried [deg].
ANGLES_DEG = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
#: A turn that takes longer does not settle [s].
LONGEST_S = 600.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Encounter:
    """What a observers can show with m aims in k slots of c cells."""

    slot_s: Array  #: when pictures are taken, past the epoch [s], shape (k,)
    aims_A: Array  #: points to aim at, shape (m, 3) [m]
    #: whether the picture of observer a at aim m in slot k shows cell c, however the camera is rolled, (a, m, k, c)
    shows: Mask
    slew: Ints  #: slots from an observer's picture of one aim to one of another, shape (a, m, m)
    area: Array  #: of the cells, shape (c,) [m^2]
    interval_s: float  #: what `slew` counts: between a spacecraft's pictures [s]
    #: most that a cell lies from an aim, over what `COVER` asks for; above 1 where the table would have become too large
    spacing: float = 1.0

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.area)

    def slot_after(self, t: float) -> int:
        """The first slot later than a time [s]; the number of slots where there is none."""
        return int(np.searchsorted(self.slot_s, t + 1e-6))


class Track(NamedTuple):
    """Where everything will be at k instants, if nothing disturbs the plan."""

    r_A: Array  #: places of the observers in A, shape (k, a, 3) [m]
    v_A: Array  #: their velocities relative to A, in A, shape (k, a, 3) [m/s]
    free: Mask  #: whether each has left the mothership: before, it takes no pictures, shape (k, a)
    sun_A: Array  #: direction to the Sun in A, shape (k, 3)


class Reach(NamedTuple):
    """What can be pictured at all, wherever cameras look: a bound on `shown_cells` by limits and light at the centroids."""

    useful: Mask  #: whether an observer can picture anything in a slot, shape (k, a)
    farthest_m: Array  #: largest distance from which a cell can be pictured, 0 for never, shape (cells,)


def reach_of(region: TargetRegion, criterion: Observation, camera: CameraModel, track: Track) -> Reach:
    """What a camera can picture of a target from a track by the criterion."""
    limits, useful = limits_of(criterion, camera, region), np.zeros(track.free.shape, np.bool_)
    farthest, darkest = np.zeros(region.n_cells), radians(criterion.max_incidence_deg)
    for k, a in np.argwhere(track.free):
        distance, height = sight(region, track.r_A[k, a])
        kept = keeps_limits(limits, distance, height)
        if criterion.needs_sun and kept.any():
            kept &= incidence(region, track.sun_A[k]) <= darkest
        useful[k, a] = kept.any()
        farthest = np.maximum(farthest, np.where(kept, distance, 0.0))
    return Reach(useful, farthest)


def aim_points(region: TargetRegion, camera: CameraModel, reach: Reach) -> tuple[Array, float]:
    """Centroids of cells to aim at, whose pictures have in view whatever can be pictured of a target of any shape.

    Greedy set cover: next is always the cell with most area within reach that no aim has yet, see `COVER`.

    Returns:
        Aims, shape (m, 3) [m], and by how much they lie farther apart than that, see `Encounter.spacing`.
    """
    wanted = np.flatnonzero(reach.farthest_m)
    if not len(wanted):
        return region.centroid_A[:1], 1.0
    slots, observers = reach.useful.any(axis=1).sum(), reach.useful.shape[1]
    most = max(min(MOST_PICTURES // reach.useful.sum(), MOST_ENTRIES // (slots * observers * region.n_cells)), 1)
    places, spacing = region.centroid_A[wanted], 1.0
    width = COVER * min(camera.sides) * camera.tan_half_angle * reach.farthest_m[wanted]
    while len(aims := _cover(places, spacing * width, region.area[wanted])) > most:
        spacing *= max(float(np.sqrt(len(aims) / most)), 1.05)
    return places[aims], spacing


def _cover(places: Array, radius: Array, area: Array) -> list[int]:
    """Numbers of places such that each, shape (n, 3) [m], lies within its radius [m] of one, those of most area first."""
    near = KDTree(places).query_ball_point(places, radius)
    row = np.repeat(np.arange(len(places)), [len(found) for found in near])
    within = csr_array((np.ones(len(row)), (np.concatenate(near).astype(np.int64), row)), shape=(len(places),) * 2)
    left, chosen = area.copy(), list[int]()
    while left.any():
        chosen.append(int(np.argmax(within @ left)))
        left[within.indices[slice(*within.indptr[chosen[-1] : chosen[-1] + 2])]] = 0.0
    return chosen


def shown_cells(
    observer: Observer, criterion: Observation, aims_A: Array, track: Track, reach: Reach | None = None
) -> Mask:
    """Cells that count in pictures from planned places, shape (a, m, k, cells); kept on disk.

    Args:
        observer: With a camera that shows the same however it is rolled.
        criterion: When a cell counts.
        aims_A: Each picture's camera keeps one in its middle, shape (m, 3) [m].
        track: Where everything will be.
        reach: From `reach_of`; None: it is worked out.
    """
    region, camera = observer.region, observer.camera
    text = f"4 {camera} {criterion} {observer.name} {observer.occlusion}"
    # Rounded to a millimetre, so that the last bits of another machine's paths find the same table.
    needed = [track.r_A, aims_A, *([track.sun_A] if criterion.needs_sun else [])]
    needed += [track.v_A] if criterion.needs_motion else []
    where = np.round(np.concatenate([array.ravel() for array in needed]), 3)
    key = hash_of(text, where, track.free, region.vertices, region.faces, region.target)
    file = cache_folder() / "encounters" / f"{key}.npy"
    shape = (track.r_A.shape[1], len(aims_A), len(track.r_A), region.n_cells)
    width = -(-region.n_cells // 8)
    kept = load_array(file, (*shape[:3], width))
    if kept is not None:
        return np.unpackbits(kept.astype(np.uint8), axis=3, count=region.n_cells).astype(np.bool_)
    shows, limits = np.zeros(shape, np.bool_), limits_of(criterion, camera, region)
    outline = float(np.linalg.norm(region.corners_A - region.centroid_A[:, None], axis=2).max())
    for k, free in enumerate((reach or reach_of(region, criterion, camera, track)).useful):
        light = partial(lit_cells, observer, criterion, track.sun_A[k])
        for a in np.flatnonzero(free):
            r_A = track.r_A[k, a]
            within = keeps_limits(limits, *sight(region, r_A))
            for m in np.flatnonzero(_beside(region.centroid_A[within] - r_A, aims_A - r_A, camera, outline)):
                pose = look_at(r_A, aims_A[m])
                motion = following(aims_A[m] - r_A, track.v_A[k, a], pose.C_CA)
                shows[a, m, k] = causes(observer, pose, criterion, motion=motion, light=light) == Cause.NONE
    store_array(file, np.packbits(shows, axis=3).astype(np.float32), folder_bytes=MAX_CACHE_BYTES)
    return shows


def _beside(cells: Array, aims: Array, camera: CameraModel, outline: float) -> Mask:
    """At which aims a picture may show any of some cells within a cone; both from the camera [m], shapes (c, 3) and (m, 3)."""
    distance = np.linalg.norm(cells, axis=1)
    cosine = aims @ (cells / distance[:, None]).T / np.linalg.norm(aims, axis=1)[:, None]
    margin = radians(camera.half_angle_deg) + np.arcsin(np.minimum(outline / distance, 1.0))
    return np.asarray((np.arccos(np.clip(cosine, -1.0, 1.0)) <= margin).any(axis=1))


def following(to_aim_A: Array, v_A: Array, C_CA: Array) -> CameraMotion:
    """The motion of a camera that keeps an aim in the middle of its picture and does not turn about the line of sight.

    Args:
        to_aim_A: From the camera to the aim, which is fixed in A, shape (3,) [m].
        v_A: Velocity of the camera relative to A, shape (3,) [m/s].
        C_CA: Rotation from A to the camera frame, shape (3, 3).
    """
    return CameraMotion(v_A, C_CA @ np.cross(to_aim_A, -v_A) / (to_aim_A @ to_aim_A))


def turning_angles(aims_A: Array, r_A: Array, useful: Mask) -> Array:
    """Largest angle between any two aims, as each observer sees them while it can show something, shape (a, m, m) [rad].

    Args:
        aims_A: Shape (m, 3) [m].
        r_A: Places, shape (k, a, 3) [m].
        useful: When an observer shows anything, shape (a, k); where never, from its nearest place.
    """
    angle = np.zeros((r_A.shape[1], len(aims_A), len(aims_A)))
    for a in range(r_A.shape[1]):
        slots = np.flatnonzero(useful[a])
        if not len(slots):
            slots = np.array([np.argmin(np.linalg.norm(r_A[:, a], axis=1))])
        ahead = aims_A - r_A[slots, a][:, None]
        ahead /= np.linalg.norm(ahead, axis=2, keepdims=True)
        cosine = np.einsum("kmi,kni->kmn", ahead, ahead).min(axis=0)
        angle[a] = np.arccos(np.clip(cosine, -1.0, 1.0)) * ~np.eye(len(aims_A), dtype=np.bool_)
    return angle


def settling_times(
    controller: Controller, properties: SpacecraftProperties, period: float, tolerance: float
) -> tuple[Array, Array]:
    """Times after which the pointing error stays below a tolerance.

    Args:
        controller: The law.
        properties: Of the spacecraft.
        period: Control period [s].
        tolerance: Largest pointing error [rad].

    Returns:
        Angles of the turns [rad], ascending from 0, and the time each takes [s], never falling, `LONGEST_S` at most.
    """
    turn = np.radians(ANGLES_DEG)
    axis = int(np.argmax(np.diag(properties.inertia_effective_B)))
    J = np.tile(properties.inertia_B, (len(turn), 1, 1))
    J_eff = np.tile(properties.inertia_effective_B, (len(turn), 1, 1))
    limit, most = properties.max_wheel_torque, properties.wheel_spin_inertia * properties.max_wheel_speed
    error, rate, wheels = turn.copy(), np.zeros(len(turn)), np.zeros(len(turn))
    late, memory = np.zeros(len(turn)), None
    zero = np.zeros((len(turn), 3))
    for k in range(1, round(LONGEST_S / period) + 1):
        sigma, omega, momentum = (np.zeros((len(turn), 3)) for _ in range(3))
        sigma[:, axis], omega[:, axis], momentum[:, axis] = np.tan(0.25 * error), rate, wheels
        inputs = ControlInput(sigma, omega, omega.copy(), zero, zero, momentum, J, J_eff, period)
        torque_B, memory = controller.torque(inputs, memory)
        torque = np.clip(torque_B[:, axis], -limit, limit)
        torque = np.clip(torque, (wheels - most) / period, (wheels + most) / period)
        acceleration = torque / J_eff[:, axis, axis]
        error = error + rate * period + 0.5 * acceleration * period**2
        rate, wheels = rate + acceleration * period, wheels - torque * period
        late = np.where(np.abs(error) > tolerance, k * period, late)
        if (np.abs(error) < 0.1 * tolerance).all() and (np.abs(rate) * period < 0.1 * tolerance).all():
            break
    else:
        late = np.where(np.abs(error) > tolerance, LONGEST_S, late)
    late = np.where(turn > tolerance, late, 0.0)
    return np.concatenate([[0.0], turn]), np.maximum.accumulate(np.concatenate([[0.0], late]))


def slots_between(angle: Array, table: tuple[Array, Array], interval_s: float, delay_s: float) -> Array:
    """Least number of pictures later at which another aim can be pictured, at least 1.

    Args:
        angle: Between the aims [rad], any shape.
        table: From `settling_times`; beyond its last angle that one's time.
        interval_s: Between pictures [s].
        delay_s: After a picture until the turn begins [s].
    """
    takes = np.interp(angle, *table)
    return np.maximum(np.ceil((takes + delay_s) / interval_s - 1e-9), 1.0)
