"""The observation vector: which numbers stand where, how they are scaled, and the compiled loop that fills it.

Nothing depends on how many flights are handled together, so that each comes out bit for bit as if it were alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from gymnasium import spaces

from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.observation.capture import takes_picture
from swarm_mj.typing import Array, Array32, Ints, Mask, lean

from .kinematics import AttitudeEstimate, Kinematics, Tracking
from .totals import EpisodeTotals

#: Per spacecraft, in this order: name, size (of the wheel speeds: with the usual three), bound of the absolute value, and
#: whether it may be negative.
PER_SPACECRAFT = (
    ("position", 3, 10.0, True),
    ("velocity", 3, 10.0, True),
    ("sigma_BR", 3, 1.0, True),
    ("boresight", 3, 1.0, True),
    ("x_axis", 3, 1.0, True),
    ("rate", 3, 10.0, True),
    ("wheel_speed", 3, 1.0, True),
    ("imaging", 1, 1.0, False),
    ("link", 1, 1.0, False),
    ("stored", 1, 10.0, False),
    ("role", len(TargetKind), 1.0, False),
)
#: Raise when what stands where, or its scale, changes: files of policies carry it.
LAYOUT = 1
#: Body rates are divided by this [rad/s].
RATE_SCALE = 0.1


def columns_with(wheels: int) -> dict[str, slice]:
    """Places of each quantity within the block of a spacecraft with that many wheels."""
    sizes = [wheels if name == "wheel_speed" else size for name, size, *_ in PER_SPACECRAFT]
    ends = np.cumsum(sizes).tolist()
    return {name: slice(end - size, end) for (name, *_), size, end in zip(PER_SPACECRAFT, sizes, ends, strict=True)}


#: With the usual three wheels: places of each quantity, and numbers for each spacecraft.
COLUMNS = columns_with(3)
FEATURES = COLUMNS["role"].stop
#: Numbers for each spacecraft besides its wheel speeds.
FEATURES_BUT_WHEELS = FEATURES - 3

# Where the quantities before the wheel speeds begin, and those behind them, counted from there.
_POSITION, _VELOCITY, _SIGMA_BR = COLUMNS["position"].start, COLUMNS["velocity"].start, COLUMNS["sigma_BR"].start
_BORESIGHT, _X_AXIS, _RATE = COLUMNS["boresight"].start, COLUMNS["x_axis"].start, COLUMNS["rate"].start
_WHEEL_SPEED, _BEHIND = COLUMNS["wheel_speed"].start, COLUMNS["wheel_speed"].stop
_IMAGING, _LINK = COLUMNS["imaging"].start - _BEHIND, COLUMNS["link"].start - _BEHIND
_STORED, _ROLE = COLUMNS["stored"].start - _BEHIND, COLUMNS["role"].start - _BEHIND


class ObservationLayout:
    """Layout of the observation; `write_observations` fills it.

    Args:
        plan: The mission, for the scales.
        patches: Number of patches.

    Attributes:
        space: The observation space.
        features: Numbers for each spacecraft.
        position_scale: Positions are divided by this [m].
        velocity_scale: Velocities are divided by this [m/s].
        columns: Places of each per-spacecraft quantity within a spacecraft's block.
    """

    def __init__(self, plan: Plan, patches: int) -> None:
        self._n = plan.n
        self.position_scale = plan.scenario.behavior.imaging_radius_m
        self.velocity_scale = float(plan.mothership_distance / plan.scenario.design.time_of_flight_s)
        self.columns = columns_with(len(plan.properties.wheel_axes_B))
        self.features = self.columns["role"].stop
        high, low = np.empty(self.features), np.empty(self.features)
        for name, _, bound, signed in PER_SPACECRAFT:
            high[self.columns[name]], low[self.columns[name]] = bound, -bound if signed else 0.0
        tail = np.ones(patches + 3)
        tail[-1] = 10.0
        self.space = spaces.Box(
            np.concatenate([np.tile(low, plan.n), 0.0 * tail]).astype(np.float32),
            np.concatenate([np.tile(high, plan.n), tail]).astype(np.float32),
            dtype=np.float32,
        )

    def split(self, observation: Array32) -> dict[str, Array32]:
        """The parts of an observation by name: per spacecraft shape (n, size), and patches, time_left, seen, delivered."""
        block = observation[: self._n * self.features].reshape(self._n, self.features)
        rest = observation[self._n * self.features :]
        parts = {name: block[:, columns] for name, columns in self.columns.items()}
        return parts | {"patches": rest[:-3], "time_left": rest[-3], "seen": rest[-2], "delivered": rest[-1]}


class ObservationConstants(NamedTuple):
    """What all observations of a task share.

    Attributes:
        n_observers: Number of spacecraft that take pictures, the first ones.
        position_m: Positions are divided by this [m].
        velocity_m_s: Velocities are divided by this [m/s].
        wheel_speed_rad_s: Wheel speeds are divided by this [rad/s].
        spin_rate: Of the body [rad/s].
        duration_s: Of the flight [s].
        nominal_bit: Data are divided by this [bit].
        target_area_m2: Of the target [m^2].
        cells: The cells patch by patch, shape (C,).
        first_cell: Where a patch begins there, and the last one ends, shape (K + 1,).
        cell_area: Shape (C,) [m^2].
        patch_area: Shape (K,) [m^2].
        low: Bounds of an observation, shape (F,).
        high: Bounds of an observation, shape (F,).
    """

    n_observers: int
    position_m: float
    velocity_m_s: float
    wheel_speed_rad_s: float
    spin_rate: float
    duration_s: float
    nominal_bit: float
    target_area_m2: float
    cells: Ints
    first_cell: Ints
    cell_area: Array
    patch_area: Array
    low: Array32
    high: Array32


@lean
def write_observations(
    constants: ObservationConstants,
    now: Kinematics,
    estimate: AttitudeEstimate,
    tracking: Tracking,
    totals: EpisodeTotals,
    live: Mask,
    observation: Array32,
) -> None:
    """Observe the live flights.

    Args:
        constants: See `ObservationConstants`.
        now: At the instant of the observation.
        estimate: Attitudes and rates as the flight software has them.
        tracking: What the spacecraft track.
        totals: What the flights have come to.
        live: Which flights, shape (E,).
        observation: Receives the observations, shape (E, F).
    """
    for e in range(live.shape[0]):
        if live[e]:
            out = observation[e]
            block = FEATURES_BUT_WHEELS + now.wheel.shape[2]
            for j in range(tracking.kind.shape[1]):
                one = out[block * j : block * (j + 1)]
                one[:] = 0.0
                _write_motion(constants, now, estimate, tracking, e, j, one)
                _write_activity(constants, tracking, totals, e, j, one[_WHEEL_SPEED + now.wheel.shape[2] :])
            _write_coverage(constants, now.t[e], totals, e, out[block * tracking.kind.shape[1] :])
            for i in range(out.shape[0]):
                out[i] = min(max(out[i], constants.low[i]), constants.high[i])


@lean
def _write_motion(
    constants: ObservationConstants,
    now: Kinematics,
    estimate: AttitudeEstimate,
    tracking: Tracking,
    e: int,
    j: int,
    out: Array32,
) -> None:
    r_A, v, C_AN, C_BN = now.r_A[e, j], now.v[e, j], now.C_AN[e], estimate.C_BN[e, j]
    # Velocity as seen by somebody who turns with the body.
    turning = (-constants.spin_rate * r_A[1], constants.spin_rate * r_A[0], 0.0)
    for k in range(3):
        v_A = C_AN[k, 0] * v[0] + C_AN[k, 1] * v[1] + C_AN[k, 2] * v[2]
        out[_POSITION + k] = r_A[k] / constants.position_m
        out[_VELOCITY + k] = (v_A - turning[k]) / constants.velocity_m_s
        out[_SIGMA_BR + k] = tracking.sigma_BR[e, j, k]
        out[_BORESIGHT + k] = C_BN[2, 0] * C_AN[k, 0] + C_BN[2, 1] * C_AN[k, 1] + C_BN[2, 2] * C_AN[k, 2]
        out[_X_AXIS + k] = C_BN[0, 0] * C_AN[k, 0] + C_BN[0, 1] * C_AN[k, 1] + C_BN[0, 2] * C_AN[k, 2]
        out[_RATE + k] = estimate.omega[e, j, k] / RATE_SCALE
    for w in range(now.wheel.shape[2]):
        out[_WHEEL_SPEED + w] = now.wheel[e, j, w] / constants.wheel_speed_rad_s


@lean
def _write_activity(
    constants: ObservationConstants, tracking: Tracking, totals: EpisodeTotals, e: int, j: int, out: Array32
) -> None:
    kind = tracking.kind[e, j]
    works = not (totals.lost[e, j] or tracking.blind[e, j])
    out[_IMAGING] = 1.0 if takes_picture(j, constants.n_observers, kind, works) else 0.0
    out[_LINK] = 1.0 if totals.closed[e, j] else 0.0
    out[_STORED] = totals.stored[e, j] / constants.nominal_bit
    out[_ROLE + kind] = 1.0


@lean
def _write_coverage(constants: ObservationConstants, t: float, totals: EpisodeTotals, e: int, out: Array32) -> None:
    patches = constants.patch_area.shape[0]
    for k in range(patches):
        seen_m2 = 0.0
        for place in range(constants.first_cell[k], constants.first_cell[k + 1]):
            i = constants.cells[place]
            if totals.seen[e, i]:
                seen_m2 += constants.cell_area[i]
        out[k] = seen_m2 / constants.patch_area[k]
    out[patches] = 1.0 - t / constants.duration_s
    out[patches + 1] = totals.area[e] / constants.target_area_m2
    out[patches + 2] = totals.delivered[e] / constants.nominal_bit
