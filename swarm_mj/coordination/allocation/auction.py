"""The consensus-based bundle auction (CBBA): the swarm allocates pictures by itself, by messages to neighbours alone.

Choi, Brunet and How (2009, "Consensus-based decentralized auctions for robust task allocation", IEEE Transactions on Robotics
25(4)). Every agent keeps, for each patch, the highest bid that it knows and who made it, and of each other agent how old its
knowledge is. In turns it builds a bundle of pictures, one after the other the one that adds most, and hears what its neighbours
think (`Claims`). Here a picture claims all the patches that it shows and that its bid wins, and it bids what it adds.

What a picture adds never grows as an agent takes others or others claim more, because the value is submodular, so that bids
have the diminishing marginal gain that the proof asks for, without any correction. A bundle is built anew before each message,
so that it is what greedy choice gives with what is known now. On a graph on which everybody hears everybody, directly or not
and as late as may be, all then agree on the pictures that central greedy choice takes, and its bound (`greedy`) holds.

Where the graph falls apart, each component agrees in itself. A patch claimed in several is settled as soon as the components
hear each other again: the higher bid keeps it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.coordination.allocation.greedy import beats, best_picture, pictures_of, take
from swarm_mj.coordination.allocation.problem import AllocationProblem, Pictures, Schedule
from swarm_mj.typing import Array, Ints, Mask

#: Who has claimed a patch that nobody claims.
NOBODY = -1
#: When something was heard of an agent of whom nothing was.
NEVER = -1.0
#: Of a bid and of a time in a message [bit].
BID_BITS, STAMP_BITS = 64, 32
_LEAVE, _UPDATE, _RESET = 0, 1, 2


class Claims(NamedTuple):
    """What an agent tells its neighbours."""

    sender: int  #: who says it
    bid: Array  #: highest bid that it knows for each patch, shape (p,)
    winner: Ints  #: who made that, `NOBODY` for nobody, shape (p,)
    heard: Array  #: when what it knows of each agent was true, of itself now; infinite: lost, shape (a,)


class Auction:
    """An auction under way: what each agent plans and thinks.

    Args:
        problem: What is allocated.
        known: Weight of each patch as each agent knows it, shape (a, p). They agree even where they know different things.
        working: Who takes part, shape (a,).

    Attributes:
        bid: Highest bid for each patch that an agent (row) knows of, shape (a, p).
        winner: Who made it, `NOBODY` for nobody, shape (a, p).
        heard: When what an agent (row) knows of another (column) was true, shape (a, a).
    """

    def __init__(self, problem: AllocationProblem, known: Array, working: Mask) -> None:
        n, p = problem.n_agents, problem.n_patches
        self.problem, self.known, self.working = problem, known, working
        self.bid, self.winner = np.zeros((n, p)), np.full((n, p), NOBODY, np.int64)
        self.heard = np.full((n, n), NEVER)
        self._chosen: list[Ints] = [np.empty(0, np.int64)] * n

    @property
    def message_bits(self) -> int:
        """Length of a message: of each patch a bid and a winner, of each agent a time [bit]."""
        n, p = self.problem.n_agents, self.problem.n_patches
        return p * (BID_BITS + n.bit_length()) + n * STAMP_BITS

    @property
    def pictures(self) -> tuple[Schedule, ...]:
        """The pictures in the bundles now."""
        return pictures_of(self.problem, np.concatenate([*self._chosen, []]).astype(int))

    def plan(self, agent: int, now: float) -> None:
        """Build an agent's bundle with what it knows now; `now` grows from one call to the next."""
        problem = self.problem
        if self.working[agent]:
            self._chosen[agent] = build_bundle(
                problem.pictures,
                agent,
                self.known[agent],
                problem.slew,
                problem.budget[agent],
                self.bid[agent],
                self.winner[agent],
            )
            self.heard[agent, agent] = now

    def message(self, agent: int) -> Claims:
        """What an agent tells its neighbours."""
        return Claims(agent, self.bid[agent].copy(), self.winner[agent].copy(), self.heard[agent].copy())

    def hear(self, agent: int, claims: Claims) -> None:
        """An agent hears what another one thinks."""
        if self.working[agent]:
            hear_claims(agent, self.bid[agent], self.winner[agent], self.heard[agent], claims)

    def forget(self, agent: int, lost: Mask) -> None:
        """What those claimed whom an agent takes for lost, shape (a,), is free for it."""
        free = (self.winner[agent] >= 0) & lost[self.winner[agent]]
        self.bid[agent, free], self.winner[agent, free] = 0.0, NOBODY


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
