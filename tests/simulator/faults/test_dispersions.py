"""Dispersions: statistics of what is drawn, and their effect in flight against closed forms and another integrator."""

import numpy as np
import pytest
from scipy.stats import kstest

from swarm_mj.errors import ScenarioError
from swarm_mj.mission.trajectories import propagate
from swarm_mj.scenarios.schema_faults import Dispersions
from swarm_mj.scenarios.schema_sensors import IDEAL, Sensors
from swarm_mj.simulator.faults.dispersions import (
    Stream,
    attitude_turns,
    disperse_environment,
    dispersed_inertia,
    draw_spacecraft,
    extra_rates,
    shifted_target,
    stream,
    velocity_errors,
)
from swarm_mj.spacecraft.properties import SpacecraftProperties

from .flying import Constant, alone, fly, momentum, plan_of

N = 4000


def draw(n=N, seed=0, sensors=IDEAL, **given):
    return draw_spacecraft(Dispersions(**given), sensors, seed, n=n, n_wheels=3, period_s=0.5)


def test_what_is_switched_off_is_drawn_as_planned():
    drawn = draw()
    assert (drawn.mass_ratio == 1).all() and (drawn.second_moment_ratio == 1).all()
    for name in ("coulomb", "viscous", "gyro_bias", "star_tracker_bias", "delay_ticks"):
        assert not getattr(drawn, name).any(), name


def test_draws_follow_their_distributions():
    drawn = draw(mass_percent=2, inertia_percent=3, wheel_coulomb_n_m=1e-4, sensors=Sensors(gyro_bias_deg_h=10))
    mass = (drawn.mass_ratio - 1) / 0.02
    assert np.abs(mass).max() <= 3.0
    assert mass.std() == pytest.approx(0.9866, abs=0.04)  # of a normal distribution cut at three sigma
    assert kstest(drawn.coulomb.ravel() / 1e-4, "uniform").pvalue > 1e-3
    assert kstest(drawn.gyro_bias.ravel() / np.radians(10 / 3600), "norm").pvalue > 1e-3
    given = Dispersions(attitude_deg=5, rate_deg_s=0.1, deployment_velocity_m_s=0.02)
    for values, sigma in (
        (attitude_turns(given, 0, N), np.radians(5)),
        (extra_rates(given, 0, N), np.radians(0.1)),
        (velocity_errors(given, 0, N), 0.02),
    ):
        assert kstest(values.ravel() / sigma, "norm").pvalue > 1e-3


def test_streams_are_apart_and_depend_on_the_seed_alone():
    alone_drawn, together = draw(mass_percent=2), draw(mass_percent=2, inertia_percent=3, sensors=Sensors(delay_s=1))
    assert np.array_equal(alone_drawn.mass_ratio, together.mass_ratio)
    assert not np.array_equal(alone_drawn.mass_ratio, draw(mass_percent=2, seed=1).mass_ratio)
    first = {what: stream(3, what).random() for what in Stream}
    assert len(set(first.values())) == len(first)
    assert np.random.default_rng(3).random() not in first.values()


def test_dispersed_inertias_are_those_of_possible_bodies():
    drawn = draw(inertia_percent=10)
    inertia = dispersed_inertia(SpacecraftProperties().inertia_B, drawn.second_moment_ratio)
    moments = np.linalg.eigvalsh(inertia)
    assert (moments[:, 0] > 0).all()
    assert (moments[:, 0] + moments[:, 1] >= moments[:, 2]).all()
    planned = dispersed_inertia(SpacecraftProperties().inertia_B, np.ones((1, 3)))
    assert np.allclose(planned[0], SpacecraftProperties().inertia_B, rtol=1e-14)


