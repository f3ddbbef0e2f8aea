"""Who images what, when: the problem, its optimum with proof, greedy choice, an auction by messages, and repairs after losses.

- `problem`: `AllocationProblem(weight (p,), shows (a, m, k, p), slew (a, m, m), budget (a,), available (a, k))`, of agents a,
  aims m, slots k and patches p; `plain_problem(weight, feasible (a, p, k), slew, budget)`, where a picture shows its own patch
  only; `Allocation`: pictures (of each agent pairs (slot, aim)), who (p,), value, bound, status, rounds, bits, duplicates.
- `optimum`: `optimum(problem, time_limit_s)`, with bound and proof.
- `greedy`: `greedy(problem)`; `guarantee(problem)`, the proven share of the optimum.
- `auction`: `cbba(problem, links, delay=, loss=, rng=, working=)`; in flight `Auction(problem, known=, working=)` with `plan`,
  `message`, `hear`, `lose`, `agreed` and `allocation`: plan, tell the neighbours, hear them, and plan again.
- `losses`: `reallocate(problem, allocation, slot, lost, by=greedy, keep=True)`; `after_loss(problem, slot, ...)`.
"""
