"""What is left of a problem when time has passed, things are seen and agents are lost, and how the others cover the hole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.coordination.allocation.problem import AgentPictures, Allocation, AllocationProblem, allocation_of
from swarm_mj.errors import MissionError


def after_loss(
    problem: AllocationProblem,
    slot: int,
    *,
    seen: ArrayLike | None = None,
    fixed: AgentPictures | None = None,
    lost: ArrayLike = False,
) -> AllocationProblem:
    """What is left to allocate at the start of a slot; slots keep their numbers.

    Args:
        problem: Of the whole encounter.
        slot: The first in which anything can be changed.
        seen: Patches that need not be seen any more, shape (p,); what `fixed` shows need not either.
        fixed: Pictures that are taken, or will be whatever is decided: others need time for the slew from and to them.
        lost: Who takes no more pictures, shape (a,).

    Raises:
        MissionError: An array does not fit, or the fixed pictures cannot be taken.
    """
    if not 0 <= slot <= problem.n_slots:
        raise MissionError(f"slot = {slot}: must lie between 0 and {problem.n_slots}, the slots of the problem")
    kept = ((),) * problem.n_agents if fixed is None else fixed
    problem.check(kept)
    weight, available, shows = problem.weight.copy(), problem.available.copy(), problem.shows.copy()
    weight[problem.shown_by(kept)] = 0.0
    if seen is not None:
        weight[_mask("seen", seen, problem.n_patches)] = 0.0
    available[:, :slot] = False
    available[_mask("lost", lost, problem.n_agents)] = False
    slots = np.arange(problem.n_slots)
    for agent, taken in enumerate(kept):
        for when, aim in taken:
            # Of aims (rows) and slots (columns): too soon after the picture, or so late before it that it could not be taken.
            after = (slots >= when) & (slots - when < problem.slew[agent, aim][:, None])
            before = (slots <= when) & (when - slots < problem.slew[agent, :, aim][:, None])
            shows[agent, after | before] = False
    budget = problem.budget - np.array([len(taken) for taken in kept], np.int64)
    return replace(problem, weight=weight, shows=shows, budget=budget, available=available)


def reallocate(
    problem: AllocationProblem,
    allocation: Allocation,
    slot: int,
    lost: ArrayLike,
    *,
    by: Callable[[AllocationProblem], Allocation] = greedy,
    keep: bool = True,
    data_lost: bool = False,
) -> Allocation:
    """The allocation repaired after agents are lost: pictures taken before a slot stay, the others' tasks go to those left.

    Args:
        problem: Of the whole encounter.
        allocation: What was planned.
        slot: The first slot in which nothing of the lost is taken any more, and others can be told so.
        lost: Who is lost, shape (a,).
        by: Allocates what is left: `greedy`, `optimum`, or `cbba` with its links bound by `functools.partial`.
        keep: Whether those left take all that they had planned, and fill the hole beside it: the repair is then never worse
            than none. Otherwise everything from the slot on is allocated anew.
        data_lost: Whether what the lost had seen is lost with them, and worth seeing again.

    Returns:
        The pictures of the whole encounter that count. The bound holds for what could be changed.
    """
    begun, gone = perf_counter(), _mask("lost", lost, problem.n_agents)
    fixed = tuple(
        tuple(p for p in taken if (p[0] < slot or (keep and not gone[agent])) and not (data_lost and gone[agent]))
        for agent, taken in enumerate(allocation.pictures)
    )
    rest = after_loss(problem, slot, fixed=fixed, lost=gone)
    new = by(rest)
    together = tuple((*old, *more) for old, more in zip(fixed, new.pictures, strict=True))
    return allocation_of(
        problem,
        together,
        status="repaired",
        bound=problem.value_of(fixed) + new.bound,
        rounds=new.rounds,
        messages=new.messages,
        bits=new.bits,
        duplicates=new.duplicates,
        seconds=perf_counter() - begun,
    )


def _mask(name: str, value: ArrayLike, n: int) -> np.ndarray:
    mask = np.asarray(value, np.bool_)
    if mask.shape not in ((), (n,)):
        raise MissionError(f"{name}: shape {mask.shape} must be ({n},), true where it holds")
    return np.broadcast_to(mask, (n,))
