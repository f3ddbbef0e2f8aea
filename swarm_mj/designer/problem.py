"""The design problem of AAS 19-144, equations 3 to 6, on a matrix of who sees what.

    minimise N_obs   subject to   |100 - P_TO| <= tolerance,   1 <= N_obs <= N_max,   1 <= p_j <= n_T

P_TO is the share of the target's area that the chosen spacecraft cover. With `fold` k a face counts as covered only where at
least k of them see it, so that the loss of any k - 1 spacecraft uncovers nothing.

A design is written as the gene map of the paper's Figure 5, [N_obs, p_1 ... p_Nmax]: N_obs genes are read and the rest are
carried along unread; points are numbered from 1.

Sets of faces are bits in uint64 words. Coverage by at least k spacecraft is counted in k layers of bits: layer i holds the
faces seen by more than i spacecraft, so adding one spacecraft is an `and` and an `or` per word and no counter is ever unpacked.
Areas are integer weights, so that sums are exact and do not depend on their order.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import kernel
from swarm_mj.errors import MissionError
from swarm_mj.observation.coverage import WORDS, percent_digits, shares
from swarm_mj.typing import Array, Ints, Mask

Words = NDArray[np.uint64]

WORD = 64
BYTES_PER_WORD = 8


def pack(sees: Mask) -> Words:
    """Rows of booleans, shape (n, n_faces), as words, shape (n, ceil(n_faces / 64)); bit j of word w is face 64 w + j."""
    n, n_faces = sees.shape
    n_words = -(-n_faces // WORD)
    padded = np.zeros((n, n_words * WORD), dtype=np.bool_)
    padded[:, :n_faces] = sees
    return np.packbits(padded, axis=1, bitorder="little").view("<u8").astype(np.uint64)


def weight_table(weights: Ints) -> Ints:
    """Summed weight of every possible byte at every byte of a row, shape (8 n_words, 256)."""
    n_bytes = -(-len(weights) // WORD) * BYTES_PER_WORD
    padded = np.zeros(n_bytes * 8, dtype=np.int64)
    padded[: len(weights)] = weights
    bits = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1, bitorder="little").astype(np.int64)
    return np.ascontiguousarray(padded.reshape(n_bytes, 8) @ bits.T)


@kernel
def word_weight(word: np.uint64, w: int, table: Ints) -> np.int64:
    """Weight of the faces in one word standing at place w of its row."""
    total = np.int64(0)
    for b in range(8):
        if word == np.uint64(0):
            break
        total += table[8 * w + b, word & np.uint64(255)]
        word = word >> np.uint64(8)
    return total


@kernel
def set_weight(row: Words, table: Ints) -> np.int64:
    """Weight of a whole set of faces."""
    total = np.int64(0)
    for w in range(row.shape[0]):
        total += word_weight(row[w], w, table)
    return total


@kernel
def add_to_layers(layers: Words, row: Words) -> None:
    """Count one more spacecraft that sees `row` in place; layers has shape (k, n_words)."""
    for w in range(row.shape[0]):
        for i in range(layers.shape[0] - 1, 0, -1):
            layers[i, w] |= layers[i - 1, w] & row[w]
        layers[0, w] |= row[w]


@kernel
def is_subset(small: Words, large: Words) -> bool:
    """Whether one set of faces lies within another."""
    for w in range(small.shape[0]):
        if small[w] & ~large[w] != np.uint64(0):
            return False
    return True


@kernel
def stands_before(points: Ints, j: int) -> bool:
    """Whether point number j of a list already stood before it."""
    for i in range(j):
        if points[i] == points[j]:
            return True
    return False


@kernel
def covered_weights(rows: Words, table: Ints, genes: Ints, fold: int) -> Ints:
    """Weight of the faces seen by at least `fold` spacecraft, for gene maps of shape (m, 1 + n_max), points from 1."""
    weights = np.zeros(genes.shape[0], dtype=np.int64)
    layers = np.empty((fold, rows.shape[1]), dtype=np.uint64)
    for d in range(genes.shape[0]):
        layers[:] = np.uint64(0)
        for j in range(genes[d, 0]):
            if not stands_before(genes[d, 1:], j):
                add_to_layers(layers, rows[genes[d, 1 + j] - 1])
        weights[d] = set_weight(layers[fold - 1], table)
    return weights


#: The whole target in units of area: fine enough that rounding every face to a unit is far below any tolerance.
AREA_UNITS = 2**50


def whole_units(area: Array) -> Ints:
    """Areas in any unit, shape (n_faces,), as whole `AREA_UNITS`."""
    return np.rint(area / area.sum() * AREA_UNITS).astype(np.int64)


class Evaluation(NamedTuple):
    """What a set of designs is worth, one entry per design.

    Attributes:
        n_observers: N_obs.
        covered_percent: P_TO, counting only faces seen by at least `fold` spacecraft.
        feasible: Whether |100 - P_TO| is within the tolerance.
        fitness: N_obs where feasible. Elsewhere N_max + 1 plus the share of the area missing beyond the tolerance, so that
            every feasible design is fitter than every infeasible one and those are ordered by how much they miss (after
            Deb, "An efficient constraint handling method for genetic algorithms", 2000; MATLAB's `ga` does likewise).
    """

    n_observers: Ints
    covered_percent: Array
    feasible: Mask
    fitness: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class DesignProblem(ABC):
    """Which points to visit so that the fewest spacecraft cover the target, whatever covering a face takes.

    Attributes:
        area: Area of each face [m^2 or any unit], shape (n_faces,).
        tolerance_percent: Largest |100 - P_TO| allowed [%].
        max_observers: N_max.
        avoided: Points of which the proof takes as few as it can among designs of as few spacecraft, shape (n_points,);
            empty: none.
        why: `Cause` why each face is seen from no point, shape (n_faces,); empty where that is not known.
    """

    area: Array
    avoided: Mask = field(default_factory=lambda: np.empty(0, np.bool_))
    why: NDArray[np.int8] = field(default_factory=lambda: np.empty(0, np.int8))
    tolerance_percent: float = 0.1
    max_observers: int = 20

    def __post_init__(self) -> None:
        object.__setattr__(self, "area", np.ascontiguousarray(self.area, dtype=np.float64))
        if not len(self.avoided):
            object.__setattr__(self, "avoided", np.zeros(self.n_points, np.bool_))

    @property
    @abstractmethod
    def n_points(self) -> int:
        """Number of visiting points, n_T."""

    @property
    @abstractmethod
    def coverable(self) -> Mask:
        """Which faces are covered if every point is visited, shape (n_faces,)."""

    @property
    @abstractmethod
    def largest_view(self) -> float:
        """So much weight at most does one spacecraft more cover, be the others however many."""

    @abstractmethod
    def covered_weight(self, points: Sequence[int] | Ints) -> int:
        """Weight that visits to these points, numbered from 1, cover; a point that stands twice counts once."""

    @abstractmethod
    def covered_weights(self, genes: Ints) -> Ints:
        """Weight that each of many gene maps covers, shape (m,)."""

    @abstractmethod
    def causes(self) -> dict[str, float]:
        """Shares of the target's area that no points cover, by their cause in words [%]; empty where that is not known."""

    def shortfall_words(self) -> str:
        """The causes in brackets, for messages."""
        found = self.causes()
        return f" ({', '.join(f'{share:.3g} % {words}' for words, share in found.items())})" if found else ""

    @property
    def n_faces(self) -> int:
        """Number of target faces."""
        return len(self.area)

    @property
    def times(self) -> str:
        """How a face is covered, for messages."""
        return ""

    @cached_property
    def weights(self) -> Ints:
        """Areas as whole `AREA_UNITS`, shape (n_faces,)."""
        return whole_units(self.area)

    @cached_property
    def total_weight(self) -> int:
        """Weight of the whole target."""
        return int(self.weights.sum())

    @property
    def slack(self) -> int:
        """Largest weight that may stay uncovered; a design exactly at the tolerance, up to rounding, is inside it."""
        return int(self.tolerance_percent / 100.0 * AREA_UNITS) + self.round_off

    @property
    def round_off(self) -> int:
        """By how much the weights of all faces may be off together."""
        return self.n_faces // 2 + 1

    def percent(self, covered_weight: int) -> float:
        """P_TO of a covered weight."""
        return 100.0 - 100.0 * (self.total_weight - covered_weight) / self.total_weight

    def is_enough(self, covered_weight: int) -> bool:
        """Whether a covered weight satisfies equation 4."""
        return self.total_weight - covered_weight <= self.slack

    def covered_percent(self, points: Sequence[int] | Ints) -> float:
        """P_TO of visits to these points, numbered from 1."""
        return self.percent(self.covered_weight(points))

    def evaluate(self, genes: Ints) -> Evaluation:
        """Value of many designs at once.

        Args:
            genes: Gene maps [N_obs, p_1 ... p_Nmax], shape (m, 1 + max_observers).
        """
        genes = np.ascontiguousarray(genes, dtype=np.int64)
        missing = self.total_weight - self.covered_weights(genes)
        feasible = missing <= self.slack
        too_much = np.maximum(missing - self.slack, 0) / self.total_weight
        fitness = np.where(feasible, genes[:, 0], self.max_observers + 1.0 + too_much)
        return Evaluation(genes[:, 0], 100.0 - 100.0 * missing / self.total_weight, feasible, fitness)

    @property
    def coverable_percent(self) -> float:
        """P_TO of visits to all points."""
        return self.percent(int(self.weights[self.coverable].sum()))

    @property
    def can_be_covered(self) -> bool:
        """Whether visiting every point would be enough."""
        return self.is_enough(int(self.weights[self.coverable].sum()))

    def require_coverable(self) -> None:
        """Check that visiting every point would be enough.

        Raises:
            MissionError: It would not; the message says how much can be seen and what would make it feasible.
        """
        if not self.can_be_covered:
            raise MissionError(_uncoverable(self, int(self.weights[self.coverable].sum())))


@dataclass(frozen=True, kw_only=True, eq=False)
class CoverProblem(DesignProblem):
    """A face is covered where enough spacecraft see it.

    Attributes:
        sees: Whether a spacecraft that visits a point sees a face, shape (n_points, n_faces).
        fold: How many spacecraft must see a face for it to count. No two visit one point, where they would collide, and would
            share whatever spoils the view.
    """

    sees: Mask
    fold: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "sees", np.ascontiguousarray(self.sees, dtype=np.bool_))
        super().__post_init__()

    @property
    def n_points(self) -> int:
        """Number of visiting points, n_T."""
        return self.sees.shape[0]

    @property
    def times(self) -> str:
        """How often a face must be seen, for messages."""
        return "" if self.fold == 1 else f" {self.fold} times"

    @cached_property
    def rows(self) -> Words:
        """`sees`, packed, shape (n_points, n_words)."""
        return pack(self.sees)

    @cached_property
    def table(self) -> Ints:
        """Byte-wise weights for `rows`."""
        return weight_table(self.weights)

    @cached_property
    def coverable(self) -> Mask:
        """Which faces are covered if every point is visited, shape (n_faces,)."""
        return self.sees.sum(axis=0) >= self.fold

    @property
    def of_use(self) -> Mask:
        """Who may be in a design of at most `max_observers` that is enough, shape (n_points,).

        Nobody else is: even with the others that add the most to it, as if these shared nothing, it would not be enough.
        """
        weights = self.weights / AREA_UNITS
        own = self.sees @ weights
        adds = own - (self.sees * weights) @ self.sees.T.astype(np.float64)
        others = -np.sort(-adds, axis=1)[:, : self.max_observers - 1]
        enough = 1.0 - (self.slack + self.round_off) / AREA_UNITS
        return np.asarray(own + others.sum(axis=1) >= enough - 1e-12)

    @property
    def largest_view(self) -> float:
        """The best view's weight; of `fold` views of a face one covers it."""
        return float((self.sees @ self.weights).max()) / self.fold

    def covered_weight(self, points: Sequence[int] | Ints) -> int:
        """Weight that visits to these points, numbered from 1, cover; a point that stands twice counts once."""
        layers = np.zeros((self.fold, self.rows.shape[1]), dtype=np.uint64)
        for point in np.unique(np.asarray(points, dtype=np.int64)):
            add_to_layers(layers, self.rows[point - 1])
        return int(set_weight(layers[-1], self.table))

    def covered_weights(self, genes: Ints) -> Ints:
        """Weight that each of many gene maps covers, shape (m,)."""
        return np.asarray(covered_weights(self.rows, self.table, genes, self.fold))

    def causes(self) -> dict[str, float]:
        """Shares of the target's area that are seen from nowhere, by their cause in words [%]; empty where `why` is."""
        found = shares(self.area, self.why) if len(self.why) else {}
        return {WORDS[cause]: share for cause, share in found.items()}


