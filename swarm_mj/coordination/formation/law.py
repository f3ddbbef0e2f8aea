"""The force law that holds a formation: relative navigation, feedback, safe separation, pulses; docs/theory/formation.md."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from swarm_mj.coordination.allocation.auction import STAMP_BITS
from swarm_mj.coordination.bus import Bus, MessageLog
from swarm_mj.coordination.formation.separation import Moves, all_pairs, nearest_allowed, safe_moves, too_close_after
from swarm_mj.coordination.formation.structure import Structure
from swarm_mj.coordination.formation.tracking import Tracking, cut, in_pulses
from swarm_mj.coordination.graph import Graph
from swarm_mj.coordination.knowledge import HEAD_BITS
from swarm_mj.dataflow.network import Access
from swarm_mj.mission.trajectories import AccelerationN
from swarm_mj.spacecraft.control.force import ForceView
from swarm_mj.typing import Array, Ints, Mask

Reference = Literal["plan", "mean", "leader"]
Links = Callable[[ForceView], Graph]
#: Share of the thrust that is set aside for stopping; the rest is for differential gravity and for feedback.
BRAKING_SHARE = 0.5
#: Place and velocity in single precision relative to the plan, which all know [bit].
STATE_BITS = 6 * 32
MESSAGE_BITS = HEAD_BITS + STAMP_BITS + STATE_BITS


@dataclass(frozen=True, kw_only=True)
class Messaging:
    """How spacecraft tell each other where they are; only where the reference is not the plan."""

    every_s: float = 10.0  #: between messages [s]
    silence_s: float = 45.0  #: after which one that is not heard of counts as lost [s]
    seed: int = 0  #: of lost messages
    access: Access = Access.ONE_AT_A_TIME  #: of the channel


class Fix(NamedTuple):
    """What a message says: when the sender was where, and how fast."""

    t: float  #: [s]
    r_N: Array  #: shape (3,) [m]
    v_N: Array  #: shape (3,) [m/s]


class RelativeNavigation:
    """What n spacecraft know of each other's motion in flight, by what they last heard and free flight since; row i is i's.

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


@dataclass(eq=False, kw_only=True)
class FormationLog(MessageLog):
    """What a flight's formation came to, with an entry at each time at which messages were sent."""

    braked: Ints  #: how many periods each was braked for the sake of separation, shape (n,)
    #: when somebody took another for the leader: time [s], who, whom
    leaders: list[tuple[float, int, int]] = field(default_factory=list)


class FormationState:
    """One flight under way."""

    def __init__(self, view: ForceView, navigation: RelativeNavigation) -> None:
        n = len(view.mass)
        self.navigation, self.log = navigation, FormationLog(braked=np.zeros(n, np.int64))
        self.full_mass = view.mass
        self.leader: Ints = np.zeros(n, np.int64)
        self.working = np.zeros(n, np.bool_)  # outside its dead band
        self.intent, self.gained, self.pairs = np.zeros((n, 3)), view.delta_v_N, all_pairs(n)
        self.guarded = np.zeros(len(self.pairs), np.bool_)


