"""Consensus: how neighbours come to agree on numbers and on an attitude, round by round.

In every round each spacecraft sends what it holds to its neighbours and mixes what it hears into its own. With the weights
W = I - eps L the part that still differs shrinks by max |1 - eps lambda_k| over the Laplacian's eigenvalues but the first; for
eps up to 2 / (lambda_2 + lambda_n) that is 1 - eps lambda_2 (Olfati-Saber, Fax and Murray 2007, Proc. IEEE 95(1)). `adjacency`
is that of a `Graph`: symmetric, shape (n, n).
"""

from __future__ import annotations

import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.spacecraft.attitude.algebra import conjugate, product, rotation_vector, turn
from swarm_mj.typing import Array, Mask


def laplacian(adjacency: Mask) -> Array:
    """L = D - A, shape (n, n)."""
    A = adjacency.astype(np.float64)
    return np.diag(A.sum(axis=1)) - A


def lambda2(adjacency: Mask) -> float:
    """Algebraic connectivity (Fiedler 1973): the second smallest eigenvalue of the Laplacian; infinite for one node alone."""
    if len(adjacency) < 2:
        return float("inf")
    value = float(np.linalg.eigvalsh(laplacian(adjacency))[1])
    return value if value > 1e-12 * len(adjacency) else 0.0


def max_degree_weights(adjacency: Mask, step: float | None = None) -> Array:
    """W = I - eps L, shape (n, n).

    Args:
        adjacency: Of the graph.
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


def attitude_consensus(q_BN: Array, adjacency: Mask, step: float) -> Array:
    """One round of agreeing on an attitude: each turns by `step` times the sum of the rotations to its neighbours' attitudes.

    To first order the rotations from the common attitude behave as vectors in `average_consensus`. It converges where all
    attitudes lie within 90 deg of one another (Tron, Afsari and Vidal 2013: a geodesically convex ball).

    Args:
        q_BN: Unit quaternions (w, x, y, z), shape (n, 4); q and -q are the same attitude.
        adjacency: Of the graph.
        step: eps, see `max_degree_weights`.
    """
    phi = np.zeros((len(q_BN), 3))
    for i, j in zip(*np.nonzero(adjacency), strict=True):
        phi[i] += rotation_vector(product(conjugate(q_BN[i]), q_BN[j]))
    q = np.array([product(own, turn((x, y, z))) for own, (x, y, z) in zip(q_BN, step * phi, strict=True)])
    return q / np.linalg.norm(q, axis=1, keepdims=True)
