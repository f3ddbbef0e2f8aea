"""Where every bit is: aboard, on Earth, or lost, slot by slot; what is seen is the sum of the three."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from swarm_mj.dataflow.network import EARTH, Network
from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Ints

#: Why data are lost: their spacecraft is, there is no room for a new picture, or a copy made room since its tile is on Earth.
SPACECRAFT_LOST = "spacecraft lost"
STORAGE_FULL = "storage full"
ON_EARTH = "tile on Earth"


class Transfer(NamedTuple):
    """Bits that were sent in a slot.

    Attributes:
        slot: When.
        sender: Spacecraft that sends.
        receiver: Spacecraft that receives, -1 for Earth.
        origin: Spacecraft whose copy of the tile it is.
        tile: Tile.
        bits: How many [bit].
    """

    slot: int
    sender: int
    receiver: int
    origin: int
    tile: int
    bits: int


class Loss(NamedTuple):
    """Bits that were lost at the start of a slot.

    Attributes:
        slot: When.
        spacecraft: Where they were.
        origin: Spacecraft whose copy of the tile it was.
        tile: Tile.
        bits: How many [bit].
        reason: 'spacecraft lost', 'storage full' (a new picture), or 'tile on Earth' (a copy that made room).
    """

    slot: int
    spacecraft: int
    origin: int
    tile: int
    bits: int
    reason: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Account:
    """What became of the pictures of a network of n spacecraft, q tiles and T slots.

    Attributes:
        aboard_bit: Bits aboard at each edge, shape (T + 1, n).
        on_earth_bit: Bits on Earth at each edge, shape (T + 1,).
        lost_bit: Bits lost up to each edge, shape (T + 1,).
        delivered_slot: Slot in which the last bit of the finest copy of a tile that arrives comes to Earth, T where none does,
            shape (q,).
        delivered_origin: Spacecraft whose copy that is, -1 where none is complete, shape (q,).
        value: Area of the delivered tiles [m^2].
        transfers: By slot.
        losses: By slot.
    """

    aboard_bit: Ints
    on_earth_bit: Ints
    lost_bit: Ints
    delivered_slot: Ints
    delivered_origin: Ints
    value: float
    transfers: tuple[Transfer, ...]
    losses: tuple[Loss, ...]

    @property
    def delivered(self) -> Ints:
        """Tiles that are on Earth, ascending."""
        return np.flatnonzero(self.delivered_slot < len(self.on_earth_bit) - 1)

    def value_over_time(self, network: Network) -> Array:
        """Area on Earth at each edge [m^2], shape (T + 1,)."""
        arrivals = np.bincount(self.delivered_slot + 1, network.value, minlength=network.n_slots + 2)
        return arrivals[: network.n_slots + 1].cumsum()


def seen_bit(network: Network) -> Ints:
    """Bits of all pictures taken up to each edge, shape (T + 1,)."""
    seen = network.seen
    taken = np.zeros(network.n_slots + 1, np.int64)
    np.add.at(taken, network.ready[seen], network.bits[seen])
    return taken.cumsum()


def check_conservation(account: Account, network: Network) -> None:
    """Check that at every edge seen = delivered + aboard + lost, to the bit, and that transfers and losses tell the same.

    Raises:
        MissionError: A bit is missing or appears from nowhere; the message says at which edge.
    """
    total = account.on_earth_bit + account.aboard_bit.sum(axis=1) + account.lost_bit
    _equal("seen = delivered + aboard + lost", total, seen_bit(network))
    earth, lost = np.zeros_like(account.on_earth_bit), np.zeros_like(account.lost_bit)
    change = np.zeros_like(account.aboard_bit)
    seen = network.seen
    np.add.at(change, (network.ready[seen], np.nonzero(seen)[0]), network.bits[seen])
    for sent in account.transfers:
        change[sent.slot + 1, sent.sender] -= sent.bits
        if sent.receiver == EARTH:
            earth[sent.slot + 1] += sent.bits
        else:
            change[sent.slot + 1, sent.receiver] += sent.bits
    for loss in account.losses:
        lost[loss.slot] += loss.bits
        change[loss.slot, loss.spacecraft] -= loss.bits
    _equal("delivered bits and transfers to Earth", account.on_earth_bit, earth.cumsum())
    _equal("lost bits and losses", account.lost_bit, lost.cumsum())
    for i in range(network.n_spacecraft):
        _equal(
            f"bits aboard spacecraft {i}, its pictures, transfers and losses",
            account.aboard_bit[:, i],
            change[:, i].cumsum(),
        )


def _equal(what: str, one: Ints, other: Ints) -> None:
    if (one != other).any():
        edge = int(np.flatnonzero(one != other)[0])
        raise MissionError(
            f"{what} differ at edge {edge}: {one[edge]} and {other[edge]} bit; the account is not complete"
        )
