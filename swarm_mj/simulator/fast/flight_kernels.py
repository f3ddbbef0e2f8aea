"""Whole flights in compiled code: decisions by the same kernels as the Python loop's, and MuJoCo stepping in between.

Nothing here depends on how many flights are flown, so that each comes out bit for bit as if it flew alone.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.simulator.fast.conditions import (
    Conditions,
    call_command,
    call_sense,
    inertia_of,
    known_attitudes,
    remember,
    series_of,
    weigh_flight,
)
from swarm_mj.simulator.fast.flights import Flights, World
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
from swarm_mj.smallbody.gravity.compiled import write_attraction
from swarm_mj.smallbody.perturbations import add_perturbations
from swarm_mj.spacecraft.control.compiled import call_law
from swarm_mj.typing import Array, Ints, Mask, inlined, jittable, kernel, lean

#: What came of a decision, the worst last.
FINE, NOT_FINITE, NO_SUCH_TARGET = 0, 1, 2
#: Parts of a control period: set forces and motor torques of the coming hold, integrate it; or both, as often as asked.
DECIDE, ADVANCE = 1, 2
WHOLE = DECIDE | ADVANCE


@lean
def fly(
    world: World,
    flights: Flights,
    batch: MjBatch,
    conditions: Conditions,
    timesteps: int,
    part: int,
    live: Mask,
    until: Ints,
) -> int:
    """Decide and integrate, one flight after the other, until each has reached a tick or something is wrong with it.

    One function for whole periods and for their parts, because each entry point is compiled with all it calls.

    Args:
        world: What the flights share.
        flights: Their states.
        batch: Their MjData.
        conditions: What faults and dispersions make of them.
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
                outcome = _decide(world, flights, conditions, e, mj)
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
def _decide(world: World, flights: Flights, conditions: Conditions, e: int, mj: MjView) -> int:
    """Set forces and motor torques of the coming hold of one flight."""
    work, torque_B, t = flights.work[e], flights.torque_B[e], flights.tick[e] * world.period
    _turn_frames(world, flights, e, mj)
    flights.finite[e] = _read(world, flights, e)
    if not flights.finite[e]:
        return NOT_FINITE
    planned, own_sensors = conditions[e].command == 0, conditions[e].sense
    _hold_forces(world, flights, conditions, e, mj, t)
    if own_sensors != 0:
        call_sense(own_sensors, conditions, e, flights.tick[e], world.period, flights.q_BN[e], work[Slot.OMEGA])
    if not _guide(world, flights, known_attitudes(conditions, e, flights.q_BN[e]), e, t):
        return NO_SUCH_TARGET
    if world.law != 0:
        _ask_law(world, work, torque_B)
    if own_sensors != 0:
        _put_rates_back(flights.qvel[e], work[Slot.OMEGA])
    if not _are_finite(torque_B, flights.released[e]):
        flights.finite[e] = False
        for j in range(torque_B.shape[0]):
            if flights.restart[e, j]:
                flights.last_kind[e, j] = -1  # whoever decides anew starts anew
        return NOT_FINITE
    if planned:
        speed_gain, max_torque, max_speed = world.speed_gain, world.max_torque, world.max_speed
        actuate(torque_B, world.allocation, speed_gain, max_torque, max_speed, work, mj.ctrl, flights.peaks[e])
        for k in range(mj.ctrl.shape[0]):
            flights.effort[e] += mj.ctrl[k] * mj.ctrl[k]
    else:
        remember(conditions, e, flights.qvel[e], work[Slot.R])
        wheels, released, peaks = conditions[e].command, flights.released[e], flights.peaks[e]
        flights.effort[e] += call_command(wheels, conditions, e, torque_B, released, mj.ctrl, peaks)
    return FINE


