"""What the swarm does alone obeys the network, loses no bit unseen, and never beats the optimum."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_mj.dataflow.network import Access
from swarm_mj.dataflow.online import ON_EARTH, SPACECRAFT_LOST, STORAGE_FULL, Loss, Transfer, run_online
from swarm_mj.dataflow.optimum import optimum
from swarm_mj.errors import MissionError
from tests.dataflow.brute import random_network
from tests.dataflow.chain import chain


def fly(account, network, relays):
    """Every transfer again, in plain loops: nothing is sent before it is aboard, and all rules are obeyed, exactly."""
    n, t_end = network.n_spacecraft, network.n_slots
    held, earth = {}, {}
    for t in range(t_end):
        for i in range(n):
            for q in range(network.n_tiles):
                if network.bits[i, q] and network.ready[i, q] == t:
                    held[i, i, q] = int(network.bits[i, q])
        for loss in account.losses:
            if loss.slot == t:
                held[loss.spacecraft, loss.origin, loss.tile] -= loss.bits
        for i in range(n):
            aboard = sum(bits for (holder, _, _), bits in held.items() if holder == i)
            assert aboard == account.aboard_bit[t, i] <= network.storage_bit[i]
            assert aboard == 0 or network.lost_slot[i] > t
        sent = [s for s in account.transfers if s.slot == t]
        check_shares(network, sent, relays[t])
        for s in sent:
            held[s.sender, s.origin, s.tile] -= s.bits
            assert s.bits > 0 and held[s.sender, s.origin, s.tile] >= 0
        for s in sent:
            if s.receiver >= 0:
                place = (s.receiver, s.origin, s.tile)
                held[place] = held.get(place, 0) + s.bits
            else:
                earth[s.origin, s.tile] = earth.get((s.origin, s.tile), 0) + s.bits
        for q in range(network.n_tiles):
            whole = any(earth.get((i, q), 0) == network.bits[i, q] > 0 for i in range(n))
            assert whole == (account.delivered_slot[q] <= t)


def check_conservation(account, network):
    """At every edge seen = delivered + aboard + lost, to the bit, and transfers and losses tell the same."""
    seen, taken = network.seen, np.zeros_like(account.aboard_bit)
    np.add.at(taken, (network.ready[seen], np.nonzero(seen)[0]), network.bits[seen])
    earth, lost, change = np.zeros_like(account.on_earth_bit), np.zeros_like(account.lost_bit), taken.copy()
    for sent in account.transfers:
        change[sent.slot + 1, sent.sender] -= sent.bits
        if sent.receiver < 0:
            earth[sent.slot + 1] += sent.bits
        else:
            change[sent.slot + 1, sent.receiver] += sent.bits
    for loss in account.losses:
        lost[loss.slot] += loss.bits
        change[loss.slot, loss.spacecraft] -= loss.bits
    total = account.on_earth_bit + account.aboard_bit.sum(axis=1) + account.lost_bit
    assert (total == taken.sum(axis=1).cumsum()).all(), "seen = delivered + aboard + lost"
    assert (account.on_earth_bit == earth.cumsum()).all(), "delivered bits and transfers to Earth"
    assert (account.lost_bit == lost.cumsum()).all(), "lost bits and losses"
    assert (account.aboard_bit == change.cumsum(axis=0)).all(), "bits aboard, pictures, transfers and losses"


def check_shares(network, sent, relay):
    """The shares of one slot, as fractions."""
    n = network.n_spacecraft
    sends, receives, to_earth = ([Fraction(0)] * n for _ in range(3))
    for s in sent:
        assert network.lost_slot[s.sender] > s.slot
        if s.receiver < 0:
            assert relay[s.sender]
            to_earth[s.sender] += Fraction(s.bits, int(network.earth_bit[s.slot, s.sender]))
        else:
            assert not relay[s.sender] and network.lost_slot[s.receiver] > s.slot
            share = Fraction(s.bits, int(network.swarm_bit[s.slot, s.sender, s.receiver]))
            sends[s.sender] += share
            receives[s.receiver] += share
    assert max(to_earth) <= 1 and sum(to_earth) <= network.earth_channels
    if network.access is Access.ONE_AT_A_TIME:
        assert sum(sends) <= 1
    else:
        assert max(sends) <= (Fraction(1, n) if network.access is Access.TDMA else 1)
        assert not network.half_duplex or max(a + b for a, b in zip(sends, receives, strict=True)) <= 1


@given(seed=st.integers(0, 2**32 - 1), everyone=st.booleans(), shared=st.booleans())
@settings(max_examples=80, deadline=None)
def test_every_bit_is_aboard_on_earth_or_lost_and_the_optimum_is_not_beaten(seed, everyone, shared):
    rng = np.random.default_rng(seed)
    network = random_network(rng)
    relays = (network.earth_bit.any(axis=0) | everyone)[None, :] & (rng.random(network.earth_bit.shape) < 0.8)
    account = run_online(network, relays, shared=shared)
    check_conservation(account, network)
    fly(account, network, relays)
    assert account.value <= optimum(network).bound + 1e-9
    assert account.value == pytest.approx(network.value[account.delivered_slot < network.n_slots].sum())


def last_is_relay(network):
    return np.arange(network.n_spacecraft)[None, :] == np.full((network.n_slots, 1), network.n_spacecraft - 1)


def fly_chain(**given):
    network = chain(**given)
    account = run_online(network, last_is_relay(network))
    check_conservation(account, network)
    return account


def test_a_chain_is_stored_and_forwarded():
    account = fly_chain()
    expected = [(0, 0, 1, 0, 0, 4), (1, 1, -1, 0, 0, 4), (1, 0, 1, 0, 0, 4), (2, 1, -1, 0, 0, 4)]
    assert account.transfers == tuple(Transfer(*sent) for sent in expected)
    assert account.delivered_slot.tolist() == [2] and account.value == 100.0
    assert account.aboard_bit.tolist() == [[8, 0], [4, 4], [0, 4], [0, 0], [0, 0]]
    assert account.on_earth_bit.tolist() == [0, 0, 4, 8, 8]


def test_a_lost_spacecraft_takes_what_it_holds_along():
    account = fly_chain(lost_slot=np.array([4, 2]))
    assert account.losses == (Loss(2, 1, 0, 0, 4, SPACECRAFT_LOST),)
    assert account.on_earth_bit[-1] == 4 and account.value == 0.0


def test_a_picture_beyond_storage_is_lost_and_said():
    account = fly_chain(storage_bit=np.array([7, 8]))
    assert account.losses == (Loss(0, 0, 0, 0, 8, STORAGE_FULL),)


def test_a_full_relay_takes_no_more_than_it_has_room_for():
    account = fly_chain(storage_bit=np.array([8, 3]))
    assert [sent.bits for sent in account.transfers if sent.receiver == 1] == [3, 3]


def test_a_relay_has_room_once_for_the_tiles_of_a_slot():
    account = two_tiles(bits=np.array([[2, 2], [0, 0]]), storage_bit=np.array([8, 3]))
    assert [sent.bits for sent in account.transfers if sent.receiver == 1] == [2, 1, 1]


def two_tiles(**given):
    two = {"value": np.array([1.0, 9.0]), "bits": np.array([[4, 4], [0, 0]]), "ready": np.array([[0, 0], [4, 4]])}
    return fly_chain(**(two | given))


def test_the_most_valuable_tile_goes_first():
    account = two_tiles()
    assert [sent.tile for sent in account.transfers if sent.receiver == 1] == [1, 0]
    assert account.delivered_slot.tolist() == [2, 1]


def test_value_counts_for_each_bit():
    account = two_tiles(bits=np.array([[1, 8], [0, 0]]), value=np.array([2.0, 9.0]))
    assert account.transfers[0].tile == 0


def test_a_copy_of_what_is_at_the_relay_stays_aboard():
    account = two_tiles(bits=np.array([[4, 4], [0, 4]]), ready=np.array([[0, 0], [4, 0]]))
    assert all(sent.origin == 1 for sent in account.transfers if sent.tile == 1)
    assert account.aboard_bit[-1].tolist() == [4, 0] and account.value == 10.0


def test_without_shared_inventories_all_send_all_their_own_and_the_finest_copy_counts():
    network = chain(
        swarm_bit=np.zeros((4, 2, 2), np.int64),
        earth_bit=np.full((4, 2), 4),
        earth_channels=2,
        bits=np.array([[8], [8]]),
        ready=np.array([[0], [1]]),
        gsd_m=np.array([[1.0], [2.0]]),
    )
    all_speak = np.ones((4, 2), np.bool_)
    alone = run_online(network, all_speak, shared=False)
    check_conservation(alone, network)
    assert {(sent.sender, sent.receiver, sent.origin) for sent in alone.transfers} == {(0, -1, 0), (1, -1, 1)}
    assert (
        alone.on_earth_bit[-1] == 16 and alone.delivered_slot.tolist() == [1] and alone.delivered_origin.tolist() == [0]
    )
    shared = run_online(network, all_speak)
    assert shared.on_earth_bit[-1] == 8
    coarse_first = run_online(replace(network, ready=np.array([[2], [0]])), all_speak)
    assert coarse_first.on_earth_bit.tolist() == [0, 4, 8, 12, 16] and coarse_first.delivered_origin.tolist() == [0]


def test_a_copy_makes_room_when_its_tile_is_on_earth():
    tiles = {"bits": np.array([[4, 4], [0, 4]]), "ready": np.array([[2, 0], [4, 0]])}
    swarm = np.zeros((4, 2, 2), np.int64)
    earth = np.array([[0, 4]] * 4)
    roomy = two_tiles(**tiles, swarm_bit=swarm, earth_bit=earth)
    tight = two_tiles(**tiles, swarm_bit=swarm, earth_bit=earth, storage_bit=np.array([4, 8]))
    assert not roomy.losses and roomy.aboard_bit[-1, 0] == 8
    assert tight.losses == (Loss(2, 0, 0, 1, 4, ON_EARTH),) and tight.aboard_bit[-1, 0] == 4


def test_another_copy_takes_over_where_the_first_is_cut_off():
    """Spacecraft 0 and 1 hold the tile; 0 is lost after half of its copy has come to the relay, 2."""
    swarm = np.zeros((6, 3, 3), np.int64)
    swarm[:, 0, 2] = swarm[:, 1, 2] = 4
    account = fly_chain(
        edges_s=np.arange(7.0),
        swarm_bit=swarm,
        earth_bit=np.full((6, 3), 4) * (np.arange(3) == 2),
        storage_bit=np.full(3, 99),
        bits=np.array([[8], [8], [0]]),
        ready=np.array([[0], [0], [6]]),
        lost_slot=np.array([1, 6, 6]),
    )
    assert account.transfers[0].origin == 0 and account.value == 100.0
    assert [sent.origin for sent in account.transfers if sent.receiver == 2] == [0, 1, 1]


def test_the_way_is_the_one_of_least_time():
    """From 0 to the relay 2: directly at 2 bits a slot, or through 1 at 8 bits a slot and hop."""
    swarm = np.zeros((4, 3, 3), np.int64)
    swarm[:, 0, 2], swarm[:, 0, 1], swarm[:, 1, 2] = 2, 8, 8
    fields = {
        "swarm_bit": swarm,
        "earth_bit": np.full((4, 3), 8) * (np.arange(3) == 2),
        "storage_bit": np.full(3, 99),
        "bits": np.array([[8], [0], [0]]),
        "ready": np.array([[0], [4], [4]]),
    }
    account = fly_chain(**fields)
    assert [(s.sender, s.receiver) for s in account.transfers] == [(0, 1), (1, 2), (2, -1)]
    swarm[:, 0, 2] = 5
    assert [(s.sender, s.receiver, s.bits) for s in fly_chain(**fields).transfers if s.slot == 0] == [(0, 2, 5)]


def test_relays_of_another_shape_and_accounts_with_a_missing_bit_are_told():
    network = chain()
    with pytest.raises(MissionError, match=r"relays: shape \(2,\), but must be \(4, 2\): slots, spacecraft"):
        run_online(network, np.ones(2, np.bool_))
    account = run_online(network, last_is_relay(network))
    account.aboard_bit[2, 1] -= 1
    with pytest.raises(AssertionError, match="seen = delivered"):
        check_conservation(account, network)
    account.aboard_bit[2, 0] += 1
    with pytest.raises(AssertionError, match="bits aboard"):
        check_conservation(account, network)
