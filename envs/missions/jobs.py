"""The compiled decisions of E episodes, and what Python adds to them where it must."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.simulator.fast.bound_calls import BoundCall
from swarm_mj.typing import Indices

from ..observe.rewards import RewardTerms, StepResult
from .decision_data import Facts, Told, no_facts
from .decisions import BEGIN, CHECK, DONE, DOUBTS, FAILS, FINISH, GO_ON, decide_flights
from .flights import MissionFlights
from .tables import Tables


class Jobs:
    """Who flies which episode in compiled code.

    Args:
        count: Number of episodes E.
        n: Most spacecraft.
        tables: Of all episodes, written to.
        pool: Threads; None for one.
        threads: How many.

    Attributes:
        facts: Of all episodes, written to.
    """

    def __init__(self, count: int, n: int, tables: Tables, pool: ThreadPoolExecutor | None, threads: int) -> None:
        self.facts: Facts = no_facts(count, n)
        self._numbers = np.zeros((len(RewardTerms._fields) + 1, count))
        result, choice = result_of(self._numbers, n), np.zeros((count, n), np.int64)
        self._told = Told(choice, np.zeros(count, np.bool_), np.zeros(count), result, tables, self.facts)
        self._made: dict[int, BoundCall] = {}
        self._like: BoundCall | None = None
        self._at, self._seats = np.zeros((count, 2), np.int64), np.zeros(count, np.int64)
        self._stages, self._answers = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self._batch_of = np.zeros(count, np.int64)
        self._flights: list[MissionFlights | None] = [None] * count
        self._pool, self._threads = pool, threads

    def seat(self, e: int, number: int, batch: MissionFlights, k: int) -> None:
        """Let episode e be flight k of a batch of that number."""
        if number not in self._made:
            self._made[number] = batch.job(self._told)
        job = self._made[number]
        self._like = self._like or job
        # Jobs that differ in more than their arrays are not called by the same code.
        assert job.kind == self._like.kind, "missions of one environment are of one kind"
        self._at[e], self._seats[e], self._batch_of[e], self._flights[e] = job.at, k, number, batch

    def step(self, which: Indices, actions: NDArray[Any]) -> StepResult:
        """Fly some episodes for one step with the choices held, shape (E, n), see `Episodes.fly`; zeros of the others."""
        told = self._told
        self._numbers[:], told.result.end[:] = 0.0, 0
        told.result.truncated[:], told.result.hit[:] = False, False
        if len(which):
            told.choice[:], self._stages[:] = actions, CHECK
            self._call(which)
            for e in which[self._answers[which] != DONE].tolist():
                self._go_on(e)
            for e in which[~told.fine[which]].tolist():
                self._of(e, MissionFlights.find_cause)
            for e in which[told.area[which] != 0.0].tolist():
                self._of(e, MissionFlights.update_percent)
            self._stages[:] = FINISH
            self._call(which)
            for e, j in zip(*np.nonzero(told.result.hit), strict=True):
                self._of(int(e), lambda batch, k, lost=int(j): batch.flights.park(k, lost))
        found = result_of(self._numbers.copy(), told.choice.shape[1])
        given = told.result
        return found._replace(end=given.end.copy(), truncated=given.truncated.copy(), hit=given.hit.copy())

    def _of(self, e: int, act: Callable[..., None]) -> None:
        batch = self._flights[e]
        assert batch is not None
        act(batch, int(self._seats[e]))

    def _call(self, which: Indices) -> None:
        if self._pool is None or len(which) < 2:
            self._fly(which)
        else:
            # A batch is flown by one thread.
            threads = self._threads
            parts = [which[self._batch_of[which] % threads == k] for k in range(threads)]
            list(self._pool.map(self._fly, parts))

    def _fly(self, which: Indices) -> None:
        decide_flights(self._like, self._at, self._seats, which, self._stages, self._answers)

    def _go_on(self, e: int) -> None:
        """Fly an episode to the end of its step in which Python has to do something first."""
        one = np.array([e])
        while self._answers[e] != DONE:
            answer = self._answers[e]
            self._stages[e] = BEGIN if answer == FAILS else GO_ON
            if answer == FAILS:
                self._of(e, MissionFlights.fail)
            elif answer == DOUBTS:
                self._of(e, MissionFlights.judge_pictures)
            else:
                self._of(e, MissionFlights.provide_noise)
            self._fly(one)


def result_of(numbers: NDArray[np.float64], n: int) -> StepResult:
    """A step of E episodes of n spacecraft that nothing has come of: terms and rewards, shape (7, E), are given."""
    count = numbers.shape[1]
    ends, over = np.zeros(count, np.int64), np.zeros(count, np.bool_)
    return StepResult(RewardTerms(*numbers[:-1]), numbers[-1], ends, over, np.zeros((count, n), np.bool_))
