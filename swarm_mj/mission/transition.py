"""State transition matrices along ballistic trajectories: how a small change of a state grows under the flight's forces.

The variational equations d(Phi)/dt = [[0, I], [G, 0]] Phi, with Phi = I at the start, are integrated by DOP853 together with
the trajectory (Montenbruck & Gill 2000, Satellite Orbits, section 7.2). The gradient G of the acceleration is taken by
central differences of the field, so that every gravity plug-in and every perturbation of the flight counts. A state is
position [m] and velocity [m/s] in N.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count

import numpy as np
from scipy.integrate import solve_ivp

from swarm_mj.errors import MissionError
from swarm_mj.mission.trajectories import MAX_EVALUATIONS, AccelerationN
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
    n, span, evaluations = len(r0_N), float(times[-1] - times[0]), count(1)

    def rhs(t: float, y: Array) -> Array:
        if next(evaluations) > MAX_EVALUATIONS:
            raise MissionError(f"{MAX_EVALUATIONS} evaluations reached t = {t:.6g} s only; check body.gravity")
        x = y.reshape(n, 6, 7)
        a_N, gradient = gravity_gradient(acceleration, t, x[:, :3, 0])
        rate = np.empty_like(x)
        rate[:, :3] = x[:, 3:]
        rate[:, 3:, 0] = a_N
        rate[:, 3:, 1:] = gradient @ x[:, :3, 1:]
        return rate.ravel()

    # A body is a row of 6 x 7: its state, then the six columns of its matrix.
    start = np.concatenate((np.concatenate((r0_N, v0_N), axis=1)[:, :, None], np.tile(np.eye(6), (n, 1, 1))), axis=2)
    solution = solve_ivp(
        rhs,
        (times[0], times[-1]),
        start.ravel(),
        method="DOP853",
        t_eval=times,
        rtol=TOLERANCE,
        atol=np.tile(_smallest(span), (n, 1, 1)).ravel(),
    )
    if not solution.success or not np.isfinite(solution.y).all():
        raise MissionError(f"a trajectory and its state transition cannot be integrated: {solution.message}")
    x = solution.y.T.reshape(len(times), n, 6, 7)
    return Transitions(times=np.asarray(times), r_N=x[..., :3, 0], v_N=x[..., 3:, 0], phi=x[..., 1:])


def _smallest(span: float) -> Array:
    """Absolute tolerances of a state and its matrix, shape (6, 7): each block of the matrix in its own unit of time."""
    tolerance = np.full((6, 7), 1e-12)
    tolerance[:3, 0] = 1e-9
    tolerance[:3, 4:] *= span
    tolerance[3:, 1:4] /= span
    return tolerance


def inverse(phi: Array, span: float) -> Array:
    """Inverse of state transition matrices, shape (..., 6, 6).

    Args:
        phi: Shape (..., 6, 6).
        span: Time that evens out the units of the blocks [s]; without it a long coast would cost digits.
    """
    scale = np.repeat((1.0, span), 3)
    ratio = scale[:, None] / scale
    return np.linalg.inv(phi * ratio) / ratio
