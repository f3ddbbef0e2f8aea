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

Before any flight, data that no design can do without tell when a map cannot be on Earth (`Needs`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from swarm_mj.dataflow.ground import stations_from
from swarm_mj.dataflow.link_budget import rate_at, rate_table
from swarm_mj.dataflow.radios import radio_from
from swarm_mj.designer.candidates.flights import CandidateFlights, at_points
from swarm_mj.designer.exact import Cut, ExactResult, Waiting, solve_cut, solve_exact
from swarm_mj.designer.problem import CoverProblem
from swarm_mj.designer.reduction import reduce_problem
from swarm_mj.errors import MissionError
from swarm_mj.flight.downlink import MOST_LINKS, deliver, frame_pixels, slot_edges
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import camera_from, observe_flight
from swarm_mj.flight.plan import Plan, as_planned, make_plan
from swarm_mj.io import interruption
from swarm_mj.mission.behaviors import AdaptableRoles, DedicatedCommunications
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.capture import Limits, keeps_limits, limits_of, pixels_on, sight
from swarm_mj.scenarios.constants import SPEED_OF_LIGHT
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array, Ints, Mask

#: Farthest that a flight's pictures are taken from the candidate's [m]: a thousand times what flights miss their points by.
DRIFT_M = 1.0
#: Share of a tile that may be missing for the accuracy of the linear program.
WHOLE = 1.0 - 1e-6
#: Relative difference of times that are the same.
ROUNDING = 1e-12
#: Faster than Earth and any small body move relative to each other [m/s], and times at which their distance is looked at.
FASTEST, LOOKS = 1e5, 200
#: An hour [s].
HOUR = 3600.0
#: The surplus from which a cut is made, as a share of what can be sent: far above rounding.
LEAST_SURPLUS = 1e-9


class Arrival(NamedTuple):
    """When the map of a design is on Earth.

    Attributes:
        full_s: When the best schedule has all that was seen on Earth [s past the epoch]; infinity where none ever has.
        covered_percent: What was seen in flight, P_TO.
        proven: Whether no schedule of that flight is sooner.
    """

    full_s: float
    covered_percent: float
    proven: bool = True

    def meets(self, limit_s: float, tolerance_percent: float) -> bool:
        """Whether that is in time, and the flight saw the target within its tolerance."""
        return self.full_s <= limit_s and 100.0 - self.covered_percent <= tolerance_percent + 1e-9


def fly_design(scenario: Scenario, points: Ints) -> Arrival:
    """Fly a design without faults, judge its pictures and send them by the schedule that is proven best.

    Args:
        scenario: Whose design; its own visiting points are not read.
        points: Visiting points, numbered from 1, in the order of the spacecraft.
    """
    try:
        plan = make_plan(at_points(as_planned(scenario), [int(p) for p in points]))
    except MissionError:
        return Arrival(math.inf, 0.0)  # each point can be flown to, but these cannot together
    telemetry = simulate(plan)
    interruption.check()
    result = observe_flight(plan, telemetry)
    percent = result.coverage.percent
    interruption.check()
    delivery = deliver(plan, telemetry, result.kept)
    if delivery is None:
        return Arrival(math.inf, percent, proven=False)
    if np.isfinite(delivery.best_full_s):
        return Arrival(float(delivery.best_full_s), percent)
    # The best schedule is not known in time, or it alone brings all home: what the swarm runs alone is what can be promised.
    sure = bool((delivery.best_share < WHOLE).any())
    return Arrival(delivery.full_s if delivery.complete else math.inf, percent, proven=sure)


@dataclass(frozen=True, kw_only=True, eq=False)
class Needs:
    """What the candidates' pictures take up at least, and how fast it can be sent at most.

    No design S has its map on Earth before  min_{p in S} start_p + (sum_c min_{p in S} bit_pc - missed) / rate + light time,
    where missed is the most that the cells hold which the tolerance lets it miss.

    Attributes:
        problem: What to cover.
        bit: Least data of each cell in a picture of a candidate, infinity where none shows it, shape (n_points, n_faces).
        start_s: Before which no design sends to Earth, unless one of its other points allows it [s], shape (n_points,).
        light_time_s: Shortest of the window.
        rate_bit_s: Of all that Earth hears at once, at most.
        edges_s: Edges of the slots where those of all designs are the same; empty elsewhere. A map is complete at an edge.
    """

    problem: CoverProblem
    bit: Array
    start_s: Array
    light_time_s: float
    rate_bit_s: float
    edges_s: Array = field(default_factory=lambda: np.empty(0))

    @cached_property
    def largest(self) -> Array:
        """What a cell takes up at most where it must be taken from another candidate, shape (n_faces,)."""
        return np.where(np.isfinite(self.bit), self.bit, 0.0).max(axis=0)

    def held(self, points: Ints | None) -> Array:
        """Least data of each cell where these points, numbered from 1, and any others of `largest` are visited; None: all."""
        rows = self.bit if points is None else self.bit[np.asarray(points, np.int64) - 1]
        return np.minimum(rows.min(axis=0), self.largest)

    def starts_s(self, points: Ints | None) -> float:
        """Before which a design of these points, numbered from 1, sends nothing to Earth [s]; None: all."""
        return float((self.start_s if points is None else self.start_s[np.asarray(points, np.int64) - 1]).min())

    def sent_at_least(self, held: Array) -> float:
        """Least that must be sent of cells that hold so much [bit]: all but the dearest that the tolerance lets be missed."""
        weights = self.problem.weights
        dearest = np.argsort(-held / np.maximum(weights, 1))
        left = np.clip(self.problem.slack - (np.cumsum(weights[dearest]) - weights[dearest]), 0, None)
        share = np.minimum(left / np.maximum(weights[dearest], 1), 1.0)
        return float(held.sum() - share @ held[dearest])

    def soonest_s(self, points: Ints | None = None) -> float:
        """No design of some of these points has its map on Earth before [s past the epoch]; None: no design at all."""
        sent = self.sent_at_least(self.held(points))
        if sent > 0.0 and self.rate_bit_s <= 0.0:
            return math.inf
        last_s = self.starts_s(points) + (sent / self.rate_bit_s if sent > 0.0 else 0.0)
        later = self.edges_s[self.edges_s >= last_s * (1.0 - ROUNDING)]
        return self.light_time_s + (float(later[0]) if len(later) else last_s)

    def capacity_bit(self, limit_s: float, start_s: float) -> float:
        """What can be sent from a start until all must be on Earth, at most; negative where that is before the start."""
        end_s = limit_s - self.light_time_s
        before = self.edges_s[self.edges_s <= end_s * (1.0 + ROUNDING)]
        return self.rate_bit_s * ((float(before[-1]) if len(before) else end_s) - start_s)


def needs_of(scenario: Scenario, flights: CandidateFlights, region: TargetRegion, problem: CoverProblem) -> Needs:
    """The least data of a scenario's candidates, whose flights make the rows of the problem."""
    bit, first_s = _least_bits(scenario, flights, region)
    rate, light_time_s = _best_rate(scenario, flights.plan)
    return Needs(
        problem=problem,
        bit=bit,
        start_s=_starts_s(scenario, flights, first_s),
        light_time_s=light_time_s,
        rate_bit_s=rate,
        edges_s=_edges_s(scenario, first_s),
    )


def _least_bits(scenario: Scenario, flights: CandidateFlights, region: TargetRegion) -> tuple[Array, Array]:
    """Least data of each cell in each candidate's pictures, shape (n, cells), and when it takes the first [s], shape (n,)."""
    limits, data = limits_of(scenario.observation, camera_from(scenario), region), scenario.data
    # A window holds at least the pixels of its cells.
    frame_bit = frame_pixels(scenario) * data.sent_bits_per_pixel if data.product == "frame" else None
    bit, first_s = np.full((flights.n, region.n_cells), np.inf), np.full(flights.n, np.inf)
    for j in range(flights.n):
        interruption.check()
        for k in np.flatnonzero(flights.counts & _may_look(flights, j)):
            shown, least, most = _pixels(limits, region, flights.r_A[k, j])
            if not shown.any():
                continue
            per_pixel = data.sent_bits_per_pixel if frame_bit is None else frame_bit / most[shown].sum()
            bit[j, shown] = np.minimum(bit[j, shown], per_pixel * least[shown])
            first_s[j] = min(first_s[j], float(flights.times[k]))
    return bit, first_s


def _starts_s(scenario: Scenario, flights: CandidateFlights, first_s: Array) -> Array:
    """Before which a candidate's presence lets nothing be sent to Earth [s], shape (n,).

    A dedicated relay takes no pictures: data must come to it in a slot before. Spacecraft of adaptable roles turn to Earth when
    they have left the imaging region.
    """
    behavior, first = flights.plan.behavior, float(first_s.min())
    if isinstance(behavior, DedicatedCommunications):
        # Once the flight is over, others may speak to Earth.
        return np.minimum(first_s + scenario.data.slot_s, np.maximum(first_s, scenario.duration_s))
    if not isinstance(behavior, AdaptableRoles) or not math.isfinite(first):
        return np.full(flights.n, first)
    leaves = np.array([_leaves_s(flights, j, first, behavior.imaging_radius_m) for j in range(flights.n)])
    return np.maximum(leaves - scenario.telemetry.interval_s, first)


def _leaves_s(flights: CandidateFlights, j: int, first: float, radius: float) -> float:
    """Until when a candidate is inside a radius from a time on [s], at least.

    The square of the distance has the second derivative 2 (v^2 + r . a). Where that is positive, the square lies below its
    chord between two times.
    """
    k = int(np.searchsorted(flights.times, first))
    times, r_A, environment = flights.times[k:], flights.r_A[k:, j], flights.plan.environment
    inside = times[0]
    for i in range(len(times) - 1):
        low, high = (float(r @ r) for r in r_A[i : i + 2])
        r_N = np.stack([environment.C_AN(t).T @ r for t, r in zip(times[i : i + 2], r_A[i : i + 2], strict=True)])
        speed = np.linalg.norm(r_N[1] - r_N[0]) / (times[i + 1] - times[i])
        pull = np.linalg.norm(environment.acceleration_N(float(times[i]), r_N), axis=1).max()
        square = (radius - DRIFT_M) ** 2
        if low >= square or speed**2 < 4.0 * pull * math.sqrt(max(low, high)):
            break
        share = 1.0 if high <= square else (square - low) / (high - low)
        inside = times[i] + share * (times[i + 1] - times[i])
        if share < 1.0:
            break
    return float(inside)


def _edges_s(scenario: Scenario, first_s: Array) -> Array:
    """Edges of the slots of all designs, where all take the same one qualifying image; elsewhere none."""
    if scenario.observation.criterion != "arrival" or not np.isfinite(first_s).any():
        return np.empty(0)
    ready_s = np.array([first_s.min()])
    few, many = (slot_edges(scenario, ready_s, MOST_LINKS // n**2) for n in (1, scenario.designer.max_observers + 1))
    return few if np.array_equal(few, many) else np.empty(0)


def _may_look(flights: CandidateFlights, j: int) -> Mask:
    """When a candidate may look at the body, whoever flies with it: the packaged behaviours decide by its own place alone."""
    if isinstance(flights.plan.behavior, DedicatedCommunications | AdaptableRoles):
        return flights.observing[:, j]
    return np.ones(len(flights.times), np.bool_)


def _pixels(limits: Limits, region: TargetRegion, r_A: Array) -> tuple[Mask, Array, Array]:
    """Cells that a picture may show within `DRIFT_M` of a place, and their pixels, at least and at most."""
    distance, height = sight(region, r_A)
    near, far = np.maximum(distance - DRIFT_M, DRIFT_M), distance + DRIFT_M
    shown = keeps_limits(limits, near, np.minimum(height + DRIFT_M, near))
    least = pixels_on(limits, region.area, far, np.maximum(height - DRIFT_M, 0.0))
    return shown, least, pixels_on(limits, region.area, near, np.minimum(height + DRIFT_M, near))


def _best_rate(scenario: Scenario, plan: Plan) -> tuple[float, float]:
    """Most that Earth can hear [bit/s], of any station, and the shortest light time of the window [s]."""
    link = scenario.link
    radio = radio_from(link.earth, "link.earth")
    times, step = np.linspace(0.0, scenario.duration_s + scenario.data.horizon_s, LOOKS, retstep=True)
    closest = min(float(np.linalg.norm(plan.environment.earth.at(t))) for t in times) - 0.5 * FASTEST * float(step)
    strayed = 2.0 * float(np.linalg.norm(plan.deployment.v0_N, axis=1).max()) * float(times[-1])
    rates = [
        rate_at(rate_table(radio, station.g_over_t_db_k), max(closest - strayed, 0.0))
        for station in stations_from(link.ground)
    ]
    return link.ground.channels * max(rates), closest / SPEED_OF_LIGHT


@dataclass(kw_only=True)
class DeadlineSearch:
    """A search under a deadline, and what is known so far.

    Attributes:
        problem: What to cover.
        needs: What designs must send at least.
        limit_s: When all must be on Earth [s past the epoch].
        fly: Tells when the map of a design is on Earth, by its points, numbered from 1.
        arrivals: What was flown, by points, numbered from 1.
        cuts: What is excluded.
        unflown: How many proposals were excluded by their data alone.
    """

    problem: CoverProblem
    needs: Needs
    limit_s: float
    fly: Callable[[Ints], Arrival]
    arrivals: dict[tuple[int, ...], Arrival] = field(default_factory=dict)
    cuts: list[Cut] = field(default_factory=list)
    unflown: int = 0

    def arrival(self, points: Ints) -> Arrival:
        """Of a design, which is flown once."""
        key = tuple(int(p) for p in points)
        if key not in self.arrivals:
            self.arrivals[key] = self.fly(points)
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

    def require_possible(self, time_limit_s: float) -> None:
        """Check that the limit is not earlier than any design can be.

        Raises:
            MissionError: It is; the message says how late at least, and what the smallest design needs.
        """
        least_s = self.needs.soonest_s()
        if least_s <= self.limit_s:
            return
        smallest = solve_exact(self.problem, time_limit_s).points
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
        reduced = reduce_problem(self.problem, all_points=True)
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
        capacity = needs.capacity_bit(self.limit_s, start_s)
        surplus = needs.sent_at_least(held) - capacity
        if surplus > LEAST_SURPLUS * (abs(capacity) + 1.0):
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
