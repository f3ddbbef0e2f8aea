"""E episodes of SwarmObserve-v1 over a pool of missions: what the single, the vector and the multi-agent environment share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.typing import Array32, Mask

from ..arguments import checked_count
from ..observe.rewards import ENDS, StepResult, horizon_ended
from ..threads import refuse_more_than_fit
from .config import MissionConfig
from .draws import EpisodeDraw, Randomisation
from .flights import MissionFlights
from .jobs import Jobs
from .layout import FlatLayout, make_interface
from .pool import MissionPool, Seats
from .tables import BOUND, Tables, no_tables

#: Episodes of one mission that fly in one batch, at most.
BATCH = 16
#: What an episode takes in memory, measured, upper estimates: of its own, and for each pair of spacecraft [B].
EPISODE_BYTES, PAIR_BYTES = 96 * 1024, 4608


class Episodes:
    """E episodes; each is a function of its flight seed alone.

    Args:
        config: The environment's arguments.
        count: Number of episodes E.
        threads: Most that are used.

    Attributes:
        config: The environment's arguments.
        pool: Its missions.
        count: Number of episodes E.
        n: Most spacecraft.
        patches: Patches of each target, K.
        interface: What agents are shown and choose among.
        tables: What the agents are shown, rows of E episodes.
        draws: What was drawn for each episode; None before it begins.

    Raises:
        ScenarioError: There are no episodes, or more than memory holds.
    """

    def __init__(self, config: MissionConfig, count: int, threads: int = 1) -> None:
        refuse_more_than_fit(checked_count("count", count), EPISODE_BYTES + config.max_spacecraft**2 * PAIR_BYTES)
        self.config, self.count = config, count
        self.n, self.patches = config.max_spacecraft, config.patches
        self.interface = make_interface(self.n, self.patches, config.candidates)
        self.pool: MissionPool = config.make_pool()
        self._random = Randomisation(config.randomise, self.pool.names, self.n)
        self._seats = Seats(self.pool, min(BATCH, count))
        self._places: list[tuple[int, int] | None] = [None] * count
        self.draws: list[EpisodeDraw | None] = [None] * count
        self.tables: Tables = no_tables(count, self.n, self.patches)
        self._missions = np.zeros(count, np.int64)
        self._pool = ThreadPoolExecutor(threads, "swarm_mj missions") if threads > 1 and count > 1 else None
        self._jobs = Jobs(count, self.n, self.tables, self._pool, threads)

    @property
    def layout(self) -> FlatLayout:
        """Of a flat observation."""
        return self.interface.layout

    @property
    def choices(self) -> int:
        """Choices of a spacecraft."""
        return self.interface.choices

    def locate(self, e: int) -> tuple[MissionFlights, int]:
        """The batch that flies episode e, and its number there."""
        place = self._places[e]
        assert place is not None, "the episode has not begun"
        return self._seats.batches[place[0]], place[1]

    def begin(self, e: int, seed: int, given: Mapping[str, Any] | None = None) -> None:
        """Start episode e anew.

        Args:
            e: Which.
            seed: Of the flight.
            given: Values by name in the place of drawn ones.

        Raises:
            ScenarioError: A name is unknown or a value not allowed.
        """
        draw = self._random.draw(seed, given)
        batch, k = self._seat(e, draw)
        batch.start(k, draw)
        self._tell(batch, k, e)

    def _seat(self, e: int, draw: EpisodeDraw) -> tuple[MissionFlights, int]:
        """A place for episode e in a batch of its mission, and its old one given back."""
        old, place = self.draws[e], self._places[e]
        if old is not None and place is not None:
            self._seats.give_back(old.mission, place)
        self.draws[e], self._places[e] = draw, self._seats.take(draw.mission)
        self._missions[e] = draw.mission
        batch, k = self.locate(e)
        self._jobs.seat(e, self._places[e][0], batch, k)  # type: ignore[index]
        return batch, k

    @property
    def task(self) -> MissionConfig:
        """What tells whether a state fits, see `take_state`."""
        return self.config

    def get_state(self, e: int) -> dict[str, Any]:
        """All that episode e is between two steps, copied, for `set_state` of any episodes of the same arguments."""
        batch, k = self.locate(e)
        return {"draw": self.draws[e], "batch": batch.get_state(k)}

    def set_state(self, e: int, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave; bit for bit the episode that went on from there."""
        batch, k = self._seat(e, state["draw"])
        batch.set_state(k, state["batch"])
        self._tell(batch, k, e)

    def reset(self, seeds: Mapping[int, int], given: Mapping[str, Any] | None = None) -> None:
        """Start episodes anew from their flight seeds, by number of the episode; `given` as of `begin`."""
        for e, seed in seeds.items():
            self.begin(e, seed, given)

    def step(self, actions: NDArray[Any], live: Mask) -> StepResult:
        """Fly the live episodes, shape (E,), one step with the agents' choices held, shape (E, n)."""
        return self.fly(self.interface.decoded(self._observed, actions), live)

    def fly(self, actions: NDArray[Any], live: Mask) -> StepResult:
        """The same with choices among all patches, Earth and relays, whatever the agents choose among."""
        result = self._jobs.step(np.flatnonzero(live), actions)
        return horizon_ended(result) if self.config.horizon_terminates else result

    def _tell(self, batch: MissionFlights, seats: Any, rows: Any) -> None:
        """Copy what a batch has of the flights in some seats into the rows of their episodes."""
        _copy_rows(batch.tables, seats, self.tables, rows)
        _copy_rows(batch.facts(), seats, self._jobs.facts, rows)

    def info(self, e: int) -> dict[str, Any]:
        """What every step tells of episode e."""
        return {name: _plain(rows[e]) for name, rows in self._facts().items()} | {
            "action_mask": self.action_mask[e].copy()
        }

    def infos(self) -> dict[str, NDArray[Any]]:
        """The same of all episodes, arrays over them; zeros of those that have not begun."""
        return {name: rows.copy() for name, rows in self._facts().items()} | {"action_mask": self.action_mask}

    def _facts(self) -> dict[str, NDArray[Any]]:
        return self._jobs.facts._asdict() | {"mission": self._missions}

    def step_info(self, e: int, result: StepResult) -> dict[str, Any]:
        """What a step has to tell of episode e, beyond `info` its reward terms and how it ended."""
        info, end = self.info(e) | {"reward_terms": result.terms_of(e)}, ENDS[result.end[e]]
        if end:
            info["end"] = end
        if end == "diverged":
            info["cause"] = self.cause(e)
        return info

    def cause(self, e: int) -> str:
        """Why episode e diverged."""
        batch, k = self.locate(e)
        return batch.flights.causes[k]

    def observation_of(self, e: int) -> Any:
        """Of one episode, a copy."""
        rows = self.observation
        return {name: part[e] for name, part in rows.items()} if isinstance(rows, dict) else rows[e]

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
        tables = self.tables
        return {
            "spacecraft": tables.spacecraft,
            "patches": tables.patches,
            "pairs": tables.pairs,
            "general": tables.general,
            "alive": tables.spacecraft[:, :, 0].astype(np.int8),
            "action_mask": tables.mask,
        }

    @property
    def action_space(self) -> spaces.MultiDiscrete:
        """Of one episode."""
        return spaces.MultiDiscrete(np.full(self.n, self.choices))

    @property
    def observation_space(self) -> spaces.Space[Any]:
        """Of one episode, as `config.observation` asks for it."""
        if self.config.observation == "flat":
            return box(self.layout.size)
        found: dict[str, spaces.Space[Any]] = {}
        for name, rows in self.shown().items():
            shape = rows.shape[1:]
            found[name] = spaces.MultiBinary(shape) if rows.dtype == np.int8 else box(*shape)
        return spaces.Dict(found)

    @property
    def observation(self) -> Any:
        """Of all episodes, as `config.observation` asks for it."""
        return self.flat() if self.config.observation == "flat" else self.shown()

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


def _plain(value: Any) -> Any:
    """A row as numbers and lists of Python's own."""
    return np.asarray(value).tolist()


def _copy_rows(source: Iterable[NDArray[Any]], seats: Any, target: Iterable[NDArray[Any]], rows: Any) -> None:
    """Rows `seats` of arrays into rows `rows` of others."""
    for ours, theirs in zip(target, source, strict=True):
        ours[rows] = theirs[seats]
