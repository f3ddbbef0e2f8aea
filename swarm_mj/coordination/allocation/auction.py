"""The consensus-based bundle auction (CBBA): the swarm allocates pictures by itself, by messages to neighbours alone.

Choi, Brunet and How (2009, "Consensus-based decentralized auctions for robust task allocation", IEEE Transactions on Robotics
25(4)). Every agent keeps, for each patch, the highest bid that it knows and who made it, and of each other agent how old its
knowledge is. In turns it builds a bundle of pictures, one after the other the one that adds most, and hears what its neighbours
think (`claims`). Here a picture claims all the patches that it shows and that its bid wins, and it bids what it adds.

What a picture adds never grows as an agent takes others or others claim more, because the value is submodular, so that bids
have the diminishing marginal gain that the proof asks for, without any correction. A bundle is built anew before each message,
so that it is what greedy choice gives with what is known now. On a graph on which everybody hears everybody, directly or not
and as late as may be, all then agree on the pictures that central greedy choice takes, and `greedy.guarantee` holds.

Where the graph falls apart, each component agrees in itself. A patch claimed in several is told (`Allocation.duplicates`), and
settled as soon as the components hear each other again: the higher bid keeps it.
"""

from __future__ import annotations

from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components

from swarm_mj.coordination.allocation.claims import NEVER, Claims, build_bundle, hear_claims
from swarm_mj.coordination.allocation.greedy import pictures_of
from swarm_mj.coordination.allocation.problem import NOBODY, AgentPictures, Allocation, AllocationProblem, allocation_of
from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Ints, Mask

#: Of a bid and of a time in a message [bit].
BID_BITS, STAMP_BITS = 64, 32
#: Rounds after which an auction that does not end is given up.
MAX_ROUNDS = 1000


class Auction:
    """An auction under way: what each agent plans and thinks.

    Args:
        problem: What is allocated.
        known: Weight of each patch as each agent knows it, shape (a, p); default: the problem's. Agreement comes all the same.
        working: Who takes part, shape (a,); default: all.

    Attributes:
        bid: Highest bid for each patch that an agent (row) knows of, shape (a, p).
        winner: Who made it, `NOBODY` for nobody, shape (a, p).
        heard: When what an agent (row) knows of another (column) was true, infinite where it is known to be lost, shape (a, a).
    """

    def __init__(
        self, problem: AllocationProblem, *, known: ArrayLike | None = None, working: ArrayLike | None = None
    ) -> None:
        n, p = problem.n_agents, problem.n_patches
        self.problem = problem
        self.known = np.array(np.broadcast_to(problem.weight if known is None else np.asarray(known, float), (n, p)))
        self.working = np.array(np.broadcast_to(True if working is None else np.asarray(working, np.bool_), (n,)))
        self.bid, self.winner = np.zeros((n, p)), np.full((n, p), NOBODY, np.int64)
        self.heard = np.full((n, n), NEVER)
        self._chosen: list[Ints] = [np.empty(0, np.int64)] * n

    @property
    def message_bits(self) -> int:
        """Length of a message: of each patch a bid and a winner, of each agent a time [bit]."""
        return self.problem.n_patches * (BID_BITS + self.problem.n_agents.bit_length()) + (
            self.problem.n_agents * STAMP_BITS
        )

    @property
    def pictures(self) -> AgentPictures:
        """The pictures in the bundles now."""
        return pictures_of(
            self.problem.n_agents, self.problem.pictures, np.concatenate([*self._chosen, []]).astype(int)
        )

    def plan(self, agent: int, now: float) -> None:
        """Build an agent's bundle with what it knows now; `now` grows from one call to the next."""
        if self.working[agent]:
            self._chosen[agent] = self._built(agent, self.bid[agent], self.winner[agent])
            self.heard[agent, agent] = now

    def _built(self, agent: int, bid: Array, winner: Ints) -> Ints:
        """Numbers of the pictures of an agent's bundle; `bid` and `winner`, shape (p,), are changed to what it claims."""
        problem = self.problem
        built: Ints = build_bundle(
            problem.pictures, agent, self.known[agent], problem.slew, problem.budget[agent], bid, winner
        )
        return built

    def message(self, agent: int) -> Claims:
        """What an agent tells its neighbours."""
        return Claims(agent, self.bid[agent].copy(), self.winner[agent].copy(), self.heard[agent].copy())

    def hear(self, agent: int, claims: Claims) -> None:
        """An agent hears what another one thinks."""
        if self.working[agent]:
            hear_claims(agent, self.bid[agent], self.winner[agent], self.heard[agent], claims)

    def lose(self, lost: int, known_by: ArrayLike = True) -> None:
        """An agent is lost: it plans, says and hears nothing any more, and what it claimed is free for those who know.

        Messages spread the knowledge to the others.

        Args:
            lost: Who.
            known_by: Who knows at once, shape (a,).
        """
        self.working[lost] = False
        self._chosen[lost] = np.empty(0, np.int64)
        knowing = np.array(np.broadcast_to(known_by, self.working.shape), np.bool_)
        self.heard[knowing, lost] = np.inf
        free = knowing[:, None] & (self.winner == lost)
        self.bid[free], self.winner[free] = 0.0, NOBODY

    def components(self, links: Mask) -> list[Ints]:
        """Groups of working agents of which each hears each, directly or not; `links[i, j]`: i can send to j."""
        works = np.flatnonzero(self.working)
        _, label = connected_components(links[np.ix_(works, works)], connection="strong")
        return [works[label == group] for group in range(int(label.max(initial=-1)) + 1)]

    def agreed(self, links: Mask, under_way: list[tuple[int, Claims]] | tuple[()] = ()) -> bool:
        """Whether all agents of each component think the same, and no message alters that.

        Args:
            links: Whether i can send to j, shape (a, a).
            under_way: Messages that have not arrived, and who will hear them.
        """
        for group in self.components(links):
            same_bid, same_winner = (
                (self.bid[group] == self.bid[group[0]]),
                (self.winner[group] == self.winner[group[0]]),
            )
            if not (same_bid.all() and same_winner.all()):
                return False
        for agent in map(int, np.flatnonzero(self.working)):
            bid, winner, heard = self.bid[agent].copy(), self.winner[agent].copy(), self.heard[agent].copy()
            for receiver, claims in under_way:
                if receiver == agent:
                    hear_claims(agent, bid, winner, heard, claims)
            for sender in np.flatnonzero(links[:, agent] & self.working):
                hear_claims(agent, bid, winner, heard, self.message(int(sender)))
            self._built(agent, bid, winner)
            if (bid != self.bid[agent]).any() or (winner != self.winner[agent]).any():
                return False
        return True

    def claimed(self) -> Mask:
        """Which patches each working agent thinks that it answers for, shape (a, p)."""
        own = self.winner == np.arange(self.problem.n_agents)[:, None]
        return np.asarray(own & self.working[:, None])

    def allocation(self, status: str, **told: float) -> Allocation:
        """What the bundles come to now; of several who claim a patch the higher bid answers for it."""
        claimed = self.claimed()
        found = allocation_of(self.problem, self.pictures)
        claims = claimed.sum(axis=0)
        bids = np.vstack([np.where(claimed, self.bid, -1.0), np.full_like(claims, -1.0, np.float64)])
        who = np.where(claims > 0, bids.argmax(axis=0), found.who)
        duplicates = tuple(int(q) for q in np.flatnonzero(claims > 1))
        return allocation_of(self.problem, found.pictures, status=status, who=who, duplicates=duplicates, **told)


