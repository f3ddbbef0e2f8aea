"""The encounter as planned: what each spacecraft can show of the target when, wherever it is aimed, and how fast it turns.

All spacecraft carry this table aboard. It is made from the planned paths; dispersions of some metres a second matter little
to pictures more than a kilometre wide.

How long a turn takes until pictures count is found by asking the flight's own control law for turns from rest to rest about
the axis of largest inertia, with the wheels' limits of torque and speed. What the real turn adds (other axes, a target that
moves on) is small for the angles between parts of one target.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from swarm_mj.io.cache import cache_folder, hash_of, load_array, store_array
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraMotion, look_at
from swarm_mj.observation.capture import keeps_limits, limits_of, observe, sight
from swarm_mj.observation.observer import Observer
from swarm_mj.scenarios.schema_imaging import Observation
from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Ints, Mask

#: Aims across a picture's width: with fewer, edges stay unseen; with more, plans take longer and see little more.
AIMS_PER_PICTURE = 1.5
#: Most aims along a side of the target.
MOST_AIMS = 6
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


def aim_points(region: TargetRegion, camera: CameraModel, distance: float) -> Array:
    """Points on the target to aim at, in a grid over its pyramid, shape (m, 3) [m].

    Args:
        region: The target.
        camera: Its pictures are laid side by side and a little over one another.
        distance: From which pictures are taken [m].
    """
    east, north, out = (region.centroid_A @ region.axes_A.T).T
    side, radius = np.tan(region.side_half_angle), float(np.linalg.norm(region.centroid_A, axis=1).mean())
    wide = 2.0 * camera.tan_half_angle * distance
    count = int(np.clip(np.ceil(AIMS_PER_PICTURE * 2.0 * side * radius / wide), 1, MOST_AIMS))
    middle = side * ((2.0 * np.arange(count) + 1.0) / count - 1.0)
    tangents = np.stack(np.meshgrid(middle, middle, indexing="ij"), axis=-1).reshape(-1, 2)
    apart = np.hypot(*(tangents[:, :, None] - np.stack([north / out, east / out])[None]).transpose(1, 0, 2))
    aims: Array = region.centroid_A[np.unique(np.argmin(apart, axis=1))]
    return aims


def shown_cells(observer: Observer, criterion: Observation, aims_A: Array, track: Track) -> Mask:
    """Cells that count in pictures from planned places, shape (a, m, k, cells); kept on disk.

    Args:
        observer: With a camera that shows the same however it is rolled.
        criterion: When a cell counts.
        aims_A: Each picture's camera keeps one in its middle, shape (m, 3) [m].
        track: Where everything will be.
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
    for k, a in np.argwhere(track.free):
        r_A = track.r_A[k, a]
        if not keeps_limits(limits, *sight(region, r_A)).any():
            continue
        for m, aim in enumerate(aims_A):
            C_CA = look_at(r_A, aim).C_CA
            motion = following(aim - r_A, track.v_A[k, a], C_CA)
            shows[a, m, k] = observe(observer, r_A, C_CA, criterion, track.sun_A[k], motion)
    store_array(file, np.packbits(shows, axis=3).astype(np.float32), folder_bytes=MAX_CACHE_BYTES)
    return shows


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
