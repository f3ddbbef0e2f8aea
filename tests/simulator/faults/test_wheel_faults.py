"""What failing wheels do to a spacecraft in flight: against conservation of momentum and closed forms."""

import numpy as np
import pytest

from swarm_mj.spacecraft.properties import SpacecraftProperties

from ..flying import place
from .flying import Constant, NoTorque, alone, events_of, fault, fly, momentum


def test_a_stuck_wheel_keeps_its_speed_gives_no_torque_and_momentum_is_conserved():
    stuck = {"kind": "wheel_stuck", "spacecraft": "sc1", "wheel": 1, "at_s": 10, "detection_s": 1000}
    simulation = alone(Constant([2e-4, 1e-4, 0.0]), faults=[stuck], speed=200.0, rate=0.002)
    before = momentum(simulation)
    record = simulation.run(60.0, 0.5)
    speed, motor = (record.samples[name][:, 0] for name in ("wheel_speed", "wheel_torque"))
    held = speed[20, 0]
    assert held < 200.0 - 70.0  # it had been driven for ten seconds
    assert np.abs(speed[20:, 0] - held).max() < 0.05
    assert np.abs(motor[21:, 0]).max() < 5e-7  # only what holds it against the turning body, of 2e-4 commanded
    assert np.ptp(speed[20:, 1]) > 100.0
    assert np.allclose(momentum(simulation), before, atol=1e-8)


def test_a_wheel_that_seizes_gives_its_momentum_to_the_body():
    seized = {"kind": "wheel_stuck", "spacecraft": "sc1", "wheel": 3, "at_s": 5, "speed_rpm": 0}
    simulation = alone(NoTorque(), faults=[seized], speed=300.0)
    place(simulation, wheel_speed=np.array([[0.0, 0.0, 300.0]]))
    simulation.run(60.0, 60.0)
    properties = SpacecraftProperties()
    expected = properties.wheel_spin_inertia * 300.0 / properties.inertia_B[2, 2]
    assert simulation.data.qvel[5] == pytest.approx(expected, rel=1e-6)


def test_a_lost_wheel_coasts_and_the_other_two_turn_the_spacecraft_about_their_axes_as_before():
    lost = {"kind": "wheel_lost", "spacecraft": "sc1", "wheel": 2, "at_s": 0}
    simulation = alone(Constant([1e-4, 1e-4, 1e-4]), faults=[lost])
    before = momentum(simulation)
    record = simulation.run(10.0, 0.5)
    assert (record.samples["wheel_torque"][:, 0, 1] == 0.0).all()
    assert record.samples["wheel_torque"][:, 0, [0, 2]] == pytest.approx(-1e-4)
    assert np.allclose(momentum(simulation), before, atol=1e-9)
    rate, healthy = simulation.data.qvel[3:6], SpacecraftProperties().inertia_effective_B
    assert rate[0] == pytest.approx(1e-4 * 10.0 / healthy[0, 0], rel=1e-3)
    assert abs(rate[1]) < 0.01 * rate[0]


def test_a_weakened_wheel_turns_the_spacecraft_by_its_part_and_recovers():
    weak = {"kind": "wheel_weakened", "spacecraft": "sc1", "wheel": 3, "at_s": 0, "factor": 0.25, "duration_s": 10}
    simulation = alone(Constant([0.0, 0.0, 1e-4]), faults=[weak])
    simulation.run(10.0, 10.0)
    full = 1e-4 * 10.0 / SpacecraftProperties().inertia_effective_B[2, 2]
    assert simulation.data.qvel[5] == pytest.approx(0.25 * full, rel=1e-9)
    simulation.run(10.0, 10.0)
    assert simulation.data.qvel[5] == pytest.approx(1.25 * full, rel=1e-9)
    assert [event.kind for event in simulation.events] == ["wheel_weakened", "over"]


@pytest.mark.parametrize("stepper", ["mujoco", "kernel"])
def test_friction_slows_a_wheel_as_the_closed_form_says_and_spins_the_body_up(stepper):
    coulomb, viscous = 3e-5, 5e-7
    rubs = {
        "kind": "wheel_friction",
        "spacecraft": "sc1",
        "wheel": 3,
        "at_s": 0,
        "coulomb_n_m": coulomb,
        "viscous_n_m_s": viscous,
    }
    simulation = alone(NoTorque(), faults=[rubs], stepper=stepper)
    properties = SpacecraftProperties()
    J_s, J = properties.wheel_spin_inertia, properties.inertia_effective_B[2, 2]
    place(simulation, wheel_speed=np.array([[0.0, 0.0, 250.0]]))
    record = simulation.run(200.0, 0.5)
    reduced = 1.0 / (1.0 / J_s + 1.0 / J)
    t = record.time
    final = -coulomb / viscous
    closed = np.maximum(0.0, final + (250.0 - final) * np.exp(-viscous * t / reduced))
    assert (closed[-50:] == 0.0).all()
    assert np.abs(record.samples["wheel_speed"][:, 0, 2] - closed).max() < 1e-6
    # Momentum is shared: what the wheel lost the body has.
    rate = simulation.model.state(simulation.data)[1][0, 5]
    assert rate == pytest.approx(J_s * 250.0 / (J + J_s), rel=1e-7)


@pytest.mark.parametrize("layout", ["orthogonal_and_skew", "pyramid"])
def test_a_flight_with_four_wheels_points_on_through_the_loss_of_one_and_one_with_three_does_not(layout):
    lost = fault("{kind: wheel_lost, spacecraft: sc1, wheel: 2, at_s: 300, detection_s: 5}")
    plan, telemetry = fly(f"spacecraft.wheel_layout={layout}", lost)
    error = np.degrees(telemetry["pointing_error"].values)
    arrival = 120  # 600 s
    assert error[arrival, 0] < 0.01
    assert error[-1, 0] < 0.1
    assert telemetry["wheel_torque"].values[62:, 0, 1] == pytest.approx(0.0)
    assert "control about 3 axes" in events_of(telemetry, "detected")[0]["detail"]
    _, three = fly(lost)
    assert np.degrees(three["pointing_error"].values)[-1, 0] > 1.0
    assert "control about 2 axes" in events_of(three, "detected")[0]["detail"]


@pytest.mark.parametrize("layout", ["orthogonal_and_skew", "pyramid"])
def test_four_wheels_stand_inside_the_mass_and_inertia_of_the_box_and_conserve_momentum(layout):
    import mujoco

    simulation = alone(Constant([1e-3, -5e-4, 2e-4]), layout=layout, speed=100.0, rate=0.02)
    model, data, properties = simulation.model.mjmodel, simulation.data, simulation.properties
    before = momentum(simulation)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    assert np.allclose(matrix[:3, :3], properties.mass * np.eye(3), atol=1e-9)
    assert np.allclose(matrix[3:6, 3:6], properties.inertia_B, atol=1e-9)
    assert np.allclose(matrix[6:, 3:6], properties.wheel_spin_inertia * properties.wheel_axes_B, atol=1e-12)
    simulation.run(60.0, 60.0)
    assert np.linalg.norm(simulation.data.qvel[6:] - 100.0) > 100.0
    assert np.allclose(momentum(simulation), before, atol=1e-7)
