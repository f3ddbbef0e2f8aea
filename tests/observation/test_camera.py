import numpy as np
import pytest

from swarm_mj.errors import MissionError
from swarm_mj.observation.camera import CameraModel, camera_pose, look_at
from swarm_mj.observation.projection import WHOLE_PICTURE, project


def test_the_line_of_sight_is_z_and_the_picture_has_x_right_and_y_down():
    pose = look_at([0.0, 10.0, 0.0], [0.0, 0.0, 0.0])
    # From +y towards the origin with z up, the observer's right is -x.
    points = np.array([[0.0, 4.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert pose.to_camera(points) == pytest.approx(np.array([[0.0, 0, 6], [1, 0, 10], [0, -1, 10]]), abs=1e-12)
    assert np.linalg.det(pose.C_CA) == pytest.approx(1.0)


def test_a_positive_roll_turns_the_camera_clockwise():
    level = look_at([0.0, 10.0, 0.0], [0.0, 0.0, 0.0])
    rolled = look_at([0.0, 10.0, 0.0], [0.0, 0.0, 0.0], roll=np.pi / 2)
    assert rolled.C_CA[0] == pytest.approx(level.C_CA[1], abs=1e-15)
    assert rolled.C_CA[2] == pytest.approx(level.C_CA[2])


def test_looking_along_the_spin_axis_is_possible():
    pose = look_at([0.0, 0.0, -30e3], [0.0, 0.0, 0.0])
    assert pose.C_CA @ pose.C_CA.T == pytest.approx(np.eye(3), abs=1e-15)
    assert pose.C_CA[2] == pytest.approx([0, 0, 1])


def test_the_field_of_view_is_a_square_pyramid_or_the_cone_in_it():
    t = np.tan(np.radians(30.0))
    points = np.array([[0, 0, 1], [0.99 * t, 0.99 * t, 1], [0.99 * t, 0, 1], [1.01 * t, 0, 1], [0, 0, -1], [0, 0, 0]])
    square, cone = (CameraModel(half_angle_deg=30.0, shape=s).contains(points) for s in ("square", "cone"))
    assert square.tolist() == [True, True, True, False, False, False]
    assert cone.tolist() == [True, False, True, False, False, False]


def test_pixel_area_and_inscribed_circle_of_a_projected_triangle():
    camera = CameraModel(half_angle_deg=45.0, resolution_px=100)
    cells = project(np.array([[[0.0, 0, 2], [0.6, 0, 2], [0, 0.8, 2]]]), camera)
    area, inradius = cells.pixels(WHOLE_PICTURE, 100)
    assert area[0] == pytest.approx(15 * 20 / 2)
    assert inradius[0] == pytest.approx((15 + 20 - 25) / 2)


def test_cells_astride_the_camera_plane_are_kept_for_the_rays():
    corners = np.array([[[0.0, 0, 2], [0, 1, 2], [0, 0, -1]], [[0.0, 0, -2], [0, 1, -2], [0, 0, -1]]])
    cells = project(corners, CameraModel())
    assert cells.ahead.tolist() == [False, False]
    assert cells.in_picture.tolist() == [True, False]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (dict(half_angle_deg=90.0), "half-angle 90"),
        (dict(half_angle_deg=0.0), "half-angle 0"),
        (dict(shape="circle"), "'square' or 'cone'"),
        (dict(resolution_px=0), "resolution 0"),
        (dict(resolution_px=100_000), "resolution 100000"),
    ],
)
def test_an_impossible_camera_is_refused(values, message):
    with pytest.raises(MissionError, match=message):
        CameraModel(**values)


@pytest.mark.parametrize("position", [[0.0, 1.0], [0.0, float("nan"), 1.0]])
def test_a_position_that_is_none_is_refused(position):
    with pytest.raises(MissionError, match="camera position"):
        camera_pose(position, np.eye(3))


def test_components_in_the_camera_frame_are_those_along_its_axes():
    pose = look_at([1e4, -3e3, 2e3], [100.0, 200.0, -300.0], roll=0.7)
    for axis in range(3):
        along = pose.r_A + 50.0 * pose.C_CA[axis]
        assert pose.to_camera(along) == pytest.approx(50.0 * np.eye(3)[axis], abs=1e-9)
    ahead = np.array([100.0, 200.0, -300.0]) - pose.r_A
    assert pose.to_camera(np.array([100.0, 200.0, -300.0])) == pytest.approx([0, 0, np.linalg.norm(ahead)], abs=1e-8)


def test_a_row_of_pixels_spans_the_field_of_view():
    camera = CameraModel(half_angle_deg=10.0, resolution_px=200)
    assert 200 * camera.pixel_angle == pytest.approx(2 * np.tan(np.radians(10.0)))
    assert CameraModel(detector_ifov=1e-5).pixel_angle == 1e-5
