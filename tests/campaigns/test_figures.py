"""Figures of a campaign: what is written on them can be read."""

import itertools
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from swarm_mj.campaigns.figures import MAX_SCENARIOS, _bars, _shown, compose_pointing


def test_no_grid_line_runs_through_the_chance_over_a_bar():
    figure = Figure()
    ax = figure.subplots()
    _bars(ax, {"two-fold": {"probability": 0.948, "wilson": (0.93, 0.961)}})
    figure.draw_without_rendering()
    (text,) = ax.texts
    ground, words = text.get_bbox_patch(), text.get_window_extent()
    assert text.get_text() == "94.8 %" and to_hex(ground.get_facecolor()) == "#ffffff"
    box = ground.get_window_extent()
    assert box.x0 <= words.x0 and box.y0 <= words.y0 and box.x1 >= words.x1 and box.y1 >= words.y1
    assert text.get_zorder() > max(line.get_zorder() for line in ax.get_ygridlines())


def test_a_diagram_that_cannot_show_every_scenario_says_so():
    few, many = ({f"s{k}": k for k in range(count)} for count in (MAX_SCENARIOS, MAX_SCENARIOS + 3))
    assert _shown(few, "Observed area") == (few, "Observed area")
    assert _shown(many, "Observed area") == (few, "Observed area, 8 of 11")


@pytest.mark.parametrize("count", [1, 4, MAX_SCENARIOS])
def test_the_intervals_of_the_95th_percentile_lie_apart_and_the_legend_explains_them(count):
    names, errors = [f"s{k}" for k in range(count)], np.linspace(0.1, 0.4, 40)
    resolved = SimpleNamespace(campaign=SimpleNamespace(name="c"), bases=dict.fromkeys(names))
    column, of = np.tile(errors, count), np.repeat(names, len(errors))
    results = pa.table({"scenario": of, "pointing_error_deg_arrival_max": column})
    quantiles = {"0.95": {"value": 0.38, "low": 0.35, "high": 0.39}}
    entry = {"outcomes": {"pointing_error_deg_arrival_max": {"quantiles": quantiles}}}
    figure = compose_pointing(resolved, results, {"scenarios": dict.fromkeys(names, entry)})
    figure.draw_without_rendering()
    (ax,) = figure.axes
    boxes = sorted((bar.lines[1][0].get_window_extent() for bar in ax.containers), key=lambda box: box.y0)
    assert len(boxes) == count
    assert all(below.y1 < above.y0 for below, above in itertools.pairwise(boxes))
    assert ax.bbox.y0 < boxes[0].y0 and boxes[-1].y1 <= ax.bbox.y1
    (legend,) = figure.legends
    assert legend.get_window_extent().y1 < ax.bbox.y0
    words = legend.get_title().get_text()
    assert "dot: 95th percentile" in words and "bar: its 95 % interval" in words
