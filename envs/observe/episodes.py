"""E episodes over a pool of missions: what the single, the vector and the multi-agent environments share."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.smallbody.environment import LinearMotion
from swarm_mj.typing import Array32, Mask, Pixels

from ..arguments import checked_count, refuse_more_than_fit
from ..batch_env import StepOutcome
from ..pixels import IMAGE_SPACE, Poses
from .camera import SwarmCameras
from .config import EnvConfig, MissionPool
from .draws import EpisodeDraw
from .flybys import TIME_OF_FLIGHT_S
from .flying import BATCH, Fleet
from .layout import FlatLayout, make_interface, observed_from
from .mission import Mission
from .pictures import FAR
from .rewards import horizon_ended
from .state import EpisodeState
from .tables import BOUND

#: What an episode takes in memory, measured, upper estimates: of its own, and for each pair of spacecraft [B].
EPISODE_BYTES, PAIR_BYTES = 96 * 1024, 4608
#: Flight seeds from here on are kept for tests, in flybys of the catalogue; environments draw lower ones and refuse these.
HELD_OUT_SEED = 2**31


class Episodes(EpisodeState):
    """E episodes; each is a function of its flight seed alone.

    Args:
        config: The environment's arguments.
        count: Number of episodes E.
        threads: Most that are used.
        tests: Whether flight seeds that are kept for tests are flown.

    Attributes:
        pool: The missions.
        interface: What agents are shown and choose among.
        draws: What was drawn for each episode; None before it begins.

    Raises:
        ScenarioError: There are no episodes, or more than memory holds.
    """

    flights: Fleet

    def __init__(self, config: EnvConfig, count: int, threads: int = 1, *, tests: bool = False) -> None:
        n, used = config.spacecraft, max(1, min(threads, count))
        refuse_more_than_fit(checked_count("count", count), EPISODE_BYTES + n**2 * PAIR_BYTES)
        self.config, self.pool, self._tests = config, MissionPool(config), tests or config.scenario is not None
        each = -(-count // used)
        super().__init__(
            Fleet(count, n, used, each if len(self.pool) == 1 else min(BATCH, each)), count, n, config.patches
        )
        self.interface = make_interface(n, config.patches, config.candidates)
        self.draws: list[EpisodeDraw | None] = [None] * count
        self._cameras = SwarmCameras(config)
        self._numbers: dict[int, int] = {}
        thread = np.array([self.flights.thread_of(e) for e in range(count)])
        self._parts: list[Mask] = [thread == k for k in range(used)]
        self._pool = ThreadPoolExecutor(used, "swarm_mj episodes") if used > 1 else None

    @property
    def layout(self) -> FlatLayout:
        """Of a flat observation."""
        return self.interface.layout

    @property
    def choices(self) -> int:
        """Choices of a spacecraft."""
        return self.interface.choices

    def mission_of(self, e: int) -> Mission:
        """The mission that episode e flies."""
        assert self.draws[e] is not None, "the episode has not begun"
        return self.missions[self.mission[e]]

    def sun_of(self, e: int) -> LinearMotion:
        """Where the Sun is in episode e relative to the body, in N; one that was drawn stands still, as at the arrival."""
        mission, draw = self.mission_of(e), self.draws[e]
        assert draw is not None
        plan = mission.plan
        if not mission.drawn_light:
            return plan.environment.sun
        sun_N = self.sheet.sun_A[e] @ plan.environment.C_AN(TIME_OF_FLIGHT_S / draw.speed) * FAR * plan.shape.max_radius
        return LinearMotion(sun_N, np.zeros(3))

    def begin(self, e: int, seed: int, given: Mapping[str, Any] | None = None) -> None:
        """Start episode e anew from the seed of its flight, with values given by name in the place of drawn ones.

        Raises:
            ScenarioError: A name is unknown or a value not allowed, or the seed is kept for tests.
        """
        if seed >= HELD_OUT_SEED and not self._tests:
            raise ScenarioError(
                f"flight_seed = {seed}: from {HELD_OUT_SEED} on they are kept for tests, which `swarm-mj score` flies; "
                "give a lower one"
            )
        draw = self.config.laws.draw(seed, given)
        mission = self._seat(e, draw)
        start, live = mission.start(draw), np.arange(self.count) == e
        self.forget(e)
        self.flights.start(e, start)
        self.update(live)
        # Sensors are read of all, before anybody is lost.
        self.update_estimate(live)
        self._write_draw(e, draw, mission)
        target = self.totals.target[e, : mission.plan.region.n_cells]
        self.deal(e, mission.yardstick_area(target, draw.spacecraft, start))
        self._lose(e, ~self.sheet.present[e])
        self._fail(live)
        self.update(live)
        self.update_estimate(live)
        self.show(live)

    def _seat(self, e: int, draw: EpisodeDraw) -> Mission:
        """Let episode e fly its mission, which is made where it is the first to."""
        mission = self.pool[draw.mission]
        if draw.mission not in self._numbers:
            self._numbers[draw.mission] = self.add(mission)
        self.mission[e], self.draws[e] = self._numbers[draw.mission], draw
        self.flights.seat(e, draw.mission, mission)
        return mission

    def _write_draw(self, e: int, draw: EpisodeDraw, mission: Mission) -> None:
        """Write down what was drawn, and which cells can count in its light; what fails does so on the pictures' clock."""
        sheet = self.sheet
        sheet.present[e] = np.arange(self.n) < draw.spacecraft
        sheet.downlink[e], sheet.camera_off[e] = True, False
        fails_s = np.ceil(draw.fails * mission.duration_s / mission.interval_s) * mission.interval_s
        sheet.fails_s[e] = np.where(sheet.present[e, :, None], fails_s, np.inf)
        if mission.drawn_light:
            sheet.sun_A[e] = mission.sun_A(draw)
            self.totals.target[e, : mission.plan.region.n_cells] = mission.lit(sheet.sun_A[e])

    def _fail(self, live: Mask) -> None:
        """Let fail in the live flights what has failed by now, as it was drawn."""
        sheet, failed = self.sheet, self.sheet.fails_s <= self.now.t[:, None, None]
        if (failed & live[:, None, None]).any():
            sheet.camera_off[live] |= failed[live, :, 1]
            sheet.downlink[live] &= ~failed[live, :, 2]
            for e in np.flatnonzero((failed[:, :, 0] & ~self.totals.lost).any(axis=1) & live):
                self._lose(int(e), failed[e, :, 0] & ~self.totals.lost[e])

    def _lose(self, e: int, who: Mask) -> None:
        if who.any():
            self.totals.lost[e] |= who
            self.flights.park(e, *np.flatnonzero(who).tolist())

    @property
    def task(self) -> EnvConfig:
        """What tells whether a state fits, see `take_state`."""
        return self.config

    def get_state(self, e: int) -> dict[str, Any]:
        """All that episode e is between two steps, copied, for `set_state` of any episodes of the same arguments."""
        return {"draw": self.draws[e], "rows": self.rows_of(e), "flight": self.flights.get_state(e)}

    def set_state(self, e: int, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave; bit for bit the episode that went on from there."""
        self._seat(e, state["draw"])
        self.flights.set_state(e, state["flight"])
        self.put_rows(e, state["rows"])

    def reset(self, flights: Mapping[int, int], draw: Mapping[str, Any] | None = None) -> None:
        """Start episodes anew from their flight seeds, by number of the episode; `draw` as `given` of `begin`."""
        for e, seed in flights.items():
            self.begin(e, seed, draw)

    def step(self, actions: NDArray[Any], live: Mask) -> StepOutcome:
        """Fly the live episodes, shape (E,), one step with the agents' choices held, shape (E, n)."""
        return self.fly(self.interface.decoded(self._observed, actions), live)

    def fly(self, choices: NDArray[Any], live: Mask) -> StepOutcome:
        """The same with choices among all patches, Earth and relays, whatever the agents choose among."""
        for part in self.result:
            part[:] = 0
        given = np.asarray(choices, np.int64)
        if self._pool is None:
            self._decide(given, live)
        else:
            list(self._pool.map(lambda part: self._decide(given, live & part), self._parts))
        found = StepOutcome._make(part.copy() for part in self.result)
        return horizon_ended(found) if self.config.horizon_terminates else found

    def _decide(self, choices: NDArray[Any], live: Mask) -> None:
        """A decision of the live episodes: targets are held, links judged and pictures taken on the way, then all is scored."""
        if not live.any():
            return
        flights, mission = self.flights, self.missions[0]
        self.choose(choices, live)
        self.begin_step(live)
        flights.hold(live)
        ticks, flown, flying = mission.ticks, 0, live.copy()
        at = np.minimum(flights.tick[:, None] + np.arange(ticks + 1), mission.last_tick)
        due, stops = mission.is_due[at], mission.is_stop[at]
        # Pictures at the end of a decision belong to the next one, if there is one.
        due[:, ticks] &= at[:, ticks] == mission.last_tick
        stops[:, 0], stops[:, ticks] = False, True
        for k in np.flatnonzero((due | stops)[live].any(axis=0)).tolist():
            if k > flown:
                flights.fly(k - flown, flying)
                flown = k
                self._stop(stops[:, k] & flying, flying)
            if (pictured := due[:, k] & flying).any():
                self.take_pictures(pictured)
        self.update_estimate(flying)
        self.score(live, flying)
        self.show(flying)

    def _stop(self, at: Mask, flying: Mask) -> None:
        """Let flights come to an instant, where what fails fails; those that are not finite fly no further."""
        fine = self.arrive(at)
        flying &= fine | ~at
        self.totals.lost[at] |= self.flights.lost[at]
        for e, j in zip(*np.nonzero(self._hit & fine[:, None]), strict=True):
            self.flights.park(int(e), int(j))
        self._fail(fine)

    def info(self, e: int) -> dict[str, Any]:
        """What every step tells of episode e."""
        told = {name: rows[e].tolist() for name, rows in self._facts().items()}
        return told | {"action_mask": self.action_mask[e].copy()}

    def infos(self) -> dict[str, NDArray[Any]]:
        """The same of all episodes, arrays over them; zeros of those that have not begun."""
        return {name: rows.copy() for name, rows in self._facts().items()} | {"action_mask": self.action_mask}

    def _facts(self) -> dict[str, NDArray[Any]]:
        totals = self.totals
        return {
            "time_s": self.flights.tick * self.flights.period,
            "coverage_percent": 100.0 * totals.area / self.sheet.yardstick_area,
            "delivered_bit": totals.delivered.sum(axis=1),
            "stored_bit": totals.stored,
            "seen_bit": totals.seen_bit,
            "lost_bit": totals.lost_bit,
            "alive": self.sheet.present & ~totals.lost,
            "mission": np.array([0 if draw is None else draw.mission for draw in self.draws]),
        }

    def cause(self, e: int) -> str:
        """Why episode e diverged."""
        return self.flights.cause(e)

    @property
    def action_mask(self) -> NDArray[np.int8]:
        """Which choices make sense, shape (E, n, C)."""
        mask: NDArray[np.int8] = self.interface.shown(self._observed)["action_mask"]
        return mask.copy()

    def flat(self) -> Array32:
        """What agents are shown of all episodes as one row each, see `FlatLayout`, shape (E, F)."""
        return self.interface.flat(self._observed)

    def entities(self) -> dict[str, NDArray[Any]]:
        """The tables of all episodes by name, copies."""
        return {name: rows.copy() for name, rows in self._observed.items()}

    @property
    def _observed(self) -> dict[str, NDArray[Any]]:
        return observed_from(self.tables)

    @property
    def action_space(self) -> spaces.MultiDiscrete:
        """Of one episode."""
        return spaces.MultiDiscrete(np.full(self.n, self.choices))

    @property
    def space(self) -> spaces.Space[Any]:
        """Of the observation of one episode, as `config.observation` asks for it."""
        if self.config.observation == "flat":
            return box(self.layout.size)
        if self.config.observation == "pixels":
            image = spaces.Box(0, 255, (self.n, *IMAGE_SPACE.shape), np.uint8)
            return spaces.Dict({"image": image, "state": box(self.layout.size)})
        found: dict[str, spaces.Space[Any]] = {}
        for name, rows in self.shown().items():
            shape = rows.shape[1:]
            found[name] = spaces.MultiBinary(shape) if rows.dtype == np.int8 else box(*shape)
        return spaces.Dict(found)

    @property
    def observation(self) -> Any:
        """Of all episodes, as `config.observation` asks for it."""
        if self.config.observation == "pixels":
            return {"image": self.images(), "state": self.flat()}
        return self.flat() if self.config.observation == "flat" else self.shown()

    def images(self) -> Pixels:
        """What the cameras see, shape (E, n, 3, 64, 64); nothing in episodes that have not begun."""
        out = np.zeros((self.count, self.n, *IMAGE_SPACE.shape), np.uint8)
        for e, draw in enumerate(self.draws):
            if draw is None:
                continue
            mission, now = self.mission_of(e), self.now if self.flights.finite[e] else self.before
            poses = Poses(now.r[e], now.q[e], np.tile(now.C_AN[e], (self.n, 1, 1)), np.full(self.n, now.t[e]))
            seen = self.totals.seen[e, : mission.plan.region.n_cells]
            out[e] = self._cameras.look(int(self.mission[e]), mission, self.sun_of(e), poses, seen)
        return out

    def shown(self) -> dict[str, NDArray[Any]]:
        """What agents are shown of all episodes by name, copies."""
        return {name: rows.copy() for name, rows in self.interface.shown(self._observed).items()}

    def close(self) -> None:
        """End the threads and release the observers."""
        if self._pool is not None:
            self._pool.shutdown()
        self.pool.close()


def box(*shape: int) -> spaces.Box:
    """Numbers as they stand in the tables."""
    return spaces.Box(-BOUND, BOUND, shape, np.float32)
