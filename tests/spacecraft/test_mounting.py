"""Cameras as they are mounted: misalignments in pixels, gimbals against closed forms, pictures by any boresight."""

import numpy as np
import pytest

from swarm_mj.scenarios.schema_imaging import Camera, Gimbal
from swarm_mj.spacecraft.mounting import camera_attitudes, gimbal_angles, nominal_mount, true_mount

AXIS, RANGE = (0.0, 1.0, 0.0), 200_000.0
IFOV = 57.0e-6


def passing(times, *, speed):
    """The body's centre from a spacecraft that flies along its own +z past it, and the angle from +z about +y."""
    along = -speed * times
    return np.column_stack((np.full(len(times), RANGE), np.zeros((len(times), 1)), along)), np.arctan2(RANGE, along)


def hinge(rate_deg_s, from_deg=-180, to_deg=180):
    return Gimbal(axis_B=AXIS, from_deg=from_deg, to_deg=to_deg, rate_deg_s=rate_deg_s)


@pytest.mark.parametrize("boresight", [(0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 2, 0), (0.3, -0.5, 0.6), (0, 0, -1)])
def test_a_mount_is_a_rotation_whose_last_row_is_the_boresight(boresight):
    C_CB = nominal_mount(boresight)
    assert np.abs(C_CB @ C_CB.T - np.eye(3)).max() < 1e-15 and np.linalg.det(C_CB) == pytest.approx(1.0)
    assert np.allclose(C_CB[2], np.array(boresight) / np.linalg.norm(boresight))


@pytest.mark.parametrize("boresight", [(0, 0, 1), (1, 0, 0), (0.3, -0.5, 0.6)])
@pytest.mark.parametrize(("turn", "moved"), [((1, 0, 0), (0, 1)), ((0, 1, 0), (-1, 0)), ((0, 0, 5), (0, 0))])
def test_a_misalignment_moves_what_is_aimed_at_by_its_angle_in_pixels(boresight, turn, moved):
    """About x of the picture, the line of sight turns up against y, which points down: what is aimed at goes down."""
    camera = Camera(boresight_B=boresight, misalignment_deg=turn)
    aimed_at_C = true_mount(camera) @ (np.array(boresight) / np.linalg.norm(boresight))
    pixels = aimed_at_C[:2] / aimed_at_C[2] / IFOV
    assert pixels == pytest.approx(np.array(moved) * np.tan(np.radians(1.0)) / IFOV, abs=1e-6)


def test_a_fast_gimbal_looks_at_the_body_all_the_way():
    times = np.linspace(-100.0, 100.0, 401)
    to_body_B, angle = passing(times, speed=6100.0)
    assert np.abs(gimbal_angles(hinge(30.0), (0, 0, 1), to_body_B, times) - angle).max() < 1e-12


def test_a_slow_gimbal_lags_by_what_it_cannot_turn_and_stops_at_its_limit():
    times, rate = np.arange(0.0, 120.0, 0.5), np.radians(1.0)
    to_body_B, angle = passing(times, speed=6100.0)
    got = gimbal_angles(hinge(1.0), (0, 0, 1), to_body_B, times)
    assert angle[1] - angle[0] > rate * 0.5  # it is too fast from the start
    late = np.flatnonzero(got >= angle - 1e-12)[1:]
    assert late[0] > 100
    assert np.abs(got[: late[0]] - (angle[0] + rate * times[: late[0]])).max() < 1e-12
    assert np.abs(got[late] - angle[late]).max() < 1e-12
    assert gimbal_angles(hinge(90.0, to_deg=100), (0, 0, 1), to_body_B, times).max() == pytest.approx(np.radians(100))


def test_cameras_with_a_gimbal_turn_with_its_angle_and_its_rate():
    times = np.linspace(-100.0, 100.0, 2001)
    to_body_B, _ = passing(times, speed=6100.0)
    camera = Camera(gimbal=hinge(30.0))
    attitudes = np.broadcast_to(np.eye(3), (len(times), 1, 3, 3))
    C_CN, omega_CN_C = camera_attitudes(camera, times, -to_body_B[:, None], attitudes, np.zeros((len(times), 1, 3)))
    to_body_C = np.einsum("tij,tj->ti", C_CN[:, 0], to_body_B)
    assert np.abs(to_body_C[:, :2]).max() < 1e-6 * RANGE
    # The line of sight turns at speed over distance at the closest approach, about the hinge.
    assert omega_CN_C[1000, 0] == pytest.approx([0.0, 6100.0 / RANGE, 0.0], rel=1e-4)
