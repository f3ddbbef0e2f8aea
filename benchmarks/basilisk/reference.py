"""The flight by SciPy: the equations written anew, DOP853 from control period to control period, tolerance 1e-12.

Neither program takes part but for constants: gravity in Cartesian form, rotation from the IAU's angles, the attitude as a
quaternion, wheels by their absolute momentum.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from benchmarks.basilisk.problem import DURATION_S, K_N_M, LEG_S, P_N_M_S, PERIOD_S, Flight, Problem
from swarm_mj.scenarios import constants
from swarm_mj.verification.reference import degree_2_matrix, eros_attitude

Array = NDArray[np.float64]

#: Columns of the state: position, velocity, quaternion (w, x, y, z), body rate, wheel momenta.
R, V, Q, OMEGA, H = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13), slice(13, 16)


def fly(problem: Problem, longest_step: float = 0.25 * PERIOD_S) -> Flight:
    """Fly and record every control period, with steps of `longest_step` [s] at most."""
    properties, start = problem.properties, problem.initial
    spin = properties.wheel_spin_inertia
    inertia = np.diag(properties.inertia_B) - spin
    attitude = Rotation.from_mrp(start.sigma_BN).as_quat(scalar_first=True)
    momentum = spin * (start.wheel_speed + start.omega_BN_B)
    states = [np.hstack((start.r_BN_N, start.v_BN_N, attitude, start.omega_BN_B, momentum))]
    options = {"rtol": 1e-12, "atol": 1e-12, "first_step": longest_step, "max_step": longest_step}
    legs = [Rotation.concatenate(leg) for leg in problem.references]
    for k in range(round(DURATION_S / PERIOD_S)):
        state, t = states[-1], k * PERIOD_S
        target = legs[min(int(t / LEG_S), len(legs) - 1)]
        motor = np.clip(-law(state, target, inertia), -properties.max_wheel_torque, properties.max_wheel_torque)

        def rates(t: float, y: Array, motor: Array = motor) -> Array:
            return derivative(t, y.reshape(-1, 16), motor, inertia).ravel()

        span = (t, t + PERIOD_S)
        end = solve_ivp(rates, span, state.ravel(), "DOP853", **options).y
        after = end[:, -1].reshape(-1, 16)
        after[:, Q] /= np.linalg.norm(after[:, Q], axis=1, keepdims=True)
        states.append(after)
    flown = np.array(states)
    return Flight(r_N=flown[..., R], attitude=flown[..., Q], wheel_speed=flown[..., H] / spin - flown[..., OMEGA])


def law(state: Array, target: Rotation, inertia: Array) -> Array:
    """Torque on the bodies in B [N m], shape (n, 3); the references stand still."""
    attitude = Rotation.from_quat(state[:, Q], scalar_first=True)
    omega = state[:, OMEGA]
    sigma = (target.inv() * attitude).as_mrp()
    return np.cross(omega, inertia * omega + state[:, H]) - K_N_M * sigma - P_N_M_S * omega


def derivative(t: float, state: Array, motor: Array, inertia: Array) -> Array:
    """Time derivative of the states of n spacecraft, shape (n, 16)."""
    C_AN = eros_attitude(t)
    r_A, q, omega, h = state[:, R] @ C_AN.T, state[:, Q], state[:, OMEGA], state[:, H]
    w, v = q[:, :1], q[:, 1:]
    out = np.empty_like(state)
    out[:, R], out[:, V] = state[:, V], attraction(r_A) @ C_AN
    out[:, 6:7], out[:, 7:10] = -0.5 * np.sum(v * omega, axis=1, keepdims=True), 0.5 * (w * omega + np.cross(v, omega))
    out[:, OMEGA] = (-np.cross(omega, inertia * omega + h) - motor) / inertia
    out[:, H] = motor
    return out


def attraction(r_A: Array) -> Array:
    """Attraction of Eros of degree 2 in A [m/s^2], shape (n, 3), from the gradient of GM/r + GM R^2 (r.Q.r) / r^5."""
    r = np.linalg.norm(r_A, axis=1, keepdims=True)
    turned = r_A @ degree_2_matrix()
    oblate = 2.0 * turned / r**5 - 5.0 * np.sum(r_A * turned, axis=1, keepdims=True) * r_A / r**7
    return constants.EROS_GM * (-r_A / r**3 + constants.EROS_REFERENCE_RADIUS**2 * oblate)
