"""A slot of E episodes of SwarmDownlink-v0, compiled: who is heard, what moves, what batteries lose, what arrives or expires.

Bits are whole numbers, so that made = delivered + aboard + lost holds exactly. Nothing depends on how many episodes are handled
together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.typing import Array, Ints, Mask, jittable, kernel

from .world import Conditions

#: Choices of a spacecraft; from `SWARM` on they are the spacecraft to send to.
IDLE, EARTH, SWARM = 0, 1, 2
#: What a product is: not asked for yet, open, whole on Earth, expired or lost.
NEW, OPEN, DELIVERED, LAPSED = 0, 1, 2, 3
#: How crosslinks share time, in the order of `Access`.
ONE_AT_A_TIME, TDMA, PARALLEL = 0, 1, 2
#: Charge below this share of the capacity is none.
NOTHING = 1e-9


class DownlinkConstants(NamedTuple):
    """What all episodes share.

    Attributes:
        step_s: Length of a slot [s].
        storage_bit: Most that a spacecraft holds [bit].
        battery_J: Capacity.
        base_J: What is always on takes this in a slot.
        earth_J: Sending to Earth takes this more in a whole slot.
        crosslink_J: Sending to a spacecraft takes this more in a whole slot.
        slew_J: A turn between the Sun and Earth.
        slew_share: Of a slot that a turn takes.
        restart_J: Charge from which a spacecraft whose battery was empty obeys again.
        channels: How many spacecraft Earth hears at once.
        access: How crosslinks share time.
        half_duplex: Whether a spacecraft sends or hears, but never both at once.
    """

    step_s: float
    storage_bit: int
    battery_J: float
    base_J: float
    earth_J: float
    crosslink_J: float
    slew_J: float
    slew_share: float
    restart_J: float
    channels: float
    access: int
    half_duplex: bool


class DownlinkState(NamedTuple):
    """Where E episodes of n spacecraft and K products stand.

    Attributes:
        slot: The one that begins, shape (E,).
        hold: Bits of each product aboard each spacecraft, shape (E, n, K).
        on_earth: Bits of each product on Earth, shape (E, K).
        status: Of each product, shape (E, K).
        charge_J: Shape (E, n).
        alive: Who is not lost, shape (E, n).
        safe: Whose battery was empty and who obeys nobody, shape (E, n).
        at_earth: Whose dish points at Earth, shape (E, n).
        made_bit: Of all products so far, shape (E,).
        lost_bit: That are gone, shape (E,).
        brought_J: By the panels, shape (E, n).
        spent_J: Shape (E, n).
        spilled_J: For which the battery had no room, or which was aboard a spacecraft that was lost, shape (E, n).
        unmet_J: That was needed and not there, shape (E, n).
    """

    slot: Ints
    hold: Ints
    on_earth: Ints
    status: Ints
    charge_J: Array
    alive: Mask
    safe: Mask
    at_earth: Mask
    made_bit: Ints
    lost_bit: Ints
    brought_J: Array
    spent_J: Array
    spilled_J: Array
    unmet_J: Array


class Gains(NamedTuple):
    """What a slot brings, each of shape (E,): value delivered, value expired or lost, batteries that became empty."""

    delivered: Array
    expired: Array
    empty: Array


def no_state(count: int, n: int, products: int) -> DownlinkState:
    """Of that many episodes, spacecraft and products, before anything has happened."""
    whole, real, truth = (
        lambda *s: np.zeros((count, *s), np.int64),
        lambda: np.zeros((count, n)),
        lambda: np.zeros((count, n), np.bool_),
    )
    return DownlinkState(
        whole(), whole(n, products), whole(products), whole(products), real(), truth(), truth(), truth(), whole(), whole(),
        real(), real(), real(), real(),
    )  # fmt: skip


def no_gains(count: int) -> Gains:
    """Nothing, of that many episodes."""
    return Gains(np.zeros(count), np.zeros(count), np.zeros(count))


@kernel
def write_masks(constants: DownlinkConstants, conditions: Conditions, state: DownlinkState, mask: Mask) -> None:
    """What each spacecraft may choose now, shape (E, n, n + 2)."""
    for e in range(mask.shape[0]):
        for i in range(mask.shape[1]):
            for c in range(mask.shape[2]):
                mask[e, i, c] = _allowed(constants, conditions, state, e, i, c)


@jittable
def _allowed(
    constants: DownlinkConstants, conditions: Conditions, state: DownlinkState, e: int, i: int, c: int
) -> bool:
    """Idle always; else who obeys, has something to send, and a link that carries; to Earth with charge for the turn."""
    slot = state.slot[e]
    if c == IDLE:
        return True
    if slot >= conditions.earth_bit.shape[1] or not state.alive[e, i] or state.safe[e, i] or _aboard(state, e, i) == 0:
        return False
    if c == EARTH:
        return conditions.earth_bit[e, slot, i] > 0 and _energy(constants, conditions, state, e, i, EARTH) > 0.0
    j = c - SWARM
    closed = j != i and state.alive[e, j] and conditions.swarm_bit[e, slot, i, j] > 0
    return closed and _aboard(state, e, j) < constants.storage_bit


@jittable
def _aboard(state: DownlinkState, e: int, i: int) -> int:
    total = 0
    for k in range(state.hold.shape[2]):
        total += state.hold[e, i, k]
    return total


@jittable
def _energy(
    constants: DownlinkConstants, conditions: Conditions, state: DownlinkState, e: int, i: int, c: int
) -> float:
    """What is left of charge and income of the slot for the transmitter, negative where they do not suffice [J]."""
    slot = state.slot[e]
    income = conditions.earth_J[e, slot, i] if c == EARTH else conditions.sun_J[e, slot, i]
    return float(state.charge_J[e, i] + income - _need(constants, state, e, i, c))


@jittable
def _need(constants: DownlinkConstants, state: DownlinkState, e: int, i: int, c: int) -> float:
    turns = (c == EARTH) != state.at_earth[e, i]
    return float(constants.base_J + (constants.slew_J if turns else 0.0))


@kernel
def begin_episode(
    constants: DownlinkConstants, conditions: Conditions, state: DownlinkState, e: int, gains: Gains
) -> None:
    """Put what is asked for at the beginning aboard."""
    state.alive[e] = True
    state.charge_J[e] = conditions.charge_J[e]
    _begin_slot(constants, conditions, state, e, gains)


@kernel
def fly_slot(
    constants: DownlinkConstants, conditions: Conditions, state: DownlinkState, actions: Ints, live: Mask, gains: Gains
) -> None:
    """Fly the slot that begins, with what is not allowed taken as idle.

    Args:
        constants: See `DownlinkConstants`.
        conditions: Of all episodes, each array with their number in front.
        state: Brought up to the beginning of the next slot.
        actions: Shape (E, n).
        live: Which episodes, shape (E,).
        gains: Added to.
    """
    n = actions.shape[1]
    choice, spare, came = np.zeros(n, np.int64), np.zeros(n), np.zeros_like(state.hold[0])
    for e in range(actions.shape[0]):
        if live[e]:
            for i in range(n):
                allowed = _allowed(constants, conditions, state, e, i, actions[e, i])
                choice[i] = actions[e, i] if allowed else IDLE
            for i in range(n):
                spare[i] = max(0.0, _energy(constants, conditions, state, e, i, choice[i]))
            came[:] = 0
            _send_to_spacecraft(constants, conditions, state, e, choice, spare, came)
            _send_to_earth(constants, conditions, state, e, choice, spare)
            _charge(constants, conditions, state, e, choice, spare, gains)
            for i in range(n):
                for k in range(came.shape[1]):
                    state.hold[e, i, k] += came[i, k]
            _arrive(conditions, state, e, gains)
            state.slot[e] += 1
            _begin_slot(constants, conditions, state, e, gains)


@jittable
def _send_to_earth(
    constants: DownlinkConstants, conditions: Conditions, state: DownlinkState, e: int, choice: Ints, spare: Array
) -> None:
    """In gene order, until the time of the ground receivers is used up."""
    slot, left = state.slot[e], constants.channels
    for i in range(choice.shape[0]):
        if choice[i] == EARTH:
            usable = 1.0 if state.at_earth[e, i] else 1.0 - constants.slew_share
            usable = min(left, usable, spare[i] / constants.earth_J if constants.earth_J > 0.0 else 1.0)
            capacity = conditions.earth_bit[e, slot, i]
            room, sent = np.int64(usable * capacity), 0
            for k in conditions.order[e]:
                bits = min(state.hold[e, i, k], room - sent)
                state.hold[e, i, k] -= bits
                state.on_earth[e, k] += bits
                sent += bits
            share = sent / capacity
            left -= share
            spare[i] = max(0.0, spare[i] - share * constants.earth_J)


@jittable
def _send_to_spacecraft(
    constants: DownlinkConstants,
    conditions: Conditions,
    state: DownlinkState,
    e: int,
    choice: Ints,
    spare: Array,
    came: Ints,
) -> None:
    """In gene order, as the access to the crosslink allows; `came` receives what is aboard from the next slot on."""
    slot, n, common = state.slot[e], choice.shape[0], 1.0
    free = np.ones(n)
    room = np.zeros(n, np.int64)
    for j in range(n):
        room[j] = constants.storage_bit - _aboard(state, e, j)
    for i in range(n):
        if choice[i] >= SWARM:
            j, capacity = choice[i] - SWARM, conditions.swarm_bit[e, slot, i, choice[i] - SWARM]
            if constants.access == ONE_AT_A_TIME:
                usable = common
            elif constants.access == TDMA:
                usable = 1.0 / n
            else:
                usable = min(free[i], free[j]) if constants.half_duplex else free[i]
            usable = min(usable, spare[i] / constants.crosslink_J if constants.crosslink_J > 0.0 else 1.0)
            most, sent = min(np.int64(usable * capacity), room[j]), 0
            for k in conditions.order[e]:
                bits = min(state.hold[e, i, k], most - sent)
                state.hold[e, i, k] -= bits
                came[j, k] += bits
                sent += bits
            share = sent / capacity
            room[j] -= sent
            common, free[i] = common - share, free[i] - share
            if constants.half_duplex:
                free[j] -= share
            spare[i] = max(0.0, spare[i] - share * constants.crosslink_J)


@jittable
def _charge(
    constants: DownlinkConstants,
    conditions: Conditions,
    state: DownlinkState,
    e: int,
    choice: Ints,
    spare: Array,
    gains: Gains,
) -> None:
    """Settle the energy of the slot; `spare` is what was left after sending."""
    slot = state.slot[e]
    for i in range(choice.shape[0]):
        if not state.alive[e, i]:
            continue
        speaks = choice[i] == EARTH
        income = conditions.earth_J[e, slot, i] if speaks else conditions.sun_J[e, slot, i]
        unmet = max(0.0, -_energy(constants, conditions, state, e, i, choice[i]))
        after = min(constants.battery_J, spare[i])
        spilled = spare[i] - after
        state.brought_J[e, i] += income
        state.spent_J[e, i] += state.charge_J[e, i] + income - spare[i] + unmet
        state.spilled_J[e, i] += spilled
        state.unmet_J[e, i] += unmet
        state.charge_J[e, i] = after
        state.at_earth[e, i] = speaks
        if after <= NOTHING * constants.battery_J:
            gains.empty[e] += 0.0 if state.safe[e, i] else 1.0
            state.safe[e, i] = True
        elif after >= constants.restart_J:
            state.safe[e, i] = False


@jittable
def _arrive(conditions: Conditions, state: DownlinkState, e: int, gains: Gains) -> None:
    for k in range(state.status.shape[1]):
        if state.status[e, k] == OPEN and state.on_earth[e, k] == conditions.size[e, k]:
            state.status[e, k] = DELIVERED
            gains.delivered[e] += conditions.value[e, k]


@jittable
def _begin_slot(
    constants: DownlinkConstants, conditions: Conditions, state: DownlinkState, e: int, gains: Gains
) -> None:
    """Losses, what expires, and what is asked for, at the start of the slot."""
    slot, slots, n = state.slot[e], conditions.earth_bit.shape[1], state.alive.shape[1]
    for i in range(n):
        if state.alive[e, i] and conditions.lost_slot[e, i] <= slot and slot < slots:
            state.alive[e, i] = False
            state.spilled_J[e, i] += state.charge_J[e, i]
            state.charge_J[e, i] = 0.0
            for k in range(state.status.shape[1]):
                if state.hold[e, i, k] > 0:
                    _lapse(conditions, state, e, k, gains)
    for k in range(state.status.shape[1]):
        if state.status[e, k] == OPEN and conditions.expiry[e, k] <= slot:
            _lapse(conditions, state, e, k, gains)
    for k in conditions.order[e]:
        if state.status[e, k] == NEW and conditions.ready[e, k] <= slot and conditions.ready[e, k] < slots:
            i, size = conditions.origin[e, k], conditions.size[e, k]
            fits = state.alive[e, i] and _aboard(state, e, i) + size <= constants.storage_bit
            state.status[e, k] = OPEN
            state.made_bit[e] += size
            if fits:
                state.hold[e, i, k] = size
            else:
                state.lost_bit[e] += size
                _lapse(conditions, state, e, k, gains)


@jittable
def _lapse(conditions: Conditions, state: DownlinkState, e: int, k: int, gains: Gains) -> None:
    """Give a product up; what is aboard of it, wherever, is deleted."""
    state.status[e, k] = LAPSED
    gains.expired[e] += conditions.value[e, k]
    for i in range(state.hold.shape[1]):
        state.lost_bit[e] += state.hold[e, i, k]
        state.hold[e, i, k] = 0
