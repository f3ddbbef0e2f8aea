"""Flies a simulation and writes its samples down, looking for impacts on the way."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError, SimulationError
from swarm_mj.io import interruption
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.scenarios.schema import is_multiple
from swarm_mj.simulator.batch import FlightSetup
from swarm_mj.simulator.fault_injection import FaultInjection
from swarm_mj.simulator.faults.impact import ImpactWatch
from swarm_mj.simulator.faults.telemetry import FaultRecord
from swarm_mj.simulator.flights import NEVER
from swarm_mj.simulator.instruments import Instruments
from swarm_mj.simulator.propulsion import Propulsion, PropulsionRecord
from swarm_mj.simulator.slots import SAMPLED, Peak, Resting, Slot
from swarm_mj.simulator.state import FlightState
from swarm_mj.smallbody.rotation import sub_point
from swarm_mj.typing import Array

Progress = Callable[[float], None]

#: Columns of `Record.vectors` after those that are rows of the work array.
_MOTOR_TORQUE, _LINE_OF_SIGHT = SAMPLED, SAMPLED + 1
_LOS = int(Slot.LOS)  # NumPy takes twice as long for a member of an enumeration
#: How often progress is told of in one flight, at least.
NEWS = 100
#: Compiled code flies on for about so long [s] before Python looks up: to be interrupted, and to tell of the progress.
SLICE_S = 0.25


@dataclass(frozen=True)
class Record:
    """Raw samples of a flight; `telemetry.dataset` names them.

    Attributes:
        time: Shape (t,) [s].
        vectors: r, v, omega, sigma_BR, wheel speed, wheel torque, line of sight, shape (t, 7, n, 3).
        attitude: q_BN and q_RN, shape (t, 2, n, 4).
        aim: `TargetKind` values and the spacecraft tracked, counted from 0 (-1: none), shape (t, 2, n).
        peaks: Over every control period, not only the samples: largest wheel speed [rad/s], largest motor torque [N m], and
            the time in which a wheel limit cut a torque [s], shape (n, 3).
        faults: What a flight with faults, dispersions or four wheels adds.
        instruments: What spacecraft from a file add: sensors and joints.
        propulsion: What thrusters add.
    """

    time: Array
    vectors: Array
    attitude: Array
    aim: NDArray[np.int16]
    peaks: Array
    faults: FaultRecord | None = None
    instruments: Instruments | None = None
    propulsion: PropulsionRecord | None = None


class Flown(Protocol):
    """What a recorder flies: `Simulation`."""

    setup: FlightSetup
    state: FlightState
    impact_watch: ImpactWatch | None

    @property
    def injection(self) -> FaultInjection | None:
        """Its faults; None: it has none."""

    @property
    def propulsion(self) -> Propulsion | None:
        """Its thrusters; None: it has none."""

    def decide(self) -> Targets:
        """Make the decision of the present tick."""
        ...

    def fly(self, periods: int) -> None:
        """Fly so many control periods."""


class Recorder:
    """Flies a simulation on from its present state; see `Simulation.run`.

    Args:
        loop: What is flown.
        duration: [s], a whole multiple of `interval`.
        interval: Time between samples [s], a whole multiple of the control period.
        progress: Called with the time reached [s], about a hundred times, or several times a second.

    Raises:
        ScenarioError: One is no multiple of the other.
    """

    def __init__(self, loop: Flown, duration: float, interval: float, progress: Progress | None) -> None:
        self._loop, self._state, self._progress = loop, loop.state, progress
        period, n = self._state.period, self._state.model.n
        if not (interval > 0.0 and is_multiple(interval, period) and is_multiple(duration, interval)):
            raise ScenarioError(
                f"duration {duration:g} s, interval {interval:g} s: the duration must be a whole multiple of the interval, and "
                f"that one of the control period, {period:g} s"
            )
        samples = round(duration / interval) + 1
        self._stride = round(interval / period)
        self._news_every = max(1, self._stride * (samples - 1) // NEWS)
        self._news_due = NEVER if progress is None else 0
        self._slice = 64
        self._record = Record(
            time=sample_times(duration, interval) + self._state.time,
            vectors=np.empty((samples, 7, n, 3)),
            attitude=np.empty((samples, 2, n, 4)),
            aim=np.empty((samples, 2, n), np.int16),
            peaks=np.empty((n, 3)),
            faults=None if loop.injection is None else FaultRecord(samples, n, self._state.properties.n_wheels),
            instruments=None
            if self._state.model.own is None
            else Instruments(self._state, samples, loop.setup.gradient_gm),
            propulsion=None if loop.propulsion is None else PropulsionRecord(samples, n),
        )

    def fly(self) -> Record:
        """Fly and record every sample.

        Raises:
            SimulationError: See `Simulation.run`.
        """
        state, record = self._state, self._record
        start = state.tick
        for row in range(len(record.time)):
            self._fly_to(start + row * self._stride)
            if row == len(record.time) - 1:
                cut = state.peaks[:, Peak.CUT_HOLDS].copy()
            self._keep(row, self._decide())
        record.peaks[:] = state.peaks
        record.peaks[:, Peak.CUT_HOLDS] = state.period * cut  # the hold of the last decision is not flown yet
        record.aim[:, 1][record.aim[:, 0] != TargetKind.SPACECRAFT] = -1
        return record

    def _fly_to(self, end: int) -> None:
        """Fly on to the next sample, stopping where impacts are looked for and progress is told of."""
        state, watch = self._state, self._loop.impact_watch
        while state.tick < end:
            stop = min(end, state.tick + self._slice, self._news_due, end if watch is None else watch.due)
            if stop > state.tick:
                self._fly_slice(stop - state.tick)
            if state.tick < end:
                self._decide()

    def _fly_slice(self, periods: int) -> None:
        """Fly on; the next slice is longer or shorter, so that one takes about `SLICE_S`, and ends with a word of progress."""
        start = time.perf_counter()
        self._loop.fly(periods)
        took = time.perf_counter() - start
        if took > 2.0 * SLICE_S:
            self._slice = max(1, self._slice // 2)
        elif took < 0.5 * SLICE_S and periods == self._slice:
            self._slice *= 2
        interruption.check()
        if self._progress is not None and took > 0.5 * SLICE_S:
            self._progress(self._state.time)

    def _decide(self) -> Targets:
        state, watch = self._state, self._loop.impact_watch
        targets = self._loop.decide()
        if watch is not None and state.tick >= watch.due:
            self._look_for_impacts(watch)
        if self._progress is not None and state.tick >= self._news_due:
            self._news_due = state.tick + self._news_every
            self._progress(state.time)
        return targets

    def _look_for_impacts(self, watch: ImpactWatch) -> None:
        state, injection, work = self._state, self._loop.injection, self._state.work
        flying = state.resting == Resting.FLYING
        hit = watch.look(state.tick, work[Slot.R], work[Slot.V], work[Slot.A], flying)
        for j in np.flatnonzero(hit):
            r_A = state.C_AN @ work[Slot.R, j]
            if injection is None:
                latitude, longitude = sub_point(r_A, np.eye(3))
                raise SimulationError(
                    f"{state.model.names[j]} hits the body at t = {state.time:g} s, latitude {latitude:.1f} deg, longitude "
                    f"{longitude:.1f} deg: its path crosses the surface. Change the mission, or fly it with faults"
                )
            injection.impact(int(j), r_A)

    def _keep(self, row: int, targets: Targets) -> None:
        state, record, injection = self._state, self._record, self._loop.injection
        motor = state.motor
        if record.instruments is not None:
            record.instruments.keep(row)
        if record.propulsion is not None and self._loop.propulsion is not None:
            record.propulsion.keep(row, self._loop.propulsion)
        if injection is not None and record.faults is not None:
            record.faults.keep(row, injection.faults, state.wheel_speed, state.q_BN)
            motor = injection.faults.wheels.motor
        vectors, attitude, aim = record.vectors[row], record.attitude[row], record.aim[row]
        vectors[:SAMPLED] = state.work[:SAMPLED]
        vectors[_MOTOR_TORQUE] = motor[:, :3]
        vectors[_LINE_OF_SIGHT] = state.work[_LOS]
        attitude[0], attitude[1] = state.q_BN, state.q_RN
        aim[0], aim[1] = targets.kind, targets.spacecraft


def sample_times(duration: float, interval: float) -> Array:
    """Times from 0 to `duration` at every `interval` [s], both ends included."""
    return np.asarray(interval * np.arange(round(duration / interval) + 1), dtype=np.float64)
