"""The design problem of a quality class: a face counts where the looks of the chosen candidates map it.

Each demand of the class (`observation.quality`) becomes requirements of each face (`requirements`): a COUNT of usable looks, a
PAIR that converges in alike light, SECTORS, a PAIR in unlike light. A COUNT that another requirement implies is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.designer.problem import WORD, DesignProblem, Words, whole_units
from swarm_mj.designer.requirements import (
    COUNT,
    PAIR,
    SECTORS,
    Requirements,
    completed,
    covered_by,
    first_gains,
    fulfilled,
    pruned,
    requirements,
)
from swarm_mj.observation.coverage import WORDS as UNSEEN
from swarm_mj.observation.coverage import Cause, shares
from swarm_mj.observation.quality import Bounds, Looks, bounds_of, is_pair, is_varied, sector_of, usable
from swarm_mj.scenarios.schema_quality import Demand, QualityClass
from swarm_mj.typing import Array, Ints, Ints32, Mask

#: What keeps a face off the map whoever flies, by kind of requirement; VARIED is a PAIR in unlike light.
VARIED = 3
WORDS = {COUNT: "lack looks within the limits", PAIR: "lack convergence in alike light"}
WORDS |= {SECTORS: "are not seen from enough sides", VARIED: "lack light that varies"}


@dataclass(frozen=True, kw_only=True, eq=False)
class ClassProblem(DesignProblem):
    """A face is covered where all its requirements are fulfilled.

    Attributes:
        asked: Of all faces.
        points: Number of visiting points.
        conditions: What each requirement is, COUNT, PAIR, SECTORS or VARIED, shape (r,).
        lacking: Whether all candidates together have too few looks of a face within the limits, shape (n_faces,).
        name: Of the class.
    """

    asked: Requirements
    points: int
    conditions: Ints32
    lacking: Mask
    name: str = "own"

    @property
    def n_points(self) -> int:
        """Number of visiting points, n_T."""
        return self.points

    @property
    def times(self) -> str:
        """Which class, for messages."""
        return f" at class {self.name}"

    @cached_property
    def gains(self) -> Array:
        """Progress by each point alone, shape (n_points,)."""
        return np.asarray(first_gains(self.asked))

    @cached_property
    def _unmet(self) -> Ints32:
        return np.asarray(fulfilled(self.asked, np.arange(self.n_points), self.n_faces))

    @property
    def coverable(self) -> Mask:
        """Which faces are mapped if every point is visited, shape (n_faces,)."""
        return self._unmet == 0

    @property
    def largest_view(self) -> float:
        """Weight of the faces to which the best point gives anything."""
        q = self.asked
        touched = np.unique(q.point.astype(np.int64) * self.n_faces + q.cell[q.owner])
        weight = np.bincount(touched // self.n_faces, self.weights[touched % self.n_faces], minlength=self.n_points)
        return float(weight.max())

    def covered_weight(self, points: Sequence[int] | Ints) -> int:
        """Weight of what visits to these points, numbered from 1, map."""
        return int(covered_by(self.asked, self.weights, np.unique(np.asarray(points, np.int64)) - 1))

    def mapped_by(self, points: Ints) -> Mask:
        """Which faces visits to these points, numbered from 1, map, shape (n_faces,)."""
        return np.asarray(fulfilled(self.asked, np.unique(points) - 1, self.n_faces)) == 0

    def covered_weights(self, genes: Ints) -> Ints:
        """Weight of what each of many gene maps maps, shape (m,)."""
        return np.array([self.covered_weight(design[1 : 1 + design[0]]) for design in genes], np.int64)

    def repaired(self, genes: Ints, noise: Array, enough: int, keep_size: bool) -> Ints:
        """Gene maps completed by largest progress and pruned, as `repair_designs` and `refill_designs` say."""
        result = genes.copy()
        for design, blur in zip(result, noise, strict=True):
            start = np.unique(design[1 : 1 + design[0]]) - 1
            most = int(design[0]) if keep_size else len(design) - 1
            found, covered = completed(self.asked, self.weights, self.gains, start, most, enough, blur)
            order = np.argsort((self.gains[found] + 1.0) * (1.0 - blur[found]), kind="stable")
            points = np.sort(pruned(self.asked, self.weights, found, min(enough, covered), order)) + 1
            design[0], design[1:] = len(points), np.resize(points, len(design) - 1)
        return result

    def causes(self) -> dict[str, float]:
        """Share of the target's area that no set of candidates maps, by what it lacks, in words [%].

        The first that applies: why it is not seen, looks within the limits, the first condition that even all do not fulfil.
        """
        q, n = self.asked, len(self.asked.cell)
        alone = q._replace(cell=np.arange(n, dtype=np.int32))
        failing = np.flatnonzero(fulfilled(alone, np.arange(self.n_points), n))[::-1]
        lack = np.full(self.n_faces, -1, np.int64)
        lack[q.cell[failing]] = self.conditions[failing]
        lack[(lack >= 0) & self.lacking] = COUNT
        unseen = self.why if len(self.why) else np.full(self.n_faces, Cause.NONE, np.int8)
        found = {UNSEEN[cause]: share for cause, share in shares(self.area, unseen).items()}
        percent = 100.0 * self.area / self.area.sum()
        here = [(words, (lack == kind) & (unseen == Cause.NONE)) for kind, words in WORDS.items()]
        return found | {words: float(percent[cells].sum()) for words, cells in here if cells.any()}


def class_problem(
    quality_class: QualityClass, looks: Looks, n_points: int, area: Array, **parameters: Any
) -> ClassProblem:
    """The problem of a class on the looks of candidates; `area` of each cell, and what else a `DesignProblem` has."""
    asked, conditions, lacking = class_requirements(quality_class, looks, n_points, whole_units(area))
    return ClassProblem(
        asked=asked,
        points=n_points,
        conditions=conditions,
        lacking=lacking,
        name=quality_class.name,
        area=area,
        **parameters,
    )


def class_requirements(
    quality_class: QualityClass, looks: Looks, n_points: int, weights: Ints
) -> tuple[Requirements, Ints32, Mask]:
    """What a class asks of each cell, of the looks of candidates; what each requirement is, COUNT to VARIED; and `lacking`."""
    parts = [_of_demand(demand, looks, n_points) for demand in quality_class.all_demands]
    tables = [table for part, _ in parts for table in part]
    cell, condition, need, sizes = (np.concatenate([table[i] for table in tables]) for i in range(4))
    starts = np.concatenate([[0], np.cumsum(sizes)])
    point = np.concatenate([table[4] for table in tables])
    edges, offset, values = [], 0, []
    for table in tables:
        values.append(table[5] + (offset if len(table[6]) else 0))
        edges.append(table[6])
        offset += len(table[6])
    order = np.argsort(cell, kind="stable")
    sizes = sizes[order]
    taken = np.repeat(starts[:-1][order] - np.cumsum(sizes) + sizes, sizes) + np.arange(sizes.sum())
    asked = requirements(
        cell[order],
        np.where(condition == VARIED, PAIR, condition)[order],
        need[order],
        np.concatenate([[0], np.cumsum(sizes)]),
        point[taken],
        np.concatenate(values)[taken],
        np.concatenate(edges),
        weights,
        n_points,
    )
    return asked, condition[order].astype(np.int32), np.logical_or.reduce([short for _, short in parts])


#: Columns of requirements of one condition for all cells: cell, condition, need, contributions, point, value, edges.
_Table = tuple[Ints, Ints, Ints, Ints, Ints, Ints, Words]


def _of_demand(demand: Demand, looks: Looks, n_points: int) -> tuple[list[_Table], Mask]:
    """Requirements of one demand, and which cells have too few looks; those of a cell may stand in any order."""
    bounds, n_cells = bounds_of(demand), len(looks.normal_A)
    cell = np.repeat(np.arange(n_cells), np.diff(looks.start))
    kept = np.flatnonzero(usable(demand, looks))
    kept = kept[np.lexsort((looks.taker[kept], cell[kept]))]
    pairs, which, count = np.unique(cell[kept] * n_points + looks.taker[kept], return_inverse=True, return_counts=True)
    owner, point = pairs // n_points, pairs % n_points
    found: list[_Table] = []
    implied = max(2 * (bounds.paired or bounds.varied), bounds.sectors)
    if demand.looks > implied:
        found.append(_table(n_cells, COUNT, demand.looks, owner, point, count))
    if bounds.sectors:
        sides = np.zeros(len(pairs), np.int64)
        np.bitwise_or.at(sides, which, _sides(looks, cell[kept], kept))
        some = sides > 0
        found.append(_table(n_cells, SECTORS, bounds.sectors, owner[some], point[some], sides[some]))
    start = np.searchsorted(cell[kept], np.arange(n_cells + 1))
    for asked, condition in ((bounds.paired, PAIR), (bounds.varied, VARIED)):
        if asked:
            found.append(_graph(bounds, looks, condition, start, kept, which, owner, point))
    return found, np.diff(start) < max(demand.looks, implied)


def _table(n_cells: int, condition: int, need: int, owner: Ints, point: Ints, value: Ints) -> _Table:
    cell = np.arange(n_cells)
    return cell, 0 * cell + condition, 0 * cell + need, np.bincount(owner, minlength=n_cells), point, value, _NO_EDGES


_NO_EDGES = np.empty(0, np.uint64)


@kernel
def _sides(looks: Looks, cell: Ints, kept: Ints) -> Ints:
    """The quadrant of each look as a bit, 0: none."""
    bits = np.zeros(len(kept), np.int64)
    for i in range(len(kept)):
        sector = sector_of(looks, cell[i], kept[i])
        bits[i] = 1 << sector if sector >= 0 else 0
    return bits


def _graph(
    bounds: Bounds, looks: Looks, condition: int, start: Ints, kept: Ints, which: Ints, owner: Ints, point: Ints
) -> _Table:
    """Requirements of a pair: the ends, those with any edge, and their neighbours."""
    varied = condition == VARIED
    ends = _has_edge(bounds, looks, varied, start, kept, which, len(owner))
    number = np.cumsum(ends) - 1
    sizes = np.bincount(owner[ends], minlength=len(start) - 1)
    words = -(-sizes // WORD)
    first = np.concatenate([[0], np.cumsum(sizes)])
    own = words[owner[ends]]
    value = np.cumsum(own) - own
    edges = np.zeros(int(own.sum()), np.uint64)
    _write_edges(bounds, looks, varied, start, kept, which, number, first, value, edges)
    cell = np.arange(len(sizes))
    return cell, 0 * cell + condition, 0 * cell + 2, sizes, point[ends], value, edges


@kernel
def _go_together(bounds: Bounds, looks: Looks, varied: bool, i: int, k: int) -> bool:
    return bool(is_varied(bounds, looks, i, k) if varied else is_pair(bounds, looks, i, k))


@kernel
def _has_edge(bounds: Bounds, looks: Looks, varied: bool, start: Ints, kept: Ints, which: Ints, n: int) -> Mask:
    """Whether each pair (cell, candidate) has a look that goes with another."""
    found = np.zeros(n, np.bool_)
    for cell in range(len(start) - 1):
        for a in range(start[cell], start[cell + 1]):
            for b in range(a + 1, start[cell + 1]):
                if (not found[which[a]] or not found[which[b]]) and _go_together(
                    bounds, looks, varied, kept[a], kept[b]
                ):
                    found[which[a]] = found[which[b]] = True
    return found


@kernel
def _write_edges(
    bounds: Bounds, looks: Looks, varied: bool, start: Ints, kept: Ints, which: Ints, number: Ints, first: Ints,
    value: Ints, edges: Words,
) -> None:  # fmt: skip
    """Set the bits of neighbours, both ways."""
    for cell in range(len(start) - 1):
        for a in range(start[cell], start[cell + 1]):
            for b in range(a + 1, start[cell + 1]):
                if _go_together(bounds, looks, varied, kept[a], kept[b]):
                    for one, other in ((which[a], which[b]), (which[b], which[a])):
                        place = number[other] - first[cell]
                        edges[value[number[one]] + place // WORD] |= np.uint64(1) << np.uint64(place % WORD)
