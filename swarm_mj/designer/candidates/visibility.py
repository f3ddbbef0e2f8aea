"""Who sees what: the matrix that the designer's problem is made of, by the scenario's reading of the observation criterion."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import product
from typing import NamedTuple

import numpy as np

from swarm_mj.designer.candidates.flights import CandidateFlights, Unreachable, fly_candidates
from swarm_mj.designer.candidates.pictures import ImagingModel, Progress, picture_numbers, shares_as_they_come
from swarm_mj.flight.observe import camera_from, criterion_from
from swarm_mj.flight.plan import load_body_shape, target_from
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.capture import ObservationCriterion, cells_that_count, lit_cells
from swarm_mj.observation.observer import Observer
from swarm_mj.scenarios.loading import scenario_from
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array, Ints, Mask


class Candidate(NamedTuple):
    """What a gene stands for.

    Attributes:
        point: Visiting point of its target, numbered from 1.
        target: Which target the point belongs to, from 0.
        altitude_m: Imaging altitude [m].
        time_of_flight_s: [s].
    """

    point: int
    target: int
    altitude_m: float
    time_of_flight_s: float


@dataclass(frozen=True, kw_only=True)
class Visibility:
    """What every candidate sees.

    Attributes:
        candidates: Meaning of each row, shape (n,).
        sees: Whether a candidate sees a cell, shape (n, cells).
        area: Of each cell, all targets one after another [m^2], shape (cells,).
        delta_v: Deployment speed of each candidate [m/s], shape (n,).
        point_A: Where each candidate passes at its time of flight, in A [m], shape (n, 3).
        regions: The targets.
        left_out: What the designer might have chosen but nobody can fly to, and why.
        unjudged: Candidates whose pictures were not judged because of an interruption; they count as seeing nothing.
    """

    candidates: list[Candidate]
    sees: Mask
    area: Array
    delta_v: Array
    point_A: Array
    regions: list[TargetRegion]
    left_out: list[tuple[Candidate, str]] = field(default_factory=list)
    unjudged: int = 0

    @property
    def n_target_faces(self) -> int:
        """Faces of F_T, all targets."""
        return sum(region.n_faces for region in self.regions)


def visibility(
    scenario: Scenario,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
    flying: Progress | None = None,
) -> Visibility:
    """Fly every candidate and judge its pictures.

    Args:
        scenario: Says what counts as observed, and with `designer` which altitudes, times and targets there are.
        workers: Processes; default: one per core.
        progress: Called with the share of the pictures done, 0 to 1.
        flying: Called with the share of the flights done, 0 to 1.

    Returns:
        What they see. Where an interruption (KeyboardInterrupt) comes after the first candidates are judged: what these see,
        and `unjudged` says how many are not.

    Raises:
        SwarmError: No candidate can be flown.
    """
    shape = load_body_shape(scenario.body)
    variants = target_variants(scenario)
    regions = [target_from(variant, shape) for variant in variants]
    flown, left_out = _fly(variants, flying)
    sees = [np.zeros((flights.n, sum(region.n_cells for region in regions)), np.bool_) for _, _, flights in flown]
    judged = [np.zeros(flights.n, np.int64) for _, _, flights in flown]
    try:
        _judge(flown, regions, imaging_model_from(scenario), _Sightings(sees, judged, workers, progress))
    except KeyboardInterrupt:
        if not any(count.any() for count in judged):
            raise
    return Visibility(
        candidates=[_candidate(variant, target, point) for target, variant, f in flown for point in f.points],
        sees=np.vstack(sees),
        area=np.concatenate([region.area for region in regions]),
        delta_v=np.concatenate([flights.delta_v for _, _, flights in flown]),
        point_A=np.concatenate([flights.plan.points_A for _, _, flights in flown]),
        regions=regions,
        left_out=left_out,
        unjudged=sum(int((count < len(regions)).sum()) for count in judged),
    )


Flown = list[tuple[int, Scenario, CandidateFlights]]


def _candidate(variant: Scenario, target: int, point: int) -> Candidate:
    return Candidate(point, target, variant.design.imaging_altitude_m, variant.design.time_of_flight_s)


def _fly(variants: list[Scenario], flying: Progress | None) -> tuple[Flown, list[tuple[Candidate, str]]]:
    """Fly to every target at every altitude and in every time; and what is left out.

    Raises:
        SwarmError: Nothing can be flown; or a scenario cannot be had.
    """
    asked = [(target, chosen) for target, variant in enumerate(variants) for chosen in flight_variants(variant)]
    flown: Flown = []
    left_out: list[tuple[Candidate, str]] = []
    failures = []
    for count, (target, variant) in enumerate(asked):
        tell = None if flying is None else partial(_tell_part, flying, count, len(asked))
        try:
            flights = fly_candidates(variant, tell)
        except Unreachable as error:
            failures.append(error)
            left_out += [(_candidate(variant, target, point), why) for point, why in error.left_out.items()]
            continue
        flown.append((target, variant, flights))
        left_out += [(_candidate(variant, target, point), why) for point, why in flights.left_out.items()]
    if not flown:
        raise failures[0]
    return flown, left_out


def _tell_part(progress: Progress, count: int, of: int, share: float) -> None:
    progress((count + share) / of)


class _Sightings(NamedTuple):
    """What is filled while candidates are judged: one array per flight, and for how many regions each row is done."""

    sees: list[Mask]
    judged: list[Ints]
    workers: int | None
    progress: Progress | None


def _judge(flown: Flown, regions: list[TargetRegion], imaging_model: ImagingModel, found: _Sightings) -> None:
    """Judge all candidates, row by row, as they are done."""
    steps = len(flown) * len(regions)
    for count, (_, variant, flights) in enumerate(flown):
        first = 0
        for k, region in enumerate(regions):
            step = count * len(regions) + k

            def report(done: float, step: int = step, n: int = flights.n) -> None:
                if found.progress is not None:
                    found.progress((step + done / n) / steps)

            rows = seen_rows(variant, flights, region, imaging_model, workers=found.workers, progress=report)
            for j, row in rows:
                found.sees[count][j, first : first + region.n_cells] = row
                found.judged[count][j] += 1
            first += region.n_cells


def target_variants(scenario: Scenario) -> list[Scenario]:
    """The scenario with each of its targets."""
    extra = [scenario.target.model_copy(update=target.model_dump()) for target in scenario.designer.extra_targets]
    return [scenario.model_copy(update={"target": target}) for target in (scenario.target, *extra)]


def flight_variants(scenario: Scenario) -> list[Scenario]:
    """The scenario with each of the altitudes and times of flight that the designer may choose from."""
    design, designer = scenario.design, scenario.designer
    altitudes = designer.altitudes_m or (design.imaging_altitude_m,)
    times = designer.times_of_flight_s or (design.time_of_flight_s,)
    return [
        # Read again, so that a value that does not fit is refused like one in the file.
        scenario_from(
            scenario.model_copy(
                update={"design": design.model_copy(update={"imaging_altitude_m": h, "time_of_flight_s": t})}
            ).model_dump(),
            f"{scenario.name} with the designer's choices",
        )
        for h, t in product(altitudes, times)
    ]


def imaging_model_from(scenario: Scenario) -> ImagingModel:
    """The camera with which candidates are judged; any rotation of a square sees what its inscribed cone sees."""
    camera = camera_from(scenario)
    if scenario.designer.any_roll:
        camera = replace(camera, shape="cone")
    observation = scenario.observation
    return ImagingModel(
        camera=camera,
        kind=observation.observer,
        occlusion=observation.occlusion,
        whole=criterion_from(scenario).whole,
    )


def seen_rows(
    scenario: Scenario,
    flights: CandidateFlights,
    region: TargetRegion,
    imaging_model: ImagingModel,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Iterator[tuple[int, Mask]]:
    """Whether a candidate sees each cell of a region by the scenario's criterion, one after the other as they are done.

    Yields:
        The candidate's number from 0, and what it sees, shape (cells,).
    """
    shares = shares_as_they_come(flights, region, imaging_model, at=flights.counts, workers=workers, progress=progress)
    criterion = criterion_from(scenario)
    with closing(imaging_model.open(region)) as observer, closing(shares):
        light = _light_by_time(flights, observer, criterion)
        for j, share in shares:
            seen = np.zeros(region.n_cells, dtype=np.bool_)
            for row, k in enumerate(picture_numbers(flights, j, flights.counts)):
                seen |= cells_that_count(
                    observer, criterion, flights.r_A[k, j], partial(light, int(k)), partial(share.__getitem__, row)
                )
            yield j, seen


def _light_by_time(
    flights: CandidateFlights, observer: Observer, criterion: ObservationCriterion
) -> Callable[[int], Mask]:
    """Gives which cells are lit at one of the flights' times, worked out once for all candidates."""
    environment = flights.plan.environment

    @cache
    def light(k: int) -> Mask:
        t = float(flights.times[k])
        return lit_cells(observer, criterion, environment.C_AN(t) @ environment.sun.at(t))

    return light
