"""The one loop of every flight: read the state, decide, hold, step; compiled, for E flights of a swarm.

A flight goes on until its tick, or until it must ask Python: for a plug-in, for something that happens, for MuJoCo's step
where that is not all there is to do. It then says what it asks for, and at its next call goes on from the stage where it
stands. Nothing here depends on how many flights are flown, so that each comes out bit for bit as if it flew alone.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from swarm_mj.compilation import allocation_free, inlined, jittable
from swarm_mj.simulator.decide import (
    actuate,
    guess_positions,
    hold_gravity,
    hold_gravity_gradient,
    is_finite,
    lie_or_stay,
    locate_targets,
    mark_new_targets,
    mount_bases,
    read_motion,
    read_rotation,
    unmount_references,
)
from swarm_mj.simulator.flights import Flights, World
from swarm_mj.simulator.kernel import move, turn_gyrostats
from swarm_mj.simulator.mujoco_step import may_step, step
from swarm_mj.simulator.slots import Slot
from swarm_mj.simulator.wheel_drive import WheelState, drive
from swarm_mj.smallbody.gravity.compiled import write_attraction
from swarm_mj.smallbody.perturbations import add_perturbations
from swarm_mj.smallbody.rotation import write_spin_dcm
from swarm_mj.spacecraft.attitude.estimation import AttitudeKnowledge, Count, FilterState, Sensors, sense
from swarm_mj.spacecraft.attitude.guidance import (
    LineOfSight,
    Reference,
    Towards,
    TrackingError,
    attitude_error,
    roll_references,
    track_line_of_sight,
)
from swarm_mj.typing import Array, Ints, Mask


class Stage(IntEnum):
    """Where in its control period a flight stands."""

    BEGIN = 0  #: nothing is decided
    HOLD = 1  #: the state is read and the attraction found
    GUIDE = 2  #: forces are held, sensors are read
    CONTROL = 3  #: references and errors are known
    DRIVE = 4  #: the law has asked for torques
    STEP = 5  #: all is decided and held


class Ask(IntEnum):
    """What a flight asks Python for."""

    PREPARE = 1  #: what is due before a decision: releases, faults, behaviours, noise
    DIVERGED = 2  #: the state is not finite
    GRAVITY = 4  #: the attraction at `Slot.R_A`, into `Slot.RHO`
    THRUST = 8  #: thrusters
    NO_TARGET = 16  #: a target makes no sense
    SLEW = 32  #: references that go by a profile
    LAW = 64  #: torques by a law in Python
    TORQUE = 128  #: a torque is not finite
    STEP = 256  #: MuJoCo's step of what is more than rigid, or no longer flies


@allocation_free
def run(
    world: World, law: Any, flights: Flights, conditions: Any, mj: Any, until: Ints, live: Mask, decide: bool
) -> int:
    """Fly each flight until its tick, or until it asks for something.

    Args:
        world: What the flights share.
        law: The control law, a C function of arrays, see `CompiledLaw`; beside `world`, for Numba looks up its type slowly.
        flights: Their states.
        conditions: What faults and dispersions make of them, `Conditions`; None: nothing.
        mj: MuJoCo's side of the only flight that is live, `MujocoFlight`; None: gyrostats are stepped here.
        until: Ticks, shape (E,).
        live: Which flights, shape (E,).
        decide: Whether the decision of the last tick is made too; it then stands until it is flown.

    Returns:
        How many ask for something, see `Flights.ask`.
    """
    asking = 0
    for e in range(live.shape[0]):
        flights.ask[e] = 0
        if not live[e] or not flights.finite[e]:
            continue
        ask = 0
        while ask == 0:
            tick = flights.tick[e]
            if flights.stage[e] != Stage.STEP:
                if tick > until[e] or (tick == until[e] and not decide and flights.stage[e] == Stage.BEGIN):
                    break
                ask = _decide(world, law, flights, conditions, e)
                continue
            if tick >= until[e]:
                break
            if mj is None:
                _step(world, flights, e)
            elif may_step(mj, flights, e):
                step(mj, flights, e, world.timesteps)
            else:
                ask = Ask.STEP.value
                continue
            flights.tick[e] += 1
            flights.stage[e] = Stage.BEGIN
        flights.ask[e] = ask
        asking += ask != 0
    return asking


@inlined
def _decide(world: World, law: Any, flights: Flights, conditions: Any, e: int) -> int:
    """Go on with the decision of flight e; returns what it asks for."""
    if flights.stage[e] == Stage.BEGIN:
        if flights.tick[e] >= flights.due[e] or _noise_is_used_up(conditions, e):
            return Ask.PREPARE.value
        if not _read(world, flights, e):
            return Ask.DIVERGED.value
        flights.stage[e] = Stage.HOLD
        if world.asks & Ask.GRAVITY.value:
            return Ask.GRAVITY.value
        _attract(world, flights, conditions, e)
    if flights.stage[e] == Stage.HOLD:
        _hold(world, flights, conditions, e)
        flights.stage[e] = Stage.GUIDE
        if world.asks & Ask.THRUST.value:
            return Ask.THRUST.value
    if flights.stage[e] == Stage.GUIDE:
        if not _guide(world, flights, conditions, e):
            return Ask.NO_TARGET.value
        flights.stage[e] = Stage.CONTROL
        if world.asks & Ask.SLEW.value:
            return Ask.SLEW.value
    if flights.stage[e] == Stage.CONTROL:
        flights.stage[e] = Stage.DRIVE
        if world.asks & Ask.LAW.value:
            return Ask.LAW.value
        _ask_law(world, law, flights.work[e], flights.torque_B[e])
    if not _are_finite(flights.torque_B[e], flights.released[e]):
        return Ask.TORQUE.value
    _drive(world, flights, conditions, e)
    flights.stage[e] = Stage.STEP
    return 0


@inlined
def _noise_is_used_up(conditions: Any, e: int) -> bool:
    if conditions is None:
        return False
    counts = conditions.knowledge.counts[e]
    return counts[Count.FILTERS] != 0 and counts[Count.NOISE] >= conditions.knowledge.noise.shape[1]


@inlined
def _read(world: World, flights: Flights, e: int) -> bool:
    """Turn the frames and read the state; whether it is finite."""
    half_hold, C_mid, work = 0.5 * world.period, flights.C_mid[e], flights.work[e]
    phase = world.phase0 + world.spin_rate * (flights.tick[e] * world.period)
    write_spin_dcm(world.C_PN, phase, flights.C_AN[e])
    write_spin_dcm(world.C_PN, phase + half_hold * world.spin_rate, C_mid)
    r_N, v_N, omega_B, speed = flights.r_N[e], flights.v_N[e], flights.omega_B[e], flights.wheel_speed[e]
    lie_or_stay(flights.resting[e], flights.rest_A[e], flights.C_AN[e], world.spin_N, r_N, v_N, omega_B, speed)
    if not is_finite(r_N, v_N, flights.q_BN[e], omega_B, speed):
        return False
    read_motion(r_N, v_N, flights.offset_N[e], C_mid, half_hold, work)
    read_rotation(omega_B, speed, world.wheel_inertia, world.wheel_axes_B, work)
    return True


@inlined
def _attract(world: World, flights: Flights, conditions: Any, e: int) -> None:
    """The body's attraction in A, into `Slot.RHO`, which is free until guidance."""
    work, cells = flights.work[e], world.cells[min(flights.tick[e], world.cells.shape[0] - 1)]
    a_A, series = work[Slot.RHO], world.field.series
    if conditions is not None:
        if conditions.series.shape[0] > 0:
            series = conditions.series[e]
    write_attraction(work[Slot.R_A], world.field, world.field.elements, series, cells, a_A)
    if conditions is not None:
        for j in range(a_A.shape[0]):
            for k in range(3):
                a_A[j, k] *= conditions.field_factor[e]


