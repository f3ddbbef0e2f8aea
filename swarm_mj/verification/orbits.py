"""Orbits: a day around Eros against SciPy's integrator in the rotating frame, and the Jacobi constant."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from swarm_mj.scenarios.constants import EROS_GM
from swarm_mj.simulator.state import InitialState
from swarm_mj.typing import Array
from swarm_mj.verification.experiment import Bench, Experiment
from swarm_mj.verification.flights import Flight, fly
from swarm_mj.verification.reference import SPIN_RATE, eros_acceleration, eros_attitude, eros_potential

DAY_S, INTERVAL_S = 86_400.0, 600.0
PERIAPSIS_M, APOAPSIS_M, INCLINATION = 35e3, 60e3, np.radians(60.0)
SPIN_A = np.array([0.0, 0.0, SPIN_RATE])


def start_A() -> tuple[Array, Array]:
    """Periapsis of the orbit and inertial velocity there, in A at the epoch, each (3,) [m], [m/s]."""
    speed = np.sqrt(2.0 * EROS_GM * APOAPSIS_M / (PERIAPSIS_M * (PERIAPSIS_M + APOAPSIS_M)))
    return np.array([PERIAPSIS_M, 0.0, 0.0]), speed * np.array([0.0, np.cos(INCLINATION), np.sin(INCLINATION)])


def day(bench: Bench) -> Flight:
    """One spacecraft for 24 h."""
    C_AN = eros_attitude(0.0)
    r_A, v_A = start_A()
    still = np.zeros((1, 3))
    initial = InitialState(
        r_BN_N=(r_A @ C_AN)[None],
        v_BN_N=(v_A @ C_AN)[None],
        sigma_BN=still,
        omega_BN_B=still,
        wheel_speed=still,
    )
    return fly(bench, initial, DAY_S, INTERVAL_S, timestep=0.5)


def orbit_error(bench: Bench) -> float:
    """Largest distance between the simulation and SciPy over 24 h [m]."""
    flight = bench.once(day)
    r_A, v_A = start_A()

    def rates(t: float, y: Array) -> Array:
        r, v = y[:3], y[3:]
        fictitious = 2.0 * np.cross(SPIN_A, v) + np.cross(SPIN_A, np.cross(SPIN_A, r))
        return np.concatenate((v, eros_acceleration(r) - fictitious))

    start = np.concatenate((r_A, v_A - np.cross(SPIN_A, r_A)))
    solution = solve_ivp(rates, (0.0, DAY_S), start, method="DOP853", t_eval=flight.time, rtol=1e-12, atol=1e-9)
    expected = np.array([r @ eros_attitude(t) for t, r in zip(flight.time, solution.y[:3].T, strict=True)])
    return float(np.linalg.norm(flight.r_N[:, 0] - expected, axis=1).max())


def jacobi_drift(bench: Bench) -> float:
    """Largest relative change of the Jacobi constant over 24 h."""
    flight = bench.once(day)
    C_AN = np.array([eros_attitude(t) for t in flight.time])
    r_A, v_A = (np.einsum("tij,tj->ti", C_AN, x[:, 0]) for x in (flight.r_N, flight.v_N))
    # v_rot^2 / 2 - (w x r)^2 / 2 - U with v_rot = v - w x r is v^2 / 2 - v.(w x r) - U.
    constant = 0.5 * np.sum(v_A**2, axis=1) - np.sum(v_A * np.cross(SPIN_A, r_A), axis=1) - eros_potential(r_A)
    return float(np.abs(constant / constant[0] - 1.0).max())


EXPERIMENTS = (
    Experiment(
        name="orbit-day",
        what="position in a 35 x 60 km orbit over 24 h, step 0.5 s",
        reference="SciPy DOP853 in the rotating frame, field of degree 2 in Cartesian form",
        tolerance=1.0,
        unit="m",
        measure=orbit_error,
    ),
    Experiment(
        name="orbit-jacobi",
        what="Jacobi constant in the same orbit over 24 h, relative",
        reference="conservation in the rotating frame",
        tolerance=1e-9,
        unit="1",
        measure=jacobi_drift,
    ),
)
