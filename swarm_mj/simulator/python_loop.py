"""One decision call by call, with all that compiled code does not know: plug-ins, perturbations, faults.

It reads the state, evaluates the forces of the coming hold at its middle, asks behaviour and control law, and leaves forces and
motor torques in MuJoCo's arrays; from the same kernels and to the same bits as `flight_kernels.fly`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swarm_mj.errors import PluginError, SimulationError
from swarm_mj.mission.behaviors import Targets
from swarm_mj.simulator.asking import view_of
from swarm_mj.simulator.fast import kernels
from swarm_mj.simulator.fast.kernels import Slot
from swarm_mj.simulator.fast.world import LAW_SLOTS, SPEED_MARGIN, inputs_from
from swarm_mj.simulator.plugin_calls import ask_for_torque
from swarm_mj.spacecraft.gyrostat import with_wheels
from swarm_mj.typing import Array

if TYPE_CHECKING:
    from swarm_mj.simulator.simulation import Simulation


def decide(s: Simulation) -> Targets:
    """Set forces and motor torques of the coming hold; see `Simulation.decide`."""
    data, work, environment, t = s.data, s._work, s.environment, s.time
    phase = environment.phase0 + environment.spin_rate * t
    adverse = s._adverse
    if adverse is not None:
        adverse.rest(environment.C_AN(t), data)
    if not _sense(s, phase):
        if adverse is None:
            raise SimulationError(s._divergence())
        adverse.diverged(t, data)
        _sense(s, phase)
    if adverse is not None:
        adverse.begin(t, work)
    _push(s, t)
    kernels.turn_body(s._q_P, phase, data.mocap_quat[s.model.asteroid_mocap])
    targets = s._asking.ask(0, view_of(t, s._C_AN.copy(), *s.model.state(data)), s.tick)
    q_known = s._q_BN
    if adverse is not None:
        targets = adverse.flight.redirect(t, targets, work[Slot.R])
        q_known = adverse.know(s.tick, s._q_BN, work)
    _guide(s, t, targets, q_known)
    torque_B = _ask_for_torque(s)
    if adverse is not None:
        adverse.actuate(torque_B, data.ctrl, s._peaks)
        adverse.forget(work)
        return targets
    _actuate(s, torque_B)
    return targets


def _ask_for_torque(s: Simulation) -> Array:
    # Copied, for a law may keep what it is given.
    like = s._inputs
    inputs = inputs_from(s._work[LAW_SLOTS], like.inertia_B, like.inertia_effective_B, like.period)
    torque_B, s._controller_memory = ask_for_torque(s.controller, inputs, s._controller_memory)
    if not np.isfinite(torque_B).all():
        s._flight.torque_B[0] = torque_B
        if s._adverse is None:
            raise SimulationError(s._divergence())
        torque_B = s._adverse.without_torque(s.time, torque_B)
    return torque_B


def _guide(s: Simulation, t: float, targets: Targets, q_known: Array) -> None:
    aimed = kernels.guide(
        targets.kind,
        targets.spacecraft,
        targets.vector,
        s.environment.earth.at(t),
        s.environment.earth.velocity,
        s._spin_N,
        s._C_AN,
        q_known,
        s._aim,
        s._restart,
        s._q_RN,
        s._work,
    )
    if not aimed:
        raise PluginError(s._aims_at_nothing(targets))


def _actuate(s: Simulation, torque_B: Array) -> None:
    limits = s.properties
    kernels.actuate(
        torque_B,
        s._allocation,
        s._speed_gain,
        limits.max_wheel_torque,
        (1.0 - SPEED_MARGIN) * limits.max_wheel_speed,
        s._work,
        s.data.ctrl,
        s._peaks,
    )


def _sense(s: Simulation, phase: float) -> bool:
    """Read the state into the work arrays; whether every number is finite."""
    qpos, qvel = _state(s)
    return kernels.sense(
        qpos,
        qvel,
        s._C_PN,
        phase,
        0.5 * s.period * s.environment.spin_rate,
        0.5 * s.period,
        s.properties.wheel_spin_inertia,
        s._axes,
        s._work,
        s._q_BN,
        s._C_AN,
        s._C_mid,
    )


def _state(s: Simulation) -> tuple[Array, Array]:
    data = s.data
    if s._adverse is not None:
        return s._adverse.state(*s.model.state(data))
    if s.model.wheels == "bodies":
        return data.qpos, data.qvel
    spin = s.properties.wheel_spin_inertia
    with_wheels(data.qpos, data.qvel, data.act, spin, s._axes, s._qpos, s._qvel)
    return s._qpos, s._qvel


def _push(s: Simulation, t: float) -> None:
    data, work = s.data, s._work
    a_A = s.environment.attraction_A(work[Slot.R_A])
    if s.environment.perturbed:
        middle = t + 0.5 * s.period
        r_N = work[Slot.R_A] @ s._C_mid
        a_A = a_A + s.environment.perturbing_acceleration_N(middle, r_N) @ s._C_mid.T
    kernels.push(a_A, s._C_mid, s.properties.mass, s._hub, data.xfrc_applied, work)
    if s._adverse is not None:
        s._adverse.weigh(data.xfrc_applied, s._hub)
    if s._gradient_gm > 0.0:
        inertia = s._inputs.inertia_B if s._adverse is None else s._adverse.flight.inertia_B
        kernels.push_gradient(s._q_BN, s._gradient_gm, inertia, s._C_mid, s._hub, data.xfrc_applied, work)