@inlined
def _hold(world: World, flights: Flights, conditions: Any, e: int) -> None:
    """Hold gravity, perturbations and the gravity-gradient torque, and read the sensors."""
    work, C_mid, t = flights.work[e], flights.C_mid[e], flights.tick[e] * world.period
    a_A, sun_N = work[Slot.RHO], flights.earth_N[e]  # the latter is free until guidance
    if world.sunlight.gm > 0.0 or world.sunlight.area_per_mass > 0.0:
        for k in range(3):
            sun_N[k] = world.sun_N[k] + (t + 0.5 * world.period) * world.sun_velocity_N[k]
        add_perturbations(work[Slot.R_A], C_mid, sun_N, world.sunlight, a_A)
    hold_gravity(a_A, C_mid, flights.resting[e], work)
    if world.gradient_gm > 0.0:
        inertia_B, released, torque_N = flights.inertia_B[e], flights.released[e], flights.torque_N[e]
        hold_gravity_gradient(flights.q_BN[e], world.gradient_gm, inertia_B, C_mid, released, torque_N, work)
    if conditions is not None:
        if conditions.senses[e]:
            known = _knowledge(conditions.knowledge, e)
            sense(flights.tick[e], flights.q_BN[e], flights.omega_B[e], world.period, known)
            _copy(conditions.knowledge.omega_BN_B[e], work[Slot.OMEGA])


