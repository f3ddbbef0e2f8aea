"""Who sees what: the matrix that the designer's problem is made of, by the scenario's reading of the observation criterion."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from typing import NamedTuple

import numpy as np

from swarm_mj.designer.candidates.flights import CandidateFlights, fly_candidates
from swarm_mj.designer.candidates.pictures import ImagingModel, Progress, picture_numbers, visible_shares
from swarm_mj.flight.observe import camera_from, criterion_from
from swarm_mj.flight.plan import load_body_shape, target_from
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.capture import ObservationCriterion, cells_that_count, lit_cells
from swarm_mj.observation.observer import Observer
from swarm_mj.scenarios.loading import scenario_from
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array, Mask


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
    """

    candidates: list[Candidate]
    sees: Mask
    area: Array
    delta_v: Array
    point_A: Array
    regions: list[TargetRegion]

    @property
    def n_target_faces(self) -> int:
        """Faces of F_T, all targets."""
        return sum(region.n_faces for region in self.regions)


def visibility(scenario: Scenario, *, workers: int | None = None, progress: Progress | None = None) -> Visibility:
    """Fly every candidate and judge its pictures.

    Args:
        scenario: Says what counts as observed, and with `designer` which altitudes, times and targets there are.
        workers: Processes; default: one per core.
        progress: Called with the share done, 0 to 1.

    Raises:
        SwarmError: A candidate cannot be flown.
    """
    shape = load_body_shape(scenario.body)
    variants = target_variants(scenario)
    regions = [target_from(variant, shape) for variant in variants]
    imaging_model = imaging_model_from(scenario)
    flown = [
        (target, flight_variant, fly_candidates(flight_variant))
        for target, variant in enumerate(variants)
        for flight_variant in flight_variants(variant)
    ]
    candidates, rows, delta_v, points = [], [], [], []
    steps = len(flown) * len(regions)
    for count, (target, variant, flights) in enumerate(flown):
        columns = []
        for k, region in enumerate(regions):
            step = count * len(regions) + k

            def report(done: float, step: int = step, n: int = flights.n) -> None:
                if progress is not None:
                    progress((step + done / n) / steps)

            columns.append(seen_cells(variant, flights, region, imaging_model, workers=workers, progress=report))
        rows.append(np.hstack(columns))
        delta_v.append(flights.delta_v)
        points.append(flights.plan.points_A)
        design = variant.design
        candidates += [
            Candidate(j + 1, target, design.imaging_altitude_m, design.time_of_flight_s) for j in range(flights.n)
        ]
    return Visibility(
        candidates=candidates,
        sees=np.vstack(rows),
        area=np.concatenate([region.area for region in regions]),
        delta_v=np.concatenate(delta_v),
        point_A=np.concatenate(points),
        regions=regions,
    )


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


def seen_cells(
    scenario: Scenario,
    flights: CandidateFlights,
    region: TargetRegion,
    imaging_model: ImagingModel,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Mask:
    """Whether each candidate sees each cell of a region by the scenario's criterion, shape (n, cells)."""
    shares = visible_shares(flights, region, imaging_model, at=flights.counts, workers=workers, progress=progress)
    criterion = criterion_from(scenario)
    seen = np.zeros((flights.n, region.n_cells), dtype=np.bool_)
    with closing(imaging_model.open(region)) as observer:
        light = _light_by_time(flights, observer, criterion)
        for j, share in enumerate(shares):
            for row, k in enumerate(picture_numbers(flights, j, flights.counts)):
                seen[j] |= cells_that_count(
                    observer, criterion, flights.r_A[k, j], partial(light, int(k)), partial(share.__getitem__, row)
                )
    return seen


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
