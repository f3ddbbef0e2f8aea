"""Pictures of a flight: what moves in an exposure smears, by whatever in the picture moves the most."""

import numpy as np
import pytest

from swarm_mj.flight.pictures import PictureMaker
from swarm_mj.flight.plan import make_plan
from swarm_mj.observation.camera import CameraMotion, look_at
from swarm_mj.observation.capture import Picture
from swarm_mj.scenarios.constants import AU
from swarm_mj.scenarios.loading import load_scenario


@pytest.fixture(scope="module")
def maker():
    return PictureMaker(make_plan(load_scenario("eros-quick", {"camera.half_angle_deg": 25.0})))


def tracking(r_A, v_A):
    """A camera that turns along with the body's centre."""
    pose = look_at(r_A, np.zeros(3))
    omega_A = np.cross(r_A, v_A) / (r_A @ r_A)
    return Picture(0.0, 0, pose.r_A, pose.C_CA, AU * np.array([0.3, 1.0, 0.2]), CameraMotion(v_A, pose.C_CA @ omega_A))


def test_ground_smears_under_a_camera_that_tracks_the_centre(maker):
    picture = tracking(np.array([0.0, 30e3, 5e3]), np.array([4000.0, 0.0, 0.0]))
    still, moving = maker.factor(picture), maker.factor(picture, 0.5)
    assert np.abs(moving - still).max() > 0.03 * still.max()
    assert moving.sum() == pytest.approx(still.sum(), rel=0.01)
    # In a thousandth of the time nothing moves by a pixel.
    assert np.array_equal(maker.factor(picture, 2e-4), still)


def test_pictures_from_far_away_smear_by_turns_alone(maker):
    far = tracking(np.array([0.0, 3e6, 0.0]), np.array([4000.0, 0.0, 0.0]))
    assert np.array_equal(maker.factor(far, 0.2), maker.factor(far))
    turning = far._replace(motion=far.motion._replace(omega_C=np.array([0.0, 0.2, 0.0])))
    assert not np.array_equal(maker.factor(turning, 0.2), maker.factor(far))
