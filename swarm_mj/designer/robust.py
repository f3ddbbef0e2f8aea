"""The fewest spacecraft that map enough of the target with a given probability, with proof.

Each spacecraft j is lost with a chance q_j of its own before it has seen all that it would, and has then seen less. Let a
realisation be one draw of everything else, dispersions and attitudes: who sees what then. With S who is sent,

    P(S) = mean over realisations of  sum_{L in S} prod_{j in L} q_j prod_{j in S - L} (1 - q_j) [S without L sees enough]

whose sum over what is lost is exact: `chance_of_enough` walks the tree of losses and leaves it where the answer is known. The
mean over realisations is a sample average (Kleywegt, Shapiro and Homem-de-Mello, SIAM J. Optim. 12, 2002), so that designs that
it favours are judged by realisations of other seeds.

For each number N of spacecraft a mixed-integer program minimises what fails at least. With x_j = 1 for who is sent, v = 1 where
a realisation fails without losses, y_j >= 1 where j alone sees some cell that must be seen, y_ij >= 1 where i and j alone do,

    v + (1 - e^-s) / s * sum_j a_j y_j + sum_ij w_ij y_ij <= 1 - P(S),   a_j = -ln(1 - q_j),   w_ij = q_i q_j (1 - q)^(N - 2)

with s the most that sum_j a_j y_j can be and q the largest chance: all who cannot be spared survive with e^-(sum_j a_j y_j),
convex, so that its chord over [0, s] lies above it; losing just i and j is one more way to fail. A cell with one seer is in the
rows sum_j (x_j + y_j) + 2 v >= 2, one with two in sum_j (x_j + 2 y_j) + sum_ij y_ij + 3 v >= 3; who sees it even when lost
counts fully. Where the program's design fails all the same, so does every one that sees nothing more of a few cells that
explain it, for P grows with S: one more row, that somebody else must be sent. So N is proven too small, or a design is found.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import LinearConstraint
from scipy.sparse import coo_array

from swarm_mj.compilation import kernel
from swarm_mj.designer.candidates.kept_flights import keep_sightings, kept_sightings
from swarm_mj.designer.candidates.pictures import Progress
from swarm_mj.designer.candidates.visibility import Candidate, Visibility, observers_of
from swarm_mj.designer.exact import FEASIBILITY_TOLERANCE, Waiting, solve_program
from swarm_mj.designer.problem import CoverProblem, Words, pack, set_weight, weight_table
from swarm_mj.designer.reduction import reduce_problem
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.io import interruption
from swarm_mj.scenarios.itinerary import arrival_times
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.faults.schedule import AT_DEPLOYMENT
from swarm_mj.typing import Array, Ints, Mask

#: Faults after which a spacecraft counts as seeing nothing more, though a camera may come back or look out of the deployer.
LOSSES = ("spacecraft_lost", "camera_off", "missed_deployment")
#: Spacecraft of which all losses are looked at: their tree has 2^24 leaves at worst.
MOST = 24
#: Designs of one number that may fall short of the probability on the other seeds before one more is taken.
MOST_REFUSED = 20
#: Set the seeds of these flights, and the random numbers of losses, apart from others that come from the same seed.
_FAMILY, _LOSSES = 11, 12
#: Half the width of a 95 % interval in standard errors.
INTERVAL = 1.96


class Loss(NamedTuple):
    """A fault that may take any spacecraft, each by itself: with which chance, and from when to when [s]."""

    probability: float
    first_s: float
    last_s: float


def losses_of(scenario: Scenario) -> list[Loss]:
    """The scenario's losses.

    Raises:
        ScenarioError: A fault is of a certain spacecraft, or of any one: which, no design can say.
    """
    found = []
    for number, fault in enumerate(scenario.faults):
        if (who := getattr(fault, "spacecraft", "all")) != "all":
            raise ScenarioError(
                f"faults.{number}.spacecraft = {who}: with designer.probability it must be all, each by itself with a chance "
                "of its own"
            )
        if fault.kind in LOSSES:
            span = (-math.inf, -math.inf) if fault.kind in AT_DEPLOYMENT else _span(fault, scenario.duration_s)
            found.append(Loss(fault.probability, *span))
    return found


def _span(fault: Any, duration_s: float) -> tuple[float, float]:
    at_s: float | None = fault.at_s
    return (fault.between_s or (0.0, duration_s)) if at_s is None else (at_s, at_s)


def without_losses(scenario: Scenario) -> Scenario:
    """The scenario with its other faults alone: what realisations are flown with."""
    faults = tuple(fault for fault in scenario.faults if fault.kind not in LOSSES)
    return scenario.model_copy(update={"faults": faults})


class Realisation(NamedTuple):
    """Who sees what in one draw of all but the losses.

    Attributes:
        full: Whether a candidate sees a cell, shape (n, cells).
        lost: Whether it has when it is lost, shape (n, cells).
        chance: With which it is, before it has seen all, shape (n,).
        area: Of each cell [m^2], shape (cells,).
    """

    full: Mask
    lost: Mask
    chance: Array
    area: Array


def realise(first_seen_s: Array, area: Array, losses: Sequence[Loss], rng: np.random.Generator) -> Realisation:
    """A realisation from when each candidate first sees each cell [s], NaN for never, shape (n, cells).

    A loss comes at a random time before the last cell; where all are seen at one instant nothing is drawn that matters.
    """
    full = ~np.isnan(first_seen_s)
    last_s = np.where(full, first_seen_s, -math.inf).max(axis=1, initial=-math.inf)
    chance, lost_s = np.zeros(len(full)), np.full(len(full), math.inf)
    for loss in losses:
        spread = loss.last_s - loss.first_s if loss.last_s > loss.first_s else 0.0
        before = np.minimum(last_s, loss.last_s) - loss.first_s if spread else np.zeros(len(full))
        share = np.clip(before / spread, 0.0, 1.0) if spread else (loss.first_s <= last_s).astype(np.float64)
        hit = loss.probability * share * full.any(axis=1)
        when = loss.first_s + rng.random(len(full)) * np.maximum(before, 0.0)
        # Of several losses the first one counts: which it is, given that one happens, is drawn.
        either = 1.0 - (1.0 - chance) * (1.0 - hit)
        u, both = rng.random(len(full)) * either, chance * hit
        lost_s = np.where(u < both, np.minimum(lost_s, when), np.where(u < hit, when, lost_s))
        chance = either
    return Realisation(full, first_seen_s < lost_s[:, None], chance, area)


@kernel
def chance_of_enough(full: Words, lost: Words, chance: Array, start: Words, table: Ints, enough: int) -> float:
    """Probability that a weight of `enough` is seen, with `start` seen from the outset; one row of cells a spacecraft."""
    n, words = full.shape
    cover, left = np.zeros((n + 1, words), np.uint64), np.zeros((n + 1, words), np.uint64)
    weight, turn = np.ones(n + 1), np.zeros(n + 1, np.int64)
    cover[0] = start
    for j in range(n - 1, -1, -1):
        left[j] = left[j + 1] | full[j]
    total, d = 0.0, 0
    while d >= 0:
        if turn[d] == 0:
            if set_weight(cover[d], table) >= enough:
                total += weight[d]
                turn[d] = 2
            elif d == n or weight[d] == 0.0 or set_weight(cover[d] | left[d], table) < enough:
                turn[d] = 2
        if turn[d] == 2:
            d -= 1
            continue
        works = turn[d] == 0
        turn[d] += 1
        cover[d + 1] = cover[d] | (full[d] if works else lost[d])
        weight[d + 1] = weight[d] * (1.0 - chance[d] if works else chance[d])
        turn[d + 1] = 0
        d += 1
    return total


def union_of(seen: Sequence[Realisation], tolerance_percent: float) -> Sample | None:
    """What is seen in any realisation, with the least chances of loss; None where their cells are not the same."""
    first = seen[0]
    if any(one.area.shape != first.area.shape or (one.area != first.area).any() for one in seen):
        return None
    full, lost = (np.any([one[k] for one in seen], axis=0) for k in (0, 1))
    return Sample(Realisation(full, lost, np.min([one.chance for one in seen], axis=0), first.area), tolerance_percent)


class Sample:
    """One realisation, reduced to the cells that decide.

    Attributes:
        full: Whether a candidate sees a cell, shape (n, cells).
        lost: Whether even when it is lost.
        chance: Of its loss, shape (n,).
        mandatory: Whether a cell must be seen, shape (cells,).
        shares: Of each cell in what may be missed, shape (cells,).
        possible: Whether all candidates together see enough.
    """

    def __init__(self, seen: Realisation, tolerance_percent: float) -> None:
        n = len(seen.full)
        both = np.concatenate((seen.full, seen.lost))
        problem = CoverProblem(sees=both, area=seen.area, tolerance_percent=tolerance_percent)
        self.possible = problem.can_be_covered
        reduced = reduce_problem(problem, all_points=True)
        sees = np.zeros((2 * n, len(reduced.weights)), np.bool_)
        sees[reduced.asked.point, reduced.asked.cell[reduced.asked.owner]] = True
        self.full, self.lost, self.chance = sees[:n], sees[n:], seen.chance
        self.mandatory, self.shares = reduced.mandatory, reduced.weights / max(reduced.slack, 1)
        self._rows, self._lost = pack(self.full), pack(self.lost)
        self._table, self._enough = weight_table(reduced.weights), int(reduced.weights.sum()) - reduced.slack

    def probability(self, chosen: Ints, asked: Mask | None = None) -> float:
        """That those chosen, from 0, see enough; of the cells asked for alone, shape (cells,), where those are given."""
        if not self.possible:
            return 0.0
        start = pack(np.zeros((1, self.full.shape[1]), np.bool_) if asked is None else ~asked[None, :])[0]
        if asked is not None:
            chosen = chosen[self.full[np.ix_(chosen, asked)].any(axis=1)]
        rows = self._rows[chosen], self._lost[chosen], self.chance[chosen]
        return float(chance_of_enough(*rows, start, self._table, self._enough))

    @property
    def bound(self) -> float:
        """What the probability cannot exceed, whoever is sent."""
        if not self.possible:
            return 0.0
        spared = np.where(self.full & ~self.lost, self.chance[:, None], np.where(self.full, 0.0, 1.0))
        return 1.0 - float(spared.prod(axis=0)[self.mandatory].max(initial=0.0))


class Cut(NamedTuple):
    """A set of candidates that is not enough, and with which probability it maps enough at most."""

    within: Mask
    probability: float


class Level(NamedTuple):
    """The answer for one probability.

    Attributes:
        asked: The probability.
        points: The design, numbered from 1, ascending; None: none was found.
        bound: No design of fewer keeps the probability on the realisations that it was sought on.
        sought: The design's probability on these.
        promised: On other seeds where there are any, else the same.
        low: From where its 95 % interval reaches, as the seeds go.
        high: To where.
        refused: Designs that kept the probability on the first realisations, but not on the other seeds.
    """

    asked: float
    points: Ints | None
    bound: int
    sought: float = math.nan
    promised: float = math.nan
    low: float = math.nan
    high: float = math.nan
    refused: int = 0

    @property
    def proven(self) -> bool:
        """Whether no smaller design keeps the probability."""
        return self.points is not None and len(self.points) <= self.bound


@dataclass(kw_only=True)
class RobustSearch:
    """A search for designs that map enough with a probability, and what is known so far.

    Attributes:
        realisations: Drawn of all but the losses.
        tolerance_percent: What may be missed of the area [%].
        max_observers: N_max.
        others: Realisations of other seeds, which judge; empty: nothing is left to chance but the losses.
        known: Probabilities on the realisations of designs that were judged, by points from 0.
        checked: The same on the other seeds, one number a seed.
        cuts: What is excluded.
        impossible: By number of spacecraft, the smallest probability that so many are proven not to keep.
    """

    realisations: Sequence[Realisation]
    tolerance_percent: float
    max_observers: int
    others: Sequence[Sample] = ()
    known: dict[tuple[int, ...], float] = field(default_factory=dict)
    checked: dict[tuple[int, ...], Array] = field(default_factory=dict)
    cuts: list[Cut] = field(default_factory=list)
    impossible: dict[int, float] = field(default_factory=dict)

    @property
    def n_points(self) -> int:
        """Number of candidates."""
        return len(self.realisations[0].full)

    @property
    def most(self) -> int:
        """The most spacecraft that are looked at."""
        return min(self.max_observers, self.n_points, MOST)

    @cached_property
    def union(self) -> Sample | None:
        """Everybody sees what it does in any of several realisations, so that the probability is at least as large."""
        return union_of(self.realisations, self.tolerance_percent) if len(self.realisations) > 1 else None

    @cached_property
    def samples(self) -> list[Sample]:
        """The realisations, each reduced."""
        return [Sample(seen, self.tolerance_percent) for seen in self.realisations]

    @cached_property
    def bound(self) -> float:
        """What the probability of no design exceeds."""
        return float(np.mean([sample.bound for sample in self.samples]))

    def probability(self, chosen: Ints) -> float:
        """P(S) on the realisations, of candidates from 0."""
        key = tuple(sorted(int(j) for j in chosen))
        if key not in self.known:
            interruption.check()
            self.known[key] = float(np.mean([sample.probability(np.array(key)) for sample in self.samples]))
        return self.known[key]

    def keeps(self, chosen: Ints, asked: float) -> bool:
        """Whether a design keeps a probability, on the realisations and on the other seeds."""
        return self.probability(chosen) >= asked and (not self.others or float(self._judged(chosen).mean()) >= asked)

    def _judged(self, chosen: Ints) -> Array:
        key = tuple(sorted(int(j) for j in chosen))
        if key not in self.checked:
            self.checked[key] = np.array([sample.probability(np.array(key)) for sample in self.others])
        return self.checked[key]

    def level(self, asked: float, chosen: Ints | None, bound: int, refused: int = 0) -> Level:
        """What is known of a design for a probability."""
        if chosen is None:
            return Level(asked, None, bound, refused=refused)
        sought = self.probability(chosen)
        promised, half = sought, 0.0
        if self.others:
            each = self._judged(chosen)
            promised = float(each.mean())
            half = INTERVAL * float(each.std(ddof=1)) / math.sqrt(len(each)) if len(each) > 1 else math.nan
        ends = max(promised - half, 0.0), min(promised + half, 1.0)
        return Level(asked, np.sort(chosen) + 1, bound, sought, promised, *ends, refused)

    def fewest(self, asked: float, time_limit_s: float, waiting: Waiting = None) -> Level:
        """The fewest spacecraft that keep a probability, as far as that is found and proven in time.

        After an interruption `so_far` has the best that was found until then.
        """
        start, bound, refused, proven = time.perf_counter(), 1, 0, True
        greedy = self._greedy(asked)
        for n in range(1, self.most + 1):
            left = time_limit_s - (time.perf_counter() - start)
            if waiting is not None:
                waiting(time_limit_s - max(left, 0.0))
            if left <= 0.0:
                break
            if greedy is not None and len(greedy) <= n and self.keeps(greedy, asked):
                return self.level(asked, greedy, bound, refused)
            found, turned_down = (None, 0) if self.impossible.get(n, 2.0) <= asked else self._at(n, asked, left)
            refused += turned_down
            if found is not None:
                return self.level(asked, found, bound, refused)
            if self.impossible.get(n, 2.0) <= asked:
                bound += proven
            else:
                proven = False
                if not turned_down:
                    break  # the time is up
        return self.level(asked, self._beyond(greedy, asked), bound, refused)

    def so_far(self, asked: float) -> Level:
        """What is known of a probability when the search was interrupted: of its designs the smallest that keeps it."""
        bound = next(n for n in range(1, self.most + 2) if self.impossible.get(n, 2.0) > asked)
        kept = sorted((len(key), -p, key) for key, p in self.known.items() if p >= asked)[:MOST_REFUSED]
        found = next((np.array(key) for *_, key in kept if self.keeps(np.array(key), asked)), None)
        return self.level(asked, found, bound)

    def _beyond(self, greedy: Ints | None, asked: float) -> Ints | None:
        """A greedy design that keeps a probability on the other seeds too, if need be of a higher one; None: none was found."""
        for share in (0.0, 0.5, 0.75):
            found = greedy if share == 0.0 else self._greedy(asked + share * (1.0 - asked))
            if found is not None and self.keeps(found, asked):
                return found
        return None

    def refusal(self, level: Level, time_limit_s: float) -> str:
        """Why there is no design for a probability, and what is possible."""
        asked = f"designer.probability = {level.asked:g}"
        best = max(self.known, key=self.known.__getitem__, default=())
        most = f"designs of at most {self.most} spacecraft"
        if self.most < self.max_observers:
            most += " (all candidates)" if self.most == self.n_points else " (so many losses are looked at)"
        known = f"the best known keeps {self.known[best]:.4f} with {len(best)}" if best else "none is known"
        remedy = (
            "ask for less, allow more designer.tolerance_percent or more designer.max_observers, or add visiting points"
        )
        if self.bound < level.asked:
            return f"{asked}: all candidates together keep at most {self.bound:.4f}; {known}; {remedy}"
        if level.bound > self.most:
            return f"{asked}: {most} are proven not to keep it; {known}; {remedy}"
        return (
            f"{asked}: {most} that keep it were not found in designer.time_limit_s = {time_limit_s:g}, nor proven not to exist"
            f" (at least {level.bound} are needed; {level.refused} kept it on {len(self.realisations)} realisations, "
            f"but not on the seeds of designer.check_flights); {known}; {remedy}, or allow more time"
        )

    def _greedy(self, asked: float) -> Ints | None:
        """A design that keeps a probability here: who adds most is added, who is not needed leaves; None: none was found."""
        chosen: list[int] = []
        while not chosen or self.probability(np.array(chosen)) < asked:
            if len(chosen) == self.most:
                return None
            gains = [(-1.0, -1.0) if j in chosen else self._worth([*chosen, j]) for j in range(self.n_points)]
            chosen.append(max(range(self.n_points), key=gains.__getitem__))
        for j in list(chosen):
            fewer = [i for i in chosen if i != j]
            if fewer and self.probability(np.array(fewer)) >= asked:
                chosen = fewer
        return np.array(chosen)

    def _worth(self, chosen: list[int]) -> tuple[float, float]:
        """Probability, then how often each cell is seen, counted to two."""
        times = np.mean([np.minimum(s.full[chosen].sum(axis=0), 2).mean() for s in self.samples])
        return self.probability(np.array(chosen)), float(times)

    def _at(self, n: int, asked: float, time_limit_s: float) -> tuple[Ints | None, int]:
        """A design of at most n spacecraft, or None and perhaps a proof that there is none; how many other seeds refused."""
        start, refused = time.perf_counter(), 0
        program = _Program(self.samples, self.union, n, asked)
        while refused < MOST_REFUSED:
            left = time_limit_s - (time.perf_counter() - start)
            if left <= 0.0:
                break
            excluded = [cut.within for cut in self.cuts if cut.probability < asked]
            answer = program.solve(excluded, left)
            if answer.status == 2:
                if not refused:
                    self.impossible[n] = min(self.impossible.get(n, 2.0), asked)
                break
            if answer.x is None:
                break
            chosen = np.flatnonzero(np.rint(answer.x[: self.n_points]) > 0.0)
            if self.probability(chosen) >= asked:
                if self.keeps(chosen, asked):
                    return chosen, refused
                refused += 1
                program.refuse(chosen)
            else:
                self.cuts.append(self._cut(chosen, asked, start + time_limit_s))
        return None, refused

    def _cut(self, chosen: Ints, asked: float, until_s: float) -> Cut:
        """Who may be added to a design that fails without any help: first all who see no more of the cells that explain it.

        At `until_s` of the clock it is left as large as it is.
        """
        few = self._explaining(chosen, asked)
        within = np.zeros(self.n_points, np.bool_)
        within[chosen] = True
        helps = np.any([s.full[:, cells].any(axis=1) for s, cells in zip(self.samples, few, strict=True)], axis=0)
        within |= ~helps
        probability = self._restricted(np.flatnonzero(within), few)
        for j in np.argsort(sum(s.full[:, cells].sum(axis=1) for s, cells in zip(self.samples, few, strict=True))):
            if time.perf_counter() > until_s:
                break
            if not within[j] and (within & helps).sum() < MOST:
                within[j] = True
                if (more := self._restricted(np.flatnonzero(within), few)) < asked:
                    probability = more
                else:
                    within[j] = False
        return Cut(within, probability)

    def _explaining(self, chosen: Ints, asked: float) -> list[Mask]:
        """Cells of each realisation that explain why a design fails: those with the fewest who see them."""
        times = [s.full[chosen].sum(axis=0) for s in self.samples]
        for most in range(len(chosen)):
            few = [t <= most for t in times]
            if self._restricted(chosen, few) < asked:
                return few
        return [np.ones(s.full.shape[1], np.bool_) for s in self.samples]

    def _restricted(self, chosen: Ints, few: Sequence[Mask]) -> float:
        interruption.check()
        return float(np.mean([s.probability(chosen, cells) for s, cells in zip(self.samples, few, strict=True)]))


class _Program:
    """The mixed-integer program for one number of spacecraft and one probability, see the module's docstring."""

    def __init__(self, samples: Sequence[Sample], union: Sample | None, n: int, asked: float) -> None:
        self._points, self._asked, self._n = len(samples[0].full), asked, n
        self._terms: list[tuple[Any, ...]] = []
        self._least: list[float] = []
        self._costs = [np.zeros(self._points)]
        self._add([-float(n)], (0, np.arange(self._points), -1.0))
        for group in ([union], samples) if union is not None else (samples,):
            before = sum(map(len, self._costs))
            for sample in group:
                # Pairs of many realisations take longer than they prove; those of the union stand for them.
                self._block(sample, _pairs(sample) if len(group) == 1 else np.empty((0, 2), np.int64), 1.0 / len(group))
            costs = np.concatenate(self._costs)
            failing = before + np.flatnonzero(costs[before:])
            self._add([asked - 1.0 - FEASIBILITY_TOLERANCE], (0, failing, -costs[failing]))

    def _new(self, cost: Array) -> Ints:
        """Columns that cost what they add to the probability of failing."""
        first = sum(map(len, self._costs))
        self._costs.append(cost)
        return np.arange(first, first + len(cost))

    def _add(self, least: Sequence[float], *terms: tuple[Any, Any, Any]) -> None:
        """Rows that are at least so much, of terms: rows counted from 0, columns and factors, one may stand for all."""
        self._terms += [np.broadcast_arrays(row + len(self._least), column, value) for row, column, value in terms]
        self._least += least

    def _block(self, sample: Sample, pairs: Ints, weight: float) -> None:
        """The columns and rows of one realisation."""
        chance = np.minimum(sample.chance, 1.0 - 1e-9)
        a, worst = -np.log1p(-chance), float(chance.max())
        most = self._n * float(a.max())
        if weight == 1.0:
            most = min(most, -math.log(self._asked))
        slope = -math.expm1(-most) / most if most > 0.0 else 0.0
        v, y = self._new(np.array([weight])), self._new(weight * slope * a)
        if not sample.possible:
            self._add([1.0], (0, v, 1.0))
            return
        w = chance[pairs[:, 0]] * chance[pairs[:, 1]] * (1.0 - worst) ** max(self._n - 2, 0)
        both, optional = self._new(weight * w), np.flatnonzero(~sample.mandatory)
        missed = self._new(np.zeros(len(optional)))
        j, c = np.nonzero(sample.full)
        cells = np.arange(len(sample.mandatory))
        self._add([1.0] * len(cells), (c, j, 1.0), (cells, v, 1.0), (optional, missed, 1.0))
        if len(optional):
            self._add([-1.0 - FEASIBILITY_TOLERANCE], (0, missed, -sample.shares[optional]))
        must = sample.mandatory[c]
        j, c, gone = j[must], (np.cumsum(sample.mandatory) - 1)[c[must]], ~sample.lost[j[must], c[must]]
        cells = np.arange(sample.mandatory.sum())
        if weight == 1.0:
            # One cell alone is missed with at most 1 - P: so many must see it, if it is not seen even when lost.
            rarest = math.log(max(float(chance.min()), 1e-300))
            seers = math.ceil(math.log1p(-self._asked) / rarest - FEASIBILITY_TOLERANCE)
            self._add([1.0] * len(cells), (c, j, np.where(gone, 1.0 / max(seers, 1), 1.0)))
        for least, some in ((2.0, pairs[:0]), (3.0, pairs)):
            if least == 2.0 or len(some):
                pair, cell = self._shared(sample, some)
                self._add(
                    [least] * len(cells),
                    (c, j, np.where(gone, 1.0, least)),
                    (c[gone], y[j[gone]], least - 1.0),
                    (cells, v, least),
                    (cell, both[pair], 1.0),
                )
        self._implied(y, np.arange(self._points))
        self._implied(both, pairs[:, 0])
        self._implied(both, pairs[:, 1])

    def _implied(self, columns: Ints, points: Ints) -> None:
        """Nobody who is not sent is missed."""
        row = np.arange(len(columns))
        self._add([0.0] * len(row), (row, points, 1.0), (row, columns, -1.0))

    @staticmethod
    def _shared(sample: Sample, pairs: Ints) -> Ints:
        """Pairs and the mandatory cells that both lose, numbers of each, shape (2, k)."""
        lose = (sample.full & ~sample.lost)[:, sample.mandatory]
        return np.array(np.nonzero(lose[pairs[:, 0]] & lose[pairs[:, 1]]))

    def refuse(self, chosen: Ints) -> None:
        """Exclude a design and all within it."""
        self._add([1.0], (0, np.setdiff1d(np.arange(self._points), chosen), 1.0))

    def solve(self, excluded: Sequence[Mask], time_limit_s: float) -> Any:
        """The answer of HiGHS, with somebody sent from outside of each set that is excluded."""
        n, failing = len(self._least), np.concatenate(self._costs)
        more = [np.broadcast_arrays(n + i, np.flatnonzero(~within), 1.0) for i, within in enumerate(excluded)]
        rows, columns, values = (np.concatenate(part) for part in zip(*self._terms, *more, strict=True))
        least = np.concatenate((self._least, np.ones(len(more))))
        matrix = coo_array((values, (rows, columns)), shape=(len(least), len(failing)))
        whole = np.arange(len(failing)) < self._points
        return solve_program(failing, [LinearConstraint(matrix.tocsr(), least, np.inf)], time_limit_s, whole=whole)


