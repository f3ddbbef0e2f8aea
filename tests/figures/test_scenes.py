"""Bodies, targets and swarms in space: what is drawn is what was seen, and stands where it flew."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import rgb_to_hsv, to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text

from swarm_mj.figures.behaviors import flight_plane, place_above
from swarm_mj.figures.operation import name_earth
from swarm_mj.figures.palette import ORANGE, SKY_BLUE
from swarm_mj.figures.run_figures import COMPOSERS
from swarm_mj.figures.scene import axis_tips, best_view, scene_from
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.target import angles
from swarm_mj.scenarios.itinerary import target_text
from swarm_mj.scenarios.schema import Target

from .sheets import assert_nothing_is_cut_off, swarm_of, with_coverage

ARRIVAL = 120  # sample of the quick flight: 600 s at 5 s


def test_twelve_spacecraft_are_drawn_around_the_body(flown):
    figure = COMPOSERS["operation"](*swarm_of(flown, 12))
    assert_nothing_is_cut_off(figure)
    assert {str(j) for j in range(1, 13)} <= {text.get_text() for text in figure.axes[0].texts}


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
    assert f"{np.floor(100.0 * percent) / 100.0:.2f} %" in figure.axes[0].get_title(loc="left")


def test_target_figure_numbers_every_visiting_point(flown, composed):
    plan = flown[0]
    numbers = {text.get_text() for text in composed["target"].axes[1].texts}
    assert numbers == {str(k) for k in range(1, plan.region.n_visiting + 1)}
    assert "0\N{DEGREE SIGN} N, 90\N{DEGREE SIGN} E" in composed["target"].axes[0].get_title(loc="left")


def test_axes_of_observers_end_on_the_ground(flown):
    plan, telemetry, _ = flown
    scene = scene_from(plan, telemetry)
    arrival = 120  # 600 s at 5 s
    assert scene.times[arrival] == 600.0
    tips = axis_tips(telemetry, scene, plan.region.mesh, arrival, 1e4)
    nearest = np.linalg.norm(plan.region.mesh.face_centroids[:, None] - tips, axis=2).min(axis=0)
    assert (nearest < 500.0).all()
    assert scene.r_A[arrival] == pytest.approx(plan.points_A, abs=1.0)


def test_target_faces_the_viewer(flown):
    plan, telemetry, _ = flown
    scene = scene_from(plan, telemetry)
    view = best_view(plan.region, scene, (120, 240))
    assert not view.hidden(plan.region.centroid_A, plan.region.mesh).mean() > 0.3
    assert (plan.region.normal_A @ view.toward > 0.0).mean() > 0.7


def test_angles_make_the_pyramid_a_square(quick_plan):
    region = quick_plan.region
    flat = angles(region.corners_A, region.axes_A)
    side = np.degrees(region.side_half_angle)
    assert flat.max(axis=(0, 1)) == pytest.approx([side, side], abs=1e-6)
    assert flat.min(axis=(0, 1)) == pytest.approx([-side, -side], abs=1e-6)


def test_places_in_words():
    words = {
        Target(latitude_deg=-12.5, longitude_deg=-90.0): "12.5° S, 270° E, half-angle 20°",
        Target(region="body"): "whole body",
        Target(region="lit", lit_at="arrival"): "lit part, at the arrival",
        Target(region="polygon", polygon_file="/some/where/crater.geojson"): "polygon of crater.geojson",
    }
    assert [target_text(target) for target in words] == list(words.values())


def test_flight_plane_holds_the_mean_path_and_the_body(flown):
    plan, telemetry, _ = flown
    scene = scene_from(plan, telemetry)
    view = flight_plane(plan.region, scene, ARRIVAL)
    assert view.axes @ view.axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(view.axes) == pytest.approx(1.0)
    path = scene.r_A.mean(axis=1)
    for place in (path[ARRIVAL], path[-1] - path[0]):
        assert place @ view.toward == pytest.approx(0.0, abs=1e-6 * np.linalg.norm(place))
    assert path[ARRIVAL] @ view.axes[1] > 0.0


def test_no_path_and_no_axis_crosses_the_words_for_an_instant(flown):
    plan, telemetry, result = flown
    telemetry = telemetry.copy(deep=True)
    at_earth = telemetry["mode"].values == 2
    telemetry["mode"].values[at_earth.any(axis=1)] = 2  # all turn to Earth when the first one does
    telemetry["tracked_spacecraft"].values[at_earth.any(axis=1)] = -1
    telemetry["sigma_BN"].values[-1] = telemetry["sigma_BN"].values[-1, np.flatnonzero(at_earth[-1])[0]]
    figure = COMPOSERS["behaviors"](plan, telemetry, result)
    figure.draw_without_rendering()
    ax = figure.axes[0]
    words = [text for text in ax.texts if text.get_text().endswith("min")]
    assert len(words) == 2
    lines = [ax.transData.transform(np.column_stack(line.get_data())) for line in ax.lines]
    for box in (text.get_window_extent() for text in words):
        for line in lines:
            steps = [
                start + np.linspace(0, 1, 50)[:, None] * (end - start)
                for start, end in zip(line, line[1:], strict=False)
            ]
            fine = np.vstack([line, *steps])
            assert not ((fine > (box.x0, box.y0)) & (fine < (box.x1, box.y1))).all(axis=1).any()


def test_distances_switch_colour_at_the_imaging_radius(flown, composed):
    plan, telemetry, _ = flown
    ax = composed["behaviors"].axes[1]
    dots = [line for line in ax.lines if line.get_marker() == "o"]
    assert len(dots) == plan.n
    radius = plan.scenario.behavior.imaging_radius_m / 1e3
    for dot in dots:  # the decision is taken every half second, the sample every five
        assert radius <= dot.get_ydata()[0] < radius + 0.3


def test_velocities_of_deployment_are_those_of_the_plan(flown, composed):
    plan = flown[0]
    bars = composed["trajectories"].axes[1].patches
    relative = plan.deployment.v0_N - plan.deployment.mothership_velocity_N
    assert [bar.get_width() for bar in bars] == pytest.approx(np.linalg.norm(relative, axis=1))


def test_trajectories_end_solid_at_the_visiting_points(flown, composed):
    plan, telemetry, _ = flown
    view = best_view(plan.region, scene_from(plan, telemetry), (ARRIVAL, 240))
    ax = composed["trajectories"].axes[0]
    marks = np.array([line.get_xydata()[0] for line in ax.lines if line.get_marker() == "o" and len(line.get_xdata())])
    assert marks == pytest.approx(view.project(plan.points_A), abs=1e-3)


def test_words_stay_in_the_diagram_where_a_line_of_sight_leaves_it():
    ax = Figure().subplots()
    ax.set_xlim(-10.0, 10.0)
    ax.set_ylim(0.0, 20.0)
    upwards = np.column_stack((np.full(50, 3.0), np.linspace(12.0, 40.0, 50)))
    x, y = place_above(ax, upwards[:1], upwards)
    assert y < 18.0
    assert 3.0 + 1.0 < x < 3.0 + 3.0  # half the text's width away, and no farther than it need be
    assert place_above(ax, upwards[:1], upwards[:3])[0] == 3.0


def test_markers_of_the_operation_say_what_each_spacecraft_does_at_the_instant_drawn(flown, composed):
    mode = scene_from(*flown[:2]).mode
    for ax, k in zip(composed["operation"].axes[:2], (ARRIVAL, -1), strict=True):
        markers = [line.get_marker() for line in ax.lines if line.get_marker() in "oD" and len(line.get_xdata())]
        assert markers == ["D" if kind == TargetKind.EARTH else "o" for kind in mode[k]]
    assert (mode[ARRIVAL] != TargetKind.EARTH).all() and (mode[-1] == TargetKind.EARTH).any()
    words = {text.get_text() for text in composed["operation"].legends[0].texts}
    assert {"observing spacecraft", "communications spacecraft"} <= words


def test_the_name_of_earth_covers_no_spacecraft():
    ax, places = (
        Figure(figsize=(4.0, 4.0)).subplots(),
        np.array([[x, y] for x in (0.3, 0.4, 0.5) for y in (0.4, 0.5, 0.6)]),
    )
    ax.plot(*places.T, "o", markersize=6.5)
    name_earth(ax, np.array([0.9, 0.5]), np.array([0.42, 0.5]), places)
    ax.figure.draw_without_rendering()
    (words,) = ax.texts
    box = Text.get_window_extent(words)
    assert not box.count_contains(ax.transData.transform(places))
