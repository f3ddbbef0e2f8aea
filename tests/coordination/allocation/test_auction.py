"""The auction agrees, whatever the links do, on what central greedy choice takes; and it keeps its bound."""

import numpy as np
import pytest

from swarm_mj.coordination.allocation.auction import Claims, hear_claims
from swarm_mj.coordination.allocation.greedy import greedy
from tests.coordination.allocation.cases import (
    can_be_taken,
    guarantee,
    most_by_trying,
    plain_problem,
    random_graph,
    random_problem,
)
from tests.coordination.allocation.rounds import all_agree, begin, hold


def links_of(rng, n, case):
    """What the links do: always there, late, lossy, both; in some cases there by chance only, and then for good."""
    delay, loss = rng.integers(0, 4, (n, n)) if case % 4 in (1, 3) else 0, 0.4 if case % 4 in (2, 3) else 0.0
    graph = random_graph(rng, n)
    if case % 3 == 0:
        graph = np.concatenate([rng.random((10, n, n)) < 0.2, graph[None]])
    return {"links": graph, "delay": delay, "loss": loss, "rng": rng}


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("longest_slew", [1, 3])
def test_at_least_the_proven_share_and_nothing_claimed_twice(seed, longest_slew):
    rng, worst = np.random.default_rng([seed, longest_slew]), 1.0
    for case in range(125):
        problem = random_problem(rng, longest_slew=longest_slew)
        found = hold(problem, **links_of(rng, problem.n_agents, case))
        best = most_by_trying(problem)
        assert found.agreed and not found.duplicates and can_be_taken(problem, found.pictures)
        assert found.pictures == greedy(problem).pictures
        assert guarantee(problem) >= (0.5 if longest_slew == 1 else 1 / 6)
        assert found.value >= max(0.5, guarantee(problem)) * best - 1e-9
        worst = min(worst, found.value / best if best else 1.0)
    assert worst < 1.0


def test_the_first_auction_needs_as_many_rounds_as_the_graph_is_wide():
    # A line of agents who all want the one patch: that the lowest has it is known at the far end after n - 1 rounds.
    for n in (2, 4, 7):
        line = np.eye(n, k=1, dtype=bool) | np.eye(n, k=-1, dtype=bool)
        found = hold(plain_problem([1.0], np.ones((n, 1, 1), bool), 1, 1), line)
        assert found.winners == [[0]] and found.rounds == n - 1 and found.messages == n * (n - 1)


def test_a_message_has_a_bid_and_a_winner_of_each_patch_and_a_time_of_each_agent():
    assert begin(plain_problem([1.0], np.ones((7, 1, 1), bool), 1, 1)).message_bits == 64 + 3 + 7 * 32


def table(me, sender, theirs, mine, outbid, newer, older):
    """Table I of Choi, Brunet and How (2009), row by row; `newer(m)`: the sender knows more of m, `older(m)`: less."""
    if theirs == sender:
        if mine == me:
            return "update" if outbid else "leave"
        if mine in (sender, -1):
            return "update"
        return "update" if newer(mine) or outbid else "leave"
    if theirs == me:
        if mine == sender:
            return "reset"
        return "reset" if mine not in (me, -1) and newer(mine) else "leave"
    if theirs != -1:
        if mine == me:
            return "update" if newer(theirs) and outbid else "leave"
        if mine == sender:
            return "update" if newer(theirs) else "reset"
        if mine in (theirs, -1):
            return "update" if newer(theirs) else "leave"
        if newer(theirs) and newer(mine) or newer(theirs) and outbid:
            return "update"
        return "reset" if newer(mine) and older(theirs) else "leave"
    if mine in (me, -1):
        return "leave"
    return "update" if mine == sender or newer(mine) else "leave"


def test_every_rule_of_the_published_table():
    rng, me, sender, met = np.random.default_rng(3), 0, 1, set()
    for _ in range(4000):
        theirs, mine = (int(x) for x in rng.integers(-1, 4, 2))
        bid, their_bid = (
            float(x) if who >= 0 else 0.0 for x, who in zip(rng.integers(1, 4, 2), (mine, theirs), strict=True)
        )
        heard, their_heard = (rng.integers(0, 3, 4).astype(float) for _ in range(2))
        their_heard[sender] = 5.0
        outbid = theirs >= 0 and (mine < 0 or (-their_bid, theirs) < (-bid, mine))
        expected = table(
            me,
            sender,
            theirs,
            mine,
            outbid,
            lambda m: their_heard[m] > heard[m],  # noqa: B023
            lambda m: their_heard[m] < heard[m],  # noqa: B023
        )
        after = {"update": (their_bid, theirs), "reset": (0.0, -1), "leave": (bid, mine)}[expected]
        bids, winners, times = np.array([bid]), np.array([mine]), heard.copy()
        hear_claims(me, bids, winners, times, Claims(sender, np.array([their_bid]), np.array([theirs]), their_heard))
        assert (bids[0], winners[0]) == after, (theirs, mine, expected)
        assert (times[1:] == np.maximum(heard, their_heard)[1:]).all() and times[0] == heard[0]
        met.add((min(theirs, 2), min(mine, 2), theirs == mine, expected))
    assert len(met) >= 24


