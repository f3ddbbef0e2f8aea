"""Who images what, when: a problem of pictures, its optimum with proof, a greedy answer, an auction by messages, and losses.

problem = AllocationProblem(weight=(p,), shows=(a, m, k, p), slew=(a, m, m), budget=(a,), available=(a, k))   # `problem`
plain_problem(weight, feasible (a, p, k), slew, budget) -> AllocationProblem: every picture shows its own patch only
Allocation: pictures (per agent: (slot, aim), ...), who (p,), value, bound, status, rounds, messages, bits, duplicates

optimum(problem, time_limit_s=None, waiting=None) -> Allocation with bound and proof                          # `optimum`
greedy(problem) -> Allocation                                                                                # `greedy`
guarantee(problem) -> share of the optimum that greedy and a finished auction are proven to reach
cbba(problem, links, delay=0, loss=0.0, rng=None, ...) -> Allocation                                         # `auction`
Auction(problem, ...): the same in rounds, one `step(links)` at a time, for a swarm in flight; `lose`, `agreed`
after_loss(problem, seen, slot, taken=..., lost=...) -> what is left of a problem at a slot                   # `losses`
reallocate(problem, allocation, slot, lost, by=greedy, keep=True) -> Allocation of the whole encounter, repaired
encounter problem from geometry (patches, what pictures show by the criterion, slews)                        # `geometry`
"""
