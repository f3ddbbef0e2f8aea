"""Pictures taken during an episode, by the criterion, camera and instants of `swarm_mj.flight.observe_flight`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarm_mj.flight import camera_from, criterion_from
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.observation.coverage import CoverageMap, observe
from swarm_mj.observation.observer import ObserverKind, make_observer
from swarm_mj.planning import Plan
from swarm_mj.simulation.telemetry import OBSERVING

from .state import SwarmState

Array = NDArray[np.float64]

#: Whether a `TargetKind` means looking at the body.
IS_OBSERVING = np.isin(np.arange(len(TargetKind)), OBSERVING)


class PictureTaker:
    """Takes the observers' pictures when they are due and keeps what was seen.

    Args:
        plan: The mission.
        kind: Which observer judges the pictures.

    Attributes:
        observer: Judges the pictures.
        coverage: What was seen in this episode, by the scenario's criterion.
        percent: Its share of the target's area [%].
    """

    def __init__(self, plan: Plan, kind: ObserverKind) -> None:
        scenario = plan.scenario
        self._plan, self._criterion = plan, criterion_from(scenario)
        self.observer = make_observer(
            plan.region, camera_from(scenario), kind=kind, occlusion=scenario.observation.occlusion
        )
        period = scenario.control.period_s
        self._every = round(scenario.observation.interval_s / period)
        self._visit = round(scenario.design.time_of_flight_s / period)
        self._visit_only = scenario.observation.criterion == "visit"
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self.coverage = CoverageMap(self._plan.region.area, self._plan.n)
        self.percent = 0.0
        self._seen = np.zeros(self._plan.region.n_cells, np.bool_)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Cells that the swarm has seen, shape (n_cells,)."""
        return self._seen

    def due(self, tick: int) -> bool:
        """Whether pictures that count are taken at this control instant, counted from 0."""
        return tick == self._visit if self._visit_only else tick % self._every == 0 or tick == self._visit

    def take(self, state: SwarmState, targets: Targets) -> tuple[float, Array]:
        """Take the pictures of all observers that look at the asteroid.

        Args:
            state: The swarm now.
            targets: What each one tracks.

        Returns:
            Newly seen area [m^2], and the pixels that each spacecraft's camera spent on newly seen cells, shape (n,).
        """
        plan, r_A, C_BA = self._plan, state.r_A, state.C_BA
        sun_A = state.C_AN @ plan.environment.sun.at(state.t)
        area, pixels = 0.0, np.zeros(plan.n)
        for j in np.flatnonzero(IS_OBSERVING[targets.kind[: plan.n_observers]]):
            seen = observe(self.observer, r_A[j], C_BA[j], self._criterion, sun_A)
            new = seen & ~self._seen
            self.coverage.add(state.t, int(j), seen)
            self._seen |= new
            area += float(plan.region.area[new].sum())
            pixels[j] = self._pixels(r_A[j], new)
        if area > 0.0:
            self.percent = self.coverage.percent
        return area, pixels

    def _pixels(self, r_A: Array, cells: NDArray[np.bool_]) -> float:
        """Area over the square of the ground sampling distance, foreshortened: A cos(emission) / (range pixel angle)^2."""
        region = self._plan.region
        to_camera = r_A - region.centroid_A[cells]
        distance = np.linalg.norm(to_camera, axis=1)
        cosine = np.einsum("ij,ij->i", to_camera, region.normal_A[cells]) / distance
        footprint = (distance * self.observer.camera.pixel_angle) ** 2
        return float((region.area[cells] * cosine / footprint).sum())

    def close(self) -> None:
        """Release the observer."""
        self.observer.close()
