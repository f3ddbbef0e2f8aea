"""Corrections and linear covariance: closed forms without forces, the target that is hit, 1,000 flights under all forces."""

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.special import erf
from scipy.stats import norm

from swarm_mj.errors import MissionError
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.corrections import plan_legs, transitions
from swarm_mj.mission.covariance import (
    FlightErrors,
    arrival_axes,
    burn_covariance,
    burnt,
    draw_linear,
    fly_dispersed,
    length_mean,
    length_quantile,
    length_within,
    sample_chance,
    spread,
)
from swarm_mj.mission.trajectories import propagate
from swarm_mj.scenarios.loading import load_scenario


def no_force(t, r):
    return np.zeros_like(r)


def released(n, position, velocity):
    return np.tile(np.diag(np.repeat((position**2, velocity**2), 3)), (n, 1, 1))


def drifting(times):
    """Two spacecraft without forces, with times (n, m + 2)."""
    times = np.atleast_2d(times) * np.ones((2, 1))
    return plan_legs(no_force, np.zeros((2, 3)), np.array([[10.0, 0, 0], [0, 5.0, 0]]), times)


def test_without_forces_one_correction_leaves_what_the_closed_form_says():
    legs, (p, v) = drifting([0.0, 100.0, 400.0]), (2.0, 0.01)
    errors = FlightErrors(release=released(2, 3.0, 0.1), position=p, velocity=v, magnitude=0.04, pointing=0.03)
    found = spread(legs, errors)
    left = 300.0
    # Before: 3 m and 0.1 m/s for 100 s; the burn takes (r + left v) / left of it and of the errors of navigation.
    wished = (3.0**2 + 400.0**2 * 0.1**2 + p**2 + left**2 * v**2) / left**2
    missed = p**2 + left**2 * (v**2 + (0.04**2 + 2 * 0.03**2) * wished)
    assert found.at_arrival[0, :, :3, :3] == pytest.approx(np.tile((9.0 + 1600.0) * np.eye(3), (2, 1, 1)), rel=1e-9)
    assert found.delta_v[0] == pytest.approx(np.tile(wished * np.eye(3), (2, 1, 1)), rel=1e-9)
    assert found.at_arrival[1, :, :3, :3] == pytest.approx(np.tile(missed * np.eye(3), (2, 1, 1)), rel=1e-9)


def test_a_correction_that_knows_and_burns_exactly_hits_the_visiting_point():
    plan = make_plan(load_scenario("eros-config1"), check_separation=False)
    n, acceleration = plan.n, plan.environment.acceleration_N
    r0, v0 = np.tile(plan.deployment.r0_N, (n, 1)), plan.deployment.v0_N
    legs = plan_legs(acceleration, r0, v0, np.tile([0.0, 200.0, 600.0], (n, 1)))
    off = 0.01 * np.random.default_rng(0).standard_normal((n, 3))
    r, v = propagate(acceleration, r0, v0 + off, np.array([0.0, 200.0]))
    deviation = np.concatenate((r[-1] - legs.r_N[:, 1], v[-1] - legs.v_N[:, 1]), axis=1)
    burn = np.einsum("jab,jb->ja", legs.gain[:, 0], deviation)
    r, _ = propagate(acceleration, r[-1], v[-1] + burn, np.array([200.0, 600.0]))
    missed = np.linalg.norm(r[-1] - plan.deployment.destination_N, axis=1)
    assert np.linalg.norm(600.0 * off, axis=1).min() > 3.0
    assert missed.max() < 1e-2  # what is left is of second order


#: Scenario; corrections as shares of the time of flight; errors of release, navigation and burns.
MISSIONS = {
    "eros-config1": ((0.25, 0.8), (0.0, 0.1, 5.0, 0.01, 0.02, 0.02)),
    "bennu-slow": ((0.5,), (20.0, 0.02, 2.0, 0.002, 0.05, 0.03)),
    "fast-flyby": ((0.1, 0.97), (100.0, 0.1, 200.0, 0.01, 0.01, 0.01)),
}


@pytest.mark.parametrize("name", MISSIONS)
def test_a_thousand_flights_under_all_forces_spread_as_the_covariance_says(name):
    shares, (r, v, position, velocity, magnitude, pointing) = MISSIONS[name]
    plan = make_plan(load_scenario(name), check_separation=False)
    n, span = 2, plan.scenario.design.time_of_flight_s
    times = np.tile(span * np.array([0.0, *shares, 1.0]), (n, 1))
    acceleration = plan.environment.acceleration_N
    legs = plan_legs(acceleration, np.tile(plan.deployment.r0_N, (n, 1)), plan.deployment.v0_N[:n], times)
    errors = FlightErrors(
        release=released(n, r, v), position=position, velocity=velocity, magnitude=magnitude, pointing=pointing
    )
    expected = spread(legs, errors)
    flown = fly_dispersed(acceleration, legs, errors, runs=1000, rng=np.random.default_rng(7))
    chances = [sample_chance(flown.deviation[:, j, :3], expected.at_arrival[-1, j, :3, :3]) for j in range(n)]
    chances += [
        sample_chance(flown.delta_v[:, j, k], expected.delta_v[k, j]) for j in range(n) for k in range(len(shares))
    ]
    # Jointly 99.9 %: with so many tests each may fail by chance with 0.001 over their number.
    assert min(chances) > 0.001 / len(chances)
    wrong = 1.15 * expected.at_arrival[-1, 0, :3, :3]  # 7 % in sigma
    assert sample_chance(flown.deviation[:, 0, :3], wrong) < 0.001


