"""The covering problem made smaller without changing its minimum, before it is proven.

Nothing here compares all with all. A cell that implies another is looked for among those whose rarest seer sees the other
as well; a point that surpasses another, among those that see the other's rarest cell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.designer.class_problem import ClassProblem
from swarm_mj.designer.problem import CoverProblem, DesignProblem, Words, is_subset, pack
from swarm_mj.designer.requirements import PAIR, Requirements, counts, selected
from swarm_mj.typing import Ints, Mask

#: Faces that are packed at one go, so that the matrix never stands in memory twice.
FACES_AT_ONCE = 4096


class ReducedProblem(NamedTuple):
    """What is left to decide.

    Attributes:
        points: The points kept, numbered from 0, shape (n,).
        asked: What each cell asks of them, by their places in `points`.
        weights: Area of each cell in units of `AREA_UNITS`, shape (n_cells,).
        mandatory: Whether a cell must be covered, shape (n_cells,).
        slack: Weight of the cells that may be missed.
    """

    points: Ints
    asked: Requirements
    weights: Ints
    mandatory: Mask
    slack: int


def seers_of(problem: CoverProblem) -> tuple[Words, Ints]:
    """Steps 1 and 2: coverable cells as (seers as bits, shape (n_cells, words); weights, shape (n_cells,))."""
    coverable = np.flatnonzero(problem.coverable)
    parts = [pack(problem.sees[:, coverable[i : i + FACES_AT_ONCE]].T) for i in range(0, len(coverable), FACES_AT_ONCE)]
    return merged(np.concatenate([*parts, pack(np.zeros((0, problem.n_points), np.bool_))]), problem.weights[coverable])


def merged(seers: Words, weights: Ints) -> tuple[Words, Ints]:
    """Cells of equal seers as one, with the sum of their weights, in the order in which they first stand there."""
    whole = np.ascontiguousarray(seers).view(np.dtype((np.void, seers.shape[1] * seers.itemsize))).ravel()
    _, first, cell = np.unique(whole, return_index=True, return_inverse=True)
    total = np.zeros(len(first), np.int64)
    np.add.at(total, cell, weights)
    order = np.argsort(first)
    return seers[first[order]], total[order]


def cells_of(problem: DesignProblem) -> ReducedProblem:
    """Cells that can be covered, equal ones merged, and all points: steps 1 and 2."""
    if isinstance(problem, ClassProblem):
        asked, weights = _merged_requirements(problem)
    else:
        assert isinstance(problem, CoverProblem)
        seers, weights = seers_of(problem)
        first, point = listed(seers, problem.n_points)
        asked = counts(first, point, problem.fold, weights, problem.n_points)
    slack = _slack(problem, weights)
    return ReducedProblem(np.arange(problem.n_points), asked, weights, weights > slack, slack)


def _slack(problem: DesignProblem, weights: Ints) -> int:
    return problem.slack - (problem.total_weight - int(weights.sum()))


def _merged_requirements(problem: ClassProblem) -> tuple[Requirements, Ints]:
    """Requirements of cells that can be mapped, those that ask the same of the same points as one, and their weights."""
    cells = np.flatnonzero(problem.coverable)
    q = problem.asked
    begin = np.searchsorted(q.cell, np.arange(problem.n_faces + 1))
    number: dict[bytes, int] = {}
    same = np.array([number.setdefault(_asked_by(q, *begin[c : c + 2]), len(number)) for c in cells], np.int64)
    weights = np.zeros(len(number), np.int64)
    np.add.at(weights, same, problem.weights[cells])
    first = cells[np.unique(same, return_index=True)[1]]
    return selected(q, first, weights), weights


def _asked_by(q: Requirements, begin: int, end: int) -> bytes:
    """What some requirements ask of whom, as bytes."""
    parts = [q.kind[begin:end], q.need[begin:end], np.diff(q.first[begin : end + 1])]
    for r in range(begin, end):
        own = slice(q.first[r], q.first[r + 1])
        n = own.stop - own.start
        pair = q.kind[r] == PAIR and n > 0
        edges = q.edges[q.value[own.start] :][: n * (q.place[r + 1] - q.place[r])] if pair else q.value[own]
        parts += [q.point[own], edges]
    return b"".join(part.tobytes() for part in parts)


def reduce_problem(problem: DesignProblem, *, all_points: bool = False) -> ReducedProblem:
    """Make a problem smaller without changing its minimum, before it is proven.

    Four steps, each sound on its own, are repeated until nothing more falls away:

    1. Faces that no choice of points can cover are given up: their area comes off the tolerance.
    2. Faces seen by exactly the same points are one cell with the summed area.
    3. A cell larger than what may be missed is mandatory. A cell is implied, and dropped, where it is seen by all the points
       that see some mandatory cell: covering that one covers it.
    4. A point is dropped where at least `fold` others see all that it sees, and are not avoided unless it is. In a smallest
       design that uses it, either one of those is free and does as well, or all are visited and the point was not needed.

    Of a quality class only the first two are taken: a point whose looks are more may still not be what another is in a pair.

    Args:
        problem: What to cover; it must be coverable.
        all_points: Leave step 4 out: more is asked of a point than what it sees.
    """
    if not isinstance(problem, CoverProblem):
        return cells_of(problem)
    seers, weights = seers_of(problem)
    slack = _slack(problem, weights)
    points = np.arange(problem.n_points)
    while True:
        kept = ~implied(seers, weights > slack, len(points))
        seers, weights = seers[kept], weights[kept]
        if all_points:
            break
        rows = transposed(seers, len(points))
        stays = ~replaceable(rows, seers, problem.avoided[points], problem.fold)
        if stays.all():
            break
        points = points[stays]
        seers, weights = merged(transposed(rows[stays], len(weights)), weights)
    first, point = listed(seers, len(points))
    asked = counts(first, point, problem.fold, weights, len(points))
    return ReducedProblem(points, asked, weights, weights > slack, slack)


@kernel
def implied(seers: Words, mandatory: Mask, n_points: int) -> Mask:
    """Which cells are covered by covering a mandatory one; no two cells have equal seers."""
    n = len(seers)
    seen, count = _tallies(seers, n_points)
    dropped = np.zeros(n, np.bool_)
    first, following = np.full(n_points, -1, np.int64), np.full(n, -1, np.int64)  # lists of cells by their rarest seer
    for c in np.argsort(count):
        rarest = -1
        for w in range(seers.shape[1]):
            word = seers[c, w]
            while word != np.uint64(0) and not dropped[c]:
                p = 64 * w + _lowest(word)
                word &= word - np.uint64(1)
                if rarest < 0 or seen[p] < seen[rarest]:
                    rarest = p
                other = first[p]
                while other >= 0 and not dropped[c]:
                    dropped[c] = is_subset(seers[other], seers[c])
                    other = following[other]
        if mandatory[c] and not dropped[c] and rarest >= 0:
            following[c], first[rarest] = first[rarest], c
    return dropped


@kernel
def replaceable(rows: Words, seers: Words, avoided: Mask, fold: int) -> Mask:
    """Which points can be dropped by step 4; equal points stand in for each other in their order."""
    n = len(rows)
    times, count = _tallies(rows, len(seers))
    dropped = np.zeros(n, np.bool_)
    for p in range(n):
        rarest = -1
        for w in range(rows.shape[1]):
            word = rows[p, w]
            while word != np.uint64(0):
                c = 64 * w + _lowest(word)
                word &= word - np.uint64(1)
                if rarest < 0 or times[c] < times[rarest]:
                    rarest = c
        stand_ins = 0
        for other in range(n):
            if other == p or (avoided[other] and not avoided[p]) or count[other] < count[p]:
                continue
            if rarest >= 0 and not _has(seers[rarest], other):
                continue
            if not is_subset(rows[p], rows[other]):
                continue
            better = count[other] > count[p] or (avoided[p] and not avoided[other])
            stand_ins += better or other < p
        dropped[p] = stand_ins >= fold
    return dropped


@kernel
def _tallies(rows: Words, n_columns: int) -> tuple[Ints, Ints]:
    """How many bits each column and each row has."""
    of_column, of_row = np.zeros(n_columns, np.int64), np.zeros(len(rows), np.int64)
    for i in range(len(rows)):
        for w in range(rows.shape[1]):
            word = rows[i, w]
            while word != np.uint64(0):
                of_column[64 * w + _lowest(word)] += 1
                of_row[i] += 1
                word &= word - np.uint64(1)
    return of_column, of_row


@kernel
def transposed(rows: Words, n_columns: int) -> Words:
    """Rows of bits as columns, shape (n_columns, words)."""
    result = np.zeros((n_columns, (len(rows) + 63) // 64), np.uint64)
    for i in range(len(rows)):
        for w in range(rows.shape[1]):
            word = rows[i, w]
            while word != np.uint64(0):
                result[64 * w + _lowest(word), i // 64] |= np.uint64(1) << np.uint64(i % 64)
                word &= word - np.uint64(1)
    return result


@kernel
def listed(rows: Words, n_columns: int) -> tuple[Ints, Ints]:
    """Where the bits of each row start in a list of all, shape (n + 1,), and that list of columns."""
    _, count = _tallies(rows, n_columns)
    first = np.zeros(len(rows) + 1, np.int64)
    first[1:] = np.cumsum(count)
    columns, n = np.empty(first[-1], np.int64), 0
    for i in range(len(rows)):
        for w in range(rows.shape[1]):
            word = rows[i, w]
            while word != np.uint64(0):
                columns[n] = 64 * w + _lowest(word)
                n += 1
                word &= word - np.uint64(1)
    return first, columns


@kernel
def _has(row: Words, column: int) -> bool:
    return bool(row[column // 64] >> np.uint64(column % 64) & np.uint64(1))


@kernel
def _lowest(word: np.uint64) -> int:
    """Place of the lowest bit of a word that is not 0, by halving."""
    place, width = 0, 32
    while width:
        if word & ((np.uint64(1) << np.uint64(width)) - np.uint64(1)) == np.uint64(0):
            word >>= np.uint64(width)
            place += width
        width >>= 1
    return place
