"""Random problems and graphs, and the optimum by trying everything."""

import numpy as np

from swarm_mj.coordination.allocation.problem import AllocationProblem


def random_problem(rng, *, longest_slew=3, agents=None, aims=None, slots=None):
    """A small problem; pictures show their own patch and now and then others, weights may be equal or nothing."""
    a, m, k = agents or rng.integers(1, 5), aims or rng.integers(1, 7), slots or rng.integers(1, 6)
    shows = (rng.random((a, m, k)) < 0.5)[..., None] & np.eye(m, dtype=bool)[:, None, :]
    shows |= rng.random((a, m, k, m)) < rng.choice([0.0, 0.15])
    return AllocationProblem(
        weight=rng.random(m) if rng.random() < 0.5 else rng.integers(0, 4, m).astype(float),
        shows=shows,
        slew=rng.integers(1, longest_slew + 1, (a, m, m)),
        budget=rng.integers(0, 4, a),
        available=rng.random((a, k)) < 0.9,
    )


def random_graph(rng, n, more=0.2):
    """Links that hold n agents together: a random tree, and more."""
    links = rng.random((n, n)) < more
    links |= links.T
    for i in range(1, n):
        j = rng.integers(i)
        links[i, j] = links[j, i] = True
    return links


def plain_problem(weight, feasible, slew, budget, available=()):
    """A problem in which a picture shows only the patch at which it is aimed; `feasible` has shape (agents, patches, slots)."""
    can = np.asarray(feasible, bool)
    a, p, _ = can.shape
    return AllocationProblem(
        weight=np.asarray(weight),
        shows=can[..., None] & np.eye(p, dtype=bool)[:, None, :],
        slew=np.broadcast_to(slew, (a, p, p)),
        budget=np.broadcast_to(budget, (a,)),
        available=np.asarray(available, bool),
    )


def guarantee(problem):
    """Share of the optimum that greedy choice is proven to reach, see `greedy`."""
    most = max((2 * (int(slew.max()) - 1) // int(slew.min()) + 1 for slew in problem.slew if slew.size), default=1)
    return 1.0 / (1.0 + most)


def can_be_taken(problem, pictures):
    """Whether all agents work when they take pictures, have time for the slews, and keep to their budgets."""
    return len(pictures) == problem.n_agents and all(
        len(taken) <= problem.budget[agent]
        and all(problem.available[agent, slot] for slot, _ in taken)
        and all(fits(problem.slew[agent], earlier, later) for n, later in enumerate(taken) for earlier in taken[:n])
        for agent, taken in enumerate(pictures)
    )


def most_by_trying(problem):
    """The optimum: every set of pictures of every agent, and every combination of what these show."""
    bits = 1 << np.arange(problem.n_patches)
    reached = {0}
    for agent in range(problem.n_agents):
        own = {(): 0}
        for _ in range(problem.budget[agent]):
            longer = {}
            for taken, mask in own.items():
                for slot in range(taken[-1][0] + 1 if taken else 0, problem.n_slots):
                    for aim in range(problem.n_aims):
                        shown = int(bits[problem.shows[agent, aim, slot]].sum())
                        if not problem.available[agent, slot] or not shown:
                            continue
                        if all(fits(problem.slew[agent], earlier, (slot, aim)) for earlier in taken):
                            longer[(*taken, (slot, aim))] = mask | shown
            own |= longer
        reached = {one | other for one in reached for other in set(own.values())}
    return max(sum(problem.weight[q] for q in range(problem.n_patches) if mask >> q & 1) for mask in reached)


def fits(slew, earlier, later):
    """Whether two pictures (slot, aim) of an agent can both be taken."""
    return later[0] > earlier[0] and later[0] - earlier[0] >= slew[earlier[1], later[1]]
