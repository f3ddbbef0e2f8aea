"""A campaign over a grid: every design has a probability of its own. Flights are made up, so that the truth is known."""

import json

import numpy as np
import pytest
from scipy import stats

from swarm_mj.campaigns import statistics
from swarm_mj.campaigns.figures import _by_design, compose_coverage, compose_sensitivity, compose_trade
from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.campaigns.store import schema_of, table_of
from swarm_mj.campaigns.summary import group_table, summarise_campaign

from .conftest import ONE

RUNS = 50
#: How many of the flights of a design with so many observers see the whole target.
SEEN = {2: 0, 3: 41, 4: 50}
POINTS = [list(range(1, n + 1)) for n in SEEN]
ONE_FACTOR = f"""
parameters:
  design.visiting_points: {{distribution: choice, values: {POINTS}}}
record: [coverage_percent]
"""
TWO_FACTORS = f"""
parameters:
  camera.half_angle_deg: {{distribution: uniform, low: 15, high: 16, steps: 2}}
  design.visiting_points: {{distribution: choice, values: {POINTS}}}
record: [coverage_percent]
"""


def flown(resolved, seen):
    """A table of flights, in an order of its own, of which `seen(values, k)` says whether the k-th of its design saw all."""
    sample, count, rows = Sample(resolved.campaign), {}, []
    for row in range(sample.rows):
        t = sample.trial(row)
        key = json.dumps(t.values)
        count[key] = count.get(key, -1) + 1
        all_seen = bool(seen(t.values, count[key]))
        rows.append(
            {"row": t.row, "run": t.run, "scenario": t.scenario, "seed": t.seed, **t.values, "status": "ok",
             "covered": all_seen, "coverage_percent": 100.0 if all_seen else 50.0 + len(t.values["design.visiting_points"])}
        )  # fmt: skip
    order = np.random.default_rng(1).permutation(len(rows))
    return table_of([rows[k] for k in order], schema_of(resolved.campaign))


def wilson(successes, n):
    """The score interval, by its formula (Wilson 1927)."""
    z, p = stats.norm.ppf(0.975), successes / n
    half = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (p + z * z / (2 * n) - half) / (1 + z * z / n), (p + z * z / (2 * n) + half) / (1 + z * z / n)


def one(summary):
    return summary["scenarios"]["one"]


def text_of(table):
    from rich.console import Console

    console = Console(width=150, record=True, quiet=False, file=open("/dev/null", "w"))
    console.print(table)
    return console.export_text()


def test_each_design_on_a_grid_has_its_own_probability_with_wilsons_interval(write):
    resolved = load_campaign(write(ONE, runs=RUNS, method="grid", more=ONE_FACTOR))
    results = flown(resolved, lambda values, k: k < SEEN[len(values["design.visiting_points"])])
    summary = summarise_campaign(resolved, results)
    groups = one(summary)["groups"]
    assert one(summary)["swept"] == ["design.visiting_points"]
    assert [group["values"]["design.visiting_points"] for group in groups] == POINTS
    for group, successes in zip(groups, SEEN.values(), strict=True):
        assert group["covered"]["flights"] == RUNS
        assert group["covered"]["probability"] == pytest.approx(successes / RUNS, abs=1e-15)
        assert group["covered"]["wilson"] == pytest.approx(wilson(successes, RUNS), abs=1e-12)
    json.dumps(summary, allow_nan=False)
    words = text_of(group_table(summary))
    assert "82.0 (69.2 to 90.2)" in words and "100.0 (92.9 to 100.0)" in words and "0.0 (0.0 to 7.1)" in words


