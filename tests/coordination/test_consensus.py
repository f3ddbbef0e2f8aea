"""Consensus, against the eigenvalues of graphs that are known in closed form, and against brute force."""

import numpy as np
import pytest

from swarm_mj.coordination import consensus
from swarm_mj.coordination.consensus import lambda2
from swarm_mj.errors import MissionError
from swarm_mj.spacecraft.attitude.algebra import conjugate, product, rotation_vector, turn


def path(n):
    A = np.zeros((n, n), bool)
    A[np.arange(n - 1), np.arange(1, n)] = True
    return A | A.T


def cycle(n):
    A = path(n)
    A[0, -1] = A[-1, 0] = True
    return A


def complete(n):
    return ~np.eye(n, dtype=bool)


#: Second eigenvalue of the Laplacian in closed form (Fiedler 1973).
KNOWN = [
    (path, 6, 2.0 - 2.0 * np.cos(np.pi / 6)),
    (path, 9, 2.0 - 2.0 * np.cos(np.pi / 9)),
    (cycle, 7, 2.0 - 2.0 * np.cos(2.0 * np.pi / 7)),
    (complete, 5, 5.0),
]


@pytest.mark.parametrize(("graph", "n", "known"), KNOWN)
def test_lambda2_is_that_of_paths_cycles_and_complete_graphs(graph, n, known):
    assert lambda2(graph(n)) == pytest.approx(known, rel=1e-12)


@pytest.mark.parametrize(("graph", "n", "known"), KNOWN)
def test_differences_shrink_by_one_minus_step_times_lambda2(graph, n, known):
    A = graph(n)
    step = 1.0 / (1.0 + A.sum(axis=1).max())
    values = np.random.default_rng(1).normal(size=n)
    rounds = 3 if graph is complete else int(np.log(1e-9) / np.log(1.0 - step * known))
    held = consensus.average_consensus(values, consensus.max_degree_weights(A), rounds)
    ratio = [np.std(b) / np.std(a) for a, b in zip(held[:-1], held[1:], strict=True)]
    if graph is complete:  # all other eigenvalues are equal: from the first round on
        assert ratio[0] == pytest.approx(1.0 - step * known, rel=1e-9)
    else:
        assert ratio[-1] == pytest.approx(1.0 - step * known, rel=1e-6)
    np.testing.assert_allclose(held.mean(axis=1), values.mean(), atol=1e-12)


def test_beyond_the_best_step_the_largest_eigenvalue_says_how_differences_shrink():
    """The complete bipartite graph of 3 and 3: eigenvalues 0, 3 (four times) and 6; the default step 1/4 exceeds 2/9."""
    side = np.arange(6) < 3
    W = consensus.max_degree_weights(side[:, None] != side)
    held = consensus.average_consensus(np.random.default_rng(2).normal(size=6), W, 30)
    ratio = [np.std(b) / np.std(a) for a, b in zip(held[:-1], held[1:], strict=True)]
    assert ratio[-1] == pytest.approx(0.5, rel=1e-6) and ratio[-1] != pytest.approx(1.0 - 0.25 * 3.0, rel=0.5)


def test_groups_that_do_not_hear_each_other_agree_on_their_own_means():
    A = np.zeros((5, 5), bool)
    A[:2, :2], A[2:, 2:] = complete(2), complete(3)
    W = consensus.max_degree_weights(A)
    assert lambda2(A) == 0.0
    held = consensus.average_consensus(np.array([0.0, 2.0, 3.0, 4.0, 8.0]), W, 100)[-1]
    np.testing.assert_allclose(held, [1.0, 1.0, 5.0, 5.0, 5.0], atol=1e-9)


def test_a_step_with_which_differences_grow_is_refused():
    with pytest.raises(MissionError, match="lambda_n"):
        consensus.max_degree_weights(complete(4), 0.6)


def turned_about(axis, angles):
    return np.array([turn(angle * np.asarray(axis, float)) for angle in angles])


def test_attitudes_about_one_axis_agree_as_numbers_do():
    A, angles = cycle(5), np.array([0.1, -0.3, 0.5, 0.2, -0.1])
    q = turned_about([0, 0, 1], angles)
    q[2] *= -1.0  # the same attitude
    held = consensus.average_consensus(angles, consensus.max_degree_weights(A, 0.3), 1)[-1]
    found = consensus.attitude_consensus(q, A, 0.3)
    np.testing.assert_allclose([rotation_vector(one)[2] for one in found], held, atol=1e-12)


def test_attitudes_within_a_quarter_turn_agree_at_the_rate_of_lambda2():
    rng, A = np.random.default_rng(3), path(4)
    q = np.array([turn(by) for by in rng.uniform(-0.4, 0.4, (4, 3))])
    apart = []
    for _ in range(70):
        q = consensus.attitude_consensus(q, A, 0.3)
        apart.append(max(np.linalg.norm(rotation_vector(product(conjugate(q[0]), p))) for p in q))
    assert apart[-1] / apart[-2] == pytest.approx(1.0 - 0.3 * lambda2(A), rel=1e-3)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0)
