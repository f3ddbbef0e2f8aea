"""Every figure of very different missions can be read: nothing cut off, nothing blank, no legend without its line."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

from swarm_mj.figures.drawing import composers
from swarm_mj.figures.palette import DASHES, SPACECRAFT
from swarm_mj.figures.run_figures import COMPOSERS
from swarm_mj.figures.scene import FAR, FAR_RADII, near_arrival, scene_from
from swarm_mj.figures.style import TICK_PT
from swarm_mj.figures.timescale import SHORT, STRETCHED, TimeScale, time_scale
from swarm_mj.figures.units import TimeAxis
from swarm_mj.flight.downlink import deliver
from tests.sample_missions.flights import MISSIONS, SIX_HOURS, fly

from .looks import all_axes, body_pixels, is_seen, share_filled
from .sheets import assert_labels_do_not_overlap, assert_nothing_is_cut_off

#: One that shows most of what goes wrong, beside the paper's flight, which is at hand anyway.
QUICK = ("eros-quick", "flyby of six hours")
#: The flyby of two days draws the same as that of six hours, on an axis that tests below stretch for two days.
SLOW = [name for name in MISSIONS if name not in (*QUICK, "fast_flyby")]
PARAMETERS = [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]
#: Least share of the width and of the height of axes that is drawn on.
FILLED = 0.3
#: Least width of the body on the page [px]; of 1,500.
BODY_PX = 30


@pytest.fixture(scope="module")
def flights(flown, tmp_path_factory):
    """A function: a mission, flown once."""
    made = {"eros-quick": flown}

    def flight(name):
        if name not in made:
            short = name == "flyby of six hours"
            arguments = ("fast_flyby", SIX_HOURS) if short else (name, ())
            plan, telemetry, result = fly(arguments[0], tmp_path_factory.mktemp("mission"), arguments[1])
            made[name] = plan, telemetry, replace(result, delivery=deliver(plan, telemetry, result.kept))
        return made[name]

    return flight


@pytest.fixture(scope="module")
def pages(flights, composed):
    """A function: all figures of a mission, drawn once."""
    made = {"eros-quick": composed}

    def figures(name):
        if name not in made:
            made[name] = {figure: compose(*flights(name)) for figure, compose in composers(flights(name)[1]).items()}
            for figure in made[name].values():
                figure.draw_without_rendering()
        return made[name]

    return figures


@pytest.mark.parametrize("name", PARAMETERS)
def test_nothing_is_cut_off_and_no_labels_overlap(pages, name):
    for figure in pages(name).values():
        assert_nothing_is_cut_off(figure, is_drawn=True)
        assert_labels_do_not_overlap(figure)


@pytest.mark.parametrize("name", PARAMETERS)
def test_no_axes_are_blank(pages, name):
    for stem, figure in pages(name).items():
        for k, ax in enumerate(all_axes(figure)):
            bars = ax.get_xlabel() in ("deployment delta-v [m/s]", "share [%]")  # which may be zero
            width, height = share_filled(ax)
            assert bars or min(width, height) > FILLED, (stem, k, width, height)


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_entry_of_a_legend_is_in_the_picture(pages, name):
    for stem, figure in pages(name).items():
        for legend in figure.legends:
            for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
                assert is_seen(handle, figure), (stem, text.get_text())


@pytest.mark.parametrize("name", PARAMETERS)
def test_the_body_can_be_made_out(pages, name):
    for stem in ("operation", "trajectories", "behaviors", "target"):
        assert body_pixels(pages(name)[stem]) > BODY_PX, stem


@pytest.mark.parametrize("name", PARAMETERS)
def test_numbers_of_spacecraft_do_not_cover_each_other(pages, name):
    for ax in pages(name)["operation"].axes[:2]:
        numbers = [text for text in ax.texts if isinstance(text, Annotation) and text.get_fontweight() == "bold"]
        for one, other in combinations([text.get_window_extent() for text in numbers], 2):
            overlap = np.minimum(one.max, other.max) - np.maximum(one.min, other.min)
            assert overlap.min() < 2.0


def test_the_encounter_of_a_long_flight_takes_half_of_every_history(flights, pages):
    plan, telemetry, _ = flights("flyby of six hours")
    radius, times = plan.scenario.behavior.imaging_radius_m, telemetry["time"].values
    inside = times[(np.linalg.norm(telemetry["r_BN_N"].values, axis=2) <= radius).any(axis=1)]
    assert np.ptp(inside) < 0.02 * times[-1]
    for stem in ("tracking_error", "pointing_error", "coverage", "wheel_speed", "links"):
        ax = pages("flyby of six hours")[stem].axes[0]
        left, right = ax.transAxes.inverted().transform(
            ax.transData.transform([(t / 3600.0, ax.get_ylim()[1]) for t in (inside[0], inside[-1])])
        )[:, 0]
        assert right - left > 0.2, stem
        words = [label.get_text() for label in ax.get_xticklabels()]
        assert "arrival" in words and "0" in words


def test_places_on_a_stretched_axis_lead_back_to_their_times():
    scale = TimeScale(axis=TimeAxis(3600.0, "h"), duration_s=1e5, arrival_s=9e4, encounter_s=(8.9e4, 9.1e4))
    times = np.linspace(0.0, 1e5, 1001)
    places = scale.on_page(times)
    assert (np.diff(places) > 0.0).all()
    assert places[[0, -1]] == pytest.approx([0.0, 1.0])
    assert scale.from_page(places) == pytest.approx(times)
    assert scale.share(8.9e4, 9.1e4) == pytest.approx(STRETCHED, abs=0.05)
    drawn = times[scale.samples(times, 100)]
    assert set(times[(times > 8.9e4) & (times <= 9.1e4)]) <= set(drawn)
    assert len(drawn) < 100


@pytest.mark.parametrize("width_in", [1.6, 2.05, 2.5, 2.7, 2.8, 4.1, 5.4, 5.6, 9.0])
@pytest.mark.parametrize("brief", [False, True])
def test_marks_of_a_stretched_axis_have_room_at_any_width(width_in, brief):
    """A flight of two days with an encounter of an hour and a half in it, whose marks are long words.

    Those at 40 min have room from 2.75 in on, and those at half that time from twice that width.
    """
    scale = TimeScale(
        axis=TimeAxis(3600.0, "h"), duration_s=176_400.0, arrival_s=172_800.0, encounter_s=(170_180.0, 175_420.0)
    )
    figure = Figure(figsize=(width_in + 2.0, 2.0))
    ax = figure.add_axes((1.0 / (width_in + 2.0), 0.4, width_in / (width_in + 2.0), 0.5))
    scale.show(ax, brief=brief)
    ax.tick_params(labelsize=TICK_PT)
    figure.draw_without_rendering()
    boxes = sorted((tick.get_window_extent() for tick in ax.get_xticklabels()), key=lambda box: box.x0)
    assert all(one.x1 + 2.0 < other.x0 for one, other in zip(boxes, boxes[1:], strict=False))
    words = {tick.get_text() for tick in ax.get_xticklabels()}
    assert "arrival" in words and "0" in words
    assert ({"\N{MINUS SIGN}40 min", "+40 min"} <= words) == (width_in > 2.75 and not brief)
    assert ("+20 min" in words) == (width_in > 5.5 and not brief)


def test_the_words_over_paths_in_frame_n_end_with_their_diagram(flights):
    figure = COMPOSERS["behaviors"](*flights("flyby of six hours"), frame="N")
    figure.draw_without_rendering()
    assert_labels_do_not_overlap(figure)
    across = figure.axes[0]
    (words,) = [text for text in across.get_children() if isinstance(text, Text) and "frame N" in text.get_text()]
    assert words.get_window_extent().x1 <= across.get_window_extent().x1


def test_an_ordinary_flight_keeps_an_even_axis(flights):
    plan, telemetry, _ = flights("eros-quick")
    scale = time_scale(plan, telemetry)
    assert scale.encounter_s is None
    assert scale.on_page(np.array([300.0])) == pytest.approx(300.0 / plan.scenario.duration_s)
    assert SHORT < 0.5


def test_pictures_in_space_show_the_swarm_as_long_as_it_is_near(flights):
    plan, telemetry, _ = flights("flyby of six hours")
    distance = np.linalg.norm(telemetry["r_BN_N"].values.mean(axis=1), axis=1)
    arrival = np.argmin(np.abs(telemetry["time"].values - plan.scenario.design.time_of_flight_s))
    limit = max(FAR * distance[arrival], FAR_RADII * plan.region.mesh.max_radius)
    assert np.array_equal(near_arrival(plan, telemetry)["time"], telemetry["time"][distance <= limit])
    plan, telemetry, _ = flights("eros-quick")
    assert near_arrival(plan, telemetry).sizes["time"] == telemetry.sizes["time"]


def test_the_frame_at_rest_keeps_a_fast_flight_straight_and_the_target_where_it_is_visited(flights):
    plan, telemetry, _ = flights("flyby of six hours")
    every = telemetry.isel(time=slice(None, None, 60))
    arrival = telemetry.sel(time=[plan.scenario.design.time_of_flight_s])
    straight, curled = (scene_from(plan, every, at_rest=at_rest).r_A[:, 0] for at_rest in (True, False))
    for path, bent in ((straight, False), (curled, True)):
        along = (path[-1] - path[0]) / np.linalg.norm(path[-1] - path[0])
        aside = np.linalg.norm(np.cross(path - path[0], along), axis=1).max() / np.linalg.norm(path[-1] - path[0])
        assert (aside > 0.1) == bent
        assert bent or aside < 1e-3  # the body's own gravity bends it no farther
    assert scene_from(plan, arrival, at_rest=True).r_A[0] == pytest.approx(plan.points_A, abs=100.0)


@pytest.mark.parametrize("stem", ["behaviors", "trajectories"])
def test_a_frame_can_be_asked_for(flights, stem):
    words = {
        frame: COMPOSERS[stem](*flights("eros-quick"), frame=frame).axes[0].get_title(loc="left") for frame in "AN"
    }
    assert words["A"].startswith("frame A") and words["N"].startswith("frame N")
    with pytest.raises(ValueError, match="must be 'A'"):
        COMPOSERS[stem](*flights("eros-quick"), frame="B")


def test_lines_of_single_spacecraft_differ_by_more_than_colour(pages):
    assert len(set(DASHES)) == len(DASHES) == len(SPACECRAFT)
    for stem in ("ground_track", "illumination", "coverage"):
        (legend,) = pages("flyby of six hours")[stem].legends
        texts = [text.get_text() for text in legend.get_texts()]
        handles = {text: handle for text, handle in zip(texts, legend.legend_handles, strict=True)}
        assert len({str(handles[f"sc{j}"]._unscaled_dash_pattern) for j in range(1, 4)}) == 3, stem