class _Sent(NamedTuple):
    due: int
    receiver: int
    claims: Claims


def cbba(
    problem: AllocationProblem,
    links: ArrayLike,
    *,
    delay: ArrayLike = 0,
    loss: ArrayLike = 0.0,
    rng: np.random.Generator | None = None,
    working: ArrayLike | None = None,
    max_rounds: int = MAX_ROUNDS,
) -> Allocation:
    """Hold an auction in rounds: all plan, all send to their neighbours, all hear what arrives, until they agree.

    Args:
        problem: What is allocated.
        links: Whether i can send to j, shape (a, a), or (rounds, a, a) where that changes; the last then stays.
        delay: Rounds for which a message is under way before it is heard, a number or shape (a, a).
        loss: Chance that a message is lost on its way to one receiver, a number or shape (a, a).
        rng: Says which messages are lost.
        working: Who takes part, shape (a,); default: all.
        max_rounds: When to give up.

    Returns:
        The allocation: 'agreed', or 'not agreed' after the last round. A message to all neighbours counts once.

    Raises:
        MissionError: An argument does not fit.
    """
    begun, n = perf_counter(), problem.n_agents
    graph = _graph(links, n)
    late = np.broadcast_to(np.asarray(delay, np.int64), (n, n))
    chance = np.broadcast_to(np.asarray(loss, np.float64), (n, n))
    if (late < 0).any() or not ((chance >= 0.0) & (chance < 1.0)).all():
        raise MissionError(
            f"delay, loss: a delay of {late.min()} must be 0 or more, and a chance of {chance.max()} at least 0 and below 1"
        )
    if chance.any() and rng is None:
        raise MissionError("loss: messages are lost by chance, pass rng = numpy.random.default_rng(SEED)")
    auction, under_way, messages, done = Auction(problem, working=working), list[_Sent](), 0, 0
    agreed = False
    while done < max_rounds and not agreed:
        open_ = graph[min(done, len(graph) - 1)]
        for agent in range(n):
            auction.plan(agent, float(done))
        for sender in np.flatnonzero(auction.working & open_.any(axis=1)):
            messages += 1
            claims = auction.message(int(sender))
            for receiver in np.flatnonzero(open_[sender]):
                if rng is None or rng.random() >= chance[sender, receiver]:
                    under_way.append(_Sent(done + int(late[sender, receiver]), int(receiver), claims))
        for sent in under_way:
            if sent.due <= done:
                auction.hear(sent.receiver, sent.claims)
        under_way = [sent for sent in under_way if sent.due > done]
        done += 1
        if done >= len(graph):
            agreed = auction.agreed(graph[-1], [(sent.receiver, sent.claims) for sent in under_way])
    for agent in range(n):
        auction.plan(agent, float(done))
    return auction.allocation(
        "agreed" if agreed else "not agreed",
        rounds=done,
        messages=messages,
        bits=messages * auction.message_bits,
        seconds=perf_counter() - begun,
    )


def _graph(links: ArrayLike, n: int) -> Mask:
    """Links by round, shape (rounds, n, n), without those to oneself."""
    graph = np.asarray(links, np.bool_)
    graph = graph[None] if graph.ndim == 2 else graph
    if graph.ndim != 3 or graph.shape[1:] != (n, n) or not len(graph):
        raise MissionError(f"links: shape {np.shape(links)} must be ({n}, {n}), or (rounds, {n}, {n})")
    return graph & ~np.eye(n, dtype=np.bool_)
