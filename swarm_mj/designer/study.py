"""The automated swarm designer: the fewest spacecraft that see the whole target, by evolution and with proof.

AAS 19-144, equations 3 to 6, on the candidates of a scenario. The genetic algorithm and the exact solver work on the same
matrix; the first shows what the paper did, the second what the minimum is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarm_mj.designer.candidates.visibility import Candidate, Visibility, observers_of, visibility
from swarm_mj.designer.class_problem import class_problem
from swarm_mj.designer.daylight import daylight_text
from swarm_mj.designer.deadline import HOUR, Arrival, DeadlineSearch, fly_design, needs_of
from swarm_mj.designer.exact import ExactResult, Waiting, solve_budget, solve_exact, without_proof
from swarm_mj.designer.problem import CoverProblem, DesignProblem
from swarm_mj.designer.robust import Level, RobustSearch, losses_of, robust_search
from swarm_mj.errors import MissionError, ScenarioError, TooFewObserversError
from swarm_mj.io.interruption import held
from swarm_mj.io.workers import Runner
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.coverage import Cause
from swarm_mj.scenarios.itinerary import target_name
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import ExtraTarget, Scenario, Target
from swarm_mj.typing import Ints, Mask

if TYPE_CHECKING:  # they load pymoo, which a study that is read back does not need
    from swarm_mj.designer.genetic import GeneticResult, Operators
    from swarm_mj.designer.pareto import ParetoFront

Stage = Callable[[str], None]
#: Told the name of a stage and the share of it that is done, 0 to 1.
Tell = Callable[[str, float], None]

#: Of the two sets of operators: repaired and pruned designs, and plain crossover and mutation as in the paper.
OPERATORS = ("repair", "plain")
#: Share of the time limit after which what candidates could see at most is not asked about any longer.
REACH_SHARE = 0.1
#: Probabilities whose cost in spacecraft is told beside that of the scenario.
CERTAINTIES = (0.5, 0.9, 0.95, 0.99)


class Verified(NamedTuple):
    """A campaign of a design: how many flights there were, how many of them failed, and how many saw enough of the target.

    Attributes:
        low: From where Wilson's 95 % interval of the share that saw enough reaches.
        high: To where.
        promised: The probability that the design was made with.
    """

    flights: int
    failed: int
    covered: int
    low: float
    high: float
    promised: float

    @property
    def inside(self) -> bool:
        """Whether the promise lies inside the interval."""
        return self.low <= self.promised <= self.high


#: What `extensions` asks for, mostly as shares of the scenario's own values: for `eros-config1` the rows that stand in
#: docs/results/reproduction.md, 10, 14 and 18 km, 480, 600 and 720 s, and one more target of 15 deg at longitude 60.
ALTITUDE_SHARES, FLIGHT_SHARES = (10 / 14, 1.0, 18 / 14), (0.8, 1.0, 1.2)
TARGET_SHARE, TARGET_EAST_DEG, MAX_INCIDENCE_DEG = 0.75, -30.0, 70.0


@dataclass(frozen=True, kw_only=True)
class Study:
    """A design problem and its answers.

    Attributes:
        scenario: What was asked for.
        visibility: Who sees what.
        problem: The matrix as a covering problem.
        exact: The proven minimum.
        genetic: Result of the genetic algorithm by set of operators.
        front: Designs that trade spacecraft, delta-v and area; None if not asked for.
        wall_s: Seconds by stage.
        interrupted: The stage in which an interruption came, after which nothing more was tried; empty: none came.
        deadline: When designs are on Earth, and what that excludes; None where `designer.deliver_within_h` asks for nothing.
        nominal: The proven minimum without losses and dispersions, where `designer.probability` is given.
        certainty: The fewest spacecraft for several probabilities, that of the scenario first; empty where none is given. The
            first has no points where an interruption came before any: then `exact` is the minimum without losses.
        verified: Flights of the design with other seeds; None: none were flown.
    """

    scenario: Scenario
    visibility: Visibility
    problem: DesignProblem
    exact: ExactResult
    genetic: dict[str, GeneticResult]
    front: ParetoFront | None
    wall_s: dict[str, float]
    interrupted: str = ""
    deadline: DeadlineSearch | None = None
    nominal: ExactResult | None = None
    certainty: Sequence[Level] = ()
    verified: Verified | None = None

    @property
    def selected(self) -> Ints:
        """The design to fly, as gene numbers from 1: the genetic algorithm's where as small as the proof's, and in time."""
        evolved = self.genetic.get("repair")
        as_small = evolved is not None and evolved.feasible and evolved.n_observers <= self.exact.n_observers
        return evolved.points if evolved is not None and as_small and self._may_fly(evolved) else self.exact.points

    def _may_fly(self, evolved: GeneticResult) -> bool:
        """Whether nothing proven is preferred to an evolved design that is as small."""
        beyond = [int(self.problem.avoided[points - 1].sum()) for points in (evolved.points, self.exact.points)]
        late = self.in_time(evolved.points) is False
        return self.exact.status == "interrupted" or not (late or beyond[0] > beyond[1])

    def in_time(self, points: Ints) -> bool | None:
        """Whether a design is on Earth in time; None where that is not asked for, or not known."""
        if self.deadline is None or self.deadline.known(points) is None:
            return None
        return self.deadline.meets(points)

    @property
    def selected_by(self) -> str:
        """Which of the two found the design to fly."""
        evolved = self.genetic.get("repair")
        if evolved is not None and self.selected is evolved.points:
            return "genetic algorithm"
        unproven = self.exact.status == "interrupted" and self.nominal is None
        return "greedy choice" if unproven else "exact solver"

    @property
    def observers(self) -> list[dict[str, Any]]:
        """Entries of `design.observers` that fly the design; empty where its points alone do."""
        return observers_of(self.scenario, [self.visibility.candidates[p - 1] for p in self.selected])

    @property
    def gap(self) -> int | None:
        """How many spacecraft the genetic algorithm's design has more than the proven minimum.

        -1 if it covers too little; None where there is no such design, or nothing proven to compare it with, and where its map
        is not on Earth in time.
        """
        evolved = self.genetic.get("repair")
        late = evolved is not None and self.in_time(evolved.points) is False
        if evolved is None or late or self.exact.status != "optimal":
            return None
        return evolved.n_observers - self.exact.n_observers if evolved.feasible else -1


def cover_problem(scenario: Scenario, seen: Visibility) -> DesignProblem:
    """The scenario's covering problem on a matrix of visibility, or on the looks where it asks for a quality class."""
    designer, quality_class = scenario.designer, scenario.designed_class
    if quality_class is not None:
        assert seen.looks is not None
        return class_problem(
            quality_class,
            seen.looks,
            len(seen.candidates),
            seen.area,
            avoided=seen.beyond,
            why=seen.why,
            tolerance_percent=designer.tolerance_percent,
            max_observers=designer.max_observers,
        )
    return CoverProblem(
        sees=seen.sees,
        area=seen.area,
        avoided=seen.beyond,
        why=seen.why,
        tolerance_percent=designer.tolerance_percent,
        max_observers=designer.max_observers,
        fold=designer.fold,
    )


