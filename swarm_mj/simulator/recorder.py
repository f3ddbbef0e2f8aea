"""Flies a simulation and writes its samples down, looking for impacts on the way."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from swarm_mj.errors import ScenarioError, SimulationError
from swarm_mj.mission.behaviors import Targets
from swarm_mj.scenarios.schema import is_multiple
from swarm_mj.simulator.fast import kernels
from swarm_mj.simulator.fast.flight_kernels import NEVER
from swarm_mj.simulator.fast.kernels import Slot
from swarm_mj.simulator.faults.telemetry import FaultRecord
from swarm_mj.simulator.records import Record, sample_times
from swarm_mj.smallbody.rotation import sub_point

if TYPE_CHECKING:
    from swarm_mj.simulator.simulation import Simulation

Progress = Callable[[float], None]

#: How often progress is told of in one flight.
NEWS = 100


class Recorder:
    """Flies a simulation on from its present state; see `Simulation.run`.

    Args:
        simulation: What is flown.
        duration: [s], a whole multiple of `interval`.
        interval: Time between samples [s], a whole multiple of the control period.
        progress: Called with the time reached [s], about a hundred times.

    Raises:
        ScenarioError: One is no multiple of the other.
    """

    def __init__(self, simulation: Simulation, duration: float, interval: float, progress: Progress | None) -> None:
        if not (interval > 0.0 and is_multiple(interval, simulation.period) and is_multiple(duration, interval)):
            raise ScenarioError(
                f"duration {duration:g} s, interval {interval:g} s: the duration must be a whole multiple of the interval, and "
                f"that one of the control period, {simulation.period:g} s"
            )
        n, samples = simulation.model.n, round(duration / interval) + 1
        self._simulation, self._progress = simulation, progress
        self._stride = round(interval / simulation.period)
        self._news_every = max(1, self._stride * (samples - 1) // NEWS)
        self._news_due = NEVER if progress is None else 0
        faulty = simulation._adverse is not None
        self._record = Record(
            time=sample_times(duration, interval) + simulation.time,
            vectors=np.empty((samples, 7, n, 3)),
            attitude=np.empty((samples, 2, n, 4)),
            aim=np.empty((samples, 2, n), np.int16),
            peaks=np.empty((n, 3)),
            faults=FaultRecord(samples, n, simulation.properties.n_wheels) if faulty else None,
        )

    def fly(self) -> Record:
        """Fly and record every sample.

        Raises:
            SimulationError: See `Simulation.run`.
        """
        simulation, record = self._simulation, self._record
        for row in range(len(record.time)):
            if row > 0:
                simulation.advance()
                self._fly_on(self._stride - 1)
            cut = simulation._peaks[:, 2].copy()
            self._keep(row, self._decide())
        simulation._peaks[:, 2] = cut  # the hold of the last decision is not flown
        record.peaks[:] = simulation._peaks * (1.0, 1.0, simulation.period)
        return record

    def _fly_on(self, periods: int) -> None:
        """Fly between two samples, stopping where impacts are looked for and progress is told of."""
        simulation, watch = self._simulation, self._simulation._watch
        end = simulation.tick + periods
        while simulation.tick < end:
            stop = min(end, self._news_due, end if watch is None else watch.due)
            if stop > simulation.tick:
                simulation.fly(stop - simulation.tick)
            else:
                self._decide()
                simulation.advance()

    def _decide(self) -> Targets:
        simulation, watch = self._simulation, self._simulation._watch
        targets = simulation.decide()
        if watch is not None and simulation.tick >= watch.due:
            self._look_for_impacts()
        if self._progress is not None and simulation.tick >= self._news_due:
            self._news_due = simulation.tick + self._news_every
            self._progress(simulation.time)
        return targets

    def _look_for_impacts(self) -> None:
        simulation, t = self._simulation, self._simulation.time
        work, adverse, watch = simulation._work, simulation._adverse, simulation._watch
        assert watch is not None
        flying = np.ones(simulation.model.n, np.bool_)
        if adverse is not None:
            flying[list(adverse.flight.resting)] = False
        hit = watch.look(simulation.tick, work[Slot.R], work[Slot.V], work[Slot.A], flying)
        for j in np.flatnonzero(hit):
            r_A = simulation._C_AN @ work[Slot.R, j]
            if adverse is None:
                latitude, longitude = sub_point(r_A, np.eye(3))
                raise SimulationError(
                    f"{simulation.model.names[j]} hits the body at t = {t:g} s, latitude {latitude:.1f} deg, longitude "
                    f"{longitude:.1f} deg: its path crosses the surface. Change the mission, or fly it with faults"
                )
            adverse.impact(t, int(j), r_A)

    def _keep(self, row: int, targets: Targets) -> None:
        simulation, record = self._simulation, self._record
        ctrl, adverse = simulation.data.ctrl, simulation._adverse
        if adverse is not None and record.faults is not None:
            record.faults.keep(row, adverse.flight, adverse.speed, simulation._q_BN)
            ctrl = adverse.motor
        kernels.record(
            row,
            targets.kind,
            targets.spacecraft,
            simulation._q_BN,
            simulation._q_RN,
            ctrl,
            simulation._work,
            record.vectors,
            record.attitude,
            record.aim,
        )
