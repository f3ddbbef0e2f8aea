"""The best schedule equals brute force, is proven by its prices, and can be flown."""

from types import SimpleNamespace

import numpy as np
import pytest

from swarm_mj.dataflow.network import Access
from swarm_mj.dataflow.optimum import dual_bound, earliest_full, optimum
from swarm_mj.dataflow.time_expanded_program import build_program
from swarm_mj.errors import MissionError
from tests.dataflow.brute import (
    Paths,
    most_by_flows,
    most_whole_by_flows,
    most_whole_by_paths,
    plain_network,
    random_network,
)
from tests.dataflow.chain import chain
from tests.dataflow.replay import replay


def check(network, schedule):
    """It can be flown, brings home what it says, and its bound is attained."""
    assert replay(network, schedule) == pytest.approx((schedule.taken * network.bits).sum(), abs=1e-6)
    assert schedule.value == pytest.approx(network.value @ schedule.delivered_share)
    assert schedule.status == "optimal" and schedule.bound == pytest.approx(schedule.value, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_shares_of_tiles_equal_all_ways_to_earth_in_every_access(seed):
    rng, delivered = np.random.default_rng(seed), 0
    for _ in range(25):
        network = random_network(rng)
        schedule = optimum(network)
        check(network, schedule)
        assert schedule.value == pytest.approx(Paths(network).most(), abs=1e-7)
        delivered += schedule.value > 0
    assert delivered > 10


@pytest.mark.parametrize("seed", range(4))
def test_whole_tiles_equal_all_choices_of_copies(seed):
    rng = np.random.default_rng([seed, 1])
    for _ in range(15):
        network = random_network(rng)
        schedule = optimum(network, whole=True)
        check(network, schedule)
        assert schedule.value == pytest.approx(most_whole_by_paths(network), abs=1e-7)
        assert ((schedule.taken > 1 - 1e-9) | (schedule.taken < 1e-9)).all()


@pytest.mark.parametrize("seed", range(4))
def test_plain_capacities_equal_the_largest_flow(seed):
    rng = np.random.default_rng([seed, 2])
    for _ in range(25):
        network = plain_network(rng)
        shares, whole = optimum(network), optimum(network, whole=True)
        check(network, shares)
        check(network, whole)
        assert shares.value == pytest.approx(most_by_flows(network), abs=1e-7)
        assert whole.value == pytest.approx(most_whole_by_flows(network), abs=1e-7)


def test_the_bound_follows_from_any_prices_and_is_attained_by_those_of_the_optimum():
    network = random_network(np.random.default_rng(11))
    program = build_program(network)
    rng = np.random.default_rng(0)
    best = -optimum(network).value / program.value_unit
    assert best < 0
    for _ in range(20):
        wild = SimpleNamespace(
            eqlin=SimpleNamespace(marginals=rng.normal(size=program.a_eq.shape[0])),
            ineqlin=SimpleNamespace(marginals=rng.normal(size=program.a_ub.shape[0])),
        )
        assert dual_bound(program, wild) < best


def test_the_earliest_full_delivery_is_the_first_window_that_paths_need():
    rng, found = np.random.default_rng(5), 0
    for _ in range(25):
        network = random_network(rng)
        full = Paths(network).most()
        enough = [k for k in range(1, network.n_slots + 1) if Paths(network.until(k)).most() > full - 1e-7]
        earliest = earliest_full(network)
        assert earliest.value == pytest.approx(full, abs=1e-7)
        if full == 0:
            assert earliest == (0, 0.0, 0.0, 0.0)
        else:
            found += 1
            assert earliest.n_slots == enough[0] and earliest.time_s == 60.0 * enough[0]
            assert earliest.value_before < full
            before = Paths(network.until(enough[0] - 1)).most() if enough[0] > 1 else 0.0
            assert earliest.value_before == pytest.approx(before, abs=1e-7)
    assert found > 8


def test_fewer_links_deliver_no_more_and_all_neighbours_are_all_links():
    rng = np.random.default_rng(6)
    for _ in range(20):
        network = random_network(rng)
        least, some, all_links = (optimum(network, neighbours=k) for k in (0, 1, network.n_spacecraft))
        full = optimum(network)
        assert least.value <= some.value + 1e-9 <= full.value + 2e-9
        assert all_links.value == pytest.approx(full.value, abs=1e-9)
        replay(network, some)


def test_a_chain_delivers_each_half_a_slot_later():
    schedule = optimum(chain())
    assert schedule.value == pytest.approx(100.0)
    assert schedule.aboard_bit[0].tolist() == pytest.approx([8.0, 0.0])
    assert schedule.aboard_bit[1].tolist() == pytest.approx([4.0, 4.0])
    assert earliest_full(chain()) == pytest.approx((3, 30.0, 100.0, 50.0))


@pytest.mark.parametrize(
    ("given", "value"),
    [
        ({"access": Access.TDMA}, 50.0),  # half the frame each
        ({"lost_slot": np.array([1, 4])}, 50.0),  # half was sent before
        ({"lost_slot": np.array([4, 2])}, 50.0),  # half came through
        ({"storage_bit": np.array([3, 8])}, 37.5),  # the camera's spacecraft holds three eighths
        ({"storage_bit": np.array([8, 3])}, 75.0),  # the relay takes three bits at a time
        ({"ready": np.array([[1], [4]])}, 50.0),  # too late for the first slot
        ({"ready": np.array([[2], [4]])}, 0.0),  # too late for both
    ],
)
def test_a_chain_loses_what_its_limits_take(given, value):
    assert optimum(chain(**given)).value == pytest.approx(value)
    assert optimum(chain(**given), whole=True).value == pytest.approx(0.0)


@pytest.mark.parametrize(("half_duplex", "value"), [(False, 100.0), (True, 75.0)])
def test_a_relay_between_two_takes_turns_where_it_cannot_hear_while_it_sends(half_duplex, value):
    """In three slots 1 hears from 0 and sends to 2: two slots each at best, and one and a half where turns add up."""
    swarm = np.zeros((4, 3, 3), np.int64)
    swarm[:, 0, 1] = swarm[:, 1, 2] = 4
    network = chain(
        swarm_bit=swarm,
        earth_bit=np.array([[0, 0, 8]] * 4),
        storage_bit=np.full(3, 8),
        access=Access.PARALLEL,
        half_duplex=half_duplex,
        bits=np.array([[8], [0], [0]]),
        ready=np.array([[0], [4], [4]]),
    )
    assert optimum(network).value == pytest.approx(value)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"access": "aloha"}, "access = 'aloha': must be one of one_at_a_time, tdma, parallel"),
        ({"earth_channels": 0}, "earth_channels = 0: must be at least 1"),
        ({"value": np.array([-1.0])}, r"value\[0\] = -1.0: must be finite and not negative"),
        ({"bits": np.array([[8], [-2]])}, r"bits\[1, 0\] = -2: must be at least 0"),
        (
            {"ready": np.array([[0], [5]])},
            r"ready\[1, 0\] = 5: must be at least 0 and at most 4, which stands for never",
        ),
        ({"storage_bit": np.array([8.0, 8.0])}, "storage_bit: numbers of type float64, but must be whole"),
        ({"bits": np.array([[8]])}, r"bits: shape \(1, 1\), but must be \(2, 1\) for 2 spacecraft, 1 tiles, 4 slots"),
        ({"edges_s": np.array([0.0, 1.0, 1.0, 2.0, 3.0])}, "edges_s: must be finite and ascending"),
        ({"swarm_bit": np.ones((4, 2, 2), np.int64)}, "swarm_bit: a spacecraft sends to itself; set its diagonal to 0"),
    ],
)
def test_a_wrong_network_is_told_by_key_and_remedy(given, told):
    with pytest.raises(MissionError, match=told):
        chain(**given)


def test_a_window_and_neighbours_out_of_range_are_told():
    with pytest.raises(MissionError, match="n_slots = 5: must lie between 1 and 4"):
        chain().until(5)
    with pytest.raises(MissionError, match="neighbours = -1: must be 0, more, or None"):
        optimum(chain(), neighbours=-1)
