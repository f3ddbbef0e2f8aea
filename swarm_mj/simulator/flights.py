"""The arrays of E flights of n spacecraft with w wheels each: one layout for one flight and for thousands.

Compiled code takes them as named tuples; what Python knows of one flight are views of the same arrays.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from swarm_mj.simulator.slots import Slot
from swarm_mj.simulator.wheel_drive import WheelState
from swarm_mj.smallbody.gravity.compiled import CompiledField
from swarm_mj.smallbody.perturbations import Sunlight
from swarm_mj.spacecraft.attitude.estimation import AttitudeKnowledge
from swarm_mj.spacecraft.attitude.guidance import Aiming
from swarm_mj.typing import Array, Ints, Mask

#: A tick that no flight reaches.
NEVER = 2**62


class World(NamedTuple):
    """What all flights of a swarm share and nothing changes."""

    period: float  #: time between two decisions [s]
    timestep: float  #: of the integration [s]
    timesteps: int  #: in a period
    inertia_B: Array  #: of every spacecraft as planned, wheels locked, shape (n, 3, 3) [kg m^2]
    inertia_effective_B: Array  #: the same less the wheels' axial inertia, shape (n, 3, 3) [kg m^2]
    phase0: float  #: prime meridian angle at the epoch [rad]
    spin_rate: float  #: of the body [rad/s]
    spin_N: Array  #: its angular velocity in N, shape (3,) [rad/s]
    C_PN: Array  #: rotation from N to the pole frame, shape (3, 3)
    earth_N: Array  #: position of Earth relative to the body in N at the epoch, shape (3,) [m]
    earth_velocity_N: Array  #: its velocity, shape (3,) [m/s]
    sun_N: Array  #: position of the Sun relative to the body in N at the epoch, shape (3,) [m]
    sun_velocity_N: Array  #: its velocity, shape (3,) [m/s]
    sunlight: Sunlight  #: what of it acts
    field: CompiledField  #: the gravity field; where Python is asked for it, any other
    #: cells of a polyhedron in which spacecraft were last at every tick, and what it does there, see
    #: `write_near_and_far`, shape (T, n, 12); the last one serves for all ticks from there on
    cells: Array
    gradient_gm: float  #: gravitational parameter whose gradient turns the spacecraft [m^3/s^2]; 0: none does
    wheel_inertia: float  #: spin inertia of a wheel [kg m^2]
    wheel_axes_B: Array  #: rows, shape (w, 3)
    allocation: Array  #: from a torque on the body to motor torques, see `actuate`, shape (w, 3)
    speed_gain: float  #: see `actuate` [rad/s per N m]
    max_torque: float  #: of a motor [N m]
    max_speed: float  #: at which motors stop to accelerate a wheel, a little below its limit [rad/s]
    asks: int  #: what Python does in every period, a sum of `Ask` members
    law_numbers: Array  #: parameters of the control law
    aiming: Aiming  #: how spacecraft are turned to their lines of sight


class Flights(NamedTuple):
    """What changes in E flights."""

    tick: Ints  #: control periods flown, shape (E,)
    stage: Ints  #: where in its period each flight stands, see `loop.Stage`, shape (E,)
    ask: Ints  #: what it asks Python for before it can go on, a member of `loop.Ask`, shape (E,); 0: nothing
    #: tick from which on Python has something to do before the decision: a release, a fault, a behaviour, shape (E,)
    due: Ints
    finite: Mask  #: false from the instant at which a number of the state or a torque was not, shape (E,)
    effort: Array  #: sum of the squares of the motor torques decided so far, shape (E,) [N^2 m^2]
    r_N: Array  #: positions in N, shape (E, n, 3) [m]
    v_N: Array  #: velocities in N, shape (E, n, 3) [m/s]
    q_BN: Array  #: attitudes (w, x, y, z), shape (E, n, 4)
    omega_B: Array  #: body rates, shape (E, n, 3) [rad/s]
    wheel_speed: Array  #: relative to the hub, shape (E, n, w) [rad/s]
    momentum: Array  #: absolute axial momenta of the wheels, shape (E, n, w) [kg m^2/s]
    mass: Array  #: in truth, shape (E, n) [kg]
    inertia_B: Array  #: in truth, wheels locked, shape (E, n, 3, 3) [kg m^2]
    offset_N: Array  #: from the hub's origin to the centre of mass, where gravity is evaluated, shape (E, n, 3) [m]
    kind: Ints  #: `TargetKind` values, shape (E, n)
    spacecraft: Ints  #: spacecraft to follow, shape (E, n)
    vector: Array  #: surface point in A [m] or direction in N, shape (E, n, 3)
    last_kind: Ints  #: `kind` at the previous decision, -1 before the first, shape (E, n)
    last_spacecraft: Ints  #: the same of `spacecraft`
    restart: Mask  #: whose target is another one than at the previous decision, shape (E, n)
    released: Mask  #: who has left the mothership, and so is turned by its wheels, shape (E, n)
    lost: Mask  #: who no longer works, shape (E, n)
    resting: Ints  #: whose flight is over, see `Resting`, shape (E, n)
    rest_A: Array  #: where they lie on the body, in A, shape (E, n, 3) [m]
    q_RN: Array  #: reference attitudes, shape (E, n, 4)
    C_AN: Array  #: rotation from N to A at the decision, shape (E, 3, 3)
    C_mid: Array  #: the same at the middle of the hold, shape (E, 3, 3)
    earth_N: Array  #: position of Earth at the decision, shape (E, 3) [m]
    work: Array  #: see `Slot`, shape (E, slots, n, 3)
    torque_B: Array  #: that the wheels shall exert on the bodies, given where it is held, shape (E, n, 3) [N m]
    thrust_N: Array  #: of the thrusters in the hold, in N, shape (E, n, 3) [N]
    torque_N: Array  #: of thrusters and gravity gradient in the hold, in N, shape (E, n, 3) [N m]
    motor: Array  #: torques of motors and bearings on the wheels in the hold, shape (E, n, w) [N m]
    peaks: Array  #: see `Peak`, shape (E, n, 3)
    guessing: Mask  #: whether positions are known by navigation, and not as they are, shape (E,)
    guessed_at: Array  #: time at which the next two held, shape (E,) [s]
    off_r_N: Array  #: known positions less the true ones, which grow with the next, shape (E, n, 3) [m]
    off_v_N: Array  #: known velocities less the true ones, shape (E, n, 3) [m/s]


def allocate_flights(count: int, n: int, w: int) -> Flights:
    """E flights of n spacecraft with w wheels before their start."""

    def zeros(*shape: int) -> Array:
        return np.zeros((count, *shape))

    def whole(value: int, *shape: int) -> Ints:
        return np.full((count, *shape), value, np.int64)

    def flags(value: bool, *shape: int) -> Mask:
        return np.full((count, *shape), value, np.bool_)

    return Flights(
        tick=whole(0),
        stage=whole(0),
        ask=whole(0),
        due=whole(0),
        finite=flags(True),
        effort=zeros(),
        r_N=zeros(n, 3),
        v_N=zeros(n, 3),
        q_BN=zeros(n, 4),
        omega_B=zeros(n, 3),
        wheel_speed=zeros(n, w),
        momentum=zeros(n, w),
        mass=zeros(n),
        inertia_B=zeros(n, 3, 3),
        offset_N=zeros(n, 3),
        kind=whole(-1, n),
        spacecraft=whole(-1, n),
        vector=zeros(n, 3),
        last_kind=whole(-1, n),
        last_spacecraft=whole(-1, n),
        restart=flags(False, n),
        released=flags(True, n),
        lost=flags(False, n),
        resting=whole(0, n),
        rest_A=zeros(n, 3),
        q_RN=zeros(n, 4),
        C_AN=zeros(3, 3),
        C_mid=zeros(3, 3),
        earth_N=zeros(3),
        work=zeros(len(Slot), n, 3),
        torque_B=zeros(n, 3),
        thrust_N=zeros(n, 3),
        torque_N=zeros(n, 3),
        motor=zeros(n, w),
        peaks=zeros(n, 3),
        guessing=flags(False),
        guessed_at=zeros(),
        off_r_N=zeros(n, 3),
        off_v_N=zeros(n, 3),
    )


class Conditions(NamedTuple):
    """What faults and dispersions make of E flights; the parts' arrays have one more axis in front, of length E."""

    field_factor: Array  #: by which the gravity field is stronger than planned, shape (E,)
    series: Array  #: coefficients of each flight's own harmonics in the shape of the planned ones; of length 0: none has any
    wheels: WheelState  #: how the wheels are
    senses: Mask  #: whether the flight software has anything else than the truth, shape (E,)
    knowledge: AttitudeKnowledge  #: what it has
    camera_on: Mask  #: whose camera works, shape (E, n)
    known_lost: Mask  #: of whom the swarm knows that it is lost, shape (E, n)


def row_of(part: Any, e: int) -> Any:
    """What flight e has of a part, views."""
    return type(part)(*(row_of(each, e) if isinstance(each, tuple) else each[e] for each in part))


def rows_of(part: Any, count: int) -> Any:
    """Space for E flights, each of which has such a part."""
    return type(part)(
        *(rows_of(each, count) if isinstance(each, tuple) else np.repeat(each[None], count, axis=0) for each in part)
    )


def arrays_of(part: tuple[Any, ...]) -> list[Any]:
    """The arrays of a part and of the parts in it, in order."""
    return [array for each in part for array in (arrays_of(each) if isinstance(each, tuple) else (each,))]


def fill(part: tuple[Any, ...], values: tuple[Any, ...]) -> None:
    """Write values into the arrays of a part."""
    for array, value in zip(arrays_of(part), arrays_of(values), strict=True):
        array[...] = value
