"""Figures of a run: written whole, not blank, labelled with units, nothing cut off, and true to the data."""

import importlib.util
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import PolyCollection
from matplotlib.colors import rgb_to_hsv, to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.text import Annotation, Text

from swarm_mj.flight import add_coverage, observe_flight, simulate
from swarm_mj.observation.coverage import CoverageMap
from swarm_mj.output.figures import COMPOSERS, FIGURES
from swarm_mj.output.figures.box import box_around, draw_box
from swarm_mj.output.figures.cells import angles
from swarm_mj.output.figures.coverage import percent_over_time
from swarm_mj.output.figures.modes import intervals, runs
from swarm_mj.output.figures.scene import axis_tips, best_view, scene_from
from swarm_mj.output.figures.style import DPI, ORANGE, SKY_BLUE, instant, new_figure, save, shown_spacecraft, time_axis
from swarm_mj.output.figures.target import geographic
from swarm_mj.output.figures.view import View, draw_body, draw_line, face_colours, first_hits, shade, unit
from swarm_mj.scenarios.loading import packaged_names
from swarm_mj.smallbody.shape import ShapeModel

NAMES = sorted(COMPOSERS)
#: Units that must be read somewhere in each figure.
UNITS = {
    "target": {"km", "deg"},
    "tracking_error": {"min", "-"},
    "pointing_error": {"min", "deg"},
    "operation": {"km", "deg"},
    "coverage": {"min", "%"},
    "wheel_speed": {"min", "rpm"},
    "links": {"min"},
}


@pytest.fixture(scope="module")
def flown(quick_plan):
    telemetry = simulate(quick_plan)
    result = observe_flight(quick_plan, telemetry)
    add_coverage(telemetry, result)
    return quick_plan, telemetry, result


@pytest.fixture(scope="module")
def composed(flown):
    """Every figure, laid out and rendered once."""
    figures = {name: compose(*flown) for name, compose in COMPOSERS.items()}
    for figure in figures.values():
        figure.draw_without_rendering()
    return figures


@pytest.fixture(scope="module")
def written(flown, tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    for name, draw in FIGURES.items():
        draw(folder / f"{name}.png", *flown)
    return folder


@pytest.fixture(scope="module")
def cube():
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return ShapeModel(corners, np.array(faces), "cube")


def swarm_of(flown, n):
    """The quick flight with its first spacecraft copied n times."""
    plan, telemetry, result = flown
    points = (12,) * n
    scenario = plan.scenario.model_copy(
        update={"design": plan.scenario.design.model_copy(update={"visiting_points": points})}
    )
    deployment = replace(plan.deployment, v0_N=np.repeat(plan.deployment.v0_N[:1], n, axis=0))
    many = replace(plan, scenario=scenario, deployment=deployment, points_A=np.repeat(plan.points_A[:1], n, axis=0))
    copies = telemetry.isel(spacecraft=[0] * n).assign_coords(spacecraft=list(many.names))
    return many, copies, with_coverage(result, np.repeat(result.coverage.first_seen_by_s[:1], n, axis=0))


def with_coverage(result, first_seen_by_s):
    coverage = CoverageMap(result.coverage.area, len(first_seen_by_s))
    coverage.first_seen_by_s[:] = first_seen_by_s
    return replace(result, coverage=coverage, passage=coverage)


def assert_nothing_is_cut_off(figure: Figure):
    figure.draw_without_rendering()
    drawn = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    assert min(drawn.x0, drawn.y0) >= -0.01
    assert drawn.x1 <= width + 0.01
    assert drawn.y1 <= height + 0.01


def visible_texts(figure: Figure):
    """Labels, titles, ticks and legends that are drawn; marks placed among the data are left out."""
    texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text() and not isinstance(t, Annotation)]
    hidden = {t for ax in figure.axes if not ax.get_visible() for t in ax.findobj(Text)}
    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            drawn = set(axis._update_ticks()) if ax.axison else set()
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if tick not in drawn:
                    hidden |= set(tick.findobj(Text))
    return [text for text in texts if text not in hidden]


def test_every_figure_of_a_run_has_its_function():
    assert set(FIGURES) == set(UNITS)


@pytest.mark.parametrize("name", NAMES)
def test_picture_has_the_size_of_its_figure(written, composed, name):
    height, width = imread(written / f"{name}.png").shape[:2]
    assert (width, height) == pytest.approx(composed[name].get_size_inches() * DPI, abs=1)


