"""A coordinated swarm of four over a target of eight cells, flown by hand: losses, a graph that falls apart, two relays."""

from dataclasses import replace

import numpy as np
import pytest

from swarm_mj.coordination.coordinated_behavior import CoordinatedBehavior, CoordinationPlan, PicturePlan
from swarm_mj.coordination.encounter import Encounter
from swarm_mj.coordination.graph import Graph
from swarm_mj.coordination.replanning import MOST_SLOTS, planned_alone, planned_together, problem_of
from swarm_mj.dataflow.network import Access
from swarm_mj.mission.behaviors import SwarmView, TargetKind

N, CELLS, SLOTS, STEP = 4, 8, 30, 10.0
EVERYBODY = np.ones((N, N), bool)


@pytest.fixture(scope="module")
def encounter():
    """Everybody can show each cell by an aim of its own, always; turning takes two slots."""
    shows = np.zeros((N, CELLS, SLOTS, CELLS), bool)
    shows[:, np.arange(CELLS), :, np.arange(CELLS)] = True
    return Encounter(
        slot_s=STEP * np.arange(1, SLOTS + 1),
        aims_A=np.column_stack([np.full(CELLS, 1e3), 100.0 * np.arange(CELLS), np.zeros(CELLS)]),
        shows=shows,
        slew=np.tile(np.where(np.eye(CELLS, dtype=bool), 1, 2), (N, 1, 1)),
        area=1.0 + 0.1 * np.arange(CELLS),
        interval_s=STEP,
    )


class Hand:
    """Flies a mission by hand: pictures show what is aimed at; links and losses by the time."""

    def __init__(self, encounter, *, links=lambda t: EVERYBODY, works=lambda t: np.ones(N, bool), loss=0.0, **parts):
        pictures = parts.pop("pictures", tuple(() for _ in range(N)))
        self.works, self.seen = works, np.zeros((N, CELLS), bool)
        self.aims_A, self.links, self.loss = encounter.aims_A, links, loss
        self.swarm = CoordinatedBehavior(
            CoordinationPlan(
                encounter=encounter,
                pictures=pictures,
                succession=np.arange(N),
                cells_shown=self.cells_shown,
                graph=self.graph,
                silence_s=3.5 * STEP,
                seed=7,
                access=Access.PARALLEL,
                **{"sensing": "auction", "relay": "election", **parts},
            )
        )

    def cells_shown(self, view, j):
        shown = (self.aims_A == self.targets.vector[j]).all(axis=1)
        self.seen[j] |= shown
        return shown

    def graph(self, view, targets):
        rate = np.where(self.links(view.t), 1e5, 0.0)
        return Graph(
            rate_bit_s=rate,
            delay_s=np.full((N, N), 0.01),
            loss=np.full((N, N), self.loss),
            works=np.array(view.working),
        )

    def fly(self, until=(SLOTS + 1) * STEP):
        memory, history, zero = None, [], np.zeros((N, 3))
        steps = np.arange(0.0, until, STEP)
        for t in np.sort(np.concatenate([steps, steps + 0.5, steps + 4.5])):
            view = SwarmView(float(t), zero, zero, np.eye(3), working=self.works(t), camera_on=self.works(t))
            self.targets, memory = self.swarm.targets(view, memory)
            history.append((t, self.targets.kind.copy(), memory.relay.copy()))
        self.memory = memory
        return history

    def events(self, kind):
        return [e for e in self.swarm.log.events if e.kind == kind]


def lost_from(t0, *who):
    return lambda t: ~np.isin(np.arange(N), who) | (t < t0)


def test_all_is_seen_once_where_nothing_goes_wrong(encounter):
    hand = Hand(encounter)
    hand.fly()
    assert hand.seen.any(axis=0).all()
    assert hand.seen.sum() <= CELLS + 1  # one may be taken twice before the first messages are there
    assert not hand.events("silent") and len(hand.events("relays")) == 1


