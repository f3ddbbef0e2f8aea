"""The figure of navigation by pictures: the error that was made, three sigmas along the longest axis, and the pictures."""

import numpy as np
import pytest

from swarm_mj.figures.drawing import figures_of
from swarm_mj.figures.run_figures import COMPOSERS


def test_it_shows_errors_three_sigmas_and_who_had_which_picture(flown):
    plan, telemetry, result = flown
    figure = COMPOSERS["navigation"](plan, telemetry, result)
    first, second = figure.axes[0].lines, figure.axes[1].lines
    sigma, error = first[0].get_ydata(), first[1].get_ydata()
    assert sigma == pytest.approx(3.0 * 50.0) and error[[0, -1]] == pytest.approx(100.0 * np.exp([0.0, -1.0]))
    last = first[1].get_xdata()[-1]
    had = {
        line.get_marker(): line.get_xdata()
        for line in first[2:]
        if line.get_marker() != "None" and len(line.get_xdata())
    }
    assert {mark: list(at / last) for mark, at in had.items()} == {
        "o": pytest.approx([0.2]),
        "s": pytest.approx([0.5]),
        "x": pytest.approx([0.8]),
    }
    assert not any(len(line.get_xdata()) for line in second[2:] if line.get_marker() != "None")
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names[:5] == ["error", "3 sigma, longest axis", "used: centroid", "used: limb", "not used"]


def test_it_is_drawn_only_of_flights_by_pictures(flown):
    telemetry = flown[1].drop_vars("r_BN_N_estimate")
    assert "navigation" in figures_of(flown[1]) and "navigation" not in figures_of(telemetry)
