"""Trajectories: where the deployed swarm really arrives, by another integrator and another form of the field."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.typing import Array
from swarm_mj.verification.experiment import Bench, Experiment
from swarm_mj.verification.reference import eros_acceleration, eros_attitude


def quick_plan(bench: Bench) -> Plan:
    """The packaged scenario eros-quick, ready to fly."""
    return make_plan(load_scenario("eros-quick"))


def miss(bench: Bench) -> float:
    """Largest distance to the visiting points at the time of flight [m]."""
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


EXPERIMENTS = (
    Experiment(
        name="trajectories-miss",
        what="miss of the visiting points of eros-quick at the time of flight",
        reference="SciPy LSODA, field of degree 2 in Cartesian form",
        tolerance=1e-3,
        unit="m",
        measure=miss,
    ),
)
