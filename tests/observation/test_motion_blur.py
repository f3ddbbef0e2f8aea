"""Motion blur against the difference of two projections, against the closed form of a flyby, and as a limit of pictures."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.observation.camera import CameraModel, CameraMotion, Motion, look_at, motion_blur_px
from swarm_mj.observation.capture import observe, pictures
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.observation.horizon_kernels import make_scene
from swarm_mj.observation.observer import make_observer
from swarm_mj.scenarios.loading import scenario_from

from .scenes import eros_target, plain

EXPOSURE = 0.02
CAMERA = CameraModel(half_angle_deg=12.0, resolution_px=1000, exposure_s=EXPOSURE)


def turned(axis_rate, t):
    return Rotation.from_rotvec(np.asarray(axis_rate) * t)


@pytest.mark.parametrize("seed", range(5))
def test_motion_blur_is_the_difference_of_the_projections_at_both_ends_of_the_exposure(seed):
    """The body spins, the spacecraft flies by and turns with a rate of its own; all motions are integrated here, in N."""
    rng, region = np.random.default_rng(seed), eros_target()
    spin_N, v_N = rng.normal(size=3) * 3e-3, rng.normal(size=3) * 700.0
    omega_B = rng.normal(size=3) * 0.03
    A_at_0 = Rotation.random(random_state=seed)  # components in A to components in N
    pose = look_at(region.centroid_A.mean(axis=0) * 2.5 + rng.normal(size=3) * 3e3, region.centroid_A.mean(axis=0))
    r_N, N_from_B = A_at_0.apply(pose.r_A), A_at_0 * Rotation.from_matrix(pose.C_CA).inv()

    def pixels(t):
        points_N = (turned(spin_N, t) * A_at_0).apply(region.centroid_A)
        in_camera = (N_from_B * turned(omega_B, t)).inv().apply(points_N - (r_N + v_N * t))
        return in_camera[:, :2] / in_camera[:, 2:] * (500.0 / np.tan(np.radians(12.0)))

    expected = np.linalg.norm(pixels(EXPOSURE / 2) - pixels(-EXPOSURE / 2), axis=1)
    moving = Motion(v_N[None], omega_B[None], spin_N)
    C_BN, C_AN = N_from_B.inv().as_matrix(), A_at_0.inv().as_matrix()
    (picture,) = pictures(0.0, np.array([True]), r_N[None], C_BN[None], C_AN, np.ones(3), moving)
    found = motion_blur_px(region, CAMERA, picture.r_A, picture.C_CA, picture.motion)
    assert expected.min() > 0.5
    assert np.allclose(found, expected, rtol=2e-5)


def test_a_camera_that_turns_with_a_point_blurs_it_not_and_one_that_does_not_by_v_over_r():
    region = eros_target()
    i, away = 0, 50e3
    centroid = region.centroid_A[i]
    pose = look_at(centroid + away * region.normal_A[i], centroid)
    right, ahead = pose.C_CA[0], pose.C_CA[2]
    v_A = 7000.0 * right
    still = motion_blur_px(region, CAMERA, pose.r_A, pose.C_CA, CameraMotion(v_A, np.zeros(3)))
    assert still[i] == pytest.approx(EXPOSURE * 7000.0 / away / CAMERA.pixel_angle, rel=1e-9)
    omega_A = np.cross(ahead, -v_A) / away  # of the line of sight to the point
    tracking = motion_blur_px(region, CAMERA, pose.r_A, pose.C_CA, CameraMotion(v_A, pose.C_CA @ omega_A))
    assert tracking[i] < 1e-9 * still[i]
    # A rate error about the line of sight blurs by its lever arm, and the middle not at all.
    rolling = motion_blur_px(region, CAMERA, pose.r_A, pose.C_CA, CameraMotion(np.zeros(3), np.array([0.0, 0.0, 0.1])))
    p = pose.to_camera(region.centroid_A)
    arm_px = np.hypot(p[:, 0], p[:, 1]) / p[:, 2] / CAMERA.pixel_angle
    assert np.allclose(rolling, EXPOSURE * 0.1 * arm_px, rtol=1e-9, atol=1e-9) and arm_px.max() > 50
    # What is behind the camera is in no picture.
    back = look_at(pose.r_A, 2 * pose.r_A - centroid)
    assert np.isinf(motion_blur_px(region, CAMERA, back.r_A, back.C_CA, CameraMotion(v_A, np.zeros(3)))[i])


def test_cells_that_blur_more_than_the_limit_do_not_count():
    region = eros_target()
    pose = look_at(region.centroid_A.mean(axis=0) * 2.5, region.centroid_A.mean(axis=0))
    motion = CameraMotion(np.array([30.0, -200.0, 500.0]), np.array([0.002, 0.02, 0.05]))
    motion_blur = motion_blur_px(region, CAMERA, pose.r_A, pose.C_CA, motion)
    observer = make_observer(region, CAMERA, kind="raycast")
    whole = observe(observer, pose.r_A, pose.C_CA, plain())
    limit = float(np.median(motion_blur[whole]))
    some = observe(observer, pose.r_A, pose.C_CA, plain(max_motion_blur_px=limit), motion=motion)
    assert np.array_equal(some, whole & (motion_blur <= limit)) and 0 < some.sum() < whole.sum()
    with pytest.raises(MissionError, match="limits motion blur: pass how the camera moves"):
        observe(observer, pose.r_A, pose.C_CA, plain(max_motion_blur_px=limit))


def test_what_cannot_limit_motion_blur_says_so():
    observer = make_observer(eros_target(), CAMERA, kind="horizon")
    assert isinstance(observer, HorizonObserver)
    with pytest.raises(MissionError, match="max_motion_blur_px 2"):
        make_scene(observer, plain(max_motion_blur_px=2.0))
    with pytest.raises(ScenarioError, match=r"observation.max_motion_blur_px = 2.*camera.exposure_s"):
        scenario_from({"name": "s", "observation": {"max_motion_blur_px": 2}})
    with pytest.raises(MissionError, match="exposure nan"):
        CameraModel(exposure_s=float("nan"))
