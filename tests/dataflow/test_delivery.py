"""What became of the data: areas over time, and why what was seen does not arrive."""

from dataclasses import replace

import numpy as np
import pytest

from swarm_mj.dataflow.delivery import REASONS, STORAGE, TIME, Delivery
from swarm_mj.mission.links import Obstacle


@pytest.fixture
def delivery():
    """Two observers and a relay (2) in three slots of 10 s; tile 0 of spacecraft 0 arrives, tile 1 of spacecraft 1 does not."""
    links, ways = np.zeros((3, 3, 3), np.int64), np.zeros((3, 3), np.int64)
    contact, earth = links.copy(), ways.copy()
    contact[:, 0, 2], earth[:, 2] = 100, 50
    why = np.where(contact > 0, Obstacle.NONE, Obstacle.BEAM).astype(np.int8)
    nan = np.nan
    return Delivery(
        edges_s=np.array([0.0, 10.0, 20.0, 30.0]),
        light_time_s=np.full(3, 500.0),
        contact_bit=contact,
        earth_contact_bit=earth,
        station=np.zeros((3, 3), np.int64),
        why_swarm=why,
        why_earth=np.where(earth > 0, Obstacle.NONE, Obstacle.ROLE).astype(np.int8),
        relay_distance_m=np.tile([1e3, 2e3, 0.0], (3, 1)),
        sent_bit=links,
        earth_bit=ways,
        aboard_bit=np.zeros((4, 3), np.int64),
        lost_bit=np.zeros((4, 3), np.int64),
        tile_of_cell=np.array([0, 1, -1, 0]),
        tile_area=np.array([4.0, 6.0]),
        tile_bit=np.array([[40, 0], [0, 60], [0, 0]]),
        tile_lost_bit=np.zeros((3, 2), np.int64),
        tile_overflow_bit=np.zeros((3, 2), np.int64),
        tile_ready_s=np.array([[0.0, nan], [nan, 0.0], [nan, nan]]),
        tile_arrives_s=np.array([520.0, nan]),
        tile_origin=np.array([0, -1]),
        best_earth_bit=np.zeros((3, 3)),
        best_share=np.array([1.0, 0.0]),
        best_full_s=np.array(520.0),
        best_bound_area=np.array(4.0),
        election_s=np.array([20.0]),
        elected=np.array([[False, False, True]]),
    )


def reasons(delivery):
    return [(part.reason, part.area, part.holders) for part in delivery.undelivered()]


def test_cells_arrive_with_their_tile(delivery):
    assert delivery.arrives_s.tolist()[0] == delivery.arrives_s.tolist()[3] == 520.0
    assert np.isnan(delivery.arrives_s[[1, 2]]).all()
    assert delivery.delivered_area_over_time(np.array([519.9, 520.0, 1e9])).tolist() == [0.0, 4.0, 4.0]
    assert delivery.delivered_area == 4.0 and not delivery.complete and np.isnan(delivery.full_s)


def test_the_obstacle_that_stands_most_often_is_the_reason(delivery):
    assert reasons(delivery) == [("beam", 6.0, (1,))]
    why = delivery.why_swarm.copy()
    why[:2, 1, 2] = Obstacle.BODY
    assert reasons(replace(delivery, why_swarm=why)) == [(REASONS[Obstacle.BODY], 6.0, (1,))]


def test_a_way_over_others_counts_as_a_way(delivery):
    contact = delivery.contact_bit.copy()
    contact[0, 1, 0] = 10  # by spacecraft 0, which can hand it on in the next slot
    assert reasons(replace(delivery, contact_bit=contact)) == [(TIME, 6.0, (1,))]
    contact[0, 1, 0], contact[2, 1, 0] = 0, 10  # too late to be handed on
    assert reasons(replace(delivery, contact_bit=contact)) == [("beam", 6.0, (1,))]


def test_what_was_lost_is_not_for_want_of_time(delivery):
    contact = delivery.contact_bit.copy()
    contact[:, 1, 2] = 10
    lost = delivery.tile_lost_bit.copy()
    lost[1, 1] = 60
    assert reasons(replace(delivery, contact_bit=contact, tile_overflow_bit=lost)) == [(STORAGE, 6.0, (1,))]
    assert reasons(replace(delivery, contact_bit=contact, tile_lost_bit=lost)) == [(REASONS[Obstacle.LOST], 6.0, (1,))]


def test_where_nobody_reaches_earth_the_relays_obstacle_is_named(delivery):
    why = np.full((3, 3), Obstacle.ROLE, np.int8)
    assert (
        reasons(replace(delivery, earth_contact_bit=delivery.earth_contact_bit * 0, why_earth=why))[0][0]
        == REASONS[Obstacle.ROLE]
    )
    why[:, 2] = Obstacle.STATION
    assert (
        reasons(replace(delivery, earth_contact_bit=delivery.earth_contact_bit * 0, why_earth=why))[0][0]
        == REASONS[Obstacle.STATION]
    )
