"""The behaviour of a coordinated swarm: parts for sensing and for the relay that make the classes 0, 1, 3 and 4.

Every spacecraft acts by what it knows itself. Right after each picture it looks at what that shows, hears what has arrived,
plans on, and says what it knows; until the next picture its target stays. Who is lost does none of that.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from swarm_mj.coordination.allocation.auction import Auction
from swarm_mj.coordination.allocation.problem import Allocation, Schedule
from swarm_mj.coordination.bus import Bus, MessageLog
from swarm_mj.coordination.encounter import Encounter
from swarm_mj.coordination.graph import Graph
from swarm_mj.coordination.knowledge import Knowledge
from swarm_mj.coordination.replanning import auction_from, replanned
from swarm_mj.dataflow.network import Access
from swarm_mj.mission.behaviors import SwarmView, TargetKind, Targets, looks_at_body
from swarm_mj.typing import Array, Ints, Mask

#: Before the first picture that shows anything the auction begins: enough for all to agree and to turn [s].
AHEAD_S = 120.0
#: Share of the area that a picture was to show from which on it counts as taken as planned.
AS_PLANNED = 0.95
#: The parts that make a class.
PARTS = {
    0: {"sensing": "own", "relay": "own"},
    1: {"sensing": "own", "relay": "own"},
    2: {"sensing": "behavior", "relay": "behavior"},
    3: {"sensing": "plan", "relay": "plan"},
    4: {"sensing": "auction", "relay": "election"},
}


class PicturePlan(NamedTuple):
    """Pictures that were planned together."""

    encounter: Encounter  #: by which
    allocation: Allocation  #: the pictures, what they show, and the bound
    objective: str = "mapped"  #: or 'delivered'
    repaired: bool = False  #: whether what is left is planned anew in flight when a picture fails


class CoordinationEvent(NamedTuple):
    """Something that a spacecraft came to know or did."""

    time_s: float  #: when [s]
    spacecraft: int  #: who, from 0
    kind: str  #: 'silent' (takes another for lost), 'relays' or 'steps down'
    detail: str  #: in words


@dataclass(frozen=True, eq=False, kw_only=True)
class CoordinationPlan:
    """What a coordinated swarm is given before its release."""

    encounter: Encounter  #: the table of what can be shown when
    pictures: tuple[Schedule, ...]  #: of each observer as planned
    sensing: str  #: 'own', 'plan' or 'auction'
    relay: str  #: 'own', 'plan' or 'election'
    succession: Ints  #: place of each spacecraft in the order in which they relay, the planned relay first, shape (n,)
    #: what the picture of a spacecraft shows at an instant, by a view and its number, shape (cells,)
    cells_shown: Callable[[SwarmView, int], Mask]
    graph: Callable[[SwarmView, Targets], Graph]  #: the links at an instant, by a view and what all track
    silence_s: float  #: see `Knowledge`
    seed: int  #: of lost messages
    access: Access  #: of the channel
    planned: PicturePlan | None = None  #: where sensing is 'plan'
    dedicated_communications: bool = False  #: whether the last spacecraft takes no pictures

    @property
    def n(self) -> int:
        """Number of spacecraft."""
        return len(self.succession)

    @property
    def talks(self) -> bool:
        """Whether messages are sent."""
        return self.sensing == "auction" or self.relay == "election"

    @property
    def repairs(self) -> bool:
        """Whether plans are repaired in flight."""
        return self.planned is not None and self.planned.repaired


@dataclass(eq=False, kw_only=True)
class CoordinationLog(MessageLog):
    """What a flight's coordination came to: entries after each picture, and `events` in order of time."""

    events: list[CoordinationEvent] = field(default_factory=list)
    taken: int = 0  #: planned pictures, of plans that are repaired
    as_planned: int = 0  #: those that showed at least `AS_PLANNED` of the area that they were to show
    repaired: int = 0  #: how often a spacecraft planned anew


class CoordinationState:
    """One flight under way: its messages, what each knows and plans, and what all track."""

    def __init__(self, mission: CoordinationPlan) -> None:
        n, encounter = mission.n, mission.encounter
        self.bus = Bus(n, np.random.default_rng(mission.seed), mission.access)
        self.knowledge = Knowledge(n, encounter.n_cells, mission.silence_s)
        self.pictures: list[Schedule] = [*mission.pictures, *[()] * (n - len(mission.pictures))]
        self.aim = np.full(n, -1, np.int64)  # pictured last, or turned to
        self.relay = np.arange(n) if mission.relay == "own" else np.full(n, int(np.argmin(mission.succession)))
        self.auction: Auction | None = None
        a = len(mission.pictures)
        # Of each: cells that its pictures were to show so far; those of them that, as it last knew, nobody will show; and whom
        # it last took for alive.
        self.owed, self.missing = np.zeros((2, a, encounter.n_cells), np.bool_)
        self.alive = np.ones((a, a), np.bool_)
        self.slot = -1
        self.log = CoordinationLog()
        self.targets = targets_for(self.pictures, 0, self.relay, encounter.aims_A)


