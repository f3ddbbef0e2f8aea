"""One decision call by call, with all that compiled code does not know: plug-ins, thrusters, faults.

It reads the state, evaluates the forces of the coming hold at its middle, asks behaviour and control law, and leaves forces and
motor torques in MuJoCo's arrays; from the same kernels and to the same bits as `flight_kernels.fly`.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.errors import PluginError, SimulationError
from swarm_mj.mission.behaviors import Targets
from swarm_mj.simulator import multibody
from swarm_mj.simulator.fast import kernels
from swarm_mj.simulator.fault_injection import FaultInjection
from swarm_mj.simulator.loop_state import LAW_SLOTS, LoopState, control_input
from swarm_mj.simulator.plugin_calls import (
    BehaviorCalls,
    ControllerCalls,
    divergence_of,
    no_such_target,
    view_of,
)
from swarm_mj.simulator.propulsion import Propulsion
from swarm_mj.simulator.slews import Slews
from swarm_mj.simulator.slots import Slot
from swarm_mj.smallbody.perturbations import add_perturbations
from swarm_mj.spacecraft.control.base import Controller
from swarm_mj.spacecraft.gyrostat import with_wheels
from swarm_mj.typing import Array


def decide(
    state: LoopState,
    behaviors: BehaviorCalls,
    law: ControllerCalls,
    injection: FaultInjection | None,
    propulsion: Propulsion | None = None,
    slews: Slews | None = None,
) -> Targets:
    """Set forces and motor torques of the coming hold.

    Args:
        state: Of the flight; left with what was decided.
        behaviors: The behaviour of the flight.
        law: Its control law.
        injection: Its faults, dispersions and fourth wheels; None: it has none.
        propulsion: Its thrusters; None: it has none.
        slews: Profiles of its turns to new targets; None: the law turns as it does.

    Raises:
        SimulationError: The state is no longer finite.
        PluginError: A plug-in fails, answers something else than its protocol says, or aims at what is not there.
    """
    qvel = _read_state(state, law.controller, injection)
    if injection is not None:
        injection.begin(state.time, qvel, state.work)
    _hold_forces(state, injection)
    view = view_of(state.time, state.C_AN.copy(), *state.rows())
    if injection is not None:
        view = injection.seen_by(view)
    state.targets, q_known = behaviors.ask(0, view, state.tick), state.q_BN
    if injection is not None:
        state.targets = injection.faults.redirect(state.time, state.targets, state.work[Slot.R])
        q_known = injection.know(state.tick, state.q_BN, state.work)
    if propulsion is not None and propulsion.law is not None:
        _thrust(state, q_known, injection, propulsion)
    _guide(state, q_known)
    if slews is not None:
        slews.follow(q_known)
    torque_B = _torque(state, law, injection)
    aboard = ~state.released
    if aboard.any():
        torque_B = np.where(aboard[:, None], 0.0, torque_B)
    if injection is not None:
        injection.actuate(torque_B, state.motor_torque, state.peaks)
        injection.forget(state.work)
    else:
        _actuate(state, torque_B)
    if aboard.any():
        state.motor_torque.reshape(state.model.n, -1)[aboard] = 0.0
        state.data.xfrc_applied[state.hub[aboard], 3:] = 0.0
    state.command_motors()
    return state.targets


def divergence(state: LoopState, controller: Controller) -> str:
    """In words, why a flight cannot go on."""
    return divergence_of(np.hstack(state.rows()), state.torque_B, controller, state.model.names, state.time)


def _read_state(state: LoopState, controller: Controller, injection: FaultInjection | None) -> Array:
    """Read the state into the work arrays, and turn the frames of the body; returns the velocities, shape (n (6 + w),)."""
    environment, half_hold, data = state.environment, 0.5 * state.period, state.data
    phase = environment.phase0 + environment.spin_rate * state.time
    kernels.turn_frames(state.C_PN, phase, half_hold * environment.spin_rate, state.C_AN, state.C_mid)
    kernels.write_body_quaternion(state.q_P, phase, data.mocap_quat[state.model.asteroid_mocap])
    if injection is not None:
        injection.rest(environment.C_AN(state.time))
    finite, qvel = _read(state, half_hold)
    if not finite:
        if injection is None:
            raise SimulationError(divergence(state, controller))
        injection.diverged(state.time)
        _, qvel = _read(state, half_hold)
    return qvel


def _read(state: LoopState, half_hold: float) -> tuple[bool, Array]:
    qpos, qvel = _rows(state)
    inertia, axes_B = state.properties.wheel_spin_inertia, state.wheel_axes_B
    return kernels.read_state(qpos, qvel, state.C_mid, half_hold, inertia, axes_B, state.q_BN, state.work), qvel


def _rows(state: LoopState) -> tuple[Array, Array]:
    data = state.data
    if state.model.own is not None:
        qpos_rows, qvel_rows = state.rows()
        return qpos_rows.reshape(-1), qvel_rows.reshape(-1)
    if state.model.wheels == "bodies":
        return data.qpos, data.qvel
    spin, axes = state.properties.wheel_spin_inertia, state.wheel_axes_B
    with_wheels(data.qpos, data.qvel, data.act, spin, axes, state.qpos, state.qvel)
    return state.qpos, state.qvel


def _hold_forces(state: LoopState, injection: FaultInjection | None) -> None:
    """Hold gravity and perturbations at the middle of the hold, and the gravity-gradient torque."""
    work, forces, C_mid, environment = state.work, state.data.xfrc_applied, state.C_mid, state.environment
    if state.model.own is not None:
        multibody.evaluate_at_centres(state)
    a_A = environment.attraction_A(work[Slot.R_A])
    if environment.perturbed:
        sun_N, a_A = environment.sun.at(state.time + 0.5 * state.period), a_A.copy()
        add_perturbations(work[Slot.R_A], C_mid, sun_N, environment.sunlight, a_A)
    kernels.hold_gravity(a_A, C_mid, state.properties.mass, state.hub, forces, work)
    if state.model.own is not None:
        multibody.weigh_bodies(state)
    if injection is not None:
        injection.weigh(forces)
    if state.gradient_gm > 0.0 and state.model.own is None:
        inertia_B = state.inputs.inertia_B if injection is None else injection.faults.inertia_B
        kernels.hold_gravity_gradient(state.q_BN, state.gradient_gm, inertia_B, C_mid, state.hub, forces, work)


def _thrust(state: LoopState, q_known: Array, injection: FaultInjection | None, propulsion: Propulsion) -> None:
    known, n = state.work[Slot.OMEGA], state.model.n
    true = known if injection is None else injection.true_rates
    working = np.ones(n, np.bool_) if injection is None else ~injection.faults.lost
    state.targets = propulsion.aim(state.time, state.targets)
    propulsion.thrust(q_known, known, true, working)


def _guide(state: LoopState, q_known: Array) -> None:
    (kind, spacecraft, vector), restart, earth = state.targets, state.restart, state.environment.earth
    if not kernels.mark_new_targets(kind, spacecraft, state.last_kind, state.last_spacecraft, restart):
        raise PluginError(no_such_target(state.targets))
    state.earth_N[:] = earth.at(state.time)
    kernels.locate_targets(
        kind, spacecraft, vector, state.earth_N, earth.velocity, state.spin_N, state.C_AN, state.work
    )
    kernels.guide(q_known, restart, state.q_RN, state.work)


def _torque(state: LoopState, law: ControllerCalls, injection: FaultInjection | None) -> Array:
    like = state.inputs
    # Copied, for a law may keep what it is given.
    inputs = control_input(state.work[LAW_SLOTS], like.inertia_B, like.inertia_effective_B, like.period)
    torque_B = law.ask(inputs)
    if not np.isfinite(torque_B).all():
        state.torque_B[:] = torque_B
        if injection is None:
            raise SimulationError(divergence(state, law.controller))
        torque_B = injection.without_torque(state.time, torque_B)
    return torque_B


def _actuate(state: LoopState, torque_B: Array) -> None:
    gain, max_torque, max_speed = state.speed_gain, state.properties.max_wheel_torque, state.max_wheel_speed
    ctrl, peaks = state.motor_torque, state.peaks
    kernels.actuate(torque_B, state.allocation, gain, max_torque, max_speed, state.work, ctrl, peaks)
