"""Planning of pictures: ahead by one who knows all, alone, and in flight from what is left."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from swarm_mj.coordination.allocation.annealing import annealed
from swarm_mj.coordination.allocation.auction import Auction
from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.coordination.allocation.optimum import optimum
from swarm_mj.coordination.allocation.problem import Allocation, AllocationProblem, Schedule, allocation_of
from swarm_mj.coordination.encounter import Encounter
from swarm_mj.typing import Array, Ints, Mask

#: Most pictures of a problem whose bound is looked for by the solver: beyond, it takes longer than it may to write the program.
MOST_PROVEN = 20_000
#: Moves of annealing of a plan that is repaired in flight: a tenth of a second.
REPLAN_MOVES = 50_000
#: Slots that the auction in flight looks ahead, so that long flights cost no more than short ones.
MOST_SLOTS = 120


def problem_of(
    encounter: Encounter, *, agent: int | None = None, budget: Sequence[int] | None = None, most: int | None = None
) -> AllocationProblem:
    """The pictures of an encounter; the patches are its cells.

    Args:
        encounter: What can be shown.
        agent: Whose pictures alone, as agent 0; None: of all.
        budget: Most pictures of each; None: any number.
        most: Most pictures of all together; None: any number.
    """
    chosen = slice(None) if agent is None else slice(agent, agent + 1)
    shows, slots = encounter.shows[chosen], len(encounter.slot_s)
    return AllocationProblem(
        weight=encounter.area,
        shows=shows,
        slew=encounter.slew[chosen],
        budget=np.full(len(shows), slots) if budget is None else np.minimum(budget, slots),
        most=most,
    )


def planned_alone(encounter: Encounter) -> Allocation:
    """Everybody plans for itself, as if there were nobody else."""
    problem = problem_of(encounter)
    pictures = [
        greedy(replace(problem, available=_only(problem, agent))).pictures[agent] for agent in range(problem.n_agents)
    ]
    return allocation_of(problem, tuple(pictures), "each alone")


def planned_together(problem: AllocationProblem, time_limit_s: float) -> Allocation:
    """The best plan known, with a bound: greedy choice, improved by annealing, and what the solver proves in a time [s]."""
    start = greedy(problem)
    pictures = annealed(problem, start.pictures, np.random.default_rng(0))
    best = allocation_of(problem, pictures, "time limit")
    if len(problem.pictures.agent) > MOST_PROVEN:
        return best
    proof = optimum(problem, time_limit_s)
    found = proof if proof.value > best.value else best
    return replace(found, bound=max(proof.bound, found.value), status=proof.status)


def _only(problem: AllocationProblem, agent: int) -> Mask:
    """Nobody but one agent works, shape (a, k)."""
    return np.tile(np.arange(problem.n_agents)[:, None] == agent, (1, problem.n_slots))


def auction_from(
    encounter: Encounter, before: Auction | None, *, t: float, known: Array, can: Mask, aim: Ints
) -> Auction:
    """The auction of the pictures after a time, with all that was said before; of the next `MOST_SLOTS` slots alone.

    Args:
        encounter: What can be shown.
        before: The auction so far; None: none yet.
        t: Now [s].
        known: Weight of each cell as each agent knows it, shape (a, cells).
        can: Who can take pictures, shape (a,).
        aim: What each is turned to, -1 for elsewhere, shape (a,).
    """
    wanted: Mask = np.asarray((known[can] > 0.0).any(axis=0))
    problem = _problem_left(encounter, t, wanted, can, aim)
    auction = Auction(problem, known, can)
    if before is not None:
        auction.bid[:], auction.winner[:], auction.heard[:] = before.bid, before.winner, before.heard
    return auction


def replanned(encounter: Encounter, pictures: Schedule, agent: int, *, t: float, wanted: Mask) -> Schedule:
    """An agent's plan with the pictures after a time made anew, for it alone.

    Args:
        encounter: What can be shown.
        pictures: Of the agent, as planned so far.
        agent: Who.
        t: Now [s].
        wanted: Cells that it is to show if it can, shape (cells,).
    """
    slot, who = encounter.slot_after(t), np.arange(len(encounter.shows)) == agent
    done = bisect_left(pictures, (slot,))
    problem = _problem_left(encounter, t, wanted, who, np.where(who, pictures[done - 1][1] if done else -1, -1))
    ahead = tuple((k - slot, m) for k, m in pictures[done:] if k < slot + problem.n_slots)
    start = tuple(ahead if own else () for own in who)
    found = annealed(problem, start, np.random.default_rng(0), REPLAN_MOVES)
    return (*pictures[:done], *((k + slot, m) for k, m in found[agent]))


def _problem_left(encounter: Encounter, t: float, wanted: Mask, can: Mask, aim: Ints) -> AllocationProblem:
    """The pictures of the next `MOST_SLOTS` slots after a time [s], of some cells, by who can take some; see `auction_from`."""
    slot = encounter.slot_after(t)
    coming = slice(slot, slot + MOST_SLOTS)
    shows, free = encounter.shows[:, :, coming], encounter.slot_s[coming] - t
    if (aim >= 0).any():
        # Turning away from where one points takes its time. The clock counts, for slots may lie far apart; of an interval
        # just begun, the first moments have passed already.
        agent = np.arange(len(aim))
        takes = np.where(aim[:, None] >= 0, encounter.slew[agent, np.maximum(aim, 0)], 0)
        shows = shows & (np.ceil(free / encounter.interval_s - 1e-6) >= takes[:, :, None])[..., None]
    return AllocationProblem(
        weight=np.where(wanted, encounter.area, 0.0),
        shows=shows,
        slew=encounter.slew,
        budget=np.full(len(can), len(free)),
        available=np.tile(can[:, None], (1, len(free))),
    )
