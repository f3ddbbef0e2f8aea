"""A delivery problem: who can send how much to whom in which slot, and who has what to send.

Slot t lasts from `edges_s[t]` to `edges_s[t + 1]`. What is sent in it is aboard the receiver at its end, so that it can be sent
on from slot t + 1. To send b bits over a link whose slot holds B takes the share b / B of the slot; `Access` says how shares
add up. Earth is heard by another radio, which may send while the crosslink is in use.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Ints, Mask

#: Receiver that stands for Earth in lists of transfers.
EARTH = -1


class Access(StrEnum):
    """How the spacecraft share the crosslink."""

    #: One channel, one transmitter at a time: the shares of all crosslinks add up to at most 1.
    ONE_AT_A_TIME = "one_at_a_time"
    #: Each of n spacecraft has 1/n of the frame as transmitter, whether it needs it or not.
    TDMA = "tdma"
    #: A channel for each link; a transmitter still sends one thing at a time.
    PARALLEL = "parallel"


@dataclass(frozen=True, eq=False, kw_only=True)
class Network:
    """A delivery problem of n spacecraft, q tiles and T slots."""

    edges_s: Array  #: edges of the slots, ascending [s], shape (T + 1,)
    swarm_bit: Ints  #: most that spacecraft i can send to j in a slot if it sends all the time [bit], shape (T, n, n)
    earth_bit: Ints  #: most that Earth can receive from i in a slot [bit], shape (T, n)
    storage_bit: Ints  #: most that is aboard a spacecraft at any edge [bit], shape (n,)
    access: Access  #: how the crosslink is shared
    half_duplex: bool  #: whether a spacecraft on the crosslink sends or receives, but never both at once
    earth_channels: int  #: how many spacecraft Earth hears at once
    value: Array  #: area of each tile [m^2], shape (q,)
    bits: Ints  #: size of the tile as spacecraft i has it [bit], 0 where it has it not, shape (n, q)
    ready: Ints  #: slot from whose start it is aboard, T where never, shape (n, q)
    #: ground sampling distance of each copy [m], which tells the better of several; none: all are as good, shape (n, q)
    gsd_m: Array = field(default_factory=lambda: np.empty(0))
    #: slot from whose start a spacecraft and all that is aboard is lost, T for never, shape (n,)
    lost_slot: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    #: after how many slots what is received can be sent on: 1, or 0 in a relaxation that bounds schedules of shorter slots,
    #: whose storage is limited at the edges alone
    delay: int = 1

    def __post_init__(self) -> None:
        """Fill in that nobody is lost, and check.

        Raises:
            MissionError: An array does not fit; the message names it.
        """
        if not self.lost_slot.size:
            object.__setattr__(self, "lost_slot", np.full(self.n_spacecraft, self.n_slots, np.int64))
        if not self.gsd_m.size:
            object.__setattr__(self, "gsd_m", np.ones(self.bits.shape))
        object.__setattr__(self, "access", _access(self.access))
        _check(self)

    @property
    def n_slots(self) -> int:
        """Number of slots."""
        return len(self.edges_s) - 1

    @property
    def n_spacecraft(self) -> int:
        """Number of spacecraft."""
        return len(self.storage_bit)

    @property
    def n_tiles(self) -> int:
        """Number of tiles."""
        return len(self.value)

    @property
    def seen(self) -> Mask:
        """Whose pictures show a tile within the window, shape (n, q)."""
        return (self.bits > 0) & (self.ready < self.n_slots)

    @property
    def kept(self) -> Mask:
        """Which copies are aboard at least once: seen, and not lost with their spacecraft before, shape (n, q)."""
        return self.seen & (self.ready < self.lost_slot[:, None])

    @property
    def seen_value(self) -> float:
        """Area that was seen [m^2]."""
        return float(self.value[self.seen.any(axis=0)].sum())

    def open_links(self) -> tuple[Ints, Ints]:
        """Capacities between spacecraft, shape (T, n, n), and to Earth, shape (T, n), without those of lost spacecraft."""
        alive = np.arange(self.n_slots)[:, None] < self.lost_slot
        return np.where(alive[:, :, None] & alive[:, None, :], self.swarm_bit, 0), np.where(alive, self.earth_bit, 0)

    def until(self, n_slots: int) -> Network:
        """The same problem with a window of the first `n_slots` slots, at least one."""
        if not 1 <= n_slots <= self.n_slots:
            raise MissionError(f"n_slots = {n_slots}: must lie between 1 and {self.n_slots}, the slots of the network")
        return replace(
            self,
            edges_s=self.edges_s[: n_slots + 1],
            swarm_bit=self.swarm_bit[:n_slots],
            earth_bit=self.earth_bit[:n_slots],
            ready=np.minimum(self.ready, n_slots),
            lost_slot=np.minimum(self.lost_slot, n_slots),
        )


def _access(given: str) -> Access:
    try:
        return Access(given)
    except ValueError:
        allowed = ", ".join(access.value for access in Access)
        raise MissionError(f"access = {given!r}: must be one of {allowed}") from None


def _check(network: Network) -> None:
    """Shapes, types and ranges.

    Raises:
        MissionError: One is wrong.
    """
    n, q, t = network.n_spacecraft, network.n_tiles, network.n_slots
    _check_shapes(network, n, q, t)
    if not (np.isfinite(network.edges_s).all() and (np.diff(network.edges_s) > 0).all()):
        raise MissionError("edges_s: must be finite and ascending; leave out slots that last no time")
    wrong = np.flatnonzero(~(np.isfinite(network.value) & (network.value >= 0)))
    if wrong.size:
        raise MissionError(f"value[{wrong[0]}] = {network.value[wrong[0]]}: must be finite and not negative [m^2]")
    for name in ("swarm_bit", "earth_bit", "storage_bit", "bits"):
        _check_range(name, getattr(network, name), 0, None)
    for name in ("ready", "lost_slot"):
        _check_range(name, getattr(network, name), 0, t)
    if network.swarm_bit[:, np.arange(n), np.arange(n)].any():
        raise MissionError("swarm_bit: a spacecraft sends to itself; set its diagonal to 0")
    if network.earth_channels < 1:
        raise MissionError(f"earth_channels = {network.earth_channels}: must be at least 1, or Earth hears nobody")


def _check_shapes(network: Network, n: int, q: int, t: int) -> None:
    if n < 1 or t < 1:
        raise MissionError(f"storage_bit, edges_s: {n} spacecraft and {t} slots; at least one of each is needed")
    shapes = {
        "edges_s": (t + 1,),
        "swarm_bit": (t, n, n),
        "earth_bit": (t, n),
        "storage_bit": (n,),
        "value": (q,),
        "bits": (n, q),
        "ready": (n, q),
        "lost_slot": (n,),
    }
    for name, shape in shapes.items():
        array = getattr(network, name)
        if array.shape != shape:
            raise MissionError(
                f"{name}: shape {array.shape}, but must be {shape} for {n} spacecraft, {q} tiles, {t} slots"
            )
        if name not in ("edges_s", "value") and array.dtype != np.int64:
            raise MissionError(f"{name}: numbers of type {array.dtype}, but must be whole: give an array of int64")


def _check_range(name: str, array: Ints, least: int, most: int | None) -> None:
    wrong = (array < least) | (array > (np.iinfo(np.int64).max if most is None else most))
    if wrong.any():
        place = tuple(int(i) for i in np.argwhere(wrong)[0])
        upper = "" if most is None else f" and at most {most}, which stands for never"
        raise MissionError(f"{name}[{', '.join(map(str, place))}] = {array[place]}: must be at least {least}{upper}")
