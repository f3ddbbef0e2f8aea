"""Whole flights in compiled code: decisions by the same kernels as `Simulation`'s, and MuJoCo stepping in between.

Nothing here depends on how many flights are flown, so that each comes out bit for bit as if it flew alone.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from swarm_mj.simulator.fast.integrator import integrate, lay_out
from swarm_mj.simulator.fast.kernels import Slot, actuate, guide, push, sense, turn_body
from swarm_mj.simulator.fast.mj_memory import MjBatch, MjView, mj_view
from swarm_mj.smallbody.gravity.spherical_harmonics import write_series
from swarm_mj.spacecraft.control.compiled import call_law
from swarm_mj.spacecraft.model import NQ, NV
from swarm_mj.typing import Array, Ints, Mask, kernel

_R_A, _RHO, _MOMENTUM, _OMEGA = int(Slot.R_A), int(Slot.RHO), int(Slot.MOMENTUM), int(Slot.OMEGA)
_SIGMA_BR, _OMEGA_BR = int(Slot.SIGMA_BR), int(Slot.OMEGA_BR)
_OMEGA_R_B, _DOMEGA_R_B = int(Slot.OMEGA_R_B), int(Slot.DOMEGA_R_B)


class World(NamedTuple):
    """What all flights share and nothing changes; few arrays, because each one costs a call a tenth of a microsecond.

    Attributes:
        law: Address of the compiled control law; 0 where torques are held.
        hub: Body ids of the hubs, shape (n,).
        numbers: See `Number`; the law's own follow.
        frames: C_PN, wheel axes (rows in B), allocation (body to motor torques), and as rows spin_N [rad/s], position [m] and
            velocity [m/s] of Earth in N at the epoch, shape (4, 3, 3).
        inertia: Inertia and effective inertia, shape (2, n, 3, 3) [kg m^2].
        table: See `recursion_table`.
        series: Coefficients of the gravity field.
    """

    law: int
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
    LAW = 13  #: as many as the law has


class Flights(NamedTuple):
    """What changes, for E flights of n spacecraft.

    Attributes:
        qpos: Positions, attitudes and wheel angles, shape (E, 10 n).
        qvel: Velocities in N, body rates and wheel speeds, shape (E, 9 n).
        tick: Control periods flown, shape (E,).
        finite: False from the instant at which a number of the state or a torque was not, shape (E,).
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

    qpos: Array
    qvel: Array
    tick: Ints
    finite: Mask
    targets: Ints
    vector: Array
    q: Array
    C: Array
    work: Array
    torque_B: Array
    peaks: Array
    effort: Array


def allocate_flights(count: int, n: int) -> Flights:
    """E flights of n spacecraft before their start."""
    return Flights(
        qpos=np.zeros((count, NQ * n)),
        qvel=np.zeros((count, NV * n)),
        tick=np.zeros(count, np.int64),
        finite=np.ones(count, np.bool_),
        targets=np.full((count, 4, n), -1, np.int64),
        vector=np.zeros((count, n, 3)),
        q=np.zeros((count, 2, n, 4)),
        C=np.zeros((count, 3, 3, 3)),
        work=np.zeros((count, len(Slot), n, 3)),
        torque_B=np.zeros((count, n, 3)),
        peaks=np.zeros((count, n, 3)),
        effort=np.zeros(count),
    )


#: A tick that no flight reaches.
NEVER = 2**62
#: What came of a decision, the worst last.
FINE, NOT_FINITE, NO_SUCH_TARGET = 0, 1, 2
#: What to do of a control period.
DECIDE, ADVANCE = 1, 2
WHOLE = DECIDE | ADVANCE

# Numba folds plain integers into the machine code; members of an IntEnum it looks up.
_PHASE0, _SPIN_RATE, _PERIOD, _MASS = int(Number.PHASE0), int(Number.SPIN_RATE), int(Number.PERIOD), int(Number.MASS)
_WHEEL_INERTIA, _SPEED_GAIN = int(Number.WHEEL_INERTIA), int(Number.SPEED_GAIN)
_MAX_TORQUE, _MAX_SPEED, _RADIUS = int(Number.MAX_TORQUE), int(Number.MAX_SPEED), int(Number.RADIUS)
_Q_P, _LAW = int(Number.Q_P), int(Number.LAW)


