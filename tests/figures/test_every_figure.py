"""Every figure of a run: written whole, not blank, labelled with units, nothing cut off, whatever the swarm."""

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from matplotlib.text import Text

from swarm_mj.figures.run_figures import COMPOSERS
from swarm_mj.figures.style import DPI, save

from .sheets import assert_labels_do_not_overlap, assert_nothing_is_cut_off, swarm_of, with_coverage

NAMES = sorted({*COMPOSERS} - {"formation"})
#: Units that must be read somewhere in each figure.
UNITS = {
    "behaviors": {"km", "min"},
    "trajectories": {"km", "m/s"},
    "target": {"km", "deg"},
    "tracking_error": {"min", "-"},
    "pointing_error": {"min", "deg"},
    "navigation": {"min", "m"},
    "operation": {"km", "deg"},
    "coverage": {"min", "%"},
    "ground_track": {"deg"},
    "footprints": {"deg"},
    "illumination": {"min", "deg"},
    "wheel_speed": {"min", "rpm"},
    "wheel_momentum": {"min", "mN m s"},
    "propulsion": {"min", "mN", "m/s", "g"},
    "links": {"min"},
    "contacts": {"min", "Mbit"},
    "data": {"min", "Mbit", "%"},
    "delivered_map": {"min", "deg"},
}


def test_every_figure_of_a_run_has_its_function():
    assert set(COMPOSERS) == {*UNITS, "formation"}  # of formations alone, which the quick flight has none of


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_has_the_size_of_its_figure_is_not_blank_and_does_not_touch_its_border(written, composed, name):
    pixels = imread(written / f"{name}.png")[..., :3]
    assert pixels.shape[1::-1] == pytest.approx(composed[name].get_size_inches() * DPI, abs=1)
    inked = (pixels < 0.97).any(axis=2)
    assert inked.mean() > 0.04
    assert pixels.std() > 0.05
    columns, rows = np.flatnonzero(inked.any(axis=0)), np.flatnonzero(inked.any(axis=1))
    square = name in ("footprints", "delivered_map")  # the shape of the map decides
    assert np.ptp(columns) > (0.6 if square else 0.85) * inked.shape[1]
    assert np.ptp(rows) > 0.85 * inked.shape[0]
    border = np.concatenate((pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]))
    assert (border > 0.99).all()


def test_nothing_else_is_left_in_the_folder(written):
    assert {path.name for path in written.iterdir()} == {*(f"{name}.png" for name in NAMES), "operation.pdf"}


@pytest.mark.parametrize("name", NAMES)
def test_every_named_axis_ends_in_its_unit_and_texts_are_large_enough(composed, name):
    named = [
        text
        for ax in composed[name].axes
        if ax.get_visible() and ax.axison
        for text in (ax.get_xlabel(), ax.get_ylabel())
        if text
    ]
    assert named
    assert all(re.search(r"\[[^\]]+\]$", text) for text in named)
    texts = [text for text in composed[name].findobj(Text) if text.get_visible() and text.get_text()]
    found = {match for text in texts for match in re.findall(r"\[([^\]]+)\]$", text.get_text())}
    assert found == UNITS[name]
    assert min(text.get_fontsize() for text in texts) >= 7.0  # to be read at half the size


def sizes():
    """Figures and numbers of spacecraft; one to five are those of `test_missions.py`."""
    growing = ("links", "contacts", "data", "ground_track", "trajectories", "wheel_momentum", "propulsion")
    for name in NAMES:
        yield pytest.param(name, 12, marks=pytest.mark.slow)
        if name in growing:
            yield name, 100


@pytest.mark.parametrize(("name", "n"), sizes())
def test_swarms_of_any_size_fit_on_the_page(flown, name, n):
    figure = COMPOSERS[name](*swarm_of(flown, n))
    assert_nothing_is_cut_off(figure)
    assert_labels_do_not_overlap(figure)


@pytest.mark.parametrize("name", ["coverage", "footprints", "operation", "illumination"])
def test_nothing_observed_is_still_a_figure(flown, name):
    plan, telemetry, result = flown
    nothing = with_coverage(result, np.full((plan.n, plan.region.n_cells), np.nan))
    figure = COMPOSERS[name](plan, telemetry, nothing)
    titles = " ".join(ax.get_title(loc="left") for ax in figure.axes)
    assert "0.00 %" in titles or name == "illumination"
    assert_nothing_is_cut_off(figure)


def test_body_names_may_hold_dollars_and_scenario_names_may_be_long(flown, tmp_path):
    plan, telemetry, result = flown
    body = plan.scenario.body.model_copy(update={"name": r"$\nonsense$ & Co"})
    odd = replace(plan, scenario=plan.scenario.model_copy(update={"body": body, "name": "long-name-" * 12}))
    for name in ("target", "tracking_error", "footprints"):
        figure = COMPOSERS[name](odd, telemetry, result)
        assert_nothing_is_cut_off(figure)
        save(figure, tmp_path / f"{name}.png")