def _pairs(sample: Sample) -> Ints:
    """Pairs of candidates that a mandatory cell may lose together, shape (k, 2)."""
    lose = (sample.full & ~sample.lost)[:, sample.mandatory].astype(np.int64)
    likely = sample.chance > 0.0
    return np.argwhere(np.triu((lose @ lose.T > 0) & likely[:, None] & likely, 1))


def fly_realisations(
    scenario: Scenario, candidates: Sequence[Candidate], seeds: Sequence[int], progress: Progress | None = None
) -> Iterator[Realisation]:
    """Fly candidates together as the scenario disperses them, but for its losses: a realisation of each seed.

    The spacecraft do not matter to each other, but where the mothership's velocity is the mean of all. With
    `navigation.mode: optical` and no corrections no pictures are taken for navigation: what is known is drawn from what linear
    covariance says of pictures along the planned paths. What is kept of a flight is not flown again.
    """
    losses, plan, known, navigator = losses_of(scenario), None, None, None
    changes = {
        "design.visiting_points": [c.point for c in candidates],
        "design.observers": observers_of(scenario, candidates),
    }
    asked = without_losses(load_scenario(scenario, changes))
    if asked.observation.criterion == "arrival":
        asked = _until_arrival(asked)
    for number, seed in enumerate(seeds):
        interruption.check()
        flown = asked.model_copy(update={"seed": seed})
        found = kept_sightings(flown)
        if found is None:
            if plan is None or asked.dispersions.target_m > 0.0:  # the target's true place is drawn with the plan
                plan = make_plan(flown, check_separation=False)
            plan = replace(plan, scenario=flown)
            if flown.navigation.mode == "optical" and not flown.trajectory.corrections:
                from swarm_mj.flight.optical_covariance import DrawnKnowledge, known_at_arrivals

                if known is None:  # as of the first seed, whichever flights are kept
                    first = asked.model_copy(update={"seed": seeds[0]})
                    known = known_at_arrivals(make_plan(first, check_separation=False))
                navigator = DrawnKnowledge(known, plan.deployment.arrival_s, seed)
            seen = observe_flight(plan, simulate(plan, navigator=navigator)).coverage
            found = {"first_seen_s": seen.first_seen_by_s[: len(candidates)], "area": seen.area}
            keep_sightings(flown, **found)
        yield realise(found["first_seen_s"], found["area"], losses, np.random.default_rng([seed, _LOSSES]))
        if progress is not None:
            progress((number + 1) / len(seeds))


