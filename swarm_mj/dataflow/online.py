"""What the swarm can do alone, knowing only the links that are closed now: nearest relay, most valuable first.

In each slot a spacecraft that is no relay sends to the next on its way to the nearest relay: the way over links that are
closed now on which a bit takes the least time. Relays send to Earth. All send the tiles of most area per bit first. Data are
stored and forwarded; a receiver takes no more than it has room for.

Assumed is that the swarm shares what is small beside pictures: inventories of who holds which tile, and who hears whom. So of
each tile one copy is on its way at a time: of those that can be completed over links closed now, the one of which most is on
Earth, then at relays, then the one that is there soonest. The others stay aboard; one takes over where the first is cut off.
Copies of tiles that are on Earth are deleted where storage may run short in a slot.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from swarm_mj.dataflow.account import ON_EARTH, SPACECRAFT_LOST, STORAGE_FULL, Account, Loss, Transfer
from swarm_mj.dataflow.network import EARTH, Access, Network
from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Ints, Mask


def run_online(network: Network, relays: Mask) -> Account:
    """Fly the policy.

    Args:
        network: What to deliver.
        relays: Who is a relay in each slot, shape (T, n).

    Raises:
        MissionError: The shape of relays does not fit.
    """
    expected = (network.n_slots, network.n_spacecraft)
    if relays.shape != expected:
        raise MissionError(f"relays: shape {relays.shape}, but must be {expected}: slots, spacecraft")
    swarm = _Swarm(network)
    for slot in range(network.n_slots):
        swarm.begin(slot)
        swarm.send(slot, relays[slot] & (slot < network.lost_slot))
    return swarm.account()


class _Routes(NamedTuple):
    """Ways to the relays in one slot.

    Attributes:
        relay: Who is one, shape (n,).
        following: Next on the way to the nearest relay, below 0 where there is none, shape (n,).
        seconds: What a bit takes on the way in parts of a slot, 0 for relays, infinity where there is none, shape (n,).
    """

    relay: Mask
    following: Ints
    seconds: Array


class _Swarm:
    """Who holds how much of each copy.

    A copy is a tile as its origin has it; parts of it may be aboard several spacecraft.
    """

    def __init__(self, network: Network) -> None:
        self.network = network
        self.links, self.to_earth = network.open_links()
        self.origin, self.tile = np.nonzero(network.seen)
        self.size = network.bits[self.origin, self.tile]
        self.ready = network.ready[self.origin, self.tile]
        #: Most valuable first.
        self.order = np.lexsort((self.origin, self.tile, -network.value[self.tile] / self.size))
        self.rank = np.argsort(self.order)
        self.held = np.zeros((network.n_spacecraft, len(self.size)), np.int64)
        self.on_earth = np.zeros(len(self.size), np.int64)
        self.delivered_slot = np.full(network.n_tiles, network.n_slots, np.int64)
        self.transfers: list[Transfer] = []
        self.losses: list[Loss] = []
        self.aboard: list[Ints] = []

    def begin(self, slot: int) -> None:
        """Losses and new pictures at the start of a slot."""
        network = self.network
        for i in np.flatnonzero(network.lost_slot == slot).tolist():
            self._lose(slot, i, np.flatnonzero(self.held[i]), SPACECRAFT_LOST)
        new = np.flatnonzero(self.ready == slot)
        asked = np.bincount(self.origin[new], self.size[new], network.n_spacecraft) + network.swarm_bit[slot].sum(
            axis=0
        )
        arrived = self.delivered_slot[self.tile] < network.n_slots
        for i in np.flatnonzero(self.held.sum(axis=1) + asked > network.storage_bit).tolist():
            self._lose(slot, i, np.flatnonzero((self.held[i] > 0) & arrived), ON_EARTH)
        room = network.storage_bit - self.held.sum(axis=1)
        for copy in new[np.argsort(self.rank[new])].tolist():
            i = int(self.origin[copy])
            self.held[i, copy] = self.size[copy]
            if network.lost_slot[i] <= slot:
                self._lose(slot, i, np.array([copy]), SPACECRAFT_LOST)
            elif self.size[copy] > room[i]:
                self._lose(slot, i, np.array([copy]), STORAGE_FULL)
            else:
                room[i] -= self.size[copy]
        self.aboard.append(self.held.sum(axis=1))

    def _lose(self, slot: int, spacecraft: int, copies: Ints, reason: str) -> None:
        for copy in copies.tolist():
            bits = int(self.held[spacecraft, copy])
            self.losses.append(Loss(slot, spacecraft, int(self.origin[copy]), int(self.tile[copy]), bits, reason))
            self.held[spacecraft, copy] = 0

    def send(self, slot: int, relay: Mask) -> None:
        """Everything that is sent in a slot; it was aboard at its start."""
        routes = _routes(self.links[slot], relay)
        underway = np.flatnonzero(self._underway(routes))
        holder, place = np.nonzero(self.held[:, underway])
        copy = underway[place]
        first = np.lexsort((holder, self.rank[copy]))
        queue = np.stack([holder[first], copy[first]], axis=1)
        room = self.network.storage_bit - self.held.sum(axis=1)
        to_earth = self._send_to_earth(slot, queue[relay[queue[:, 0]]].tolist(), room)
        inside = self._send_inside(slot, queue[routes.following[queue[:, 0]] >= 0].tolist(), room, routes)
        for part, sent in to_earth:
            self.on_earth[part] += sent.bits
            if self.on_earth[part] == self.size[part]:
                self.delivered_slot[sent.tile] = slot
        for part, sent in inside:
            self.held[sent.receiver, part] += sent.bits
        self.transfers += [sent for _, sent in (*to_earth, *inside)]

    def _send_to_earth(self, slot: int, queue: list[list[int]], room: Ints) -> list[tuple[int, Transfer]]:
        turns, capacity = _Turns(), self.to_earth[slot].tolist()
        sent: list[tuple[int, Transfer]] = []
        for i, copy in queue:
            if (i, EARTH) in turns.over:
                continue
            limits = [(i, Fraction(1)), (EARTH, Fraction(self.network.earth_channels))]
            bits = turns.take(limits, int(self.held[i, copy]), (i, EARTH), capacity[i])
            if bits:
                sent.append((copy, self._remove(slot, i, EARTH, copy, bits)))
                room[i] += bits
        return sent

    def _send_inside(
        self, slot: int, queue: list[list[int]], room: Ints, routes: _Routes
    ) -> list[tuple[int, Transfer]]:
        turns, following = _Turns(), routes.following.tolist()
        sent: list[tuple[int, Transfer]] = []
        for i, copy in queue:
            j = following[i]
            if (i, j) in turns.over:
                continue
            fits = min(int(self.held[i, copy]), int(room[j]))
            bits = turns.take(_limits(self.network, i, j), fits, (i, j), int(self.links[slot, i, j]))
            if bits:
                sent.append((copy, self._remove(slot, i, j, copy, bits)))
                room[i] += bits
                room[j] -= bits
        return sent

    def _remove(self, slot: int, sender: int, receiver: int, copy: int, bits: int) -> Transfer:
        self.held[sender, copy] -= bits
        return Transfer(slot, sender, receiver, int(self.origin[copy]), int(self.tile[copy]), bits)

    def _underway(self, routes: _Routes) -> Mask:
        """Which copy of each tile is on its way, shape (copies,)."""
        there = self.on_earth + self.held[routes.relay].sum(axis=0)
        within_reach = np.isfinite(routes.seconds)
        complete = self.on_earth + self.held[within_reach].sum(axis=0) == self.size
        soon = np.where(within_reach, routes.seconds, 0.0)[self.origin] * self.size
        best = np.lexsort((self.origin, soon, -there / self.size, -self.on_earth / self.size, ~complete, self.tile))
        _, first = np.unique(self.tile[best], return_index=True)
        chosen = np.zeros(len(self.size), np.bool_)
        chosen[best[first]] = True
        return chosen & (self.delivered_slot[self.tile] == self.network.n_slots)

    def account(self) -> Account:
        """After the last slot."""
        network = self.network
        earth, lost = np.zeros((2, network.n_slots + 1), np.int64)
        for sent in self.transfers:
            earth[sent.slot + 1] += sent.bits * (sent.receiver == EARTH)
        for loss in self.losses:
            lost[loss.slot] += loss.bits
        return Account(
            aboard_bit=np.stack([*self.aboard, self.held.sum(axis=1)]),
            on_earth_bit=earth.cumsum(),
            lost_bit=lost.cumsum(),
            delivered_slot=self.delivered_slot,
            value=float(network.value[self.delivered_slot < network.n_slots].sum()),
            transfers=tuple(self.transfers),
            losses=tuple(self.losses),
        )


def _routes(links: Ints, relay: Mask) -> _Routes:
    """Ways of least time to the nearest relay, found from the relays backwards."""
    n = len(relay)
    if not relay.any():
        return _Routes(relay, np.full(n, -1), np.full(n, np.inf))
    sender, receiver = np.nonzero(links)
    backwards = csr_array((1.0 / links[sender, receiver], (receiver, sender)), shape=(n, n))
    seconds, following, _ = dijkstra(backwards, indices=np.flatnonzero(relay), min_only=True, return_predecessors=True)
    return _Routes(relay, following.astype(np.int64), seconds)


def _limits(network: Network, i: int, j: int) -> list[tuple[Hashable, Fraction]]:
    """The limits of time in which a crosslink from i to j takes part."""
    if network.access is Access.ONE_AT_A_TIME:
        return [("channel", Fraction(1))]
    if network.access is Access.TDMA:
        return [(i, Fraction(1, network.n_spacecraft))]
    return [(i, Fraction(1)), (j, Fraction(1))] if network.half_duplex else [(i, Fraction(1))]


class _Turns:
    """What is left of each limit of time in a slot, exactly."""

    def __init__(self) -> None:
        self.left: dict[Hashable, Fraction] = {}
        self.over: set[tuple[int, int]] = set()

    def take(self, limits: Iterable[tuple[Hashable, Fraction]], bits: int, link: tuple[int, int], capacity: int) -> int:
        """As many of the bits as there is time for, over a link that carries `capacity` in the whole slot.

        The link is `over` when there is time for no more.
        """
        if bits <= 0:
            return 0
        left = {name: self.left.get(name, whole) for name, whole in limits}
        most = int(min(left.values()) * capacity)
        if most <= bits:
            self.over.add(link)
        bits = min(bits, most)
        if bits:
            self.left.update({name: share - Fraction(bits, capacity) for name, share in left.items()})
        return bits
