"""Thrusters in flight: a force law's wishes become pulses of nozzles, forces and torques, and an emptier tank.

Within a control period T a nozzle of thrust F that should give f on average is open for f T / F (pulse-width modulation). A
period is short against the motion, so its mean force is held, with direction and lever arm at the attitude of its middle. The
tank loses m_dot = sum F / (g0 I_sp) (Sutton and Biblarz, Rocket Propulsion Elements, equation 2-5). While the force is held,
MuJoCo's mass is the logarithmic mean of those before and after, (m0 - m1) / ln(m0 / m1), for which F T / m is the rocket
equation g0 I_sp ln(m0 / m1) exactly. Propellant is spread through the hub: its centre of mass stays, its inertia falls with its
mass.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from swarm_mj.errors import SimulationError
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.scenarios.schema_propulsion import Thrusters
from swarm_mj.simulator.slots import Slot
from swarm_mj.simulator.state import FlightState
from swarm_mj.spacecraft.control.force import AimingForceLaw, ForceLaw, ForceView, ask_for_forces
from swarm_mj.spacecraft.thrusters import ThrusterAllocation, read_nozzles
from swarm_mj.typing import Array, Mask

#: The long axis, by which spacecraft are pointed, must be the axis of nozzles that have to be turned, to so much.
ALONG_Z = np.cos(np.radians(1.0))


class Propulsion:
    """Thrusters and tanks of one flight.

    Args:
        state: Of the flight, whose properties have thrusters; its model is changed, and must be its own.
        thrusters: Their numbers.
        gradient: Whether the gravity gradient is held in `FlightState.torque_N` already.

    Attributes:
        thrusters: As given.
        allocation: How wishes are shared among the nozzles.
    """

    def __init__(self, state: FlightState, thrusters: Thrusters, *, gradient: bool) -> None:
        model, hub, n = state.model.mjmodel, state.model.hub_body, state.model.n
        self._state, self.thrusters, self._gradient = state, thrusters, gradient
        nozzles = read_nozzles(model, int(hub[0]), f"{state.model.names[0]}_")
        self.allocation = ThrusterAllocation(nozzles, model.body_ipos[hub[0]])
        axes = Rotation.from_quat(model.body_iquat[hub[0]], scalar_first=True).as_matrix()
        self._to_B, offset = (axes**2).T, model.body_ipos[hub[0]]
        self._axes_B = axes
        self._offset = offset @ offset - offset**2
        self._law: ForceLaw | None = None
        self._memory: Any = None
        self._as_built = model.body_mass[hub].copy(), model.body_inertia[hub].copy()
        self._delta_v_N, self._delta_v = np.zeros((n, 3)), np.zeros(n)
        self._propellant, self._used, self._gain_N = np.zeros(n), np.zeros(n), np.zeros((n, 3))
        self._moment_N = np.zeros((n, 3))  # gains times the middles of their holds [m]
        self._fired_at = 0
        self._start()

    @property
    def law(self) -> ForceLaw | None:
        """Who asks for forces; None: nobody."""
        return self._law

    @law.setter
    def law(self, law: ForceLaw | None) -> None:
        if isinstance(law, AimingForceLaw) and not self.allocation.reaches_all and self.allocation.axis_B[2] < ALONG_Z:
            raise SimulationError(
                f"spacecraft.thrusters: the nozzles cannot push in every direction, and together they push along "
                f"{np.round(self.allocation.axis_B, 3).tolist()} in B: must be +z, which is what spacecraft are pointed by, or "
                "more nozzles are needed"
            )
        self._law, self._memory = law, None

    @property
    def force_N(self) -> Array:
        """Mean forces of the hold that was decided last, shape (n, 3) [N]."""
        return self._state.thrust_N

    @property
    def propellant(self) -> Array:
        """Left in the tanks, shape (n,) [kg]."""
        self._burn()
        return self._propellant

    @property
    def delta_v(self) -> Array:
        """Velocity gained by thrust so far, whatever its direction, shape (n,) [m/s]."""
        self._burn()
        return self._delta_v

    @property
    def delta_v_N(self) -> Array:
        """The same as a vector, as accelerometers have it, shape (n, 3) [m/s]."""
        self._burn()
        return self._delta_v_N

    @property
    def displacement_N(self) -> Array:
        """How far thrust alone has carried each by now, shape (n, 3) [m]."""
        self._burn()
        return self._delta_v_N * self._state.time - self._moment_N

    @property
    def mass(self) -> Array:
        """Of the spacecraft with what is left in their tanks, shape (n,) [kg]."""
        return self._full_mass - (self.thrusters.propellant_kg - self.propellant)

    def refill(self) -> None:
        """Give the model the masses that it was built with; dispersions may change them before `reset`."""
        if self._state.data is not None:
            self._write_masses(*self._as_built)

    def reset(self) -> None:
        """Begin a flight with full tanks; masses have been written.

        Raises:
            SimulationError: A tank does not fit into a hub.
        """
        self._memory = None
        self._start()

    def _start(self) -> None:
        state, model, properties = self._state, self._state.model.mjmodel, self._state.properties
        hub, rigid = state.model.hub_body, state.model.own is None
        if state.data is not None:
            self._hub_mass, self._hub_inertia = model.body_mass[hub].copy(), model.body_inertia[hub].copy()
        else:
            self._hub_mass = state.mass - properties.n_wheels * properties.wheel_mass
            self._hub_inertia = np.einsum(
                "ji,njk,ki->ni", self._axes_B, state.inertia_B - properties.wheels_inertia_B, self._axes_B
            )
        self._full_mass = state.mass.copy() if rigid else model.body_subtreemass[hub].copy()
        self._full_inertia_B = state.inertia_B.copy()
        if self._hub_mass.min() <= self.thrusters.propellant_kg:
            raise SimulationError(
                f"spacecraft.thrusters.propellant_kg = {self.thrusters.propellant_kg:g}: must be below the hub's "
                f"{self._hub_mass.min():.6g} kg"
            )
        self._inertia_per_kg = self._hub_inertia / self._hub_mass[:, None]
        self._propellant[:] = self.thrusters.propellant_kg
        for array in (self.force_N, self._delta_v, self._delta_v_N, self._moment_N, self._used, self._gain_N):
            array[:] = 0.0

    def aim(self, t: float, targets: Targets) -> Targets:
        """Turn the spacecraft that are about to push, where their nozzles cannot push in every direction."""
        if self.allocation.reaches_all or not isinstance(self._law, AimingForceLaw):
            return targets
        directions = np.broadcast_to(self._law.directions(t), self.force_N.shape)
        turning = (directions != 0.0).any(axis=1) & (self.propellant > 0.0) & self._state.released
        if not turning.any():
            return targets
        kind, vector = targets.kind.copy(), targets.vector.copy()
        kind[turning], vector[turning] = int(TargetKind.DIRECTION), directions[turning]
        return Targets(kind, targets.spacecraft, vector)

    def thrust(self, q_known: Array) -> None:
        """Ask for forces and hold those that the thrusters give; what the hold before used is gone from the tanks.

        Args:
            q_known: Attitudes that the flight software has, by which it opens nozzles, shape (n, 4); its rates stand in
                `Slot.OMEGA`.
        """
        state = self._state
        self._burn()
        self._fired_at = state.tick
        working = ~state.lost & state.released  # who is still aboard the mothership pushes no more than the lost
        wish_N = self._ask(q_known, working)
        firing = (wish_N != 0.0).any(axis=1) & working & (self.propellant > 0.0)
        self._used[:], self._gain_N[:], state.thrust_N[:] = 0.0, 0.0, 0.0
        mean_mass, torque_N = self.mass, np.zeros_like(wish_N)
        if firing.any():
            omega_known = state.work[Slot.OMEGA]
            thrusts = self._open(_mid_attitude(q_known, omega_known, state.period)[firing], wish_N[firing], firing)
            to_N = _mid_attitude(state.q_BN, state.omega_B, state.period)[firing]
            state.thrust_N[firing] = to_N.apply(thrusts @ self.allocation.force_B)
            torque_N[firing] = to_N.apply(thrusts @ self.allocation.torque_B)
            self._used[firing] = thrusts.sum(axis=1) * state.period / self.thrusters.exhaust_speed
            mean_mass = logarithmic_mean(self.mass, self._used)
            self._gain_N[:] = state.thrust_N * (state.period / mean_mass)[:, None]
        self._weigh(mean_mass)
        if not self._gradient:
            state.torque_N[:] = 0.0
        state.torque_N[:] += torque_N

    def _ask(self, q_known: Array, working: Mask) -> Array:
        state = self._state
        if self._law is None:
            return np.zeros_like(self.force_N)
        r_N, v_N = state.known()
        view = ForceView(
            t=state.time,
            period=state.period,
            r_BN_N=r_N,
            v_BN_N=v_N,
            q_BN=q_known.copy(),
            mass=self.mass,
            propellant=self.propellant.copy(),
            delta_v_N=self.delta_v_N.copy(),
            working=working.copy(),
        )
        wish_N, self._memory = ask_for_forces(self._law, view, self._memory)
        return wish_N

    def _open(self, to_N: Rotation, wish_N: Array, firing: Mask) -> Array:
        """Mean thrusts of the nozzles of those that fire, shape (k, m) [N]: limits, shortest pulses, what the tank has left."""
        thrusters, period = self.thrusters, self._state.period
        thrusts = self.allocation.thrusts(to_N.inv().apply(wish_N))
        # All nozzles are cut alike, so that the force keeps its direction.
        thrusts /= np.maximum(thrusts.max(axis=1, keepdims=True) / thrusters.thrust_n, 1.0)
        bit = thrusters.min_impulse_bit_n_s / period
        thrusts = np.where(thrusts >= bit, thrusts, np.where(thrusts >= 0.5 * bit, bit, 0.0)) if bit > 0.0 else thrusts
        asked = thrusts.sum(axis=1) * period / thrusters.exhaust_speed
        left = self.propellant[firing]
        share = np.divide(left, asked, out=np.ones_like(left), where=asked > left)
        return np.asarray(thrusts * share[:, None])

    def _weigh(self, mean_mass: Array) -> None:
        """Give the spacecraft, and MuJoCo, the masses of the hold."""
        state = self._state
        gone = self._full_mass - mean_mass
        per_kg_B = np.einsum("ij,nj,kj->nik", self._axes_B, self._inertia_per_kg, self._axes_B)
        state.mass[:], state.inertia_B[:] = mean_mass, self._full_inertia_B - gone[:, None, None] * per_kg_B
        hub_mass = self._hub_mass - gone
        if state.data is not None and not np.array_equal(hub_mass, state.model.mjmodel.body_mass[state.model.hub_body]):
            self._write_masses(hub_mass, self._hub_inertia - gone[:, None] * self._inertia_per_kg)

    def _write_masses(self, hub_mass: Array, hub_inertia: Array) -> None:
        # And what a free body's motion depends on besides, for `mj_setConst` would take too long: MuJoCo reads the inertia
        # matrix of a body without others from `dof_M0`.
        swarm = self._state.model
        model, hub, qvel = swarm.mjmodel, swarm.hub_body, swarm.layout.qvel
        change, turned = hub_mass - model.body_mass[hub], hub_inertia - model.body_inertia[hub]
        model.body_mass[hub], model.body_inertia[hub] = hub_mass, hub_inertia
        model.body_subtreemass[hub] += change
        model.body_subtreemass[0] += change.sum()
        model.dof_M0[qvel[:, :3]] += change[:, None]
        model.dof_M0[qvel[:, 3:6]] += turned @ self._to_B + change[:, None] * self._offset

    def _burn(self) -> None:
        """Take from the tanks what the hold that has been flown used."""
        if self._state.tick > self._fired_at:
            self._propellant[:] = np.maximum(self._propellant - self._used, 0.0)
            self._delta_v_N += self._gain_N
            self._moment_N += self._gain_N * (self._fired_at + 0.5) * self._state.period
            self._delta_v += np.linalg.norm(self._gain_N, axis=1)
            self._used[:], self._gain_N[:] = 0.0, 0.0


def logarithmic_mean(mass: Array, used: Array) -> Array:
    """Mean of `mass` and `mass - used` with which a constant force gives the rocket equation's change of velocity [kg]."""
    share = used / mass
    series = 1.0 - share / 2.0 - share**2 / 12.0 - share**3 / 24.0 - 19.0 * share**4 / 720.0
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = -share / np.log1p(-share)
    return np.asarray(mass * np.where(share < 1e-3, series, exact))


def _mid_attitude(q_BN: Array, omega_B: Array, period: float) -> Rotation:
    """Rotations from B to N at the middle of a hold."""
    return Rotation.from_quat(q_BN, scalar_first=True) * Rotation.from_rotvec(0.5 * period * omega_B)
