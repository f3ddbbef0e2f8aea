"""Steps swarms by `mj_step` on their MJCF model.

Wheels are bodies, gravity acts through `xfrc_applied`, and whatever else the model holds acts as well. A rigid spacecraft is
pulled at its centre of mass, which is its hub's origin. One with panels on hinges or a sliding mass is pulled at each of its
bodies, by the acceleration at the centre of mass of the whole times the body's mass: the pull then bends no hinge, as in free
fall. With `gravity_gradient_torque`, body i is pulled besides by m_i G (r_i - r_C), and turned by 3 GM / r^5 r x (I_i r), with
the gradient G = GM / r^3 (3 r r^T / r^2 - 1) of the central field. The forces add up to nothing, and all of it to the torque of
the rigid whole (Schaub and Junkins, Analytical Mechanics of Space Systems, section 4.4).
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from swarm_mj.errors import ScenarioError, SimulationError
from swarm_mj.scenarios.schema import is_multiple
from swarm_mj.simulator.mujoco_step import hold, mujoco_flight, read, step
from swarm_mj.simulator.slots import Resting, Slot
from swarm_mj.simulator.state import FlightState
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.typing import Array

#: Motors are limited before friction is added to their torque; MuJoCo shall not cut the sum.
_NO_LIMIT = 1e3
#: All that MuJoCo needs to go on bit for bit.
_WHOLE = mujoco.mjtState.mjSTATE_INTEGRATION


def timesteps_in(control_period: float, timestep: float) -> int:
    """Timesteps in a control period [s].

    Raises:
        ScenarioError: It is no whole multiple of the timestep.
    """
    if not (control_period > 0.0 and is_multiple(control_period, timestep)):
        raise ScenarioError(
            f"control.period_s = {control_period:g}: must be a whole multiple of the model's timestep, {timestep:g} s"
        )
    return round(control_period / timestep)


def own_copy(model: SwarmModel, *, limits_by_loop: bool) -> SwarmModel:
    """The same swarm for a flight that changes masses; with or without limits of the motors, which the loop keeps anyhow."""
    own = replace(model, mjmodel=copy(model.mjmodel))
    if not limits_by_loop:
        return own
    motors = model.layout.actuators.ravel()
    own.mjmodel.actuator_ctrlrange[motors] = -_NO_LIMIT, _NO_LIMIT
    own.mjmodel.actuator_forcelimited[motors] = False
    return own


class MujocoStepper:
    """Steps one flight.

    Args:
        state: Of the flight, with an MjData.
        timesteps: In a control period.
        gradient_gm: Gravitational parameter whose gradient turns bodies of one's own [m^3/s^2]; 0: none does.

    Attributes:
        model: The swarm.
        data: MuJoCo's state.
        flight: The same for compiled code.
    """

    def __init__(self, state: FlightState, timesteps: int, gradient_gm: float) -> None:
        assert state.data is not None
        self._state, self._timesteps, self._gradient_gm = state, timesteps, gradient_gm
        self.model, self.data = state.model, state.data
        self.flight = mujoco_flight(state.model, state.data)

    def __reduce__(self) -> str:
        """Refuse to be copied or pickled, and so every simulation: what is copied would go on stepping this flight."""
        raise TypeError(
            "a simulation cannot be copied or pickled; make another one and hand it what get_state gives (see "
            "Simulation.set_state)"
        )

    def start(self) -> None:
        """Put MuJoCo at the start of the flight: of a spacecraft of one's own the centre of mass stands and moves so."""
        mujoco.mj_resetData(self.model.mjmodel, self.data)
        self.model.start(self.data, *self._rows(np.zeros_like(self._state.wheel_speed)))
        self.read()

    def write(self) -> None:
        """Give MuJoCo the state of the flight; wheel angles stay."""
        self.model.set_state(self.data, *self._rows(self.model.state(self.data)[0][:, 7:]))
        if self._state.resting.any():
            self._rest()
        self.read()

    def read(self) -> None:
        """Take the state of the flight from MuJoCo."""
        read(self.flight, self._state.flights, 0)
        if self.model.own is not None:
            self._state.flights.offset_N[0] = self.model.centres_of_mass(self.data)[0] - self._state.r_N

    def hold(self) -> None:
        """Set forces and motor torques of the coming hold."""
        self._prepare()
        hold(self.flight, self._state.flights, 0)

    def step(self) -> None:
        """Fly the hold."""
        self._prepare()
        step(self.flight, self._state.flights, 0, self._timesteps)
        if self.model.own is not None:
            self.read()

    def _prepare(self) -> None:
        if self._state.resting.any():
            self._rest()
        if self.model.own is not None:
            self._weigh_bodies()

    def get_state(self) -> Array:
        """All numbers that MuJoCo needs to go on, a copy."""
        numbers = np.empty(mujoco.mj_stateSize(self.model.mjmodel, _WHOLE))
        mujoco.mj_getState(self.model.mjmodel, self.data, numbers, _WHOLE)
        return numbers

    def set_state(self, numbers: Array) -> None:
        """Go on from what `get_state` gave."""
        mujoco.mj_setState(self.model.mjmodel, self.data, numbers, _WHOLE)

    def _rows(self, angles: Array) -> tuple[Array, Array]:
        """The state as `SwarmModel.set_state` takes it, with wheel angles of shape (n, w) [rad]."""
        state = self._state
        return np.hstack((state.r_N, state.q_BN, angles)), np.hstack((state.v_N, state.omega_B, state.wheel_speed))

    def _rest(self) -> None:
        """Put the spacecraft whose flight is over where the loop holds them."""
        state, data, layout = self._state, self.data, self.model.layout
        for j in np.flatnonzero(state.resting):
            if state.resting[j] == Resting.HELD:
                data.qpos[layout.all_qpos[j]] = self.model.mjmodel.qpos0[layout.all_qpos[j]]
            data.qvel[layout.all_qvel[j]] = 0.0
            data.qpos[layout.qpos[j, :7]] = *state.r_N[j], *state.q_BN[j]
            data.qvel[layout.qvel[j, :3]] = state.v_N[j]
        if not np.isfinite(data.qacc_warmstart).all():
            data.qacc_warmstart[:] = 0.0

    def _weigh_bodies(self) -> None:
        """Hold the weight of every body, and the tide where it is asked for."""
        state, model, bodies = self._state, self.model.mjmodel, self.model.layout.bodies
        forces = self.data.xfrc_applied
        forces[bodies, :3] = model.body_mass[bodies][..., None] * state.work[Slot.A][:, None]
        forces[bodies, 3:] = 0.0
        if self._gradient_gm > 0.0:
            self._add_tide()
        forces[bodies[state.resting != Resting.FLYING]] = 0.0

    def _add_tide(self) -> None:
        state, model, data, bodies = self._state, self.model.mjmodel, self.data, self.model.layout.bodies
        r_N = (state.work[Slot.R_A] @ state.C_mid)[:, None]
        arm_N = data.xipos[bodies] - data.subtree_com[self.model.hub_body][:, None]
        forces, axes = data.xfrc_applied, data.ximat[bodies].reshape(*bodies.shape, 3, 3)
        forces[bodies, :3] += model.body_mass[bodies][..., None] * tide(arm_N, r_N, self._gradient_gm)
        # In the principal axes of each body.
        r_body = np.einsum("nbij,nbi->nbj", axes, np.broadcast_to(r_N, arm_N.shape))
        distance = np.linalg.norm(r_N, axis=-1, keepdims=True)
        torque = 3.0 * self._gradient_gm / distance**5 * np.cross(r_body, model.body_inertia[bodies] * r_body)
        forces[bodies, 3:] = np.einsum("nbij,nbj->nbi", axes, torque)