@jittable
def _put_rates_back(qvel: Array, omega: Array) -> None:
    n = omega.shape[0]
    for j in range(n):
        for k in range(3):
            omega[j, k] = qvel[qvel.shape[0] // n * j + 3 + k]


@jittable
def _are_finite(torque_B: Array, released: Mask) -> bool:
    """Whether all torques are; those of spacecraft aboard the mothership are set to zero."""
    total = 0.0
    for j in range(torque_B.shape[0]):
        if not released[j]:
            for k in range(3):
                torque_B[j, k] = 0.0
        total += torque_B[j, 0] + torque_B[j, 1] + torque_B[j, 2]
    return bool(np.isfinite(total))


@inlined
def _turn_frames(world: World, flights: Flights, e: int, mj: MjView) -> None:
    """Write C_AN, C_mid and the body's attitude; remembered, because they are the same in all flights at a tick."""
    tick, known, C_AN, C_mid = flights.tick[e], world.frames, flights.C_AN[e], flights.C_mid[e]
    q = mj.asteroid_quat
    if tick >= known.shape[0] or known[tick, 22] == 0.0:
        phase = world.phase0 + world.spin_rate * (tick * world.period)
        turn_frames(world.C_PN, phase, 0.5 * world.period * world.spin_rate, C_AN, C_mid)
        write_body_quaternion(world.q_P, phase, q)
        if tick < known.shape[0]:
            for k in range(9):
                known[tick, k], known[tick, 9 + k] = C_AN[k // 3, k % 3], C_mid[k // 3, k % 3]
            for k in range(4):
                known[tick, 18 + k] = q[k]
            known[tick, 22] = 1.0
    else:
        for i in range(3):
            for k in range(3):
                C_AN[i, k], C_mid[i, k] = known[tick, 3 * i + k], known[tick, 9 + 3 * i + k]
        for k in range(4):
            q[k] = known[tick, 18 + k]


@inlined
def _read(world: World, flights: Flights, e: int) -> bool:
    half_hold, C_mid, qpos, qvel = 0.5 * world.period, flights.C_mid[e], flights.qpos[e], flights.qvel[e]
    inertia, axes_B = world.wheel_inertia, world.wheel_axes_B
    return read_state(qpos, qvel, C_mid, half_hold, inertia, axes_B, flights.q_BN[e], flights.work[e])


@inlined
def _hold_forces(world: World, flights: Flights, conditions: Conditions, e: int, mj: MjView, t: float) -> None:
    work, C_mid, tick, forces = flights.work[e], flights.C_mid[e], flights.tick[e], mj.xfrc_applied
    a_A, r_A = work[Slot.RHO], work[Slot.R_A]  # the former is free until guidance writes there
    own_field = conditions[e].own_field != 0
    if own_field or not _recall(world.pulls, tick, r_A, a_A):
        series = series_of(conditions, e, world.field.series)
        write_attraction(r_A, world.field, series, world.cells[min(tick, world.cells.shape[0] - 1)], a_A)
        if own_field:
            _strengthen(conditions[e].field_factor, a_A)
        _add_sunlight(world, r_A, C_mid, t, flights.earth_N[e], a_A)
        if not own_field:
            _remember(world.pulls, tick, r_A, a_A)
    hold_gravity(a_A, C_mid, world.mass, world.hub, forces, work)
    weigh_flight(conditions, e, world.hub, forces)
    if world.gradient_gm > 0.0:
        inertia_B = inertia_of(conditions, e, world.inertia_B)
        hold_gravity_gradient(flights.q_BN[e], world.gradient_gm, inertia_B, C_mid, world.hub, forces, work)
        for j in range(world.hub.shape[0]):
            if not flights.released[e, j]:
                for k in range(3):
                    forces[world.hub[j], 3 + k] = 0.0


@jittable
def _strengthen(factor: float, a_A: Array) -> None:
    for j in range(a_A.shape[0]):
        for k in range(3):
            a_A[j, k] *= factor


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
def _guide(world: World, flights: Flights, q_known: Array, e: int, t: float) -> bool:
    kind, spacecraft, restart, earth_N = flights.kind[e], flights.spacecraft[e], flights.restart[e], flights.earth_N[e]
    if not mark_new_targets(kind, spacecraft, flights.last_kind[e], flights.last_spacecraft[e], restart):
        return False
    for k in range(3):
        earth_N[k] = world.earth_N[k] + t * world.earth_velocity_N[k]
    vector, work = flights.vector[e], flights.work[e]
    locate_targets(kind, spacecraft, vector, earth_N, world.earth_velocity_N, world.spin_N, flights.C_AN[e], work)
    guide(q_known, restart, flights.q_RN[e], work)
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


@lean
def split_states(qpos: Array, qvel: Array, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
    """Copy states, shape (E, n, 7 + w) and (E, n, 6 + w), to positions, velocities, attitudes, rates and wheel speeds."""
    for e in range(qpos.shape[0]):
        for j in range(qpos.shape[1]):
            for k in range(3):
                r[e, j, k], v[e, j, k], omega[e, j, k] = qpos[e, j, k], qvel[e, j, k], qvel[e, j, 3 + k]
            for k in range(wheel.shape[2]):
                wheel[e, j, k] = qvel[e, j, 6 + k]
            for k in range(4):
                q[e, j, k] = qpos[e, j, 3 + k]


@kernel
def sense_flights(conditions: Conditions, live: Mask, tick: Ints, period: float, q: Array, omega: Array) -> None:
    """Put what the flight software knows in the place of attitudes, (E, n, 4), and rates, (E, n, 3), where sensors err."""
    for e in range(live.shape[0]):
        if live[e] and conditions[e].sense != 0:
            call_sense(conditions[e].sense, conditions, e, tick[e], period, q[e], omega[e])
            known = known_attitudes(conditions, e, q[e])
            for j in range(known.shape[0]):
                for k in range(4):
                    q[e, j, k] = known[j, k]
