"""One picture after the other, always the one that adds most: centrally, and with a bound on what that can cost.

Where each choice rules out at most q others that could stand together, greedy choice of a monotone submodular value reaches
1 / (1 + q) of the optimum (Fisher, Nemhauser and Wolsey 1978, "An analysis of approximations for maximizing submodular set
functions II"; Calinescu, Chekuri, Pal and Vondrak 2011, "Maximizing a monotone submodular function subject to a matroid
constraint"). Where every slew takes one slot, an agent's choice is one picture a slot and a budget, a matroid: q is 1 and the
share one half. With slews of up to s slots and at least r, q is 2 (s - 1) / r + 1 at most, rounded down.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.coordination.allocation.problem import (
    Allocation,
    AllocationProblem,
    Pictures,
    Schedule,
    allocation_of,
    in_conflict,
)
from swarm_mj.typing import Array, Ints, Mask


def greedy(problem: AllocationProblem) -> Allocation:
    """Pictures chosen one by one, each the one that adds most weight; the lowest agent wins ties, see `Pictures`."""
    chosen = _greedy(problem.pictures, problem.weight, problem.slew, problem.budget)[: problem.most]
    return allocation_of(problem, pictures_of(problem, chosen), "greedy")


def pictures_of(problem: AllocationProblem, chosen: Ints) -> tuple[Schedule, ...]:
    """Pictures by their numbers, sorted by agents and slots."""
    pictures = problem.pictures
    found: list[list[tuple[int, int]]] = [[] for _ in range(problem.n_agents)]
    for x in chosen:
        found[pictures.agent[x]].append((int(pictures.slot[x]), int(pictures.aim[x])))
    return tuple(tuple(sorted(taken)) for taken in found)


@kernel
def beats(bid: float, agent: int, other_bid: float, other: int) -> bool:
    """Whether a bid wins against another one's; nobody is -1, and the lower agent wins ties."""
    return bool(other < 0 or bid > other_bid or (bid == other_bid and agent < other))


@kernel
def gain_of(pictures: Pictures, x: int, weight: Array, own: Mask, bid: Array, winner: Ints) -> float:
    """What a picture adds: the weight of the patches that it shows, the agent does not, and that its bid wins.

    It bids the whole gain for each patch. The bid falls as patches are found that it does not win, until it wins all the rest.

    Args:
        pictures: All.
        x: Number of the picture.
        weight: Of each patch, as the agent knows it.
        own: Patches that the agent's other pictures show.
        bid: Highest known for each patch.
        winner: Who made it, -1 for nobody.
    """
    agent, gain, before = pictures.agent[x], np.inf, 0.0
    while gain != before:
        before, gain = gain, 0.0
        for n in range(pictures.first[x], pictures.first[x + 1]):
            q = pictures.patch[n]
            if not own[q] and beats(before, agent, bid[q], winner[q]):
                gain += weight[q]
        if gain == 0.0:
            return 0.0
    return gain


@kernel
def best_picture(
    pictures: Pictures, agent: int, open_: Mask, weight: Array, own: Mask, bid: Array, winner: Ints
) -> tuple[int, float]:
    """The picture of an agent that adds most of those that are open, and what it adds; the first of equal ones, -1 for none."""
    best, most = -1, 0.0
    for x in range(pictures.start[agent], pictures.start[agent + 1]):
        if open_[x]:
            gain = gain_of(pictures, x, weight, own, bid, winner)
            if gain > most:
                best, most = x, gain
    return best, most


@kernel
def take(pictures: Pictures, x: int, slew: Ints, open_: Mask) -> None:
    """Close what an agent cannot do beside a picture, itself included."""
    agent = pictures.agent[x]
    for other in range(pictures.start[agent], pictures.start[agent + 1]):
        if in_conflict(slew, agent, pictures.slot[x], pictures.aim[x], pictures.slot[other], pictures.aim[other]):
            open_[other] = False


@kernel
def _greedy(pictures: Pictures, weight: Array, slew: Ints, budget: Ints) -> Ints:
    agents, left = len(budget), budget.copy()
    open_, shown = np.ones(len(pictures.agent), np.bool_), np.zeros(len(weight), np.bool_)
    bid, winner = np.zeros(len(weight)), np.full(len(weight), -1, np.int64)
    best, gain = np.empty(agents, np.int64), np.zeros(agents)
    chosen, count = np.empty(len(pictures.agent), np.int64), 0
    while True:
        for agent in range(agents):
            if left[agent] > 0:
                best[agent], gain[agent] = best_picture(pictures, agent, open_, weight, shown, bid, winner)
            else:
                gain[agent] = 0.0
        agent = int(np.argmax(gain)) if agents else 0
        if agents == 0 or gain[agent] == 0.0:
            return chosen[:count]
        x = best[agent]
        chosen[count] = x
        count += 1
        left[agent] -= 1
        take(pictures, x, slew, open_)
        for n in range(pictures.first[x], pictures.first[x + 1]):
            shown[pictures.patch[n]] = True
