"""The filter against batch least squares, and against what it says of its own errors."""

import numpy as np
import pytest
from scipy.stats import chi2

from scripts.pages.filter_flights import CASES, GM, R0, SIGMA, SPIN, V0, Case, begun, flight, flown, pull
from swarm_mj.navigation.filter import FilterNoise, SwarmFilter
from swarm_mj.navigation.picture import Fix
from swarm_mj.spacecraft.attitude.mrp import cross_matrix


@pytest.mark.parametrize("case", CASES)
def test_estimates_and_innovations_err_as_the_filter_says(case):
    rng = np.random.default_rng(0)
    flights = [flight(rng, CASES[case]) for _ in range(14)]
    nees, nis, dof = (sum(column) for column in zip(*flights, strict=True))
    assert chi2.ppf(1e-4, 12 * 14) < nees < chi2.isf(1e-4, 12 * 14)
    assert chi2.ppf(1e-4, dof) < nis < chi2.isf(1e-4, dof)


def test_without_process_noise_it_is_batch_least_squares():
    rng, each, times = np.random.default_rng(1), begun(Case(FilterNoise()), 1), (200.0, 400.0, 600.0)
    R = np.diag([30.0, 20.0, 80.0]) ** 2
    # Derivatives at the plan, by differences of another integrator.
    steps = np.diag(np.repeat((10.0, 0.01), 3))

    def place(x, t):
        return flown(x[None, :3], x[None, 3:], t)[0][0]

    x0 = np.concatenate((R0[0], V0[0]))
    info, right = np.diag(1.0 / SIGMA**2), np.zeros(6)
    for t in times:
        H = np.stack([(place(x0 + s, t) - place(x0 - s, t)) / (2 * np.abs(s).max()) for s in steps], axis=1)
        offset = np.array([15.0, -10.0, 25.0]) * rng.normal(size=3)
        each.advance(t)
        seen = place(x0, t) + offset - each.r_N[0]
        each.use_fix(0, Fix("limb", seen, np.eye(3), R, np.zeros((3, 3)), 1), np.eye(3))
        info, right = info + H.T @ np.linalg.solve(R, H), right + H.T @ np.linalg.solve(R, offset)
    dx = np.linalg.solve(info, right)
    r, v = flown((x0 + dx)[None, :3], (x0 + dx)[None, 3:], times[-1])
    sigma = np.sqrt(np.diag(each.covariance(0)))
    assert np.abs(np.concatenate((each.r_N[0] - r[0], each.v_N[0] - v[0])) / sigma).max() < 1e-3
    plain = begun(Case(FilterNoise()), 1)
    phi = plain.advance(times[-1])[:6, :6]
    assert np.allclose(
        each.covariance(0) / np.outer(sigma, sigma),
        (phi @ np.linalg.inv(info) @ phi.T) / np.outer(sigma, sigma),
        atol=1e-3,
    )


def test_wild_measurements_are_refused_and_change_nothing():
    each = begun(Case(FilterNoise()), 1)
    before = each.x.copy(), each.S.copy()
    wild = Fix("limb", np.array([3e4, 0.0, 0.0]), np.eye(3), 100.0 * np.eye(3), np.zeros((3, 3)), 1)
    update = each.use_fix(0, wild, np.eye(3))
    assert not update.accepted and update.nis > 30.0
    assert np.array_equal(each.x, before[0]) and np.array_equal(each.S, before[1])


def test_a_range_tells_both_spacecraft_and_is_not_counted_twice():
    each = begun(Case(FilterNoise()))
    distance = float(np.linalg.norm(R0[1] - R0[0]))
    along = (R0[1] - R0[0]) / distance
    for _ in range(2):
        each.use_range(0, 1, distance, 1.0)
    P = each.P
    between = np.zeros(len(P))
    between[9:12], between[:3] = along, -along
    assert np.sqrt(between @ P @ between) < 40.0  # far less than 300 sqrt(2), not below what two ranges give
    own = [float(along @ each.covariance(j)[:3, :3] @ along) for j in range(2)]
    # Their mean is as unknown as ever, so that neither knows more than half of what one range could say.
    assert min(own) > 0.49 * 300.0**2


def test_a_push_and_a_coast_go_together():
    each = begun(Case(FilterNoise()), 1)
    push = np.array([4.0, 1.0, -2.0, 0.5, -0.2, 0.1])
    there = each.coast(300.0, [(100.0, 0, push)])
    each.advance(100.0)
    each.push(0, push, np.zeros((6, 6)))
    each.advance(300.0)
    assert np.allclose(there.r_N, each.r_N, atol=1e-6) and np.allclose(
        there.covariance(0), each.covariance(0), rtol=1e-9
    )
    r, v = flown(R0[:1], V0[:1], 100.0)
    r, _ = flown(r + push[:3], v + push[3:], 200.0)
    assert np.allclose(each.r_N, r, atol=1e-3)


def known_place(noise):
    """A filter that knows its place to a metre, and the turns of what else it does not."""
    sigma = np.repeat((1.0, 1e-3), 3)
    return SwarmFilter(pull, GM, SPIN, noise, 0.0, R0[:1], V0[:1], np.diag(sigma**2)[None])


def test_how_the_body_is_turned_otherwise_is_found_with_its_sign():
    each, turned = known_place(FilterNoise(rotation=1e-3)), 1e-3 * np.array([0.5, -0.8, 0.3])
    # The camera seems to stand elsewhere by the turn, whatever turn about the line of sight is.
    seen = Fix("limb", -np.cross(turned, R0[0]), np.eye(3), np.eye(3), np.zeros((3, 3)), 1)
    each.use_fix(0, seen, np.eye(3))
    across = np.eye(3) - np.outer(R0[0], R0[0]) / (R0[0] @ R0[0])
    assert np.allclose(each.rotation_error(0.0), across @ turned, atol=1e-4)


def test_what_a_camera_is_turned_by_is_told_once():
    each, mount = known_place(FilterNoise(mount=1e-3)), 1e-3 * np.array([0.7, 0.2, -0.4])
    turn = cross_matrix(R0[0])
    across = np.eye(3) - np.outer(R0[0], R0[0]) / (R0[0] @ R0[0])
    for _ in range(3):
        assert each.use_fix(0, Fix("limb", turn @ mount, np.eye(3), np.eye(3), turn, 1), np.eye(3)).accepted
        assert np.allclose(each.mount[0], across @ mount, atol=1e-4)
