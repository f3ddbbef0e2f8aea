"""How a camera is mounted on its spacecraft, and how spacecraft are turned so that it looks at the body."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from swarm_mj.scenarios.schema import SecondAxis
from swarm_mj.scenarios.schema_imaging import Camera, Gimbal
from swarm_mj.spacecraft.attitude.guidance import PLAIN, Aiming, Towards
from swarm_mj.typing import Array


def nominal_mount(boresight_B: ArrayLike) -> Array:
    """Rotation from B to the camera's frame C as the spacecraft knows it, shape (3, 3): its rows are the camera's axes in B.

    The last one is the boresight; x of the picture is B's x made perpendicular to it, or B's y where it looks along x.
    """
    z = np.asarray(boresight_B, np.float64) / np.linalg.norm(boresight_B)
    if z[2] == 1.0:
        return np.eye(3)
    along = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 1.0 - 1e-9 else np.array([0.0, 1.0, 0.0])
    x = along - (along @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def true_mount(camera: Camera) -> Array:
    """Rotation from B to C as it was built, misalignment included, shape (3, 3)."""
    turned = Rotation.from_rotvec(camera.misalignment_deg, degrees=True).as_matrix().T
    return turned @ nominal_mount(camera.boresight_B)


def aiming_of(camera: Camera, second_axis: SecondAxis | None) -> Aiming:
    """How guidance turns the spacecraft."""
    C_CB = nominal_mount(camera.boresight_B)
    mounted = camera.gimbal is None and not np.array_equal(C_CB, np.eye(3))
    q_BC = Rotation.from_matrix(C_CB.T).as_quat(scalar_first=True) if mounted else PLAIN.q_BC
    if second_axis is None:
        return PLAIN._replace(q_BC=q_BC, mounted=mounted)
    axis, towards, direction = np.array(second_axis.axis_B), second_axis.towards, np.zeros(3)
    if not isinstance(towards, str):
        direction = np.array(towards) / np.linalg.norm(towards)
    kind = Towards[towards.upper()] if isinstance(towards, str) else Towards.DIRECTION
    return Aiming(q_BC, mounted, int(kind), axis / np.linalg.norm(axis), direction)


def gimbal_angles(gimbal: Gimbal, boresight_B: ArrayLike, to_body_B: Array, times: Array) -> Array:
    """Angles of a gimbal that follows the body's centre within its range and rate [rad].

    Args:
        gimbal: Axis and limits.
        boresight_B: Line of sight at the angle 0, shape (3,).
        to_body_B: From the spacecraft to the body's centre in B, at every time, shape (t, 3).
        times: Rising [s], shape (t,). At the first it is where it should be.
    """
    axis, zero = (np.asarray(each, np.float64) / np.linalg.norm(each) for each in (gimbal.axis_B, boresight_B))
    low, high = np.radians((gimbal.from_deg, gimbal.to_deg))
    middle = 0.5 * (low + high)
    wanted = np.arctan2(to_body_B @ np.cross(axis, zero), to_body_B @ zero)
    # Of all full turns that which is nearest to the middle of the range, so that what is out of it ends at the nearer limit.
    wanted = np.clip(middle + np.remainder(wanted - middle + np.pi, 2.0 * np.pi) - np.pi, low, high)
    most, angles = np.radians(gimbal.rate_deg_s) * np.diff(times), wanted.copy()
    for k, step in enumerate(most, start=1):
        angles[k] = angles[k - 1] + np.clip(wanted[k] - angles[k - 1], -step, step)
    return angles


def camera_attitudes(
    camera: Camera, times: Array, r_BN_N: Array, C_BN: Array, omega_BN_B: Array | None
) -> tuple[Array, Array | None]:
    """Attitudes of cameras in a flight, as they are mounted and turned by their gimbals.

    Args:
        camera: Of every spacecraft.
        times: Of the samples [s], shape (t,).
        r_BN_N: Positions relative to the body, shape (t, n, 3) [m].
        C_BN: Attitudes, shape (t, n, 3, 3).
        omega_BN_B: Rates in B, shape (t, n, 3) [rad/s]; None: not known.

    Returns:
        C_CN, shape (t, n, 3, 3), and the rates of C relative to N in C, shape (t, n, 3) [rad/s], None where they are not known.
    """
    if camera.as_the_body:
        return C_BN, omega_BN_B
    C_CB = np.broadcast_to(true_mount(camera), C_BN.shape)
    omega_B = omega_BN_B
    if camera.gimbal is not None:
        angles, axis = gimbal_of(camera, camera.gimbal, times, r_BN_N, C_BN)
        turns = Rotation.from_rotvec((angles[..., None] * axis).reshape(-1, 3)).as_matrix().reshape(C_BN.shape)
        C_CB = C_CB @ np.swapaxes(turns, -1, -2)
        if omega_B is not None and len(times) > 1:
            omega_B = omega_B + np.gradient(angles, times, axis=0)[..., None] * axis
    return C_CB @ C_BN, None if omega_B is None else np.einsum("tnij,tnj->tni", C_CB, omega_B)


def gimbal_of(camera: Camera, gimbal: Gimbal, times: Array, r_BN_N: Array, C_BN: Array) -> tuple[Array, Array]:
    """Angles of the gimbals of a flight [rad], shape (t, n), and their axis in B, shape (3,); args as of `camera_attitudes`."""
    to_body_B = -np.einsum("tnij,tnj->tni", C_BN, r_BN_N)
    angles = [gimbal_angles(gimbal, camera.boresight_B, to_body_B[:, j], times) for j in range(r_BN_N.shape[1])]
    return np.stack(angles, axis=1), np.array(gimbal.axis_B) / np.linalg.norm(gimbal.axis_B)
