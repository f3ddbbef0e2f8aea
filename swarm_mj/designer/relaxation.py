"""Linear rows that every design keeps, and the bound of their Lagrangian relaxation.

With x_p = 1 where point p is visited and m_c = 1 where cell c is missed, a row says a . x + b m_c >= b. Of the requirements:

- COUNT: the looks of each point, no more than are asked for, and b = `need`;
- SECTORS: likewise the sides, and where all sides there are must be seen, a row of ones for each of them with b = 1;
- PAIR: 1 for each end of an edge, 2 for each loop, and b = 2.

COUNT and full SECTORS are exact. For the others more rows are found when a design or a fraction of one breaks them
(`violated`): let I be a set that does not fulfil a requirement and to which no point can be added. A design within I does not
map the cell, whatever it has besides, so that sum of x_p over the others >= 1 - m_c.

The relaxation multiplies the rows by u >= 0 and adds them to the objective. What is left falls apart into points, each visited
where its reduced cost is below zero, and the knapsack of missed cells, whose linear relaxation is solved by sorting. Any u
gives a bound; u climbs along the subgradient (Held, Wolfe and Crowder 1974) with steps after Caprara, Fischetti and Toth
(1999), and the reduced costs exclude points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, vstack

from swarm_mj.compilation import kernel
from swarm_mj.designer.problem import WORD
from swarm_mj.designer.requirements import COUNT, PAIR, SECTORS, Requirements, bits_of, largest_unfulfilling
from swarm_mj.typing import Array, Ints, Mask

#: A row is broken where it falls short by this much.
BROKEN = 1e-4
#: Rows added to a relaxation at one go, the most broken ones.
AT_ONCE = 3000
#: The climb ends where the length of a step, as a share of the gap, is below this.
LEAST_STEP = 1e-4
#: After so many iterations without a better bound the step shrinks by this factor, and the climb goes on from the best one.
STALE, SHRINK = 15, 0.6
#: The climb aims at this multiple of the cost of the best design known, so that steps do not vanish near it.
AIMED = 1.02


class Rows(NamedTuple):
    """Rows a . x + need m_cell >= need.

    Attributes:
        matrix: a, shape (n, n_points).
        need: Shape (n,).
        cell: Shape (n,).
    """

    matrix: csr_array
    need: Array
    cell: Ints

    def of(self, chosen: Mask | Ints) -> Rows:
        """Some of them."""
        return Rows(self.matrix[chosen], self.need[chosen], self.cell[chosen])

    def joined(self, others: Rows) -> Rows:
        """These and others."""
        if not len(others.need):
            return self
        return Rows(
            vstack([self.matrix, others.matrix], format="csr"),
            np.concatenate([self.need, others.need]),
            np.concatenate([self.cell, others.cell]),
        )

    def shortfall(self, x: Array, missed: Array) -> Array:
        """By how much each falls short, as a share of `need`; `missed` of all cells."""
        return 1.0 - missed[self.cell] - (self.matrix @ x) / self.need


def rows_of(q: Requirements) -> Rows:
    """The rows of requirements that hold from the start."""
    first, column, value, need, cell = _rows(q)
    matrix = csr_array((value, column, first), shape=(len(need), len(q.at) - 1))
    return Rows(matrix, need, cell)


@kernel
def _rows(q: Requirements) -> tuple[Ints, Ints, Array, Array, Ints]:
    n_rows, n_entries = len(q.cell), len(q.point)
    every = np.zeros(len(q.cell), np.int64)  # sides that all must be seen
    for r in range(len(q.cell)):
        if q.kind[r] == SECTORS:
            sides = 0
            for e in range(q.first[r], q.first[r + 1]):
                sides |= q.value[e]
            if bits_of(sides) == q.need[r] > 1:
                every[r] = sides
                n_rows += q.need[r] - 1
                n_entries += (q.need[r] - 1) * (q.first[r + 1] - q.first[r])
    first, column, value = np.zeros(n_rows + 1, np.int64), np.empty(n_entries, np.int64), np.empty(n_entries)
    need, cell, row, n = np.empty(n_rows), np.empty(n_rows, np.int64), 0, 0
    for r in range(len(q.cell)):
        side = 1
        while True:
            while every[r] and not every[r] & side:
                side *= 2
            for e in range(q.first[r], q.first[r + 1]):
                amount = 1 if every[r] and q.value[e] & side else 0
                if not every[r]:
                    amount = _amount(q, r, e)
                if amount > 0:
                    column[n], value[n] = q.point[e], amount
                    n += 1
            need[row], cell[row], first[row + 1] = 1.0 if every[r] else q.need[r], q.cell[r], n
            row += 1
            side *= 2
            if side > every[r]:
                break
    return first, column[:n], value[:n], need, cell


@kernel
def _amount(q: Requirements, r: int, e: int) -> int:
    """Most that one point gives to a requirement."""
    if q.kind[r] == PAIR:
        own = e - q.first[r]
        return 2 if q.edges[q.value[e] + own // WORD] >> np.uint64(own % WORD) & np.uint64(1) else 1
    return min(bits_of(q.value[e]) if q.kind[r] == SECTORS else q.value[e], q.need[r])


def violated(q: Requirements, x: Array, missed: Array) -> Rows:
    """Rows of sets I that points and missed cells break, the most broken ones; x of all points, 0 to 1, missed of all cells."""
    columns: list[Ints] = []
    cells: list[int] = []
    depth: list[float] = []
    for r in np.flatnonzero((q.kind != COUNT) & (missed[q.cell] < 1.0 - BROKEN)):
        ends = q.point[q.first[r] : q.first[r + 1]]
        inside = largest_unfulfilling(q, r, np.lexsort((_friends(q, r), -x[ends])))
        outside = ends[~inside]
        short = 1.0 - missed[q.cell[r]] - x[outside].sum()
        if short > BROKEN:
            columns.append(outside)
            cells.append(int(q.cell[r]))
            depth.append(float(short))
    order = np.argsort(-np.array(depth), kind="stable")[:AT_ONCE]
    chosen = [columns[i] for i in order]
    first = np.cumsum([0, *map(len, chosen)])
    column = np.concatenate([*chosen, np.empty(0, np.int32)])
    matrix = csr_array((np.ones(len(column)), column, first), shape=(len(chosen), len(q.at) - 1))
    return Rows(matrix, np.ones(len(chosen)), np.array([cells[i] for i in order], np.int64))


@kernel
def _friends(q: Requirements, r: int) -> Ints:
    """How much each contribution to a requirement helps: its edges, or its sides."""
    found = np.zeros(q.first[r + 1] - q.first[r], np.int64)
    for i in range(len(found)):
        value = q.value[q.first[r] + i]
        if q.kind[r] == SECTORS:
            found[i] = bits_of(value)
        elif q.kind[r] == PAIR:
            for w in range(q.place[r + 1] - q.place[r]):
                word = q.edges[value + w]
                while word != np.uint64(0):
                    word &= word - np.uint64(1)
                    found[i] += 1
    return found


@kernel
def climb(
    first: Ints, column: Ints, value: Array, need: Array, cell: Ints, weights: Ints, mandatory: Mask, slack: int,
    cost: Array, upper: float, u: Array, step: float, iterations: int,
) -> tuple[float, Array, float]:  # fmt: skip
    """Best bound and its u after some iterations from u, changed in place, and the step to go on with."""
    best, best_u, stale = -np.inf, u.copy(), 0
    chosen = np.empty(len(cost))
    for _ in range(iterations):
        bound, missed = _value(first, column, value, need, cell, weights, mandatory, slack, cost, u, chosen)
        if bound > best + 1e-6 * abs(best):
            stale = 0
        else:
            stale += 1
        if bound > best:
            best, best_u = bound, u.copy()
        if stale >= STALE:
            step, stale = SHRINK * step, 0
            u[:] = best_u
            continue
        slope, norm = np.empty(len(u)), 0.0
        for r in range(len(u)):
            short = need[r] * (1.0 - missed[cell[r]])
            for e in range(first[r], first[r + 1]):
                if chosen[column[e]] < 0.0:
                    short -= value[e]
            slope[r] = 0.0 if u[r] == 0.0 and short < 0.0 else short
            norm += slope[r] * slope[r]
        if norm == 0.0 or step < LEAST_STEP:
            break
        for r in range(len(u)):
            u[r] = max(0.0, u[r] + step * max(AIMED * upper - bound, 0.05) / norm * slope[r])
    return best, best_u, step


@kernel
def _value(
    first: Ints, column: Ints, value: Array, need: Array, cell: Ints, weights: Ints, mandatory: Mask, slack: int,
    cost: Array, u: Array, reduced: Array,
) -> tuple[float, Array]:  # fmt: skip
    """The relaxation's minimum at u, and how far it misses each cell; the reduced costs are written."""
    reduced[:] = cost
    prize, total = np.zeros(len(weights)), 0.0
    for r in range(len(u)):
        if u[r] > 0.0:
            total += u[r] * need[r]
            prize[cell[r]] += u[r] * need[r]
            for e in range(first[r], first[r + 1]):
                reduced[column[e]] -= u[r] * value[e]
    for p in range(len(cost)):
        total += min(reduced[p], 0.0)
    missed, left = np.zeros(len(weights)), float(slack)
    open_cells = np.flatnonzero((prize > 0.0) & ~mandatory)
    for i in np.argsort(-prize[open_cells] / np.maximum(weights[open_cells], 1)):
        c = open_cells[i]
        missed[c] = min(1.0, left / max(weights[c], 1))
        total -= missed[c] * prize[c]
        left -= missed[c] * weights[c]
        if left <= 0.0:
            break
    return total, missed


def reduced_costs(rows: Rows, cost: Array, u: Array) -> Array:
    """Of each point, shape (n_points,)."""
    return np.asarray(cost - rows.matrix.T @ u)