class CoordinatedBehavior:
    """A coordinated swarm in flight, see `Behavior`; the memory is its `CoordinationState`, brought up to date in place.

    Attributes:
        mission: What it is given before its release.
        log: Of the last flight.
    """

    def __init__(self, mission: CoordinationPlan) -> None:
        self.mission, self.log = mission, CoordinationLog()
        self._step_s = mission.encounter.interval_s

    @property
    def dedicated_communications(self) -> bool:
        """See `Behavior`."""
        return self.mission.dedicated_communications

    def targets(self, view: SwarmView, memory: CoordinationState | None) -> tuple[Targets, CoordinationState]:
        """See `Behavior`."""
        state = CoordinationState(self.mission) if memory is None else memory
        self.log = state.log
        instant = self._instant(view.t)
        if instant > state.slot:
            state.slot = instant
            self._act(state, view)
        return state.targets, state

    def steady_for(self, view: SwarmView, memory: CoordinationState) -> float:
        """See `SteadyBehavior`: until right after the next picture."""
        slots = self.mission.encounter.slot_s
        following = float(np.ceil(view.t / self._step_s - 1e-9)) * self._step_s
        coming = slots[slots > view.t - 1e-6]
        return max(min([following, *coming[:1].tolist()]) - view.t, 0.0)

    def _instant(self, t: float) -> int:
        """How many steps and pictures lie before a time: when it changes, all look, hear, plan and speak."""
        slots = self.mission.encounter.slot_s
        return int(np.ceil(t / self._step_s - 1e-9)) + int(np.searchsorted(slots, t - 1e-6))

    def _act(self, state: CoordinationState, view: SwarmView) -> None:
        mission, t = self.mission, view.t
        works = np.ones(mission.n, np.bool_) if view.working is None else view.working
        if mission.talks or mission.repairs:
            self._look(state, view, works)
        if mission.talks:
            for message in state.bus.arrived(t):
                if works[message.receiver]:
                    state.knowledge.hear(message.receiver, message.payload)
                    if state.auction is not None and message.payload.claims is not None:
                        if message.receiver < state.auction.problem.n_agents:
                            state.auction.hear(message.receiver, message.payload.claims)
            self._plan(state, view, works)
        if mission.repairs:
            self._repair(state, view, works)
        slot = mission.encounter.slot_after(t)
        for j in np.flatnonzero(works):
            coming = next_picture(state.pictures[j], slot)
            state.aim[j] = state.aim[j] if coming is None else coming[1]
        found = targets_for(state.pictures, slot, state.relay, mission.encounter.aims_A)
        for new, old in zip(found, state.targets, strict=True):
            new[~works] = old[~works]
        state.targets = found
        if mission.talks:
            self._speak(state, view, works)
        state.log.note(t, state.bus)

    def _look(self, state: CoordinationState, view: SwarmView, works: Mask) -> None:
        """What the pictures just taken show, each for itself."""
        encounter, slots = self.mission.encounter, self.mission.encounter.slot_s
        if not (np.abs(slots - view.t) <= self._step_s * 0.5).any():
            return
        camera_on = works if view.camera_on is None else view.camera_on
        for j in range(len(self.mission.pictures)):
            if works[j] and camera_on[j] and looks_at_body(state.targets.kind[j]):
                state.knowledge.held[j, j] |= self.mission.cells_shown(view, j)

        if self.mission.repairs:
            self._compare(state, encounter.slot_after(view.t) - 1, works & camera_on)

    def _compare(self, state: CoordinationState, slot: int, takes: Mask) -> None:
        """Hold what was seen in a slot against what was to be seen."""
        encounter, log = self.mission.encounter, state.log
        for j in range(len(self.mission.pictures)):
            picture = next_picture(state.pictures[j], slot)
            if picture is None or picture[0] != slot:
                continue
            due = encounter.shows[j, picture[1], slot]
            state.owed[j] |= due
            seen = encounter.area[due & state.knowledge.held[j, j]].sum()
            log.taken += 1
            log.as_planned += bool(takes[j] and seen >= AS_PLANNED * encounter.area[due].sum())

    def _repair(self, state: CoordinationState, view: SwarmView, works: Mask) -> None:
        """Who misses cells of its pictures, or takes another for lost, plans anew what is left beside the others' plans."""
        mission, encounter, t = self.mission, self.mission.encounter, view.t
        camera_on, a = works if view.camera_on is None else view.camera_on, len(mission.pictures)
        for j in np.flatnonzero(works[:a] & camera_on[:a]).tolist():
            alive = state.knowledge.alive(j, t)[:a] if mission.talks else state.alive[j]
            own, lost = np.arange(a) == j, state.alive[j] & ~alive
            wanted = ~state.knowledge.seen(j, t) & ~shown_cells_of(encounter, mission.pictures, alive & ~own, 0)
            missing = wanted & state.owed[j] & ~shown_cells_of(encounter, state.pictures, own, encounter.slot_after(t))
            if lost.any() or (missing & ~state.missing[j]).any():
                state.pictures[j] = replanned(encounter, state.pictures[j], j, t=t, wanted=wanted)
                state.log.repaired += 1
            state.alive[j], state.missing[j] = alive, missing

    def _plan(self, state: CoordinationState, view: SwarmView, works: Mask) -> None:
        mission, knowledge, t = self.mission, state.knowledge, view.t
        before = [knowledge.alive(j, t - self._step_s) for j in range(mission.n)]
        for j in np.flatnonzero(works).tolist():
            knowledge.heard_s[j, j] = t
            alive = knowledge.alive(j, t)
            for k in np.flatnonzero(before[j] & ~alive):
                state.log.events.append(CoordinationEvent(t, j, "silent", f"sc{k + 1} has not been heard of"))
            if mission.relay == "election":
                self._elect(state, j, t)
        if mission.sensing == "auction":
            self._bid(state, view, works)

    def _elect(self, state: CoordinationState, j: int, t: float) -> None:
        stood = bool(state.knowledge.stands[j, j])
        state.relay[j] = state.knowledge.elect(j, t, self.mission.succession)
        stands = bool(state.knowledge.stands[j, j])
        if stands != stood:
            kind = "relays" if stands else "steps down"
            detail = "" if stands else f"for sc{state.relay[j] + 1}"
            state.log.events.append(CoordinationEvent(t, j, kind, detail))

    def _bid(self, state: CoordinationState, view: SwarmView, works: Mask) -> None:
        """Go on with the auction of the pictures that are left."""
        mission, encounter, t = self.mission, self.mission.encounter, view.t
        slot = encounter.slot_after(t)
        if slot >= len(encounter.slot_s) or encounter.slot_s[slot] > t + AHEAD_S:
            return
        a = len(mission.pictures)
        camera_on = works if view.camera_on is None else view.camera_on
        alive = [state.knowledge.alive(j, t) for j in range(mission.n)]
        left = np.array([~state.knowledge.seen(j, t) for j in range(a)]) * encounter.area
        can = np.array([works[j] and camera_on[j] for j in range(a)])
        state.auction = auction_from(encounter, state.auction, t=t, known=left, can=can, aim=state.aim[:a])
        for j in np.flatnonzero(can).tolist():
            state.auction.forget(j, ~alive[j][:a])
            state.auction.plan(j, t)
        found = state.auction.pictures
        for j in np.flatnonzero(works[:a]).tolist():
            state.pictures[j] = tuple((k + slot, m) for k, m in found[j])

    def _speak(self, state: CoordinationState, view: SwarmView, works: Mask) -> None:
        """Everybody says what it knows."""
        graph = self.mission.graph(view, state.targets)
        for j in np.flatnonzero(works).tolist():
            claims, length = None, 0
            if state.auction is not None and j < state.auction.problem.n_agents:
                claims, length = state.auction.message(j), state.auction.message_bits
            report, bits = state.knowledge.report(j, view.t, claims)
            state.bus.broadcast(view.t, j, bits + length, report, graph)


