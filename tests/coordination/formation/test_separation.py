"""Nobody comes too close: many random swaps, with the theorem's condition at the start, beside the same law unguarded."""

import numpy as np
import pytest

from swarm_mj.coordination.formation.separation import (
    Moves,
    all_pairs,
    half_spaces,
    least_on_stop,
    nearest_allowed,
    safe_moves,
    stopping_path,
    too_close_after,
)
from swarm_mj.coordination.formation.tracking import Tracking, cut

PERIOD, MOST, DISTANCE = 1.0, 7e-3, 10.0
LAW = Tracking(bandwidth=0.05, damping=1.0, dead_band=0.0)


def moves_of(r, v, braking=0.5 * MOST):
    return Moves(np.array(r, float), np.array(v, float), np.full(len(r), braking), PERIOD, DISTANCE)


def fly(r, v, goal, *, steps, barrier=True, guard=True, able=None):
    """Least distance on the way, read off the exact parabola in ten places a period, and the last places."""
    n = len(r)
    pairs, most = all_pairs(n), np.full(n, MOST)
    most[[] if able is None else np.flatnonzero(~able)] = 0.0
    least = np.inf
    inner = np.linspace(0.0, PERIOD, 11)[:, None, None]
    for _ in range(steps):
        moves = Moves(r, v, 0.5 * most, PERIOD, DISTANCE)
        w = cut(LAW.feedback(r - goal, v, np.maximum(most, 1e-12)), most)
        w = nearest_allowed(moves, w, most, pairs) if barrier else w
        w = safe_moves(moves, w, pairs)[0] if guard else w
        assert (np.linalg.norm(w, axis=1) <= most * (1.0 + 1e-9)).all()
        x = r + inner * v + 0.5 * inner**2 * w
        least = min(least, np.linalg.norm(x[:, pairs[:, 1]] - x[:, pairs[:, 0]], axis=2).min())
        r, v = moves.after(w).r, moves.after(w).v
    return least, r


def swap(rng, n):
    """All on a ring want to the other side; some are under way already."""
    angle = 2.0 * np.pi * np.arange(n) / n
    r = 50.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1) + rng.normal(0.0, 2.0, (n, 3))
    return r, rng.normal(0.0, 0.15, (n, 3)), -r + rng.normal(0.0, 0.5, (n, 3))


def test_swaps_never_come_too_close_and_would_without_the_guard():
    rng, collided, came = np.random.default_rng(5), 0, 0
    for case in range(10):
        start = swap(rng, 2 + case % 4)
        moves = moves_of(*start[:2])
        assert not too_close_after(moves, moves.stopping(), all_pairs(len(start[0]))).any()  # the condition
        least, end = fly(*start, steps=400)
        assert least >= DISTANCE
        came += np.linalg.norm(end - start[2], axis=1).max() < 5.0
        collided += fly(*start, steps=250, barrier=False, guard=False)[0] < DISTANCE
    assert collided >= 6
    assert came >= 7  # and it is no standstill that keeps them apart


def test_the_proof_alone_keeps_them_apart_whatever_is_wished():
    rng = np.random.default_rng(6)
    for _ in range(5):
        r, v, goal = swap(rng, 4)
        assert fly(r, v, goal, steps=200, barrier=False)[0] >= DISTANCE
    r, v = np.array([[-30.0, 0, 0], [30, 0, 0]]), np.array([[0.3, 0, 0], [-0.3, 0, 0]])
    pairs, least = all_pairs(2), np.inf
    for k in range(200):  # somebody who wants harm
        moves = moves_of(r, v)
        w = safe_moves(moves, MOST * np.array([[1.0, 0.1 * np.sin(k), 0], [-0.99, 0, 0]]) * 0.99, pairs)[0]
        r, v = moves.after(w).r, moves.after(w).v
        least = min(least, np.linalg.norm(r[1] - r[0]))
    assert DISTANCE <= least < DISTANCE + 1.0


def test_a_head_on_pair_stays_within_its_barrier_by_the_barrier_alone():
    r, v = np.array([[-40.0, 0, 0], [40, 0, 0]]), np.array([[0.3, 0, 0], [-0.3, 0, 0]])
    assert fly(r, v, -r, steps=500, guard=False)[0] >= DISTANCE
    assert fly(r, v, -r, steps=500, guard=False, barrier=False)[0] < 1.0


