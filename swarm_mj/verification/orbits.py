"""Orbits: a day around Eros against SciPy's integrator in the rotating frame, the Jacobi constant, and where a swarm is."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.scenarios.constants import EROS_GM
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.simulation import FlightSamples
from swarm_mj.simulator.state import InitialState
from swarm_mj.typing import Array
from swarm_mj.verification.experiment import Bench, experiment
from swarm_mj.verification.flights import fly
from swarm_mj.verification.reference import SPIN_RATE, eros_acceleration, eros_attitude, eros_potential

DAY_S, INTERVAL_S = 86_400.0, 600.0
PERIAPSIS_M, APOAPSIS_M, INCLINATION = 35e3, 60e3, np.radians(60.0)
SPIN_A = np.array([0.0, 0.0, SPIN_RATE])


def start_A() -> tuple[Array, Array]:
    """Periapsis of the orbit and inertial velocity there, in A at the epoch, each (3,) [m], [m/s]."""
    speed = np.sqrt(2.0 * EROS_GM * APOAPSIS_M / (PERIAPSIS_M * (PERIAPSIS_M + APOAPSIS_M)))
    return np.array([PERIAPSIS_M, 0.0, 0.0]), speed * np.array([0.0, np.cos(INCLINATION), np.sin(INCLINATION)])


def day(bench: Bench) -> FlightSamples:
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


@experiment("orbit-day", "SciPy DOP853 in the rotating frame, field of degree 2 in Cartesian form", 1.0, "m")
def orbit_error(bench: Bench) -> float:
    """Position in a 35 x 60 km orbit over 24 h, step 0.5 s."""
    flight = bench.once(day)
    r_A, v_A = start_A()

    def rates(t: float, y: Array) -> Array:
        r, v = y[:3], y[3:]
        fictitious = 2.0 * np.cross(SPIN_A, v) + np.cross(SPIN_A, np.cross(SPIN_A, r))
        return np.concatenate((v, eros_acceleration(r) - fictitious))

    start = np.concatenate((r_A, v_A - np.cross(SPIN_A, r_A)))
    solution = solve_ivp(rates, (0.0, DAY_S), start, method="DOP853", t_eval=flight.time, rtol=1e-12, atol=1e-9)
    expected = np.array([r @ eros_attitude(t) for t, r in zip(flight.time, solution.y[:3].T, strict=True)])
    return float(np.linalg.norm(flight.samples["r_BN_N"][:, 0] - expected, axis=1).max())


@experiment("orbit-jacobi", "conservation in the rotating frame", 1e-9)
def jacobi_drift(bench: Bench) -> float:
    """Jacobi constant in the same orbit over 24 h, relative."""
    flight = bench.once(day)
    C_AN = np.array([eros_attitude(t) for t in flight.time])
    r_A, v_A = (np.einsum("tij,tj->ti", C_AN, x[:, 0]) for x in (flight.samples["r_BN_N"], flight.samples["v_BN_N"]))
    # v_rot^2 / 2 - (w x r)^2 / 2 - U with v_rot = v - w x r is v^2 / 2 - v.(w x r) - U.
    constant = 0.5 * np.sum(v_A**2, axis=1) - np.sum(v_A * np.cross(SPIN_A, r_A), axis=1) - eros_potential(r_A)
    return float(np.abs(constant / constant[0] - 1.0).max())


def quick_plan(bench: Bench) -> Plan:
    """The packaged scenario eros-quick, ready to fly."""
    return make_plan(load_scenario("eros-quick"))


@experiment("trajectories-miss", "SciPy LSODA, field of degree 2 in Cartesian form", 1e-3, "m")
def miss(bench: Bench) -> float:
    """Miss of the visiting points of eros-quick at the time of flight."""
    plan = bench.once(quick_plan)
    design, mothership = plan.scenario.design, plan.scenario.mothership

    def rates(t: float, y: Array) -> Array:
        C_AN = eros_attitude(t)
        return np.concatenate((y[3:], eros_acceleration(C_AN @ y[:3]) @ C_AN))

    distances = []
    for point_A, v0 in zip(plan.points_A, plan.deployment.v0_N, strict=True):
        start = np.concatenate((np.array(mothership.position_A_m) @ eros_attitude(0.0), v0))
        solution = solve_ivp(rates, (0.0, design.time_of_flight_s), start, method="LSODA", rtol=1e-12, atol=1e-9)
        arrival_A = eros_attitude(design.time_of_flight_s) @ solution.y[:3, -1]
        distances.append(np.linalg.norm(arrival_A - point_A))
    return float(max(distances))