def test_what_a_lost_one_had_seen_is_seen_again_after_its_silence(encounter):
    hand = Hand(encounter, works=lost_from(35.0, 0))
    hand.fly()
    assert hand.seen[0].any()
    assert hand.seen[1:].any(axis=0).all()
    silent = hand.events("silent")
    assert {e.spacecraft for e in silent} == {1, 2, 3}
    # Last heard of at 30.5 s, and by others a step later at most.
    assert all(30.5 + 35.0 < e.time_s <= 30.5 + 35.0 + 2 * STEP for e in silent)


def test_a_plan_is_not_repaired(encounter):
    plan = planned_together(problem_of(encounter), 2.0)
    assert plan.value == pytest.approx(encounter.area.sum()) and plan.proven
    who = next(a for a in range(N) if plan.pictures[a])
    hand = Hand(encounter, sensing="plan", relay="plan", pictures=plan.pictures, works=lost_from(0.5, who))
    hand.fly()
    kinds = {k for _, kind, _ in hand.fly() for k in kind}
    assert kinds <= {TargetKind.SURFACE, TargetKind.EARTH, TargetKind.SPACECRAFT}
    assert hand.memory.bus.bits.sum() == 0


def repaired(encounter, plan, **more):
    return Hand(
        encounter, sensing="plan", pictures=plan.pictures, planned=PicturePlan(encounter, plan, repaired=True), **more
    )


def test_a_picture_that_fails_is_taken_again_by_who_missed_it(encounter):
    plan = planned_together(problem_of(encounter), 2.0)
    who = next(a for a in range(N) if plan.pictures[a])
    first = encounter.slot_s[plan.pictures[who][0][0]]
    quiet, failed = repaired(encounter, plan, relay="plan"), repaired(encounter, plan, relay="plan")
    quiet.fly()
    assert quiet.seen.any(axis=0).all() and quiet.swarm.log.repaired == 0
    assert quiet.swarm.log.as_planned == quiet.swarm.log.taken == sum(map(len, plan.pictures))
    shown = failed.cells_shown
    failed.cells_shown = lambda view, j: shown(view, j) & ~((j == who) & (abs(view.t - first) < 1.0))
    failed.swarm = CoordinatedBehavior(replace(failed.swarm.mission, cells_shown=failed.cells_shown))
    failed.fly()
    assert failed.swarm.log.repaired == 1
    assert failed.memory.knowledge.held.any(axis=(0, 1)).all()
    times = [slot for slot, _ in failed.memory.pictures[who]]
    assert len(times) == len(plan.pictures[who]) + 1 and min(np.diff(times)) >= 1
    others = [j for j in range(N) if j != who]
    assert all(failed.memory.pictures[j] == plan.pictures[j] for j in others if j < len(plan.pictures))


def test_those_who_hear_nothing_of_a_lost_one_take_its_pictures_too(encounter):
    plan = planned_together(problem_of(encounter), 2.0)
    who = next(a for a in range(N) if plan.pictures[a])
    alone, told = (repaired(encounter, plan, relay=relay, works=lost_from(0.5, who)) for relay in ("plan", "election"))
    alone.fly()
    told.fly()
    others = np.arange(N) != who
    assert not alone.seen[others].any(axis=0).all()
    assert told.seen[others].any(axis=0).all() and told.swarm.log.repaired >= 1


def test_alone_everybody_looks_at_everything(encounter):
    pictures = planned_alone(encounter).pictures
    assert all({aim for _, aim in taken} == set(range(CELLS)) for taken in pictures)


def test_lost_messages_cost_time_and_nothing_else(encounter):
    hand = Hand(encounter, loss=0.4)
    hand.fly()
    assert hand.seen.any(axis=0).all() and hand.memory.bus.lost > 0


def test_a_graph_that_falls_apart_has_a_relay_and_the_whole_target_in_each_part_and_then_one_relay_again(encounter):
    apart = np.kron(np.eye(2, dtype=bool), np.ones((2, 2), bool))
    hand = Hand(encounter, links=lambda t: apart if 5.0 < t < 215.0 else EVERYBODY)
    history = hand.fly(290.0)
    torn = next(relay for t, _, relay in history if t == 200.5)
    assert torn.tolist() == [0, 0, 2, 2]
    for part in ([0, 1], [2, 3]):  # each part took the other for lost and saw all by itself
        assert hand.seen[part].any(axis=0).all()
    # Two that claim the role hear each other: the one that comes later in the succession steps down.
    assert history[-1][2].tolist() == [0, 0, 0, 0]
    assert [e.spacecraft for e in hand.events("steps down")] == [2]
    assert 215.0 <= hand.events("steps down")[0].time_s <= 215.0 + 3 * STEP


