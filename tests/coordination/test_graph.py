"""The communication graph, against swarms drawn on paper, and the bus, against times counted by hand."""

import numpy as np
import pytest
import trimesh

from swarm_mj.coordination.bus import Bus
from swarm_mj.coordination.graph import Graph, graph_at
from swarm_mj.dataflow.contacts import Instant, Radios
from swarm_mj.dataflow.link_budget import RateTable
from swarm_mj.dataflow.network import Access
from swarm_mj.mission.links import Antennas
from swarm_mj.scenarios.constants import SPEED_OF_LIGHT
from swarm_mj.smallbody.occultation import occluder_of
from swarm_mj.smallbody.shape import ShapeModel

RATES = RateTable(np.array([10e3, 40e3]), np.array([100.0, 10.0]))


@pytest.fixture(scope="module")
def body():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=1e3)
    return occluder_of(ShapeModel(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32), "ball"))


def graph(body, r_N, works=None, **keys):
    r_N = np.asarray(r_N, float)
    n = len(r_N)
    antennas = Antennas(
        dish_half_angle=0.1,
        hemispherical_boresight_B=np.array([0.0, 0.0, -1.0]),
        hemispherical_half_angle=np.pi / 2,
        max_range=1e9,
        omnidirectional=True,
    )
    works = np.ones(n, bool) if works is None else np.array(works)
    zero = np.zeros(n, np.int64)
    now = Instant(r_N, np.tile(np.eye(3), (n, 1, 1)), np.eye(3), np.array([1.5e11, 0.0, 0.0]), zero, zero, works)
    return graph_at(Radios(antennas, RATES, RateTable(np.zeros((0, 1)), np.zeros((0, 1)))), body, now, **keys)


def links_of(n, *pairs, rate=100.0, loss=0.0):
    rates = np.zeros((n, n))
    for i, j in pairs:
        rates[i, j] = rates[j, i] = rate
    return Graph(rate_bit_s=rates, delay_s=np.full((n, n), 0.25), loss=np.full((n, n), loss), works=np.ones(n, bool))


def test_links_have_the_rate_of_their_range_and_the_light_time(body):
    g = graph(body, [[5e3, 0, 0], [5e3, 8e3, 0], [5e3, 0, 39e3], [5e3, 0, -30e3]], processing_s=0.1)
    assert g.rate_bit_s[0].tolist() == [0.0, 100.0, 10.0, 10.0] and g.rate_bit_s[2, 3] == 0.0
    assert g.delay_s[0, 2] == pytest.approx(0.1 + 39e3 / SPEED_OF_LIGHT, rel=1e-12)
    assert g.adjacency.sum(axis=1).tolist() == [3, 3, 2, 2]


def test_the_body_cuts_a_link_that_is_in_range(body):
    g = graph(body, [[5e3, 0, 0], [-4e3, 0, 0], [0, 5e3, 0]])
    assert not g.adjacency[0, 1] and g.adjacency[0, 2] and g.adjacency[1, 2]


def test_a_graph_falls_apart_where_the_one_in_the_middle_is_lost(body):
    r_N = [[5e3, -30e3, 0], [5e3, 0, 0], [5e3, 30e3, 0], [5e3, 35e3, 0]]
    whole, torn = graph(body, r_N), graph(body, r_N, works=[True, False, True, True])
    assert [c.tolist() for c in whole.components] == [[0, 1, 2, 3]]
    assert [c.tolist() for c in torn.components] == [[0], [2, 3]]


def test_a_link_that_is_open_one_way_joins_nobody():
    rates = np.array([[0.0, 9.0, 0.0], [0.0, 0.0, 5.0], [0.0, 5.0, 0.0]])
    g = Graph(rate_bit_s=rates, delay_s=np.zeros((3, 3)), loss=np.zeros((3, 3)), works=np.ones(3, bool))
    assert g.links[0, 1] and not g.adjacency[0, 1] and not g.adjacency[1, 0]
    assert [c.tolist() for c in g.components] == [[0], [1, 2]]


def test_an_empty_swarm_has_no_groups_and_nothing_to_say(body):
    g = graph(body, [[5e3, 0, 0], [5e3, 1e3, 0]], works=[False, False])
    bus = Bus(2, np.random.default_rng(0))
    assert g.components == [] and not g.links.any()
    bus.broadcast(0.0, 0, 10, "hello", g)
    assert bus.bits.sum() == 0 and bus.arrived(1e9) == []


def test_a_message_arrives_after_it_was_sent_and_the_way_and_once():
    bus, g = Bus(3, np.random.default_rng(0)), links_of(3, (0, 1), (1, 2))
    bus.broadcast(5.0, 1, 200, "hello", g)
    assert bus.arrived(7.24) == []
    assert sorted(m.receiver for m in bus.arrived(7.25)) == [0, 2] and bus.arrived(99.0) == []
    assert bus.bits.tolist() == [0, 200, 0] and bus.airtime_s.tolist() == [0.0, 2.0, 0.0]


def test_all_neighbours_hear_a_message_at_the_rate_of_the_slowest():
    bus, g = Bus(3, np.random.default_rng(0)), links_of(3, (0, 1), (1, 2))
    g.rate_bit_s[1, 2] = 50.0
    bus.broadcast(0.0, 1, 100, "hello", g)
    assert [m.arrives_s for m in bus.arrived(99.0)] == [2.25, 2.25] and bus.airtime_s[1] == 2.0


@pytest.mark.parametrize(
    ("access", "arrive"),
    [(Access.ONE_AT_A_TIME, [1.25, 2.25]), (Access.PARALLEL, [1.25, 1.25]), (Access.TDMA, [2.25, 2.25])],
)
def test_who_shares_the_channel_waits(access, arrive):
    bus, g = Bus(2, np.random.default_rng(0), access), links_of(2, (0, 1))
    bus.broadcast(0.0, 0, 100, "a", g)
    bus.broadcast(0.0, 1, 100, "b", g)
    assert [m.arrives_s for m in bus.arrived(99.0)] == arrive


def test_as_many_messages_are_lost_as_the_chance_says_and_the_same_by_the_same_seed():
    def lost(seed):
        bus, g = Bus(2, np.random.default_rng(seed), Access.PARALLEL), links_of(2, (0, 1), loss=0.3)
        for k in range(4000):
            bus.broadcast(float(k), 0, 1, k, g)
        return bus.lost, [m.payload for m in bus.arrived(1e9)]

    count, heard = lost(1)
    assert abs(count - 1200) < 4 * np.sqrt(4000 * 0.3 * 0.7) and len(heard) == 4000 - count
    assert lost(1) == (count, heard) and lost(2)[1] != heard