def gene_map(points: Sequence[int] | Ints, max_observers: int) -> Ints:
    """Gene map of a list of points, numbered from 1: they are sorted, and repeated in the genes that are not read.

    Raises:
        MissionError: No point, or more than max_observers.
    """
    ordered = np.sort(np.asarray(points, dtype=np.int64))
    if not 1 <= len(ordered) <= max_observers:
        raise MissionError(f"a design visits {len(ordered)} points: must be 1 to max_observers = {max_observers}")
    return np.concatenate([[len(ordered)], np.resize(ordered, max_observers)])


def _uncoverable(problem: DesignProblem, best: int) -> str:
    unseen = int((~problem.coverable).sum())
    missing = math.ceil(1e4 * (problem.total_weight - best - problem.round_off) / AREA_UNITS) / 100.0
    remedies = (
        f"allow a tolerance of at least {missing:.2f} %" if missing < 100.0 else "",
        "add visiting points",
        "ask for a lower fold" if isinstance(problem, CoverProblem) and problem.fold > 1 else "",
    )
    return (
        f"the target cannot be covered: visiting all {problem.n_points} points sees "
        f"{percent_digits(problem.percent(best))} % of its area{problem.times}, "
        f"{100.0 - problem.tolerance_percent:g} % is asked for, {unseen} of {problem.n_faces} faces fall short"
        f"{problem.shortfall_words()}; {', or '.join(filter(None, remedies))}"
    )
