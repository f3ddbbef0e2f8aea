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


def most_by_trying(problem, fixed=None, first_slot=0, lost=None):
    """The optimum: every set of pictures of every agent, and every combination of what these show.

    With `fixed` pictures every set that holds these, and besides none before the first slot, and none of those who are lost.
    """
    fixed = fixed or ((),) * problem.n_agents
    bits = 1 << np.arange(problem.n_patches)
    reached = {0}
    for agent in range(problem.n_agents):
        start = problem.shown_by(tuple(fixed[agent] if a == agent else () for a in range(problem.n_agents)))
        own = {fixed[agent]: int(bits[start].sum())}
        for _ in range(0 if lost is not None and lost[agent] else problem.budget[agent] - len(fixed[agent])):
            longer = {}
            for taken, mask in own.items():
                new = taken[len(fixed[agent]) :]
                for slot in range(new[-1][0] + 1 if new else first_slot, problem.n_slots):
                    for aim in range(problem.n_aims):
                        shown = int(bits[problem.shows[agent, aim, slot]].sum())
                        if not problem.available[agent, slot] or not shown:
                            continue
                        if all(fits(problem.slew[agent], *sorted([(s, other), (slot, aim)])) for s, other in taken):
                            longer[(*taken, (slot, aim))] = mask | shown
            own |= longer
        reached = {one | other for one in reached for other in set(own.values())}
    return max(sum(problem.weight[q] for q in range(problem.n_patches) if mask >> q & 1) for mask in reached)


def fits(slew, earlier, later):
    """Whether two pictures (slot, aim) of an agent can both be taken."""
    return later[0] > earlier[0] and later[0] - earlier[0] >= slew[earlier[1], later[1]]
