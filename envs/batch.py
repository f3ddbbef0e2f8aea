"""E episodes of one setting at once: what the single environment (E = 1), the vector one and the multi-agent one stand on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import SimulationError
from swarm_mj.flight.fly import initial_state, make_simulation
from swarm_mj.simulator.compiled_batch import CompiledBatch
from swarm_mj.simulator.python_batch import PythonBatch
from swarm_mj.spacecraft.control.base import Controller
from swarm_mj.typing import Array, Ints, Mask

from .actions import ControlLevel, make_level
from .config import Setting
from .episode_state import Ledger
from .rewards import TERMS, settle

#: Data aboard below this share of the nominal volume count as delivered.
NOTHING_STORED = 1e-9


@dataclass(frozen=True, eq=False)
class Step:
    """What a step of E flights brought.

    Attributes:
        terms: Weighted reward terms in the order of `TERMS`, shape (E, 6).
        reward: Their sum, shape (E,).
        end: Number in `ENDS`, shape (E,).
        truncated: Whether the flight is over by its duration, shape (E,).
        hit: Which spacecraft hit the body in this step, shape (E, n).
    """

    terms: Array
    reward: Array
    end: Ints
    truncated: Mask
    hit: Mask


class Flybys(Ledger):
    """E flights in one thread, and their books.

    Args:
        setting: What they share.
        count: Number of flights E.
        go_on_after_impact: Whether a flight goes on without the spacecraft that hit the body.

    Attributes:
        level: How actions reach them.
        flights: The simulation.
        batched: Whether that is the batch; else `why_separate` says why not.
    """

    flights: CompiledBatch | PythonBatch

    def __init__(self, setting: Setting, count: int, *, go_on_after_impact: bool = False) -> None:
        self._go_on = go_on_after_impact
        self.level: ControlLevel = make_level(
            setting.control, setting.plan, count, setting.patches, setting.observer.tracer
        )
        law = None if self.level.torque_B is not None else setting.plan.controller
        self.why_separate = setting.simulation.why_not_compiled(law)
        self.batched = not self.why_separate
        super().__init__(setting, self._batch(setting, count, law) if self.batched else self._separate(setting, count))
        self._prices = self._make_prices()

    def _batch(self, setting: Setting, count: int, law: Controller | None) -> CompiledBatch:
        level = self.level
        behaviors = None if level.held is not None else [level.behavior(e) for e in range(count)]
        return CompiledBatch(setting.simulation, count, law, behaviors)

    def _separate(self, setting: Setting, count: int) -> PythonBatch:
        plan, level = setting.plan, self.level
        laws = [level.controller(e, plan.controller) for e in range(count)]
        plans = [replace(plan, behavior=level.behavior(e), controller=law) for e, law in enumerate(laws)]
        return PythonBatch([make_simulation(flown) for flown in plans])

    def reset(self, e: int, flight_seed: int) -> None:
        """Start flight e anew from the seed of its initial attitudes and rates."""
        plan = self.setting.plan
        scenario = plan.scenario.model_copy(update={"seed": flight_seed})
        start = initial_state(replace(plan, scenario=scenario))
        self.level.reset(e)
        books = self.books
        books.seen[e], books.first_seen[e], books.closed[e], books.lost[e] = False, np.nan, False, False
        books.area[e], books.stored[e], books.delivered[e], self.percent[e] = 0.0, 0.0, 0.0, 0.0
        live = np.arange(self.count) == e
        self.flights.reset(e, start)
        # The first decision shows the attitude error; the second reset undoes whatever it left behind.
        self.flights.hold(self.level.held, self.level.torque_B)
        if not self.flights.decide(live):
            raise SimulationError(self.flights.causes[e])
        self.flights.reset(e, start)
        self._look(self.now, live)
        self._end_step(live, 0.0)

    def step(self, actions: NDArray[np.generic], live: Mask | None = None) -> Step:
        """Fly on for one step with the actions held.

        Args:
            actions: In the action space, shape (E, size).
            live: Flights to fly, shape (E,); None for all. The others stay as they are.
        """
        setting, flights = self.setting, self.flights
        live = self._everyone if live is None else live
        self.level.hold(actions, self.known.C_BN[:, :, 2], live)
        self.before, self.now = self.now, self.before
        flights.effort[:] = 0.0
        area, flying = np.zeros(self.count), live.copy()
        due = self._due()
        flights.hold(self.level.held, self.level.torque_B)
        k = 0
        while k < setting.ticks:
            stop = min((tick for tick in due if tick >= k), default=setting.ticks)
            if stop > k and not flights.fly(min(stop, setting.ticks) - k, flying):
                flying &= flights.finite
            k = stop
            if k < setting.ticks:
                if not flights.decide(flying):
                    flying &= flights.finite
                self._take_pictures(due[k] & flying, area)
                flights.advance(flying)
                k += 1
        flying = self._finish(flying, due.get(setting.ticks), area)
        return self._result(live, flying, area)

    def _due(self) -> dict[int, Mask]:
        """In which flights pictures are due, by control instant of this step, where there are any."""
        setting, tick = self.setting, self.flights.tick
        found: dict[int, Mask] = {}
        for start in set(tick.tolist()):
            for k in np.flatnonzero(setting.is_due[start : start + setting.ticks + 1]).tolist():
                found[k] = found.get(k, np.zeros(self.count, np.bool_)) | (tick == start)
        return found

    def _finish(self, flying: Mask, due: Mask | None, area: Array) -> Mask:
        """The last pictures of a flight, and a look at the state at the end of the step."""
        last = flying & (self.flights.tick >= self.setting.last_tick)
        if last.any():
            effort = self.flights.effort.copy()
            self.flights.decide(last)
            self.flights.effort[:] = effort
            flying = flying & self.flights.finite
            if due is not None:
                self._take_pictures(due & last & flying, area)
        # Of all flights: the moments were exchanged for those that stayed behind, too.
        fine = self._look(self.now, self._everyone)
        if not fine.all():
            # Deciding again names the spacecraft.
            self.flights.decide(flying & ~fine)
        return flying & fine

    def _result(self, live: Mask, flying: Mask, area: Array) -> Step:
        setting, flights, books, count = self.setting, self.flights, self.books, self.count
        gone = flights.lost & ~books.lost
        books.lost[:] |= gone
        measures, hit = self._end_step(flying, setting.step_s)
        self._count_seen(area)
        terms, reward = np.zeros((count, len(TERMS))), np.zeros(count)
        end, truncated = np.zeros(count, np.int64), np.zeros(count, np.bool_)
        settle(
            self._prices,
            flights.tick,
            live,
            flying,
            area,
            flights.effort,
            measures,
            hit,
            gone,
            books.lost,
            books.stored,
            self.percent,
            terms,
            reward,
            end,
            truncated,
        )
        if self._go_on and hit.any():
            for e, j in zip(*np.nonzero(hit), strict=True):
                flights.park(int(e), int(j))
        return Step(terms, reward, end, truncated, hit)

    def _make_prices(self) -> Array:
        """See `settle`."""
        setting, properties = self.setting, self.setting.plan.properties
        share = setting.step_s / setting.plan.scenario.duration_s
        torques = setting.ticks * setting.plan.n * len(properties.wheel_axes_B) * properties.max_wheel_torque**2
        numbers = [setting.plan.region.total_area, setting.nominal_bit, share, torques, setting.complete]
        numbers += [NOTHING_STORED * setting.nominal_bit, setting.last_tick, float(self._go_on)]
        return np.array([*numbers, *(setting.weights[name] for name in TERMS)], np.float64)