def tide(arm: Array, r: Array, gm: float) -> Array:
    """Acceleration by a central field at `r + arm` less that at `r`, to first order, shape (..., 3) [m/s^2].

    Args:
        arm: From the one place to the other, shape (..., 3) [m].
        r: From the attracting centre, shape (..., 3) [m].
        gm: Gravitational parameter [m^3/s^2].
    """
    distance = np.linalg.norm(r, axis=-1, keepdims=True)
    along = (arm * r).sum(axis=-1, keepdims=True) / distance**2
    return gm / distance**3 * (3.0 * along * r - arm)


def write_masses(model: SwarmModel, data: mujoco.MjData, mass: Array, inertia_B: Array) -> None:
    """Give every spacecraft of a compiled model its own mass and inertia.

    Args:
        model: The swarm; its MjModel is changed.
        data: Its state.
        mass: With wheels, shape (n,) [kg].
        inertia_B: With wheels, about the centre of mass, shape (n, 3, 3) [kg m^2].

    Raises:
        SimulationError: The wheels leave a hub an impossible inertia.
    """
    mjmodel, properties, hub = model.mjmodel, model.properties, model.hub_body
    wheels_mass = properties.n_wheels * properties.wheel_mass
    axes_of = [principal_axes(hub_inertia) for hub_inertia in inertia_B - properties.wheels_inertia_B]
    moments, turns = np.array([m for m, _ in axes_of]), np.array([turn for _, turn in axes_of])
    fits = (mass > wheels_mass) & (moments.min(axis=1) > 0.0) & (2.0 * moments.max(axis=1) <= moments.sum(axis=1))
    for j in np.flatnonzero(~fits):
        raise SimulationError(
            f"{model.names[j]}: dispersions leave the hub {mass[j] - wheels_mass:.3g} kg and "
            f"{np.round(moments[j], 6).tolist()} kg m^2, which no body has; make dispersions.inertia_percent smaller"
        )
    mjmodel.body_mass[hub], mjmodel.body_inertia[hub] = mass - wheels_mass, moments
    mjmodel.body_iquat[hub] = turns
    extent, centre = mjmodel.stat.extent, mjmodel.stat.center.copy()
    mujoco.mj_setConst(mjmodel, data)
    mjmodel.stat.extent, mjmodel.stat.center[:] = extent, centre


def principal_axes(inertia_B: Array) -> tuple[Array, Any]:
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
