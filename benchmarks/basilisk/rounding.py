"""How far a free tumble drifts with the speed at which the spacecraft travels, which should not matter at all.

MuJoCo's momentum balance of linked bodies sums terms v x m v, whose total is zero but for rounding; a gyrostat is one body, in
which they vanish. Far from everything, no motor torque, against SciPy's DOP853.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.basilisk.problem import PERIOD_S, STEPPERS, Problem
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.simulator.batch import FlightBatch
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.state import InitialState
from swarm_mj.spacecraft.model import Stepper, build_model
from swarm_mj.verification.reference import Gyrostat

SPEEDS_M_S = (0.0, 10.0, 40.0)
DURATION_S, STEP_S = 600.0, 0.05
ROTATION = np.array([0.02, -0.03, 0.01, 100.0, -50.0, 80.0])
HEADING = np.array([10.0, 7.0, -4.0]) / np.linalg.norm([10.0, 7.0, -4.0])


class Nothing:
    """A field that pulls nobody."""

    def acceleration(self, r_A: np.ndarray) -> np.ndarray:
        """None [m/s^2]."""
        return np.zeros_like(r_A)


def drift(problem: Problem) -> list[dict[str, Any]]:
    """Angle from SciPy after the tumble [rad], by speed and stepper."""
    properties = problem.properties
    plant = Gyrostat(inertia=properties.inertia_B, wheel_inertia=properties.wheel_spin_inertia)
    start = np.concatenate(([1.0, 0.0, 0.0, 0.0], ROTATION))
    span = (0.0, DURATION_S)
    end = solve_ivp(lambda t, y: plant.rates(y, np.zeros(3)), span, start, "DOP853", rtol=1e-13, atol=1e-13).y[:4, -1]
    rows = []
    for speed in SPEEDS_M_S:
        angles = {stepper: _angle(tumble(problem, speed, stepper), end) for stepper in STEPPERS}
        rows.append({"speed_m_s": speed, **angles})
    return rows


def tumble(problem: Problem, speed: float, stepper: Stepper) -> np.ndarray:
    """Attitude at the end, (w, x, y, z)."""
    model = build_model(1, shape=problem.plan.shape, properties=problem.properties, timestep=STEP_S, stepper=stepper)
    nowhere = replace(problem.environment, gravity=Nothing())
    batch = FlightBatch(FlightSetup(model=model, environment=nowhere, period=PERIOD_S), 1)
    none = np.zeros((1, 3))
    start = InitialState(
        r_BN_N=none,
        v_BN_N=speed * HEADING[None],
        sigma_BN=none,
        omega_BN_B=ROTATION[None, :3],
        wheel_speed=ROTATION[None, 3:],
    )
    batch.reset(0, start)
    batch.hold(
        Targets(np.full((1, 1), int(TargetKind.EARTH)), np.zeros((1, 1), np.int64), np.zeros((1, 1, 3))), none[None]
    )
    batch.fly(round(DURATION_S / PERIOD_S))
    return batch.flights.q_BN[0, 0].copy()


def _angle(one: np.ndarray, other: np.ndarray) -> float:
    one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
    return float(2.0 * min(np.linalg.norm(one - other), np.linalg.norm(one + other)))