def _until_arrival(scenario: Scenario) -> Scenario:
    """The scenario with the pictures of the arrival alone, and without what comes after the last one."""
    interval_s, last_s = scenario.telemetry.interval_s, max(arrival_times(scenario))
    observation = scenario.observation.model_copy(
        update={"interval_s": interval_s * math.ceil(scenario.duration_s / interval_s)}
    )
    duration_s = scenario.duration_s if scenario.faults else interval_s * math.ceil(last_s / interval_s - 1e-9)
    return scenario.model_copy(update={"observation": observation, "duration_s": duration_s})


def robust_search(scenario: Scenario, seen: Visibility, progress: Progress | None = None) -> RobustSearch:
    """The search for a scenario's candidates, once their dispersed flights are flown.

    Raises:
        ScenarioError: A fault cannot be priced, see `losses_of`.
        SwarmError: A flight fails.
    """
    designer, losses = scenario.designer, losses_of(scenario)
    if not designer.realisations:
        at_s = np.array([[c.release_s + c.time_of_flight_s] for c in seen.candidates])
        rng = np.random.default_rng(scenario.seed)
        realisations, others = [realise(np.where(seen.sees, at_s, np.nan), seen.area, losses, rng)], []
    else:
        count = designer.realisations
        seeds = _seeds(scenario, count + designer.check_flights)
        flights = fly_realisations(scenario, seen.candidates, seeds, progress)
        realisations = list(islice(flights, count))
        others = [Sample(one, designer.tolerance_percent) for one in flights]
    return RobustSearch(
        realisations=realisations,
        tolerance_percent=designer.tolerance_percent,
        max_observers=designer.max_observers,
        others=others,
    )


def _seeds(scenario: Scenario, count: int) -> list[int]:
    """Seeds of flights, other ones than those of campaigns."""
    state = np.random.SeedSequence(scenario.seed, spawn_key=(_FAMILY,)).generate_state(count, np.uint64)
    return [int(word >> np.uint64(1)) for word in state]
