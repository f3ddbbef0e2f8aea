"""A slot of E episodes of SwarmDownlink-v0, compiled: who may send, what `dataflow` moves, batteries, arrivals and losses.

Bits are whole numbers, so that made = delivered + aboard + lost holds exactly. Nothing depends on how many episodes are handled
together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import jittable, kernel
from swarm_mj.dataflow import network
from swarm_mj.dataflow.transfer import NOBODY, LinkRules, carry
from swarm_mj.typing import Array, Ints, Mask

from .world import DownlinkConditions

#: Choices of a spacecraft; from `SWARM` on they are the spacecraft to send to.
IDLE, EARTH, SWARM = 0, 1, 2
#: What a product is: not asked for yet, open, whole on Earth, expired or lost.
NEW, OPEN, DELIVERED, LAPSED = 0, 1, 2, 3
#: Charge below this share of the capacity is none.
NOTHING = 1e-9
_TO_EARTH = network.EARTH


class DownlinkConstants(NamedTuple):
    """What all episodes share.

    Attributes:
        rules: How links share time.
        storage_bit: Most that a spacecraft holds [bit].
        battery_J: Capacity.
        base_J: What is always on takes this in a slot.
        earth_J: Sending to Earth takes this more in a whole slot.
        crosslink_J: Sending to a spacecraft takes this more in a whole slot.
        slew_J: A turn between the Sun and Earth.
        slew_share: Of a slot that a turn takes.
        restart_J: Charge from which a spacecraft whose battery was empty obeys again.
        full_sun_J: Most that panels bring in a slot.
        best_earth_bit: Most that Earth hears in a slot.
        best_swarm_bit: Most that a crosslink carries in a slot.
        largest_bit: Of a product.
    """

    rules: LinkRules
    storage_bit: int
    battery_J: float
    base_J: float
    earth_J: float
    crosslink_J: float
    slew_J: float
    slew_share: float
    restart_J: float
    full_sun_J: float
    best_earth_bit: float
    best_swarm_bit: float
    largest_bit: float


class DownlinkState(NamedTuple):
    """Where E episodes of n spacecraft and K products stand.

    Attributes:
        slot: The one that begins, shape (E,).
        hold: Bits of each product aboard each spacecraft, shape (E, n, K).
        on_earth: Bits of each product on Earth, shape (E, K).
        status: Of each product, shape (E, K).
        made_bit: Of all products so far, shape (E,).
        lost_bit: That are gone, shape (E,).
        alive: Who is not lost, shape (E, n).
        safe: Whose battery was empty and who obeys nobody, shape (E, n).
        at_earth: Whose dish points at Earth, shape (E, n).
        charge_J: Shape (E, n).
        brought_J: By the panels, shape (E, n).
        spent_J: Shape (E, n).
        spilled_J: For which the battery had no room, or which was aboard a spacecraft that was lost, shape (E, n).
        unmet_J: That was needed and not there, shape (E, n).
        delivered: Value on Earth, shape (E,).
        expired: Value that expired or was lost, shape (E,).
        emptied: Batteries that became empty, shape (E,).
    """

    slot: Ints
    hold: Ints
    on_earth: Ints
    status: Ints
    made_bit: Ints
    lost_bit: Ints
    alive: Mask
    safe: Mask
    at_earth: Mask
    charge_J: Array
    brought_J: Array
    spent_J: Array
    spilled_J: Array
    unmet_J: Array
    delivered: Array
    expired: Array
    emptied: Array


def no_state(count: int, n: int, products: int) -> DownlinkState:
    """Of that many episodes, spacecraft and products, before anything has happened."""
    whole = [np.zeros((count, *shape), np.int64) for shape in ((), (n, products), (products,), (products,), (), ())]
    truths = [np.zeros((count, n), np.bool_) for _ in range(3)]
    return DownlinkState(
        *whole, *truths, *(np.zeros((count, n)) for _ in range(5)), *(np.zeros(count) for _ in range(3))
    )


@kernel
def write_masks(constants: DownlinkConstants, conditions: DownlinkConditions, state: DownlinkState, mask: Mask) -> None:
    """What each spacecraft may choose now, shape (E, n, n + 2)."""
    for e in range(mask.shape[0]):
        aboard = state.hold[e].sum(axis=1)
        for i in range(mask.shape[1]):
            for c in range(mask.shape[2]):
                mask[e, i, c] = _allowed(constants, conditions, state, aboard, e, i, c)


@kernel
def _allowed(
    constants: DownlinkConstants,
    conditions: DownlinkConditions,
    state: DownlinkState,
    aboard: Ints,
    e: int,
    i: int,
    c: int,
) -> bool:
    """Idle always; else who obeys, has something to send, and a link that carries; to Earth with charge for the turn."""
    slot, n = state.slot[e], state.alive.shape[1]
    if c == IDLE:
        return True
    if slot >= conditions.capacity_bit.shape[1] or not state.alive[e, i] or state.safe[e, i] or aboard[i] == 0:
        return False
    if c == EARTH:
        return conditions.capacity_bit[e, slot, i, n] > 0 and _energy_left(constants, conditions, state, e, i, c) > 0.0
    j = c - SWARM
    closed = j != i and state.alive[e, j] and conditions.capacity_bit[e, slot, i, j] > 0
    return closed and aboard[j] < constants.storage_bit


@kernel
def _energy_left(
    constants: DownlinkConstants, conditions: DownlinkConditions, state: DownlinkState, e: int, i: int, c: int
) -> float:
    """What is left of charge and income of the slot for the transmitter, negative where they do not suffice [J]."""
    turns = (c == EARTH) != state.at_earth[e, i]
    need = constants.base_J + (constants.slew_J if turns else 0.0)
    return state.charge_J[e, i] + _income(conditions, state, e, i, c) - need


@jittable
def _income(conditions: DownlinkConditions, state: DownlinkState, e: int, i: int, c: int) -> float:
    brings_J = conditions.earth_J if c == EARTH else conditions.sun_J
    return float(brings_J[e, state.slot[e], i])


@kernel
def begin_episode(constants: DownlinkConstants, conditions: DownlinkConditions, state: DownlinkState, e: int) -> None:
    """Put what is asked for at the beginning aboard."""
    state.alive[e] = True
    state.charge_J[e] = conditions.charge_J[e]
    _begin_slot(constants, conditions, state, e)
    state.expired[e] = 0.0


@kernel
def fly_slot(
    constants: DownlinkConstants, conditions: DownlinkConditions, state: DownlinkState, actions: Ints, live: Mask
) -> None:
    """Fly the slot that begins, with what is not allowed taken as idle.

    `conditions` and `state`, brought up to the beginning of the next slot, are of all episodes; `live`, shape (E,), says which
    fly. Actions are of shape (E, n).
    """
    n, products = actions.shape[1], state.hold.shape[2]
    choice, to, spare_J, time_share = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n), np.zeros(n)
    queue, moved = np.zeros((n * products, 2), np.int64), np.zeros(n * products, np.int64)
    storage_bit = np.full(n, constants.storage_bit)
    for e in range(actions.shape[0]):
        if live[e]:
            capacity_bit, aboard = conditions.capacity_bit[e, state.slot[e]], state.hold[e].sum(axis=1)
            for i in range(n):
                c = actions[e, i] if _allowed(constants, conditions, state, aboard, e, i, actions[e, i]) else IDLE
                choice[i] = c
                to[i] = NOBODY if c == IDLE else (_TO_EARTH if c == EARTH else c - SWARM)
                spare_J[i] = max(0.0, _energy_left(constants, conditions, state, e, i, c))
                takes_J = constants.earth_J if c == EARTH else constants.crosslink_J
                time_share[i] = min(1.0, spare_J[i] / takes_J) if takes_J > 0.0 else 1.0
                if c == EARTH and not state.at_earth[e, i]:
                    time_share[i] = min(time_share[i], 1.0 - constants.slew_share)
                queue[i * products : (i + 1) * products, 0] = i
                queue[i * products : (i + 1) * products, 1] = conditions.order[e]
            carry(constants.rules, capacity_bit, time_share, to, queue, storage_bit, state.hold[e], moved)
            for q in range(queue.shape[0]):
                i, k = queue[q]
                if moved[q] > 0:
                    takes_J = constants.earth_J if to[i] == _TO_EARTH else constants.crosslink_J
                    spare_J[i] = max(0.0, spare_J[i] - moved[q] / capacity_bit[i, to[i]] * takes_J)
                    state.on_earth[e, k] += moved[q] if to[i] == _TO_EARTH else 0
            for i in range(n):
                if state.alive[e, i]:
                    _charge(constants, conditions, state, e, i, choice[i], spare_J[i])
            for k in range(products):
                if state.status[e, k] == OPEN and state.on_earth[e, k] == conditions.size[e, k]:
                    state.status[e, k] = DELIVERED
                    state.delivered[e] += conditions.value[e, k]
            state.slot[e] += 1
            _begin_slot(constants, conditions, state, e)


@kernel
def _charge(
    constants: DownlinkConstants,
    conditions: DownlinkConditions,
    state: DownlinkState,
    e: int,
    i: int,
    c: int,
    spare_J: float,
) -> None:
    """Settle the energy of the slot; `spare_J` is what was left after sending."""
    income_J = _income(conditions, state, e, i, c)
    unmet_J = max(0.0, -_energy_left(constants, conditions, state, e, i, c))
    after_J = min(constants.battery_J, spare_J)
    state.brought_J[e, i] += income_J
    state.spent_J[e, i] += state.charge_J[e, i] + income_J - spare_J + unmet_J
    state.spilled_J[e, i] += spare_J - after_J
    state.unmet_J[e, i] += unmet_J
    state.charge_J[e, i] = after_J
    state.at_earth[e, i] = c == EARTH
    if after_J <= NOTHING * constants.battery_J:
        state.emptied[e] += 0.0 if state.safe[e, i] else 1.0
        state.safe[e, i] = True
    elif after_J >= constants.restart_J:
        state.safe[e, i] = False


@kernel
def _begin_slot(constants: DownlinkConstants, conditions: DownlinkConditions, state: DownlinkState, e: int) -> None:
    """Losses, what expires, and what is asked for, at the start of the slot."""
    slot, slots, n = state.slot[e], conditions.capacity_bit.shape[1], state.alive.shape[1]
    for i in range(n):
        if state.alive[e, i] and conditions.lost_slot[e, i] <= slot and slot < slots:
            state.alive[e, i] = False
            state.spilled_J[e, i] += state.charge_J[e, i]
            state.charge_J[e, i] = 0.0
            for k in range(state.status.shape[1]):
                if state.hold[e, i, k] > 0:
                    _lapse(conditions, state, e, k)
    for k in range(state.status.shape[1]):
        if state.status[e, k] == OPEN and conditions.expiry[e, k] <= slot:
            _lapse(conditions, state, e, k)
    for k in conditions.order[e]:
        if state.status[e, k] == NEW and conditions.ready[e, k] <= slot and conditions.ready[e, k] < slots:
            i, size = conditions.origin[e, k], conditions.size[e, k]
            state.status[e, k] = OPEN
            state.made_bit[e] += size
            if state.alive[e, i] and state.hold[e, i].sum() + size <= constants.storage_bit:
                state.hold[e, i, k] = size
            else:
                state.lost_bit[e] += size
                _lapse(conditions, state, e, k)


@jittable
def _lapse(conditions: DownlinkConditions, state: DownlinkState, e: int, k: int) -> None:
    """Give a product up; what is aboard of it, wherever, is deleted."""
    state.status[e, k] = LAPSED
    state.expired[e] += conditions.value[e, k]
    for i in range(state.hold.shape[1]):
        state.lost_bit[e] += state.hold[e, i, k]
        state.hold[e, i, k] = 0
