"""The loop against other integrators, conservation laws and itself."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from swarm_mj.errors import PluginError, SimulationError
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.flight.fly import initial_state, make_simulation, simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import AdaptableRoles, DedicatedCommunications, Targets
from swarm_mj.mission.trajectories import propagate
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.simulation import InitialState, Simulation
from swarm_mj.spacecraft.control.base import ControlInput
from swarm_mj.spacecraft.model import build_model
from swarm_mj.spacecraft.properties import RPM, SpacecraftProperties

from .flying import place


class NoTorque:
    def torque(self, inputs: ControlInput, memory):
        return np.zeros_like(inputs.sigma_BR), memory


class Noise:
    """A fixed sequence of torques, to exercise the wheels without a law."""

    def torque(self, inputs: ControlInput, memory):
        rng = memory or np.random.default_rng(5)
        return rng.uniform(-2e-3, 2e-3, inputs.sigma_BR.shape), rng


def momentum(model, data):
    """Angular momentum of every spacecraft about its centre of mass in N, wheels included, from MuJoCo."""
    mujoco.mj_fwdPosition(model.mjmodel, data)
    mujoco.mj_fwdVelocity(model.mjmodel, data)
    mujoco.mj_subtreeVel(model.mjmodel, data)
    return data.subtree_angmom[model.hub_body].copy()


def tumbling(controller, eros, n=3, wheel_speed=0.0, timestep=0.1, **keys):
    """Spacecraft far from the body, so that only their own torques act."""
    scenario = load_scenario("eros-quick")
    model, environment = build_model(n, shape=eros, timestep=timestep), environment_from(scenario, eros)
    simulation = Simulation(
        FlightSetup(model=model, environment=environment, **keys), AdaptableRoles(n, 35e3), controller
    )
    rng = np.random.default_rng(2)
    simulation.reset(
        InitialState(
            r_BN_N=rng.uniform(30e3, 40e3, (n, 3)),
            v_BN_N=np.zeros((n, 3)),
            sigma_BN=rng.uniform(-0.5, 0.5, (n, 3)),
            omega_BN_B=rng.uniform(-0.2, 0.2, (n, 3)) * RPM,
            wheel_speed=np.full((n, 3), wheel_speed),
        )
    )
    return simulation


@pytest.mark.parametrize("name", ["eros-config1", "eros-config2"])
def test_positions_agree_with_dop853_to_a_millimetre_over_the_whole_flight(config_flights, name):
    plan, telemetry = config_flights[name]
    times = telemetry["time"].values
    starts = np.broadcast_to(plan.deployment.r0_N, plan.deployment.v0_N.shape)
    r, v = propagate(plan.environment.acceleration_N, starts, plan.deployment.v0_N, times, rtol=1e-13)
    assert np.linalg.norm(telemetry["r_BN_N"].values - r, axis=2).max() < 1e-3
    assert np.linalg.norm(telemetry["v_BN_N"].values - v, axis=2).max() < 1e-5


def test_every_spacecraft_passes_its_visiting_point_at_the_time_of_flight(config_flights):
    plan, telemetry = config_flights["eros-config1"]
    t = plan.scenario.design.time_of_flight_s
    r_A = telemetry["r_BN_N"].sel(time=t).values @ plan.environment.C_AN(t).T
    expected = np.vstack((plan.points_A, plan.points_A.mean(axis=0)))
    assert np.linalg.norm(r_A - expected, axis=1).max() < 1e-3


def test_torque_free_tumbling_conserves_the_momentum_of_body_and_wheels_for_twenty_minutes(eros):
    simulation = tumbling(NoTorque(), eros, wheel_speed=300.0)
    before = momentum(simulation.model, simulation.data)
    simulation.run(1200.0, 1200.0)
    after = momentum(simulation.model, simulation.data)
    assert (np.linalg.norm(after - before, axis=1) / np.linalg.norm(before, axis=1)).max() < 1e-9


def test_wheel_torques_create_no_momentum_but_the_error_of_a_fourth_order_integrator(eros):
    def error(timestep):
        simulation = tumbling(Noise(), eros, timestep=timestep)
        before = momentum(simulation.model, simulation.data)
        record = simulation.run(100.0, 1.0)
        moved = SpacecraftProperties().wheel_spin_inertia * np.abs(record.samples["wheel_speed"]).max()
        assert moved > 5e-3
        return np.abs(momentum(simulation.model, simulation.data) - before).max() / moved

    coarse, fine = error(0.1), error(0.05)
    assert coarse < 1e-6
    assert coarse > 8 * fine


def test_a_constant_wheel_torque_gives_the_closed_form_rate(eros):
    class Constant:
        def torque(self, inputs, memory):
            torque = np.zeros_like(inputs.sigma_BR)
            torque[:, 2] = 1e-4
            return torque, memory

    simulation = tumbling(Constant(), eros, n=1)
    place(simulation, omega_B=np.zeros((1, 3)))
    simulation.run(20.0, 20.0)
    properties = SpacecraftProperties()
    rate = 1e-4 * 20.0 / properties.inertia_effective_B[2, 2]
    assert simulation.data.qvel[5] == pytest.approx(rate, rel=1e-9)
    # Momentum is shared: J omega + J_s Omega = 0.
    wheel = -properties.inertia_B[2, 2] * rate / properties.wheel_spin_inertia
    assert simulation.data.qvel[8] == pytest.approx(wheel, rel=1e-9)


def test_no_wheel_passes_its_speed_or_torque_limit_however_hard_it_is_pushed(eros):
    class Push:
        def torque(self, inputs, memory):
            return np.full_like(inputs.sigma_BR, -1.0), memory

    simulation = tumbling(Push(), eros)
    record = simulation.run(120.0, 0.5)
    properties = SpacecraftProperties()
    speed, torque = (np.abs(record.samples[name]).max() for name in ("wheel_speed", "wheel_torque"))
    assert 0.999 * properties.max_wheel_speed < speed <= properties.max_wheel_speed
    assert torque == pytest.approx(properties.max_wheel_torque)


def test_peaks_and_saturation_are_kept_between_samples(eros):
    class Pulse:
        def torque(self, inputs, memory):
            tick = memory or 0
            torque = np.zeros_like(inputs.sigma_BR)
            torque[:, 0] = {3: -1.0, 4: 0.002}.get(tick, 0.0)
            return torque, tick + 1

    record = tumbling(Pulse(), eros).run(50.0, 50.0)
    properties = SpacecraftProperties()
    assert record.peaks[:, 1] == pytest.approx(properties.max_wheel_torque)
    assert record.peaks[:, 2] == pytest.approx(0.5)
    assert (record.peaks[:, 0] > 0.9 * 0.5 * properties.max_wheel_torque / properties.wheel_spin_inertia).all()


@pytest.mark.parametrize(("kind", "spacecraft"), [(1, 7), (1, -1), (9, 0)])
def test_a_behavior_that_aims_at_what_is_not_there_is_refused(eros, kind, spacecraft):
    class Wild(AdaptableRoles):
        def targets(self, view, memory):
            n = self.n_observers
            return Targets(np.full(n, kind), np.full(n, spacecraft), np.zeros((n, 3))), memory

    simulation = tumbling(NoTorque(), eros)
    simulation.behavior = Wild(3, 35e3)
    with pytest.raises(PluginError, match="aims at what is not there"):
        simulation.run(1.0, 1.0)


def test_same_seed_gives_bit_equal_telemetry_and_another_seed_does_not(quick_plan):
    first, second = simulate(quick_plan), simulate(quick_plan)
    for name in first.data_vars:
        assert np.array_equal(first[name].values, second[name].values), name
    other = make_plan(quick_plan.scenario.model_copy(update={"seed": 1}))
    assert not np.array_equal(initial_state(other).sigma_BN, initial_state(quick_plan).sigma_BN)


def test_initial_attitudes_and_rates_fill_the_ranges_of_the_paper(quick_plan):
    plan = make_plan(
        load_scenario("eros-quick", parse_overrides(["design.visiting_points=" + str(list(range(1, 41)))]))
    )
    state = initial_state(plan)
    assert np.abs(state.sigma_BN).max() <= 1.0
    assert np.abs(state.omega_BN_B).max() <= 0.2 * RPM
    assert np.abs(state.sigma_BN).max() > 0.95
    assert np.abs(state.omega_BN_B).max() > 0.95 * 0.2 * RPM


@pytest.mark.parametrize("name", ["eros-config1", "eros-config2"])
def test_pointing_settles_before_every_switch_and_at_the_end_and_a_switch_is_a_spike(config_flights, name):
    plan, telemetry = config_flights[name]
    error = np.degrees(telemetry["pointing_error"].values)
    mode = telemetry["mode"].values
    assert error[-1].max() < 0.1
    for j in range(plan.n_observers):
        switch = np.flatnonzero(np.diff(mode[:, j])) + 1
        assert len(switch) == 1
        assert error[switch[0] - 1, j] < 0.1
        assert error[switch[0], j] > 20.0
        decaying = error[switch[0] + 5 : switch[0] + 100, j]
        assert (np.diff(decaying) < 0).all()


@pytest.mark.parametrize("name", ["eros-config1", "eros-config2"])
def test_no_wheel_is_beyond_its_limits_in_the_papers_missions(config_flights, name):
    plan, telemetry = config_flights[name]
    assert np.abs(telemetry["wheel_speed"].values).max() <= plan.properties.max_wheel_speed
    assert np.abs(telemetry["wheel_torque"].values).max() <= plan.properties.max_wheel_torque


def test_reported_pointing_error_is_the_angle_between_z_and_the_target(config_flights):
    from scipy.spatial.transform import Rotation

    _, telemetry = config_flights["eros-config2"]
    sigma = telemetry["sigma_BN"].values
    norm2 = (sigma**2).sum(axis=-1, keepdims=True)
    quaternion = np.concatenate(((1 - norm2), 2 * sigma), axis=-1) / (1 + norm2)
    z_N = Rotation.from_quat(quaternion.reshape(-1, 4), scalar_first=True).apply([0, 0, 1]).reshape(sigma.shape)
    r, mode = telemetry["r_BN_N"].values, telemetry["mode"].values
    j, observing = 1, mode[:, 1] == 0
    aim = np.where(observing[:, None], -r[:, j], r[:, 0] - r[:, j])
    aim /= np.linalg.norm(aim, axis=1, keepdims=True)
    expected = np.arctan2(np.linalg.norm(np.cross(z_N[:, j], aim), axis=1), (z_N[:, j] * aim).sum(axis=1))
    assert np.allclose(telemetry["pointing_error"].values[:, j], expected, atol=1e-7)


def test_a_divergence_is_reported_with_spacecraft_and_time(quick_plan):
    simulation = make_simulation(quick_plan)
    simulation.run(10.0, 5.0)
    rates = simulation.state.omega_B.copy()
    rates[1, 1] = np.nan
    place(simulation, omega_B=rates)
    with pytest.raises(SimulationError, match=r"sc2 .* t = 10 s"):
        simulation.decide()


def test_the_drawn_asteroid_turns_as_the_ephemeris_says(quick_plan):
    simulation = make_simulation(quick_plan)
    simulation.run(600.0, 5.0)
    simulation.step()  # its forces, and the body, are those of its beginning
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, simulation.data.mocap_quat[simulation.model.asteroid_mocap])
    assert np.allclose(matrix.reshape(3, 3).T, quick_plan.environment.C_AN(600.0), atol=1e-12)


@pytest.mark.parametrize(("switch", "scale"), [("solar_tide", 1e-5), ("solar_radiation_pressure", 1e-4)])
def test_a_perturbation_moves_the_flight_as_dop853_says(switch, scale):
    plain = make_plan(load_scenario("eros-quick"))
    plan = make_plan(load_scenario("eros-quick", parse_overrides([f"perturbations.{switch}=true"])))
    # Same start for both, so that the difference is the perturbation alone.
    object.__setattr__(plan.deployment, "v0_N", plain.deployment.v0_N)
    r = simulate(plan)["r_BN_N"].values
    times = np.arange(0.0, 1200.1, 5.0)
    starts = np.broadcast_to(plan.deployment.r0_N, plan.deployment.v0_N.shape)
    expected, _ = propagate(plan.environment.acceleration_N, starts, plan.deployment.v0_N, times, rtol=1e-13)
    unperturbed = simulate(plain)["r_BN_N"].values
    assert np.linalg.norm(r[-1] - unperturbed[-1], axis=1).min() > scale
    assert np.linalg.norm(r - expected, axis=2).max() < 1e-3


def test_the_gravity_gradient_torque_changes_momentum_as_its_formula_says(eros):
    simulation = tumbling(NoTorque(), eros, n=1, gravity_gradient=True)
    before, dt = momentum(simulation.model, simulation.data)[0], 0.5
    r, q = simulation.data.qpos[:3].copy(), simulation.data.qpos[3:7].copy()
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, q)
    r_B = matrix.reshape(3, 3).T @ r
    inertia = SpacecraftProperties().inertia_B
    gm = simulation.environment.gravity.gm
    expected = matrix.reshape(3, 3) @ (3 * gm / np.linalg.norm(r) ** 5 * np.cross(r_B, inertia @ r_B))
    simulation.decide()
    simulation.step()
    change = momentum(simulation.model, simulation.data)[0] - before
    assert np.allclose(change / dt, expected, rtol=1e-3, atol=1e-3 * np.linalg.norm(expected))


def test_spacecraft_start_at_one_point_and_nothing_breaks_when_they_track_each_other():
    plan = make_plan(load_scenario("eros-quick", {"duration_s": 600}))
    telemetry = simulate(replace(plan, behavior=replace(plan.behavior, imaging_radius_m=10e3)))
    assert all(np.isfinite(telemetry[name].values).all() for name in telemetry.data_vars)
    assert np.degrees(telemetry["pointing_error"].values)[-1].max() < 0.1


def test_forty_spacecraft_fly_in_one_model(eros):
    simulation = tumbling(NoTorque(), eros, n=40)
    simulation.run(1.0, 0.5)
    assert np.isfinite(simulation.data.qpos).all()


def test_both_behaviors_count_their_spacecraft():
    assert DedicatedCommunications(5, 35e3).dedicated_communications
    assert not AdaptableRoles(5, 35e3).dedicated_communications


def test_the_packaged_body_is_the_default():
    assert load_body_shape(load_scenario("eros-quick").body).name


def test_limits_cut_torques_for_no_longer_than_the_flight(quick_plan):
    class Strong:
        def torque(self, inputs, memory):
            return np.full_like(inputs.sigma_BR, 1.0), memory

    whole, parts = (make_simulation(replace(quick_plan, controller=Strong())) for _ in range(2))
    assert whole.run(60.0, 10.0).peaks[:, 2].tolist() == [60.0] * quick_plan.n
    parts.run(20.0, 10.0)
    assert parts.run(40.0, 10.0).peaks[:, 2].tolist() == [60.0] * quick_plan.n