def study_design(
    scenario: Scenario,
    *,
    pareto: bool = False,
    workers: int | Runner | None = None,
    tell: Tell | None = None,
    at_most: int | None = None,
) -> Study:
    """Solve a scenario's design problem both ways.

    Args:
        scenario: The problem; `designer` and `observation` say how it is read.
        pareto: Whether to trade spacecraft against delta-v and area too.
        workers: See `visibility`.
        tell: Told how far each stage is.
        at_most: Designs of more spacecraft than these are of no use; None: `designer.max_observers`. Where it takes more even
            of what candidates could see at most, if the body hid nothing, that is told before their pictures are judged;
            otherwise those that no such design can have are left out, and evolution by plain operators, which adds nothing.

    Returns:
        The answers. Where an interruption (KeyboardInterrupt) comes when a design can already be had, the best one so far; its
        `interrupted` says so.

    Raises:
        MissionError: No design covers the target; the message says how much can be seen.
        TooFewObserversError: More spacecraft are needed.
        KeyboardInterrupt: An interruption came before there was any design.
    """
    reached = None
    if at_most is not None and at_most < scenario.designer.max_observers:
        scenario = load_scenario(scenario, {"designer.max_observers": at_most})
        reached = partial(_require_few, scenario)
    clock = _Clock(tell)
    if scenario.designer.probability is not None:
        losses_of(scenario)  # what cannot be priced is refused before anything is flown
    with clock.stage("candidates", "candidates' flights", "candidates' pictures") as (flying, judging):
        seen = visibility(scenario, workers=workers, progress=judging, flying=flying, costs=pareto, reached=reached)
    work = _Work(scenario, seen, cover_problem(scenario, seen), clock)
    if seen.unjudged:
        clock.interrupted = "candidates' pictures"
    else:
        try:
            work.solve(pareto, plain=reached is None)
        except KeyboardInterrupt:
            clock.interrupted = clock.name
        except MissionError as error:
            few = isinstance(error, TooFewObserversError) or not work.problem.can_be_covered
            if few and seen.too_little:  # with these there may be designs, but none of so few
                assert at_most is not None
                raise TooFewObserversError(f"no {at_most} spacecraft cover the target", at_most + 1) from None
            dark = np.isin(seen.why, (Cause.DARK, Cause.NEVER_LIT)).any() and not work.problem.can_be_covered
            if not dark or scenario.target.region == "lit":  # which moves with the epoch
                raise
            raise MissionError(f"{error}; {daylight_text(scenario, seen.region)}") from None
    return work.study()


