"""Figures of the way to Earth: what is painted is what the delivery says, and nothing is there that is not."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.colors import to_rgb

from swarm_mj.figures.delivery_view import (
    LINK_STYLES,
    OTHERS,
    cells_by_reason,
    last_shown_s,
    link_in_swarm,
    links_to_earth,
    on_earth,
    speakers,
    stretches,
)
from swarm_mj.figures.palette import VERMILLION
from swarm_mj.figures.run_figures import COMPOSERS
from swarm_mj.figures.timescale import STRETCHED, delivery_scale
from swarm_mj.figures.units import data_unit
from swarm_mj.mission.links import Obstacle
from tests.records.deliveries import with_delivery

from .looks import is_seen
from .sheets import assert_labels_do_not_overlap, assert_nothing_is_cut_off, swarm_of, with_coverage

NAMES = ("contacts", "data", "delivered_map")


@pytest.fixture(scope="module")
def partly(flown):
    """A flight of two in which half of the target was seen by one alone, which never closes its link."""
    plan, telemetry, result = flown
    first = result.coverage.first_seen_by_s.copy()
    first[1, plan.region.centroid_A @ plan.region.axes_A[0] > 0.0] = np.nan
    first[:, plan.region.centroid_A @ plan.region.axes_A[1] > 1500.0] = np.nan
    return with_delivery((plan, telemetry, with_coverage(result, first)), mute=(0,), lost_bit=300_000)


@pytest.mark.parametrize("name", NAMES)
def test_a_map_that_arrives_in_part_reads_well(partly, name):
    figure = COMPOSERS[name](*partly)
    assert_nothing_is_cut_off(figure)
    assert_labels_do_not_overlap(figure)
    (legend,) = figure.legends
    for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
        assert is_seen(handle, figure), text.get_text()


def test_cells_are_hatched_by_their_reason_and_the_legend_says_how_much(partly):
    plan, _, result = partly
    delivery = result.delivery
    (reason,) = cells_by_reason(delivery)
    cells = cells_by_reason(delivery)[reason]
    assert reason == "beam"
    assert np.array_equal(cells, np.isnan(delivery.arrives_s) & (delivery.tile_of_cell >= 0))
    ax = COMPOSERS["delivered_map"](*partly).axes[0]
    (hatched,) = [c for c in ax.collections if c.get_hatch()]
    assert len(hatched.get_paths()) == cells.sum() > 5
    words = [text.get_text() for text in ax.get_figure().legends[0].get_texts()]
    percent = 100.0 * plan.region.area[cells].sum() / plan.region.total_area
    assert f"seen, not delivered (beam): {np.ceil(100.0 * percent) / 100.0:.2f} %" in words
    unseen = 100.0 * plan.region.area[delivery.tile_of_cell < 0].sum() / plan.region.total_area
    assert unseen > 1.0 and f"not seen: {np.ceil(100.0 * unseen) / 100.0:.2f} %" in words


def test_later_cells_are_darker(flown):
    times = flown[2].delivery.arrives_s
    ax = COMPOSERS["delivered_map"](*flown).axes[0]
    colours = ax.collections[0].get_facecolor()[:, :3]
    luminance = colours @ (0.2126, 0.7152, 0.0722)
    there = ~np.isnan(times)
    order = np.argsort(times[there])
    assert np.ptp(times[there]) > 600.0
    assert (np.diff(luminance[there][order]) <= 1e-6).all() and np.ptp(luminance[there]) > 0.3


def test_bars_tell_contacts_obstacles_and_transfers_slot_by_slot(partly):
    plan, telemetry, result = partly
    delivery = result.delivery
    rows = [link_in_swarm(delivery, 0), *links_to_earth(delivery)]
    assert link_in_swarm(delivery, 1) is None  # it speaks to Earth itself
    assert [row.sent_bit for row in rows] == [0, delivery.delivered_bit]
    assert set(rows[0].state[12:]) == {Obstacle.BEAM}
    contact = delivery.earth_contact_bit[:, 1] > 0
    assert np.array_equal(rows[1].state == Obstacle.NONE, contact)
    assert np.array_equal(rows[1].used > 0.0, delivery.earth_bit[:, 1] > 0)
    ax = COMPOSERS["contacts"](*partly).axes[0]
    sent = [c for c in ax.collections if isinstance(c, FillBetweenPolyCollection)]
    assert {tuple(c.get_facecolor()[0, :3]) for c in sent} == {to_rgb(VERMILLION)}
    # The area that is painted above a row is the time of sending times the share that was used, with a least height.
    assert sum(c.get_datalim(ax.transData).height > 0.0 for c in sent) == 1
    stations = {text.get_text() for text in ax.texts}
    assert stations and stations <= {"Goldstone DSS-14", "Goldstone", "G", "C", "M", "Canberra", "Madrid"}


def test_contact_with_those_who_do_not_speak_to_earth_is_another_state(flown):
    delivery = with_delivery(swarm_of(flown, 3), mute=(1,))[2].delivery
    capacity = delivery.contact_bit.copy()
    capacity[:, 1, 0] = 7
    row = link_in_swarm(replace(delivery, contact_bit=capacity), 1)
    assert set(row.state) == {OTHERS}
    assert link_in_swarm(delivery, 1).state[-1] == Obstacle.BEAM
    assert set(LINK_STYLES) == {*map(int, Obstacle), OTHERS}
    to_relay = delivery.contact_bit[:, 0, 2] > 0
    assert to_relay.any() and np.array_equal(link_in_swarm(delivery, 0).state == Obstacle.NONE, to_relay)


def test_of_several_relays_the_obstacle_is_that_of_the_link_that_comes_nearest_to_closing(flown):
    delivery = with_delivery(swarm_of(flown, 3), mute=(0,))[2].delivery
    earth, why = delivery.earth_contact_bit.copy(), delivery.why_swarm.copy()
    earth[-1, 1] = 5
    why[:, 0, 1] = Obstacle.RANGE
    both = replace(delivery, earth_contact_bit=earth, why_swarm=why)
    assert list(speakers(both)) == [1, 2] and both.why_swarm[-1, 0, 2] == Obstacle.BEAM
    assert link_in_swarm(both, 0).state[-1] == Obstacle.BEAM


def test_stretches_meet_and_cover_all_slots():
    edges = np.array([0.0, 1.0, 3.0, 4.0, 9.0])
    assert stretches(edges, np.array([2, 2, 0, 2])) == [(0.0, 3.0, 2), (3.0, 4.0, 0), (4.0, 9.0, 2)]


def test_earth_has_received_what_was_sent_a_light_time_before(partly):
    delivery = partly[2].delivery
    times, received = on_earth(delivery, delivery.earth_bit)
    slot = int(np.flatnonzero(delivery.earth_bit.any(axis=1))[0])
    assert np.interp(delivery.edges_s[slot] + 900.0, times, received) == 0.0
    assert np.interp(delivery.edges_s[slot + 1] + 900.0, times, received) == delivery.earth_bit[slot].sum()
    assert received[-1] == delivery.delivered_bit
    arrived = delivery.tile_arrives_s[delivery.arrived]
    bits = np.interp(arrived, times, received)
    assert (bits > 0).all() and bits.max() == delivery.delivered_bit


def test_the_time_axis_is_wider_while_data_move_and_ends_soon_after_them(flown, partly):
    for plan, telemetry, result in (flown, partly):
        delivery = result.delivery
        end = last_shown_s(delivery)
        assert (end < delivery.edges_s[-1]) == delivery.complete
        assert not delivery.complete or end > delivery.full_s
        scale = delivery_scale(plan, telemetry, 3000.0, end)
        assert scale.duration_s == end
        if scale.encounter_s is not None:
            assert scale.share(*scale.encounter_s) == pytest.approx(STRETCHED, abs=0.05)
            assert scale.on_page(scale.from_page(np.linspace(0, 1, 50))) == pytest.approx(np.linspace(0, 1, 50))


def test_every_line_lies_inside_its_axes(partly):
    plan, telemetry, result = partly
    lost = result.delivery.lost_bit.copy()
    lost[20:, 0] = 5 * result.delivery.aboard_bit.max()
    ax = COMPOSERS["data"](plan, telemetry, replace(result, delivery=replace(result.delivery, lost_bit=lost))).axes[0]
    low, high = ax.get_ylim()
    assert all(low <= np.min(line.get_ydata()) and np.max(line.get_ydata()) <= high for line in ax.lines)


def test_what_arrives_after_the_last_slot_is_shown_too(partly):
    delivery = partly[2].delivery
    late = np.where(delivery.arrived, delivery.edges_s[-1] + 800.0, np.nan)
    assert last_shown_s(replace(delivery, tile_arrives_s=late)) > delivery.edges_s[-1] + 800.0


def test_an_unproven_plan_draws_no_best(partly):
    plan, telemetry, result = partly
    unknown = {
        key: np.full_like(np.asarray(getattr(result.delivery, key), float), np.nan)
        for key in ("best_earth_bit", "best_share", "best_full_s", "best_bound_area")
    }
    figure = COMPOSERS["data"](plan, telemetry, replace(result, delivery=replace(result.delivery, **unknown)))
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "delivered" in words and not any("best" in word or "schedule" in word for word in words)
    assert_nothing_is_cut_off(figure)


@pytest.mark.parametrize("name", NAMES)
def test_where_nothing_is_known_or_nothing_was_seen_the_page_says_so(flown, name):
    plan, telemetry, result = flown
    unknown = COMPOSERS[name](plan, telemetry, replace(result, delivery=None))
    assert any("not computed" in text.get_text() for text in unknown.texts)
    nothing = with_coverage(result, np.full((plan.n, plan.region.n_cells), np.nan))
    figure = COMPOSERS[name](*with_delivery((plan, telemetry, nothing)))
    assert_nothing_is_cut_off(figure)
    titles = " ".join(ax.get_title(loc="left") for ax in figure.axes)
    assert "0.00 % seen, 0.00 % delivered" in titles or name == "contacts"


def test_amounts_of_data_have_the_unit_in_which_they_read_best():
    assert [data_unit(bits).unit for bits in (0, 999, 1e3, 2.5e6, 7e12)] == ["bit", "bit", "kbit", "Mbit", "Gbit"]
    assert data_unit(2.5e6).bits == 1e6
