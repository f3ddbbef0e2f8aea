"""Attitude: MRP algebra against SciPy's rotations, conservation laws of body and wheels, and the integrator's order."""

from __future__ import annotations

from math import log2

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from swarm_mj.simulator.simulation import FlightSamples
from swarm_mj.simulator.state import InitialState
from swarm_mj.spacecraft.attitude.mrp import dcm, mrp_rate
from swarm_mj.verification.experiment import Bench, experiment
from swarm_mj.verification.flights import fly, gyrostat, rotational_state

TUMBLING_S, STUDY_S, STUDY_STEPS_S = 1200.0, 300.0, (0.5, 0.25, 0.125)
SPACECRAFT = 4


@experiment("attitude-matrices", "SciPy's Rotation", 1e-14)
def matrices_error(bench: Bench) -> float:
    """Elements of C_BN from MRP of both sets."""
    sigma = np.random.default_rng(3).uniform(-1.5, 1.5, (500, 3))
    expected = Rotation.from_mrp(sigma).as_matrix().swapaxes(1, 2)
    return float(np.abs(dcm(sigma) - expected).max())


@experiment("attitude-kinematics", "differences along rotations turned by SciPy", 1e-9)
def kinematics_error(bench: Bench) -> float:
    """Rate of the MRP, relative."""
    rng = np.random.default_rng(4)
    start, omega = Rotation.from_rotvec(rng.uniform(-1.5, 1.5, (300, 3))), rng.uniform(-1.0, 1.0, (300, 3))
    step = 1e-3
    weights = {-2: 1.0, -1: -8.0, 1: 8.0, 2: -1.0}
    expected = sum(w * (start * Rotation.from_rotvec(k * step * omega)).as_mrp() for k, w in weights.items())
    expected = expected / (12.0 * step)
    error = np.linalg.norm(mrp_rate(start.as_mrp(), omega) - expected, axis=1)
    return float(np.max(error / np.linalg.norm(expected, axis=1)))


def tumbling_start() -> InitialState:
    """Far from each other, rates up to 0.6 rpm about every axis, wheels at up to 300 rad/s."""
    rng = np.random.default_rng(5)
    shape = (SPACECRAFT, 3)
    return InitialState(
        r_BN_N=rng.uniform(30e3, 40e3, shape),
        v_BN_N=np.zeros(shape),
        sigma_BN=rng.uniform(-0.5, 0.5, shape),
        omega_BN_B=rng.uniform(-0.06, 0.06, shape),
        wheel_speed=rng.uniform(-300.0, 300.0, shape),
    )


def tumbling(bench: Bench) -> FlightSamples:
    """Twenty minutes without torque at the default step."""
    return fly(bench, tumbling_start(), TUMBLING_S, 10.0, timestep=0.1)


@experiment("attitude-momentum", "conservation", 1e-8)
def momentum_drift(bench: Bench) -> float:
    """Angular momentum of body and wheels in 1,200 s of torque-free tumbling, relative."""
    flight = bench.once(tumbling)
    momentum_B = gyrostat().momentum_B(flight.samples["omega_BN_B"], flight.samples["wheel_speed"])
    to_N = Rotation.from_quat(flight.samples["q_BN"].reshape(-1, 4), scalar_first=True)
    momentum_N = to_N.apply(momentum_B.reshape(-1, 3)).reshape(momentum_B.shape)
    change = np.linalg.norm(momentum_N - momentum_N[0], axis=2)
    return float(np.max(change / np.linalg.norm(momentum_N[0], axis=1)))


@experiment("attitude-energy", "conservation", 1e-7)
def energy_drift(bench: Bench) -> float:
    """Energy of body and wheels in 1,200 s of torque-free tumbling, over the body's.

    The fast wheels hold a thousand times more, which hardly changes and would hide what the body does.
    """
    flight = bench.once(tumbling)
    energy = gyrostat().energy(flight.samples["omega_BN_B"], flight.samples["wheel_speed"])
    body = gyrostat().energy(flight.samples["omega_BN_B"][0], np.zeros(3))
    return float(np.max(np.abs(energy - energy[0]) / body))


@experiment("attitude-gyrostat", "equations of a gyrostat by SciPy DOP853", 1e-6, "rad")
def gyrostat_error(bench: Bench) -> float:
    """Attitude after 1,200 s of torque-free tumbling, step 0.1 s."""
    return attitude_error(bench.once(tumbling))


@experiment("attitude-order", "4: the error falls by 16 where the step is halved", 0.25)
def order_error(bench: Bench) -> float:
    """Order in the step by which attitudes after 300 s converge, less 4.

    An error c h^4 (1 + d h) falls by 16 (1 + d h / 2) from a step h to its half, and by 16 (1 + d h / 4) from there to its
    half: twice the second ratio less the first is that of vanishing steps, but for terms of h^2. For these stands the
    tolerance, a quarter of what parts one order from the next.
    """
    coarse, middle, fine = (
        attitude_error(fly(bench, tumbling_start(), STUDY_S, STUDY_S, timestep=step, period=STUDY_STEPS_S[0]))
        for step in STUDY_STEPS_S
    )
    return abs(log2(max(2.0 * middle / fine - coarse / middle, 1e-9)) - 4.0)


@experiment("attitude-step", "MuJoCo's mj_step", 1e-8, "rad/s")
def step_error(bench: Bench) -> float:
    """Body rates after 300 s of tumbling by the kernel, step 0.1 s."""
    flights = [fly(bench, tumbling_start(), STUDY_S, STUDY_S, stepper=stepper) for stepper in ("mujoco", "kernel")]
    return float(np.abs(flights[0].samples["omega_BN_B"] - flights[1].samples["omega_BN_B"]).max())


def attitude_error(flight: FlightSamples) -> float:
    """Largest angle at the end of a torque-free flight from the attitude that SciPy finds [rad]."""
    body, end = gyrostat(), float(flight.time[-1])
    angles = []
    for j in range(flight.samples["q_BN"].shape[1]):
        solution = solve_ivp(
            lambda t, y: body.rates(y, np.zeros(3)),
            (0.0, end),
            rotational_state(flight, 0, j),
            method="DOP853",
            t_eval=[end],
            rtol=1e-12,
            atol=1e-12,
        )
        expected = Rotation.from_quat(solution.y[:4, 0], scalar_first=True)
        angles.append(
            (Rotation.from_quat(flight.samples["q_BN"][-1, j], scalar_first=True) * expected.inv()).magnitude()
        )
    return float(max(angles))