@inlined
def _knowledge(c: AttitudeKnowledge, e: int) -> AttitudeKnowledge:
    """What the flight software of flight e knows; `row_of` for compiled code."""
    s, f = c.sensors, c.state
    return AttitudeKnowledge(
        Sensors(
            s.gyro_noise[e],
            s.bias_walk[e],
            s.star_tracker_noise[e],
            s.gyro_offset[e],
            s.star_tracker_offset[e],
            s.gyro_works[e],
            s.star_tracker_works[e],
        ),
        c.assumed[e],
        FilterState(
            f.q_BN[e],
            f.omega_BN_B[e],
            f.bias[e],
            f.covariance[e],
            f.true_bias[e],
            f.q_before[e],
            f.q_tracked[e],
            f.tracked[e],
            f.started[e],
        ),
        c.noise[e],
        c.counts[e],
        c.delay[e],
        c.q_past[e],
        c.omega_past[e],
        c.q_BN[e],
        c.omega_BN_B[e],
    )


@inlined
def _guide(world: World, flights: Flights, conditions: Any, e: int) -> bool:
    """References and tracking errors; whether the targets make sense."""
    kind, spacecraft, restart, earth_N = flights.kind[e], flights.spacecraft[e], flights.restart[e], flights.earth_N[e]
    if not mark_new_targets(kind, spacecraft, flights.last_kind[e], flights.last_spacecraft[e], restart):
        return False
    t = flights.tick[e] * world.period
    for k in range(3):
        earth_N[k] = world.earth_N[k] + t * world.earth_velocity_N[k]
    vector, work, q_known = flights.vector[e], flights.work[e], flights.q_BN[e]
    if flights.guessing[e]:
        guess_positions(t - flights.guessed_at[e], flights.off_r_N[e], flights.off_v_N[e], work)
    locate_targets(kind, spacecraft, vector, earth_N, world.earth_velocity_N, world.spin_N, flights.C_AN[e], work)
    if conditions is not None:
        if conditions.senses[e]:
            q_known = conditions.knowledge.q_BN[e]
    sight = LineOfSight(work[Slot.RHO], work[Slot.RHO_DOT], work[Slot.RHO_DDOT])
    reference = Reference(flights.q_RN[e], work[Slot.OMEGA_R], work[Slot.DOMEGA_R], work[Slot.LOS])
    error = TrackingError(work[Slot.SIGMA_BR], work[Slot.OMEGA_BR], work[Slot.OMEGA_R_B], work[Slot.DOMEGA_R_B])
    aiming = world.aiming
    if aiming.mounted:
        mount_bases(aiming, kind, restart, q_known, reference.q_RN)
        track_line_of_sight(sight, reference.q_RN, restart, reference)
        unmount_references(aiming, kind, reference.q_RN)
    else:
        track_line_of_sight(sight, q_known, restart, reference)
    if aiming.towards != Towards.NOTHING:
        sun_N = work[Slot.OMEGA_R_B, 0]  # free until the errors are written
        for k in range(3):
            sun_N[k] = world.sun_N[k] + t * world.sun_velocity_N[k]
        roll_references(aiming, sun_N, earth_N, work[Slot.R], work[Slot.V], work[Slot.A], sight, reference)
    attitude_error(q_known, work[Slot.OMEGA], reference, error)
    if flights.guessing[e]:
        _copy(flights.r_N[e], work[Slot.R])
        _copy(flights.v_N[e], work[Slot.V])
    return True