def _require_few(scenario: Scenario, reach: Mask, region: TargetRegion) -> Mask:
    """Refuse what needs too many spacecraft even of what candidates could see at most.

    Returns:
        Who may be in a design of no more, shape (n,); of as many as are thinned, anybody.

    Raises:
        TooFewObserversError: It does.
    """
    designer = scenario.designer
    problem = CoverProblem(
        sees=reach,
        area=region.weighted_area,
        tolerance_percent=designer.tolerance_percent,
        max_observers=designer.max_observers,
        fold=designer.fold if scenario.designed_class is None else 1,
    )
    try:
        solve_exact(problem, REACH_SHARE * designer.time_limit_s)
    except TooFewObserversError:
        raise
    except MissionError:  # what pictures tell of that says why
        return np.ones(len(reach), np.bool_)
    return problem.of_use if len(reach) < designer.thin_from else np.ones(len(reach), np.bool_)


class _Work:
    """A study under way: what is known so far."""

    def __init__(self, scenario: Scenario, seen: Visibility, problem: DesignProblem, clock: _Clock) -> None:
        self.scenario, self.seen, self.problem, self.clock = scenario, seen, problem, clock
        self.exact: ExactResult | None = None
        self.genetic: dict[str, GeneticResult] = {}
        self.front: ParetoFront | None = None
        self.deadline = _deadline_search(scenario, seen, problem)
        self.nominal: ExactResult | None = None
        self.certainty: list[Level] = []
        self.search: RobustSearch | None = None

    def solve(self, pareto: bool, plain: bool) -> None:
        """All stages; evolution comes first, so that there is a good design when the proof takes long.

        Args:
            pareto: Whether to trade spacecraft against delta-v and area too.
            plain: Whether to evolve by plain operators too.
        """
        problem, limit = self.problem, self.scenario.designer.time_limit_s
        if self.deadline is not None:
            with self.clock.stage("least delivery", "least delivery"):
                self.deadline.require_possible(limit)
        robust = self.scenario.designer.probability is not None
        if not robust:  # evolution knows of no losses
            self.evolve("repair")
        with self.clock.stage("proof", f"proof, at most {limit:g} s") as (tell,):
            self.exact = self.prove(limit, _waiting(tell, limit))
        if robust:
            self.secure(limit)
        elif plain:
            self.evolve("plain")
        if pareto:
            from swarm_mj.designer.pareto import pareto_front

            with self.clock.stage("trade-off", "trade-off"):
                # The best coverage for each number of spacecraft, with proof, for evolution to start from.
                known = [solve_budget(problem, n).points for n in range(1, self.exact.n_observers + 1)]
                self.front = pareto_front(problem, self.seen.delta_v, known=known)

    def secure(self, limit: float) -> None:
        """The fewest spacecraft for the scenario's probability, and what others cost; the minimum so far is the nominal one.

        Raises:
            MissionError: No design keeps the scenario's probability, or none was found in time; the message says what is.
        """
        asked = self.scenario.designer.probability
        assert asked is not None and self.exact is not None
        self.nominal, self.exact = self.exact, None
        with self.clock.stage("dispersed flights", "dispersed flights of the candidates") as (flying,):
            search = self.search = robust_search(self.scenario, self.seen, flying)
        for p in dict.fromkeys((asked, *CERTAINTIES)):
            name = f"design for P = {p:g}, at most {limit:g} s"
            with self.clock.stage(f"P = {p:g}", name) as (tell,):
                level = search.fewest(p, limit, _waiting(tell, limit))
            self.certainty.append(level)
            if p == asked:
                if level.points is None:
                    raise MissionError(search.refusal(level, limit))
                self.exact = self._robust(level, "optimal" if level.proven else "time limit")

    def _robust(self, level: Level, status: str) -> ExactResult:
        """The answer for the scenario's probability in the words of the exact solver."""
        assert level.points is not None
        percent = self.problem.covered_percent(level.points)
        seconds = self.clock.wall_s[f"P = {level.asked:g}"]
        return ExactResult(len(level.points), level.points, percent, float(level.bound), status, seconds)

    def prove(self, limit: float, waiting: Waiting) -> ExactResult:
        """The proven minimum, on Earth in time where that is asked for."""
        if self.deadline is None:
            return solve_exact(self.problem, limit, waiting)
        return self.deadline.solve(limit, self.genetic["repair"].points, waiting)

    def evolve(self, operators: Operators) -> None:
        """One run of the genetic algorithm; and when its design is on Earth, where that matters."""
        from swarm_mj.designer.genetic import GeneticSettings, evolve

        name, given = f"evolution, {operators}", self.scenario.designer
        settings = GeneticSettings(
            operators=operators,
            population=given.population,
            max_generations=given.max_generations,
            patience=given.patience,
            seed=self.scenario.seed,
        )
        with self.clock.stage(name, name) as (tell,):
            found = self.genetic[operators] = evolve(self.problem, settings, tell)
            if self.deadline is not None and found.feasible:
                self.deadline.arrival(found.points)

    def study(self) -> Study:
        """The study as far as it came."""
        exact = self.exact
        if exact is None:
            with held():
                exact = self._best_so_far()
        return Study(
            scenario=self.scenario,
            visibility=self.seen,
            problem=self.problem,
            exact=exact,
            genetic={name: self.genetic[name] for name in OPERATORS if name in self.genetic},
            front=self.front,
            wall_s=self.clock.wall_s,
            interrupted=self.clock.interrupted,
            deadline=self.deadline,
            nominal=self.nominal,
            certainty=self.certainty,
        )

    def _best_so_far(self) -> ExactResult:
        asked = self.scenario.designer.probability
        if asked is not None:
            if not self.certainty:
                self.certainty.append(Level(asked, None, 1) if self.search is None else self.search.so_far(asked))
            if self.certainty[0].points is not None:
                return self._robust(self.certainty[0], "interrupted")
            if self.nominal is not None:
                return self.nominal._replace(status="interrupted")
        evolved = self.genetic.get("repair")
        try:
            return without_proof(self.problem, evolved.points if evolved is not None and evolved.feasible else None)
        except MissionError:
            raise KeyboardInterrupt from None


