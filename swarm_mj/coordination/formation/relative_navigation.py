"""Relative navigation: where each spacecraft believes the others to be, by what it last heard of them and free flight since."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from swarm_mj.coordination.allocation.auction import STAMP_BITS
from swarm_mj.coordination.bus import Bus
from swarm_mj.coordination.graph import Graph
from swarm_mj.coordination.knowledge import HEAD_BITS
from swarm_mj.mission.trajectories import AccelerationN
from swarm_mj.spacecraft.control.force import ForceView
from swarm_mj.typing import Array, Ints, Mask

#: Place and velocity in single precision relative to the plan, which all know [bit].
STATE_BITS = 6 * 32
MESSAGE_BITS = HEAD_BITS + STAMP_BITS + STATE_BITS

Links = Callable[[ForceView], Graph]


class Fix(NamedTuple):
    """What a message says: when the sender was where, and how fast.

    Attributes:
        t: [s].
        r_N: Shape (3,) [m].
        v_N: Shape (3,) [m/s].
    """

    t: float
    r_N: Array
    v_N: Array


class RelativeNavigation:
    """What n spacecraft know of each other's motion during one flight; row i is what i knows.

    Args:
        bus: Carries the messages.
        gravity: By which they fly on in between.
        silence_s: After which one that is not heard of counts as lost [s].

    Attributes:
        heard_s: When j was where i last heard of it, shape (n, n) [s].
        r_N: Where i believes j to be now, shape (n, n, 3) [m].
        v_N: The same of the velocity, shape (n, n, 3) [m/s].
    """

    def __init__(self, bus: Bus, gravity: AccelerationN, silence_s: float) -> None:
        n = bus.n
        self.bus, self.gravity, self.silence_s = bus, gravity, silence_s
        self.heard_s, self.now = np.zeros((n, n)), np.nan
        self.r_N, self.v_N = np.zeros((n, n, 3)), np.zeros((n, n, 3))
        self._next_s = 0.0

    def alive(self, t: float) -> Mask:
        """Whom i does not take for lost, itself among them, shape (n, n)."""
        living: Mask = t - self.heard_s <= self.silence_s + 1e-9
        np.fill_diagonal(living, True)
        return living

    def leaders(self, t: float) -> Ints:
        """Whom each takes for the leader: the lowest number alive, shape (n,)."""
        return np.argmax(self.alive(t), axis=1)

    def listen(self, view: ForceView) -> None:
        """Bring what is believed up to now: fly on, take one's own state, hear what has arrived."""
        n, t = len(view.r_BN_N), view.t
        if np.isnan(self.now):
            # All leave together, and know it.
            self.r_N[:], self.v_N[:], self.heard_s[:] = view.r_BN_N, view.v_BN_N, t
        elif t > self.now:
            r, v = coast(self.gravity, self.now, t - self.now, self.r_N.reshape(-1, 3), self.v_N.reshape(-1, 3))
            self.r_N, self.v_N = r.reshape(n, n, 3), v.reshape(n, n, 3)
        self.now = t
        for message in self.bus.arrived(t):
            i, j, fix = message.receiver, message.sender, message.payload
            if view.working[i] and fix.t > self.heard_s[i, j]:
                r, v = coast(self.gravity, fix.t, t - fix.t, fix.r_N[None], fix.v_N[None])
                self.heard_s[i, j], self.r_N[i, j], self.v_N[i, j] = fix.t, r[0], v[0]
        own = np.arange(n)
        self.r_N[own, own], self.v_N[own, own], self.heard_s[own, own] = view.r_BN_N, view.v_BN_N, t

    def speak(self, view: ForceView, links: Links, every_s: float) -> None:
        """Everybody tells its place and velocity, when that is due."""
        if view.t < self._next_s - 1e-9:
            return
        self._next_s = (np.floor(view.t / every_s + 1e-9) + 1.0) * every_s
        graph = links(view)
        for j in np.flatnonzero(view.working).tolist():
            fix = Fix(view.t, view.r_BN_N[j].copy(), view.v_BN_N[j].copy())
            self.bus.broadcast(view.t, j, MESSAGE_BITS, fix, graph)


def coast(gravity: AccelerationN, t: float, span: float, r_N: Array, v_N: Array) -> tuple[Array, Array]:
    """Free flight over a short span: half a drift, a kick, half a drift, as the flight itself is stepped."""
    middle = r_N + 0.5 * span * v_N
    v = v_N + span * gravity(t + 0.5 * span, middle)
    return middle + 0.5 * span * v, v
