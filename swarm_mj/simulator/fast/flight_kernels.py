"""Whole flights in compiled code: decisions by the same kernels as the Python loop's, and MuJoCo stepping in between.

Nothing here depends on how many flights are flown, so that each comes out bit for bit as if it flew alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.simulator.fast.integrator import copy_state, integrate
from swarm_mj.simulator.fast.kernels import (
    actuate,
    guide,
    hold_gravity,
    hold_gravity_gradient,
    locate_targets,
    mark_new_targets,
    read_state,
    turn_frames,
    write_body_quaternion,
)
from swarm_mj.simulator.fast.mj_memory import MjBatch, MjView, mj_view
from swarm_mj.simulator.slots import Slot
from swarm_mj.smallbody.gravity.compiled import CompiledField, write_attraction
from swarm_mj.smallbody.perturbations import Sunlight, add_perturbations
from swarm_mj.spacecraft.control.compiled import call_law
from swarm_mj.spacecraft.model import NQ, NV
from swarm_mj.typing import Array, Ints, Mask, inlined, jittable, kernel


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
        gradient_gm: Gravitational parameter whose gradient turns the spacecraft [m^3/s^2]; 0: none does.
        wheel_inertia: Spin inertia of a wheel [kg m^2].
        wheel_axes_B: Rows, shape (3, 3).
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
        qvel: Velocities in N, body rates and wheel speeds, shape (E, 9 n).
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


def allocate_flights(count: int, n: int) -> Flights:
    """E flights of n spacecraft before their start."""
    return Flights(
        tick=np.zeros(count, np.int64),
        finite=np.ones(count, np.bool_),
        effort=np.zeros(count),
        qpos=np.zeros((count, NQ * n)),
        qvel=np.zeros((count, NV * n)),
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


#: A tick that no flight reaches.
NEVER = 2**62
#: What came of a decision, the worst last.
FINE, NOT_FINITE, NO_SUCH_TARGET = 0, 1, 2
#: Parts of a control period: set forces and motor torques of the coming hold, integrate it; or both, as often as asked.
DECIDE, ADVANCE = 1, 2
WHOLE = DECIDE | ADVANCE


@kernel
def fly(world: World, flights: Flights, batch: MjBatch, timesteps: int, part: int, live: Mask, until: Ints) -> int:
    """Decide and integrate, one flight after the other, until each has reached a tick or something is wrong with it.

    One function for whole periods and for their parts, because each entry point is compiled with all it calls.

    Args:
        world: What the flights share.
        flights: Their states.
        batch: Their MjData.
        timesteps: Of MuJoCo in a control period.
        part: WHOLE periods, or only once DECIDE or ADVANCE.
        live: Which flights, shape (E,).
        until: Ticks, shape (E,); a flight that has reached its own is left alone.

    Returns:
        FINE, NO_SUCH_TARGET (see `mark_new_targets`) or NOT_FINITE (a state or a torque): the worst that came of a decision.
    """
    worst = FINE
    for e in range(live.shape[0]):
        if not live[e] or flights.tick[e] >= until[e]:
            continue
        mj = mj_view(batch, e)
        copy_state(mj, flights.qpos[e], flights.qvel[e])
        while flights.tick[e] < until[e]:
            if part & DECIDE:
                outcome = _decide(world, flights, e, mj)
                worst = max(worst, outcome)
                if outcome != FINE:
                    break
            if part & ADVANCE:
                integrate(mj, timesteps)
                copy_state(mj, flights.qpos[e], flights.qvel[e])
                flights.tick[e] += 1
            if part != WHOLE:
                break
    return worst


@inlined
def _decide(world: World, flights: Flights, e: int, mj: MjView) -> int:
    """Set forces and motor torques of the coming hold of one flight."""
    work, torque_B, t = flights.work[e], flights.torque_B[e], flights.tick[e] * world.period
    flights.finite[e] = _read(world, flights, e, t)
    if not flights.finite[e]:
        return NOT_FINITE
    _hold_forces(world, flights, e, mj, t)
    if not _guide(world, flights, e, t):
        return NO_SUCH_TARGET
    if world.law != 0:
        _ask_law(world, work, torque_B)
    total = 0.0
    for j in range(torque_B.shape[0]):
        if not flights.released[e, j]:
            torque_B[j] = 0.0
        total += torque_B[j, 0] + torque_B[j, 1] + torque_B[j, 2]
    if not np.isfinite(total):
        flights.finite[e] = False
        return NOT_FINITE
    speed_gain, max_torque, max_speed = world.speed_gain, world.max_torque, world.max_speed
    actuate(torque_B, world.allocation, speed_gain, max_torque, max_speed, work, mj.ctrl, flights.peaks[e])
    for k in range(mj.ctrl.shape[0]):
        flights.effort[e] += mj.ctrl[k] * mj.ctrl[k]
    return FINE


@inlined
def _read(world: World, flights: Flights, e: int, t: float) -> bool:
    phase, half_hold, C_mid = world.phase0 + world.spin_rate * t, 0.5 * world.period, flights.C_mid[e]
    turn_frames(world.C_PN, phase, half_hold * world.spin_rate, flights.C_AN[e], C_mid)
    qpos, qvel, inertia, axes_B = flights.qpos[e], flights.qvel[e], world.wheel_inertia, world.wheel_axes_B
    return read_state(qpos, qvel, C_mid, half_hold, inertia, axes_B, flights.q_BN[e], flights.work[e])


@inlined
def _hold_forces(world: World, flights: Flights, e: int, mj: MjView, t: float) -> None:
    work, C_mid, tick = flights.work[e], flights.C_mid[e], flights.tick[e]
    a_A = work[Slot.RHO]  # free until guidance writes there
    if not _recall(world.pulls, tick, work[Slot.R_A], a_A):
        write_attraction(work[Slot.R_A], world.field, world.field.series, a_A)
        _add_sunlight(world, work[Slot.R_A], C_mid, t, flights.earth_N[e], a_A)
        _remember(world.pulls, tick, work[Slot.R_A], a_A)
    hold_gravity(a_A, C_mid, world.mass, world.hub, mj.xfrc_applied, work)
    if world.gradient_gm > 0.0:
        inertia_B, forces = world.inertia_B, mj.xfrc_applied
        hold_gravity_gradient(flights.q_BN[e], world.gradient_gm, inertia_B, C_mid, world.hub, forces, work)
    write_body_quaternion(world.q_P, world.phase0 + world.spin_rate * t, mj.asteroid_quat)


@inlined
def _add_sunlight(world: World, r_A: Array, C_mid: Array, t: float, sun_N: Array, a_A: Array) -> None:
    if world.sunlight.gm > 0.0 or world.sunlight.area_per_mass > 0.0:
        for k in range(3):
            sun_N[k] = world.sun_N[k] + (t + 0.5 * world.period) * world.sun_velocity_N[k]
        add_perturbations(r_A, C_mid, sun_N, world.sunlight, a_A)


@jittable
def _recall(pulls: Array, tick: int, r_A: Array, a_A: Array) -> bool:
    """Write the accelerations that were found at these very places at this tick; whether there were any."""
    if tick >= pulls.shape[0]:
        return False
    for j in range(r_A.shape[0]):
        for k in range(3):
            if pulls[tick, j, k] != r_A[j, k]:
                return False
            a_A[j, k] = pulls[tick, j, 3 + k]
    return True


@jittable
def _remember(pulls: Array, tick: int, r_A: Array, a_A: Array) -> None:
    if tick < pulls.shape[0]:
        for j in range(r_A.shape[0]):
            for k in range(3):
                pulls[tick, j, k], pulls[tick, j, 3 + k] = r_A[j, k], a_A[j, k]


@inlined
def _guide(world: World, flights: Flights, e: int, t: float) -> bool:
    kind, spacecraft, restart, earth_N = flights.kind[e], flights.spacecraft[e], flights.restart[e], flights.earth_N[e]
    if not mark_new_targets(kind, spacecraft, flights.last_kind[e], flights.last_spacecraft[e], restart):
        return False
    for k in range(3):
        earth_N[k] = world.earth_N[k] + t * world.earth_velocity_N[k]
    vector, work = flights.vector[e], flights.work[e]
    locate_targets(kind, spacecraft, vector, earth_N, world.earth_velocity_N, world.spin_N, flights.C_AN[e], work)
    guide(flights.q_BN[e], restart, flights.q_RN[e], work)
    return True


@inlined
def _ask_law(world: World, work: Array, torque_B: Array) -> None:
    call_law(
        world.law,
        work[Slot.SIGMA_BR],
        work[Slot.OMEGA_BR],
        work[Slot.OMEGA],
        work[Slot.OMEGA_R_B],
        work[Slot.DOMEGA_R_B],
        work[Slot.MOMENTUM],
        world.inertia_B,
        world.inertia_effective_B,
        world.law_numbers,
        torque_B,
    )


@kernel
def split_states(qpos: Array, qvel: Array, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
    """Copy states, shape (E, n, 10) and (E, n, 9), to positions, velocities, attitudes, rates and wheel speeds."""
    for e in range(qpos.shape[0]):
        for j in range(qpos.shape[1]):
            for k in range(3):
                r[e, j, k], v[e, j, k] = qpos[e, j, k], qvel[e, j, k]
                omega[e, j, k], wheel[e, j, k] = qvel[e, j, 3 + k], qvel[e, j, 6 + k]
            for k in range(4):
                q[e, j, k] = qpos[e, j, 3 + k]
