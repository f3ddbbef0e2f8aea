"""The problem: agents take pictures in slots of time, each is aimed at something and shows patches, and patches have weights.

Sought are pictures that show most weight together, such that any two pictures of an agent are far enough apart in time for the
slew between them, no agent takes more than its budget, and each works when it takes one. A patch counts once, however many
pictures show it. The value is a weighted coverage: monotone and submodular in the set of pictures.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Ints, Mask, kernel

#: Who shows a patch that nobody shows.
NOBODY = -1


class Pictures(NamedTuple):
    """All pictures that show something, agent by agent, and of each agent in the order in which it prefers equal ones.

    Preferred are those that rule out the fewest others of the agent, then early ones, then those of a low aim.

    Attributes:
        agent: Who takes it, rising, shape (x,).
        slot: When, shape (x,).
        aim: At what, shape (x,).
        start: Number of an agent's first picture, and at last x, shape (a + 1,).
        first: Where the patches of a picture start in `patch`, shape (x + 1,).
        patch: The patches that each shows, rising, one picture after the other.
    """

    agent: Ints
    slot: Ints
    aim: Ints
    start: Ints
    first: Ints
    patch: Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class AllocationProblem:
    """A problem of a agents, m aims, k slots and p patches.

    Attributes:
        weight: Of each patch, not negative [m^2]; 0 for what need not be seen any more, shape (p,).
        shows: Whether agent a's picture of aim m in slot k shows patch p, shape (a, m, k, p).
        slew: Least number of slots from an agent's picture of one aim to one of another that follows, at least 1, shape
            (a, m, m).
        budget: Most pictures of each agent, shape (a,).
        available: Whether an agent works in a slot, shape (a, k); default: all do.

    Raises:
        MissionError: An array does not fit; the message names it.
    """

    weight: Array
    shows: Mask
    slew: Ints
    budget: Ints
    available: Mask = field(default_factory=lambda: np.empty(0, np.bool_))

    def __post_init__(self) -> None:
        """Convert and check."""
        for name, kind in _KINDS.items():
            object.__setattr__(self, name, _converted(name, getattr(self, name), kind))
        if self.shows.ndim != 4:
            raise MissionError(f"shows: shape {self.shows.shape} must be (agents, aims, slots, patches)")
        a, m, k, p = self.shows.shape
        if not self.available.size:
            object.__setattr__(self, "available", np.ones((a, k), np.bool_))
        shapes = {"weight": (p,), "slew": (a, m, m), "budget": (a,), "available": (a, k)}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise MissionError(f"{name}: shape {getattr(self, name).shape} must be {shape}, as `shows` has it")
        if not (np.isfinite(self.weight) & (self.weight >= 0.0)).all():
            raise MissionError("weight: every patch needs a finite number that is not negative")
        for name, least in (("slew", 1), ("budget", 0)):
            if (getattr(self, name) < least).any():
                raise MissionError(f"{name}: {getattr(self, name).min()} must be at least {least}")

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
        some = (self.shows & (self.weight > 0.0)).any(axis=3) & self.available[:, None, :]
        return some & (self.budget > 0)[:, None, None]

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

    def value_of(self, pictures: AgentPictures) -> float:
        """Weight of the patches that pictures show together [m^2]."""
        return float(self.weight[self.shown_by(pictures)].sum())

    def shown_by(self, pictures: AgentPictures) -> Mask:
        """Patches that pictures show, shape (p,)."""
        shown = np.zeros(self.n_patches, np.bool_)
        for agent, taken in enumerate(pictures):
            for slot, aim in taken:
                shown |= self.shows[agent, aim, slot]
        return shown

    def check(self, pictures: AgentPictures) -> None:
        """See that pictures can be taken.

        Raises:
            MissionError: They cannot; the message names the first that is wrong.
        """
        if len(pictures) != self.n_agents:
            raise MissionError(f"pictures: of {len(pictures)} agents, but the problem has {self.n_agents}")
        for agent, taken in enumerate(pictures):
            if len(taken) > self.budget[agent]:
                raise MissionError(f"agent {agent} takes {len(taken)} pictures, its budget is {self.budget[agent]}")
            for n, (slot, aim) in enumerate(taken):
                if not self.available[agent, slot]:
                    raise MissionError(f"agent {agent} takes a picture in slot {slot}, in which it does not work")
                for earlier, other in taken[:n]:
                    if slot - earlier < self.slew[agent, other, aim]:
                        raise MissionError(
                            f"agent {agent} needs {self.slew[agent, other, aim]} slots from aim {other} to {aim}, "
                            f"but has {slot - earlier} from slot {earlier} to {slot}"
                        )


#: Of each agent its pictures in order of time: pairs (slot, aim).
AgentPictures = tuple[tuple[tuple[int, int], ...], ...]

_KINDS: dict[str, type] = {"weight": float, "shows": bool, "slew": int, "budget": int, "available": bool}


def _converted(name: str, value: ArrayLike, kind: type) -> Array | Ints | Mask:
    array = np.asarray(value)
    if kind is int and array.dtype.kind == "f" and not (array == np.round(array)).all():
        raise MissionError(f"{name}: needs whole numbers")
    try:
        return np.ascontiguousarray(array, {float: np.float64, int: np.int64, bool: np.bool_}[kind])
    except (TypeError, ValueError):
        raise MissionError(f"{name}: needs an array of numbers, got {type(value).__name__}") from None


def plain_problem(
    weight: ArrayLike, feasible: ArrayLike, slew: ArrayLike, budget: ArrayLike, available: ArrayLike = ()
) -> AllocationProblem:
    """A problem in which a picture shows only the patch at which it is aimed.

    Args:
        weight: Of each patch, shape (p,) [m^2].
        feasible: Whether an agent can image a patch in a slot, shape (a, p, k).
        slew: As `AllocationProblem.slew`; one number stands for all.
        budget: As `AllocationProblem.budget`; one number stands for all.
        available: As `AllocationProblem.available`.
    """
    can = np.asarray(feasible, np.bool_)
    if can.ndim != 3:
        raise MissionError(f"feasible: shape {can.shape} must be (agents, patches, slots)")
    a, p, _ = can.shape
    return AllocationProblem(
        weight=np.asarray(weight),
        shows=can[..., None] & np.eye(p, dtype=np.bool_)[:, None, :],
        slew=np.asarray(slew) if np.ndim(slew) else np.full((a, p, p), slew),
        budget=np.asarray(budget) if np.ndim(budget) else np.full(a, budget),
        available=np.asarray(available, np.bool_),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Allocation:
    """Who takes which pictures.

    Attributes:
        pictures: Of each agent its pictures in order of time, as pairs (slot, aim).
        who: The agent that answers for each patch, `NOBODY` where no picture shows it, shape (p,).
        value: Weight of all patches that are shown [m^2].
        bound: No allocation has more [m^2].
        status: 'optimal' or 'time limit' (`optimum`), 'greedy', 'agreed' or 'not agreed' (`auction`), 'repaired' (`losses`).
        rounds: Of messages until all agreed, or until they stopped.
        messages: Sent, those that got lost included.
        bits: Of these messages.
        duplicates: Patches for which more than one agent thinks that it answers, rising: none where all agree.
        seconds: Wall-clock time.
    """

    pictures: AgentPictures
    who: Ints
    value: float
    bound: float = inf
    status: str = "greedy"
    rounds: int = 0
    messages: int = 0
    bits: int = 0
    duplicates: tuple[int, ...] = ()
    seconds: float = 0.0

    @property
    def gap(self) -> float:
        """What the bound exceeds the value by, relatively."""
        return (self.bound - self.value) / self.bound if self.bound > 0.0 else 0.0

    @property
    def proven(self) -> bool:
        """Whether no allocation is better."""
        return self.status == "optimal"


def allocation_of(problem: AllocationProblem, pictures: AgentPictures, **told: Any) -> Allocation:
    """An allocation from its pictures: the agent whose picture shows a patch first answers for it, the lowest of several.

    Args:
        problem: Which.
        pictures: Of each agent, in any order.
        told: Attributes of the allocation that do not follow from these; `bound` and `who` where they are known better.

    Raises:
        MissionError: The pictures cannot be taken.
    """
    in_order = tuple(tuple(sorted((int(slot), int(aim)) for slot, aim in taken)) for taken in pictures)
    problem.check(in_order)
    who = np.full(problem.n_patches, NOBODY, np.int64)
    for slot, agent, aim in sorted((slot, a, aim) for a, taken in enumerate(in_order) for slot, aim in taken):
        who[problem.shows[agent, aim, slot] & (who == NOBODY)] = agent
    known: dict[str, Any] = {"who": who, "bound": problem.coverable, **told}
    return Allocation(pictures=in_order, value=problem.value_of(in_order), **known)


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
