"""E episodes of SwarmDownlink-v0 at once: what the single environment (E = 1) and the vector one stand on."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.dataflow.network import Access
from swarm_mj.typing import Array, Array32, Ints, Mask

from ..threads import refuse_more_than_fit
from .kernels import (
    LAPSED,
    NEW,
    DownlinkConstants,
    begin_episode,
    fly_slot,
    no_gains,
    no_state,
    write_masks,
)
from .observations import dict_space, flat, flat_space, no_tables, scales_of, write_tables
from .world import Conditions, DownlinkTask

#: How an episode can end by itself; 0 goes on.
DOWNLINK_ENDS = ("", "complete", "lost")


class DownlinkResult(NamedTuple):
    """Rewards and ends of a step of E episodes.

    Attributes:
        terms: Weighted terms, shape (E, 3), see `DownlinkWeights`.
        reward: Their sum, shape (E,).
        end: Number in `DOWNLINK_ENDS`, shape (E,).
        truncated: Whether the episode is over by its horizon, shape (E,).
    """

    terms: Array
    reward: Array
    end: Ints
    truncated: Mask


class DownlinkBatch:
    """E episodes of one task.

    Args:
        task: What they share.
        count: Number of episodes E.

    Attributes:
        task: What they share.
        count: Number of episodes.
        state: Where they stand.
        conditions: Of all of them.
        delivered: Value on Earth, shape (E,).
        tables: Their observations.

    Raises:
        ScenarioError: So many episodes would take more memory than there is.
    """

    def __init__(self, task: DownlinkTask, count: int) -> None:
        n, products, slots = task.n, task.config.products, task.config.slots
        one = (*no_state(1, n, products), *_no_conditions(1, slots, n, products), *no_tables(1, n, products))
        refuse_more_than_fit(count, sum(array.nbytes for array in one))
        self.task, self.count = task, count
        self.state, self.delivered = no_state(count, n, products), np.zeros(count)
        self.conditions = _no_conditions(count, slots, n, products)
        self.tables = no_tables(count, n, products)
        self._constants, self._scales, self._weights = (
            constants_of(task),
            scales_of(task),
            np.array(task.config.weights),
        )

    def reset(self, e: int, flight_seed: int) -> None:
        """Start episode e anew with what its seed draws; `observe` brings observations up to date."""
        self.place(e, self.task.draw(np.random.default_rng(flight_seed)))

    def place(self, e: int, drawn: Conditions) -> None:
        """Start episode e anew under given conditions; as `reset`."""
        for array, values in zip(self.conditions, drawn, strict=True):
            array[e] = values
        for array in self.state:
            array[e] = 0
        begin_episode(self._constants, self.conditions, self.state, e, no_gains(self.count))
        self.delivered[e] = 0.0

    def step(self, actions: NDArray[Any], live: Mask | None = None) -> DownlinkResult:
        """Fly a slot.

        Args:
            actions: Shape (E, n).
            live: Episodes to go on with, shape (E,); None for all.
        """
        live = np.ones(self.count, np.bool_) if live is None else live
        gains, state = no_gains(self.count), self.state
        choices = np.ascontiguousarray(actions, np.int64).reshape(self.count, self.task.n)
        fly_slot(self._constants, self.conditions, state, choices, live & (state.slot < self.task.config.slots), gains)
        self.delivered += gains.delivered
        self.observe()
        terms = np.stack(gains, axis=1) * self._weights
        settled = (self.conditions.size == 0) | ((state.status != NEW) & ~state.hold.any(axis=1))
        alive = state.alive.any(axis=1)
        end = np.where(~alive, 2, np.where(settled.all(axis=1), 1, 0)) * live
        truncated = live & (end == 0) & (state.slot >= self.task.config.slots)
        return DownlinkResult(terms, terms[:, 0] + terms[:, 1] + terms[:, 2], end.astype(np.int64), truncated)

    def observe(self) -> None:
        """Bring observations and masks up to date."""
        write_tables(self._scales, self.conditions, self.state, self.delivered, self.tables)
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
            "delivered_value": self.delivered.copy(),
            "delivered_bit": state.on_earth.sum(axis=1),
            "stored_bit": state.hold.sum(axis=2),
            "made_bit": state.made_bit.copy(),
            "lost_bit": state.lost_bit.copy(),
            "charge_J": state.charge_J.copy(),
            "action_mask": self.tables.action_mask.astype(np.int8),
        }

    def get_state(self, e: int) -> dict[str, Any]:
        """All that episode e is, copied."""
        return {"rows": [np.array(array[e]) for array in (*self.conditions, *self.state, self.delivered)]}

    def set_state(self, e: int, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave."""
        for array, row in zip((*self.conditions, *self.state, self.delivered), state["rows"], strict=True):
            array[e] = row
        self.observe()

    @property
    def lapsed(self) -> Mask:
        """Products that expired or were lost, shape (E, K)."""
        return np.asarray(self.state.status == LAPSED)


def constants_of(task: DownlinkTask) -> DownlinkConstants:
    """What all episodes of a task share."""
    config, power = task.config, task.config.powers
    return DownlinkConstants(
        step_s=float(config.step_s),
        storage_bit=int(config.storage_bit),
        battery_J=power.battery_J,
        base_J=power.base_W * config.step_s,
        earth_J=power.earth_W * config.step_s,
        crosslink_J=power.crosslink_W * config.step_s,
        slew_J=power.slew_J,
        slew_share=power.slew_s / config.step_s,
        restart_J=power.restart * power.battery_J,
        channels=float(task.given.link.ground.channels),
        access=list(Access).index(task.access),
        half_duplex=task.half_duplex,
    )


def _no_conditions(count: int, slots: int, n: int, products: int) -> Conditions:
    whole, real = (lambda *s: np.zeros((count, *s), np.int64)), (lambda *s: np.zeros((count, *s)))
    return Conditions(
        swarm_bit=whole(slots, n, n),
        earth_bit=whole(slots, n),
        sun_J=real(slots, n),
        earth_J=real(slots, n),
        allotted=np.zeros((count, slots), np.bool_),
        lost_slot=whole(n),
        charge_J=real(n),
        origin=whole(products),
        size=whole(products),
        value=real(products),
        ready=whole(products),
        expiry=whole(products),
        order=whole(products),
    )