@pytest.mark.parametrize("name", NAMES)
def test_picture_is_not_blank(written, name):
    pixels = imread(written / f"{name}.png")[..., :3]
    inked = (pixels < 0.97).any(axis=2)
    assert inked.mean() > 0.04
    assert pixels.std() > 0.05
    columns, rows = np.flatnonzero(inked.any(axis=0)), np.flatnonzero(inked.any(axis=1))
    assert np.ptp(columns) > 0.85 * inked.shape[1]
    assert np.ptp(rows) > 0.85 * inked.shape[0]


@pytest.mark.parametrize("name", NAMES)
def test_no_picture_touches_its_border(written, name):
    pixels = imread(written / f"{name}.png")[..., :3]
    border = np.concatenate((pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]))
    assert (border > 0.99).all()


def test_nothing_else_is_left_in_the_folder(written):
    assert {path.name for path in written.iterdir()} == {f"{name}.png" for name in NAMES}


@pytest.mark.parametrize("name", NAMES)
def test_every_named_axis_ends_in_its_unit(composed, name):
    named = [
        text
        for ax in composed[name].axes
        if ax.get_visible() and ax.axison
        for text in (ax.get_xlabel(), ax.get_ylabel())
        if text
    ]
    assert named
    assert all(re.search(r"\[[^\]]+\]$", text) for text in named)


@pytest.mark.parametrize("name", NAMES)
def test_units_are_read_in_the_figure(composed, name):
    texts = [text.get_text() for text in composed[name].findobj(Text) if text.get_visible()]
    found = {match for text in texts for match in re.findall(r"\[([^\]]+)\]$", text)}
    assert found == UNITS[name]


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_cut_off(composed, name):
    assert_nothing_is_cut_off(composed[name])


@pytest.mark.parametrize("name", NAMES)
def test_labels_do_not_overlap(composed, name):
    texts = visible_texts(composed[name])
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts]
    clashes = [
        (a, b)
        for (a, first), (b, second) in combinations(boxes, 2)
        if min(first.x1, second.x1) - max(first.x0, second.x0) > 1.0
        and min(first.y1, second.y1) - max(first.y0, second.y0) > 1.0
    ]
    assert len(boxes) > 5
    assert clashes == []


@pytest.mark.parametrize("n", [1, 3, 5, 12, 20])
@pytest.mark.parametrize("name", ["tracking_error", "links", "coverage"])
def test_swarms_of_any_size_fit_on_the_page(flown, name, n):
    assert_nothing_is_cut_off(COMPOSERS[name](*swarm_of(flown, n)))


@pytest.mark.parametrize(("n", "panels"), [(1, 1), (7, 7), (25, 20)])
def test_each_spacecraft_has_a_panel_up_to_twenty(flown, n, panels):
    figure = COMPOSERS["wheel_speed"](*swarm_of(flown, n))
    shown = [ax for ax in figure.axes if ax.get_visible()]
    assert len(shown) == panels
    assert shown[-1].get_title(loc="left").startswith(f"sc{n}:")
    assert ("of 25 spacecraft" in figure.get_suptitle()) == (n > panels)


def test_twelve_spacecraft_are_drawn_around_the_body(flown):
    figure = COMPOSERS["operation"](*swarm_of(flown, 12))
    assert_nothing_is_cut_off(figure)
    assert {str(j) for j in range(1, 13)} <= {text.get_text() for text in figure.axes[0].texts}


def test_tracking_errors_are_those_of_the_telemetry(flown, composed):
    plan, telemetry, _ = flown
    for j, ax in enumerate(composed["tracking_error"].axes[: plan.n]):
        for k in range(3):
            assert np.array_equal(ax.lines[k].get_ydata(), telemetry["sigma_BR"].values[:, j, k])
            assert ax.lines[k].get_xdata() == pytest.approx(telemetry["time"].values / 60.0)


def test_curves_stay_below_the_band_that_names_the_modes(composed):
    for name in ("tracking_error", "wheel_speed", "pointing_error"):
        for ax in (ax for ax in composed[name].axes if ax.get_visible()):
            band = min(ax.transAxes.inverted().transform(text.get_window_extent())[0, 1] for text in ax.texts)
            for line in ax.lines:
                if len(line.get_xdata()) > 2:
                    top = ax.transData.transform(np.column_stack((line.get_xdata(), line.get_ydata())))[:, 1].max()
                    assert ax.transAxes.inverted().transform((0.0, top))[1] < band