def test_the_figures_of_a_grid_show_designs_and_not_their_mixture(write):
    resolved = load_campaign(write(ONE, runs=RUNS, method="grid", more=ONE_FACTOR))
    results = flown(resolved, lambda values, k: k < SEEN[len(values["design.visiting_points"])])
    summary = summarise_campaign(resolved, results)
    figure = compose_coverage(resolved, results, summary)
    assert [text.get_text() for text in figure.axes[0].texts] == ["0.0 %", "82.0 %", "100.0 %"]
    areas, _ = _by_design(resolved, results, summary)
    assert list(areas) == [f"visiting_points={points}" for points in POINTS]
    line = compose_trade(resolved, results, summary).axes[0].containers[0].lines[0]
    assert line.get_ydata() == pytest.approx([0.0, 82.0, 100.0])


def test_two_swept_factors_make_a_heat_map(write):
    resolved = load_campaign(write(ONE, runs=RUNS, method="grid", more=TWO_FACTORS))

    def chance(values):
        return SEEN[len(values["design.visiting_points"])] // (2 if values["camera.half_angle_deg"] == 15.0 else 1)

    results = flown(resolved, lambda values, k: k < chance(values))
    summary = summarise_campaign(resolved, results)
    assert len(one(summary)["groups"]) == 6
    figure = compose_trade(resolved, results, summary)
    (image,) = figure.axes[0].images
    assert np.asarray(image.get_array()) == pytest.approx(np.array([[0.0, 40.0, 50.0], [0.0, 82.0, 100.0]]))


def test_what_is_drawn_at_random_makes_no_groups(write):
    resolved = load_campaign(write(ONE, runs=60, more=ONE_FACTOR))
    results = flown(resolved, lambda values, k: k % 2)
    summary = summarise_campaign(resolved, results)
    assert "groups" not in one(summary) and group_table(summary) is None
    assert compose_trade(resolved, results, summary) is None
    assert one(summary)["covered"]["flights"] == 60


def test_a_choice_among_any_values_appears_in_the_sensitivity(write):
    resolved = load_campaign(write(ONE, runs=90, more=ONE_FACTOR))
    results = flown(resolved, lambda values, k: len(values["design.visiting_points"]) == 3)
    summary = summarise_campaign(resolved, results)
    assert one(summary)["choices"]["coverage_percent"]["design.visiting_points"]["value"] == pytest.approx(
        1.0, abs=1e-9
    )
    figure = compose_sensitivity(resolved, results, summary)
    assert "design.visiting_points" in [tick.get_text() for tick in figure.axes[0].get_yticklabels()]


def test_the_correlation_ratio_is_that_of_a_mixture_of_gaussians():
    rng = np.random.default_rng(4)
    groups = rng.integers(3, size=4000)
    y = np.array([0.0, 1.0, 5.0])[groups] + 2.0 * rng.standard_normal(4000)
    between = np.var([0.0, 1.0, 5.0])
    estimate, p = statistics.correlation_ratio(groups, y, rng)
    truth = np.sqrt(between / (between + 4.0))
    assert estimate.low < truth < estimate.high and estimate.value == pytest.approx(truth, abs=0.02) and p < 1e-10


def test_a_choice_that_changes_nothing_has_a_ratio_near_zero():
    rng = np.random.default_rng(4)
    estimate, p = statistics.correlation_ratio(rng.integers(3, size=2000), rng.standard_normal(2000), rng)
    assert estimate.value < 0.06 and p > 0.01
    assert statistics.correlation_ratio(np.zeros(50, int), rng.random(50), rng) is None


def test_two_long_values_that_look_alike_stay_apart(write):
    alike = [[*range(1, 15), 20], [*range(1, 15), 21]]
    resolved = load_campaign(write(ONE, runs=RUNS, method="grid", more=ONE_FACTOR.replace(str(POINTS), str(alike))))
    results = flown(resolved, lambda values, k: k < 20 * (values["design.visiting_points"][-1] - 19))
    summary = summarise_campaign(resolved, results)
    areas, _ = _by_design(resolved, results, summary)
    assert len(areas) == 2
    line = compose_trade(resolved, results, summary).axes[0].containers[0].lines[0]
    assert line.get_ydata() == pytest.approx([40.0, 80.0])
