"""What cells ask of the set of candidates that is flown, requirement by requirement, and how far a set fulfils it; compiled.

A cell counts where all its requirements are fulfilled. There are three kinds; all are monotone in the set:

- COUNT: the looks of the chosen candidates are at least `need`;
- SECTORS: they come from at least `need` sides, each candidate's sides being bits of its value;
- PAIR: two of them go together: an edge of a graph of candidates, or a loop at one whose own looks do.

`need` of a PAIR is 2: an end of an edge is half of what is needed. Sets are grown candidate by candidate: `levels` counts the
looks, collects the bits, or is 1 for an end and 2 for a pair; `held` has the bits of the chosen ends of each graph.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import allocation_free, kernel
from swarm_mj.designer.problem import WORD, Words
from swarm_mj.typing import Array, Ints, Ints32, Mask

COUNT, SECTORS, PAIR = 0, 1, 2


class Requirements(NamedTuple):
    """Requirements of all cells, sorted by cell, and who can contribute to each.

    Attributes:
        cell: Whose each is, rising, shape (r,).
        kind: COUNT, SECTORS or PAIR, shape (r,).
        need: How much of it is asked for, shape (r,).
        first: Contributions to requirement k are those from first[k] up to first[k + 1], shape (r + 1,).
        point: Who contributes, from 0, rising within a requirement, shape (e,).
        value: Looks of a COUNT, bits of SECTORS, place in `edges` of the neighbours in a PAIR, shape (e,).
        edges: Neighbours of each end of each graph as bits, by their place in the requirement.
        place: Where the bits of each requirement start in `held`, shape (r + 1,).
        share: Weight of the cell over its number of requirements, shape (r,).
        at: Contributions of point p are entry[at[p]] up to entry[at[p + 1]], shape (n_points + 1,).
        entry: Numbers of contributions, point by point, shape (e,).
        owner: Requirement of each contribution, shape (e,).
    """

    cell: Ints32
    kind: Ints32
    need: Ints32
    first: Ints
    point: Ints32
    value: Ints32
    edges: Words
    place: Ints
    share: Array
    at: Ints
    entry: Ints32
    owner: Ints32


def requirements(
    cell: Ints | Ints32,
    kind: Ints | Ints32,
    need: Ints | Ints32,
    first: Ints,
    point: Ints | Ints32,
    value: Ints | Ints32,
    edges: Words,
    weights: Ints,
    n_points: int,
) -> Requirements:
    """Requirements with what follows from them; `weights` of all cells, the rest as in the class."""
    sizes = np.diff(first)
    place = np.concatenate([[0], np.cumsum(np.where(kind == PAIR, -(-sizes // WORD), 0))])
    point = np.ascontiguousarray(point, np.int32)
    share = weights[cell] / np.bincount(cell, minlength=len(weights))[cell]
    return Requirements(
        cell=np.ascontiguousarray(cell, np.int32),
        kind=np.ascontiguousarray(kind, np.int32),
        need=np.ascontiguousarray(need, np.int32),
        first=np.ascontiguousarray(first, np.int64),
        point=point,
        value=np.ascontiguousarray(value, np.int32),
        edges=np.ascontiguousarray(edges, np.uint64),
        place=place,
        share=np.ascontiguousarray(share, np.float64),
        at=np.concatenate([[0], np.cumsum(np.bincount(point, minlength=n_points))]),
        entry=np.argsort(point, kind="stable").astype(np.int32),
        owner=np.repeat(np.arange(len(cell), dtype=np.int32), sizes),
    )


def counts(first: Ints, point: Ints, need: int, weights: Ints, n_points: int) -> Requirements:
    """One COUNT of `need` for each cell, whose seers are point[first[c]] up to point[first[c + 1]]."""
    cell = np.arange(len(first) - 1)
    same, ones = np.ones_like(cell), np.ones(len(point), np.int64)
    return requirements(cell, COUNT * same, need * same, first, point, ones, np.empty(0, np.uint64), weights, n_points)


def selected(given: Requirements, cells: Ints, weights: Ints) -> Requirements:
    """The requirements of some cells, in rising order, renumbered; `weights` of those cells."""
    number = np.full(int(given.cell.max(initial=-1)) + 1, -1, np.int64)
    number[cells] = np.arange(len(cells))
    kept = number[given.cell] >= 0
    sizes = np.diff(given.first)[kept]
    chosen = np.repeat(kept, np.diff(given.first))
    return requirements(
        number[given.cell[kept]],
        given.kind[kept],
        given.need[kept],
        np.concatenate([[0], np.cumsum(sizes)]),
        given.point[chosen],
        given.value[chosen],
        given.edges,
        weights,
        len(given.at) - 1,
    )


@allocation_free
def bits_of(x: int) -> int:
    """Number of bits that are set."""
    n = 0
    while x:
        x &= x - 1
        n += 1
    return n


@allocation_free
def measure(q: Requirements, r: int, level: int) -> int:
    """How much of a requirement a level is; `need` or more fulfils it."""
    return min(bits_of(level) if q.kind[r] == SECTORS else level, q.need[r])


@allocation_free
def _raised(q: Requirements, levels: Ints32, held: Words, r: int, e: int) -> int:
    """The level of a requirement with contribution e besides."""
    if q.kind[r] == COUNT:
        return int(levels[r] + q.value[e])
    if q.kind[r] == SECTORS:
        return int(levels[r] | q.value[e])
    own, place = e - q.first[r], q.place[r]
    for w in range(q.place[r + 1] - place):
        others = held[place + w]
        if own // WORD == w:
            others |= np.uint64(1) << np.uint64(own % WORD)
        if q.edges[q.value[e] + w] & others != np.uint64(0):
            return 2
    return max(int(levels[r]), 1)


@allocation_free
def _enter(q: Requirements, levels: Ints32, held: Words, unmet: Ints32, e: int) -> None:
    """Count one contribution in place."""
    r = q.owner[e]
    before = measure(q, r, levels[r])
    levels[r] = _raised(q, levels, held, r, e)
    if q.kind[r] == PAIR:
        own = e - q.first[r]
        held[q.place[r] + own // WORD] |= np.uint64(1) << np.uint64(own % WORD)
    if before < q.need[r] <= measure(q, r, levels[r]):
        unmet[q.cell[r]] -= 1


@kernel
def nothing_chosen(q: Requirements, n_cells: int) -> tuple[Ints32, Words, Ints32]:
    """Levels, ends held and unfulfilled requirements of each cell of the empty set."""
    unmet = np.zeros(n_cells, np.int32)
    for r in range(len(q.cell)):
        unmet[q.cell[r]] += 1
    return np.zeros(len(q.cell), np.int32), np.zeros(q.place[-1], np.uint64), unmet


@kernel
def fulfilled(q: Requirements, points: Ints, n_cells: int) -> Ints32:
    """Unfulfilled requirements of each cell for a set of points, from 0, none twice, shape (n_cells,)."""
    levels, held, unmet = nothing_chosen(q, n_cells)
    for p in points:
        for i in range(q.at[p], q.at[p + 1]):
            _enter(q, levels, held, unmet, q.entry[i])
    return unmet


@kernel
def covered_by(q: Requirements, weights: Ints, points: Ints) -> np.int64:
    """Weight of the cells all of whose requirements a set of points fulfils."""
    unmet = fulfilled(q, points, len(weights))
    total = np.int64(0)
    for c in range(len(weights)):
        if unmet[c] == 0:
            total += weights[c]
    return total


@allocation_free
def _contribution(q: Requirements, levels: Ints32, held: Words, r: int, e: int) -> float:
    """Progress by contribution e, in units of weight."""
    step = measure(q, r, _raised(q, levels, held, r, e)) - measure(q, r, levels[r])
    return q.share[r] * step / q.need[r]


@kernel
def first_gains(q: Requirements) -> Array:
    """Progress by each point alone, in units of weight, shape (n_points,)."""
    return _gains(q, np.zeros(len(q.cell), np.int32), np.zeros(q.place[-1], np.uint64))


@kernel
def _gains(q: Requirements, levels: Ints32, held: Words) -> Array:
    """Progress by each point beside those that are chosen, in units of weight, shape (n_points,)."""
    gains = np.zeros(len(q.at) - 1)
    for r in range(len(q.cell)):
        if measure(q, r, levels[r]) < q.need[r]:
            for e in range(q.first[r], q.first[r + 1]):
                gains[q.point[e]] += _contribution(q, levels, held, r, e)
    return gains


@allocation_free
def _take(q: Requirements, levels: Ints32, held: Words, unmet: Ints32, gains: Array, p: int) -> None:
    """Add a point in place and bring the gains of all up to date."""
    for i in range(q.at[p], q.at[p + 1]):
        r = q.owner[q.entry[i]]
        if measure(q, r, levels[r]) >= q.need[r]:
            continue  # it gives nobody anything, before and after
        for e in range(q.first[r], q.first[r + 1]):
            gains[q.point[e]] -= _contribution(q, levels, held, r, e)
        _enter(q, levels, held, unmet, q.entry[i])
        for e in range(q.first[r], q.first[r + 1]):
            gains[q.point[e]] += _contribution(q, levels, held, r, e)


@kernel
def completed(
    q: Requirements, weights: Ints, start: Array, points: Ints, most: int, enough: int, noise: Array
) -> tuple[Ints, np.int64]:
    """A set of points with others of largest progress, until the cells that count weigh `enough`, or `most` are chosen.

    `start`: the gains of the empty set; `noise`: blur of every gain, 0 to 1. Returns the set and the weight of what counts.
    """
    levels, held, unmet = nothing_chosen(q, len(weights))
    chosen, n = np.zeros(len(start), np.bool_), len(points)
    gains = start[:0] if n else start.copy()
    result = np.empty(max(most, n), np.int64)
    result[:n] = points
    for p in points:
        chosen[p] = True
        for i in range(q.at[p], q.at[p + 1]):
            _enter(q, levels, held, unmet, q.entry[i])
    while True:
        covered, best = np.int64(0), -1
        for c in range(len(weights)):
            if unmet[c] == 0:
                covered += weights[c]
        if covered >= enough or n >= most:
            return result[:n], covered
        if not len(gains):  # most sets are enough as they are
            gains = _gains(q, levels, held)
        largest = 0.5  # of a unit of weight: below it there is nothing but rounding
        for p in range(len(gains)):
            if not chosen[p] and gains[p] * (1.0 - noise[p]) > largest:
                best, largest = p, gains[p] * (1.0 - noise[p])
        if best < 0:
            return result[:n], covered
        result[n], chosen[best] = best, True
        n += 1
        _take(q, levels, held, unmet, gains, best)


@allocation_free
def _leave(q: Requirements, levels: Ints32, held: Words, unmet: Ints32, chosen: Mask, e: int) -> None:
    """Take one contribution back in place; its point is no longer among the chosen."""
    r = q.owner[e]
    before = measure(q, r, levels[r])
    if q.kind[r] == COUNT:
        levels[r] -= q.value[e]
    else:
        levels[r] = 0
        if q.kind[r] == PAIR:
            own = e - q.first[r]
            held[q.place[r] + own // WORD] &= ~(np.uint64(1) << np.uint64(own % WORD))
        for other in range(q.first[r], q.first[r + 1]):
            if chosen[q.point[other]]:
                levels[r] = _raised(q, levels, held, r, other)
                if measure(q, r, levels[r]) == q.need[r]:
                    break  # SECTORS that are fulfilled matter no more, a PAIR is all there
    if measure(q, r, levels[r]) < q.need[r] <= before:
        unmet[q.cell[r]] += 1


@kernel
def pruned(q: Requirements, weights: Ints, points: Ints, enough: int, order: Ints) -> Ints:
    """A set without those that it does not need for `enough`, tried in an order of places; one is kept."""
    levels, held, unmet = nothing_chosen(q, len(weights))
    chosen, left = np.zeros(len(q.at) - 1, np.bool_), len(points)
    for p in points:
        chosen[p] = True
        for i in range(q.at[p], q.at[p + 1]):
            _enter(q, levels, held, unmet, q.entry[i])
    covered = weights[unmet == 0].sum()
    for j in order:
        if left == 1:
            break
        p, loss, i = points[j], np.int64(0), q.at[points[j]]
        chosen[p] = False
        while i < q.at[p + 1] and covered - loss >= enough:
            c = q.cell[q.owner[q.entry[i]]]
            before = unmet[c]
            _leave(q, levels, held, unmet, chosen, q.entry[i])
            loss += weights[c] if before == 0 and unmet[c] > 0 else 0
            i += 1
        if covered - loss >= enough:
            covered -= loss
            left -= 1
            continue
        chosen[p] = True
        for k in range(q.at[p], i):
            _enter(q, levels, held, unmet, q.entry[k])
    return points[chosen[points]]


@kernel
def largest_unfulfilling(q: Requirements, r: int, order: Ints) -> Mask:
    """A set of contributions that does not fulfil a requirement, to which none can be added; taken in an order."""
    alone = Requirements(
        q.cell[r : r + 1] * 0, q.kind[r : r + 1], q.need[r : r + 1], q.first[r : r + 2], q.point, q.value, q.edges,
        q.place[r : r + 2] - q.place[r], q.share[r : r + 1], q.at, q.entry, q.owner,
    )  # fmt: skip
    levels, held = np.zeros(1, np.int32), np.zeros(q.place[r + 1] - q.place[r], np.uint64)
    taken = np.zeros(q.first[r + 1] - q.first[r], np.bool_)
    for i in order:
        e = q.first[r] + i
        level = _raised(alone, levels, held, 0, e)
        if measure(alone, 0, level) < q.need[r]:
            taken[i], levels[0] = True, level
            if q.kind[r] == PAIR:
                held[i // WORD] |= np.uint64(1) << np.uint64(i % WORD)
    return taken
