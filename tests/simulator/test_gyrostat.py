"""Wheels as momentum states against wheels as bodies, SciPy and the conservation of angular momentum."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarm_mj.errors import ScenarioError, SimulationError
from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.fast.integrator import Integrator, accelerate
from swarm_mj.simulator.fast.mj_memory import mj_view
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.attitude.mrp import dcm, mrp_from_quaternion
from swarm_mj.spacecraft.model import build_model
from swarm_mj.spacecraft.properties import SpacecraftProperties

N = 2
PROPERTIES = SpacecraftProperties()
INERTIA, SPIN = PROPERTIES.inertia_effective_B, PROPERTIES.wheel_spin_inertia


@pytest.fixture(scope="module")
def tetrahedron():
    vertices = 1e3 * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return ShapeModel(vertices, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))


#: MuJoCo's accelerations, or the closed equations alone.
STEPPERS = pytest.mark.parametrize("stepper", ["auto", "kernel"])


def spinning(shape, wheels, timestep=0.1, stepper="auto"):
    """Two tumbling spacecraft with fast wheels; model and data."""
    model = build_model(N, shape=shape, timestep=timestep, wheels=wheels, stepper=stepper)
    data = mujoco.MjData(model.mjmodel)
    qpos, qvel = np.zeros((N, 10)), np.zeros((N, 9))
    rng = np.random.default_rng(3)
    qpos[:, 3:7] = rng.normal(size=(N, 4))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    qvel[:, 3:6], qvel[:, 6:9] = rng.uniform(-0.1, 0.1, (N, 3)), rng.uniform(-400.0, 400.0, (N, 3))
    model.set_state(data, qpos, qvel)
    return model, data


def fly(model, data, duration):
    Integrator(model, data).step(round(duration / model.mjmodel.opt.timestep))
    return model.state(data)


def momentum_N(qpos, qvel):
    C_BN = dcm(mrp_from_quaternion(qpos[:, 3:7]))
    wheels = SPIN * (qvel[:, 6:9] + qvel[:, 3:6])
    return np.einsum("nji,nj->ni", C_BN, qvel[:, 3:6] @ INERTIA + wheels)


def scipy_flight(q0, omega0, momentum0, motor, duration):
    """One spacecraft by DOP853: quaternion (w, x, y, z) and body rate at the end; wheels along the body's axes."""

    def derivative(t, y):
        (w, x, y_, z), omega = y[:4], y[4:]
        a, b, c = omega
        spin = 0.5 * np.array(
            [-x * a - y_ * b - z * c, w * a + y_ * c - z * b, w * b + z * a - x * c, w * c + x * b - y_ * a]
        )
        total = INERTIA @ omega + momentum0 + motor * t
        return np.concatenate((spin, np.linalg.solve(INERTIA, -motor - np.cross(omega, total))))

    end = solve_ivp(derivative, (0, duration), np.concatenate((q0, omega0)), "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return end[:4] / np.linalg.norm(end[:4]), end[4:]


def angle(q, p):
    """Between attitudes [rad], accurate when small."""
    return 2.0 * np.min([np.linalg.norm(q - p, axis=-1), np.linalg.norm(q + p, axis=-1)], axis=0)


def test_state_reads_back_what_was_set(tetrahedron):
    for wheels in ("bodies", "gyrostat"):
        model, data = spinning(tetrahedron, wheels)
        qpos, qvel = (array.copy() for array in model.state(data))
        model.set_state(data, qpos, qvel)
        again = model.state(data)
        assert np.allclose(again[0], qpos, rtol=0, atol=0)
        assert np.allclose(again[1], qvel, rtol=1e-14, atol=1e-13)
    bodies = spinning(tetrahedron, "bodies")
    assert np.allclose(bodies[0].state(bodies[1])[1], qvel, rtol=1e-14, atol=1e-13)


def test_mass_and_inertia_of_hub_and_wheels_stay_on_the_one_body(tetrahedron):
    model = build_model(N, shape=tetrahedron, wheels="gyrostat").mjmodel
    assert model.nbody == 2 + N and model.na == 3 * N
    hub = model.body("sc2_cubesat")
    assert hub.mass[0] == pytest.approx(8.0)
    assert np.allclose(np.sort(hub.inertia), np.sort(np.diag(PROPERTIES.inertia_B) - SPIN), rtol=1e-12)


@STEPPERS
def test_motion_under_motor_torques_agrees_with_dop853(tetrahedron, stepper):
    model, data = spinning(tetrahedron, "gyrostat", 0.05, stepper)
    qpos, qvel = (array.copy() for array in model.state(data))
    motor = np.array([[1e-3, -2e-3, 5e-4], [-3e-3, 1e-3, 2e-3]])
    data.ctrl[:] = motor.ravel()
    end_q, end_v = (array.copy() for array in fly(model, data, 5.0))
    for j in range(N):
        momentum = SPIN * (qvel[j, 6:9] + qvel[j, 3:6])
        q, omega = scipy_flight(qpos[j, 3:7], qvel[j, 3:6], momentum, motor[j], 5.0)
        assert angle(end_q[j, 3:7], q) < 1e-8
        assert np.allclose(end_v[j, 3:6], omega, rtol=0, atol=1e-8)
        assert np.allclose(end_v[j, 6:9], (momentum + 5.0 * motor[j]) / SPIN - omega, rtol=1e-9)


@STEPPERS
def test_attitude_converges_at_fourth_order(tetrahedron, stepper):
    errors = []
    for timestep in (0.4, 0.2, 0.1):
        model, data = spinning(tetrahedron, "gyrostat", timestep, stepper)
        qpos, qvel = (array.copy() for array in model.state(data))
        end, _ = fly(model, data, 20.0)
        momentum = SPIN * (qvel[0, 6:9] + qvel[0, 3:6])
        errors.append(angle(end[0, 3:7], scipy_flight(qpos[0, 3:7], qvel[0, 3:6], momentum, np.zeros(3), 20.0)[0]))
    assert errors[0] / errors[1] > 12.0 and errors[1] / errors[2] > 12.0


@STEPPERS
def test_angular_momentum_stays_in_inertial_space_whatever_the_motors_do(tetrahedron, stepper):
    model, data = spinning(tetrahedron, "gyrostat", 0.02, stepper)
    before = momentum_N(*model.state(data))
    rng = np.random.default_rng(1)
    for _ in range(20):
        data.ctrl[:] = rng.uniform(-4e-3, 4e-3, 3 * N)
        after = momentum_N(*fly(model, data, 0.5))
    assert np.linalg.norm(after - before) < 1e-8 * np.linalg.norm(before)


@STEPPERS
def test_motor_torques_stay_within_the_limit(tetrahedron, stepper):
    model, data = spinning(tetrahedron, "gyrostat", stepper=stepper)
    before = data.act.copy()
    data.ctrl[:] = 1.0
    fly(model, data, 1.0)
    assert np.allclose(data.act - before, PROPERTIES.max_wheel_torque, rtol=1e-9)
    assert data.time == pytest.approx(1.0)


def flown(wheels, timestep=0.1, duration=1200.0, stepper="auto", *more):
    simulation = make_simulation(
        make_plan(
            load_scenario(
                "eros-config1",
                [f"physics.wheels={wheels}", f"physics.timestep_s={timestep}", f"physics.stepper={stepper}", *more],
            )
        )
    )
    return simulation, simulation.run(duration, 1.0)


@pytest.mark.parametrize("timestep", [0.1, 0.5])
def test_a_whole_flight_equals_that_with_wheels_as_bodies(timestep):
    _, bodies = flown("bodies", timestep)
    for stepper in ("auto", "kernel"):
        simulation, gyrostat = flown("gyrostat", timestep, 1200.0, stepper)
        assert simulation.stepper == {"auto": "fast"}.get(stepper, stepper)
        assert angle(bodies.attitude[:, 0], gyrostat.attitude[:, 0]).max() < 1e-8
        assert np.abs(bodies.vectors[:, 0] - gyrostat.vectors[:, 0]).max() < 1e-6
        speed, same = bodies.vectors[:, 4], gyrostat.vectors[:, 4]
        assert np.abs(speed - same).max() < 1e-6 * np.abs(speed).max()
        assert np.array_equal(bodies.aim, gyrostat.aim)
        assert np.allclose(bodies.peaks, gyrostat.peaks, rtol=1e-6)


def test_the_kernel_flies_what_mj_step_flies_to_a_nanoradian_and_a_micrometre():
    # A step of mj_step turns wheels that are bodies; at 0.1 s that and rounding are all that differs.
    (_, kernel), (simulation, mj_step) = (
        flown("gyrostat", 0.1, 1200.0, "kernel"),
        flown("bodies", 0.1, 1200.0, "mj_step"),
    )
    assert simulation.stepper == "mj_step"
    assert angle(kernel.attitude[:, 0], mj_step.attitude[:, 0]).max() < 1e-9
    assert np.abs(kernel.vectors[:, 0] - mj_step.vectors[:, 0]).max() < 1e-6


@pytest.mark.parametrize(
    "more",
    [
        "perturbations.gravity_gradient_torque=true",
        "dispersions={mass_percent: 3, inertia_percent: 3}",
    ],
)
def test_the_kernel_turns_under_torques_in_inertial_space_and_with_other_masses(more):
    # The gradient is no torque of the wheels; dispersed masses are written into the model after it was compiled.
    flights = [flown("gyrostat", 0.1, 300.0, stepper, more)[1] for stepper in ("fast", "kernel")]
    assert angle(flights[0].attitude[:, 0], flights[1].attitude[:, 0]).max() < 1e-9
    assert np.abs(flights[0].vectors[:, 0] - flights[1].vectors[:, 0]).max() < 1e-6


def test_held_torques_and_forces_in_inertial_space_act_as_mujoco_has_them(tetrahedron):
    # Large ones, of which every term shows: free, without wheels turning, so that mj_step can say how it goes.
    ends = []
    for stepper in ("auto", "kernel"):
        model, data = spinning(tetrahedron, "gyrostat", 0.02, stepper)
        data.xfrc_applied[model.hub_body] = 0.05 * np.random.default_rng(4).normal(size=(N, 6))
        ends.append(np.hstack([part.copy() for part in fly(model, data, 10.0)]))
    assert np.abs(ends[0] - ends[1])[:, :16].max() < 1e-8
    assert np.abs(ends[1][:, 10:13]).min() > 1e-3


def test_the_kernel_refuses_principal_axes_that_are_not_the_hubs(tetrahedron):
    model, data = spinning(tetrahedron, "gyrostat", stepper="kernel")
    model.mjmodel.body_sameframe[model.hub_body[0]] = 0
    with pytest.raises(SimulationError, match=r"physics\.stepper: fast"):
        Integrator(model, data)


def test_the_kernel_is_refused_for_wheels_that_are_bodies():
    with pytest.raises(ScenarioError, match=r"physics\.stepper = kernel: .* use physics\.wheels: gyrostat"):
        load_scenario("eros-config1", ["physics.stepper=kernel"])


def test_a_momentum_that_is_not_finite_stops_the_flight_and_is_named():
    simulation, _ = flown("gyrostat", 0.5, 10.0)
    simulation.data.act[4] = np.nan
    with pytest.raises(SimulationError, match="sc2"):
        simulation.decide()


def test_accelerations_are_those_of_mj_forward_to_the_bit(tetrahedron):
    model, data = spinning(tetrahedron, "gyrostat")
    data.xfrc_applied[model.hub_body] = np.random.default_rng(4).normal(size=(N, 6))
    data.qfrc_applied[:] = np.random.default_rng(5).normal(size=6 * N)
    integrator = Integrator(model, data)
    accelerate(mj_view(integrator.batch, 0), True)
    quick = data.qacc_smooth.copy()
    mujoco.mj_forward(model.mjmodel, data)
    assert np.array_equal(quick, data.qacc)