@pytest.mark.parametrize("stepper", ["mujoco", "kernel"])
def test_a_torque_turns_a_dispersed_spacecraft_by_its_true_inertia_and_momentum_is_conserved(stepper):
    given = {"mass_percent": 5, "inertia_percent": 8}
    simulation = alone(Constant([0, 0, 1e-4]), dispersions=given, stepper=stepper, seed=4)
    drawn = draw_spacecraft(Dispersions(**given), IDEAL, 4, n=1, n_wheels=3, period_s=0.5)
    properties = SpacecraftProperties()
    true = drawn.mass_ratio[0] * dispersed_inertia(properties.inertia_B, drawn.second_moment_ratio)[0]
    assert abs(true[2, 2] / properties.inertia_B[2, 2] - 1) > 0.02
    assert simulation.state.mass[0] == pytest.approx(properties.mass * drawn.mass_ratio[0])
    if stepper == "mujoco":
        hub = simulation.model.hub_body[0]
        assert simulation.model.mjmodel.body_subtreemass[hub] == pytest.approx(simulation.state.mass[0])
        before = momentum(simulation)
    simulation.run(20.0, 20.0)
    effective = true[2, 2] - properties.wheel_spin_inertia
    assert simulation.state.omega_B[0, 2] == pytest.approx(1e-4 * 20 / effective, rel=1e-8)
    if stepper == "mujoco":
        assert np.allclose(momentum(simulation), before, atol=1e-9)


def test_a_new_seed_gives_other_masses_to_the_same_simulation():
    from dataclasses import replace

    from swarm_mj.flight.fly import initial_state, make_simulation

    plan = plan_of("eros-quick", ("dispersions.mass_percent=3", "dispersions.gravity_percent=3"))
    simulation = make_simulation(plan)
    first = simulation.model.mjmodel.body_mass.copy()
    gravity = simulation.environment.gravity
    simulation.reset(initial_state(replace(plan, scenario=plan.scenario.model_copy(update={"seed": 9}))))
    assert not np.array_equal(first, simulation.model.mjmodel.body_mass)
    assert simulation.environment.gravity.factor != gravity.factor
    simulation.reset(initial_state(plan))
    assert np.array_equal(first, simulation.model.mjmodel.body_mass)


def test_mass_does_not_change_the_fall_and_dispersed_gravity_does_as_dop853_says():
    plan, heavy = fly("dispersions.mass_percent=5")
    _, plain = fly()
    assert np.abs(heavy["r_BN_N"].values - plain["r_BN_N"].values).max() < 1e-6
    plan, telemetry = fly("dispersions.gravity_percent=5", "dispersions.harmonics_percent=20")
    truth = disperse_environment(plan.environment, plan.scenario.dispersions, plan.scenario.seed)
    starts = np.broadcast_to(plan.deployment.r0_N, plan.deployment.v0_N.shape)
    r, _ = propagate(truth.acceleration_N, starts, plan.deployment.v0_N, telemetry["time"].values)
    assert np.abs(telemetry["r_BN_N"].values - r).max() < 1e-3
    assert np.abs(telemetry["r_BN_N"].values - plain["r_BN_N"].values)[-1].max() > 1.0


def test_a_dispersed_field_keeps_its_central_term_and_scales_as_drawn():
    plan = plan_of("eros-quick", ())
    far = np.array([[1e7, 2e6, -3e6]])
    scaled = disperse_environment(plan.environment, Dispersions(gravity_percent=5), 1).gravity
    ratio = scaled.acceleration(far) / plan.environment.gravity.acceleration(far)
    assert ratio == pytest.approx(scaled.factor)
    assert scaled.gm == pytest.approx(scaled.factor * plan.environment.gravity.gm)
    bent = disperse_environment(plan.environment, Dispersions(harmonics_percent=50), 1).gravity
    near = np.array([[2e4, 1e4, 5e3]])
    assert np.allclose(bent.acceleration(far), plan.environment.gravity.acceleration(far), rtol=1e-4)
    assert not np.allclose(bent.acceleration(near), plan.environment.gravity.acceleration(near), rtol=1e-3)
    assert disperse_environment(plan.environment, Dispersions(), 1) is plan.environment


