"""Planning of pictures: ahead by one who knows all, alone, and in flight from what is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from swarm_mj.coordination.allocation.auction import Auction
from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.coordination.allocation.optimum import optimum
from swarm_mj.coordination.allocation.problem import Allocation, AllocationProblem, allocation_of
from swarm_mj.coordination.encounter import Encounter
from swarm_mj.typing import Array, Ints, Mask

#: Share of the time that the proof may take; the rest is spent on one agent after the other.
PROOF_SHARE = 0.4
#: Slots that the auction in flight looks ahead, so that long flights cost no more than short ones.
MOST_SLOTS = 120


def problem_of(encounter: Encounter) -> AllocationProblem:
    """All pictures of an encounter; the patches are its cells."""
    agents, _, slots, _ = encounter.shows.shape
    return AllocationProblem(
        weight=encounter.area, shows=encounter.shows, slew=encounter.slew, budget=np.full(agents, slots)
    )


def planned_alone(encounter: Encounter) -> Allocation:
    """Everybody plans for itself, as if there were nobody else."""
    problem = problem_of(encounter)
    pictures = [
        greedy(replace(problem, available=_only(problem, agent))).pictures[agent] for agent in range(problem.n_agents)
    ]
    return allocation_of(problem, tuple(pictures), "each alone")


def planned_together(encounter: Encounter, time_limit_s: float) -> Allocation:
    """The best plan found in a time [s], with a bound: greedy choice, each agent's pictures made best in turn, the proof."""
    problem = problem_of(encounter)
    best = greedy(problem)
    each_s = (1.0 - PROOF_SHARE) * time_limit_s / max(problem.n_agents, 1)
    for agent in sorted(range(problem.n_agents), key=lambda a: -len(best.pictures[a])):
        others = tuple(() if a == agent else taken for a, taken in enumerate(best.pictures))
        weight = np.where(problem.shown_by(others), 0.0, problem.weight)
        rest = replace(problem, weight=weight, available=_only(problem, agent))
        if not rest.possible.any():
            continue
        own = optimum(rest, each_s).pictures[agent]
        trial = allocation_of(problem, (*others[:agent], own, *others[agent + 1 :]), "time limit")
        best = trial if trial.value > best.value else best
    proof = optimum(problem, PROOF_SHARE * time_limit_s)
    found = proof if proof.value > best.value else best
    return replace(found, bound=min(proof.bound, problem.coverable), status=proof.status)


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
    slot = encounter.slot_after(t)
    coming = slice(slot, slot + MOST_SLOTS)
    shows, free = encounter.shows[:, :, coming], encounter.slot_s[coming] - t
    if (aim >= 0).any():
        # Turning away from where one points takes its time. The clock counts, for slots may lie far apart; of an interval
        # just begun, the first moments have passed already.
        agent = np.arange(len(aim))
        takes = np.where(aim[:, None] >= 0, encounter.slew[agent, np.maximum(aim, 0)], 0)
        shows = shows & (np.ceil(free / encounter.interval_s - 1e-6) >= takes[:, :, None])[..., None]
    wanted = (known[can] > 0.0).any(axis=0)
    problem = AllocationProblem(
        weight=np.where(wanted, encounter.area, 0.0),
        shows=shows,
        slew=encounter.slew,
        budget=np.full(len(can), len(free)),
        available=np.tile(can[:, None], (1, len(free))),
    )
    auction = Auction(problem, known, can)
    if before is not None:
        auction.bid[:], auction.winner[:], auction.heard[:] = before.bid, before.winner, before.heard
    return auction
