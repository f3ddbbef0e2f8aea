"""E episodes of SwarmDownlink-v0 at once: what the single environment (E = 1), the vector one and the baselines stand on."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.dataflow.transfer import link_rules
from swarm_mj.typing import Array32, Mask

from ..batch_env import StepOutcome
from ..capacity import refuse_more_than_fit
from .observations import dict_space, flat, flat_space, no_tables, write_tables
from .slot import NEW, DownlinkConstants, begin_episode, fly_slot, no_state, write_masks
from .world import DownlinkConditions, DownlinkTask

#: How an episode can end by itself; 0 goes on.
DOWNLINK_ENDS = ("", "complete", "lost")


class DownlinkBatch:
    """E episodes of one task, see `swarm_mj.envs.batch_env`.

    Args:
        task: What they share.
        count: Number of episodes E.

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
        """Fly a slot.

        Args:
            actions: Shape (E, n).
            live: Episodes to go on with, shape (E,); None for all.
        """
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
