"""Trajectory correction manoeuvres: velocity changes that bring a spacecraft back to its visiting point at the planned time.

Fixed time of arrival: at a correction at t_c the change of velocity is

    delta_v = -Phi_rv(t_v, t_c)^-1 [Phi_rr(t_v, t_c) dr + Phi_rv(t_v, t_c) dv],

with (dr, dv) how far the state lies from the planned one as far as the spacecraft knows, and t_v the arrival (Battin 1999, An
Introduction to the Mathematics and Methods of Astrodynamics, section 11.1). States are in N, metres and seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.mission.deployment import groups
from swarm_mj.mission.trajectories import AccelerationN
from swarm_mj.mission.transition import inverse, transitions
from swarm_mj.typing import Array

#: Worst condition of Phi_rv with which a correction is still one: beyond, a metre costs a million times more in one direction
#: than in another, as half a revolution before the arrival.
WORST_CONDITION = 1e6


@dataclass(frozen=True, kw_only=True)
class Legs:
    """Planned flights of n spacecraft, each cut at its m corrections.

    Attributes:
        times: Release, corrections in order, arrival of each spacecraft, shape (n, m + 2) [s].
        r_N: Planned positions at these times, shape (n, m + 2, 3) [m].
        v_N: Planned velocities, shape (n, m + 2, 3) [m/s].
        phi: State transition matrix of each leg, from one time to the next, shape (n, m + 1, 6, 6).
    """

    times: Array
    r_N: Array
    v_N: Array
    phi: Array

    @property
    def n_corrections(self) -> int:
        """Number of corrections of each spacecraft, m."""
        return self.times.shape[1] - 2

    @property
    def to_arrival(self) -> Array:
        """Phi(arrival, t) from each of the times before it, shape (n, m + 1, 6, 6)."""
        phi = self.phi.copy()
        for k in reversed(range(self.n_corrections)):
            phi[:, k] = phi[:, k + 1] @ self.phi[:, k]
        return phi

    @property
    def gain(self) -> Array:
        """What a correction answers to a deviation of the state, shape (n, m, 3, 6): `delta_v = gain @ (dr, dv)`.

        Raises:
            MissionError: A change of velocity at a correction cannot reach all directions at the arrival.
        """
        to_arrival, time_left = self.to_arrival[:, 1:], self.times[:, -1:] - self.times[:, 1:-1]
        phi_rv = to_arrival[..., :3, 3:]
        bad = ~(np.linalg.cond(phi_rv / time_left[..., None, None]) < WORST_CONDITION)
        if bad.any():
            j, k = np.argwhere(bad)[0]
            raise MissionError(
                f"sc{j + 1}: correction {k + 1}, {time_left[j, k]:g} s before the arrival, cannot move the arrival in every "
                "direction (its Phi_rv is singular, as half a revolution before); move it in trajectory.corrections"
            )
        return np.asarray(-np.linalg.solve(phi_rv, to_arrival[..., :3, :]))


def plan_legs(acceleration: AccelerationN, r0_N: Array, v0_N: Array, times: Array) -> Legs:
    """Fly the planned trajectories with their state transition matrices.

    Args:
        acceleration: Function (t, r (n, 3)) -> (n, 3) [m/s^2] in N.
        r0_N: Positions at release, shape (n, 3) [m].
        v0_N: Velocities at release, shape (n, 3) [m/s].
        times: Release, corrections, arrival of each spacecraft, increasing, shape (n, m + 2) [s].

    Raises:
        MissionError: A trajectory cannot be integrated.
    """
    n, knots = times.shape
    r_N, v_N = np.empty((n, knots, 3)), np.empty((n, knots, 3))
    phi = np.empty((n, knots - 1, 6, 6))
    for _, group in groups(*times.T):
        flown = transitions(acceleration, r0_N[group], v0_N[group], times[group[0]])
        r_N[group], v_N[group] = flown.r_N.swapaxes(0, 1), flown.v_N.swapaxes(0, 1)
        back = inverse(flown.phi[:-1], flown.times[-1] - flown.times[0])
        phi[group] = (flown.phi[1:] @ back).swapaxes(0, 1)
    return Legs(times=times, r_N=r_N, v_N=v_N, phi=phi)
