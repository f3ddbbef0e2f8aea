"""Better pictures than greedy choice finds: simulated annealing (Kirkpatrick, Gelatt and Vecchi 1983, Science 220, 671).

A move takes one more picture, drawn evenly from all, and drops those of its agent that leave no time for the slew. One that
loses weight stays with the probability exp(change / temperature). The temperature falls geometrically, from a share of all
weight that lets many pictures go to one that lets none. The best pictures met are kept, so that the answer is never worse than
the start. The number of moves is fixed: with the same random numbers the answer is the same on any machine.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.coordination.allocation.greedy import pictures_of
from swarm_mj.coordination.allocation.problem import AllocationProblem, Pictures, Schedule, in_conflict
from swarm_mj.typing import Array, Ints

#: Temperatures at first and at last, over the weight that can be covered: the best of some that were tried on `eros-observe`.
HOT, COLD = 0.01, 1e-4
#: Moves, moves for each picture, and patches looked at in all of them: some seconds.
MOVES, MOVES_EACH, MOST_LOOKS = 2_000_000, 1000, 100_000_000


def annealed(
    problem: AllocationProblem, start: tuple[Schedule, ...], rng: np.random.Generator, moves: int = MOVES
) -> tuple[Schedule, ...]:
    """Pictures that show at least as much as some to start with, which can be taken together."""
    pictures = problem.pictures
    if not len(pictures.agent):
        return start
    moves = min(
        moves, MOVES_EACH * len(pictures.agent), MOST_LOOKS * len(pictures.agent) // max(len(pictures.patch), 1)
    )
    number = np.full((problem.n_agents, problem.n_slots, problem.n_aims), -1, np.int64)
    number[pictures.agent, pictures.slot, pictures.aim] = np.arange(len(pictures.agent))
    held = np.full(number.shape[:2], -1, np.int64)
    for agent, taken in enumerate(start):
        for slot, aim in taken:
            held[agent, slot] = number[agent, slot, aim]
    heat = problem.coverable * HOT, (COLD / HOT) ** (1.0 / max(moves, 1))
    most = problem.n_slots * problem.n_agents if problem.most is None else problem.most
    best = _annealed(pictures, problem.weight, problem.slew, problem.budget, most, held, rng, moves, heat)
    return pictures_of(problem, best[best >= 0])


@kernel
def _annealed(
    pictures: Pictures,
    weight: Array,
    slew: Ints,
    budget: Ints,
    most: int,
    held: Ints,
    rng: np.random.Generator,
    moves: int,
    heat: tuple[float, float],
) -> Ints:
    """Number of the picture of each agent in each slot, -1 for none, shape (a, k), from `held`, which is changed."""
    shown, left, all_left = np.zeros(len(weight), np.int64), budget.copy(), most
    for y in held.ravel():
        if y >= 0:
            _count(pictures, y, 1, weight, shown)
            left[pictures.agent[y]] -= 1
            all_left -= 1
    gained, record, best, temperature = 0.0, 0.0, held.copy(), heat[0]
    reach, slots, dropped = int(slew.max()), held.shape[1], np.empty(held.shape[1], np.int64)
    for _ in range(moves):
        temperature *= heat[1]
        x = int(rng.random() * len(pictures.agent))
        agent, slot, aim = pictures.agent[x], pictures.slot[x], pictures.aim[x]
        if held[agent, slot] == x:
            continue
        count, change = 0, 0.0
        for k in range(max(slot - reach + 1, 0), min(slot + reach, slots)):
            y = held[agent, k]
            if y >= 0 and in_conflict(slew, agent, slot, aim, k, pictures.aim[y]):
                dropped[count] = y
                count += 1
        if count == 0 and min(left[agent], all_left) == 0:
            y = held[agent, int(rng.random() * slots)]
            if y < 0:
                continue
            dropped[0], count = y, 1
        for y in dropped[:count]:
            change += _count(pictures, y, -1, weight, shown)
        change += _count(pictures, x, 1, weight, shown)
        if change < 0.0 and rng.random() >= np.exp(change / temperature):
            _count(pictures, x, -1, weight, shown)
            for y in dropped[:count]:
                _count(pictures, y, 1, weight, shown)
            continue
        for y in dropped[:count]:
            held[agent, pictures.slot[y]] = -1
        held[agent, slot] = x
        left[agent] += count - 1
        all_left += count - 1
        gained += change
        if gained > record + 1e-9 * heat[0]:
            record, best[:] = gained, held
    shown[:] = 0
    for y in best.ravel():
        if y >= 0:
            _count(pictures, y, 1, weight, shown)
    for k in range(slots):
        for agent in range(len(budget)):  # what the others show as well is not taken
            y = best[agent, k]
            if y >= 0 and _count(pictures, y, -1, weight, shown) == 0.0:
                best[agent, k] = -1
            elif y >= 0:
                _count(pictures, y, 1, weight, shown)
    return best


@kernel
def _count(pictures: Pictures, x: int, by: int, weight: Array, shown: Ints) -> float:
    """Count a picture once more or less among those that show each patch; the change of the weight that is shown."""
    change = 0.0
    for n in range(pictures.first[x], pictures.first[x + 1]):
        q = pictures.patch[n]
        before = shown[q]
        shown[q] += by
        change += weight[q] * ((shown[q] > 0) - (before > 0))
    return change
