"""Who sees what: the matrix that the designer's problem is made of, by the scenario's reading of the observation criterion.

Candidates need not be judged (`Thinning`) whose reach (`observation.reach`) lies within what `fold` others see, who are judged,
kept and no dearer. In a design that uses one either one of those is free and does as well, or all are taken and it was not
needed. So neither the fewest spacecraft nor the trade-off against their cost changes, however many are left out at once: who
stands in for them stays. It is step 4 of `exact.reduce_problem`, taken before the pictures instead of after.

Those that reach farthest are judged first, in waves that double, and only earlier waves stand in: who is left out depends
neither on the number of processes nor on what is kept on disk.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from itertools import count, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import kernel
from swarm_mj.designer.candidates.flights import CandidateFlights, Unreachable, b_plane_of
from swarm_mj.designer.candidates.kept_flights import flights_from, fly, keep, kept
from swarm_mj.designer.candidates.pictures import ImagingModel, Judge, Progress, Watcher
from swarm_mj.designer.problem import Words, is_subset, pack
from swarm_mj.flight.environment import load_body_shape
from swarm_mj.flight.observe import camera_from, tell_never_lit
from swarm_mj.flight.targets import target_from
from swarm_mj.io.cache import Arrays
from swarm_mj.io.workers import Runner
from swarm_mj.mission.deployment import tell_part
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.quality import Looks
from swarm_mj.scenarios.itinerary import all_targets
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_itinerary import Aim
from swarm_mj.typing import Array, Indices, Mask

#: Candidates in the first wave.
FIRST_WAVE = 16


class Thinning:
    """Whom to judge, wave by wave, and who need not be.

    Args:
        reach: What each candidate could see at most, shape (n, cells).
        sees: What each sees, shape (n, cells); to be filled in for the candidates of a wave before the next is asked for.
        fold: How many must stand in for one.
        cost: What each costs: nobody dearer stands in, shape (n,); None: cost does not matter.

    Attributes:
        stand_in: For each candidate that is left out so far who sees at least as much, both from 0.
    """

    def __init__(self, reach: Mask, sees: Mask, *, fold: int = 1, cost: Array | None = None) -> None:
        self.stand_in: dict[int, int] = {}
        self._reach, self._sees, self._fold = reach, sees, fold
        self._cost = np.zeros(len(reach)) if cost is None else np.asarray(cost, dtype=np.float64)

    def waves(self) -> Iterator[Indices]:
        """The candidates to judge, from 0."""
        left = np.argsort(-self._reach.sum(axis=1), kind="stable")
        size, stand_ins = FIRST_WAVE, np.zeros(len(left), np.int64)
        while len(left):
            wave, left = left[:size], left[size:]
            yield wave
            first = np.full(len(left), -1, np.int64)
            stand_ins[left] += count_stand_ins(
                pack(self._reach[left]), self._cost[left], pack(self._sees[wave]), self._cost[wave], first
            )
            enough = stand_ins[left] >= self._fold
            self.stand_in |= dict(zip(left[enough].tolist(), wave[first[enough]].tolist(), strict=True))
            left, size = left[~enough], 2 * size


@kernel
def count_stand_ins(reach: Words, cost: Array, sees: Words, their_cost: Array, first: Indices) -> Indices:
    """How many of m see all that each of n could see and cost no more, shape (n,); `first` gets the first of them, -1: none.

    `reach`, shape (n, words), and `sees`, shape (m, words), are packed; `cost` and `first` have shape (n,), `their_cost` (m,).
    """
    found = np.zeros(len(reach), np.int64)
    for j in range(len(reach)):
        for i in range(len(sees)):
            if their_cost[i] <= cost[j] and is_subset(reach[j], sees[i]):
                found[j] += 1
                if first[j] < 0:
                    first[j] = i
    return found


class Candidate(NamedTuple):
    """What a gene stands for.

    Attributes:
        point: Visiting point of its target, numbered from 1.
        target: Which target the point belongs to, from 0.
        altitude_m: Imaging altitude [m].
        time_of_flight_s: [s].
        release_s: Past the epoch [s].
        aim: Where it looks, see `design.aim`.
    """

    point: int
    target: int
    altitude_m: float
    time_of_flight_s: float
    release_s: float
    aim: Aim = "centre"


def observers_of(scenario: Scenario, chosen: Sequence[Candidate]) -> list[dict[str, Any]]:
    """Entries of `design.observers` that fly candidates; empty where their points alone do."""
    design = scenario.design
    common = 0, design.imaging_altitude_m, design.time_of_flight_s, design.release_s, design.aim
    if all(candidate[1:] == common for candidate in chosen):
        return []
    return [
        {
            "target": candidate.target,
            "visiting_point": candidate.point,
            "imaging_altitude_m": candidate.altitude_m,
            "time_of_flight_s": candidate.time_of_flight_s,
            "release_s": candidate.release_s,
            "aim": candidate.aim,
        }
        for candidate in chosen
    ]


@dataclass(frozen=True, kw_only=True)
class Visibility:
    """What every candidate sees.

    Attributes:
        candidates: Meaning of each row, shape (n,).
        sees: Whether a candidate sees a cell, shape (n, cells).
        area: Of each cell of all targets, times its weight [m^2], shape (cells,); where targets overlap, a cell is there once.
        delta_v: Deployment speed of each candidate [m/s], shape (n,).
        beyond: Whether that is more than the deployer can give, shape (n,).
        point_A: Where each candidate passes at its time of flight, in A [m], shape (n, 3).
        b_plane: B.T and B.R [m] and the speed on the asymptote [m/s] of each candidate's path, see `b_plane_of`, shape (n, 3).
        region: All targets in one; its `targets` are each of them.
        left_out: What the designer might have chosen but nobody can fly to, and why.
        unjudged: Candidates whose pictures were not judged because of an interruption; they count as seeing nothing.
        why: `Cause` why each cell is seen by no candidate, shape (cells,).
        looks: Their looks, kept where `designer.quality_class` asks for them; takers are rows. All candidates are then judged.
        flights: Their flights, kept where `designer.deliver_within_h` asks for them.
        thinned: Candidates whose pictures were not judged because another one sees all that they could see at most (of several,
            the first), and that other one; they are not among `candidates`.
        resumed: What was kept from before, in words; empty: nothing.
        too_little: How many could see so little that no design of as few as are of use has them; they are not among
            `candidates`.
    """

    candidates: list[Candidate]
    sees: Mask
    area: Array
    delta_v: Array
    beyond: Mask
    point_A: Array
    b_plane: Array
    region: TargetRegion
    left_out: list[tuple[Candidate, str]] = field(default_factory=list)
    why: NDArray[np.int8] = field(default_factory=lambda: np.empty(0, np.int8))
    unjudged: int = 0
    thinned: list[tuple[Candidate, Candidate]] = field(default_factory=list)
    flights: list[CandidateFlights] = field(default_factory=list)
    resumed: str = ""
    too_little: int = 0
    looks: Looks | None = None


def visibility(
    scenario: Scenario,
    *,
    workers: int | Runner | None = None,
    progress: Progress | None = None,
    flying: Progress | None = None,
    costs: bool = False,
    reached: Reached | None = None,
) -> Visibility:
    """Fly every candidate and judge its pictures.

    From `designer.thin_from` candidates on those are left out that see no more than others, as far as that is known beforehand,
    see `Thinning`; not where `deliver_within_h`, `probability` or `quality_class` of the designer asks for more than that.

    Args:
        scenario: Says what counts as observed, and with `designer` which altitudes, times and targets there are.
        workers: Processes for the pictures; default: one per core. Or who runs flights and pictures elsewhere.
        progress: Called with the share of the pictures done, 0 to 1.
        flying: Called with the share of the flights done, 0 to 1.
        costs: Whether a candidate of more delta-v may not stand in for one of less; one beyond the deployer never does for one
            that it can release.
        reached: Given what each candidate could see at most if the body hid nothing, shape (n, cells), and the targets, before
            pictures are judged; what it raises is raised. It says which candidates are of use, shape (n,); the others' pictures
            are not judged, but where `deliver_within_h`, `probability` or `quality_class` is asked for, or some are thinned.

    Returns:
        What they see. Where an interruption (KeyboardInterrupt) comes after the first candidates are judged: what these see,
        and `unjudged` says how many are not.

    Raises:
        SwarmError: No candidate can be flown.
    """
    region = target_from(scenario, load_body_shape(scenario.body))
    flown, left_out, resumed = _fly(target_variants(scenario), flying, workers)
    candidates = [_candidate(variant, target, point) for target, variant, f in flown for point in f.points]
    delta_v = np.concatenate([flights.delta_v for _, _, flights in flown])
    beyond = np.concatenate([flights.beyond for _, _, flights in flown])
    found = _Sightings(len(candidates), region, progress)
    try:
        _judge(scenario, flown, found, workers, delta_v if costs else beyond.astype(np.float64), reached)
    except KeyboardInterrupt:
        if not found.judged.any():
            raise
    kept = found.kept
    return Visibility(
        candidates=[candidates[j] for j in kept],
        sees=found.sees[kept],
        area=region.weighted_area,
        delta_v=delta_v[kept],
        beyond=beyond[kept],
        point_A=np.concatenate([flights.plan.points_A for _, _, flights in flown])[kept],
        b_plane=np.concatenate([b_plane_of(flights) for _, _, flights in flown])[kept],
        region=region,
        left_out=left_out,
        why=found.why,
        unjudged=int((~found.judged[kept]).sum()),
        thinned=[(candidates[j], candidates[i]) for j, i in sorted(found.stand_in.items())],
        flights=[] if scenario.designer.deliver_within_h is None else [flights for _, _, flights in flown],
        resumed=_in_words(resumed, (found.pictures_kept, int(found.judged.sum()))),
        too_little=len(found.too_little),
        looks=found.looks,
    )


Flown = list[tuple[int, Scenario, CandidateFlights]]
#: Who is of use, shape (n,), of those who could see so much at most, shape (n, cells), of targets.
Reached = Callable[[Mask, TargetRegion], Mask]


def _candidate(variant: Scenario, target: int, point: int) -> Candidate:
    design = variant.design
    return Candidate(point, target, design.imaging_altitude_m, design.time_of_flight_s, design.release_s, design.aim)


def _fly(
    variants: list[Scenario], flying: Progress | None, workers: int | Runner | None
) -> tuple[Flown, list[tuple[Candidate, str]], tuple[int, int]]:
    """Fly to every target at every altitude, in every time and from every release; what is left out; how many were kept."""
    asked = [(target, chosen) for target, variant in enumerate(variants) for chosen in flight_variants(variant)]
    known = {k: arrays for k, (_, variant) in enumerate(asked) if (arrays := kept(variant)) is not None}
    n_kept, missing = len(known), {k: variant for k, (_, variant) in enumerate(asked) if k not in known}
    for k, arrays in _flown(missing, len(asked), flying, workers):
        keep(missing[k], arrays)
        known[k] = arrays
    flown: Flown = []
    left_out: list[tuple[Candidate, str]] = []
    failures = []
    for k, (target, variant) in enumerate(asked):
        try:
            flights = flights_from(variant, known.pop(k))
        except Unreachable as error:
            failures.append(error)
            left_out += [(_candidate(variant, target, point), why) for point, why in error.left_out.items()]
            continue
        flown.append((target, variant, flights))
        left_out += [(_candidate(variant, target, point), why) for point, why in flights.left_out.items()]
    if not flown:
        raise failures[0]
    return flown, left_out, (n_kept, len(asked))


def _flown(
    missing: dict[int, Scenario], of: int, flying: Progress | None, workers: int | Runner | None
) -> Iterator[tuple[int, Arrays]]:
    """Fly what is missing of so many sets of candidates, here or elsewhere."""
    tell = flying or (lambda share: None)
    done = of - len(missing)
    tell(done / of)
    if callable(workers):
        jobs = {k: (variant,) for k, variant in missing.items()}
        for k, arrays in workers(jobs.items(), _fly_one, setup=tuple):
            done += 1
            tell(done / of)
            yield k, arrays
        return
    for number, (k, variant) in enumerate(missing.items(), done):
        yield k, fly(variant, None if flying is None else partial(tell_part, flying, number, of))


def _fly_one(_: object, variant: Scenario) -> Arrays:
    return fly(variant)


def _in_words(flights: tuple[int, int], pictures: tuple[int, int]) -> str:
    """What was kept, of how many sets of candidates and candidates."""
    if not flights[0] and not pictures[0]:
        return ""
    return (
        f"kept from before: the flights of {flights[0]} of {flights[1]} sets of candidates, the pictures of {pictures[0]} of "
        f"{pictures[1]} candidates"
    )


class _Sightings:
    """What is filled while candidates are judged: who sees what, who is judged, and who need not be."""

    def __init__(self, n: int, region: TargetRegion, progress: Progress | None) -> None:
        self.region, self.progress = region, progress
        self.sees = np.zeros((n, region.n_cells), np.bool_)
        self.why = np.zeros(region.n_cells, np.int8)
        self.judged = np.zeros(n, np.bool_)
        self.stand_in: dict[int, int] = {}
        self.too_little = np.empty(0, np.intp)
        self.pictures_kept = 0
        self.looks: Looks | None = None

    @property
    def kept(self) -> Indices:
        """The candidates that are not left out."""
        return np.delete(np.arange(len(self.judged)), [*self.stand_in, *self.too_little])

    def judge(self, judge: Judge, watchers: Sequence[Watcher], wave: Indices) -> None:
        """Judge the candidates of a wave, row by row, as they are done."""
        before, first = int(self.judged.sum()) + len(self.stand_in) + len(self.too_little), count()

        def tell(done: float) -> None:
            if next(first) == 0:  # called once for all that are kept
                self.pictures_kept += int(done)
            self.tell(before, done)

        for j, row in judge.seen([watchers[j] for j in wave], progress=tell):
            self.sees[wave[j]] = row
            self.judged[wave[j]] = True

    def tell_never_lit(self, judge: Judge, flights: Sequence[CandidateFlights]) -> None:
        """Tell of cells that are lit at no time of pictures."""
        if judge.criterion.needs_sun:
            times = np.unique(np.concatenate([each.times[each.counts] for each in flights]))
            tell_never_lit(self.why, judge.observer, judge.criterion, flights[0].plan.environment, times)

    def tell(self, before: int, done: float) -> None:
        """Tell how much is done: so many candidates before, and some now."""
        if self.progress is not None:
            self.progress((before + done) / len(self.judged))


def _judge(
    scenario: Scenario,
    flown: Flown,
    found: _Sightings,
    workers: int | Runner | None,
    cost: Array,
    reached: Reached | None,
) -> None:
    """Judge all candidates, or with many all that need be."""
    watchers = [Watcher(flights, j) for _, _, flights in flown for j in range(flights.n)]
    designer = scenario.designer
    with closing(Judge(found.region, imaging_model_from(scenario), scenario.observation, workers)) as judge:
        found.why = judge.why  # filled in as it judges
        if (quality_class := scenario.designed_class) is not None:
            judge.keep_looks(scenario, quality_class)
        asked = (designer.deliver_within_h, designer.probability, quality_class)
        all_count = any(one is not None for one in asked)
        thinned = len(watchers) >= designer.thin_from and not all_count
        try:
            if thinned or reached is not None:
                found.tell(0, 0.0)  # the flights are done
                reach = np.stack([judge.could_see(watcher) for watcher in watchers])
                if reached is not None:
                    of_use = reached(reach, found.region)
                    if not (thinned or all_count):
                        found.too_little = np.flatnonzero(~of_use)
            if not thinned:
                found.judge(judge, watchers, np.delete(np.arange(len(watchers)), found.too_little))
            else:
                thinning = Thinning(reach, found.sees, fold=designer.fold, cost=cost)
                found.stand_in = thinning.stand_in
                for wave in thinning.waves():
                    found.judge(judge, watchers, wave)
        finally:
            found.looks = judge.looks
        found.tell_never_lit(judge, [flights for _, _, flights in flown])
        found.tell(len(watchers), 0.0)


def target_variants(scenario: Scenario) -> list[Scenario]:
    """The scenario with each of its targets."""
    alone = scenario.designer.model_copy(update={"extra_targets": ()})
    return [scenario.model_copy(update={"target": target, "designer": alone}) for target in all_targets(scenario)]


def flight_variants(scenario: Scenario) -> list[Scenario]:
    """The scenario with each of the altitudes, times of flight, releases and aims that the designer may choose from."""
    design, designer = scenario.design, scenario.designer
    choices = {
        "design.imaging_altitude_m": designer.altitudes_m or (design.imaging_altitude_m,),
        "design.time_of_flight_s": designer.times_of_flight_s or (design.time_of_flight_s,),
        "design.release_s": designer.releases_s or (design.release_s,),
        "design.aim": designer.aims or (design.aim,),
    }
    # Read again, so that a value that does not fit is refused like one in the file.
    variants = [
        load_scenario(scenario, dict(zip(choices, chosen, strict=True))) for chosen in product(*choices.values())
    ]
    return variants if designer.fold == 1 and designer.probability is None else _apart(variants)


def _apart(variants: list[Scenario]) -> list[Scenario]:
    """Those that are the longest of all that arrive at one altitude at one time: two of them would collide at their points."""
    longest: dict[tuple[float, float], Scenario] = {}
    for variant in sorted(variants, key=lambda v: v.design.time_of_flight_s):
        design = variant.design
        longest[design.imaging_altitude_m, design.release_s + design.time_of_flight_s] = variant
    return [variant for variant in variants if variant in longest.values()]


def imaging_model_from(scenario: Scenario) -> ImagingModel:
    """The camera with which candidates are judged; any rotation of a square sees what its inscribed cone sees."""
    camera = camera_from(scenario)
    if scenario.designer.any_roll:
        camera = camera.inscribed_cone
    observation = scenario.observation
    return ImagingModel(
        camera=camera,
        kind=observation.observer,
        occlusion=observation.occlusion,
        whole=scenario.observation.whole,
    )
