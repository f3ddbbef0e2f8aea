"""Bodies, cameras and pictures for tests of navigation."""

import numpy as np
import trimesh

from swarm_mj.navigation.picture import FEWEST_SAMPLES, Predictor, SeenPicture
from swarm_mj.observation.camera import CameraModel, CameraPose, look_at
from swarm_mj.observation.detector import DetectorModel
from swarm_mj.observation.lens import lens_of
from swarm_mj.observation.photometry import surface_of
from swarm_mj.observation.shading import ShadedBody
from swarm_mj.scenarios.constants import AU
from swarm_mj.scenarios.schema_imaging import Camera
from swarm_mj.scenarios.schema_photometry import Photometry


def ball(subdivisions=4, axes=(1000.0, 1000.0, 1000.0)):
    mesh = trimesh.creation.icosphere(subdivisions)
    # As large as the sphere on the mean, not inside it.
    grown = 2.0 - float(np.linalg.norm(mesh.triangles_center, axis=1).mean())
    return grown * np.array(mesh.vertices) * np.array(axes), np.array(mesh.faces)


class Studio:
    """A body before a camera of 256 x 256 pixels."""

    def __init__(self, vertices, faces, law="lambert", **keys):
        surface = surface_of(Photometry(law=law, **keys))
        self.body, self.radius = ShadedBody(vertices, faces, surface), float(np.linalg.norm(vertices, axis=1).max())
        self.predictor = Predictor(ShadedBody(vertices, faces, surface), self.radius)
        self.camera = Camera(half_angle_deg=5.0, resolution_px=256, aperture_m=0.02)
        self.lens = lens_of(CameraModel(half_angle_deg=5.0, resolution_px=256))
        self.detector = DetectorModel(self.camera, 1.0 / self.lens.focal_px, (256, 256))

    def distance(self, diameter_px):
        return 2.0 * self.radius * self.lens.focal_px / diameter_px

    def shot(self, r_A, C_CA, sun_A, rng, believed_A):
        psf_px = self.camera.detector.psf_sigma_px
        factor = self.body.draw_spread(self.lens, CameraPose(r_A, C_CA), sun_A, psf_px, fewest=FEWEST_SAMPLES)
        exposed = self.detector.expose(factor, float(np.linalg.norm(sun_A)), rng)
        diameter_px = self.predictor.diameter_at(float(np.linalg.norm(r_A)), self.lens)
        return SeenPicture.of(exposed, self.lens, psf_px, diameter_px, CameraPose(believed_A, C_CA), sun_A)


def geometry(rng, distance, phase, aside=0.0):
    """Camera at a random place that looks near the centre, and the Sun at a phase angle [rad]."""
    to_camera = rng.normal(size=3)
    to_camera /= np.linalg.norm(to_camera)
    across = np.cross(to_camera, rng.normal(size=3))
    across /= np.linalg.norm(across)
    r_A = distance * to_camera
    aim = aside * distance * rng.uniform(-1.0, 1.0, 3)
    sun_A = AU * (np.cos(phase) * to_camera + np.sin(phase) * across)
    return r_A, look_at(r_A, aim, roll=float(rng.uniform(0.0, 6.0))).C_CA, sun_A
