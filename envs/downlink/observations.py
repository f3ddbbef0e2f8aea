"""What an agent of SwarmDownlink-v0 is told: a table of spacecraft, one of products, and the swarm's own numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from gymnasium import spaces

from swarm_mj.compilation import kernel
from swarm_mj.typing import Array32, Mask

from .slot import OPEN, DownlinkConstants, DownlinkState
from .world import DownlinkConditions, DownlinkTask

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
    """Write observations of all episodes, but for the masks.

    Args:
        constants: Numbers are told over some of them.
        conditions: Of all episodes.
        state: Where they stand.
        tables: Written to.
    """
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