@kernel
def fly(world: World, flights: Flights, swarms: MjBatch, hold: int, part: int, live: Mask, until: Ints) -> int:
    """Decide and integrate, one flight after the other, until each has reached a tick or something is wrong with it.

    One function for whole periods and for their parts, because each entry point is compiled with all it calls.

    Args:
        world: See `World`.
        flights: See `Flights`.
        swarms: Their MjData.
        hold: Timesteps in a control period.
        part: WHOLE periods; or once DECIDE, set forces and motor torques of the coming hold, or ADVANCE, integrate it.
        live: Which flights, shape (E,).
        until: Ticks, shape (E,); a flight that has reached its own is left alone.

    Returns:
        FINE, NO_SUCH_TARGET (targets, see `guide`) or NOT_FINITE (a state or a torque): the worst that came of a decision.
    """
    worst = FINE
    for e in range(live.shape[0]):
        if not live[e] or flights.tick[e] >= until[e]:
            continue
        motion = mj_view(swarms, e)
        lay_out(motion, flights.qpos[e], flights.qvel[e])
        while flights.tick[e] < until[e]:
            if part & DECIDE:
                answer = _decide(world, flights, e, motion)
                worst = max(worst, answer)
                if answer != FINE:
                    break
            if part & ADVANCE:
                integrate(motion, hold)
                lay_out(motion, flights.qpos[e], flights.qvel[e])
                flights.tick[e] += 1
            if part != WHOLE:
                break
    return worst


@kernel
def _decide(world: World, flights: Flights, e: int, motion: MjView) -> int:
    numbers, work, ctrl = world.numbers, flights.work[e], motion.ctrl
    period, spin_rate = numbers[_PERIOD], numbers[_SPIN_RATE]
    phase = numbers[_PHASE0] + spin_rate * (flights.tick[e] * period)
    flights.finite[e] = sense(
        flights.qpos[e],
        flights.qvel[e],
        world.frames[0],
        phase,
        0.5 * period * spin_rate,
        0.5 * period,
        numbers[_WHEEL_INERTIA],
        world.frames[1],
        work,
        flights.q[e, 0],
        flights.C[e, 0],
        flights.C[e, 1],
    )
    if not flights.finite[e]:
        return NOT_FINITE
    a_A = work[_RHO]  # free until guidance writes there
    write_series(work[_R_A], numbers[_RADIUS], world.table, world.series, a_A)
    push(a_A, flights.C[e, 1], numbers[_MASS], world.hub, motion.force, work)
    turn_body(numbers[_Q_P : _Q_P + 4], phase, motion.asteroid)
    if not _guide(world, flights, e):
        return NO_SUCH_TARGET
    if world.law != 0:
        _control(world, work, flights.torque_B[e])
    total = 0.0
    for j in range(world.hub.shape[0]):
        total += flights.torque_B[e, j, 0] + flights.torque_B[e, j, 1] + flights.torque_B[e, j, 2]
    if not np.isfinite(total):
        flights.finite[e] = False
        return NOT_FINITE
    limits = numbers[_SPEED_GAIN : _MAX_SPEED + 1]
    actuate(flights.torque_B[e], world.frames[2], limits[0], limits[1], limits[2], work, ctrl, flights.peaks[e])
    for k in range(ctrl.shape[0]):
        flights.effort[e] += ctrl[k] * ctrl[k]
    return FINE


@kernel
def _guide(world: World, flights: Flights, e: int) -> bool:
    targets, earth, t = flights.targets[e], flights.C[e, 2], flights.tick[e] * world.numbers[_PERIOD]
    for k in range(3):
        earth[0, k], earth[1, k] = world.frames[3, 1, k] + t * world.frames[3, 2, k], world.frames[3, 2, k]
    return guide(
        targets[0],
        targets[1],
        flights.vector[e],
        earth[0],
        earth[1],
        world.frames[3, 0],
        flights.C[e, 0],
        flights.q[e, 0],
        targets[2:],
        np.empty(world.hub.shape[0], np.bool_),
        flights.q[e, 1],
        flights.work[e],
    )


@kernel
def _control(world: World, work: Array, torque_B: Array) -> None:
    call_law(
        world.law,
        work[_SIGMA_BR],
        work[_OMEGA_BR],
        work[_OMEGA],
        work[_OMEGA_R_B],
        work[_DOMEGA_R_B],
        work[_MOMENTUM],
        world.inertia[0],
        world.inertia[1],
        world.numbers[_LAW:],
        torque_B,
    )


@kernel
def read(qpos: Array, qvel: Array, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
    """Copy states, shape (E, n, 10) and (E, n, 9), to positions, velocities, attitudes, rates and wheel speeds."""
    for e in range(qpos.shape[0]):
        for j in range(qpos.shape[1]):
            for k in range(3):
                r[e, j, k], v[e, j, k] = qpos[e, j, k], qvel[e, j, k]
                omega[e, j, k], wheel[e, j, k] = qvel[e, j, 3 + k], qvel[e, j, 6 + k]
            for k in range(4):
                q[e, j, k] = qpos[e, j, 3 + k]