def test_dispersed_coefficients_change_by_their_share_and_the_total_mass_by_nothing():
    planned, changes = plan_of("eros-quick", ()).environment, []
    before, far = planned.gravity, np.array([[3e9, -2e9, 1e9]])
    for seed in range(60):
        after = disperse_environment(planned, Dispersions(harmonics_percent=10), seed).gravity
        assert (after.gm, after.c[0, 0]) == (before.gm, before.c[0, 0])
        # Of the potential far away the monopole alone is left, whatever was drawn.
        assert after.potential(far) == pytest.approx(before.gm / np.linalg.norm(far), rel=1e-9)
        for old, new in ((before.c[1:], after.c[1:]), (before.s[1:], after.s[1:])):
            assert not new[old == 0.0].any()
            changes.append(new[old != 0.0] / old[old != 0.0] - 1.0)
    assert kstest(np.concatenate(changes) / 0.1, "norm").pvalue > 1e-3


def test_cosine_and_sine_coefficients_are_dispersed_independently():
    planned, pairs = plan_of("eros-quick", ()).environment, []
    before = planned.gravity
    both = (before.c != 0.0) & (before.s != 0.0)
    for seed in range(60):
        after = disperse_environment(planned, Dispersions(harmonics_percent=10), seed).gravity
        pairs.append((after.c[both] / before.c[both] - 1.0, after.s[both] / before.s[both] - 1.0))
    cosine, sine = np.concatenate(pairs, axis=1)
    assert abs(np.corrcoef(cosine, sine)[0, 1]) < 5 / np.sqrt(len(sine))


def test_harmonics_of_a_field_without_any_are_refused():
    plan = plan_of("eros-quick", ("body.gravity.model=point_mass",))
    with pytest.raises(ScenarioError, match="dispersions.harmonics_percent = 5: needs"):
        disperse_environment(plan.environment, Dispersions(harmonics_percent=5), 0)


@pytest.mark.parametrize(("latitude", "longitude"), [(0.0, 90.0), (45.0, -120.0), (89.9, 10.0), (90.0, 0.0)])
def test_a_shifted_target_lies_as_far_away_as_it_was_shifted(latitude, longitude):
    def unit(a, b):
        a, b = np.radians([a, b])
        return np.array([np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a)])

    moved = shifted_target(latitude, longitude, 300.0, -400.0, 1e4)
    angle = np.arccos(unit(latitude, longitude) @ unit(*moved))
    assert angle * 1e4 == pytest.approx(500.0, rel=1e-5)
    north = shifted_target(0.0, 90.0, 0.0, 100.0, 1e4)
    assert north == pytest.approx((np.degrees(0.01), 90.0))
    assert shifted_target(0.0, 90.0, 100.0, 0.0, 1e4) == pytest.approx((0.0, 90.0 + np.degrees(0.01)))


def test_a_target_that_lies_elsewhere_moves_the_region_and_not_the_visiting_points():
    plan, moved = plan_of("eros-quick", ()), plan_of("eros-quick", ("dispersions.target_m=500",))
    assert np.array_equal(plan.points_A, moved.points_A)
    assert 100 < np.linalg.norm(plan.region.centroid_A.mean(axis=0) - moved.region.centroid_A.mean(axis=0)) < 2000


def test_dispersed_initial_attitudes_turn_by_the_drawn_angle_about_the_planned_one():
    from swarm_mj.flight.fly import initial_state
    from swarm_mj.spacecraft.attitude.mrp import subtract_mrp

    plan = plan_of("eros-quick", ("dispersions.attitude_deg=3", "dispersions.rate_deg_s=0.1"))
    plain = initial_state(plan_of("eros-quick", ()))
    start = initial_state(plan)
    turned = 4.0 * np.arctan(np.linalg.norm(subtract_mrp(start.sigma_BN, plain.sigma_BN), axis=1))
    given = plan.scenario.dispersions
    assert turned == pytest.approx(np.linalg.norm(attitude_turns(given, 0, 2), axis=1), rel=1e-9)
    assert np.allclose(start.omega_BN_B - plain.omega_BN_B, extra_rates(given, 0, 2))
