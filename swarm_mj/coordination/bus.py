"""Messages between spacecraft: sent over the links that are closed, counted in bits, late, and lost by chance.

A message goes to all neighbours at once, at the slowest rate that all of them hear. While it is sent the channel is busy, for
the whole swarm or for its sender, as the scenario's `link.crosslink.access` says; another message waits.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from swarm_mj.coordination.graph import Graph
from swarm_mj.dataflow.network import Access
from swarm_mj.typing import Array, Ints


@dataclass(eq=False, kw_only=True)
class MessageLog:
    """What the messages of a flight came to, for its telemetry."""

    time_s: list[float] = field(default_factory=list)  #: of each entry [s]
    bits: list[Ints] = field(default_factory=list)  #: sent by each up to then [bit]
    airtime_s: list[Array] = field(default_factory=list)  #: for how long each has sent up to then [s]

    def note(self, t: float, bus: Bus) -> None:
        """Add what was sent by a time [s]."""
        self.time_s.append(t)
        self.bits.append(bus.bits.copy())
        self.airtime_s.append(bus.airtime_s.copy())

    def sent_by(self, times: Array, n: int) -> tuple[Ints, Array]:
        """Bits and airtime [s] of n spacecraft by some times [s], each of shape (len(times), n)."""
        entries = np.searchsorted(self.time_s, times + 1e-6)
        bits, airtime_s = [np.zeros(n, np.int64), *self.bits], [np.zeros(n), *self.airtime_s]
        return np.array(bits)[entries], np.array(airtime_s)[entries]


class Message(NamedTuple):
    """A message on its way to one receiver."""

    arrives_s: float  #: when it is there [s]
    number: int  #: in the order of sending
    sender: int  #: who says it, from 0
    receiver: int  #: who hears it
    payload: Any  #: what it says; nobody may change it


@dataclass(eq=False)
class Bus:
    """The messages of one flight.

    Args:
        n: Number of spacecraft.
        rng: Says which messages are lost.
        access: How the channel is shared, see `Access`.

    Attributes:
        bits: Sent by each so far, shape (n,) [bit].
        airtime_s: For how long each has sent so far, shape (n,) [s].
        sent: Messages to one receiver so far, those that were lost too.
        lost: Of these, lost on the way.
    """

    n: int
    rng: np.random.Generator
    access: Access = Access.ONE_AT_A_TIME
    bits: Ints = field(init=False)
    airtime_s: Array = field(init=False)
    sent: int = field(init=False, default=0)
    lost: int = field(init=False, default=0)
    _queue: list[Message] = field(init=False, default_factory=list)
    _free_s: Array = field(init=False)

    def __post_init__(self) -> None:
        """Nothing has been said."""
        self.bits, self.airtime_s, self._free_s = np.zeros(self.n, np.int64), np.zeros(self.n), np.zeros(self.n)

    def broadcast(self, t: float, sender: int, bits: int, payload: Any, graph: Graph) -> None:
        """Say something to all neighbours; without any nothing is sent.

        Args:
            t: Now [s].
            sender: Who says it.
            bits: How long it is [bit], more than 0.
            payload: What it says.
            graph: The links now.
        """
        receivers = np.flatnonzero(graph.links[sender])
        if not len(receivers):
            return
        takes_s = bits / float(graph.rate_bit_s[sender, receivers].min())
        share_s = takes_s * (self.n if self.access is Access.TDMA else 1)  # only each n-th part of the frame is its own
        busy = slice(None) if self.access is Access.ONE_AT_A_TIME else slice(sender, sender + 1)
        said_s = max(t, float(self._free_s[busy].max())) + share_s
        self._free_s[busy] = said_s
        self.bits[sender] += bits
        self.airtime_s[sender] += takes_s
        # One draw a receiver, heard or not, so that a flight with other losses draws alike.
        missed = self.rng.random(len(receivers)) < graph.loss[sender, receivers]
        for receiver, gone in zip(receivers.tolist(), missed.tolist(), strict=True):
            self.sent += 1
            self.lost += gone
            if not gone:
                arrives_s = said_s + float(graph.delay_s[sender, receiver])
                heapq.heappush(self._queue, Message(arrives_s, self.sent, sender, receiver, payload))

    def arrived(self, t: float) -> list[Message]:
        """Messages that are there by `t` [s], in the order of arrival; each is given once."""
        found = []
        while self._queue and self._queue[0].arrives_s <= t + 1e-9:
            found.append(heapq.heappop(self._queue))
        return found
