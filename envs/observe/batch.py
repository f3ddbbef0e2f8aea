"""E episodes of one task at once: what the single environment (E = 1), the vector one and the multi-agent one stand on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import SimulationError
from swarm_mj.flight.fly import initial_state, make_simulation
from swarm_mj.simulator.batch import Batch
from swarm_mj.simulator.compiled_batch import CompiledBatch
from swarm_mj.simulator.fast.bound_calls import BoundCall
from swarm_mj.simulator.loop_state import InitialState
from swarm_mj.simulator.python_batch import PythonBatch
from swarm_mj.spacecraft.control.base import Controller
from swarm_mj.typing import Array, Mask

from .actions import ControlLevel, make_level
from .episode_state import EpisodeState
from .kinematics import Tracking
from .rewards import ENDS, Flown, StepResult, horizon_ended, joined, no_outcome
from .step import finish_step
from .task import Task
from .totals import reset_totals


class EpisodeFlights(EpisodeState):
    """E episodes and the simulation that flies them in one thread.

    Args:
        task: What they share.
        count: Number of episodes E.

    Attributes:
        level: How actions reach them.
        flights: The simulation.
        why_python: Why compiled code cannot fly them, so that Python does; empty where it can.
    """

    flights: Batch

    def __init__(self, task: Task, count: int) -> None:
        tracer = task.observer.tracer
        self.level: ControlLevel = make_level(task.config.control, task.plan, count, task.patches, tracer)
        law = None if self.level.torque_B is not None else task.plan.controller
        self.why_python = task.simulation.why_not_compiled(law)
        flights = self._python_batch(task, count) if self.why_python else self._compiled_batch(task, count, law)
        super().__init__(task, flights)
        self._total_area = task.patches.cell_area.sum()

    def _compiled_batch(self, task: Task, count: int, law: Controller | None) -> CompiledBatch:
        level = self.level
        behaviors = None if level.held is not None else [level.behavior(e) for e in range(count)]
        return CompiledBatch(task.simulation, count, law, behaviors)

    def _python_batch(self, task: Task, count: int) -> PythonBatch:
        plan, level = task.plan, self.level
        laws = [level.controller(e, plan.controller) for e in range(count)]
        plans = [replace(plan, behavior=level.behavior(e), controller=law) for e, law in enumerate(laws)]
        return PythonBatch([make_simulation(flown) for flown in plans])

    def _put(self, e: int, start: InitialState) -> Mask:
        """Let episode e stand at its start; returns it as a mask."""
        self.level.reset(e)
        reset_totals(self.totals, e)
        live = np.arange(self.count) == e
        self.flights.reset(e, start)
        # The first decision shows the attitude error; whatever else it left behind is undone.
        self.flights.hold(self.level.held, self.level.torque_B)
        if not self.flights.decide(live):
            raise SimulationError(self.flights.causes[e])
        self.flights.rewind(e, start)
        return live

    def get_state(self, e: int) -> dict[str, Any]:
        """All that episode e is between two steps, copied, for `set_state` of any batch of the same task.

        Raises:
            SimulationError: Something flies whose state cannot be taken; the message names it.
        """
        return {"rows": [array[e].copy() for array in self._remembered], "flight": self.flights.get_state(e)}

    def set_state(self, e: int, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave; bit for bit the flight that went on from there."""
        for array, row in zip(self._remembered, state["rows"], strict=True):
            array[e] = row
        self.flights.set_state(e, state["flight"])

    @property
    def _remembered(self) -> list[NDArray[Any]]:
        """What episodes remember besides their simulation, with the number of the episode in front."""
        return [*self.totals, *self.before, *self.now, *self.estimate, *self.level.remembered]

    def update_percent(self, e: int) -> None:
        """Bring the seen share of a flight up to date."""
        # From the cells, so that the order in which they were seen does not matter.
        area = self.task.patches.cell_area[self.totals.seen[e]].sum()
        self.totals.percent[e] = 100.0 * float(area / self._total_area)


