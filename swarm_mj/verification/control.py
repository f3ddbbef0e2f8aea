"""Control: the sliding mode law in closed loop against its equations written anew and integrated by SciPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from swarm_mj.simulator.simulation import FlightSamples
from swarm_mj.simulator.state import InitialState
from swarm_mj.spacecraft.control import MrpSlidingMode
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array
from swarm_mj.verification.experiment import Bench, experiment
from swarm_mj.verification.flights import fly, gyrostat, rotational_state
from swarm_mj.verification.reference import eros_acceleration, eros_attitude

DURATION_S, PERIOD_S = 120.0, 0.5
#: State of the reference: position, velocity, attitude (w, x, y, z), body rate, wheel speeds.
R, V, Q, OMEGA, WHEELS = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13), slice(13, 16)


def slew(bench: Bench, duration: float = DURATION_S) -> FlightSamples:
    """A spacecraft that passes Eros and turns from a random attitude to track its centre."""
    initial = InitialState(
        r_BN_N=np.array([[24e3, -6e3, 5e3]]),
        v_BN_N=np.array([[-10.0, 45.0, 8.0]]),
        sigma_BN=np.array([[0.3, -0.5, 0.2]]),
        omega_BN_B=np.array([[0.01, -0.02, 0.015]]),
        wheel_speed=np.array([[40.0, -30.0, 20.0]]),
    )
    return fly(bench, initial, duration, PERIOD_S, timestep=0.1, controller=MrpSlidingMode())


def expected_states(start: Array, duration: float = DURATION_S) -> Array:
    """The same flight by the equations alone: state at every control period, shape (t, 16)."""
    body, states = gyrostat(), [start]
    base = Rotation.from_quat(start[Q], scalar_first=True)
    limit = SpacecraftProperties().max_wheel_torque
    for k in range(round(duration / PERIOD_S)):
        state, t = states[-1], k * PERIOD_S
        base = aligned(base, -state[R])
        motor = np.clip(-law(state, t, base), -limit, limit)

        def rates(t: float, y: Array, motor: Array = motor) -> Array:
            return np.concatenate((y[V], attraction(t, y[R]), body.rates(y[6:], motor)))

        # Motions are slow for a period: its whole length, tried first, is nearly always fine enough.
        given = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-11, "first_step": PERIOD_S}
        states.append(solve_ivp(rates, (t, t + PERIOD_S), state, **given).y[:, -1])
    return np.array(states)


def attraction(t: float, r_N: Array) -> Array:
    """Attraction of Eros in N [m/s^2], shape (3,)."""
    C_AN = eros_attitude(t)
    return eros_acceleration(C_AN @ r_N) @ C_AN


def aligned(attitude: Rotation, direction_N: Array) -> Rotation:
    """The attitude turned on the shortest way until its +z axis has the direction."""
    z = attitude.apply([0.0, 0.0, 1.0])
    axis = np.cross(z, direction_N)
    angle = np.arctan2(np.linalg.norm(axis), z @ direction_N)
    norm = np.linalg.norm(axis)
    return attitude if norm == 0.0 else Rotation.from_rotvec(angle * axis / norm) * attitude


def law(state: Array, t: float, reference: Rotation) -> Array:
    """Torque on the body in B [N m], shape (3,), by the equations of docs/theory/attitude_control.md."""
    p, body = MrpSlidingMode(), gyrostat()
    attitude, omega = Rotation.from_quat(state[Q], scalar_first=True), state[OMEGA]
    rho, rho_dot, rho_ddot = -state[R], -state[V], -attraction(t, state[R])
    square = rho @ rho
    turning = np.cross(rho, rho_dot) / square
    turning_dot = (np.cross(rho, rho_ddot) - 2.0 * (rho @ rho_dot) * turning) / square
    omega_R, domega_R = attitude.inv().apply(turning), attitude.inv().apply(turning_dot)
    sigma, error = (reference.inv() * attitude).as_mrp(), omega - omega_R
    sigma_dot = mrp_matrix(sigma) @ error / 4.0
    # The derivative of the commanded rate along sigma_dot, by a step into the complex plane.
    m_dot = commanded_rate(sigma + 1e-30j * sigma_dot).imag / 1e-30
    on_manifold = domega_R - np.cross(omega, omega_R) - m_dot
    s = error + commanded_rate(sigma).real
    J = np.diag(body.inertia)
    J_eff, delta = J - body.wheel_inertia, p.inertia_uncertainty
    pair = np.abs(np.roll(omega, -1) * np.roll(omega, -2)) * (np.roll(J, -1) + np.roll(J, -2)) / J_eff
    spoiled = delta * (np.abs(on_manifold) + (1.0 + delta) / (1.0 - delta) * pair)
    gain = (p.reaching_rate + (1.0 + delta) * p.disturbance_torque / J_eff + spoiled) / (1.0 - delta)
    reaching = gain * np.clip(s / p.layer, -1.0, 1.0) + p.damping * s
    momentum = body.momentum_B(omega, state[WHEELS])
    return np.cross(omega, momentum) + J_eff * (on_manifold - reaching)


def commanded_rate(sigma: NDArray[np.complex128] | Array) -> NDArray[np.complex128]:
    """m(sigma) [rad/s], shape (3,)."""
    p = MrpSlidingMode()
    bend = 0.0 if p.rate_limit is None else (p.slope / p.rate_limit) ** 2
    return np.asarray(p.slope * sigma / np.sqrt(1.0 + bend * np.sum(sigma * sigma)), dtype=np.complex128)


def mrp_matrix(sigma: Array) -> Array:
    """B of sigma_dot = B omega / 4, shape (3, 3)."""
    x, y, z = sigma
    tilde = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return (1.0 - sigma @ sigma) * np.eye(3) + 2.0 * tilde + 2.0 * np.outer(sigma, sigma)


@experiment("control-sliding-mode", "the law, guidance and plant written anew, SciPy DOP853", 1e-7, "rad")
def loop_error(bench: Bench) -> float:
    """Attitude while slewing to and tracking Eros, 120 s."""
    return largest_angle(bench.once(slew), DURATION_S)


def largest_angle(flight: FlightSamples, duration: float) -> float:
    """Largest angle between a flight and its equations [rad]."""
    start = np.concatenate(
        (flight.samples["r_BN_N"][0, 0], flight.samples["v_BN_N"][0, 0], rotational_state(flight, 0, 0))
    )
    expected = Rotation.from_quat(expected_states(start, duration)[:, Q], scalar_first=True)
    simulated = Rotation.from_quat(flight.samples["q_BN"][:, 0], scalar_first=True)
    return float((simulated * expected.inv()).magnitude().max())
