"""E episodes of one setting at once: what the single environment (E = 1), the vector one and the multi-agent one stand on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import SimulationError
from swarm_mj.flight import initial_state, make_simulation
from swarm_mj.observation.coverage import observe
from swarm_mj.simulation.batch import BatchFlights
from swarm_mj.simulation.compiled import why_not_compiled
from swarm_mj.simulation.separate import SeparateFlights
from swarm_mj.simulation.simulation import Simulation

from . import step_kernels
from .controls import IS_OBSERVING, ControlLevel, make_level
from .moments import Known, Now, turn
from .rewards import TERMS, settle
from .setting import Setting
from .step_kernels import Books

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

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
    end: NDArray[np.int64]
    truncated: Mask
    hit: Mask


class Flybys:
    """E flights in one thread.

    Args:
        setting: What they share.
        count: Number of flights E.
        go_on_after_impact: Whether a flight goes on without the spacecraft that hit the body.

    Attributes:
        setting: What they share.
        level: How actions reach them.
        flights: The simulation.
        batched: Whether that is the batch; else `why_separate` says why not.
        books: What they have come to.
        now: The instant between two steps, in truth.
        known: Attitudes and rates at that instant as the flight software has them.
        observation: Of every flight, shape (E, F).
        percent: Seen share of the target, shape (E,) [%].
    """

    def __init__(self, setting: Setting, count: int, *, go_on_after_impact: bool = False) -> None:
        self.setting, self.count, self._go_on = setting, count, go_on_after_impact
        plan, n = setting.plan, setting.plan.n
        self.level: ControlLevel = make_level(setting.control, plan, count, setting.patches, setting.observer.tracer)
        self.flights = self._make_flights()
        cells, wheels = plan.region.n_cells, len(plan.properties.wheel_axes_B)
        self.books = Books(
            seen=np.zeros((count, cells), np.bool_),
            first_seen=np.full((count, cells), np.nan),
            area=np.zeros(count),
            stored=np.zeros((count, n)),
            delivered=np.zeros(count),
            closed=np.zeros((count, n), np.bool_),
            lost=np.zeros((count, n), np.bool_),
        )
        self._before, self.now, self._picture = (_moment(count, n, wheels) for _ in range(3))
        self.known = Known(np.zeros((count, n, 4)), np.zeros((count, n, 3)), np.zeros((count, n, 3, 3)))
        space = setting.readings.space
        self.observation = np.zeros((count, *space.shape), np.float32)
        self._low, self._high = space.low, space.high
        self.percent = np.zeros(count)
        self._prices = self._make_prices()
        self._everyone = np.ones(count, np.bool_)

    def _make_flights(self) -> BatchFlights | SeparateFlights:
        setting, level = self.setting, self.level
        law = None if level.torque_B is not None else setting.plan.controller
        self.why_separate = why_not_compiled(setting.simulation, law)
        self.batched = not self.why_separate
        if not self.batched:
            return SeparateFlights([self._simulation(e) for e in range(self.count)])
        behaviors = None if level.kind is not None else [level.behavior(e) for e in range(self.count)]
        return BatchFlights(setting.simulation, self.count, law, behaviors)

    def _simulation(self, e: int) -> Simulation:
        plan = self.setting.plan
        flown = replace(plan, behavior=self.level.behavior(e), controller=self.level.controller(e, plan.controller))
        return make_simulation(flown)

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
        self._give_held()
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
        self._before, self.now = self.now, self._before
        flights.effort[:] = 0.0
        area, flying = np.zeros(self.count), live.copy()
        due = self._due()
        self._give_held()
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
            for k in range(setting.ticks + 1):
                if start + k <= setting.last_tick and setting.is_due[start + k]:
                    found[k] = found.get(k, np.zeros(self.count, np.bool_)) | (tick == start)
        return found

    def _give_held(self) -> None:
        """Hand the batch what the level holds; separate simulations read it themselves."""
        flights, level = self.flights, self.level
        flights.ask_again()
        if isinstance(flights, SeparateFlights):
            return
        if level.kind is not None:
            flights.kind[:], flights.index[:], flights.vector[:] = level.kind, level.index, level.vector
        if level.torque_B is not None:
            flights.torque_B[:] = level.torque_B

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

    def _look(self, now: Now, live: Mask) -> Mask:
        """Bring a moment up to date; returns which flights are finite."""
        self.flights.read(now.r, now.v, now.q, now.omega, now.wheel)
        now.t[:] = self.flights.tick * self.flights.period
        fine = np.zeros(self.count, np.bool_)
        step_kernels.orient(self.setting.mission, now, live, fine)
        return fine

    def _know(self, live: Mask) -> None:
        """Bring up to date what the flight software knows: bit for bit the truth where sensors are perfect."""
        now, known = self.now, self.known
        known.q[live], known.omega[live], known.C_BN[live] = now.q[live], now.omega[live], now.C_BN[live]
        if isinstance(self.flights, SeparateFlights):
            turn(known, self.flights.know(live, known.q, known.omega))

    def _take_pictures(self, due: Mask, area: Array) -> None:
        if not due.any():
            return
        setting, now = self.setting, self._picture
        self._look(now, due)
        kind, books = self.flights.kind, self.books
        if setting.scene is not None and not setting.criterion.needs_sun:
            singly = np.zeros(kind.shape, np.bool_)
            doubt = step_kernels.take_pictures(
                setting.scene, setting.mission, now, books, kind, self.flights.blind, due, area, singly
            )
            if not doubt:
                return
        else:
            singly = due[:, None] & IS_OBSERVING[kind] & ~books.lost & ~self.flights.blind
            singly[:, setting.plan.n_observers :] = False
        for e, j in zip(*np.nonzero(singly), strict=True):
            self._judge_singly(int(e), int(j), area)

    def _judge_singly(self, e: int, j: int, area: Array) -> None:
        """One picture by the observer itself: of any kind, in light that matters, or where the maps are in doubt."""
        setting, now, books = self.setting, self._picture, self.books
        plan, C_AN, r_A = setting.plan, now.C_AN[e], now.r_A[e, j]
        sun_A = C_AN @ plan.environment.sun.at(now.t[e])
        seen = observe(setting.observer, r_A, now.C_BN[e, j] @ C_AN.T, setting.criterion, sun_A)
        new = seen & ~books.seen[e]
        if new.any():
            gained = float(plan.region.area[new].sum())
            bits = self._pixels(r_A, new) * setting.radio.bits_per_pixel
            step_kernels.write_down(books, e, j, new, now.t[e], gained, bits)
            area[e] += gained

    def _pixels(self, r_A: Array, cells: Mask) -> float:
        """Area over the square of the ground sampling distance, foreshortened: A cos(emission) / (range pixel angle)^2."""
        region = self.setting.plan.region
        to_camera = r_A - region.centroid_A[cells]
        distance = np.linalg.norm(to_camera, axis=1)
        cosine = np.einsum("ij,ij->i", to_camera, region.normal_A[cells]) / distance
        footprint = (distance * self.setting.observer.camera.pixel_angle) ** 2
        return float((region.area[cells] * cosine / footprint).sum())

    def _end_step(self, live: Mask, step_s: float) -> tuple[Array, Mask]:
        measures, hit = np.zeros((self.count, 3)), np.zeros(self.books.lost.shape, np.bool_)
        self._know(live)
        step_kernels.end_step(
            self.setting.mission,
            self._before,
            self.now,
            self.known,
            self.books,
            self.flights.kind,
            self.flights.index,
            np.ascontiguousarray(self.flights.sigma_BR),
            live,
            step_s,
            self._low,
            self._high,
            measures,
            hit,
            self.observation,
        )
        return measures, hit

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

    def _count_seen(self, new: Array) -> None:
        """Bring the seen share up to date where there is new area; from the cells, so that their order does not matter."""
        if new.any():
            area = self.setting.plan.region.area
            for e in np.flatnonzero(new):
                self.percent[e] = 100.0 * float(area[self.books.seen[e]].sum() / area.sum())

    @property
    def time_s(self) -> Array:
        """Seconds past the epoch, shape (E,)."""
        return np.asarray(self.flights.tick * self.flights.period, np.float64)


def _moment(count: int, n: int, wheels: int) -> Now:
    return Now(
        t=np.zeros(count),
        r=np.zeros((count, n, 3)),
        v=np.zeros((count, n, 3)),
        q=np.zeros((count, n, 4)),
        omega=np.zeros((count, n, 3)),
        wheel=np.zeros((count, n, wheels)),
        C_AN=np.zeros((count, 3, 3)),
        r_A=np.zeros((count, n, 3)),
        C_BN=np.zeros((count, n, 3, 3)),
    )