def test_the_half_space_is_the_barriers_condition_by_finite_differences():
    rng = np.random.default_rng(2)
    for _ in range(20):
        moves = moves_of(rng.normal(0.0, 30.0, (2, 3)) + [[0.0], [60.0]], rng.normal(0.0, 0.1, (2, 3)))
        w = rng.normal(0.0, MOST, (2, 3))
        e, bound = half_spaces(moves, all_pairs(2))

        def h(t, w=w, moves=moves):
            x = np.diff(moves.r + t * moves.v + 0.5 * t * t * w, axis=0)[0]
            u = np.diff(moves.v + t * w, axis=0)[0]
            d = np.linalg.norm(x)
            return np.sqrt(2.0 * MOST * (d - DISTANCE)) + x @ u / d

        slack = (h(1e-3) - h(-1e-3)) / 2e-3 + 0.1 * h(0.0)
        if bound[0] < MOST:  # not cut
            assert e[0] @ (w[1] - w[0]) - bound[0] == pytest.approx(slack, rel=1e-4, abs=1e-9)


def test_the_stop_that_is_checked_is_the_stop_that_is_flown():
    rng = np.random.default_rng(3)
    moves = moves_of(rng.normal(0.0, 30.0, (3, 3)), rng.normal(0.0, 0.2, (3, 3)))
    who, flown = np.arange(3), moves
    for k in range(240):
        np.testing.assert_allclose(flown.r, stopping_path(moves, who, np.full((3, 1), k * PERIOD))[:, 0], atol=1e-9)
        flown = flown.after(flown.stopping())
    assert np.abs(flown.v).max() < 1e-12
    assert moves.stop_time() == pytest.approx(np.ceil(np.linalg.norm(moves.v, axis=1) / (0.5 * MOST)))


def test_the_bound_lies_below_the_true_distance_of_the_stop():
    rng = np.random.default_rng(4)
    pairs = all_pairs(5)
    for _ in range(20):
        moves = moves_of(rng.normal(0.0, 40.0, (5, 3)), rng.normal(0.0, 0.4, (5, 3)))
        t = np.broadcast_to(np.linspace(0.0, moves.stop_time().max(), 4001), (5, 4001))
        places = stopping_path(moves, np.arange(5), t)
        true = np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=2).min(axis=1)
        bound = least_on_stop(moves, pairs)
        assert (bound <= true + 1e-9).all() and (bound > true - 0.5).all()


def test_one_that_cannot_push_is_flown_around():
    r, v = np.array([[0.0, 1.0, 0.0], [60.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 0.0], [-0.05, 0.0, 0.0]])
    goal = np.array([[100.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    able = np.array([True, False])
    assert fly(r, v, goal, steps=600, able=able)[0] >= DISTANCE
    assert fly(r, v, goal, steps=600, able=able, barrier=False, guard=False)[0] < DISTANCE


def test_the_nearest_allowed_point_is_that_of_a_general_solver():
    from scipy.optimize import minimize

    moves = moves_of([[-8.0, 0.0, 0.0], [8.0, 1.0, 0.0], [0.0, 200.0, 0.0]], [[0.1, 0, 0], [-0.1, 0, 0], [0, 0, 0]])
    pairs, most = all_pairs(3), np.full(3, MOST)
    wish = np.array([[3e-3, 0.0, 0.0], [-3e-3, 1e-3, 0.0], [0.0, 1e-3, 0.0]])
    from swarm_mj.coordination.formation import separation

    e, bound = half_spaces(moves._replace(distance=separation.FARTHER * DISTANCE), pairs)
    tight = np.einsum("pi,pi->p", e, wish[pairs[:, 1]] - wish[pairs[:, 0]]) < bound
    swerved = cut(separation.swerved(wish, separation.SWERVE * most, e, pairs, tight), most)
    found = nearest_allowed(moves, wish, most, pairs)
    rules = [
        {
            "type": "ineq",
            "fun": lambda w, p=p: (
                1e3 * (e[p] @ (w.reshape(3, 3)[pairs[p, 1]] - w.reshape(3, 3)[pairs[p, 0]]) - bound[p])
            ),
        }
        for p in range(3)
    ] + [
        {"type": "ineq", "fun": lambda w, j=j: 1e5 * (MOST**2 - w.reshape(3, 3)[j] @ w.reshape(3, 3)[j])}
        for j in range(3)
    ]
    best = minimize(
        lambda w: 1e4 * np.sum((w - swerved.ravel()) ** 2),
        np.zeros(9),
        constraints=rules,
        options={"ftol": 1e-14, "maxiter": 500},
    )
    np.testing.assert_allclose(found.ravel(), best.x, atol=5e-5)
