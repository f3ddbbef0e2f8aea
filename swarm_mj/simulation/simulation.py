"""The simulation of one flight: MuJoCo integrates in N while gravity, behaviour, guidance and control act on it.

Every control period the state is read, the forces of the coming hold are evaluated at its middle, the behaviour names the
targets, guidance turns them into references, the controller answers with torques, and MuJoCo steps on with all of it held.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarm_mj.attitude.controllers.base import ControlInput, Controller
from swarm_mj.attitude.mrp import quaternion_from_mrp
from swarm_mj.errors import PluginError, SimulationError
from swarm_mj.faults.flight import Adversity
from swarm_mj.faults.impact import ImpactWatch
from swarm_mj.faults.schedule import Event
from swarm_mj.faults.telemetry import FaultRecord
from swarm_mj.mission.behaviors import Behavior, SwarmView, Targets
from swarm_mj.simulation import kernels
from swarm_mj.simulation.adverse import NOTHING, AdverseLoop
from swarm_mj.simulation.gyrostat import GyrostatIntegrator
from swarm_mj.simulation.kernels import Slot
from swarm_mj.simulation.records import InitialState, Record, sample_times
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.rotation import sub_point
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.gyrostat import with_wheels
from swarm_mj.spacecraft.model import NQ, NV, SwarmModel
from swarm_mj.spacecraft.properties import SpacecraftProperties

Array = NDArray[np.float64]
Progress = Callable[[float], None]

#: The wheel-speed limiter aims this far below the limit, for what the gyroscopic terms add within a hold.
SPEED_MARGIN = 1e-4


class Simulation:
    """A swarm in flight.

    Args:
        model: The compiled swarm.
        properties: The spacecraft's mass properties and wheel limits.
        environment: Gravity, rotation, Sun and Earth.
        behavior: Who points at what.
        controller: The attitude control law.
        control_period: How long torques and forces are held [s]; a whole multiple of the model's timestep.
        gravity_gradient_torque: Whether the torque of the central field acts; the field must know its `gm`.
        adversity: What may go wrong; None: nothing, all is as planned.
        shape: The body, to look for impacts while `run` flies; None: nobody looks.
    """

    def __init__(
        self,
        model: SwarmModel,
        *,
        properties: SpacecraftProperties,
        environment: Environment,
        behavior: Behavior,
        controller: Controller,
        control_period: float = 0.5,
        gravity_gradient_torque: bool = False,
        adversity: Adversity | None = None,
        shape: ShapeModel | None = None,
    ) -> None:
        self.model, self.properties, self.environment = model, properties, environment
        self.behavior, self.controller, self.period = behavior, controller, control_period
        self.data = mujoco.MjData(model.mjmodel)
        self._hold = round(control_period / model.mjmodel.opt.timestep)
        self._gradient_gm = self._gm_of_field() if gravity_gradient_torque else 0.0
        self._allocate_arrays(model.n)
        self._watch = None if shape is None else ImpactWatch(shape, environment, control_period)
        if adversity is None and properties.n_wheels != 3:
            adversity = NOTHING
        self._adverse = None if adversity is None else AdverseLoop(self, adversity, SPEED_MARGIN)
        self._gyrostats = GyrostatIntegrator(model.mjmodel, self._axes) if model.wheels == "gyrostat" else None
        self.tick = 0

    def _gm_of_field(self) -> float:
        gm = getattr(self.environment.gravity, "gm", None)
        if gm is None:
            raise PluginError("the gravity-gradient torque needs a gravity field with an attribute gm [m^3/s^2]")
        return float(gm)

    def _allocate_arrays(self, n: int) -> None:
        properties, environment = self.properties, self.environment
        axes = properties.wheel_axes_B
        self._work = np.zeros((len(Slot), n, 3))
        self._q_BN, self._q_RN = np.zeros((n, 4)), np.zeros((n, 4))
        self._C_AN, self._C_mid = np.zeros((3, 3)), np.zeros((3, 3))
        self._aim = np.zeros((2, n), np.int64)
        self._restart = np.zeros(n, np.bool_)
        self._peaks = np.zeros((n, 3))
        self._qpos, self._qvel = np.zeros(NQ * n), np.zeros(NV * n)
        self._hub = np.ascontiguousarray(self.model.hub_body, np.int64)
        self._axes = np.ascontiguousarray(axes)
        self._allocation = -np.linalg.pinv(axes.T)
        gain = 1.0 / properties.wheel_spin_inertia + (1.0 / np.diag(properties.inertia_effective_B)).max()
        self._speed_gain = self.period * float(gain)
        self._spin_N = environment.spin_N
        self._C_PN = np.ascontiguousarray(environment.C_PN)
        self._q_P = _quaternion_of(self._C_PN)
        self._inputs = self._control_inputs(n)

    def _control_inputs(self, n: int) -> ControlInput:
        w = self._work
        return ControlInput(
            sigma_BR=w[Slot.SIGMA_BR],
            omega_BR_B=w[Slot.OMEGA_BR],
            omega_BN_B=w[Slot.OMEGA],
            omega_RN_B=w[Slot.OMEGA_R_B],
            domega_RN_B=w[Slot.DOMEGA_R_B],
            wheel_momentum_B=w[Slot.MOMENTUM],
            inertia_B=np.repeat(self.properties.inertia_B[None], n, axis=0),
            inertia_effective_B=np.repeat(self.properties.inertia_effective_B[None], n, axis=0),
            period=self.period,
        )

    @property
    def time(self) -> float:
        """Seconds past the epoch, counted in whole control periods."""
        return self.tick * self.period

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Spacecraft that no longer work, shape (n,); they drift on."""
        return np.zeros(self.model.n, np.bool_) if self._adverse is None else self._adverse.flight.lost

    @property
    def camera_on(self) -> NDArray[np.bool_]:
        """Spacecraft that can take pictures, shape (n,)."""
        return ~self.lost if self._adverse is None else self._adverse.flight.camera_on & ~self.lost

    @property
    def events(self) -> list[Event]:
        """What went wrong so far, in order of time."""
        return [] if self._adverse is None else self._adverse.flight.events

    @property
    def motor_torque(self) -> Array:
        """Torques of the motors, without friction in the bearings, of all wheels in order, shape (n w,) [N m]."""
        return self.data.ctrl if self._adverse is None else self._adverse.flight.wheels.motor.ravel()

    def known(self) -> tuple[Array, Array] | None:
        """Attitudes (n, 4) and body rates (n, 3) [rad/s] as the flight software has them now; None where it has the truth.

        The controller is given the same by the decision that follows; asking ahead of it changes nothing in the flight.
        """
        if self._adverse is None:
            return None
        return self._adverse.known_now(self.time, self.tick, *self.model.state(self.data))

    def reset(self, initial: InitialState) -> None:
        """Put the swarm at its start and forget everything; faults and dispersions are drawn from the state's seed."""
        n, w = self.model.n, self.properties.n_wheels
        if self._adverse is not None:
            self._adverse.reset(initial.seed, initial.deployment)
        if self._watch is not None:
            self._watch.reset()
        mujoco.mj_resetData(self.model.mjmodel, self.data)
        qpos, qvel = np.zeros((n, NQ - 3 + w)), np.empty((n, NV - 3 + w))
        qpos[:, :3], qpos[:, 3:7] = initial.r_BN_N, quaternion_from_mrp(initial.sigma_BN)
        qvel[:, :3], qvel[:, 3:6], qvel[:, 6:] = initial.v_BN_N, initial.omega_BN_B, initial.wheel_speed
        self.model.set_state(self.data, qpos, qvel)
        self.tick = 0
        self._aim[:] = -1
        self._peaks[:] = 0.0
        self._behavior_memory: Any = None
        self._controller_memory: Any = None

    def decide(self) -> Targets:
        """Read the state and set forces and motor torques for the coming hold.

        Raises:
            SimulationError: The state is no longer finite.
        """
        data, work, environment, t = self.data, self._work, self.environment, self.time
        phase = environment.phase0 + environment.spin_rate * t
        adverse = self._adverse
        if adverse is not None:
            adverse.rest(environment.C_AN(t), data)
        if not self._sense(phase):
            if adverse is None:
                raise SimulationError(self._divergence())
            adverse.diverged(t, data)
            self._sense(phase)
        if adverse is not None:
            adverse.begin(t, work)
        self._push(t)
        kernels.turn_body(self._q_P, phase, data.mocap_quat[self.model.asteroid_mocap])
        wheel_speed = work[Slot.WHEEL] if adverse is None else adverse.speed
        view = SwarmView(t, work[Slot.R], work[Slot.V], self._C_AN, self._q_BN, work[Slot.OMEGA], wheel_speed)
        targets, self._behavior_memory = self.behavior.targets(view, self._behavior_memory)
        q_known = self._q_BN
        if adverse is not None:
            targets = adverse.flight.redirect(t, targets, work[Slot.R])
            q_known = adverse.know(self.tick, self._q_BN, work)
        aimed = kernels.guide(
            targets.kind,
            targets.spacecraft,
            targets.vector,
            environment.earth.at(t),
            environment.earth.velocity,
            self._spin_N,
            self._C_AN,
            q_known,
            self._aim,
            self._restart,
            self._q_RN,
            work,
        )
        if not aimed:
            raise PluginError(
                f"the behaviour aims at what is not there: kinds {targets.kind.tolist()}, spacecraft "
                f"{targets.spacecraft.tolist()} of {self.model.n}, counted from 0"
            )
        torque_B, self._controller_memory = self.controller.torque(self._inputs, self._controller_memory)
        if adverse is not None:
            adverse.actuate(torque_B, data.ctrl, self._peaks)
            adverse.forget(work)
            return targets
        limits = self.properties
        kernels.actuate(
            torque_B,
            self._allocation,
            self._speed_gain,
            limits.max_wheel_torque,
            (1.0 - SPEED_MARGIN) * limits.max_wheel_speed,
            work,
            data.ctrl,
            self._peaks,
        )
        return targets

    def _sense(self, phase: float) -> bool:
        """Read the state into the work arrays; whether every number is finite."""
        qpos, qvel = self._state()
        return kernels.sense(
            qpos,
            qvel,
            self._C_PN,
            phase,
            0.5 * self.period * self.environment.spin_rate,
            0.5 * self.period,
            self.properties.wheel_spin_inertia,
            self._axes,
            self._work,
            self._q_BN,
            self._C_AN,
            self._C_mid,
        )

    def _state(self) -> tuple[Array, Array]:
        data = self.data
        if self._adverse is not None:
            return self._adverse.state(*self.model.state(data))
        if self._gyrostats is None:
            return data.qpos, data.qvel
        spin = self.properties.wheel_spin_inertia
        with_wheels(data.qpos, data.qvel, data.act, spin, self._axes, self._qpos, self._qvel)
        return self._qpos, self._qvel

    def _push(self, t: float) -> None:
        data, work = self.data, self._work
        a_A = self.environment.gravity.acceleration(work[Slot.R_A])
        if self.environment.perturbed:
            middle = t + 0.5 * self.period
            r_N = work[Slot.R_A] @ self._C_mid
            a_A = a_A + self.environment.perturbing_acceleration_N(middle, r_N) @ self._C_mid.T
        kernels.push(a_A, self._C_mid, self.properties.mass, self._hub, data.xfrc_applied, work)
        if self._adverse is not None:
            self._adverse.weigh(data.xfrc_applied, self._hub)
        if self._gradient_gm > 0.0:
            inertia = self._inputs.inertia_B if self._adverse is None else self._adverse.flight.inertia_B
            kernels.push_gradient(
                self._q_BN, self._gradient_gm, inertia, self._C_mid, self._hub, data.xfrc_applied, work
            )

    def advance(self) -> None:
        """Let MuJoCo integrate one control period with everything held."""
        if self._gyrostats is None:
            mujoco.mj_step(self.model.mjmodel, self.data, nstep=self._hold)
        else:
            self._gyrostats.step(self.data, self._hold)
        self.tick += 1

    def run(self, duration: float, interval: float, progress: Progress | None = None) -> Record:
        """Fly from the present state and sample.

        Args:
            duration: [s], a whole multiple of `interval`.
            interval: Time between samples [s], a whole multiple of the control period.
            progress: Called with the time reached [s], about a hundred times.

        Raises:
            SimulationError: A spacecraft hit the body or the state is no longer finite; the message gives time and spacecraft.
                Where faults are flown, the spacecraft is lost instead and the others fly on.
        """
        n, stride = self.model.n, round(interval / self.period)
        samples = round(duration / interval) + 1
        record = Record(
            time=sample_times(duration, interval) + self.time,
            vectors=np.empty((samples, 7, n, 3)),
            attitude=np.empty((samples, 2, n, 4)),
            aim=np.empty((samples, 2, n), np.int16),
            peaks=np.empty((n, 3)),
            faults=None if self._adverse is None else FaultRecord(samples, n, self.properties.n_wheels),
        )
        ticks = stride * (samples - 1)
        report_every = max(1, ticks // 100)
        for k in range(ticks + 1):
            targets = self.decide()
            if self._watch is not None and self.tick >= self._watch.due:
                self._look_for_impacts(self._watch)
            if k % stride == 0:
                self._record(k // stride, targets, record)
            if k < ticks:
                self.advance()
            if progress is not None and k % report_every == 0:
                progress(self.time)
        record.peaks[:] = self._peaks * (1.0, 1.0, self.period)
        return record

    def _record(self, row: int, targets: Targets, record: Record) -> None:
        ctrl, adverse = self.data.ctrl, self._adverse
        if adverse is not None and record.faults is not None:
            record.faults.keep(row, adverse.flight, adverse.speed, self._q_BN)
            ctrl = adverse.motor
        kernels.record(
            row,
            targets.kind,
            targets.spacecraft,
            self._q_BN,
            self._q_RN,
            ctrl,
            self._work,
            record.vectors,
            record.attitude,
            record.aim,
        )

    def _look_for_impacts(self, watch: ImpactWatch) -> None:
        work, t = self._work, self.time
        flying = np.ones(self.model.n, np.bool_)
        if self._adverse is not None:
            flying[list(self._adverse.flight.resting)] = False
        hit = watch.look(self.tick, work[Slot.R], work[Slot.V], work[Slot.A], flying)
        for j in np.flatnonzero(hit):
            r_A = self._C_AN @ work[Slot.R, j]
            if self._adverse is None:
                latitude, longitude = sub_point(r_A, np.eye(3))
                raise SimulationError(
                    f"{self.model.names[j]} hits the body at t = {t:g} s, latitude {latitude:.1f} deg, longitude "
                    f"{longitude:.1f} deg: its path crosses the surface. Change the mission, or fly it with faults"
                )
            self._adverse.impact(t, int(j), r_A)

    def _divergence(self) -> str:
        state = np.hstack(self.model.state(self.data))
        bad = int(np.argmin(np.isfinite(state).all(axis=1)))
        cause = (
            "its torque or force was not finite"
            if not np.isfinite(self.data.ctrl).all()
            else "the integration diverged"
        )
        return (
            f"the flight diverged: {self.model.names[bad]} has a state that is not finite at t = {self.time:g} s; {cause}. "
            "Check gains, wheel limits and physics.timestep_s"
        )


def _quaternion_of(C_PN: Array) -> Array:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(C_PN.T).ravel())
    return quaternion
