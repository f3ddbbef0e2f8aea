"""What moves in one slot over links that share time, in whole bits, compiled: the only place where data change hands.

To send b bits over a link that carries B in the slot takes the share b / B of it. Shares add up as `LinkRules` say: Earth
hears `channels` spacecraft at once; crosslinks share one channel, have a fixed part of the frame each, or are in use in
parallel. What is received is aboard at the end of the slot and can be sent on from the next one on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.dataflow.network import EARTH, Access
from swarm_mj.typing import Array, Ints

#: Receiver of those who send nothing.
NOBODY = -2
#: Share of a slot that rounding may take from what is left of it, given back so that no whole bit is lost to it.
ROUNDING = 1e-13
_ONE_AT_A_TIME, _TDMA = (list(Access).index(access) for access in (Access.ONE_AT_A_TIME, Access.TDMA))


class LinkRules(NamedTuple):
    """How links share time."""

    access: int  #: to the crosslink, the number of an `Access` in its order
    half_duplex: bool  #: whether a spacecraft on the crosslink sends or receives, but never both at once
    channels: float  #: how many spacecraft Earth hears at once


def link_rules(access: Access, *, half_duplex: bool, channels: float) -> LinkRules:
    """The rules by names, see `LinkRules`."""
    return LinkRules(list(Access).index(access), half_duplex, float(channels))


@kernel
def carry(
    rules: LinkRules,
    capacity: Ints,
    time_share: Array,
    to: Ints,
    queue: Ints,
    storage_bit: Ints,
    hold: Ints,
    moved: Ints,
) -> None:
    """Send what n spacecraft hold of K products: to Earth first, which makes room, then to each other.

    Args:
        rules: How links share time.
        capacity: Most that i could send to j in the whole slot, in the last column to Earth, shape (n, n + 1) [bit].
        time_share: Of the slot, for which each can send at most, shape (n,).
        to: To whom each sends: a spacecraft from 0, `EARTH` or `NOBODY`, shape (n,).
        queue: Sender and product, in the order of sending, shape (m, 2).
        storage_bit: Most that is aboard each, shape (n,).
        hold: Of each product aboard each spacecraft, brought to the end of the slot, shape (n, K) [bit].
        moved: Receives what is sent of each entry of the queue, shape (m,) [bit].
    """
    n = to.shape[0]
    sent, room = np.zeros(n, np.int64), storage_bit - hold.sum(axis=1)
    busy, earth_busy, channel_busy = np.zeros(n), 0.0, 0.0
    moved[:] = 0
    for earth_turn in (True, False):
        for q in range(queue.shape[0]):
            i, k = queue[q, 0], queue[q, 1]
            j = to[i]
            if j == NOBODY or (j == EARTH) != earth_turn or capacity[i, j] <= 0:
                continue
            used, left, bits = sent[i] / capacity[i, j], 1.0, hold[i, k]
            if earth_turn:
                left = rules.channels - earth_busy + used
            else:
                bits = min(bits, room[j])
                if rules.access == _ONE_AT_A_TIME:
                    left = 1.0 - channel_busy + used
                elif rules.access == _TDMA:
                    left = 1.0 / n
                else:
                    left = 1.0 - busy[i] + used
                    if rules.half_duplex:
                        left = min(left, 1.0 - busy[j] + used)
            left = min(1.0, left, time_share[i])
            bits = max(0, min(bits, np.int64((left + ROUNDING) * capacity[i, j]) - sent[i]))
            sent[i] += bits
            more = sent[i] / capacity[i, j] - used
            if earth_turn:
                earth_busy += more
            else:
                channel_busy += more
                busy[i] += more
                if rules.half_duplex:
                    busy[j] += more
                room[j] -= bits
            room[i] += bits
            hold[i, k] -= bits
            moved[q] = bits
    for q in range(queue.shape[0]):
        if to[queue[q, 0]] >= 0:
            hold[to[queue[q, 0]], queue[q, 1]] += moved[q]