def test_each_spacecraft_has_times_of_its_own():
    together, apart = drifting([0.0, 100.0, 400.0]), drifting([[0.0, 100.0, 400.0], [0.0, 50.0, 400.0]])
    errors = FlightErrors(release=released(2, 0.0, 0.1), velocity=0.01)
    first, second = spread(together, errors).at_arrival[1, :, 0, 0], spread(apart, errors).at_arrival[1, :, 0, 0]
    assert first[0] == pytest.approx(second[0])
    assert second[1] == pytest.approx((350.0 * 0.01) ** 2)


def test_burns_err_as_their_covariance_says():
    errors = FlightErrors(release=np.zeros((1, 6, 6)), magnitude=0.05, pointing=0.1)
    wished = np.tile([0.3, -0.1, 0.2], (100_000, 1))
    off = burnt(wished, errors, np.random.default_rng(3)) - wished
    assert sample_chance(off, burn_covariance(np.outer(wished[0], wished[0]), errors)) > 1e-3
    along = off @ wished[0] / np.linalg.norm(wished[0])
    assert along.std() == pytest.approx(0.05 * np.linalg.norm(wished[0]), rel=0.01)


def test_a_correction_half_a_revolution_before_the_arrival_is_refused():
    gm, radius = 4.46e5, 30_000.0
    half = np.pi * np.sqrt(radius**3 / gm)
    legs = plan_legs(
        lambda t, r: -gm * r / np.linalg.norm(r, axis=1, keepdims=True) ** 3,
        np.array([[radius, 0, 0]]),
        np.array([[0, np.sqrt(gm / radius), 0]]),
        np.array([[0.0, 100.0, 100.0 + half]]),
    )
    with pytest.raises(MissionError, match=r"sc1: correction 1, .* s before the arrival.*trajectory.corrections"):
        spread(legs, FlightErrors(release=np.zeros((1, 6, 6))))


def test_legs_chain_in_the_order_in_which_they_are_flown():
    gm, radius = 4.46e5, 30_000.0

    def pulled(t, r):
        return -gm * r / np.linalg.norm(r, axis=1, keepdims=True) ** 3

    start = np.array([[radius, 0, 0]]), np.array([[0, np.sqrt(gm / radius), 0]])
    times = np.array([0.0, 8e3, 2e4, 4e4])
    legs, whole = plan_legs(pulled, *start, times[None]), transitions(pulled, *start, times)
    for k in range(3):
        expected = (whole.phi[3] @ np.linalg.inv(whole.phi[k]))[0]
        assert np.abs(legs.to_arrival[0, k, :3, :3] - expected[:3, :3]).max() < 1e-7
        assert np.abs(legs.to_arrival[0, k, :3, 3:] - expected[:3, 3:]).max() < 1e-3


def test_axes_of_the_arrival_are_a_rotation_with_the_third_along_the_flight():
    r, v = np.array([[3.0, 4.0, 1.0], [5.0, 0, 0]]), np.array([[0.5, -1.0, 2.0], [2.0, 0, 0]])
    axes = arrival_axes(r, v)
    assert axes @ axes.swapaxes(1, 2) == pytest.approx(np.tile(np.eye(3), (2, 1, 1)))
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert np.einsum("jab,jb->ja", axes, v)[:, :2] == pytest.approx(np.zeros((2, 2)))
    assert axes[0, 0] @ r[0] > 0  # R points outward
    assert axes[0, 1] @ r[0] == pytest.approx(0.0)


def test_linear_flights_have_the_mean_and_quantile_of_the_quadrature_while_all_is_normal():
    legs = drifting([0.0, 100.0, 300.0, 400.0])
    errors = FlightErrors(release=released(2, 3.0, 0.1), position=1.0, velocity=0.02)
    found = spread(legs, errors)
    position, delta_v = draw_linear(legs, errors, 0, draws=40_000, rng=np.random.default_rng(1))
    covariances = (*found.delta_v[:, 0], *found.at_arrival[:, 0, :3, :3])
    for drawn, covariance in zip((*delta_v, *position), covariances, strict=True):
        size = np.linalg.norm(drawn, axis=1)
        assert size.mean() == pytest.approx(length_mean(covariance), rel=0.01)
        assert np.quantile(size, 0.99) == pytest.approx(length_quantile(covariance, 0.99), rel=0.02)