def _deadline_search(scenario: Scenario, seen: Visibility, problem: DesignProblem) -> DeadlineSearch | None:
    hours = scenario.designer.deliver_within_h
    if hours is None or not isinstance(problem, CoverProblem):
        return None

    def fly(points: Ints) -> Arrival:
        return fly_design(scenario, np.array([seen.candidates[p - 1].point for p in points]))

    needs = needs_of(scenario, seen.flights[0], seen.region, problem)
    return DeadlineSearch(problem=problem, needs=needs, limit_s=hours * HOUR, fly=fly)


def _waiting(tell: Callable[[float], None] | None, limit: float) -> Waiting:
    """Tells the share of a time limit [s] that is used up."""
    return None if tell is None else lambda seconds: tell(min(seconds / limit, 1.0))


class Growth(NamedTuple):
    """The proven minimum under one more demand or freedom.

    Attributes:
        change: What was changed, in words.
        n_observers: Proven minimum; None where the target cannot be covered.
        note: Why not, or what the design chose.
    """

    change: str
    n_observers: int | None
    note: str


def extensions(scenario: Scenario) -> dict[str, dict[str, Any]]:
    """Demands and freedoms beyond the paper by a few words, as overrides of the scenario: for Eros those of the pages."""
    design, designer, interval = scenario.design, scenario.designer, scenario.telemetry.interval_s
    altitudes = [float(f"{share * design.imaging_altitude_m:.3g}") for share in ALTITUDE_SHARES]
    times = [interval * round(share * design.time_of_flight_s / interval) for share in FLIGHT_SHARES]
    lasting = max(scenario.duration_s, max(designer.releases_s or (design.release_s,)) + max(times))
    incidence = min(MAX_INCIDENCE_DEG, scenario.observation.max_incidence_deg)
    light = {"observation.light": "sunlit", "observation.max_incidence_deg": incidence}
    more = _next_to(scenario.target)
    targets = [given.model_dump() for given in (*designer.extra_targets, more)]
    place = f"{more.latitude_deg:g} N, {more.longitude_deg:g} E, {more.half_angle_deg:g} deg"
    flights = {"designer.times_of_flight_s": times, "duration_s": lasting}
    return {
        "as asked": {},
        **{f"every face seen by {fold}": {"designer.fold": fold} for fold in (designer.fold + 1, designer.fold + 2)},
        f"incidence of sunlight at most {incidence:g} deg": light,
        **(
            {f"one more target at {place}": {"designer.extra_targets": targets}}
            if scenario.target.region == "pyramid"
            else {}
        ),
        f"altitude free among {_enumerated(altitudes, 1e3)} km": {"designer.altitudes_m": altitudes},
        f"time of flight free among {_enumerated(times)} s": flights,
    }


