"""An auction held in rounds, over links that delay and lose messages, until all who hear one another agree."""

from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components

from swarm_mj.coordination.allocation.auction import Auction, build_bundle, hear_claims


class Outcome(NamedTuple):
    """What an auction came to; `duplicates` are patches that several agents think they answer for."""

    agreed: bool
    pictures: tuple
    value: float
    duplicates: tuple
    winners: list
    rounds: int
    messages: int


def begin(problem, *, known=None, working=True):
    """An auction in which all know the weights, and take part, where nothing else is said."""
    n, p = problem.n_agents, problem.n_patches
    weight = np.broadcast_to(problem.weight if known is None else known, (n, p))
    return Auction(problem, np.array(weight, float), np.array(np.broadcast_to(working, (n,)), bool))


def hold(problem, links, *, delay=0, loss=0.0, rng=None, working=True, max_rounds=1000):
    """All plan, all send to their neighbours, all hear what arrives, until they agree.

    Args:
        problem: What is allocated.
        links: Whether i can send to j, shape (a, a), or (rounds, a, a) where that changes; the last then stays.
        delay: Rounds for which a message is under way before it is heard, a number or shape (a, a).
        loss: Chance that a message is lost on its way to one receiver.
        rng: Says which messages are lost.
        working: Who takes part, shape (a,).
        max_rounds: When to give up.
    """
    n = problem.n_agents
    graph = np.asarray(links, bool)
    graph = (graph[None] if graph.ndim == 2 else graph) & ~np.eye(n, dtype=bool)
    late = np.broadcast_to(delay, (n, n))
    auction, under_way, messages, done, agreed = begin(problem, working=working), [], 0, 0, False
    while done < max_rounds and not agreed:
        open_ = graph[min(done, len(graph) - 1)]
        for agent in range(n):
            auction.plan(agent, float(done))
        for sender in np.flatnonzero(auction.working & open_.any(axis=1)):
            messages += 1
            claims = auction.message(int(sender))
            for receiver in map(int, np.flatnonzero(open_[sender])):
                if rng is None or rng.random() >= loss:
                    under_way.append((done + late[sender, receiver], receiver, claims))
        for due, receiver, claims in under_way:
            if due <= done:
                auction.hear(receiver, claims)
        under_way = [sent for sent in under_way if sent[0] > done]
        done += 1
        agreed = done >= len(graph) and all_agree(auction, graph[-1], [sent[1:] for sent in under_way])
    for agent in range(n):
        auction.plan(agent, float(done))
    claimed = (auction.winner == np.arange(n)[:, None]) & auction.working[:, None]
    return Outcome(
        agreed,
        auction.pictures,
        problem.value_of(auction.pictures),
        tuple(np.flatnonzero(claimed.sum(axis=0) > 1).tolist()),
        [np.flatnonzero(column).tolist() for column in claimed.T],
        done,
        messages,
    )


def all_agree(auction, links, under_way=()):
    """Whether all agents of each component think the same, and no message alters that.

    Args:
        auction: Under way.
        links: Whether i can send to j, shape (a, a).
        under_way: Messages that have not arrived: who will hear them, and what they say.
    """
    works, problem = np.flatnonzero(auction.working), auction.problem
    _, label = connected_components(links[np.ix_(works, works)], connection="strong")
    for component in range(int(label.max(initial=-1)) + 1):
        group = works[label == component]
        if (auction.bid[group] != auction.bid[group[0]]).any():
            return False
        if (auction.winner[group] != auction.winner[group[0]]).any():
            return False
    for agent in map(int, works):
        bid, winner, heard = (array[agent].copy() for array in (auction.bid, auction.winner, auction.heard))
        coming = [claims for receiver, claims in under_way if receiver == agent]
        coming += [auction.message(int(sender)) for sender in np.flatnonzero(links[:, agent] & auction.working)]
        for claims in coming:
            hear_claims(agent, bid, winner, heard, claims)
        weight, budget = auction.known[agent], problem.budget[agent]
        build_bundle(problem.pictures, agent, weight, problem.slew, budget, bid, winner)
        if (bid != auction.bid[agent]).any() or (winner != auction.winner[agent]).any():
            return False
    return True
