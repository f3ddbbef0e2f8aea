"""The problem: agents take pictures in slots of time, each is aimed at something and shows patches, and patches have weights.

Sought are pictures that show most weight together, such that any two pictures of an agent are far enough apart in time for the
slew between them, no agent takes more than its budget, and each works when it takes one. A patch counts once, however many
pictures show it. The value is a weighted coverage: monotone and submodular in the set of pictures.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.typing import Array, Ints, Mask

#: The pictures of an agent in order of time: pairs (slot, aim).
Schedule = tuple[tuple[int, int], ...]


class Pictures(NamedTuple):
    """All pictures that show something, agent by agent, and of each agent in the order in which it prefers equal ones.

    Preferred are those that rule out the fewest others of the agent, then early ones, then those of a low aim.
    """

    agent: Ints  #: who takes it, rising, shape (x,)
    slot: Ints  #: when, shape (x,)
    aim: Ints  #: at what, shape (x,)
    start: Ints  #: number of an agent's first picture, and at last x, shape (a + 1,)
    first: Ints  #: where the patches of a picture start in `patch`, shape (x + 1,)
    patch: Ints  #: the patches that each shows, rising, one picture after the other


@dataclass(frozen=True, eq=False, kw_only=True)
class AllocationProblem:
    """A problem of a agents, m aims, k slots and p patches."""

    weight: Array  #: of each patch, not negative [m^2]; 0 for what need not be seen any more, shape (p,)
    shows: Mask  #: whether agent a's picture of aim m in slot k shows patch p, shape (a, m, k, p)
    #: least number of slots from an agent's picture of one aim to one of another that follows, at least 1, shape (a, m, m)
    slew: Ints
    budget: Ints  #: most pictures of each agent, shape (a,)
    #: whether an agent works in a slot, shape (a, k); default: all do
    available: Mask = field(default_factory=lambda: np.empty(0, np.bool_))
    most: int | None = None  #: most pictures of all agents together; None: any number

    def __post_init__(self) -> None:
        """Bring all arrays into the one layout for which kernels are compiled."""
        if not self.available.size:
            object.__setattr__(self, "available", np.ones((self.n_agents, self.n_slots)))
        kinds = {"weight": np.float64, "shows": np.bool_, "slew": np.int64, "budget": np.int64, "available": np.bool_}
        for name, kind in kinds.items():
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), kind))

    @property
    def n_agents(self) -> int:
        """Number of agents a."""
        return self.shows.shape[0]

    @property
    def n_aims(self) -> int:
        """Number of aims m."""
        return self.shows.shape[1]

    @property
    def n_slots(self) -> int:
        """Number of slots k."""
        return self.shows.shape[2]

    @property
    def n_patches(self) -> int:
        """Number of patches p."""
        return self.shows.shape[3]

    @cached_property
    def possible(self) -> Mask:
        """Whether a picture can be taken and shows something of weight, shape (a, m, k)."""
        shows_any = (self.shows & (self.weight > 0.0)).any(axis=3)
        return shows_any & self.available[:, None, :] & (self.budget > 0)[:, None, None]

    @property
    def coverable(self) -> float:
        """Weight that any picture shows [m^2]: no allocation has more."""
        return float(self.weight[(self.shows & self.possible[..., None]).any(axis=(0, 1, 2))].sum())

    @cached_property
    def pictures(self) -> Pictures:
        """All pictures that are `possible`."""
        agent, aim, slot = np.nonzero(self.possible)
        ruled_out = _conflicts(self.possible, self.slew, agent, aim, slot)
        order = np.lexsort((aim, slot, ruled_out, agent))
        agent, aim, slot = agent[order], aim[order], slot[order]
        first, patch = _shown(self.shows, self.weight, agent, aim, slot)
        start = np.searchsorted(agent, np.arange(self.n_agents + 1))
        columns = (agent, slot, aim, start, first, patch)
        return Pictures(*(np.ascontiguousarray(column, np.int64) for column in columns))

    def value_of(self, pictures: tuple[Schedule, ...]) -> float:
        """Weight of the patches that pictures show together [m^2]."""
        return float(self.weight[self.shown_by(pictures)].sum())

    def shown_by(self, pictures: tuple[Schedule, ...]) -> Mask:
        """Patches that pictures show, shape (p,)."""
        shown = np.zeros(self.n_patches, np.bool_)
        for agent, taken in enumerate(pictures):
            for slot, aim in taken:
                shown |= self.shows[agent, aim, slot]
        return shown


@dataclass(frozen=True, eq=False, kw_only=True)
class Allocation:
    """Who takes which pictures."""

    pictures: tuple[Schedule, ...]  #: of each agent its pictures in order of time, as pairs (slot, aim)
    value: float  #: weight of all patches that are shown [m^2]
    bound: float = inf  #: no allocation has more [m^2]
    status: str = "greedy"  #: 'optimal' or 'time limit' (`optimum`), 'greedy', or 'each alone' (`planned_alone`)

    @property
    def proven(self) -> bool:
        """Whether no allocation is better."""
        return self.status == "optimal"


def allocation_of(problem: AllocationProblem, pictures: tuple[Schedule, ...], status: str) -> Allocation:
    """An allocation from pictures that can be taken together; its bound is all that can be covered."""
    return Allocation(pictures=pictures, value=problem.value_of(pictures), bound=problem.coverable, status=status)


@kernel
def in_conflict(slew: Ints, agent: int, slot: int, aim: int, other_slot: int, other_aim: int) -> bool:
    """Whether an agent cannot take both of two pictures: there is no time for the slew between them."""
    if slot <= other_slot:
        return bool(other_slot - slot < slew[agent, aim, other_aim])
    return bool(slot - other_slot < slew[agent, other_aim, aim])


@kernel
def _conflicts(possible: Mask, slew: Ints, agent: Ints, aim: Ints, slot: Ints) -> Ints:
    """Of each picture, how many others of its agent it rules out (`in_conflict`), shape (x,): slots of each aim, summed up."""
    agents, aims, slots = possible.shape
    before = np.zeros((agents, aims, slots + 1), np.int64)
    for a in range(agents):
        for m in range(aims):
            for k in range(slots):
                before[a, m, k + 1] = before[a, m, k] + possible[a, m, k]
    count = np.empty(len(agent), np.int64)
    for x in range(len(agent)):
        a, k, total = agent[x], slot[x], -1  # itself
        for m in range(aims):
            low = max(k - slew[a, m, aim[x]] + 1, 0)
            high = min(k + slew[a, aim[x], m], slots)
            total += before[a, m, high] - before[a, m, low]
        count[x] = total
    return count


@kernel
def _shown(shows: Mask, weight: Array, agent: Ints, aim: Ints, slot: Ints) -> tuple[Ints, Ints]:
    """Where the patches of each picture start, shape (x + 1,), and all of them that have a weight, rising in each picture."""
    first = np.zeros(len(agent) + 1, np.int64)
    for x in range(len(agent)):
        of = shows[agent[x], aim[x], slot[x]]
        first[x + 1] = first[x]
        for q in range(len(weight)):
            first[x + 1] += of[q] and weight[q] > 0.0
    patch, n = np.empty(first[-1], np.int64), 0
    for x in range(len(agent)):
        of = shows[agent[x], aim[x], slot[x]]
        for q in range(len(weight)):
            if of[q] and weight[q] > 0.0:
                patch[n] = q
                n += 1
    return first, patch