def test_linear_flights_whose_burns_err_have_the_covariance_and_the_tails_of_flights_drawn_another_way():
    """Other seeds, one component after the other, no matrices; the tail is longer than that of a normal vector."""
    legs, (p, v, s, a) = drifting([0.0, 100.0, 300.0, 400.0]), (0.1, 1e-3, 0.1, 0.05)
    errors = FlightErrors(release=released(2, 3.0, 0.1), position=p, velocity=v, magnitude=s, pointing=a)
    position, delta_v = draw_linear(legs, errors, 1, draws=40_000, rng=np.random.default_rng(1))
    rng, n = np.random.default_rng(77), 200_000
    r, u, sizes, t = 3.0 * rng.standard_normal((n, 3)), 0.1 * rng.standard_normal((n, 3)), [], 0.0
    for at in (100.0, 300.0):
        r, t = r + (at - t) * u, at
        wish = -((r + p * rng.standard_normal((n, 3))) / (400.0 - at) + u + v * rng.standard_normal((n, 3)))
        sizes.append(np.linalg.norm(wish, axis=1))
        u = u + wish + s * rng.standard_normal((n, 1)) * wish + np.cross(a * rng.standard_normal((n, 3)), wish)
    missed = np.linalg.norm(r + 100.0 * u, axis=1)
    found = spread(legs, errors)
    assert (delta_v[1] ** 2).sum(axis=1).mean() == pytest.approx(np.trace(found.delta_v[1, 1]), rel=0.03)
    for drawn, expected in ((delta_v[0], sizes[0]), (delta_v[1], sizes[1]), (position[2], missed)):
        assert np.quantile(np.linalg.norm(drawn, axis=1), 0.99) == pytest.approx(np.quantile(expected, 0.99), rel=0.02)
    assert np.quantile(sizes[1], 0.99) > 1.1 * length_quantile(found.delta_v[1, 1], 0.99)


@pytest.mark.parametrize("sigmas", [(1.0, 1.0, 1.0), (2.0, 1.0, 0.5), (3.0, 0.2, 1.0)])
def test_quantiles_of_lengths_hold_so_much_of_the_density(sigmas):
    """The normal density over the ball of that radius, one component after the other."""
    length, (a, b, c) = length_quantile(np.diag(np.square(sigmas)), 0.99), sigmas

    def slice_of(y, x):
        return norm.pdf(x / a) / a * norm.pdf(y / b) / b * erf(np.sqrt(max(length**2 - x**2 - y**2, 0.0) / 2) / c)

    inside, _ = dblquad(slice_of, 0.0, length, 0.0, lambda x: np.sqrt(length**2 - x**2), epsabs=1e-6)
    assert 4.0 * inside == pytest.approx(0.99, abs=1e-6)


@pytest.mark.parametrize("sigmas", [(1.0, 1.0, 1.0), (2.0, 1.0, 0.5), (1.0, 1e-6, 0.0), (3.0, 0.2), (1.0, 1.0)])
def test_lengths_of_normal_vectors_are_those_of_drawn_ones(sigmas):
    turn, _ = np.linalg.qr(np.random.default_rng(5).standard_normal((len(sigmas),) * 2))
    covariance = turn @ np.diag(np.square(sigmas)) @ turn.T
    drawn = np.linalg.norm(np.random.default_rng(4).standard_normal((400_000, len(sigmas))) * sigmas, axis=1)
    assert length_mean(covariance) == pytest.approx(drawn.mean(), rel=0.005)
    assert length_quantile(covariance, 0.99) == pytest.approx(np.quantile(drawn, 0.99), rel=0.01)
    assert length_within(covariance, 0.7) == pytest.approx((drawn < 0.7).mean(), abs=0.003)


def test_equal_sigmas_are_maxwells_distribution_and_nothing_is_nothing():
    assert length_mean(4.0 * np.eye(3)) == pytest.approx(2.0 * np.sqrt(8.0 / np.pi), rel=1e-12)
    assert length_quantile(np.eye(2), 0.99) == pytest.approx(np.sqrt(-2.0 * np.log(0.01)), rel=1e-9)
    assert length_quantile(np.zeros((3, 3)), 0.99) == length_mean(np.zeros((3, 3))) == 0.0
    assert length_within(np.zeros((2, 2)), 0.1) == 1.0


def test_the_chance_of_samples_is_uniform_where_they_belong_and_small_where_not():
    rng, covariance = np.random.default_rng(11), np.diag([4.0, 1.0, 1e-4])
    chances = [sample_chance(rng.standard_normal((500, 3)) * [2.0, 1.0, 0.01], covariance) for _ in range(300)]
    assert np.mean(np.array(chances) < 0.1) < 0.16
    shifted = rng.standard_normal((500, 3)) * [2.0, 1.0, 0.01] + [0.5, 0.0, 0.0]
    assert sample_chance(shifted, covariance) < 1e-4
