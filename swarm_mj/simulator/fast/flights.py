"""What compiled code is given of flights: the world that they share, and the arrays of what changes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.simulator.slots import Slot
from swarm_mj.smallbody.gravity.compiled import CompiledField
from swarm_mj.smallbody.perturbations import Sunlight
from swarm_mj.spacecraft.gyrostat import NQ_FREE, NV_FREE
from swarm_mj.typing import Array, Ints, Mask

#: A tick that no flight reaches.
NEVER = 2**62


class World(NamedTuple):
    """What all flights of a swarm share and nothing changes.

    Attributes:
        period: Time between two decisions [s].
        mass: Of one spacecraft [kg].
        hub: Body ids of the hubs, shape (n,).
        inertia_B: Of every spacecraft, wheels locked, shape (n, 3, 3) [kg m^2].
        inertia_effective_B: The same less the wheels' axial inertia, shape (n, 3, 3) [kg m^2].
        phase0: Prime meridian angle at the epoch [rad].
        spin_rate: Of the body [rad/s].
        spin_N: Its angular velocity in N, shape (3,) [rad/s].
        C_PN: Rotation from N to the pole frame, shape (3, 3).
        q_P: Attitude of the pole frame as MuJoCo's quaternion, shape (4,).
        earth_N: Position of Earth relative to the body in N at the epoch, shape (3,) [m].
        earth_velocity_N: Its velocity, shape (3,) [m/s].
        sun_N: Position of the Sun relative to the body in N at the epoch, shape (3,) [m].
        sun_velocity_N: Its velocity, shape (3,) [m/s].
        sunlight: What of it acts.
        field: The gravity field.
        pulls: Places in A [m] and the accelerations there [m/s^2] that were last found at every tick, shape (T, n, 6): where no
            action moves the flights, gravity is evaluated for the first of them alone. Empty: it always is.
        cells: Cells of a polyhedron in which spacecraft were last at every tick, and what it does there, see
            `write_near_and_far`, shape (T, n, 12); the last one serves for all ticks from there on.
        frames: C_AN, C_mid and the attitude of A at every tick, and 1 where they are known, shape (T, 23); see `pulls`.
        gradient_gm: Gravitational parameter whose gradient turns the spacecraft [m^3/s^2]; 0: none does.
        wheel_inertia: Spin inertia of a wheel [kg m^2].
        wheel_axes_B: Rows, shape (w, 3).
        allocation: From a torque on the body to motor torques, see `actuate`, shape (3, 3).
        speed_gain: See `actuate` [rad/s per N m].
        max_torque: Of a motor [N m].
        max_speed: Of a wheel [rad/s].
        law: Address of the compiled control law; 0 where torques are held.
        law_numbers: The law's parameters.
    """

    period: float
    mass: float
    hub: Ints
    inertia_B: Array
    inertia_effective_B: Array
    phase0: float
    spin_rate: float
    spin_N: Array
    C_PN: Array
    q_P: Array
    earth_N: Array
    earth_velocity_N: Array
    sun_N: Array
    sun_velocity_N: Array
    sunlight: Sunlight
    field: CompiledField
    pulls: Array
    cells: Array
    frames: Array
    gradient_gm: float
    wheel_inertia: float
    wheel_axes_B: Array
    allocation: Array
    speed_gain: float
    max_torque: float
    max_speed: float
    law: int
    law_numbers: Array


class Flights(NamedTuple):
    """What changes, for E flights of n spacecraft.

    Attributes:
        tick: Control periods flown, shape (E,).
        finite: False from the instant at which a number of the state or a torque was not, shape (E,).
        effort: Sum of the squares of the motor torques decided so far, shape (E,) [N^2 m^2].
        qpos: Positions in N, attitudes and wheel angles, shape (E, 10 n).
        qvel: Velocities in N, body rates and wheel speeds, shape (E, n (6 + w)).
        kind: `TargetKind` values, shape (E, n).
        spacecraft: Spacecraft to follow, shape (E, n).
        vector: Surface point in A [m] or direction in N, shape (E, n, 3).
        last_kind: `kind` at the previous decision, -1 before the first, shape (E, n).
        last_spacecraft: The same of `spacecraft`.
        released: Who has left the mothership, and so is turned by its wheels, shape (E, n).
        restart: Whose target is another one than at the previous decision, shape (E, n).
        q_BN: Attitudes, shape (E, n, 4).
        q_RN: Reference attitudes, shape (E, n, 4).
        C_AN: Rotation from N to A at the decision, shape (E, 3, 3).
        C_mid: The same at the middle of the hold, shape (E, 3, 3).
        earth_N: Position of Earth at the decision, shape (E, 3) [m].
        work: See `Slot`, shape (E, slots, n, 3).
        torque_B: Torque on the bodies, given where it is held, shape (E, n, 3) [N m].
        peaks: See `Peak`, shape (E, n, 3).
    """

    tick: Ints
    finite: Mask
    effort: Array
    qpos: Array
    qvel: Array
    kind: Ints
    spacecraft: Ints
    vector: Array
    last_kind: Ints
    last_spacecraft: Ints
    released: Mask
    restart: Mask
    q_BN: Array
    q_RN: Array
    C_AN: Array
    C_mid: Array
    earth_N: Array
    work: Array
    torque_B: Array
    peaks: Array


def allocate_flights(count: int, n: int, wheels: int = 3) -> Flights:
    """E flights of n spacecraft with so many wheels before their start."""
    return Flights(
        tick=np.zeros(count, np.int64),
        finite=np.ones(count, np.bool_),
        effort=np.zeros(count),
        qpos=np.zeros((count, (NQ_FREE + wheels) * n)),
        qvel=np.zeros((count, (NV_FREE + wheels) * n)),
        kind=np.full((count, n), -1, np.int64),
        spacecraft=np.full((count, n), -1, np.int64),
        vector=np.zeros((count, n, 3)),
        last_kind=np.full((count, n), -1, np.int64),
        last_spacecraft=np.full((count, n), -1, np.int64),
        released=np.ones((count, n), np.bool_),
        restart=np.zeros((count, n), np.bool_),
        q_BN=np.zeros((count, n, 4)),
        q_RN=np.zeros((count, n, 4)),
        C_AN=np.zeros((count, 3, 3)),
        C_mid=np.zeros((count, 3, 3)),
        earth_N=np.zeros((count, 3)),
        work=np.zeros((count, len(Slot), n, 3)),
        torque_B=np.zeros((count, n, 3)),
        peaks=np.zeros((count, n, 3)),
    )


def one_of(flights: Flights, e: int) -> Flights:
    """Views of the arrays of flight e, as those of a batch of one."""
    return Flights._make(array[e : e + 1] for array in flights)
