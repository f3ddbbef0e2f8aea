"""Consensus: how neighbours come to agree on numbers, on what has been seen, and on an attitude, round by round.

In every round each spacecraft sends what it holds to its neighbours and mixes what it hears into its own. With the weights
W = I - eps L the part that still differs shrinks by max |1 - eps lambda_k| over the Laplacian's eigenvalues but the first; for
eps up to 2 / (lambda_2 + lambda_n) that is 1 - eps lambda_2 (Olfati-Saber, Fax and Murray 2007, Proc. IEEE 95(1)).
"""

from __future__ import annotations

import numpy as np

from swarm_mj.coordination.graph import laplacian
from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Mask

#: Below this angle [rad] a rotation vector is taken as it is.
SMALL = 1e-12


def max_degree_weights(adjacency: Mask, step: float | None = None) -> Array:
    """W = I - eps L, shape (n, n).

    Args:
        adjacency: Symmetric, shape (n, n).
        step: eps; None: 1 / (1 + largest degree), with which every entry is at least 0.

    Raises:
        MissionError: The step is not between 0 and 2 / lambda_n, so that differences would grow.
    """
    L = laplacian(adjacency)
    if step is None:
        step = 1.0 / (1.0 + float(np.diag(L).max(initial=0.0)))
    largest = float(np.linalg.eigvalsh(L)[-1]) if len(L) else 0.0
    if not 0.0 < step * max(largest, 1e-300) < 2.0 and largest > 0.0:
        raise MissionError(f"step = {step:g}: must be > 0 and < {2.0 / largest:g} = 2 / lambda_n, or differences grow")
    return np.eye(len(L)) - step * L


def metropolis_weights(adjacency: Mask) -> Array:
    """Weights that need only the neighbours' degrees: 1 / (1 + max(d_i, d_j)) (Xiao, Boyd and Lall 2005), shape (n, n)."""
    degree = adjacency.sum(axis=1)
    W = np.where(adjacency, 1.0 / (1.0 + np.maximum(degree[:, None], degree)), 0.0)
    return W + np.diag(1.0 - W.sum(axis=1))


def convergence_factor(weights: Array) -> float:
    """Factor by which differences shrink in a round at least: the spectral norm of W - 11'/n; 1 where the graph falls apart."""
    n = len(weights)
    return float(np.linalg.norm(weights - np.full((n, n), 1.0 / n), 2))


def average_consensus(values: Array, weights: Array, rounds: int) -> Array:
    """What each holds after each round, shape (rounds + 1, n, ...); groups that hear each other agree on their own means.

    Args:
        values: At first, shape (n, ...).
        weights: Of one round, rows sum to 1, shape (n, n).
        rounds: How many.
    """
    held = [np.asarray(values, np.float64)]
    for _ in range(rounds):
        held.append(np.tensordot(weights, held[-1], axes=1))
    return np.array(held)


def disagreement(values: Array) -> float:
    """Norm of the differences from the mean."""
    return float(np.linalg.norm(values - values.mean(axis=0)))


def or_consensus(seen: Mask, heard: Mask) -> Mask:
    """One round of telling what has been seen: each knows what it knew, and what those knew that it hears.

    After as many rounds as the longest of the shortest ways has links, everybody in reach knows all.

    Args:
        seen: What each knows to be seen, shape (n, cells).
        heard: Whether the message from i reaches j in this round, shape (n, n).
    """
    return np.asarray(seen | np.matmul(heard.T, seen))


def attitude_consensus(q_BN: Array, adjacency: Mask, step: float) -> Array:
    """One round of agreeing on an attitude: each turns by `step` times the sum of the rotations to its neighbours' attitudes.

    To first order the rotations from the common attitude behave as vectors in `average_consensus`. It converges where all
    attitudes lie within 90 deg of one another (Tron, Afsari and Vidal 2013: a geodesically convex ball).

    Args:
        q_BN: Unit quaternions, scalar first, shape (n, 4); q and -q are the same attitude.
        adjacency: Symmetric, shape (n, n).
        step: eps, see `max_degree_weights`.
    """
    turn = np.zeros((len(q_BN), 3))
    for i, j in zip(*np.nonzero(adjacency), strict=True):
        turn[i] += rotation_vector(product(conjugate(q_BN[i]), q_BN[j]))
    q = np.array([product(q_BN[i], quaternion_of(step * turn[i])) for i in range(len(q_BN))])
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def product(p: Array, q: Array) -> Array:
    """Hamilton's product of two quaternions, scalar first, shape (4,)."""
    return np.concatenate(([p[0] * q[0] - p[1:] @ q[1:]], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])))


def conjugate(q: Array) -> Array:
    """The inverse of a unit quaternion, shape (4,)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def rotation_vector(q: Array) -> Array:
    """Axis times angle of a unit quaternion, the shorter way, shape (3,) [rad]."""
    q = -q if q[0] < 0.0 else q
    sine = float(np.linalg.norm(q[1:]))
    return 2.0 * q[1:] if sine < SMALL else 2.0 * np.arctan2(sine, q[0]) / sine * q[1:]


def quaternion_of(turn: Array) -> Array:
    """Unit quaternion of axis times angle [rad], shape (4,)."""
    angle = float(np.linalg.norm(turn))
    half = 0.5 * turn if angle < SMALL else np.sin(0.5 * angle) / angle * turn
    return np.concatenate(([np.cos(0.5 * angle)], half))
