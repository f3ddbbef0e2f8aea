"""How far a free tumble drifts with the speed at which the spacecraft travels, which should not matter at all.

MuJoCo's momentum balance of linked bodies sums terms v x m v, whose total is zero but for rounding; a gyrostat is one body, in
which they vanish. Far from everything, no motor torque, against SciPy's DOP853.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.basilisk.problem import Problem
from swarm_mj.simulator.fast.integrator import Integrator
from swarm_mj.spacecraft.model import WheelModel, build_model
from swarm_mj.verification.physics.reference import Gyrostat

SPEEDS_M_S = (0.0, 10.0, 40.0)
DURATION_S, STEP_S = 600.0, 0.05
ROTATION = np.array([0.02, -0.03, 0.01, 100.0, -50.0, 80.0])
HEADING = np.array([10.0, 7.0, -4.0]) / np.linalg.norm([10.0, 7.0, -4.0])


def drift(problem: Problem) -> list[dict[str, Any]]:
    """Angle from SciPy after the tumble [rad], by speed and model of the wheels."""
    properties = problem.properties
    plant = Gyrostat(inertia=properties.inertia_B, wheel_inertia=properties.wheel_spin_inertia)
    start = np.concatenate(([1.0, 0.0, 0.0, 0.0], ROTATION))
    span = (0.0, DURATION_S)
    end = solve_ivp(lambda t, y: plant.rates(y, np.zeros(3)), span, start, "DOP853", rtol=1e-13, atol=1e-13).y[:4, -1]
    rows = []
    for speed in SPEEDS_M_S:
        angles = {wheels: _angle(tumble(problem, speed, wheels), end) for wheels in ("bodies", "gyrostat")}
        rows.append({"speed_m_s": speed, **angles})
    return rows


def tumble(problem: Problem, speed: float, wheels: WheelModel) -> np.ndarray:
    """Attitude at the end, (w, x, y, z)."""
    built = build_model(1, shape=problem.plan.shape, properties=problem.properties, timestep=STEP_S, wheels=wheels)
    data = mujoco.MjData(built.mjmodel)
    qpos = np.zeros((1, 10))
    qpos[0, 3] = 1.0
    built.set_state(data, qpos, np.concatenate((speed * HEADING, ROTATION))[None])
    Integrator(built, data).step(round(DURATION_S / STEP_S))
    return built.state(data)[0][0, 3:7].copy()


def _angle(one: np.ndarray, other: np.ndarray) -> float:
    one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
    return float(2.0 * min(np.linalg.norm(one - other), np.linalg.norm(one + other)))
