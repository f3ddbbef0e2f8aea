"""Repair of designs, compiled: complete greedily what does not cover, prune what is not needed.

Crossover and mutation alone rarely reach the minimum: a child that covers everything usually carries spacecraft that it does
not need, and one with too few usually misses a face. Repair turns both into a design from which no spacecraft can be taken
away. Completion adds the point that sees most of the area still missing; pruning takes the spacecraft whose loss uncovers
least, while the tolerance allows. Both choices are blurred with the random numbers that the caller gives, so that equal
parents do not always have equal children.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.designer.class_problem import ClassProblem
from swarm_mj.designer.problem import (
    CoverProblem,
    DesignProblem,
    Words,
    add_to_layers,
    set_weight,
    stands_before,
    word_weight,
)
from swarm_mj.typing import Array, Ints


def repair_designs(problem: DesignProblem, genes: Ints, noise: Array) -> Ints:
    """Designs completed until they cover the target within its tolerance, then pruned; copies.

    A design that cannot be completed within `max_observers` is returned as far as it came.

    Args:
        problem: What to cover.
        genes: Gene maps, shape (m, 1 + max_observers); a point that stands twice counts once.
        noise: Blur of every point's gain, 0 for purely greedy choices, below 1, shape (m, n_points).

    Returns:
        Gene maps, the points ascending, the genes that are not read repeating those that are.
    """
    return _repaired(problem, genes, noise, problem.total_weight - problem.slack, False)


def refill_designs(problem: DesignProblem, genes: Ints, noise: Array) -> Ints:
    """Designs completed up to the N_obs that they name, whatever they then cover, without spacecraft that add nothing.

    Arguments and result as for `repair_designs`; the tolerance plays no part.
    """
    return _repaired(problem, genes, noise, problem.total_weight, True)


def _repaired(problem: DesignProblem, genes: Ints, noise: Array, enough: int, keep_size: bool) -> Ints:
    repaired = np.ascontiguousarray(genes, dtype=np.int64).copy()
    blur = np.ascontiguousarray(noise, dtype=np.float64)
    if isinstance(problem, ClassProblem):
        return problem.repaired(repaired, blur, enough, keep_size)
    assert isinstance(problem, CoverProblem)
    _repair_all(problem.rows, problem.table, problem.fold, enough, keep_size, blur, repaired)
    return repaired


@kernel
def _repair_all(rows: Words, table: Ints, fold: int, enough: int, keep_size: bool, noise: Array, genes: Ints) -> None:
    """Repair gene maps in place until a weight of `enough` is covered; with keep_size N_obs never grows."""
    layers = np.zeros((fold + 1, rows.shape[1]), dtype=np.uint64)
    for d in range(genes.shape[0]):
        points = genes[d, 1:]
        most = genes[d, 0] if keep_size else points.shape[0]
        n = _drop_repeats(points, genes[d, 0])
        _count(rows, points, n, layers)
        n = _complete(rows, table, noise[d], enough, points[:most], n, layers)
        n = _prune(rows, table, noise[d], enough, points, n, layers)
        genes[d, 0] = n
        points[:n].sort()
        for j in range(n, points.shape[0]):
            points[j] = points[j - n]


@kernel
def _drop_repeats(points: Ints, n: int) -> int:
    """Close up the list in place without points that stand in it already; returns its new length."""
    kept = 0
    for j in range(n):
        points[kept] = points[j]
        if not stands_before(points, kept):
            kept += 1
    return kept


@kernel
def _count(rows: Words, points: Ints, n: int, layers: Words) -> None:
    """Layers of the first n points, afresh."""
    layers[:] = np.uint64(0)
    for j in range(n):
        add_to_layers(layers, rows[points[j] - 1])


@kernel
def _complete(rows: Words, table: Ints, noise: Array, enough: int, points: Ints, n: int, layers: Words) -> int:
    """Add points until the design covers enough, or nothing helps or fits; returns its new length."""
    visited = np.zeros(rows.shape[0], dtype=np.bool_)
    for j in range(n):
        visited[points[j] - 1] = True
    covered = layers[layers.shape[0] - 2]
    while n < points.shape[0] and set_weight(covered, table) < enough:
        best, best_gain = -1, 0.0
        for p in range(rows.shape[0]):
            if not visited[p]:
                gain = _gain(rows[p], covered, table) * (1.0 - noise[p])
                if gain > best_gain:
                    best, best_gain = p, gain
        if best < 0:
            break
        points[n] = best + 1
        n += 1
        visited[best] = True
        add_to_layers(layers, rows[best])
    return n


@kernel
def _gain(row: Words, covered: Words, table: Ints) -> np.int64:
    """Weight of the faces that a point sees and that are not yet covered often enough."""
    gain = np.int64(0)
    for w in range(row.shape[0]):
        new = row[w] & ~covered[w]
        if new != np.uint64(0):
            gain += word_weight(new, w, table)
    return gain


@kernel
def _prune(rows: Words, table: Ints, noise: Array, enough: int, points: Ints, n: int, layers: Words) -> int:
    """Take away points while the rest still covers enough, or else as much as before; returns the new length."""
    fold = layers.shape[0] - 1
    spare = max(set_weight(layers[fold - 1], table) - enough, 0)
    while n > 1:
        worst, least, loss_of_worst = -1, np.inf, 0
        for j in range(n):
            loss = _loss(rows[points[j] - 1], layers[fold - 1], layers[fold], table)
            blurred = (loss + 1.0) * (1.0 - noise[points[j] - 1])
            if loss <= spare and blurred < least:
                worst, least, loss_of_worst = j, blurred, loss
        if worst < 0:
            break
        spare -= loss_of_worst
        n -= 1
        points[worst] = points[n]
        _count(rows, points, n, layers)
    return n


@kernel
def _loss(row: Words, enough_times: Words, once_more: Words, table: Ints) -> np.int64:
    """Weight of the faces that are covered no more often than needed and that this point sees."""
    loss = np.int64(0)
    for w in range(row.shape[0]):
        critical = row[w] & enough_times[w] & ~once_more[w]
        if critical != np.uint64(0):
            loss += word_weight(critical, w, table)
    return loss
