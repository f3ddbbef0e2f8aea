"""The decisions of many flights at one instant, compiled: the same kernels as `Simulation`, flight by flight.

Nothing here depends on how many flights are decided together, so that each comes out bit for bit as if it flew alone.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit, types
from numpy.typing import NDArray

from swarm_mj.attitude.controllers.sliding_mode import write_torque
from swarm_mj.simulation.gyrostat import integrate
from swarm_mj.simulation.kernels import Slot, actuate, guide, push, sense, turn_body
from swarm_mj.smallbody.gravity.spherical_harmonics import write_series
from swarm_mj.spacecraft.gyrostat import with_wheels
from swarm_mj.spacecraft.model import NQ, NV

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Fields = tuple[Array, Array, Array, Array, Array]

#: MuJoCo's own function, found by name among the symbols that are global in the process, see `native.load_mujoco`.
_mj_step = types.ExternalFunction("mj_step", types.void(types.intp, types.intp))

_R_A, _RHO, _MOMENTUM, _OMEGA = int(Slot.R_A), int(Slot.RHO), int(Slot.MOMENTUM), int(Slot.OMEGA)
_SIGMA_BR, _OMEGA_BR = int(Slot.SIGMA_BR), int(Slot.OMEGA_BR)
_OMEGA_R_B, _DOMEGA_R_B = int(Slot.OMEGA_R_B), int(Slot.DOMEGA_R_B)


class World(NamedTuple):
    """What all flights share and nothing changes; few arrays, because each one costs a call a tenth of a microsecond.

    Attributes:
        at: Where qpos, qvel, ctrl, xfrc_applied and the asteroid's mocap quaternion begin in a row of the state, then the
            number of bodies of the model, shape (6,).
        hub: Body ids of the hubs, shape (n,).
        numbers: See `Number`; the law's parameters follow in the order of `write_torque`.
        frames: C_PN, wheel axes (rows in B), allocation (body to motor torques), and as rows spin_N [rad/s], position [m] and
            velocity [m/s] of Earth in N at the epoch, shape (4, 3, 3).
        inertia: Inertia and effective inertia, shape (2, n, 3, 3) [kg m^2].
        table: See `recursion_table`.
        series: Coefficients of the gravity field.
    """

    at: Ints
    hub: Ints
    numbers: Array
    frames: Array
    inertia: Array
    table: Array
    series: Array


class Number(IntEnum):
    """Places in `World.numbers`."""

    PHASE0 = 0  #: prime meridian angle at the epoch [rad]
    SPIN_RATE = 1  #: [rad/s]
    PERIOD = 2  #: time between two decisions [s]
    MASS = 3  #: of one spacecraft [kg]
    WHEEL_INERTIA = 4  #: spin inertia [kg m^2]
    SPEED_GAIN = 5  #: see `actuate`
    MAX_TORQUE = 6  #: [N m]
    MAX_SPEED = 7  #: [rad/s]
    RADIUS = 8  #: reference radius of the gravity field [m]
    Q_P = 9  #: pole frame as MuJoCo's quaternion, 4 numbers
    LAW = 13  #: 7 numbers; unused where torques are held


class Flights(NamedTuple):
    """What changes, for E flights of n spacecraft.

    Attributes:
        state: MuJoCo's state vectors, shape (E, size).
        tick: Control periods flown, shape (E,).
        finite: False from the instant at which a number was not, shape (E,).
        targets: Kind (`TargetKind`) and spacecraft to follow, now and at the previous decision, shape (E, 4, n).
        vector: Surface point in A [m] or direction in N, shape (E, n, 3).
        q: Attitudes and references, shape (E, 2, n, 4).
        C: Rotations from N to A now and at the middle of the hold, then position [m] and velocity [m/s] of Earth as rows,
            shape (E, 3, 3, 3).
        work: See `Slot`, shape (E, slots, n, 3).
        torque_B: Torque on the bodies, given where it is held, shape (E, n, 3) [N m].
        peaks: See `actuate`, shape (E, n, 3).
        effort: Sum of the squares of the motor torques decided so far, shape (E,) [N^2 m^2].
    """

    state: Array
    tick: Ints
    finite: NDArray[np.bool_]
    targets: Ints
    vector: Array
    q: Array
    C: Array
    work: Array
    torque_B: Array
    peaks: Array
    effort: Array


class Free(NamedTuple):
    """Arrays of the MjData of a swarm of gyrostats.

    Attributes:
        qpos: Positions, shape (7 n,).
        qvel: Velocities, shape (6 n,).
        act: Axial momenta of the wheels, shape (3 n,) [kg m^2/s].
        qacc: `qacc_smooth`, shape (6 n,).
        bias: `qfrc_bias`, shape (6 n,).
        torque: `qfrc_applied`, shape (6 n,).
        limits: Lower and upper limits of the motor torques, shape (3 n, 2) [N m].
        rates: Scratch, shape (4, 6 n).
        start: Scratch, shape (7 n,).
    """

    qpos: Array
    qvel: Array
    act: Array
    qacc: Array
    bias: Array
    torque: Array
    limits: Array
    rates: Array
    start: Array


#: What `decide` answers.
FINE, NOT_FINITE, SENSELESS = 0, 1, 2

# Numba folds plain integers into the machine code; members of an IntEnum it looks up.
_PHASE0, _SPIN_RATE, _PERIOD, _MASS = int(Number.PHASE0), int(Number.SPIN_RATE), int(Number.PERIOD), int(Number.MASS)
_WHEEL_INERTIA, _SPEED_GAIN = int(Number.WHEEL_INERTIA), int(Number.SPEED_GAIN)
_MAX_TORQUE, _MAX_SPEED, _RADIUS = int(Number.MAX_TORQUE), int(Number.MAX_SPEED), int(Number.RADIUS)
_Q_P, _LAW = int(Number.Q_P), int(Number.LAW)


@njit(cache=True, nogil=True, error_model="numpy")
def decide(world: World, flights: Flights, live: NDArray[np.bool_], held_torque: bool) -> int:
    """Forces and motor torques of the coming hold for the flights that are live, as `Simulation.decide` sets them.

    Args:
        world: See `World`.
        flights: See `Flights`.
        live: Which flights to decide, shape (E,); one whose state is not finite is left alone and marked.
        held_torque: Whether `torque_B` is given instead of coming from the control law.

    Returns:
        FINE, or what is wrong with some flight: SENSELESS targets (see `guide`) or a state that is NOT_FINITE.
    """
    worst, at, n = FINE, world.at, world.hub.shape[0]
    for e in range(live.shape[0]):
        if live[e]:
            row = flights.state[e]
            fields = (
                row[at[0] : at[0] + NQ * n],
                row[at[1] : at[1] + NV * n],
                row[at[2] : at[2] + 3 * n],
                row[at[3] : at[3] + 6 * at[5]].reshape(at[5], 6),
                row[at[4] : at[4] + 4],
            )
            worst = max(worst, _decide_one(world, flights, fields, e, held_torque))
    return worst


@njit(cache=True, nogil=True, error_model="numpy")
def fly(
    world: World, flights: Flights, fields: Fields, model: int, data: int, held_torque: bool, hold: int, periods: int
) -> int:
    """Decide and integrate so many control periods of one flight, calling MuJoCo from compiled code.

    Args:
        world: See `World`.
        flights: See `Flights`, of one flight.
        fields: qpos, qvel, ctrl, xfrc_applied and the asteroid's mocap quaternion of its MjData.
        model: Address of the MjModel.
        data: Address of the MjData.
        held_torque: See `decide`.
        hold: Timesteps in a control period.
        periods: Control periods; 0 decides once and integrates nothing.

    Returns:
        See `decide`; the flight stops where something is wrong.
    """
    if periods == 0:
        return _decide_one(world, flights, fields, 0, held_torque)
    for _ in range(periods):
        answer = _decide_one(world, flights, fields, 0, held_torque)
        if answer != FINE:
            return answer
        for _ in range(hold):
            _mj_step(model, data)
        flights.tick[0] += 1
    return FINE


@njit(cache=True, nogil=True, error_model="numpy")
def fly_gyrostats(
    world: World,
    flights: Flights,
    e: int,
    fields: Fields,
    free: Free,
    model: int,
    data: int,
    held_torque: bool,
    hold: int,
    timestep: float,
    periods: int,
) -> int:
    """The same for flight `e` of spacecraft whose wheels are momentum states.

    Args:
        world: See `World`.
        flights: See `Flights`.
        e: Which flight.
        fields: As for `fly`, with qpos and qvel laid out as if the wheels were joints.
        free: MuJoCo's own arrays, see `Free`.
        model: Address of the MjModel.
        data: Address of the MjData.
        held_torque: See `decide`.
        hold: Timesteps in a control period.
        timestep: [s].
        periods: Control periods; 0 decides once and integrates nothing.
    """
    if periods == 0:
        return _decide_one(world, flights, fields, e, held_torque)
    for _ in range(periods):
        answer = _decide_one(world, flights, fields, e, held_torque)
        if answer != FINE:
            return answer
        hold_gyrostats(world, fields, free, model, data, hold, timestep)
        flights.tick[e] += 1
    return FINE


@njit(cache=True, nogil=True, error_model="numpy")
def hold_gyrostats(world: World, fields: Fields, free: Free, model: int, data: int, hold: int, timestep: float) -> None:
    """Integrate one control period of one flight with everything held; see `fly_gyrostats`."""
    axes = world.frames[1]
    integrate(
        model,
        data,
        hold,
        timestep,
        free.qpos,
        free.qvel,
        free.act,
        free.qacc,
        free.bias,
        fields[2],
        free.limits,
        axes,
        free.torque,
        free.rates,
        free.start,
    )
    with_wheels(free.qpos, free.qvel, free.act, world.numbers[_WHEEL_INERTIA], axes, fields[0], fields[1])


@njit(cache=True, nogil=True, error_model="numpy")
def _decide_one(world: World, flights: Flights, fields: Fields, e: int, held_torque: bool) -> int:
    n, numbers, work = world.hub.shape[0], world.numbers, flights.work[e]
    qpos, qvel, ctrl, xfrc, mocap_quat = fields
    period, spin_rate = numbers[_PERIOD], numbers[_SPIN_RATE]
    t = flights.tick[e] * period
    phase = numbers[_PHASE0] + spin_rate * t
    C_AN, C_mid, q_BN, targets = flights.C[e, 0], flights.C[e, 1], flights.q[e, 0], flights.targets[e]
    flights.finite[e] = sense(
        qpos,
        qvel,
        world.frames[0],
        phase,
        0.5 * period * spin_rate,
        0.5 * period,
        numbers[_WHEEL_INERTIA],
        world.frames[1],
        work,
        q_BN,
        C_AN,
        C_mid,
    )
    if not flights.finite[e]:
        return NOT_FINITE
    a_A = work[_RHO]  # free until guidance writes there
    write_series(work[_R_A], numbers[_RADIUS], world.table, world.series, a_A)
    push(a_A, C_mid, numbers[_MASS], world.hub, xfrc, work)
    turn_body(numbers[_Q_P : _Q_P + 4], phase, mocap_quat)
    spin_N, planet = world.frames[3, 0], flights.C[e, 2]
    for k in range(3):
        planet[0, k], planet[1, k] = world.frames[3, 1, k] + t * world.frames[3, 2, k], world.frames[3, 2, k]
    sensible = guide(
        targets[0],
        targets[1],
        flights.vector[e],
        planet[0],
        planet[1],
        spin_N,
        C_AN,
        q_BN,
        targets[2:],
        np.empty(n, np.bool_),
        flights.q[e, 1],
        work,
    )
    if not held_torque:
        _control(world, work, flights.torque_B[e])
    limits = numbers[_SPEED_GAIN : _MAX_SPEED + 1]
    actuate(flights.torque_B[e], world.frames[2], limits[0], limits[1], limits[2], work, ctrl, flights.peaks[e])
    for k in range(3 * n):
        flights.effort[e] += ctrl[k] * ctrl[k]
    return FINE if sensible else SENSELESS


@njit(cache=True, nogil=True, error_model="numpy")
def _control(world: World, work: Array, torque_B: Array) -> None:
    law = world.numbers[_LAW:]
    write_torque(
        work[_SIGMA_BR],
        work[_OMEGA_BR],
        work[_OMEGA],
        work[_OMEGA_R_B],
        work[_DOMEGA_R_B],
        work[_MOMENTUM],
        world.inertia[0],
        world.inertia[1],
        law[0],
        law[1],
        law[2],
        law[3],
        law[4],
        law[5],
        law[6],
        torque_B,
    )