def _next_to(target: Target) -> ExtraTarget:
    """A smaller target on the same latitude."""
    return ExtraTarget(
        latitude_deg=target.latitude_deg,
        longitude_deg=(target.longitude_deg + TARGET_EAST_DEG + 180.0) % 360.0 - 180.0,
        half_angle_deg=TARGET_SHARE * target.half_angle_deg,
    )


def _enumerated(values: Sequence[float], unit: float = 1.0) -> str:
    words = [f"{value / unit:g}" for value in values]
    return f"{', '.join(words[:-1])} and {words[-1]}"


def growth(scenario: Scenario, *, workers: int | Runner | None = None, stage: Stage | None = None) -> list[Growth]:
    """The proven minimum under each of `extensions`, of seeing alone: when the map is on Earth is not asked."""
    rows = []
    scenario = load_scenario(scenario, {"designer.deliver_within_h": None, "designer.probability": None})
    for change, overrides in extensions(scenario).items():
        if stage is not None:
            stage(change)
        rows.append(_grown(change, scenario, overrides, workers))
    return rows


def _grown(change: str, scenario: Scenario, overrides: dict[str, Any], workers: int | Runner | None) -> Growth:
    try:
        scenario = load_scenario(scenario, overrides)
        seen = visibility(scenario, workers=workers)
        exact = solve_exact(cover_problem(scenario, seen), scenario.designer.time_limit_s)
    except (MissionError, ScenarioError) as error:
        return Growth(change, None, str(error))
    return Growth(change, exact.n_observers, ", ".join(describe(seen.candidates[p - 1], seen) for p in exact.points))


def describe(candidate: Candidate, seen: Visibility) -> str:
    """A candidate in a few words: its point, and what the designer was free to choose besides."""
    words = str(candidate.point)
    if seen.region.parts:
        words = f"{target_name(candidate.target)}{words}"
    if len({c.altitude_m for c in seen.candidates}) > 1:
        words += f" at {candidate.altitude_m / 1e3:g} km"
    if len({c.time_of_flight_s for c in seen.candidates}) > 1:
        words += f" in {candidate.time_of_flight_s:g} s"
    if len({c.release_s for c in seen.candidates}) > 1:
        words += f" released at {candidate.release_s:g} s"
    if len({c.aim for c in seen.candidates}) > 1:
        words += " looking at its point" if candidate.aim == "point" else " looking at the centre"
    return words


class _Clock:
    """Wall-clock seconds by stage, and who is told how far each is."""

    def __init__(self, tell: Tell | None) -> None:
        self.wall_s: dict[str, float] = {}
        self.name = self.interrupted = ""
        self._tell = tell

    @contextmanager
    def stage(self, name: str, *labels: str) -> Iterator[tuple[Callable[[float], None] | None, ...]]:
        """Time a stage, one that is interrupted too; gives for each label who is told the share of it that is done."""
        self.name, start, tell = name, time.perf_counter(), self._tell
        try:
            if tell is None:
                yield (None,) * len(labels)
            else:
                tell(labels[0], 0.0)
                yield tuple(partial(tell, label) for label in labels)
                tell(labels[-1], 1.0)
        finally:
            self.wall_s[name] = time.perf_counter() - start