class FormationLaw:
    """Holds a formation, see `ForceLaw`; the memory is its `FormationState`, brought up to date in place.

    Args:
        structure: Who should be where when.
        tracking: The feedback.
        links: Who can send to whom at an instant.
        force: Greatest of the thrusters in every direction [N].
        least_impulse: Of a pulse [N s].
        reference: 'plan', 'mean' of those heard of, or 'leader'.
        separation: That no pair may go below once it could be kept [m]; 0: nothing is done about it.
        messaging: For 'mean' and 'leader'.

    Attributes:
        log: Of the last flight.
    """

    def __init__(
        self,
        structure: Structure,
        tracking: Tracking,
        links: Links,
        *,
        force: float,
        least_impulse: float,
        reference: Reference = "plan",
        separation: float = 0.0,
        messaging: Messaging | None = None,
    ) -> None:
        self.structure, self.tracking, self.links = structure, tracking, links
        self.force, self.least_impulse = force, least_impulse
        self.reference, self.separation, self.messaging = reference, separation, messaging or Messaging()
        self.log: FormationLog | None = None

    def forces(self, view: ForceView, memory: FormationState | None) -> tuple[Array, FormationState]:
        """See `ForceLaw`."""
        state = self._begin(view) if memory is None else memory
        self.log = state.log
        if self.reference != "plan":
            self._talk(state, view)
        t, structure = view.t, self.structure
        if t < structure.start_s - 1e-9:
            state.intent = np.zeros_like(state.intent)
            self._guard(state, self._moves(state, view, self._most(view)))
            return np.zeros_like(view.r_BN_N), state
        most = self._most(view)
        wish = self._track(state, view, most)
        wish = self._keep_apart(state, view, wish, most) if self.separation > 0.0 else wish
        owed = state.intent - (view.delta_v_N - state.gained)
        state.gained, least = view.delta_v_N, self.least_impulse / view.mass
        asked, state.intent = in_pulses(cut(wish, most) * view.period, owed, least)
        asked[most == 0.0], state.intent[most == 0.0] = 0.0, 0.0
        return asked * (view.mass / view.period)[:, None], state

    def _begin(self, view: ForceView) -> FormationState:
        bus = Bus(len(view.mass), np.random.default_rng(self.messaging.seed), self.messaging.access)
        return FormationState(view, RelativeNavigation(bus, self.structure.gravity, self.messaging.silence_s))

    def _talk(self, state: FormationState, view: ForceView) -> None:
        navigation = state.navigation
        navigation.listen(view)
        sent = navigation.bus.sent
        navigation.speak(view, self.links, self.messaging.every_s)
        if navigation.bus.sent > sent:
            state.log.note(view.t, navigation.bus)
        leaders = navigation.leaders(view.t)
        if self.reference == "leader":
            for i in np.flatnonzero((leaders != state.leader) & view.working).tolist():
                state.log.leaders.append((view.t, i, int(leaders[i])))
        state.leader = leaders

    def _most(self, view: ForceView) -> Array:
        """Acceleration that thrusters give, shape (n,) [m/s^2]; 0 for those that cannot push."""
        return np.where(view.working & (view.propellant > 0.0), self.force / view.mass, 0.0)

    def shift(self, state: FormationState, view: ForceView) -> tuple[Array, Array]:
        """How far the whole formation is from its planned place, as each sees it: place and velocity, shape (n, 3)."""
        if self.reference == "plan":
            return np.zeros_like(view.r_BN_N), np.zeros_like(view.v_BN_N)
        r, v = self.structure.states(view.t)
        navigation = state.navigation
        if self.reference == "mean":
            weight = navigation.alive(view.t).astype(np.float64)
        else:
            weight = np.eye(len(r))[state.leader]
        weight /= weight.sum(axis=1, keepdims=True)
        by_place = np.einsum("ij,ijk->ik", weight, navigation.r_N - r)
        return by_place, np.einsum("ij,ijk->ik", weight, navigation.v_N - v)

    def _track(self, state: FormationState, view: ForceView, most: Array) -> Array:
        """Accelerations by thrust that lead each to its place, shape (n, 3) [m/s^2]."""
        structure, gravity, t = self.structure, self.structure.gravity, view.t
        place, velocity = structure.states(t)
        shift_r, shift_v = self.shift(state, view)
        error, rate = view.r_BN_N - place - shift_r, view.v_BN_N - velocity - shift_v
        wanted = structure.accelerations(t)
        if self.reference != "plan":
            centre = structure.centre(t)
            wanted = wanted + gravity(t, centre + shift_r) - gravity(t, centre[None])
        wish = wanted - gravity(t, view.r_BN_N) + self.tracking.feedback(error, rate, most)
        state.working = self.tracking.at_work(error, rate, state.working)
        if self.reference == "leader":
            state.working &= state.leader != np.arange(len(wish))  # a leader flies free
        return cut(np.where(state.working[:, None], wish, 0.0), most)

    def _moves(self, state: FormationState, view: ForceView, most: Array) -> Moves:
        """Motion relative to the structure's point."""
        r, v = view.r_BN_N - self.structure.centre(view.t), view.v_BN_N - self.structure.centre(view.t, 1)
        # With full tanks, for what is set aside must not change while it is relied upon.
        braking = np.where(most > 0.0, BRAKING_SHARE * self.force / state.full_mass, 0.0)
        return Moves(r, v, braking, view.period, self.separation)

    def _guard(self, state: FormationState, moves: Moves) -> Mask:
        """Take those pairs under guard that could stop clear of each other from now on."""
        new = np.flatnonzero(~state.guarded)
        if len(new) and self.separation > 0.0:
            state.guarded[new] = ~too_close_after(moves, moves.stopping(), state.pairs[new])
        return state.guarded

    def _keep_apart(self, state: FormationState, view: ForceView, wish: Array, most: Array) -> Array:
        moves = self._moves(state, view, most)
        pairs = state.pairs[self._guard(state, moves)]
        drift = self._drift(view)
        # What is left for moving relative to the others, at the least what stopping takes.
        left = np.where(most > 0.0, np.maximum(most - np.linalg.norm(drift, axis=1), moves.braking), 0.0)
        proposed = nearest_allowed(moves, wish + drift, left, pairs)
        safe, braked = safe_moves(moves, proposed, pairs)
        state.log.braked += braked
        changed = (safe != wish + drift).any(axis=1)
        return np.where(changed[:, None], safe - drift, wish)

    def _drift(self, view: ForceView) -> Array:
        """Acceleration without thrust relative to the structure's point, shape (n, 3) [m/s^2]."""
        t, T = view.t, view.period
        of_centre = (self.structure.centre(t + T, 1) - self.structure.centre(t, 1)) / T
        return np.asarray(self.structure.gravity(t + 0.5 * T, view.r_BN_N + 0.5 * T * view.v_BN_N) - of_centre)
