"""Motion blur: how far the image of each cell moves over the detector while a picture is exposed.

To first order in the exposure: the rate at which the image moves, at the middle of the exposure, times its length. A point at p
in the camera frame moves in it with

    dp/dt = -C_CA v - omega x p,

where v is the camera's velocity and omega its angular velocity, both relative to the rotating body. The image (x / z, y / z)
moves accordingly. That holds the whole motion: the flyby, the spin of the body, the commanded turn of the spacecraft and the
rates by which it misses it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel
from swarm_mj.typing import Array


class CameraMotion(NamedTuple):
    """How a camera moves relative to the rotating body.

    Attributes:
        v_A: Velocity in A relative to A [m/s], shape (3,).
        omega_C: Angular velocity of the camera relative to A, components in C [rad/s], shape (3,).
    """

    v_A: Array
    omega_C: Array


class Motion(NamedTuple):
    """How spacecraft and the body move in N.

    Attributes:
        v_BN_N: Velocities [m/s], shape (n, 3).
        omega_BN_B: Angular velocities of B relative to N, in B [rad/s], shape (n, 3).
        spin_N: Angular velocity of A relative to N [rad/s], shape (3,).
    """

    v_BN_N: Array
    omega_BN_B: Array
    spin_N: Array

    def of(self, j: int, r_N: Array, C_BN: Array, C_AN: Array) -> CameraMotion:
        """The motion of one camera.

        Args:
            j: Number of its spacecraft.
            r_N: Its position [m], shape (3,).
            C_BN: Rotation from N to B, which is the camera's frame, shape (3, 3).
            C_AN: Rotation from N to A, shape (3, 3).
        """
        v_A = C_AN @ (self.v_BN_N[j] - np.cross(self.spin_N, r_N))
        return CameraMotion(v_A, self.omega_BN_B[j] - C_BN @ self.spin_N)


def motion_blur_px(region: TargetRegion, camera: CameraModel, r_A: Array, C_CA: Array, motion: CameraMotion) -> Array:
    """Motion blur of every cell's centroid [px of the detector], shape (n,); infinite where it is not ahead of the camera.

    Args:
        region: The target.
        camera: With its exposure and the angle of its pixels.
        r_A: Position of the camera in A [m], shape (3,).
        C_CA: Rotation from A to the camera frame, shape (3, 3).
        motion: Of the camera.
    """
    p = (region.centroid_A - r_A) @ C_CA.T
    p_dot = -(C_CA @ motion.v_A) - np.cross(motion.omega_C, p)
    depth = np.where(p[:, 2] > 0.0, p[:, 2], np.nan)
    image_dot = (p_dot[:, :2] - p[:, :2] * (p_dot[:, 2:] / depth[:, None])) / depth[:, None]
    moved = camera.exposure_s * np.hypot(image_dot[:, 0], image_dot[:, 1]) / camera.pixel_angle
    return np.where(np.isnan(depth), np.inf, moved)