def test_panels_mark_the_visit_and_every_switch(flown, composed):
    plan, telemetry, _ = flown
    mode = telemetry["mode"].values
    times = telemetry["time"].values / 60.0
    for j, ax in enumerate(composed["tracking_error"].axes[: plan.n]):
        marks = sorted(float(line.get_xdata()[0]) for line in ax.lines if len(line.get_xdata()) == 2)
        switches = [float(times[k]) for k in range(1, len(times)) if mode[k, j] != mode[k - 1, j]]
        assert switches
        assert marks == pytest.approx(sorted([10.0, *switches]))


def test_modes_are_named_as_in_the_paper(composed):
    names = [{text.get_text() for text in ax.texts} for ax in composed["tracking_error"].axes]
    assert names == [{"TO", "ET"}, {"TO", "CT"}]


def test_wheel_limits_are_drawn(composed, flown):
    limit = flown[0].scenario.spacecraft.wheel.max_speed_rpm
    for ax in composed["wheel_speed"].axes:
        level = [line.get_ydata()[0] for line in ax.lines if len(set(line.get_ydata())) == 1]
        assert min(level) == pytest.approx(-limit)
        assert max(level) == pytest.approx(limit)


def test_share_of_each_spacecraft_ends_at_its_total(flown):
    _, telemetry, result = flown
    for j, total in enumerate(result.coverage.percent_by_spacecraft):
        assert percent_over_time(result.coverage, j, telemetry["time"].values)[-1] == pytest.approx(total, abs=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_operation_colours_exactly_the_observed_cells(flown, share):
    plan, telemetry, result = flown
    n = plan.region.n_cells
    seen = np.arange(n) < round(share * n)
    first = np.where(seen, 30.0, np.nan)
    figure = COMPOSERS["operation"](plan, telemetry, with_coverage(result, np.array([first, np.full(n, np.nan)])))
    for ax in figure.axes[2:]:
        (cells,) = [c for c in ax.collections if isinstance(c, PolyCollection)]
        hue = rgb_to_hsv(cells.get_facecolor()[:, :3])[:, 0]
        assert hue[seen] == pytest.approx(rgb_to_hsv(to_rgb(SKY_BLUE))[0], abs=1e-6)
        assert hue[~seen] == pytest.approx(rgb_to_hsv(to_rgb(ORANGE))[0], abs=1e-6)
    percent = 100.0 * plan.region.area[seen].sum() / plan.region.area.sum()
    assert f"{percent:.2f} %" in figure.axes[0].get_title(loc="left")


def test_nothing_observed_is_still_a_figure(flown):
    plan, telemetry, result = flown
    nothing = with_coverage(result, np.full((plan.n, plan.region.n_cells), np.nan))
    figure = COMPOSERS["coverage"](plan, telemetry, nothing)
    assert "0.00 %" in figure.axes[0].get_title(loc="left")
    assert_nothing_is_cut_off(figure)


def test_flight_without_a_switch_marks_none(flown):
    plan, telemetry, result = flown
    calm = telemetry.assign(
        mode=xr.zeros_like(telemetry["mode"]), tracked_spacecraft=telemetry["tracked_spacecraft"] * 0
    )
    figure = COMPOSERS["tracking_error"](plan, calm, result)
    legend = {text.get_text() for text in figure.legends[0].get_texts()}
    assert "switch" not in legend
    assert "visit" in legend
    assert_nothing_is_cut_off(figure)


def test_target_figure_numbers_every_visiting_point(flown, composed):
    plan = flown[0]
    numbers = {text.get_text() for text in composed["target"].axes[1].texts}
    assert numbers == {str(k) for k in range(1, plan.region.n_visiting + 1)}
    assert "0\N{DEGREE SIGN} N, 90\N{DEGREE SIGN} E" in composed["target"].axes[0].get_title(loc="left")


def test_body_names_may_hold_dollars_and_scenario_names_may_be_long(flown, tmp_path):
    plan, telemetry, result = flown
    body = plan.scenario.body.model_copy(update={"name": r"$\nonsense$ & Co"})
    odd = replace(plan, scenario=plan.scenario.model_copy(update={"body": body, "name": "long-name-" * 12}))
    for name in ("target", "tracking_error"):
        figure = COMPOSERS[name](odd, telemetry, result)
        assert_nothing_is_cut_off(figure)
        save(figure, tmp_path / f"{name}.png")


def test_same_flight_gives_the_same_bytes_even_in_threads(flown, written, tmp_path):
    names = ["tracking_error", "coverage", "links"]

    def draw(name):
        FIGURES[name](tmp_path / f"{name}.png", *flown)
        return (tmp_path / f"{name}.png").read_bytes()

    with ThreadPoolExecutor(3) as pool:
        drawn = list(pool.map(draw, names))
    assert drawn == [(written / f"{name}.png").read_bytes() for name in names]


def test_failed_picture_leaves_the_earlier_one(tmp_path):
    path = tmp_path / "picture.png"
    path.write_bytes(b"earlier")
    figure = new_figure(2.0, "title")
    figure.text(0.5, 0.5, "$\\nonsense$")
    with pytest.raises(ValueError, match="nonsense"):
        save(figure, path)
    assert path.read_bytes() == b"earlier"
    assert list(tmp_path.iterdir()) == [path]


def test_runs_and_intervals_cover_the_flight_once():
    mode = np.array([[0], [0], [2], [2], [1], [1]], np.int8)
    tracked = np.array([[0], [0], [0], [0], [3], [4]], np.int16)
    telemetry = xr.Dataset(
        {"mode": (("time", "spacecraft"), mode), "tracked_spacecraft": (("time", "spacecraft"), tracked)},
        {"time": [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]},
    )
    assert runs(telemetry, 0) == [(0.0, 20.0, 0), (20.0, 40.0, 2), (40.0, 50.0, 1), (50.0, 50.0, 1)]
    flag = np.array([True, False, True, True, False, True])
    assert intervals(flag, telemetry["time"].values) == [(0.0, 10.0), (20.0, 20.0), (50.0, 0.0)]
    assert intervals(np.zeros(6, bool), telemetry["time"].values) == []


def test_view_is_a_rotation_with_z_upwards():
    for toward in ([1, 2, 3], [0, 0, 1], [0, 0, -1], [-1, 0.1, 0]):
        view = View.from_direction(np.array(toward, float))
        assert view.axes @ view.axes.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(view.axes) == pytest.approx(1.0)
        assert view.toward == pytest.approx(unit(np.array(toward, float)))
    level = View.from_direction(np.array([1.0, 0.0, 0.0]))
    assert level.project(np.array([5.0, 2000.0, 3000.0])) == pytest.approx([2.0, 3.0])


def test_body_hides_what_is_behind_it_and_not_what_is_in_front(cube):
    view = View.from_direction(np.array([1.0, 0.0, 0.0]))
    points = np.array([[-3.0, 0.2, 0.1], [3.0, 0.2, 0.1], [-3.0, 1.5, 0.0], [1.0, 0.3, 0.2], [-1.0, 0.3, 0.2]])
    assert view.hidden(points, cube).tolist() == [True, False, False, False, True]
    assert view.before(points, cube).tolist() == [False, True, False, True, False]


def test_body_shows_the_faces_turned_to_the_viewer_from_far_to_near(cube):
    view = View.from_direction(np.array([5.0, 2.0, 1.0]))
    ax = Figure().subplots()
    draw_body(ax, view, cube, face_colours(cube, [(np.arange(12), SKY_BLUE)]))
    (painted,) = ax.collections
    corners = np.array([path.vertices[:3] for path in painted.get_paths()])
    sides = [face for face in cube.faces if cube.vertices[face].min(axis=0).max() == 1.0]  # those at x, y or z = 1
    centres = view.project(np.array([cube.vertices[face].mean(axis=0) for face in sides]))
    assert len(corners) == len(sides) == 6
    assert np.sort(corners.mean(axis=1), axis=0) == pytest.approx(np.sort(centres, axis=0))
    towards_x = corners[-2:].mean(axis=(0, 1))  # the nearest side is x = 1
    assert towards_x == pytest.approx(view.project(np.array([1.0, 0.0, 0.0])))


def test_line_behind_the_body_is_faded_only_there(cube):
    view = View.from_direction(np.array([1.0, 0.0, 0.0]))
    ax = Figure().subplots()
    draw_line(ax, view, cube, np.column_stack((np.full(401, -2.0), np.linspace(-2.0, 2.0, 401), np.full(401, 0.2))))
    pale = [line for line in ax.lines if line.get_alpha() < 0.5]
    assert len(ax.lines) == 3
    assert len(pale) == 1
    # From -1 to 1 m, in kilometres, to the width of a segment.
    assert pale[0].get_xdata()[[0, -1]] == pytest.approx([-1e-3, 1e-3], abs=2e-5)


def test_rays_end_where_they_meet_the_body(cube):
    start = np.array([[5.0, 0.2, 0.3], [5.0, 3.0, 0.0], [0.0, 0.1, -4.0]])
    direction = np.array([[-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert first_hits(start, direction, np.array([10.0, 10.0, 2.0]), cube) == pytest.approx([4.0, 10.0, 2.0], abs=1e-5)


def test_axes_of_observers_end_on_the_ground(flown):
    plan, telemetry, _ = flown
    scene = scene_from(plan, telemetry)
    visit = 120  # 600 s at 5 s
    assert scene.times[visit] == 600.0
    tips = axis_tips(telemetry, scene, plan.region.mesh, visit, 1e4)
    nearest = np.linalg.norm(plan.region.mesh.face_centroids[:, None] - tips, axis=2).min(axis=0)
    assert (nearest < 500.0).all()
    assert scene.r_A[visit] == pytest.approx(plan.points_A, abs=1.0)


def test_target_faces_the_viewer(flown):
    plan, telemetry, _ = flown
    scene = scene_from(plan, telemetry)
    view = best_view(plan.region, scene, (120, 240))
    assert not view.hidden(plan.region.centroid_A, plan.region.mesh).mean() > 0.3
    assert (plan.region.normal_A @ view.toward > 0.0).mean() > 0.7


def test_light_follows_lamberts_law():
    normals = np.array([[0.0, 0.0, 1.0], [0.0, np.sin(1.0), np.cos(1.0)], [0.0, 0.0, -1.0]])
    white = np.ones((3, 3))
    lit = shade(white, normals, np.array([0.0, 0.0, 2.0]), ambient=0.25)
    assert lit[:, 0] == pytest.approx([1.0, 0.25 + 0.75 * np.cos(1.0), 0.25])


@pytest.mark.parametrize("size", [3.0, 250.0, 4.1e4])
def test_box_of_any_size_has_three_scales_in_km(size):
    ax = Figure().subplots()
    points = size * np.array([[-1.0, -0.4, -0.3], [1.0, 0.5, 0.6]])
    draw_box(ax, View.from_direction(np.array([1.0, 0.8, 0.5])), box_around(points))
    texts = [text.get_text() for text in ax.texts]
    assert [text for text in texts if "[km]" in text] == ["$x_A$ [km]", "$y_A$ [km]", "$z_A$ [km]"]
    values = [float(text.replace("\N{MINUS SIGN}", "-")) for text in texts if "km" not in text]
    assert len(values) >= 6
    assert max(np.abs(values)) <= 1.2 * size / 1e3


def test_angles_make_the_pyramid_a_square(quick_plan):
    region = quick_plan.region
    flat = angles(region.corners_A, region.axes_A)
    side = np.degrees(region.side_half_angle)
    assert flat.max(axis=(0, 1)) == pytest.approx([side, side], abs=1e-6)
    assert flat.min(axis=(0, 1)) == pytest.approx([-side, -side], abs=1e-6)


def test_words_for_times_and_places():
    assert instant(600.0, time_axis(1200.0)) == "10 min"
    assert instant(90.0, time_axis(120.0)) == "90 s"
    assert instant(7200.0, time_axis(86_400.0)) == "2 h"
    assert geographic(-12.5, -90.0) == "12.5\N{DEGREE SIGN} S, 270\N{DEGREE SIGN} E"
    assert shown_spacecraft(25).tolist() == [*range(19), 24]


def test_pictures_of_the_documents_are_figures_of_packaged_scenarios():
    path = Path(__file__).parents[2] / "docs" / "images.py"
    spec = importlib.util.spec_from_file_location("docs_images", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert {figure for _, figure in module.PICTURES} <= set(FIGURES)
    assert {scenario for scenario, _ in module.PICTURES} <= set(packaged_names())
