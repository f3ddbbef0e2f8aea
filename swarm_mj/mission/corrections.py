"""Trajectory correction manoeuvres back to a visiting point at the planned time, and the state transition matrices they take.

Fixed time of arrival: at a correction at t_c the change of velocity is

    delta_v = -Phi_rv(t_v, t_c)^-1 [Phi_rr(t_v, t_c) dr + Phi_rv(t_v, t_c) dv],

with (dr, dv) how far the state lies from the planned one as far as the spacecraft knows, and t_v the arrival (Battin 1999, An
Introduction to the Mathematics and Methods of Astrodynamics, section 11.1).

State transition matrices say how a small change of a state grows along a ballistic trajectory. The variational equations
d(Phi)/dt = [[0, I], [G, 0]] Phi, with Phi = I at the start, are integrated by DOP853 together with the trajectory (Montenbruck
and Gill 2000, Satellite Orbits, section 7.2). The gradient G of the acceleration is taken by central differences of the field,
so that every gravity plug-in and every perturbation of the flight counts. A state is position [m] and velocity [m/s] in N.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.mission.deployment import groups
from swarm_mj.mission.trajectories import AccelerationN, integrate
from swarm_mj.typing import Array

#: Step of the central differences over the distance from the centre: errs by 1e-9 by curvature and by 1e-11 by rounding.
GRADIENT_STEP = 1e-5
#: Relative tolerance of trajectory and matrices.
TOLERANCE = 1e-12


@dataclass(frozen=True, kw_only=True)
class Transitions:
    """Trajectories of n bodies and how changes of their starts carry on.

    Attributes:
        times: Increasing; the first is the start, shape (t,) [s].
        r_N: Positions, shape (t, n, 3) [m].
        v_N: Velocities, shape (t, n, 3) [m/s].
        phi: Phi(times[k], times[0]), shape (t, n, 6, 6); blocks rr [-], rv [s], vr [1/s], vv [-].
    """

    times: Array
    r_N: Array
    v_N: Array
    phi: Array


def gravity_gradient(acceleration: AccelerationN, t: float, r_N: Array) -> tuple[Array, Array]:
    """Acceleration and its gradient by central differences.

    Args:
        acceleration: Function (t, r (n, 3)) -> (n, 3) [m/s^2] in N.
        t: [s].
        r_N: Positions, shape (n, 3) [m].

    Returns:
        Acceleration (n, 3) [m/s^2], and da_i/dr_j, shape (n, 3, 3) [1/s^2].
    """
    n = len(r_N)
    step = GRADIENT_STEP * np.maximum(np.linalg.norm(r_N, axis=1), 1.0)[:, None, None]
    offsets = step * np.vstack((np.zeros(3), np.eye(3), -np.eye(3)))
    a_N = acceleration(t, (r_N[:, None] + offsets).reshape(-1, 3)).reshape(n, 7, 3)
    return a_N[:, 0], ((a_N[:, 1:4] - a_N[:, 4:]) / (2.0 * step)).transpose(0, 2, 1)


def transitions(acceleration: AccelerationN, r0_N: Array, v0_N: Array, times: Array) -> Transitions:
    """Integrate n trajectories with their state transition matrices.

    Args:
        acceleration: Function (t, r (n, 3)) -> (n, 3) [m/s^2] in N.
        r0_N: Start positions, shape (n, 3) [m].
        v0_N: Start velocities, shape (n, 3) [m/s].
        times: Increasing output times [s]; the first is the start.

    Raises:
        MissionError: The integrator failed, for instance at an impact with a point mass.
    """
    n, span = len(r0_N), float(times[-1] - times[0])

    def rhs(t: float, y: Array) -> Array:
        x = y.reshape(n, 6, 7)
        a_N, gradient = gravity_gradient(acceleration, t, x[:, :3, 0])
        rate = np.empty_like(x)
        rate[:, :3] = x[:, 3:]
        rate[:, 3:, 0] = a_N
        rate[:, 3:, 1:] = gradient @ x[:, :3, 1:]
        return rate.ravel()

    # A body is a row of 6 x 7: its state, then the six columns of its matrix.
    start = np.concatenate((np.concatenate((r0_N, v0_N), axis=1)[:, :, None], np.tile(np.eye(6), (n, 1, 1))), axis=2)
    atol = np.tile(_smallest(span), (n, 1, 1)).ravel()
    x = integrate(rhs, start.ravel(), times, rtol=TOLERANCE, atol=atol).reshape(len(times), n, 6, 7)
    return Transitions(times=np.asarray(times), r_N=x[..., :3, 0], v_N=x[..., 3:, 0], phi=x[..., 1:])


def _smallest(span: float) -> Array:
    """Absolute tolerances of a state and its matrix, shape (6, 7): each block of the matrix in its own unit of time."""
    tolerance = np.full((6, 7), 1e-12)
    tolerance[:3, 0] = 1e-9
    tolerance[:3, 4:] *= span
    tolerance[3:, 1:4] /= span
    return tolerance


def inverse_transition(phi: Array, span: float) -> Array:
    """Inverse of state transition matrices, shape (..., 6, 6).

    Args:
        phi: Shape (..., 6, 6).
        span: Time that evens out the units of the blocks [s]; without it a long coast would cost digits.
    """
    scale = np.repeat((1.0, span), 3)
    ratio = scale[:, None] / scale
    return np.linalg.inv(phi * ratio) / ratio


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
        back = inverse_transition(flown.phi[:-1], flown.times[-1] - flown.times[0])
        phi[group] = (flown.phi[1:] @ back).swapaxes(0, 1)
    return Legs(times=times, r_N=r_N, v_N=v_N, phi=phi)
