"""Swarm classes in flight: class 2 is the behaviour itself, the others fly, talk and pay for it."""

import numpy as np
import pytest

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight.coordination import CoordinatedMissionBehavior
from swarm_mj.flight.downlink import deliver
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import behavior_from, make_plan
from swarm_mj.records.summary import summarise
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

QUICK = ("observation.observer=horizon", "duration_s=800", "target.cell_size_m=900")


def flown(level, *more):
    plan = make_plan(
        load_scenario(
            "eros-observe", parse_overrides([*QUICK, f"swarm={{class: {level}, plan_time_limit_s: 2}}", *more])
        )
    )
    return plan, simulate(plan)


@pytest.fixture(scope="module")
def talked():
    return flown(4, "faults=[{kind: spacecraft_lost, spacecraft: sc5, at_s: 100}]")


def test_class_2_is_the_behaviour_itself():
    plain, classed = (load_scenario("eros-observe", parse_overrides(more)) for more in ([], ["swarm.class=2"]))
    assert behavior_from(classed) == behavior_from(plain)
    assert isinstance(behavior_from(load_scenario("eros-observe", {"swarm.class": 4})), CoordinatedMissionBehavior)


def test_the_class_is_read_and_written_by_its_key():
    scenario = load_scenario("eros-observe", {"swarm.class": 3})
    assert scenario.swarm.level == 3 and scenario.model_dump(mode="json")["swarm"]["class"] == 3
    assert load_scenario(scenario.model_dump(mode="json")) == scenario
    with pytest.raises(ScenarioError, match="swarm.class"):
        load_scenario("eros-observe", {"swarm.class": 5})
    with pytest.raises(MissionError, match="swarm.sensing"):
        behavior_from(load_scenario("eros-observe", {"swarm": {"class": 4, "relay": "behavior"}}))


def test_a_swarm_of_class_4_covers_for_a_lost_one_and_says_when_it_knew(talked):
    plan, telemetry = talked
    result = observe_flight(plan, telemetry)
    _, planned = flown(3, "faults=[{kind: spacecraft_lost, spacecraft: sc5, at_s: 100}]")
    assert result.coverage.percent > observe_flight(plan, planned).coverage.percent
    summary = summarise(plan, telemetry, result, {})
    assert summary["coordination_bits"] == telemetry.coordination_bits.values[-1].sum() > 0
    silent = [e for e in summary["coordination_events"] if e["kind"] == "silent"]
    assert {e["spacecraft"] for e in silent} == {"sc1", "sc2", "sc3", "sc4"}
    assert all(135.0 < e["time_s"] <= 170.0 for e in silent)


def test_messages_end_with_their_sender_and_take_their_time_from_the_crosslink(talked):
    plan, telemetry = talked
    bits, airtime = telemetry.coordination_bits.values, telemetry.coordination_airtime.values
    late = telemetry.time.values > 111.0
    assert (bits[late, 4] == bits[late, 4][0]).all() and (np.diff(bits[:, 0]) >= 0).all()
    result = observe_flight(plan, telemetry)
    with_messages = deliver(plan, telemetry, result.kept, prove=False)
    without = deliver(plan, telemetry.drop_vars("coordination_airtime"), result.kept, prove=False)
    taken = 1.0 - with_messages.contact_bit.sum(axis=(1, 2)) / np.maximum(without.contact_bit.sum(axis=(1, 2)), 1)
    spent = np.diff(np.interp(with_messages.edges_s, telemetry.time.values, airtime.sum(axis=1)))
    np.testing.assert_allclose(taken, spent / np.diff(with_messages.edges_s), atol=1e-3)
    assert taken.max() > 0.001


@pytest.fixture(scope="module")
def sent():
    """What of the flights of some classes is sent, by class and chance that a message is lost."""

    def delivered(level, loss, *more):
        formation = ", formation: {reference: mean}" if level == 1 else ""
        thrusters = ("spacecraft.thrusters={}",) if level == 1 else ()
        swarm = f"swarm={{class: {level}, plan_time_limit_s: 2, message_loss: {loss}{formation}}}"
        plan = make_plan(load_scenario("eros-observe", parse_overrides([*QUICK, swarm, *thrusters, *more])))
        telemetry = simulate(plan)
        kept = observe_flight(plan, telemetry).kept
        return telemetry, deliver(plan, telemetry, kept, prove=False)

    cases = ((0, 0.05), (1, 0.05), (4, 1), (3, 1), (3, 0), (3, 0.5))
    return {case: delivered(*case) for case in cases} | {
        "relay lost": delivered(3, 0, "faults=[{kind: spacecraft_lost, spacecraft: sc4, at_s: 790}]"),
        "replaced": delivered(
            3, 0, "faults=[{kind: spacecraft_lost, spacecraft: sc4, at_s: 790}]", "data.election=medoid"
        ),
    }


@pytest.mark.parametrize("case", [(0, 0.05), (1, 0.05), (4, 1)])
def test_who_hears_of_nobody_sends_all_its_own_to_earth_and_nothing_to_others(sent, case):
    _, delivery = sent[case]
    assert delivery.contact_bit.sum() == delivery.sent_bit.sum() == 0
    assert (delivery.earth_bit.sum(axis=0) == delivery.tile_bit.sum(axis=1)).all()
    assert np.count_nonzero(delivery.earth_bit.sum(axis=0)) == delivery.n and delivery.elected.all()


def test_where_no_message_arrives_the_planned_relay_brings_home_its_own_alone(sent):
    (_, whole), (_, deaf), (_, half) = sent[3, 0], sent[3, 1], sent[3, 0.5]
    (relay,) = whole.relay.tolist()
    assert whole.sent_bit.sum() > 0 and deaf.sent_bit.sum() == deaf.contact_bit.sum() == 0
    assert deaf.relay.tolist() == [relay] and deaf.earth_bit.sum() == deaf.tile_bit[relay].sum()
    np.testing.assert_array_equal(half.contact_bit, whole.contact_bit // 2)


def test_a_plan_is_not_repaired_when_its_relay_is_lost_unless_an_election_is_asked_for(sent):
    relay = sent[3, 0][1].relay
    (telemetry, lost), (_, replaced) = sent["relay lost"], sent["replaced"]
    assert relay.tolist() == [3] and (telemetry["operational"].values[-1] == [1, 1, 1, 0, 1]).all()
    assert not lost.elected.any() and lost.earth_bit[:, [0, 1, 2, 4]].sum() == 0
    assert replaced.elected.sum() == 1 and replaced.delivered_area > 2.0 * lost.delivered_area


def test_an_election_that_nobody_can_hold_is_refused():
    for swarm in ({"class": 0}, {"class": 4, "message_loss": 1}):
        with pytest.raises(MissionError, match="data.election = medoid: takes messages.* must be 'flight'"):
            behavior_from(load_scenario("eros-observe", {"swarm": swarm, "data.election": "medoid"}))


def test_class_0_says_nothing_and_everybody_speaks_to_earth_itself():
    _, telemetry = flown(0)
    assert "coordination_bits" not in telemetry
    assert (telemetry["mode"].values[-1] == 2).all()
