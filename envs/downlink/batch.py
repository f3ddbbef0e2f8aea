"""E episodes of SwarmDownlink-v0 at once: what the single environment (E = 1), the vector one and the baselines stand on.

An agent is told a table of spacecraft, one of products, and the swarm's own numbers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.compilation import kernel
from swarm_mj.dataflow.transfer import link_rules
from swarm_mj.typing import Array32, Mask

from ..arguments import refuse_more_than_fit
from ..batch_env import StepOutcome
from .slot import NEW, OPEN, DownlinkConstants, DownlinkState, begin_episode, fly_slot, no_state, write_masks
from .world import DownlinkConditions, DownlinkTask

#: How an episode can end by itself; 0 goes on.
DOWNLINK_ENDS = ("", "complete", "lost")
#: Numbers of a spacecraft before those of its links, of a product before those of who holds it, and of the swarm.
OWN, PRODUCT, SWARM_NUMBERS = 8, 5, 5


class DownlinkTables(NamedTuple):
    """Observations of E episodes, each written in place.

    Attributes:
        spacecraft: Shape (E, n, 8 + n).
        products: Shape (E, K, 5 + n).
        swarm: Shape (E, 5).
        action_mask: Shape (E, n, n + 2).
    """

    spacecraft: Array32
    products: Array32
    swarm: Array32
    action_mask: Mask


def no_tables(count: int, n: int, products: int) -> DownlinkTables:
    """Of that many episodes, spacecraft and products."""
    return DownlinkTables(
        np.zeros((count, n, OWN + n), np.float32),
        np.zeros((count, products, PRODUCT + n), np.float32),
        np.zeros((count, SWARM_NUMBERS), np.float32),
        np.zeros((count, n, n + 2), np.bool_),
    )


def dict_space(task: DownlinkTask) -> spaces.Dict:
    """The space of an observation by tables."""
    tables = no_tables(1, task.n, task.config.products)
    shapes = {name: table.shape[1:] for name, table in tables._asdict().items()}
    boxes = {name: spaces.Box(0.0, 10.0, shapes[name], np.float32) for name in ("spacecraft", "products", "swarm")}
    return spaces.Dict(boxes | {"action_mask": spaces.MultiBinary(shapes["action_mask"])})


def flat_space(task: DownlinkTask) -> spaces.Box:
    """The space of the same in a row."""
    tables = no_tables(1, task.n, task.config.products)
    masked = tables.action_mask.size
    high = np.full(sum(table.size for table in tables), 10.0, np.float32)
    high[-masked:] = 1.0
    return spaces.Box(np.zeros_like(high), high)


def flat(tables: DownlinkTables) -> Array32:
    """Observations in a row, shape (E, F)."""
    return np.concatenate([table.reshape(len(table), -1) for table in tables], axis=1, dtype=np.float32)


@kernel
def write_tables(
    constants: DownlinkConstants, conditions: DownlinkConditions, state: DownlinkState, tables: DownlinkTables
) -> None:
    """Write observations of all episodes, but for the masks."""
    slots, n = conditions.capacity_bit.shape[1], state.alive.shape[1]
    for e in range(state.slot.shape[0]):
        slot = min(state.slot[e], slots - 1)
        over = state.slot[e] >= slots
        for i in range(n):
            row = tables.spacecraft[e, i]
            row[0] = state.charge_J[e, i] / constants.battery_J
            row[1] = state.hold[e, i].sum() / constants.storage_bit
            row[2] = 0.0 if over else min(10.0, conditions.sun_J[e, slot, i] / constants.full_sun_J)
            row[3] = 0.0 if over else min(10.0, conditions.earth_J[e, slot, i] / constants.full_sun_J)
            row[4] = 0.0 if over else min(10.0, conditions.capacity_bit[e, slot, i, n] / constants.best_earth_bit)
            row[5], row[6], row[7] = state.at_earth[e, i], state.safe[e, i], state.alive[e, i]
            for j in range(n):
                row[8 + j] = (
                    0.0 if over else min(10.0, conditions.capacity_bit[e, slot, i, j] / constants.best_swarm_bit)
                )
        for k in range(state.status.shape[1]):
            entry, size = tables.products[e, k], conditions.size[e, k]
            entry[:] = 0.0
            if state.status[e, k] == OPEN:
                entry[0] = 1.0
                entry[1] = min(10.0, conditions.value[e, k] * state.status.shape[1])
                entry[2] = min(10.0, (size - state.on_earth[e, k]) / constants.largest_bit)
                entry[3] = (conditions.expiry[e, k] - state.slot[e]) / slots
                entry[4] = state.on_earth[e, k] / size
                for i in range(n):
                    entry[5 + i] = state.hold[e, i, k] / size
        _write_swarm(conditions, state, e, tables.swarm[e])


@kernel
def _write_swarm(conditions: DownlinkConditions, state: DownlinkState, e: int, row: Array32) -> None:
    """Time left, whether a pass is on, its rest, the time to the next one, and the value on Earth."""
    slots, now = conditions.allotted.shape[1], state.slot[e]
    end = now
    while end < slots and conditions.allotted[e, end]:
        end += 1
    start = end
    while start < slots and not conditions.allotted[e, start]:
        start += 1
    row[0] = (slots - now) / slots
    row[1] = 1.0 if end > now else 0.0
    row[2] = (end - now) / slots
    row[3] = (start - end) / slots
    row[4] = min(1.0, state.delivered[e])


class DownlinkBatch:
    """As many episodes E of one task as `count` says, see `swarm_mj.envs.batch_env`.

    Attributes:
        state: Where they stand.
        conditions: Of all of them.
        tables: Their observations.

    Raises:
        ScenarioError: So many episodes would take more memory than there is.
    """

    def __init__(self, task: DownlinkTask, count: int) -> None:
        n, products = task.n, task.config.products
        likeness = task.draw(np.random.default_rng(0))
        one = sum(array.nbytes for array in (*likeness, *no_state(1, n, products), *no_tables(1, n, products)))
        refuse_more_than_fit(count, one)
        self.task, self.count = task, count
        self.state, self.tables = no_state(count, n, products), no_tables(count, n, products)
        self.conditions = DownlinkConditions(*(np.zeros((count, *array.shape), array.dtype) for array in likeness))
        self._constants = constants_of(task)
        self._weights = np.array(task.config.weights)

    def reset(self, flights: dict[int, int]) -> None:
        """Start episodes anew with what their flight seeds draw."""
        for e, seed in flights.items():
            self.place(e, self.task.draw(np.random.default_rng(seed)))
        self.observe()

    def place(self, e: int, drawn: DownlinkConditions) -> None:
        """Start episode e anew under given conditions; `observe` brings observations up to date."""
        for array, values in zip(self.conditions, drawn, strict=True):
            array[e] = values
        for array in self.state:
            array[e] = 0
        begin_episode(self._constants, self.conditions, self.state, e)

    def step(self, actions: NDArray[Any], live: Mask | None = None) -> StepOutcome:
        """Fly a slot with the choices of the spacecraft, shape (E, n), in the live episodes, shape (E,); None: in all."""
        live, state, slots = np.ones(self.count, np.bool_) if live is None else live, self.state, self.task.config.slots
        before = np.array([state.delivered, state.expired, state.emptied])
        choices = np.ascontiguousarray(actions, np.int64).reshape(self.count, self.task.n)
        fly_slot(self._constants, self.conditions, state, choices, live & (state.slot < slots))
        self.observe()
        gained = np.array([state.delivered, state.expired, state.emptied]) - before
        terms = gained.T * self._weights
        settled = (self.conditions.size == 0) | ((state.status != NEW) & ~state.hold.any(axis=1))
        end = np.where(~state.alive.any(axis=1), 2, np.where(settled.all(axis=1), 1, 0)) * live
        truncated = live & (end == 0) & (state.slot >= slots)
        return StepOutcome(terms, terms.sum(axis=1), end.astype(np.int64), truncated)

    def observe(self) -> None:
        """Bring observations and masks up to date."""
        write_tables(self._constants, self.conditions, self.state, self.tables)
        write_masks(self._constants, self.conditions, self.state, self.tables.action_mask)

    @property
    def space(self) -> spaces.Space[Any]:
        """Of the observation of one episode."""
        return flat_space(self.task) if self.task.config.observation == "flat" else dict_space(self.task)

    @property
    def observation(self) -> Array32 | dict[str, NDArray[Any]]:
        """Of all episodes, each array with their number in front; a copy."""
        if self.task.config.observation == "flat":
            return flat(self.tables)
        arrays = {name: table.copy() for name, table in self.tables._asdict().items()}
        return arrays | {"action_mask": self.tables.action_mask.astype(np.int8)}

    def infos(self) -> dict[str, NDArray[Any]]:
        """What is told of all episodes, each array with their number in front."""
        state = self.state
        return {
            "time_s": state.slot * self.task.config.step_s,
            "delivered_value": state.delivered.copy(),
            "delivered_bit": state.on_earth.sum(axis=1),
            "stored_bit": state.hold.sum(axis=2),
            "made_bit": state.made_bit.copy(),
            "lost_bit": state.lost_bit.copy(),
            "charge_J": state.charge_J.copy(),
            "action_mask": self.tables.action_mask.astype(np.int8),
        }

    def get_state(self, e: int) -> dict[str, Any]:
        """All that episode e is, copied."""
        return {"rows": [np.array(array[e]) for array in (*self.conditions, *self.state)]}

    def set_state(self, e: int, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave."""
        for array, row in zip((*self.conditions, *self.state), state["rows"], strict=True):
            array[e] = row
        self.observe()

    def close(self) -> None:
        """Nothing is held that has to be released."""


def constants_of(task: DownlinkTask) -> DownlinkConstants:
    """What all episodes of a task share."""
    config, power = task.config, task.config.powers
    return DownlinkConstants(
        rules=link_rules(task.access, half_duplex=task.half_duplex, channels=task.given.link.ground.channels),
        storage_bit=int(config.storage_bit),
        battery_J=power.battery_J,
        base_J=power.base_W * config.step_s,
        earth_J=power.earth_W * config.step_s,
        crosslink_J=power.crosslink_W * config.step_s,
        slew_J=power.slew_J,
        slew_share=power.slew_s / config.step_s,
        restart_J=power.restart * power.battery_J,
        full_sun_J=task.full_sun_J,
        best_earth_bit=task.best_earth_bit,
        best_swarm_bit=task.best_swarm_bit,
        largest_bit=float(config.draws.size_most_bit),
    )
