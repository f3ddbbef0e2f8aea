"""The camera: its field of view, where its pictures fall, and their motion blur.

Camera frame C: z along the line of sight, x to the right and y down in the picture (right-handed). A spacecraft's
camera that is not mounted otherwise looks along its +z, and C is its frame B. `C_CA` maps components in the body-fixed frame
A into C; its rows are the camera's axes in A. Lengths are in metres.

Motion blur is how far the image of each cell moves over the detector while a picture is exposed: to first order, the rate at
which the image moves at the middle of the exposure times its length. A point at p in C moves in it with

    dp/dt = -C_CA v - omega x p,

where v is the camera's velocity and omega its angular velocity, both relative to the rotating body. The image (x / z, y / z)
moves accordingly. That holds the whole motion: the flyby, the spin of the body, the commanded turn of the spacecraft and the
rates by which it misses it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.compilation import jittable
from swarm_mj.errors import MissionError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.typing import Array, Mask

FieldOfView = Literal["square", "cone"]

#: Largest picture that every OpenGL 4 driver renders [pixel].
MAX_RESOLUTION = 8192

_UNIT = np.eye(3)
#: How far C_CA C_CA^T may be from that: attitudes come rounded, from files or single precision.
_ROUNDING = 1e-6 + 1e-5 * _UNIT


@dataclass(frozen=True, kw_only=True)
class CameraModel:
    """An ideal pinhole camera.

    Attributes:
        half_angle_deg: Angle between the line of sight and the middle of a picture's edge [deg], between 0 and 90; of a
            rectangle, of the nearer edges of its longer sides' ends.
        shape: `square` pyramid, or the `cone` inscribed in it.
        resolution_px: Pixels along one side of the square picture.
        sides: Width and height of a rectangular field of view over the longer of the two; the square about it is drawn.
        detector_ifov: Width of a pixel of the real detector at unit distance [rad], where it is finer than the picture that
            is drawn; None: the picture's.
        exposure_s: Time for which a picture is exposed [s]; 0: an instant.

    Raises:
        MissionError: A value is impossible.
    """

    half_angle_deg: float = 21.5
    shape: FieldOfView = "square"
    resolution_px: int = 512
    detector_ifov: float | None = None
    exposure_s: float = 0.0
    sides: tuple[float, float] = (1.0, 1.0)

    def __post_init__(self) -> None:
        """Refuse impossible cameras."""
        if not 0.0 < self.half_angle_deg < 90.0:
            raise MissionError(f"camera half-angle {self.half_angle_deg} deg must be above 0 and below 90 deg")
        if self.shape not in ("square", "cone"):
            raise MissionError(f"unknown field of view {self.shape!r}: use 'square' or 'cone'")
        if not 1 <= self.resolution_px <= MAX_RESOLUTION:
            raise MissionError(f"camera resolution {self.resolution_px} px must be 1 to {MAX_RESOLUTION} px")
        if max(self.sides) != 1.0 or not min(self.sides) > 0.0 or (self.shape == "cone" and min(self.sides) != 1.0):
            raise MissionError(f"camera sides {self.sides}: the longer must be 1, the other above 0, both 1 for a cone")
        if not (isfinite(self.exposure_s) and self.exposure_s >= 0.0):
            raise MissionError(f"camera exposure {self.exposure_s} s must be 0 or more")

    @property
    def tan_half_angle(self) -> float:
        """Half the width of the picture at unit distance."""
        return float(np.tan(np.radians(self.half_angle_deg)))

    @property
    def pixel_angle(self) -> float:
        """Width of a pixel of the detector at unit distance [rad, small angles]; it sets the ground sampling distance."""
        if self.detector_ifov is not None:
            return self.detector_ifov
        return 2.0 * self.tan_half_angle / self.resolution_px

    @property
    def optics(self) -> Optics:
        """The field of view in numbers."""
        return Optics(self.tan_half_angle, self.shape == "cone", *self.sides)

    @property
    def inscribed_cone(self) -> CameraModel:
        """The same with the cone that lies in the field of view however it is turned about the line of sight."""
        if min(self.sides) == 1.0:
            return replace(self, shape="cone")
        half_angle = float(np.degrees(np.arctan(min(self.sides) * self.tan_half_angle)))
        resolution = max(1, round(min(self.sides) * self.resolution_px))
        ifov = self.pixel_angle
        return replace(
            self,
            shape="cone",
            half_angle_deg=half_angle,
            resolution_px=resolution,
            detector_ifov=ifov,
            sides=(1.0, 1.0),
        )

    def outline(self, per_side: int) -> Array:
        """Points on the edge of the field of view at unit distance along z, shape (4 per_side, 2).

        In order, from corner to corner where it has some: the first of every `per_side` is one.
        """
        if self.shape == "cone":
            angle = 2.0 * np.pi * np.arange(4 * per_side) / (4 * per_side)
            return self.tan_half_angle * np.column_stack((np.cos(angle), np.sin(angle)))
        along, one = -1.0 + 2.0 * np.arange(per_side) / per_side, np.ones(per_side)
        edges = ((along, -one), (one, along), (-along, one), (-one, -along))
        return self.tan_half_angle * np.array(self.sides) * np.vstack([np.column_stack(edge) for edge in edges])

    def contains(self, points_C: Array) -> Mask:
        """Tell which points lie in the field of view, occlusion aside; `points_C` [m] has shape (..., 3)."""
        return np.asarray(in_field_of_view(self.optics, *np.moveaxis(points_C, -1, 0)))


class Optics(NamedTuple):
    """A field of view in numbers.

    Attributes:
        tan_half_angle: Half the width of the picture at unit distance.
        cone: Whether it is the cone inscribed in the square pyramid.
        across: Share of that width that a rectangle takes.
        down: Share of the height.
    """

    tan_half_angle: float
    cone: bool
    across: float = 1.0
    down: float = 1.0


@jittable
def in_field_of_view(optics: Optics, x: Any, y: Any, z: Any) -> Any:
    """Whether points given in the camera frame [m], numbers or arrays of them, lie in the field of view."""
    reach = z * optics.tan_half_angle
    if optics.cone:
        within = x * x + y * y <= reach * reach
    else:
        within = (abs(x) <= reach * optics.across) & (abs(y) <= reach * optics.down)
    return (z > 0.0) & within


@dataclass(frozen=True, eq=False)
class CameraPose:
    """Where a camera is and how it is turned.

    Attributes:
        r_A: Position in A [m], shape (3,).
        C_CA: Rotation from A to C, shape (3, 3).
    """

    r_A: Array
    C_CA: Array

    def to_camera(self, points_A: Array) -> Array:
        """Points in A [m], shape (..., 3), as components in C [m] relative to the camera."""
        return (points_A - self.r_A) @ self.C_CA.T


def camera_pose(r_A: ArrayLike, C_CA: ArrayLike) -> CameraPose:
    """Check a pose and convert it to arrays.

    Raises:
        MissionError: The position or the matrix has the wrong shape or is not finite, or the matrix is no rotation.
    """
    position, matrix = np.asarray(r_A, dtype=np.float64), np.asarray(C_CA, dtype=np.float64)
    if position.shape != (3,) or not all(isfinite(x) for x in position):
        raise MissionError(f"camera position must be three finite numbers in metres, got {position}")
    if matrix.shape != (3, 3) or not (np.abs(matrix @ matrix.T - _UNIT) <= _ROUNDING).all():
        raise MissionError(f"camera attitude C_CA must be a 3 x 3 rotation matrix, got {matrix.tolist()}")
    if np.linalg.det(matrix) < 0.0:
        raise MissionError("camera attitude C_CA mirrors the scene: its determinant must be +1, not -1")
    return CameraPose(position, matrix)


def look_at(r_A: ArrayLike, aim_A: ArrayLike, *, roll: float = 0.0) -> CameraPose:
    """Point a camera at `aim_A` [m].

    At zero roll the picture's right is perpendicular to A's z axis (to its x axis when looking along z); a positive
    roll [rad] turns the camera clockwise about its line of sight.
    """
    position = np.asarray(r_A, dtype=np.float64)
    forward = np.asarray(aim_A, dtype=np.float64) - position
    forward = forward / np.linalg.norm(forward)
    across = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(across) < 1e-9:
        across = np.cross(forward, [1.0, 0.0, 0.0])
    right = across / np.linalg.norm(across)
    down = np.cross(forward, right)
    c, s = np.cos(roll), np.sin(roll)
    return CameraPose(position, np.array([c * right + s * down, c * down - s * right, forward]))


class CameraMotion(NamedTuple):
    """How a camera moves relative to the rotating body.

    Attributes:
        v_A: Velocity in A relative to A [m/s], shape (3,).
        omega_C: Angular velocity of the camera relative to A, components in C [rad/s], shape (3,).
        exposure_s: How long it moves so while a picture is exposed [s]; None: the camera's exposure.
    """

    v_A: Array
    omega_C: Array
    exposure_s: float | None = None


class Motion(NamedTuple):
    """How spacecraft and the body move in N.

    Attributes:
        v_BN_N: Velocities [m/s], shape (n, 3).
        omega_BN_B: Angular velocities of B, or of the camera's frame where that is another, relative to N, in that frame
            [rad/s], shape (n, 3).
        spin_N: Angular velocity of A relative to N [rad/s], shape (3,).
    """

    v_BN_N: Array
    omega_BN_B: Array
    spin_N: Array

    def of(self, j: int, r_N: Array, C_BN: Array, C_AN: Array) -> CameraMotion:
        """The motion of the camera of spacecraft j at `r_N` [m], shape (3,); its frame is B."""
        v_A = C_AN @ (self.v_BN_N[j] - np.cross(self.spin_N, r_N))
        return CameraMotion(v_A, self.omega_BN_B[j] - C_BN @ self.spin_N)


def motion_blur_px(region: TargetRegion, camera: CameraModel, r_A: Array, C_CA: Array, motion: CameraMotion) -> Array:
    """Motion blur of every cell's centroid [px of the detector], shape (n,); infinite where it is not ahead of the camera.

    Exposure, where the motion names no other, and angle of a pixel are the camera's; `r_A` [m], shape (3,), and `C_CA`, shape
    (3, 3), are its pose.
    """
    p = (region.centroid_A - r_A) @ C_CA.T
    p_dot = -(C_CA @ motion.v_A) - np.cross(motion.omega_C, p)
    depth = np.where(p[:, 2] > 0.0, p[:, 2], np.nan)
    image_dot = (p_dot[:, :2] - p[:, :2] * (p_dot[:, 2:] / depth[:, None])) / depth[:, None]
    exposure_s = camera.exposure_s if motion.exposure_s is None else motion.exposure_s
    moved = exposure_s * np.hypot(image_dot[:, 0], image_dot[:, 1]) / camera.pixel_angle
    return np.where(np.isnan(depth), np.inf, moved)
