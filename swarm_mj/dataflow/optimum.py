"""What a swarm that knows everything beforehand can deliver, with proof: the program of `program`, solved by HiGHS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import csr_array, vstack

from swarm_mj.dataflow.network import EARTH, Network
from swarm_mj.dataflow.time_expanded_program import Program, build_program
from swarm_mj.errors import MissionError
from swarm_mj.io import highs
from swarm_mj.typing import Array

#: Values that differ relatively by less are taken for the same: HiGHS works to this accuracy, not to the last bit.
SAME = 1e-9
#: Least that HiGHS takes for the accuracy of constraints and of their prices.
_TOLERANCE = 1e-10
#: Columns from which on an interior point, then a crossover to a corner, is faster than walking along corners.
LARGE = 10_000

Waiting = Callable[[float], None] | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Schedule:
    """Who sends how much to whom, and when."""

    value: float  #: area delivered [m^2]
    #: no schedule delivers more [m^2]; follows from the prices of the constraints alone, see `dual_bound`, and with whole tiles
    #: from HiGHS' search
    bound: float
    taken: Array  #: share of each tile that is taken from each spacecraft's copy, shape (n, q)
    swarm_bit: Array  #: bits sent from i to j in a slot, shape (T, n, n)
    earth_bit: Array  #: bits sent to Earth, shape (T, n)
    aboard_bit: Array  #: bits aboard at each edge that are on their way to Earth, shape (T + 1, n)
    status: str  #: 'optimal', or 'time limit' where that is not proven (whole tiles only)

    @property
    def delivered_share(self) -> Array:
        """Of each tile, shape (q,)."""
        return self.taken.sum(axis=0)


def optimum(
    network: Network,
    *,
    whole: bool = False,
    neighbours: int | None = None,
    time_limit_s: float | None = None,
    waiting: Waiting = None,
) -> Schedule:
    """The schedule that delivers most.

    Args:
        network: What to deliver.
        whole: Deliver a tile wholly and from one copy, or not at all; otherwise parts of tiles count as parts of their area.
        neighbours: Leave out crosslinks other than those to spacecraft that ever reach Earth and to this many others, to whom
            most can be sent in the slot. The program is smaller, its bound holds for such schedules only, and what it
            delivers can be delivered with all links too. None: all links.
        time_limit_s: When to stop [s]; None: never.
        waiting: Called now and then with the seconds that have passed.

    Raises:
        MissionError: Nothing was found in time, or neighbours is negative.
    """
    if neighbours is not None and neighbours < 0:
        raise MissionError(f"neighbours = {neighbours}: must be 0, more, or None for all links")
    program = build_program(network, neighbours)
    if not len(program.copies):
        return _schedule(network, program, np.zeros(len(program.c)), 0.0, "optimal")
    solve = _solve_whole if whole else _solve_shares
    answer = solve(program, time_limit_s, waiting)
    if answer.x is None or (not whole and answer.status == 1):
        raise MissionError(
            f"time_limit_s = {time_limit_s}: no schedule in that time; allow more, or set neighbours = 4"
        )
    if answer.status not in (0, 1):
        raise MissionError(f"HiGHS could not solve the problem: {answer.message}")
    bound = -float(answer.mip_dual_bound) if whole else -dual_bound(program, answer)
    status = "optimal" if answer.status == 0 else "time limit"
    return _schedule(network, program, answer.x, bound * program.value_unit, status)


class EarliestFull(NamedTuple):
    """When all that can be delivered is."""

    n_slots: int  #: slots after which it is; 0 where nothing can be delivered
    time_s: float  #: their end, from the start of the window [s]
    value: float  #: what can be delivered [m^2]
    value_before: float  #: what one slot less can deliver at most [m^2], which is less: the proof


def earliest_full(network: Network, *, neighbours: int | None = None, waiting: Waiting = None) -> EarliestFull:
    """The first number of slots in which everything that the whole window can deliver is delivered.

    What can be delivered grows with the window, so that halving finds the number.

    Args:
        network: What to deliver.
        neighbours: As for `optimum`.
        waiting: Called now and then with the seconds that have passed.

    Raises:
        MissionError: neighbours is negative.
    """
    full = optimum(network, neighbours=neighbours, waiting=waiting).value
    if full == 0.0:
        return EarliestFull(0, 0.0, 0.0, 0.0)
    too_few, enough, before = 0, network.n_slots, 0.0
    while enough - too_few > 1:
        middle = (too_few + enough) // 2
        schedule = optimum(network.until(middle), neighbours=neighbours, waiting=waiting)
        if schedule.value >= full * (1.0 - SAME):
            enough = middle
        else:
            too_few, before = middle, schedule.bound
    return EarliestFull(enough, float(network.edges_s[enough] - network.edges_s[0]), full, before)


def dual_bound(program: Program, answer: Any) -> float:
    """Least cost by weak duality, from the marginals of an answer of `linprog` and the program's own numbers.

    Whatever the prices are, if only those of inequalities are not positive, no x costs less than
    b_ub . price + sum_j min(0, reduced cost_j) upper_j, the right side of the balance being 0.
    """
    price_ub = np.minimum(answer.ineqlin.marginals, 0.0)
    reduced = program.c - program.a_eq.T @ answer.eqlin.marginals - program.a_ub.T @ price_ub
    return float(program.b_ub @ price_ub + np.minimum(reduced, 0.0) @ program.upper)


def _solve_shares(program: Program, time_limit_s: float | None, waiting: Waiting) -> Any:
    arguments = {
        "c": program.c,
        "A_ub": program.a_ub,
        "b_ub": program.b_ub,
        "A_eq": program.a_eq,
        "b_eq": np.zeros(program.a_eq.shape[0]),
        "bounds": np.stack([np.zeros(len(program.c)), program.upper], axis=1),
        "method": "highs-ipm" if len(program.c) > LARGE else "highs",
        "options": {"primal_feasibility_tolerance": _TOLERANCE, "dual_feasibility_tolerance": _TOLERANCE},
    }
    return highs.solve(arguments, time_limit_s, waiting, by=linprog)


def _solve_whole(program: Program, time_limit_s: float | None, waiting: Waiting) -> Any:
    equal = np.zeros(program.a_eq.shape[0])
    both = csr_array(vstack([program.a_eq, program.a_ub]))
    low = np.concatenate([equal, np.full(len(program.b_ub), -np.inf)])
    arguments = {
        "c": program.c,
        "constraints": LinearConstraint(both, low, np.concatenate([equal, program.b_ub])),
        "bounds": Bounds(0.0, program.upper),
        "integrality": (np.arange(len(program.c)) < len(program.copies)).astype(np.int64),
        "options": {"mip_rel_gap": 0.0},
    }
    return highs.solve(arguments, time_limit_s, waiting, by=milp)


def _schedule(network: Network, program: Program, x: Array, bound: float, status: str) -> Schedule:
    links, n_copies, n_links = program.links, len(program.copies), len(program.links.slot)
    taken = np.zeros((network.n_spacecraft, network.n_tiles))
    taken[program.copies[:, 0], program.copies[:, 1]] = np.clip(x[:n_copies], 0.0, 1.0)
    sent = np.clip(x[n_copies : n_copies + n_links], 0.0, 1.0) * links.bits
    inside = links.receiver != EARTH
    swarm, earth = np.zeros(network.swarm_bit.shape), np.zeros(network.earth_bit.shape)
    swarm[links.slot[inside], links.sender[inside], links.receiver[inside]] = sent[inside]
    earth[links.slot[~inside], links.sender[~inside]] = sent[~inside]
    return Schedule(
        value=float(network.value @ taken.sum(axis=0)),
        bound=bound,
        taken=taken,
        swarm_bit=swarm,
        earth_bit=earth,
        aboard_bit=_aboard(network, taken, swarm, earth),
        status=status,
    )


def _aboard(network: Network, taken: Array, swarm: Array, earth: Array) -> Array:
    """What is aboard at each edge: pictures and arrivals before it, less what was sent before it."""
    comes = np.zeros((network.n_slots + 1, network.n_spacecraft))
    spacecraft, tile = np.nonzero(taken)
    np.add.at(
        comes, (network.ready[spacecraft, tile], spacecraft), taken[spacecraft, tile] * network.bits[spacecraft, tile]
    )
    comes[1:] += swarm.sum(axis=1) - swarm.sum(axis=2) - earth
    return comes.cumsum(axis=0)
