"""The loop's part that deals with faults, dispersions and more than three wheels; a flight without them never comes here.

What goes wrong is decided by `FaultState`; what that does to the arrays of the loop and of MuJoCo is done here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from swarm_mj.errors import SimulationError
from swarm_mj.mission.behaviors import SwarmView, Targets
from swarm_mj.scenarios.schema_faults import Dispersions
from swarm_mj.simulator.fast import kernels
from swarm_mj.simulator.fast.conditions import CONDITION, described
from swarm_mj.simulator.fast.flights import NEVER
from swarm_mj.simulator.fast.plain_data import PlainModel
from swarm_mj.simulator.faults.dispersions import unscaled
from swarm_mj.simulator.faults.schedule import Event
from swarm_mj.simulator.faults.state import EARLY_S, FaultModel, FaultState
from swarm_mj.simulator.loop_state import SPEED_MARGIN, LoopState
from swarm_mj.simulator.slots import Slot
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics
from swarm_mj.smallbody.rotation import sub_point
from swarm_mj.typing import Array

#: Motors are limited before friction is added to their torque; MuJoCo shall not cut the sum.
_NO_LIMIT = 1e3
#: Numbers beyond this are no state of a spacecraft, whatever their unit; a sum of finite ones may overflow.
_ABSURD = 1e100
NOTHING = FaultModel(faults=(), dispersions=Dispersions(), duration_s=0.0)


class FaultInjection:
    """Faults of one flight.

    Args:
        state: Of the flight; its model is changed, and must be its own.
        fault_model: What may go wrong.

    Attributes:
        state: As given.
        fault_model: As given.
        planned: The environment as planned.
        faults: What goes wrong.
        wheel_speed: Of all wheels at the last decision, shape (n, w) [rad/s].
        condition: The same for compiled code, see `conditions`, shape (1,); valid as long as this object lives.
        due: Tick at which something has to be done before compiled code may fly on.
    """

    def __init__(self, state: LoopState, fault_model: FaultModel) -> None:
        model, properties = state.model, state.properties
        self.state, self.fault_model, self.planned, n = state, fault_model, state.environment, model.n
        self.faults = FaultState(
            fault_model,
            properties=properties,
            environment=state.environment,
            n=n,
            period=state.period,
            speed_margin=SPEED_MARGIN,
        )
        motors = model.layout.actuators.ravel()
        model.mjmodel.actuator_ctrlrange[motors] = -_NO_LIMIT, _NO_LIMIT
        model.mjmodel.actuator_forcelimited[motors] = False
        given = fault_model.dispersions
        self._disperses_mass = given.mass_percent > 0.0 or given.inertia_percent > 0.0
        self._mass_ratio = np.ones(n)
        self.wheel_speed = np.zeros((n, properties.n_wheels))
        self._true_omega = np.zeros((n, 3))
        self._last_r = np.zeros((n, 3))
        self.condition, self.due = np.zeros(1, CONDITION), 0
        self._described: list[Array] = []

    def reset(self, seed: int, deployment: tuple[Event, ...]) -> None:
        """Begin a flight: draw from the seed what will happen and what the spacecraft are like."""
        state = self.state
        self.faults.reset(seed, deployment)
        state.environment = self.faults.environment
        if self._disperses_mass:
            self._mass_ratio[:] = self.faults.mass / state.properties.mass
            write_masses(state, self.faults.mass, self.faults.inertia_B)
        self._describe()

    def rewind(self, deployment: tuple[Event, ...]) -> None:
        """Begin the flight of the last `reset` again, when no propellant has been burnt."""
        self.faults.rewind(deployment)
        self.due = 0

    def get_state(self) -> dict[str, Any]:
        """What has become of the flight since `reset`, a copy."""
        return {"faults": self.faults.get_state(), "arrays": [array.copy() for array in self._arrays]}

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave, after a `reset` with the seed of that flight."""
        self.faults.set_state(state["faults"])
        for array, value in zip(self._arrays, state["arrays"], strict=True):
            array[:] = value
        self._describe()

    @property
    def _arrays(self) -> tuple[Array, ...]:
        return self.wheel_speed, self._true_omega, self._last_r

    def _describe(self) -> None:
        """Tell compiled code where all of it stands, and have it wait for the next event."""
        faults, (field, factor) = self.faults, unscaled(self.state.environment.gravity)
        arrays: dict[str, Any] = {
            "mass_ratio": self._mass_ratio,
            "inertia_B": np.ascontiguousarray(faults.inertia_B),
            "dead": faults.lost,
            "wheel_speed": self.wheel_speed,
            "last_r": self._last_r,
            **faults.wheels.state._asdict(),
        }
        if isinstance(field, SphericalHarmonics) and self.fault_model.dispersions.harmonics_percent > 0.0:
            arrays["series"] = field.acceleration_series.copy()
        self.condition[0] = described(
            arrays,
            faults.sensing.knowledge,
            field_factor=factor,
            period=self.state.period,
            max_torque=self.state.properties.max_wheel_torque,
            max_speed=self.state.max_wheel_speed,
        )
        self._described = list(arrays.values())  # they must live as long as their addresses are known
        self.due = 0

    def aim(self, view: SwarmView, ask: Callable[[SwarmView], Targets]) -> Targets:
        """Let happen what is due, and ask for the targets that hold until the next event.

        Args:
            view: The instant.
            ask: Gives the targets of an instant.

        Returns:
            The targets; lost relays have successors.
        """
        assert view.wheel_speed is not None
        self.faults.happen(view.t, view.wheel_speed)
        targets = self.faults.redirect(view.t, ask(self.seen_by(view)), view.r_BN_N)
        self.due = self._tick_of(self.faults.next_s())  # a relay lost just now is noticed later
        return targets

    def _tick_of(self, time_s: float) -> int:
        """The first control period that begins at or after a time."""
        if not np.isfinite(time_s):
            return NEVER
        period = self.state.period
        tick = max(0, int(time_s / period) - 2)
        while time_s > tick * period + EARLY_S:
            tick += 1
        return tick

    def seen_by(self, view: SwarmView) -> SwarmView:
        """What a behaviour is shown, with who works and whose camera is on."""
        faults = self.faults
        return view._replace(working=~faults.lost, camera_on=faults.camera_on & ~faults.lost)

    def begin(self, t: float, qvel: Array, work: Array) -> None:
        """Let happen what is due; the state has been read.

        Args:
            t: Time of the control period [s].
            qvel: Velocities, shape (n (6 + w),).
            work: See `Slot`.
        """
        self.wheel_speed[:] = qvel.reshape(len(self.wheel_speed), -1)[:, 6:]
        self._last_r[:] = work[Slot.R]
        self.faults.happen(t, self.wheel_speed)

    def weigh(self, forces: Array) -> None:
        """Gravity pulls with the true masses, and what lies on the body is not pulled; see MuJoCo's `xfrc_applied`."""
        if self._disperses_mass:
            kernels.weigh(self._mass_ratio, self.state.hub, forces)
        for j in self.faults.resting:
            forces[self.state.model.layout.bodies[j]] = 0.0

    def know(self, tick: int, q_BN: Array, work: Array) -> Array:
        """Attitudes that the controller is given; its rates are put into `work` until `forget`."""
        self._true_omega[:] = work[Slot.OMEGA]
        if not self.faults.sensing.active:
            return q_BN
        q_known, work[Slot.OMEGA] = self.faults.sensing.know(tick, q_BN, self._true_omega)
        return q_known

    def known_now(self, t: float, tick: int, qpos: Array, qvel: Array) -> tuple[Array, Array] | None:
        """What `know` gives at this instant, asked ahead of the decision: the same sensors are read, and only once.

        Args:
            t: Time of the control period that is about to begin [s].
            tick: Its number.
            qpos: Positions, shape (n, 7 + w).
            qvel: Velocities, shape (n, 6 + w).

        Returns:
            Attitudes (n, 4) and rates (n, 3) [rad/s]; None where they are the truth.
        """
        if not self.faults.sensing.active:
            return None
        # A sensor that fails at this instant has failed before it is read.
        self.faults.happen(t, qvel[:, 6:])
        return self.faults.sensing.know(tick, qpos[:, 3:7], qvel[:, 3:6])

    @property
    def true_rates(self) -> Array:
        """Body rates as they are, from `know` to `forget`, shape (n, 3) [rad/s]."""
        return self._true_omega

    def forget(self, work: Array) -> None:
        """Put the true rates back."""
        work[Slot.OMEGA] = self._true_omega

    def actuate(self, torque_B: Array, ctrl: Array, peaks: Array) -> None:
        """Set the torque of every wheel."""
        faults = self.faults
        total = faults.wheels.drive(torque_B, self.wheel_speed, self.state.period, faults.lost, peaks)
        ctrl[:] = total.ravel()

    @property
    def motor(self) -> Array:
        """Motor torques of the first three wheels, shape (3 n,) [N m]."""
        return self.faults.wheels.motor[:, :3].ravel()

    def rest(self, C_AN: Array) -> None:
        """Hold the spacecraft whose flight is over: at its place on the turning body, or where it diverged."""
        data, layout = self.state.data, self.state.model.layout
        for j, r_A in self.faults.resting.items():
            data.qvel[layout.all_qvel[j]] = 0.0
            if r_A is not None:
                r_N = r_A @ C_AN
                data.qpos[layout.qpos[j, :3]] = r_N
                data.qvel[layout.qvel[j, :3]] = np.cross(self.state.environment.spin_N, r_N)

    def diverged(self, t: float) -> None:
        """Give up the spacecraft whose state is not finite, so that the others fly on.

        Raises:
            SimulationError: It is not a spacecraft's state that is not finite.
        """
        model, data = self.state.model, self.state.data
        layout, momentum = model.layout, data.act.reshape(model.n, -1)
        parts = data.qpos[layout.all_qpos], data.qvel[layout.all_qvel], momentum
        bad = np.flatnonzero(~np.all([(np.abs(part) < _ABSURD).all(axis=1) for part in parts], axis=0))
        if not len(bad):
            raise SimulationError(f"the flight diverged at t = {t:g} s: torques or forces are not finite")
        for j in bad:
            data.qpos[layout.all_qpos[j]] = model.mjmodel.qpos0[layout.all_qpos[j]]
            data.qpos[layout.qpos[j, :7]] = *self._last_r[j], 1.0, 0.0, 0.0, 0.0
            data.qvel[layout.all_qvel[j]], momentum[j] = 0.0, 0.0
            self.faults.rest(t, int(j), "diverged", "its state was not finite; held where it was", None)
        data.qacc_warmstart[:] = 0.0

    def without_torque(self, t: float, torque_B: Array) -> Array:
        """Give up the spacecraft whose control law gives no finite torque; the torques of the others, shape (n, 3) [N m]."""
        bad = np.asarray(~np.isfinite(torque_B).all(axis=1))
        for j in np.flatnonzero(bad & ~self.faults.lost):
            self.faults.rest(t, int(j), "diverged", "its control law gave no finite torque; held where it was", None)
        return np.where(bad[:, None], 0.0, torque_B)

    def impact(self, t: float, j: int, r_A: Array) -> None:
        """Record an impact; the spacecraft lies where it hit."""
        latitude, longitude = sub_point(r_A, np.eye(3))
        self.faults.rest(t, j, "impact", f"latitude {latitude:.2f} deg, longitude {longitude:.2f} deg", r_A)


