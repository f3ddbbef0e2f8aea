"""Parallel projection with correct hiding, light, and the box with scales."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from swarm_mj.figures.box import box_around, draw_box
from swarm_mj.figures.palette import SKY_BLUE
from swarm_mj.figures.view import View, draw_body, draw_line, face_colours, first_hits, shade, unit


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
