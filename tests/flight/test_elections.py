"""Elections after a flight: against trying all sets without short cuts, and by hand."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import xarray as xr

from swarm_mj.dataflow.contacts import samples_of
from swarm_mj.dataflow.online import run_online
from swarm_mj.dataflow.optimum import optimum
from swarm_mj.errors import MissionError
from swarm_mj.flight.downlink import (
    FEWEST_SAMPLES,
    SampledSwarm,
    Trials,
    contacts_of,
    deliver,
    network_of,
    slot_edges,
    tiles_of,
)
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.flight.post_flight import (
    Course,
    Elections,
    elect_relays,
    election_slots,
    flown_instants,
    joined,
    post_flight_instants,
    post_flight_paths,
)
from swarm_mj.mission.behaviors import TargetKind, elect_medoid
from swarm_mj.records.delivered import delivered_summary
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.spacecraft.attitude.mrp import dcm


@pytest.fixture(scope="module")
def config2(config_flights):
    """The flight of eros-config2 and what it saw, with any scenario of radios and data."""
    plan, telemetry = config_flights["eros-config2"]
    kept = observe_flight(plan, telemetry).kept

    def told(*overrides, antenna="hemispherical"):
        overrides = ("data.product=cells", *overrides)
        scenario = load_scenario("eros-config2", parse_overrides([f"link.crosslink.antenna={antenna}", *overrides]))
        return replace(plan, scenario=scenario), telemetry, kept

    return told


def networks(plan, telemetry, kept):
    """The delivery problem with given relays, built anew for each from the flight."""
    tiles = tiles_of(plan, telemetry, kept)
    edges_s = slot_edges(plan.scenario, tiles.ready_s, 10_000)
    times = samples_of(edges_s, FEWEST_SAMPLES).ravel()
    later = times[times > telemetry["time"].values[-1]]
    course, flown = (
        post_flight_paths(plan, telemetry, later),
        flown_instants(plan, telemetry, times[: len(times) - len(later)]),
    )

    def with_relays(relays):
        last_BN = dcm(telemetry["sigma_BN"].values[-1])
        after = post_flight_instants(plan, last_BN, course, np.tile(np.array(relays, np.int64), (len(later), 1)))
        instants = joined(flown, after)
        return network_of(plan.scenario, tiles, contacts_of(plan, edges_s, instants), instants)

    return with_relays, Trials(SampledSwarm.of_flight(plan, telemetry, edges_s), tiles)


@pytest.mark.parametrize("k", [1, 2])
def test_delivery_elects_what_trying_all_sets_finds(config2, k):
    plan, telemetry, kept = config2("data.election=delivery", f"data.relays={k}")
    with_relays, trials = networks(plan, telemetry, kept)
    values = {relays: optimum(with_relays(relays)).value for relays in combinations(range(plan.n), k)}
    found = deliver(plan, telemetry, kept)
    elected = tuple(found.relay.tolist())
    best = max(values.values())
    assert values[elected] == pytest.approx(best, rel=1e-9)
    assert elected == next(relays for relays, value in values.items() if value > best * (1 - 1e-9))
    assert float(found.best_bound_area) == pytest.approx(best, rel=1e-9)
    assert all(trials.bound(relays) >= values[relays] * (1 - 1e-9) for relays in list(values)[:6])


def test_who_is_elected_by_delivery_delivers_more_than_the_medoid(config2):
    by = {rule: deliver(*config2(f"data.election={rule}"), prove=False) for rule in ("flight", "medoid", "delivery")}
    assert by["medoid"].relay.tolist() == [elect_medoid(config2()[1]["r_BN_N"].values[-1])]
    assert by["flight"].relay.tolist() == [0]
    # A hemisphere that looks away from Earth hears all from the Earthward side only.
    assert by["delivery"].complete
    assert by["delivery"].delivered_area > 1.05 * max(by["medoid"].delivered_area, by["flight"].delivered_area)


@pytest.mark.parametrize("relays", [(0,), (3,), (1, 4)])
def test_with_omnidirectional_antennas_crosslinks_are_computed_once_for_all_sets(config2, relays):
    with_relays, trials = networks(*config2(antenna="omnidirectional"))
    (one, speaks), other = trials.problem(relays), with_relays(relays)
    assert (one.swarm_bit == other.swarm_bit).all() and one.swarm_bit.any()
    assert (one.earth_bit == other.earth_bit).all() and one.earth_bit[:, relays].any(axis=0).all()
    assert (one.lost_slot == other.lost_slot).all()
    after = one.edges_s[:-1] > config2()[1]["time"].values[-1]
    assert np.flatnonzero(speaks[after].all(axis=0)).tolist() == list(relays) == np.flatnonzero(speaks[-1]).tolist()


def test_what_a_set_would_deliver_is_the_optimum_where_the_swarm_alone_falls_short(config2):
    # A rate too slow for all, of which whole tiles waste some.
    slow = ("data.horizon_s=1200", "link.earth.rates_bit_s=[200]")
    with_relays, trials = networks(*config2(*slow, antenna="omnidirectional"))
    for relay in (0, 2):
        network, speaks = trials.problem((relay,))
        best = optimum(with_relays((relay,))).value
        assert run_online(network, speaks).value < 0.99 * best < 0.99 * trials.bound((relay,))
        assert trials.value((relay,)) == pytest.approx(best, rel=1e-9)


def test_the_summary_tells_who_elected_whom_when(config2):
    plan, telemetry, kept = config2("data.election=k_medoids", "data.relays=2")
    result = replace(observe_flight(plan, telemetry), delivery=deliver(plan, telemetry, kept, prove=False))
    summary = delivered_summary(plan, result)
    assert summary["elected_by"] == "k_medoids" and len(summary["relays_after"]) == 2
    assert summary["elections"] == [{"time_s": 1200.0, "relays": summary["relays_after"]}]


# By hand: three spacecraft on a line, of which the middle one changes.

EDGES_S = np.arange(0.0, 1001.0, 100.0)


def line(x):
    return np.array([[x_j, 0.0, 0.0] for x_j in x])


def elections(later, *overrides, works=None, at_the_end=(0.0, 10.0, 25.0), lost=()):
    """Elections of spacecraft that stand on a line after a flight of 100 s, at one place in each later slot."""
    scenario = load_scenario("eros-quick", parse_overrides(["data.election=medoid", *overrides]))
    n = len(at_the_end)
    operational, mode = np.ones((2, n), np.int8), np.full((2, n), TargetKind.SPACECRAFT, np.int8)
    mode[:, 2] = TargetKind.EARTH
    operational[1, list(lost)] = 0
    telemetry = xr.Dataset(
        {
            "r_BN_N": (("time", "spacecraft", "xyz"), np.array([line(at_the_end)] * 2)),
            "mode": (("time", "spacecraft"), mode),
            "operational": (("time", "spacecraft"), operational),
            "pointing_error": (("time", "spacecraft"), np.zeros((2, n))),
        },
        {"time": [0.0, 100.0]},
    )
    course = Course(
        samples_of(EDGES_S, 1).ravel()[1:],
        np.array([line(x) for x in later]),
        np.ones((9, n), bool) if works is None else works,
    )
    found = elect_relays(scenario, telemetry, course, EDGES_S, lambda relays: 0.0, lambda relays: 0.0)
    return list(zip(found.time_s.tolist(), [np.flatnonzero(who).tolist() for who in found.elected], strict=True)), found


#: Middle is 1; from 300 s on 0, with a sum of distances of 30 against 31 (3 %); from 600 s on of 40 against 70.
PATHS = [(0, 10, 25)] * 2 + [(0, 1, -29)] * 3 + [(0, 30, -10)] * 4


def test_without_an_interval_one_election_stands():
    assert elections(PATHS)[0] == [(100.0, [1])]


def test_others_are_elected_only_where_they_are_better_by_the_hysteresis():
    assert elections(PATHS, "data.election_interval_s=100")[0] == [(100.0, [1]), (600.0, [0])]
    assert elections(PATHS, "data.election_interval_s=100", "data.hysteresis=0.02")[0] == [(100.0, [1]), (300.0, [0])]
    assert elections(PATHS, "data.election_interval_s=100", "data.hysteresis=0.5")[0] == [(100.0, [1])]
    # Every 400 s: at 500 s, when little is gained, and at 900 s.
    assert elections(PATHS, "data.election_interval_s=400")[0] == [(100.0, [1]), (900.0, [0])]


@pytest.mark.parametrize(
    ("rule", "first", "then"), [("medoid", [1], [0]), ("first", [0], [0]), ("flight", [2], [2]), ("delivery", [0], [0])]
)
def test_a_relay_that_is_lost_is_replaced_at_the_next_election(rule, first, then):
    works = np.ones((9, 3), bool)
    works[4:, first] = False
    interval = [] if rule == "delivery" else ["data.election_interval_s=200"]
    found, _ = elections([(0.0, 10.0, 25.0)] * 9, f"data.election={rule}", *interval, works=works)
    left = {"medoid": [0], "first": [1], "flight": [0], "delivery": None}[rule]
    # Lost from 500 s on; elections at 300, 500, ... s.
    assert found == [(100.0, first)] + ([(500.0, left)] if left is not None else [])


def test_the_lost_do_not_count():
    # A wreck 1 km off would make 40 against 70 m a gain of nothing.
    works = np.tile([True, True, True, False], (9, 1))
    found, _ = elections(
        [(*x, 1000) for x in PATHS],
        "data.election_interval_s=100",
        works=works,
        at_the_end=(0.0, 10.0, 25.0, 1000.0),
        lost=(3,),
    )
    assert found == [(100.0, [1]), (600.0, [0])]


def test_nobody_is_elected_where_nobody_is_left():
    works = np.ones((9, 3), bool)
    works[4:] = False
    assert elections(PATHS, "data.election_interval_s=100", works=works)[0] == [(100.0, [1])]


def test_where_too_few_work_all_of_them_speak_and_where_nobody_does_nobody():
    many = ["data.election=k_medoids", "data.relays=2"]
    assert elections([(0, 10, 25)] * 9, *many)[0] == [(100.0, [0, 2])]
    assert elections([(0, 10, 25)] * 9, *many, lost=(0, 1))[0] == [(100.0, [2])]
    by_delivery = ["data.election=delivery", "data.relays=3"]
    assert elections([(0, 10, 25)] * 9, *by_delivery, lost=(0, 1))[0] == [(100.0, [2])]
    found, who = elections([(0, 10, 25)] * 9, *many, lost=(0, 1, 2), works=np.zeros((9, 3), bool))
    assert found == [(100.0, [])] and who.relays_at(np.array([200.0, 300.0])).shape == (2, 0)


def test_relays_stand_from_their_election_on():
    found = Elections(np.array([100.0, 500.0]), np.array([[False, True, True], [True, False, False]]))
    assert found.relays_at(np.array([100.1, 499.0, 500.0, 900.0])).tolist() == [[1, 2], [1, 2], [0, 0], [0, 0]]


def test_elections_are_held_at_the_first_slot_after_each_interval():
    edges_s = np.array([50.0, 110.0, 170.0, 290.0, 530.0, 1010.0])
    assert election_slots(edges_s, 100.0, None).tolist() == []
    assert election_slots(edges_s, 100.0, 60.0).tolist() == [2, 3, 4]
    assert election_slots(edges_s, 100.0, 190.0).tolist() == [3, 4]
    assert election_slots(edges_s, 100.0, 1e-9).tolist() == [1, 2, 3, 4]
    assert election_slots(edges_s, 100.0, 1e9).tolist() == []


def test_more_relays_than_spacecraft_are_refused_before_the_flight():
    with pytest.raises(MissionError, match=r"data.relays = 3: must be >= 1 and <= 2"):
        make_plan(load_scenario("eros-quick", {"data.relays": 3, "data.election": "first"}))
