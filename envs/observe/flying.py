"""E flights over several missions: the only place where these environments meet the simulator.

Flights of one mission fly together in batches, so that a step of all calls the simulator once or twice a mission. Flights of
different threads share no batch.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from swarm_mj.errors import SimulationError
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.simulator.batch import FlightBatch
from swarm_mj.simulator.slots import Slot
from swarm_mj.simulator.state import InitialState
from swarm_mj.typing import Array, Indices, Ints, Mask

from .kinematics import AttitudeEstimate, Kinematics
from .mission import Mission

#: Flights of one mission that fly in one batch, at most, where there are several missions.
BATCH = 16


class _Seats:
    """A batch of flights of one mission, and which flight of the fleet sits where."""

    def __init__(self, mission: Mission, size: int) -> None:
        n = mission.plan.n
        self.batch = FlightBatch(mission.setup, size, mission.plan.controller)
        self.who: Ints = np.full(size, -1, np.int64)
        self.held = Targets(np.zeros((size, n), np.int64), np.zeros((size, n), np.int64), np.zeros((size, n, 3)))
        self.known = np.zeros((size, n, 4)), np.zeros((size, n, 3))

    def of(self, live: Mask) -> tuple[Indices, Ints]:
        """Seats of the live flights, and their numbers in the fleet."""
        seats = np.flatnonzero((self.who >= 0) & live[self.who])
        return seats, self.who[seats]

    def mask(self, seats: Indices) -> Mask:
        """These seats."""
        found = np.zeros(len(self.who), np.bool_)
        found[seats] = True
        return found


class Fleet:
    """E flights of up to n spacecraft.

    Args:
        count: Number of flights E.
        n: Spacecraft of each.
        threads: Among which the flights are shared out.
        together: Most flights of one mission and thread in one batch.

    Attributes:
        period: Control period [s].
        tick: Control periods flown, shape (E,).
        finite: False where a flight has diverged, shape (E,).
        lost: Spacecraft lost to faults of the scenario, shape (E, n).
        off: Whose camera a fault of the scenario has off, shape (E, n).
        held: Targets that hold for the step, shape (E, n, ...).
        kind: What is tracked, `TargetKind` values; faults of the scenario may direct spacecraft elsewhere, shape (E, n).
        spacecraft: Whom, where that is a spacecraft, shape (E, n).
        sigma_BR: Attitude errors at the last decision, shape (E, n, 3).
        senses: Whether sensors of some flight may err.
    """

    def __init__(self, count: int, n: int, threads: int, together: int) -> None:
        self.count, self.n, self._threads, self._size = count, n, threads, together
        self.period = 0.0
        self.tick: Ints = np.zeros(count, np.int64)
        self.finite: Mask = np.ones(count, np.bool_)
        self.lost: Mask = np.zeros((count, n), np.bool_)
        self.off: Mask = np.zeros((count, n), np.bool_)
        self.held = Targets(np.zeros((count, n), np.int64), np.zeros((count, n), np.int64), np.zeros((count, n, 3)))
        self.kind: Ints = np.zeros((count, n), np.int64)
        self.spacecraft: Ints = np.zeros((count, n), np.int64)
        self.sigma_BR: Array = np.zeros((count, n, 3))
        self.senses = False
        self._batches: dict[tuple[int, int], list[_Seats]] = {}
        self._all: list[_Seats] = []
        self._place: list[tuple[_Seats, int] | None] = [None] * count

    def thread_of(self, e: int) -> int:
        """Which thread flies flight e."""
        return e * self._threads // self.count

    def seat(self, e: int, number: int, mission: Mission) -> None:
        """Let flight e be one of a mission of that number; its old place is free again."""
        if (old := self._place[e]) is not None:
            old[0].who[old[1]] = -1
        batches = self._batches.setdefault((number, self.thread_of(e)), [])
        taken = next((seats for seats in batches if (seats.who < 0).any()), None)
        if taken is None:
            taken = _Seats(mission, self._size)
            batches.append(taken)
            self._all.append(taken)
            self.senses, self.period = self.senses or taken.batch.senses, taken.batch.period
        k = int(np.argmax(taken.who < 0))
        taken.who[k], self._place[e] = e, (taken, k)

    def _of(self, e: int) -> tuple[_Seats, int]:
        place = self._place[e]
        assert place is not None, "the episode has not begun"
        return place

    def start(self, e: int, initial: InitialState) -> None:
        """Put flight e at its start; all look at the body's centre until they are told something else."""
        seats, k = self._of(e)
        for part in (*self.held, self.kind, self.spacecraft):
            part[e] = 0
        for part in seats.held:
            part[k] = 0
        self.held.kind[e] = self.kind[e] = seats.held.kind[k] = int(TargetKind.ASTEROID)
        seats.batch.reset(k, initial)
        # The first decision shows the attitude errors; it is taken back.
        seats.batch.hold(seats.held, None)
        if not seats.batch.decide(seats.mask(np.array([k]))):
            raise SimulationError(seats.batch.causes[k])
        sigma_BR = seats.batch.flights.work[k, Slot.SIGMA_BR].copy()
        seats.batch.reset(k, initial)
        self._fetch(seats, np.array([k]), np.array([e]))
        self.sigma_BR[e] = sigma_BR

    def hold(self, live: Mask) -> None:
        """Let the targets `held` hold in the live flights."""
        for seats in self._all:
            at, who = seats.of(live)
            if len(at):
                for ours, theirs in zip(seats.held, self.held, strict=True):
                    ours[at] = theirs[who]
                seats.batch.hold(seats.held, None)
                self.kind[who], self.spacecraft[who] = self.held.kind[who], self.held.spacecraft[who]

    def fly(self, periods: int, live: Mask) -> None:
        """Fly so many control periods of the live flights; one that is not finite any more stops."""
        for seats in self._all:
            at, who = seats.of(live)
            if len(at):
                seats.batch.fly(periods, seats.mask(at))
                self._fetch(seats, at, who)
                flights = seats.batch.flights
                self.kind[who], self.spacecraft[who] = flights.kind[at], flights.spacecraft[at]

    def _fetch(self, seats: _Seats, at: Indices, who: Ints) -> None:
        """Take over what the simulator tells of some flights."""
        f = seats.batch.flights
        self.tick[who], self.finite[who] = f.tick[at], f.finite[at]
        self.lost[who], self.off[who] = f.lost[at], seats.batch.blind[at]
        self.sigma_BR[who] = f.work[at, Slot.SIGMA_BR]

    def read(self, now: Kinematics, live: Mask) -> None:
        """Copy times and states of the live flights into an instant."""
        for seats in self._all:
            at, who = seats.of(live)
            if len(at):
                f = seats.batch.flights
                now.r[who], now.v[who], now.q[who] = f.r_N[at], f.v_N[at], f.q_BN[at]
                now.omega[who], now.wheel[who] = f.omega_B[at], f.wheel_speed[at]
        now.t[live] = self.tick[live] * self.period

    def know(self, estimate: AttitudeEstimate, live: Mask) -> Mask:
        """Put what the flight software has of attitudes and rates in the place of the truth; returns where that differs."""
        imperfect = np.zeros(self.count, np.bool_)
        if self.senses:
            for seats in self._all:
                at, who = seats.of(live)
                if len(at):
                    q, omega = seats.known
                    q[at], omega[at] = estimate.q[who], estimate.omega[who]
                    errs = seats.batch.know(seats.mask(at), q, omega)[at]
                    estimate.q[who[errs]], estimate.omega[who[errs]] = q[at[errs]], omega[at[errs]]
                    imperfect[who[errs]] = True
        return imperfect

    def park(self, e: int, *which: int) -> None:
        """Put spacecraft that are no more where they disturb nothing."""
        seats, k = self._of(e)
        seats.batch.park(k, *which)

    def cause(self, e: int) -> str:
        """Why flight e diverged."""
        seats, k = self._of(e)
        return seats.batch.causes[k]

    @property
    def _rows(self) -> tuple[Any, ...]:
        return (
            self.tick,
            self.finite,
            self.lost,
            self.off,
            *self.held,
            self.kind,
            self.spacecraft,
            self.sigma_BR,
        )

    def get_state(self, e: int) -> dict[str, Any]:
        """All that flight e is, copied, for `set_state` of any flight of the same mission.

        Raises:
            SimulationError: Something flies whose state cannot be taken; the message names it.
        """
        seats, k = self._of(e)
        return {"rows": [rows[e].copy() for rows in self._rows], "flight": seats.batch.get_state(k)}

    def set_state(self, e: int, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave, bit for bit."""
        seats, k = self._of(e)
        seats.batch.set_state(k, state["flight"])
        for rows, row in zip(self._rows, state["rows"], strict=True):
            rows[e] = row