class EpisodeBatch(EpisodeFlights):
    """E episodes of `SwarmObserve-v0`.

    Args:
        task: What they share.
        count: Number of episodes E.
        continues_after_impact: Whether a flight goes on without the spacecraft that hit the body.
    """

    def __init__(self, task: Task, count: int, *, continues_after_impact: bool = False) -> None:
        super().__init__(task, count)
        self._continues = continues_after_impact
        self._constants = task.step_constants(continues_after_impact=continues_after_impact)
        n = task.plan.n
        masks, area, failed = np.zeros((2, count), np.bool_), np.zeros(count), np.zeros((count, n), np.bool_)
        self._flown = Flown(self.flights.tick, masks[0], masks[1], area, self.flights.effort, failed)
        self._tracked = Tracking(self.flights.kind, self.flights.index, np.zeros((count, n, 3)), self.flights.blind)
        self._outcome = no_outcome(self.observation, n)
        instants = (self.before, self.now, self.estimate)
        given = (self._constants, *instants, self._tracked, self.totals, self._flown, self._outcome)
        self._finish = BoundCall(finish_step, given)

    def reset(self, e: int, flight_seed: int) -> None:
        """Start episode e anew from the seed of its initial attitudes and rates."""
        plan = self.task.plan
        scenario = plan.scenario.model_copy(update={"seed": flight_seed})
        self.begin(e, initial_state(replace(plan, scenario=scenario)))

    def begin(self, e: int, start: InitialState) -> None:
        """Start episode e anew from a state of its swarm."""
        live = self._put(e, start)
        self._update_kinematics(self.now, live)
        self._observe(live)

    def step(self, actions: NDArray[Any], live: Mask | None = None) -> StepResult:
        """Fly on for one step with the actions held.

        Args:
            actions: In the action space, shape (E, size).
            live: Episodes to go on with, shape (E,); None for all. The others stay as they are.
        """
        live = self._all if live is None else live
        self.level.apply(actions, self.estimate.C_BN[:, :, 2], live)
        self._shift_instants()
        self.flights.effort[:] = 0.0
        self.flights.hold(self.level.held, self.level.torque_B)
        flown = self._flown
        flown.area[:], flown.live[:] = 0.0, live
        flown.finite[:] = self._fly(live, flown.area)
        self._note_losses()
        self._update_estimate(flown.finite)
        self._tracked.sigma_BR[:] = self.flights.sigma_BR
        self._finish()
        result = joined([self._outcome.result])
        if self._continues and result.hit.any():
            for e, j in zip(*np.nonzero(result.hit), strict=True):
                self.flights.park(int(e), int(j))
        return horizon_ended(result) if self.task.config.horizon_terminates else result

    @property
    def _remembered(self) -> list[NDArray[Any]]:
        """See `EpisodeFlights`."""
        return [*super()._remembered, self.observation]

    def step_info(self, e: int, result: StepResult) -> dict[str, Any]:
        """What a step has to tell of flight e, beyond `info` its reward terms and how it ended."""
        info, end = self.info(e) | {"reward_terms": result.terms_of(e)}, ENDS[result.end[e]]
        if end:
            info["end"] = end
        if end == "diverged":
            info["cause"] = self.flights.causes[e]
        return info

    def _fly(self, live: Mask, new_area: Array) -> Mask:
        """Fly the live flights for one step and take the pictures that fall due; returns which stayed finite."""
        task, flights = self.task, self.flights
        flying, due, k = live.copy(), self._due(), 0
        while k < task.ticks:
            stop = min((tick for tick in due if tick >= k), default=task.ticks)
            if stop > k and not flights.fly(min(stop, task.ticks) - k, flying):
                flying &= flights.finite
            k = stop
            if k < task.ticks:
                if not flights.decide(flying):
                    flying &= flights.finite
                self._take_pictures(due[k] & flying, new_area)
                flights.advance(flying)
                k += 1
        flying = self._take_last_pictures(flying, due.get(task.ticks), new_area)
        # Of all flights: the instants were exchanged for those that stayed behind, too.
        finite = self._update_kinematics(self.now, self._all)
        if not finite.all():
            # Deciding again names the spacecraft.
            flights.decide(flying & ~finite)
        return flying & finite

    def _due(self) -> dict[int, Mask]:
        """In which flights pictures are due, by control instant of this step, where there are any."""
        task, tick = self.task, self.flights.tick
        starts = set(tick.tolist())
        if len(starts) == 1:
            return dict.fromkeys(task.due_in_step[starts.pop() // task.ticks], self._all)
        found: dict[int, Mask] = {}
        for start in starts:
            for k in task.due_in_step[start // task.ticks]:
                found[k] = found.get(k, ~self._all) | (tick == start)
        return found

    def _take_last_pictures(self, flying: Mask, due: Mask | None, new_area: Array) -> Mask:
        """The pictures at the very end of a flight; returns which flights are still finite."""
        last = flying & (self.flights.tick >= self.task.last_tick)
        if last.any():
            effort = self.flights.effort.copy()
            self.flights.decide(last)
            self.flights.effort[:] = effort
            flying = flying & self.flights.finite
            if due is not None:
                self._take_pictures(due & last & flying, new_area)
        return flying

    def _note_losses(self) -> None:
        """Bring losses to faults and the seen share up to date."""
        totals, lost = self.totals, self.flights.lost
        np.logical_and(lost, ~totals.lost, out=self._flown.failed)
        totals.lost[:] |= lost
        for e in np.flatnonzero(self._flown.area):
            self.update_percent(int(e))
