"""What the swarm can do alone, knowing only the links that are closed now: nearest relay, most valuable first.

What became of every bit is told by an `Account`: aboard, on Earth or lost, and why.

In each slot a spacecraft that is no relay sends to the next on its way to the nearest relay: the way over links that are
closed now on which a bit takes the least time. Relays send to Earth. All send the tiles of most area per bit first. Data are
stored and forwarded; a receiver takes no more than it has room for.

Assumed is that the swarm shares what is small beside pictures: inventories of who holds which tile, and who hears whom. So of
each tile one copy is on its way at a time: of those that can be completed over links closed now, the one of the
finest grade of ground sampling distance, then that of which most is on Earth, then at relays, then the one that is there
soonest. The others stay aboard; one takes over where the first is cut off. A finer copy that comes up later, or can be
completed only then, follows a coarser one that is on Earth already, after all tiles of which nothing is there, and replaces it.
Copies of tiles that are on Earth are deleted where storage may run short in a slot.

A swarm that exchanges no messages shares none of that: each sends all that it took itself, whatever others hold or have sent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from swarm_mj.dataflow.network import EARTH, Network
from swarm_mj.dataflow.tiles import grade
from swarm_mj.dataflow.transfer import NOBODY, carry, link_rules
from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Ints, Mask

#: Why data are lost: their spacecraft is, there is no room for a new picture, or a copy made room since its tile is on Earth.
SPACECRAFT_LOST = "spacecraft lost"
STORAGE_FULL = "storage full"
ON_EARTH = "tile on Earth"


class Transfer(NamedTuple):
    """Bits that were sent in a slot."""

    slot: int  #: when
    sender: int  #: spacecraft that sends
    receiver: int  #: spacecraft that receives, -1 for Earth
    origin: int  #: spacecraft whose copy of the tile it is
    tile: int
    bits: int  #: how many [bit]


class Loss(NamedTuple):
    """Bits that were lost at the start of a slot."""

    slot: int  #: when
    spacecraft: int  #: where they were
    origin: int  #: spacecraft whose copy of the tile it was
    tile: int
    bits: int  #: how many [bit]
    reason: str  #: 'spacecraft lost', 'storage full' (a new picture), or 'tile on Earth' (a copy that made room)


@dataclass(frozen=True, eq=False, kw_only=True)
class Account:
    """What became of the pictures of a network of n spacecraft, q tiles and T slots."""

    aboard_bit: Ints  #: bits aboard at each edge, shape (T + 1, n)
    on_earth_bit: Ints  #: bits on Earth at each edge, shape (T + 1,)
    lost_bit: Ints  #: bits lost up to each edge, shape (T + 1,)
    #: slot in which the last bit of the finest copy of a tile that arrives comes to Earth, T where none does, shape (q,)
    delivered_slot: Ints
    delivered_origin: Ints  #: spacecraft whose copy that is, -1 where none is complete, shape (q,)
    value: float  #: area of the delivered tiles [m^2]
    transfers: tuple[Transfer, ...]  #: by slot
    losses: tuple[Loss, ...]  #: by slot


def run_online(network: Network, relays: Mask, *, shared: bool = True) -> Account:
    """Fly the policy.

    Args:
        network: What to deliver.
        relays: Who is a relay in each slot, shape (T, n).
        shared: Whether all know who holds which tile, and what is on Earth.

    Raises:
        MissionError: The shape of relays does not fit.
    """
    expected = (network.n_slots, network.n_spacecraft)
    if relays.shape != expected:
        raise MissionError(f"relays: shape {relays.shape}, but must be {expected}: slots, spacecraft")
    swarm = _Swarm(network, shared=shared)
    for slot in range(network.n_slots):
        swarm.begin(slot)
        swarm.send(slot, relays[slot] & (slot < network.lost_slot))
    return swarm.account()


class _Routes(NamedTuple):
    """Ways to the relays in one slot."""

    relay: Mask  #: who is one, shape (n,)
    following: Ints  #: next on the way to the nearest relay, below 0 where there is none, shape (n,)
    #: what a bit takes on the way in parts of a slot, 0 for relays, infinity where there is none, shape (n,)
    seconds: Array


class _Swarm:
    """Who holds how much of each copy.

    A copy is a tile as its origin has it; parts of it may be aboard several spacecraft.
    """

    def __init__(self, network: Network, *, shared: bool) -> None:
        self.network, self.shared = network, shared
        links, to_earth = network.open_links()
        self.capacity = np.concatenate([links, to_earth[:, :, None]], axis=2)
        self.rules = link_rules(network.access, half_duplex=network.half_duplex, channels=network.earth_channels)
        self.origin, self.tile = np.nonzero(network.seen)
        self.size = network.bits[self.origin, self.tile]
        self.ready = network.ready[self.origin, self.tile]
        #: Most valuable first.
        self.order = np.lexsort((self.origin, self.tile, -network.value[self.tile] / self.size))
        self.rank = np.argsort(self.order)
        self.held = np.zeros((network.n_spacecraft, len(self.size)), np.int64)
        self.on_earth = np.zeros(len(self.size), np.int64)
        self.delivered_slot = np.full(network.n_tiles, network.n_slots, np.int64)
        self.delivered_origin = np.full(network.n_tiles, -1, np.int64)
        self.delivered_grade = np.full(network.n_tiles, np.inf)
        self.grade = grade(network.gsd_m[self.origin, self.tile])
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
        arrived = self.grade >= self._known_grade[self.tile]
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
        routes = _routes(self.capacity[slot, :, :-1], relay)
        to = np.where(relay, EARTH, np.where(routes.following >= 0, routes.following, NOBODY))
        underway = np.flatnonzero(self._underway(routes))
        holder, place = np.nonzero(self.held[:, underway])
        copy = underway[place]
        again = np.isfinite(self._known_grade[self.tile[copy]])
        queue = np.column_stack([holder, copy])[np.lexsort((holder, self.rank[copy], again))]
        moved, everybody = np.zeros(len(queue), np.int64), np.ones(len(relay))
        carry(self.rules, self.capacity[slot], everybody, to, queue, self.network.storage_bit, self.held, moved)
        inside = to[queue[:, 0]] != EARTH
        for q in np.argsort(inside, kind="stable").tolist():
            if moved[q]:
                self._record(slot, int(to[queue[q, 0]]), *queue[q].tolist(), bits=int(moved[q]))

    def _record(self, slot: int, receiver: int, sender: int, copy: int, *, bits: int) -> None:
        tile = int(self.tile[copy])
        self.transfers.append(Transfer(slot, sender, receiver, int(self.origin[copy]), tile, bits))
        if receiver == EARTH:
            self.on_earth[copy] += bits
            if self.on_earth[copy] == self.size[copy] and self.grade[copy] < self.delivered_grade[tile]:
                self.delivered_slot[tile], self.delivered_origin[tile] = slot, self.origin[copy]
                self.delivered_grade[tile] = self.grade[copy]

    @property
    def _known_grade(self) -> Array:
        """Of the finest copy of each tile that the swarm knows to be on Earth, infinite for none, shape (q,)."""
        return self.delivered_grade if self.shared else np.full(self.network.n_tiles, np.inf)

    def _underway(self, routes: _Routes) -> Mask:
        """Which copy of each tile is on its way, shape (copies,): all, where nobody knows of the others'."""
        if not self.shared:
            return np.ones(len(self.size), np.bool_)
        there = self.on_earth + self.held[routes.relay].sum(axis=0)
        within_reach = np.isfinite(routes.seconds)
        complete = self.on_earth + self.held[within_reach].sum(axis=0) == self.size
        soon = np.where(within_reach, routes.seconds, 0.0)[self.origin] * self.size
        better = self.grade < self.delivered_grade[self.tile]
        sent, at_relays = self.on_earth / self.size, there / self.size
        best = np.lexsort((self.origin, soon, -at_relays, -sent, self.grade, ~complete, ~better, self.tile))
        _, first = np.unique(self.tile[best], return_index=True)
        chosen = np.zeros(len(self.size), np.bool_)
        chosen[best[first]] = True
        return chosen & better

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
            delivered_origin=self.delivered_origin,
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
