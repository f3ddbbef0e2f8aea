"""Data under way in pictures: the transfers of the moment, packets that go from sender to receiver, and a film's own time."""

from dataclasses import replace

import numpy as np
import pytest

from swarm_mj.rendering.picture import Drawing
from swarm_mj.rendering.replay import Replay
from swarm_mj.rendering.transfers import BEATS, PACKETS, packets, transfers_of, ways, words
from tests.records.deliveries import delivery_of


@pytest.fixture(scope="module")
def delivery(flown):
    """Spacecraft 1 sends to 2 in the middle of the flight; what 2 sends to Earth two slots later is there before its end."""
    made = delivery_of(flown, relay=1, hours=2.0, cell_bit=500)
    sent, earth = np.zeros_like(made.sent_bit), np.zeros_like(made.earth_bit)
    middle = int(np.searchsorted(made.edges_s, 600.0))
    sent[middle, 0, 1], earth[middle + 2, 1] = 7_000, 6_000
    return replace(made, sent_bit=sent, earth_bit=earth, light_time_s=np.full(made.n_slots, 100.0))


@pytest.fixture(scope="module")
def film(flown, delivery):
    plan, telemetry, result = flown
    return Replay(plan, telemetry, result.coverage.first_seen_s, delivery)


def test_a_transfer_is_drawn_while_it_lasts_and_no_longer(film, delivery):
    edges = delivery.edges_s
    first, last = (int(np.flatnonzero(bits.sum(axis=axis))[0]) for bits, axis in (
        (delivery.sent_bit, (1, 2)), (delivery.earth_bit, 1)
    ))  # fmt: skip
    for slot, links in ((first - 1, ()), (first, ((0, 1),)), (first + 1, ()), (last, ((1, -1),)), (last + 1, ())):
        assert film.at(edges[slot] + 1.0).traffic.links == links
        assert film.at(edges[slot + 1] - 1.0).traffic.links == links
    assert film.at(0.0).traffic.links == ()


def test_what_was_sent_is_on_the_way_for_the_time_of_light_and_then_on_earth(film, delivery):
    slot = int(np.flatnonzero(delivery.earth_bit.any(axis=1))[0])
    start, end = delivery.edges_s[slot : slot + 2]
    for t, on_way, on_earth in (
        (start, 0.0, 0.0),
        (end, 6000.0, 0.0),
        (start + 100.0, 6000.0, 0.0),
        (0.5 * (start + end) + 100.0, 3000.0, 3000.0),
        (end + 100.0, 0.0, 6000.0),
    ):
        traffic = film.at(t).traffic
        assert (traffic.on_way_bit, traffic.on_earth_bit) == pytest.approx((on_way, on_earth), abs=1e-6)
    assert words(film.at(end).traffic) == ["0 bit on Earth", "6.0 kbit on the way to Earth"]


def test_packets_go_from_sender_to_receiver_at_an_even_pace(film, delivery):
    slot = int(np.flatnonzero(delivery.sent_bit.any(axis=(1, 2)))[0])
    beat_s = film.duration / BEATS
    t = beat_s * np.ceil(delivery.edges_s[slot] / beat_s) + 0.1
    before, after = film.at(t), film.at(t + 0.4 * beat_s)
    ((start, end),) = ways(before, 1.0)
    assert np.array_equal(start, before.r_BN_N[0]) and np.array_equal(end, before.r_BN_N[1])
    line = (np.zeros(3), np.array([0.0, 0.0, 9.0]))
    moved = packets(after, line)[:, 2] - packets(before, line)[:, 2]
    assert moved == pytest.approx(np.full(PACKETS, 0.4 * 9.0 / PACKETS), rel=1e-6)
    assert (np.diff(packets(before, line)[:, 2]) == pytest.approx(9.0 / PACKETS)) and packets(before, line).min() >= 0.0


def test_lines_to_earth_point_where_the_dish_points(film, delivery):
    slot = int(np.flatnonzero(delivery.earth_bit.any(axis=1))[0])
    now = film.at(delivery.edges_s[slot] + 5.0)
    ((start, end),) = ways(now, 1.0)
    along = (end - start) / np.linalg.norm(end - start)
    assert along == pytest.approx(now.boresight_N[1])


def test_a_flight_that_delivers_nothing_has_the_pictures_it_had(gl, flown, replay, film, delivery):
    plan, telemetry, result = flown
    silent = replace(delivery, earth_bit=np.zeros_like(delivery.earth_bit))
    assert transfers_of(silent, 1200.0) is None and transfers_of(None, 1200.0) is None
    t = float(delivery.edges_s[np.flatnonzero(delivery.sent_bit.any(axis=(1, 2)))[0]]) + 5.0
    with Drawing(plan, replay.path_N, width=320, height=240) as drawing:
        plain = drawing.draw(replay.at(t))
        same = drawing.draw(Replay(plan, telemetry, result.coverage.first_seen_s, silent).at(t))
        busy = drawing.draw(film.at(t))
    assert np.array_equal(plain, same)
    assert 200 < (plain != busy).any(axis=2).sum() < 0.4 * plain[..., 0].size
