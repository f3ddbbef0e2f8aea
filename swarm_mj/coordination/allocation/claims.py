"""Kernels of the auction: how an agent builds its bundle, and what it makes of what a neighbour claims."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.coordination.allocation.greedy import beats, best_picture, take
from swarm_mj.coordination.allocation.problem import NOBODY, Pictures
from swarm_mj.typing import Array, Ints, kernel

#: When something was heard of an agent of whom nothing was.
NEVER = -1.0
_LEAVE, _UPDATE, _RESET = 0, 1, 2


class Claims(NamedTuple):
    """What an agent tells its neighbours.

    Attributes:
        sender: Who says it.
        bid: Highest bid that it knows for each patch, shape (p,).
        winner: Who made that, `NOBODY` for nobody, shape (p,).
        heard: When what it knows of each agent was true, of itself now; infinite: lost, shape (a,).
    """

    sender: int
    bid: Array
    winner: Ints
    heard: Array


@kernel
def build_bundle(
    pictures: Pictures, agent: int, weight: Array, slew: Ints, budget: int, bid: Array, winner: Ints
) -> Ints:
    """An agent's bundle from scratch; what it claims is written into `bid` and `winner`, and what it no longer claims is free.

    Args:
        pictures: All pictures of the problem.
        agent: Who.
        weight: Of each patch, as it knows it, shape (p,).
        slew: Of the problem.
        budget: Most pictures.
        bid: Highest bid that it knows for each patch, shape (p,).
        winner: Who made it, shape (p,).

    Returns:
        Numbers of its pictures, in the order in which they were chosen.
    """
    own, open_ = np.zeros(len(weight), np.bool_), np.ones(len(pictures.agent), np.bool_)
    chosen, count = np.empty(budget, np.int64), 0
    for q in range(len(weight)):
        if winner[q] == agent:
            bid[q], winner[q] = 0.0, NOBODY
    while count < budget:
        x, gain = best_picture(pictures, agent, open_, weight, own, bid, winner)
        if x < 0:
            break
        chosen[count] = x
        count += 1
        take(pictures, x, slew, open_)
        for n in range(pictures.first[x], pictures.first[x + 1]):
            q = pictures.patch[n]
            if not own[q] and beats(gain, agent, bid[q], winner[q]):
                bid[q], winner[q], own[q] = gain, agent, True
    return chosen[:count]


@kernel
def hear_claims(me: int, bid: Array, winner: Ints, heard: Array, claims: Claims) -> None:
    """What an agent thinks after it heard another: table I of Choi, Brunet and How.

    A message that was overtaken by later news of its sender says nothing new.

    Args:
        me: Who hears it.
        bid: Highest bid that it knows for each patch, changed, shape (p,).
        winner: Who made it, changed, shape (p,).
        heard: When what it knows of each agent was true, changed, shape (a,).
        claims: What it hears.
    """
    if claims.heard[claims.sender] < heard[claims.sender]:
        return
    for q in range(len(bid)):
        theirs, mine = claims.winner[q], winner[q]
        outbid = theirs >= 0 and beats(claims.bid[q], theirs, bid[q], mine)
        action = _action(me, claims.sender, theirs, mine, outbid, claims.heard, heard)
        if action == _UPDATE:
            bid[q], winner[q] = claims.bid[q], theirs
        elif action == _RESET:
            bid[q], winner[q] = 0.0, NOBODY
    for m in range(len(heard)):
        if m != me:
            heard[m] = max(heard[m], claims.heard[m])


@kernel
def _action(me: int, sender: int, theirs: int, mine: int, outbid: bool, heard_k: Array, heard_i: Array) -> int:
    """What to do about a patch of which the sender thinks that `theirs` has it, and the receiver that `mine` does."""
    other = mine >= 0 and mine != me and mine != sender
    news_of_mine = mine >= 0 and heard_k[mine] > heard_i[mine]
    action = _LEAVE
    if theirs == sender:
        if not other:
            action = _UPDATE if mine != me or outbid else _LEAVE
        elif news_of_mine or outbid:
            action = _UPDATE
    elif theirs == me:
        if mine == sender or (other and news_of_mine):
            action = _RESET
    elif theirs < 0:
        if mine == sender or (other and news_of_mine):
            action = _UPDATE
    else:
        news = heard_k[theirs] > heard_i[theirs]
        if mine == me:
            action = _UPDATE if news and outbid else _LEAVE
        elif mine == sender:
            action = _UPDATE if news else _RESET
        elif mine < 0 or mine == theirs:
            action = _UPDATE if news else _LEAVE
        elif news and (news_of_mine or outbid):
            action = _UPDATE
        elif news_of_mine and heard_i[theirs] > heard_k[theirs]:
            action = _RESET
    return action