@pytest.mark.parametrize("known_at", [3.0, np.inf])
def test_a_message_that_was_overtaken_or_comes_from_a_lost_one_says_nothing(known_at):
    bid, winner, heard = np.array([0.0]), np.array([-1]), np.array([0.0, known_at, 0.0])
    hear_claims(0, bid, winner, heard, Claims(1, np.array([9.0]), np.array([1]), np.array([0.0, 2.0, 5.0])))
    assert bid[0] == 0.0 and winner[0] == -1 and heard.tolist() == [0.0, known_at, 0.0]


def test_components_agree_in_themselves_and_settle_when_they_meet():
    rng = np.random.default_rng(4)
    for _ in range(20):
        problem = random_problem(rng, agents=6, aims=6, slots=5)
        apart = np.zeros((6, 6), bool)
        apart[:3, :3] = apart[3:, 3:] = True
        found = hold(problem, apart)
        assert found.agreed
        for group in (slice(0, 3), slice(3, 6)):
            alone = np.zeros(6, bool)
            alone[group] = True
            inside = hold(problem, apart, working=alone)
            assert inside.pictures[group] == found.pictures[group] and not inside.duplicates
            assert all(not taken for a, taken in enumerate(inside.pictures) if not alone[a])
        meeting = apart.copy()
        meeting[2, 3] = meeting[3, 2] = True
        together = hold(problem, np.concatenate([np.repeat(apart[None], 10, axis=0), meeting[None]]))
        assert together.agreed and not together.duplicates
        assert together.pictures == greedy(problem).pictures
    twice = hold(plain_problem([1.0], np.ones((2, 1, 1), bool), 1, 1), np.zeros((2, 2), bool))
    assert twice.duplicates == (0,) and twice.winners == [[0, 1]] and twice.value == 1.0


def test_what_the_lost_had_claimed_is_free_for_those_who_take_them_for_lost():
    rng = np.random.default_rng(5)
    for _ in range(30):
        problem = random_problem(rng, agents=5, aims=6, slots=5)
        links, lost = random_graph(rng, 5, more=1.0), int(rng.integers(5))
        auction, working = begin(problem), np.ones(5, bool)
        for now in range(40):
            if now == 20:
                working = auction.working = np.arange(5) != lost
            for agent in np.flatnonzero(working):
                auction.forget(int(agent), ~working)
                auction.plan(int(agent), now)
            said = [auction.message(agent) for agent in range(5) if auction.working[agent]]
            for claims in said:
                for agent in np.flatnonzero(links[claims.sender]):
                    auction.hear(int(agent), claims)
        assert all_agree(auction, links) and not (auction.winner[working] == lost).any()
        alone = hold(problem, links, working=working).pictures
        assert [auction.pictures[a] for a in range(5) if a != lost] == [alone[a] for a in range(5) if a != lost]


def test_agents_agree_who_disagree_on_what_is_seen():
    rng = np.random.default_rng(6)
    for _ in range(30):
        problem = random_problem(rng, agents=4, aims=6, slots=5)
        links = random_graph(rng, 4)
        auction = begin(problem, known=problem.weight * (rng.random((4, 6)) < 0.7))
        for now in range(60):
            for agent in range(4):
                auction.plan(agent, now)
            said = [auction.message(agent) for agent in range(4)]
            for claims in said:
                for agent in np.flatnonzero(links[claims.sender]):
                    auction.hear(int(agent), claims)
            if all_agree(auction, links):
                break
        assert all_agree(auction, links)


def test_nobody_agrees_on_nothing():
    nobody = hold(plain_problem([1.0], np.ones((0, 1, 1), bool), 1, 1), np.zeros((0, 0), bool))
    assert nobody.agreed and nobody.pictures == () and nobody.value == 0.0