def shown_cells_of(encounter: Encounter, pictures: Sequence[Schedule], who: Mask, slot: int) -> Mask:
    """Cells that planned pictures of some observers, shape (a,), show from a slot on, shape (cells,)."""
    shown = np.zeros(encounter.n_cells, np.bool_)
    for j in np.flatnonzero(who).tolist():
        for k, aim in pictures[j][bisect_left(pictures[j], (slot,)) :]:
            shown |= encounter.shows[j, aim, k]
    return shown


def next_picture(pictures: Schedule, slot: int) -> tuple[int, int] | None:
    """The first picture in a slot or later; None where none is left."""
    n = bisect_left(pictures, (slot,))
    return pictures[n] if n < len(pictures) else None


def targets_for(pictures: Sequence[Schedule], slot: int, relay: Ints, aims_A: Array) -> Targets:
    """One line of sight per spacecraft: at the next picture's aim; without one at Earth, or at the relay.

    Args:
        pictures: Of each spacecraft, as it knows them itself.
        slot: The next one.
        relay: Whom each takes for the relay, itself to speak to Earth, shape (n,).
        aims_A: Shape (m, 3) [m].
    """
    n = len(pictures)
    kind, spacecraft, vector = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros((n, 3))
    for j in range(n):
        coming = next_picture(pictures[j], slot)
        if coming is not None:
            kind[j], vector[j] = TargetKind.SURFACE, aims_A[coming[1]]
        elif relay[j] == j:
            kind[j] = TargetKind.EARTH
        else:
            kind[j], spacecraft[j] = TargetKind.SPACECRAFT, relay[j]
    return Targets(kind, spacecraft, vector)
