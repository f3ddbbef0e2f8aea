"""The way to Earth on the page: numbers, reasons and plots are those of the run's own files."""

from dataclasses import replace

import numpy as np
import pytest

from swarm_mj.flight.plan import make_plan
from swarm_mj.observation.coverage import percent_text, rounded_up_digits
from swarm_mj.records.delivered import delivered_summary
from swarm_mj.records.run_record import observation_of, read_run
from swarm_mj.reports.delivery import CLASSES, delivery_figures, delivery_section, outcome
from swarm_mj.reports.page import report_html
from swarm_mj.reports.sections import summary_section
from tests.records.deliveries import with_delivery


@pytest.fixture(scope="module")
def run(folder):
    return read_run(folder)


@pytest.fixture(scope="module")
def partly(run):
    """The run, but half of the target was seen by one alone, which never closes its link."""
    plan = make_plan(run.scenario)
    result = observation_of(run, plan)
    result.coverage.first_seen_by_s[1, ::2] = np.nan
    *_, result = with_delivery((plan, run.telemetry, result), mute=(0,), cell_bit=90_000)
    summary = {**run.summary, **delivered_summary(plan, result)}
    coverage = {**run.coverage, "first_seen_by_s": result.coverage.first_seen_by_s}
    return replace(run, delivery=result.delivery, summary=summary, coverage=coverage)


def test_the_page_leads_with_seen_and_delivered(run):
    text = report_html([run])
    cards = [part.split("</dt>")[0].split("<sub>")[0] for part in text.split("<dt>")[1:4]]
    assert cards == ["observed area P", "delivered to Earth", "map complete on Earth"]
    assert percent_text(run.summary["delivered_percent"]) in text and 'href="#delivery"' in text
    for name in ("contacts", "data", "map"):
        assert f'id="way-0-{name}"' in text and f'"way-0-{name}":' in text


def test_what_is_seen_and_not_delivered_stands_in_a_table_with_reason_and_remedy(partly):
    (part,) = partly.summary["not_delivered"]
    text = str(delivery_section([partly], ["quick"]))
    assert 30.0 < part["percent"] < 70.0
    row = text.split("<tbody>")[1].split("</tbody>")[0]
    for words in ("beam", rounded_up_digits(part["percent"]), "sc1", part["remedy"]):
        assert words in row
    assert f"{partly.summary['delivered_percent']:.2f}" in text and "no schedule has it there" not in text


def test_bounds_and_what_is_missing_are_rounded_up(partly):
    told = {"coverage_percent": 97.3192, "delivered_percent": 97.3144, "delivered_percent_bound": 97.3192}
    run = replace(partly, summary={**partly.summary, **told, "time_to_all_data_s": None})
    assert "No schedule delivers more than 97.32\N{NO-BREAK SPACE}%" in outcome(run, partly.delivery)
    assert "0.01 % stays out there" in str(summary_section(run))


def test_plots_show_every_contact_transfer_and_arrival(partly):
    delivery = partly.delivery
    figures = delivery_figures(partly)
    sent = figures["contacts"].data[-1]
    slots = np.flatnonzero(delivery.earth_bit[:, 1])
    assert np.allclose(60.0 * np.array(sent.base), delivery.edges_s[slots])
    assert np.allclose(60.0 * np.array(sent.x), np.diff(delivery.edges_s)[slots])
    assert figures["contacts"].layout.yaxis.range[0] > figures["contacts"].layout.yaxis.range[1]  # downwards
    assert np.allclose(sent.offset, -np.array(sent.width))  # so that transfers stand on their row
    assert np.array_equal(
        np.argsort(sent.width), np.argsort(delivery.earth_bit[slots, 1] / delivery.earth_contact_bit[slots, 1])
    )
    bars = {bar.name: 60.0 * sum(bar.x) for bar in figures["contacts"].data[:-1]}
    lasts = np.diff(delivery.edges_s)
    assert bars["contact"] == pytest.approx(lasts @ (delivery.earth_contact_bit[:, 1] > 0))
    assert sum(bars.values()) == pytest.approx(2.0 * lasts.sum())
    curves = {curve.name: curve for curve in figures["data"].data}
    assert curves["delivered"].y[-1] == pytest.approx(partly.summary["delivered_percent"], abs=1e-3)
    assert curves["on Earth"].y[-1] == pytest.approx(delivery.delivered_bit / 1e6, rel=1e-6)
    assert len({curve.line.dash for curve in curves.values() if curve.name.startswith("aboard")}) == partly.n


def test_the_map_shows_each_cell_once(partly, run):
    for one in (partly, run):
        cells = one.delivery.tile_of_cell
        traces = delivery_figures(one)["map"].data
        counts = [np.isnan(trace.x).sum() for trace in traces]
        assert sum(counts) == len(cells)
        late = [trace for trace in traces if trace.name.startswith("until")]
        assert len(late) <= CLASSES
        words = [trace.name for trace in traces if "not delivered" in trace.name]
        assert len(words) == len(one.summary["not_delivered"])


def test_where_nothing_was_seen_the_contacts_planned_are_shown_and_no_data(run):
    plan, nothing = make_plan(run.scenario), np.full_like(run.coverage["first_seen_by_s"], np.nan)
    result = observation_of(run, plan)
    result.coverage.first_seen_by_s[:] = nothing
    *_, result = with_delivery((plan, run.telemetry, result))
    summary = {**run.summary, **delivered_summary(plan, result), "coverage_percent": 0.0}
    dark = replace(
        run, delivery=result.delivery, summary=summary, coverage={**run.coverage, "first_seen_by_s": nothing}
    )
    figures, text = delivery_figures(dark), str(delivery_section([dark], ["dark"]))
    assert list(figures) == ["contacts", "map"] and "way-0-data" not in text and "othing was on its way" in text
    axis, bars = figures["contacts"].layout.xaxis, figures["contacts"].data
    ends = [start + length for bar in bars for start, length in zip(bar.base or (), bar.x or (), strict=True)]
    assert ends and axis.range[1] == pytest.approx(max(ends))


def test_a_run_whose_way_to_earth_is_unknown_has_no_such_part(run, partly):
    old = replace(run, delivery=None, summary={**run.summary, "delivered_percent": None})
    assert delivery_section([old], ["old"]) is None
    text = report_html([old])
    assert "delivered to Earth" not in text and 'href="#delivery"' not in text
    both = report_html([old, partly])
    assert "was not computed" in both and '"way-1-map"' in both and '"way-0-map"' not in both
