"""What the cameras of a flight show: pictures of the body in true light, as the detector reads them out, with their labels."""

from __future__ import annotations

from math import ceil, sqrt
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.observe import camera_from
from swarm_mj.flight.plan import Plan
from swarm_mj.observation.camera import CameraModel, CameraMotion, CameraPose
from swarm_mj.observation.capture import Picture
from swarm_mj.observation.detector import DetectorModel, Exposed
from swarm_mj.observation.lens import Distortion, Lens, lens_of
from swarm_mj.observation.photometry import needed_surface
from swarm_mj.observation.shading import FEWEST, Labels, ShadedBody
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.smallbody.companion import Companion
from swarm_mj.typing import Array, Array32

#: Longest side of a picture [px], and most instants of an exposure at which it is drawn.
MOST_PIXELS, MOST_INSTANTS = 8192, 16
#: Motion of the picture's middle between two instants of an exposure that are both drawn [px].
BETWEEN_PX = 0.5


def detector_camera(scenario: Scenario) -> CameraModel:
    """The scenario's camera with a picture as fine as its detector, where that is told."""
    camera, given = camera_from(scenario), scenario.camera
    size = given.resolution_px
    if given.detector_px is not None:
        size = max(given.detector_px)
    elif given.detector_ifov_rad is not None:
        size = round(2.0 * camera.tan_half_angle / given.detector_ifov_rad)
    if size > MOST_PIXELS:
        raise ScenarioError(
            f"camera: the detector has {size} pixels along a side, of which pictures take at most {MOST_PIXELS}; give a "
            "larger camera.detector_ifov_rad"
        )
    return CameraModel(
        half_angle_deg=camera.half_angle_deg, resolution_px=size, exposure_s=camera.exposure_s, sides=camera.sides
    )


def lens_from(scenario: Scenario) -> Lens:
    """Lens and detector of the scenario's camera; of a cone, the square about it."""
    return lens_of(detector_camera(scenario), Distortion(*scenario.camera.detector.distortion))