@inlined
def _ask_law(world: World, law: Any, work: Array, torque_B: Array) -> None:
    law(
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
def _drive(world: World, flights: Flights, conditions: Any, e: int) -> None:
    """Drive the wheels; the true rates stand in the place of the known ones again."""
    torque_B, speed, motor, peaks = flights.torque_B[e], flights.wheel_speed[e], flights.motor[e], flights.peaks[e]
    effort = 0.0
    if conditions is None:
        gain, max_torque, max_speed = world.speed_gain, world.max_torque, world.max_speed
        actuate(torque_B, world.allocation, gain, max_torque, max_speed, speed, motor, peaks)
        for j in range(motor.shape[0]):
            for w in range(motor.shape[1]):
                effort += motor[j, w] * motor[j, w]
    else:
        c = conditions.wheels
        wheels = WheelState(
            c.effectiveness[e],
            c.stuck[e],
            c.stuck_speed[e],
            c.coulomb[e],
            c.viscous[e],
            c.allocation[e],
            c.inertia[e],
            c.motor[e],
            c.bearing[e],
            c.healthy[e],
        )
        drive(torque_B, wheels, speed, world.period, world.max_torque, world.max_speed, flights.lost[e], peaks)
        for j in range(motor.shape[0]):
            for w in range(motor.shape[1]):
                motor[j, w] = wheels.motor[j, w] + wheels.bearing[j, w] if flights.released[e, j] else 0.0
                effort += wheels.motor[j, w] * wheels.motor[j, w]
        _copy(flights.omega_B[e], flights.work[e][Slot.OMEGA])
    flights.effort[e] += effort


@inlined
def _step(world: World, flights: Flights, e: int) -> None:
    """Fly the hold."""
    mass, inertia_B, torque_N = flights.mass[e], flights.inertia_B[e], flights.torque_N[e]
    move(flights.r_N[e], flights.v_N[e], flights.work[e], flights.thrust_N[e], mass, world.timesteps * world.timestep)
    turn_gyrostats(
        flights.q_BN[e],
        flights.omega_B[e],
        flights.momentum[e],
        flights.wheel_speed[e],
        flights.motor[e],
        torque_N,
        inertia_B,
        world.wheel_axes_B,
        world.wheel_inertia,
        world.timestep,
        world.timesteps,
    )


@jittable
def _copy(source: Array, target: Array) -> None:
    for j in range(source.shape[0]):
        for k in range(source.shape[1]):
            target[j, k] = source[j, k]


@allocation_free
def sense_flights(world: World, flights: Flights, conditions: Any, live: Mask, q: Array, omega: Array) -> None:
    """Put what the flight software knows in the place of attitudes, (E, n, 4), and rates, (E, n, 3), where sensors err."""
    for e in range(live.shape[0]):
        if live[e] and conditions.senses[e]:
            sense(
                flights.tick[e], flights.q_BN[e], flights.omega_B[e], world.period, _knowledge(conditions.knowledge, e)
            )
            _copy(conditions.knowledge.q_BN[e], q[e])
            _copy(conditions.knowledge.omega_BN_B[e], omega[e])