def write_masses(state: LoopState, mass: Array, inertia_B: Array) -> None:
    """Give every spacecraft of the compiled model its own mass and inertia.

    Args:
        state: Whose model and data are changed.
        mass: With wheels, shape (n,) [kg].
        inertia_B: With wheels, about the centre of mass, shape (n, 3, 3) [kg m^2].

    Raises:
        SimulationError: The wheels leave a hub an impossible inertia.
    """
    model, properties = state.model.mjmodel, state.properties
    axes, spin = properties.wheel_axes_B, properties.wheel_spin_inertia
    bodies = state.model.wheels == "bodies"
    wheels_mass = properties.n_wheels * properties.wheel_mass if bodies else 0.0
    wheels_inertia = properties.wheels_inertia_B if bodies else spin * axes.T @ axes
    hubs = inertia_B - wheels_inertia
    axes_of = [principal_axes(hub_inertia) for hub_inertia in hubs]
    moments, turns = np.array([m for m, _ in axes_of]), np.array([turn for _, turn in axes_of])
    fits = (mass > wheels_mass) & (moments.min(axis=1) > 0.0) & (2.0 * moments.max(axis=1) <= moments.sum(axis=1))
    for j in np.flatnonzero(~fits):
        raise SimulationError(
            f"{state.model.names[j]}: dispersions leave the hub {mass[j] - wheels_mass:.3g} kg and "
            f"{np.round(moments[j], 6).tolist()} kg m^2, which no body has; make dispersions.inertia_percent smaller"
        )
    model.body_mass[state.hub], model.body_inertia[state.hub] = mass - wheels_mass, moments
    model.body_iquat[state.hub] = turns
    if isinstance(model, PlainModel):
        return
    extent, centre = model.stat.extent, model.stat.center.copy()
    mujoco.mj_setConst(model, state.data)
    model.stat.extent, model.stat.center[:] = extent, centre


def principal_axes(inertia_B: Array) -> tuple[Array, Array]:
    """Principal moments (3,) and the quaternion of their axes in B; in the order x, y, z where the tensor is diagonal."""
    moments = inertia_B.diagonal().copy()
    if np.abs(inertia_B - np.diag(moments)).max() <= 1e-15:
        return moments, np.array([1.0, 0.0, 0.0, 0.0])
    moments, vectors = np.linalg.eigh(inertia_B)
    if np.linalg.det(vectors) < 0.0:
        vectors[:, 2] *= -1.0
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, vectors.ravel())
    return moments, quaternion