class PictureMaker:
    """Makes the pictures of a plan's cameras.

    Args:
        plan: The mission.

    Attributes:
        lens: Lens and detector of every spacecraft.

    Raises:
        ScenarioError: It is not known how the body reflects light, or the file of the faces' albedos does not fit its mesh.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, scenario = plan, plan.scenario
        surface = needed_surface(scenario.body)
        self.lens = lens_from(scenario)
        self._companion: Companion | None = plan.environment.companion
        vertices, faces = np.array(plan.shape.vertices), np.array(plan.shape.faces)
        albedo = face_albedo(scenario, len(faces))
        if self._companion is not None:
            other = self._companion.shape
            faces = np.vstack((faces, other.faces + len(vertices)))
            vertices = np.vstack((vertices, self._companion_at(0.0)))
            albedo = np.concatenate((albedo, np.ones(len(other.faces))))
        self._body = ShadedBody(vertices, faces, surface, albedo)
        self._vertices = vertices
        shape = self.lens.height, self.lens.width
        self._detectors = [
            DetectorModel(scenario.camera, 1.0 / self.lens.focal_px, shape, seed=scenario.seed + j)
            for j in range(plan.n)
        ]

    def _companion_at(self, t: float) -> Array:
        """Vertices of the companion in A at a time [s]."""
        assert self._companion is not None
        C_AN = self._plan.environment.C_AN(t)
        placed: Array = (
            self._companion.shape.vertices @ self._companion.C_AN(t) + self._companion.position(t)
        ) @ C_AN.T
        return placed

    def _arrange(self, t: float) -> None:
        if self._companion is not None:
            self._vertices[-len(self._companion.shape.vertices) :] = self._companion_at(t)
            self._body.move(self._vertices)

    def factor(self, picture: Picture, exposure_s: float = 0.0, fewest: int = FEWEST) -> Array32:
        """Radiance factors of a picture, spread and averaged over each pixel and the exposure; shape (height, width)."""
        self._arrange(picture.t)
        shown = self._drawn(picture.pose, picture.sun_A, fewest)
        blur = self._motion_px(picture, exposure_s)
        if blur <= BETWEEN_PX:
            return shown
        instants = min(ceil(blur / BETWEEN_PX), MOST_INSTANTS)
        total = np.zeros_like(shown)
        # Those of several instants fall on other places: fewer of each do.
        few = max(FEWEST, ceil(fewest / sqrt(instants)))
        for k in range(instants):
            pose = moved(picture.pose, picture.motion, exposure_s * ((k + 0.5) / instants - 0.5))
            total += self._drawn(pose, picture.sun_A, few)
        return total / np.float32(instants)

    def _drawn(self, pose: CameraPose, sun_A: Array, fewest: int) -> Array32:
        psf_px = self._plan.scenario.camera.detector.psf_sigma_px
        return self._body.draw_spread(self.lens, pose, sun_A, psf_px, fewest=fewest)

    def _motion_px(self, picture: Picture, exposure_s: float) -> float:
        """How far what is in a picture moves over the detector in an exposure, at most [px]; 0 where nothing is ahead."""
        if picture.motion is None or exposure_s <= 0.0:
            return 0.0
        now = picture.pose.to_camera(self._vertices)
        ahead = np.flatnonzero(now[:, 2] > 0.0)
        if not len(ahead):
            return 0.0
        beside = np.abs(now[ahead, :2] / now[ahead, 2:] * self.lens.focal_px)
        seen = ahead[(beside <= np.array([self.lens.width, self.lens.height]) / 2.0).all(axis=1)]
        if not len(seen):  # of faces wider than the picture, the corner that is nearest to it
            seen = ahead[[int(np.linalg.norm(beside, axis=1).argmin())]]
        before, after = (
            moved(picture.pose, picture.motion, side * exposure_s).to_camera(self._vertices[seen])
            for side in (-0.5, 0.5)
        )
        stays = (before[:, 2] > 0.0) & (after[:, 2] > 0.0)
        way = before[stays, :2] / before[stays, 2:] - after[stays, :2] / after[stays, 2:]
        return float(np.linalg.norm(way, axis=1).max(initial=0.0)) * self.lens.focal_px

    def take(self, picture: Picture, fewest: int = FEWEST) -> Exposed:
        """Expose a picture, with the noise that belongs to its spacecraft and time; `fewest` samples along a pixel."""
        detector, sun_m = self._detectors[picture.spacecraft], float(np.linalg.norm(picture.sun_A))
        exposure_s = picture.exposure_s
        if exposure_s is None:
            self._arrange(picture.t)
            still = self._drawn(picture.pose, picture.sun_A, fewest)
            exposure_s = detector.exposure(still, sun_m)
            smeared = self._motion_px(picture, exposure_s) > BETWEEN_PX
            factor = self.factor(picture, exposure_s, fewest) if smeared else still
        else:
            factor = self.factor(picture, exposure_s, fewest)
        rng = np.random.default_rng([self._plan.scenario.seed, picture.spacecraft, round(1e3 * picture.t)])
        return detector.expose(factor, sun_m, rng, exposure_s)

    def labels(self, picture: Picture) -> Labels:
        """What is under each pixel of a picture; faces of a companion count on from those of the body."""
        self._arrange(picture.t)
        return self._body.labels(self.lens, picture.pose, picture.sun_A)


def moved(pose: CameraPose, motion: CameraMotion | None, dt: float) -> CameraPose:
    """A camera's pose a little later [s], as it moves and turns relative to the body."""
    if motion is None or dt == 0.0:
        return pose
    turned = Rotation.from_rotvec(-dt * motion.omega_C).as_matrix() @ pose.C_CA
    return CameraPose(pose.r_A + dt * motion.v_A, turned)


def face_albedo(scenario: Scenario, count: int) -> Array:
    """Factor of each face's reflectance, shape (count,).

    Raises:
        ScenarioError: The file cannot be read, or does not fit the mesh.
    """
    if scenario.body.face_albedo is None:
        return np.ones(count)
    path = Path(scenario.body.face_albedo)
    try:
        factors = np.loadtxt(path, ndmin=1)
    except (OSError, ValueError) as error:
        raise ScenarioError(f"body.face_albedo = {path}: cannot be read as numbers: {error}") from None
    if factors.shape != (count,) or not (np.isfinite(factors) & (factors >= 0.0)).all():
        raise ScenarioError(
            f"body.face_albedo = {path}: must hold {count} numbers from 0 on, one for each face of the mesh in its order; it "
            f"holds {factors.size}"
        )
    return factors