def test_a_lost_relay_is_replaced_by_the_next_in_the_succession(encounter):
    hand = Hand(encounter, works=lost_from(100.0, 0))
    relay = hand.fly()[-1][2]
    assert relay[1:].tolist() == [1, 1, 1]
    assert [e.spacecraft for e in hand.events("relays")] == [0, 1]


def test_one_that_comes_first_but_was_out_of_reach_does_not_depose_who_relays(encounter):
    """Who stands goes before who does not: the swarm turns no dish for nothing."""
    alone = ~np.eye(N, dtype=bool)
    alone[0], alone[:, 0] = False, False
    hand = Hand(encounter, links=lambda t: alone if t < 100.0 else EVERYBODY)
    relay = hand.fly()[-1][2]
    # Both stood: spacecraft 0 for itself alone, 1 for the others; of two that stand the first in the succession stays.
    assert relay.tolist() == [0, 0, 0, 0]
    assert [e.spacecraft for e in hand.events("steps down")] == [1]


def test_an_empty_swarm_says_nothing_and_keeps_its_last_targets(encounter):
    hand = Hand(encounter, works=lambda t: np.full(N, t < 25.0))
    history = hand.fly()
    bits = hand.swarm.log.bits
    assert (bits[-1] == bits[3]).all() and not hand.events("silent")
    last = next(kind for t, kind, _ in history if t == 24.5)
    assert (history[-1][1] == last).all()


def test_a_swarm_that_is_empty_from_the_start_flies(encounter):
    hand = Hand(encounter, works=lambda t: np.zeros(N, bool))
    hand.fly()
    assert not hand.seen.any() and hand.memory.bus.sent == 0


def test_steady_for_never_passes_a_picture(encounter):
    swarm = Hand(encounter).swarm
    view = SwarmView(0.0, np.zeros((N, 3)), np.zeros((N, 3)), np.eye(3))
    for t in (0.0, 0.5, 9.5, 10.0, 10.5):
        rest = swarm.steady_for(view._replace(t=t), None)
        assert t + rest <= np.ceil(t / STEP) * STEP + 1e-9


def test_a_flight_goes_as_the_one_before(encounter):
    first, second = Hand(encounter, loss=0.2), Hand(encounter, loss=0.2)
    first.fly(), second.fly(), second.seen.fill(False), second.fly()
    assert (first.seen == second.seen).all() and first.swarm.log.events == second.swarm.log.events


def test_turning_away_takes_time_by_the_clock_and_not_by_the_number_of_pictures(encounter):
    """One picture each, minutes ahead: all first want the same cell, hear of it, and turn to others in time."""
    once = replace(
        encounter,
        slot_s=np.array([200.0]),
        shows=encounter.shows[:, :, :1],
        slew=np.tile(np.where(np.eye(CELLS, dtype=bool), 1, 3), (N, 1, 1)),
    )
    hand = Hand(once)
    hand.fly(240.0)
    assert (hand.seen.sum(axis=1) == 1).all() and hand.seen.any(axis=0).sum() == N
    assert hand.seen.any(axis=0)[-N:].all()  # the largest ones


def test_a_long_flight_is_planned_some_way_ahead_and_all_is_seen(encounter):
    long = replace(
        encounter,
        slot_s=STEP * np.arange(1, 10 * SLOTS + 1),
        shows=np.concatenate([np.zeros_like(encounter.shows)] * 9 + [encounter.shows], axis=2),
    )
    assert len(long.slot_s) > 2 * MOST_SLOTS
    hand = Hand(long)
    hand.fly(STEP * (10 * SLOTS + 1))
    assert hand.seen.any(axis=0).all()
