"""Slews along the minimum-time turn that the wheels allow: the reference goes there by a profile in place of a jump.

When a target is new, guidance puts the reference on it at once, and the control law turns the body as its gains have it. Here
the reference starts at the body instead and turns about the same axis, bang-bang or bang-coast-bang, within a share of what the
wheels give; its rate and acceleration are fed to the law, which is left to correct what is missing.
"""

from __future__ import annotations

from math import atan2
from typing import TYPE_CHECKING

import numpy as np

from swarm_mj.simulator.slots import Slot
from swarm_mj.spacecraft.attitude.algebra import conjugate, product, put_quaternion, put_vector, quaternion, rotate
from swarm_mj.spacecraft.attitude.guidance import Reference, TrackingError, attitude_error
from swarm_mj.spacecraft.attitude.slew import Turning, rotation_about, slew_profile, turning_about
from swarm_mj.typing import Array

if TYPE_CHECKING:
    from swarm_mj.simulator.state import FlightState

#: Share of torque and momentum that a profile takes; the rest is for the law's corrections.
SHARE = 0.8
#: Least share of the wheels' momentum that a slew is given, however fast the spacecraft tumbles.
LEAST = 0.1


class Slews:
    """The slews of n spacecraft, each from its last change of target on.

    Args:
        state: Of the flight; its work arrays receive references and errors.
    """

    def __init__(self, state: FlightState) -> None:
        n = state.model.n
        self._state = state
        self._start, self._angle, self._axis = np.zeros(n), np.zeros(n), np.zeros((n, 3))
        self._limits = [Turning(1.0, 1.0)] * n
        self._reference = Reference(*(np.empty((n, width)) for width in (4, 3, 3, 3)))

    def get_state(self) -> tuple[Array, Array, Array, list[Turning]]:
        """The slews that are under way, a copy."""
        return self._start.copy(), self._angle.copy(), self._axis.copy(), list(self._limits)

    def set_state(self, state: tuple[Array, Array, Array, list[Turning]]) -> None:
        """Go on from what `get_state` gave."""
        self._start[:], self._angle[:], self._axis[:], self._limits[:] = state

    def follow(self, q_known: Array) -> None:
        """Let the references of this decision, which guidance has worked out, go by the profiles.

        Args:
            q_known: Attitudes as the flight software has them, shape (n, 4).
        """
        state, work = self._state, self._state.work
        for j in np.flatnonzero(state.restart).tolist():
            self._begin(j, q_known)
        slewed = self._reference
        for target, source in zip(
            slewed, (state.q_RN, work[Slot.OMEGA_R], work[Slot.DOMEGA_R], work[Slot.LOS]), strict=True
        ):
            target[:] = source
        for j in range(len(q_known)):
            self._turn(j, slewed)
        error = TrackingError(work[Slot.SIGMA_BR], work[Slot.OMEGA_BR], work[Slot.OMEGA_R_B], work[Slot.DOMEGA_R_B])
        attitude_error(q_known, work[Slot.OMEGA], slewed, error)

    def _begin(self, j: int, q_known: Array) -> None:
        """Start a slew from the present attitude to the reference, which lies one turn about an axis across +z away."""
        w, *v = product(conjugate(quaternion(self._state.q_RN, j)), quaternion(q_known, j))
        sine, sign = float(np.linalg.norm(v)), 1.0 if w >= 0.0 else -1.0
        self._start[j], self._angle[j] = self._state.time, 2.0 * atan2(sine, abs(w))
        if sine == 0.0:
            return
        self._axis[j] = sign * np.array(v) / sine
        properties, work = self._state.properties, self._state.work
        aboard = properties.inertia_B @ work[Slot.OMEGA, j] + work[Slot.MOMENTUM, j]
        limits = turning_about(self._axis[j], properties)
        taken = float(np.linalg.norm(aboard)) / (properties.wheel_spin_inertia * properties.max_wheel_speed)
        self._limits[j] = Turning(SHARE * limits.acceleration, max(SHARE - taken, LEAST) * limits.rate)

    def _turn(self, j: int, slewed: Reference) -> None:
        angle, limits, t = float(self._angle[j]), self._limits[j], self._state.time - float(self._start[j])
        left, rate, _ = slew_profile(angle, limits, t)
        if left == 0.0:
            return
        # Torques are held: the mean of the coming hold leads to the rate that the profile has at its end.
        acceleration = (slew_profile(angle, limits, t + self._state.period)[1] - rate) / self._state.period
        q_RN, axis = quaternion(slewed.q_RN, j), self._axis[j]
        axis_N = np.array(rotate(q_RN, (axis[0], axis[1], axis[2])))
        w, x, y, z = rotation_about(axis, left)
        put_quaternion(slewed.q_RN, j, product(q_RN, (w, x, y, z)))
        omega_N = slewed.omega_RN_N[j].copy()
        change = acceleration * axis_N + rate * np.cross(omega_N, axis_N)
        put_vector(slewed.omega_RN_N, j, tuple(omega_N + rate * axis_N))
        put_vector(slewed.domega_RN_N, j, tuple(slewed.domega_RN_N[j] + change))
