"""The fewest spacecraft that cover the target and whose whole map is on Earth in time, with proof.

Logic-based Benders decomposition (Hooker and Ottosson, "Logic-based Benders decomposition", Mathematical Programming 96, 2003):
the covering program proposes a design, its flight and the best schedule of its transfers judge it, and where it is late, the
program is told so by cuts and solved again.

- This set of points is excluded, and no other.
- The least data of a map, f(S) = sum_c min_{p in S} bit_pc, fall with every point that is added, each time by less (f is
  supermodular). With gain_p = f(S) - f(S + p), every design S' has f(S') >= f(S) - sum gain_p over p of S' not in S. Where what
  must be sent of f(S) exceeds what can be sent until then by a surplus, every design in time has sum_p gain_p x_p >= surplus.
  This excludes S, all its subsets and all that add too little, before any of them is flown. Points that let sending begin
  earlier gain what can be sent meanwhile; the earliest start, too, gains less the more points there are.

Each program allows at least every design in time, so that its bound is a bound.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from swarm_mj.designer.arrival import HOUR, Arrival, Needs
from swarm_mj.designer.exact import Cut, ExactResult, Waiting, solve_cut, solve_exact
from swarm_mj.designer.problem import CoverProblem
from swarm_mj.designer.reduction import reduce_problem
from swarm_mj.errors import MissionError
from swarm_mj.typing import Ints

#: Tells when the map of a design is on Earth, by its points, numbered from 1.
Judge = Callable[[Ints], Arrival]
#: The surplus from which a cut is made, as a share of what can be sent: far above rounding.
LEAST_SURPLUS = 1e-9


@dataclass(kw_only=True)
class Within:
    """A search under a limit of time, and what is known so far.

    Attributes:
        problem: What to cover.
        needs: What designs must send at least.
        limit_s: When all must be on Earth [s past the epoch].
        judge: Flies a design.
        arrivals: What was flown, by points, numbered from 1.
        cuts: What is excluded.
        unflown: How many proposals were excluded by their data alone.
    """

    problem: CoverProblem
    needs: Needs
    limit_s: float
    judge: Judge
    arrivals: dict[tuple[int, ...], Arrival] = field(default_factory=dict)
    cuts: list[Cut] = field(default_factory=list)
    unflown: int = 0

    def arrival(self, points: Ints) -> Arrival:
        """Of a design, which is flown once."""
        key = tuple(int(p) for p in points)
        if key not in self.arrivals:
            self.arrivals[key] = self.judge(points)
        return self.arrivals[key]

    def known(self, points: Ints) -> Arrival | None:
        """Of a design if it was flown."""
        return self.arrivals.get(tuple(int(p) for p in points))

    def meets(self, points: Ints) -> bool:
        """Whether a design is known to be in time."""
        found = self.known(points)
        return found is not None and found.meets(self.limit_s, self.problem.tolerance_percent)

    @property
    def _all_proven(self) -> bool:
        """Whether every design that was flown and found late has no better schedule."""
        return all(
            a.proven for a in self.arrivals.values() if not a.meets(self.limit_s, self.problem.tolerance_percent)
        )

    @property
    def soonest(self) -> tuple[tuple[int, ...], float]:
        """The design of those flown that covers the target and is the first on Earth, and when [s]; () and infinity: none."""
        tolerance = self.problem.tolerance_percent
        ever = [(a.full_s, points) for points, a in self.arrivals.items() if a.meets(math.inf, tolerance)]
        full_s, points = min(ever, default=(math.inf, ()))
        return (points, full_s) if math.isfinite(full_s) else ((), math.inf)

    def require_possible(self, time_limit_s: float | None, waiting: Waiting = None) -> None:
        """Check that the limit is not earlier than any design can be.

        Raises:
            MissionError: It is; the message says how late at least, and what the smallest design needs.
        """
        least_s = self.needs.soonest_s()
        if least_s <= self.limit_s:
            return
        smallest = solve_exact(self.problem, time_limit_s, waiting).points
        bound = (
            f"no design's map can be on Earth before {_hours_up(least_s)} h, with every cell at its smallest and the best rate"
            if math.isfinite(least_s)
            else "Earth hears the radio link.earth at no rate from there"
        )
        raise MissionError(f"{self._key}: {bound}; {self._what_would_do(smallest)}")

    def solve(self, time_limit_s: float, evolved: Ints | None = None, waiting: Waiting = None) -> ExactResult:
        """The fewest spacecraft that cover the target and are in time.

        Args:
            time_limit_s: When to stop without proof [s].
            evolved: A design that may be in time; None: none is known.
            waiting: Called now and then with the seconds that have passed.

        Raises:
            MissionError: No design is in time; or none was found, which is said.
        """
        start = time.perf_counter()
        reduced = reduce_problem(self.problem, np.ones(self.problem.n_points), all_points=True)
        best = evolved if evolved is not None and self.meets(evolved) else None
        found: ExactResult | None = solve_exact(self.problem, time_limit_s, _since(waiting, start))
        assert found is not None
        smallest = found.points
        while True:
            if found is None:
                return self._exhausted(best, smallest, start)
            spent = time.perf_counter() - start
            if best is not None and len(best) <= found.bound:
                return self._result(best, found.bound, "optimal", spent)
            if not self._excluded(found.points) and self._is_in_time(found.points):
                status = found.status if self._all_proven else "time limit"
                return found._replace(status=status, seconds=time.perf_counter() - start)
            self._cut(found.points)
            spent = time.perf_counter() - start
            if waiting is not None:
                waiting(min(spent, time_limit_s))
            if spent >= time_limit_s:
                if best is None:
                    raise MissionError(self._out_of_time(found.bound, smallest, time_limit_s))
                return self._result(best, found.bound, "time limit", spent)
            found = solve_cut(self.problem, reduced, self.cuts, time_limit_s - spent, _since(waiting, start))

    def _is_in_time(self, points: Ints) -> bool:
        if self.needs.soonest_s(points) > self.limit_s:
            self.unflown += 1
            return False
        self.arrival(points)
        return self.meets(points)

    def _excluded(self, points: Ints) -> bool:
        """Whether a cut excludes a design: HiGHS had no time for a better one, or kept it within its accuracy only."""
        visits = np.bincount(points - 1, minlength=self.problem.n_points)
        return any(cut.factor @ visits < cut.least - 1e-6 for cut in self.cuts)

    def _cut(self, points: Ints) -> None:
        """Exclude a late design, and what is late for the same reason."""
        chosen = np.zeros(self.problem.n_points, np.bool_)
        chosen[points - 1] = True
        self.cuts.append(Cut(np.where(chosen, -1.0, 1.0), 1.0 - len(points)))
        needs, held, start_s = self.needs, self.needs.held(points), self.needs.starts_s(points)
        room = needs.room_bit(self.limit_s, start_s)
        surplus = needs.sent_at_least(held) - room
        if surplus > LEAST_SURPLUS * (abs(room) + 1.0):
            gain = np.maximum(held - needs.bit, 0.0).sum(axis=1)
            gain += needs.rate_bit_s * np.maximum(start_s - needs.start_s, 0.0)
            # A factor above the limit is the limit: one such point is enough.
            self.cuts.append(Cut(np.minimum(gain / surplus, 1.0), 1.0))

    def _result(self, points: Ints, bound: float, status: str, seconds: float) -> ExactResult:
        return ExactResult(len(points), points, self.problem.covered_percent(points), bound, status, seconds)

    def _exhausted(self, best: Ints | None, smallest: Ints, start: float) -> ExactResult:
        """All of at most `max_observers` are excluded, but for the one that is known."""
        if best is not None:
            status = "optimal" if self._all_proven else "time limit"
            return self._result(best, float(len(best)), status, time.perf_counter() - start)
        most, late = self.problem.max_observers, "late" if self._all_proven else "late (not proven)"
        raise MissionError(
            f"{self._key}: no design of at most designer.max_observers = {most} has its map on Earth by then: "
            f"{len(self.arrivals)} were flown and are {late}, all others are excluded; {self._what_would_do(smallest)}"
        )

    def _out_of_time(self, bound: float, smallest: Ints, time_limit_s: float) -> str:
        return (
            f"{self._key}: no design in time was found in designer.time_limit_s = {time_limit_s:g}, nor is it proven that "
            f"there is none (at least {bound:g} observers; {len(self.arrivals)} designs were flown): allow more time; "
            f"{self._what_would_do(smallest)}"
        )

    @property
    def _key(self) -> str:
        return f"designer.deliver_within_h = {self.limit_s / HOUR:.6g}"

    def _what_would_do(self, smallest: Ints) -> str:
        if not self.soonest[0]:
            self.arrival(smallest)
        points, full_s = self.soonest
        if not points:
            return (
                "none of the designs flown has its map on Earth at all: lengthen data.horizon_s, or choose other radios or "
                "stations (link.crosslink, link.earth, link.ground)"
            )
        names = ", ".join(map(str, points))
        return (
            f"{_hours_up(full_s)} h are enough for the {len(points)} at points {names}; or choose a faster radio (link.earth) "
            "or more data.compression"
        )


def _hours_up(seconds: float) -> str:
    """Hours, rounded up so that they are enough."""
    return f"{math.ceil(seconds / HOUR * 1e4 - 1e-6) / 1e4:g}"


def _since(waiting: Waiting, start: float) -> Waiting:
    """Tells the seconds since the start of all programs, not of one."""
    return None if waiting is None else lambda _: waiting(time.perf_counter() - start)
