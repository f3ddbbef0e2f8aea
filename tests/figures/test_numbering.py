"""Numbers beside spacecraft cover no marker, no other number, and where there is room no line."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from swarm_mj.figures.numbering import number_beside
from swarm_mj.figures.run_figures import COMPOSERS

from .sheets import swarm_of

#: How far the spacecraft of the tests are apart, about [m].
REACH_M = 2500.0


def numbered(places, **options):
    figure = Figure(figsize=(5.0, 5.0), dpi=100)
    ax = figure.subplots()
    ax.set_xlim(0.0, 10.0)
    ax.set_ylim(0.0, 10.0)
    number_beside(ax, np.asarray(places, float), ["black"] * len(places), **options)
    figure.draw_without_rendering()
    return ax


def covers(box, point, room=0.0):
    return box.x0 - room < point[0] < box.x1 + room and box.y0 - room < point[1] < box.y1 + room


def test_numbers_keep_clear_of_markers_and_of_each_other():
    rng = np.random.default_rng(3)
    for _ in range(10):
        places = 5.0 + 0.6 * rng.standard_normal((6, 2))
        ax = numbered(places)
        boxes = [Text.get_window_extent(text) for text in ax.texts]
        pixels = ax.transData.transform(places)
        for k, box in enumerate(boxes):
            assert not any(covers(box, point) for point in pixels)
            assert not any(box.overlaps(other) for other in boxes[k + 1 :])


def test_a_number_leaves_a_line_through_its_place():
    rng = np.random.default_rng(4)
    for angle in rng.uniform(0.0, np.pi, 10):
        arm = 4.0 * np.array([np.cos(angle), np.sin(angle)])
        ax = numbered([(5.0, 5.0)], lines=[np.array([5.0 - arm, 5.0 + arm])], marked=False)
        box = Text.get_window_extent(ax.texts[0]).shrunk(0.6, 0.6)
        line = ax.transData.transform(5.0 + np.linspace(-1.0, 1.0, 400)[:, None] * arm)
        assert not any(covers(box, point) for point in line)


@pytest.mark.parametrize("n", [6, 8, 10])
def test_no_number_of_the_trajectories_covers_a_marker(flown, n):
    plan, telemetry, result = swarm_of(flown, n)
    apart_m = np.random.default_rng(n).uniform(-REACH_M, REACH_M, (n, 3))
    figure = COMPOSERS["trajectories"](plan, telemetry.assign(r_BN_N=telemetry["r_BN_N"] + apart_m), result)
    figure.draw_without_rendering()
    ax = figure.axes[0]
    markers = [
        ax.transData.transform(np.column_stack(line.get_data())) for line in ax.lines if line.get_marker() == "o"
    ]
    boxes = [
        Text.get_window_extent(text).shrunk(0.7, 0.7)
        for text in ax.texts
        if text.get_text().isdigit() and text.get_fontweight() == "bold"
    ]
    assert len(boxes) == n
    for k, box in enumerate(boxes):
        assert not any(covers(box, point) for points in markers for point in points)
        assert not any(box.overlaps(other) for other in boxes[k + 1 :])


def test_the_line_of_the_arrival_runs_through_no_name_of_a_mode(flown):
    plan, telemetry, result = flown
    calm = telemetry.assign(mode=telemetry["mode"] * 0, tracked_spacecraft=telemetry["tracked_spacecraft"] * 0)
    figure = COMPOSERS["links"](plan, calm, result)
    figure.draw_without_rendering()
    ax = figure.axes[0]
    arrival = ax.transData.transform((plan.scenario.design.time_of_flight_s / 60.0, 0.0))[0]
    names = [Text.get_window_extent(text) for text in ax.texts if text.get_text() == "TO"]
    assert len(names) == plan.n
    assert not any(box.x0 < arrival < box.x1 for box in names)
