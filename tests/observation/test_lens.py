"""Lens and detector coordinates."""

import numpy as np

from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.lens import Distortion, lens_of

BENT = Distortion(k1=-0.3, k2=0.1, p1=2e-3, p2=-1e-3, k3=-0.02)


def test_a_plain_lens_is_that_of_the_camera():
    lens = lens_of(CameraModel(half_angle_deg=10.0, resolution_px=512))
    edge = np.tan(np.radians(10.0))
    assert np.allclose(lens.to_pixels([[edge, -edge, 1.0], [0.0, 0.0, 5.0]]), [[512.0, 0.0], [256.0, 256.0]])
    wide = lens_of(CameraModel(half_angle_deg=10.0, resolution_px=512, sides=(1.0, 0.5)))
    assert (wide.width, wide.height) == (512, 256) and wide.focal_px == lens.focal_px


def test_distortion_is_browns_and_is_undone():
    lens = lens_of(CameraModel(half_angle_deg=20.0, resolution_px=400), BENT)
    x, y = 0.25, -0.15
    r2 = x * x + y * y
    radial = 1 - 0.3 * r2 + 0.1 * r2**2 - 0.02 * r2**3
    expected = (
        x * radial + 2 * 2e-3 * x * y - 1e-3 * (r2 + 2 * x * x),
        y * radial + 2e-3 * (r2 + 2 * y * y) - 2 * 1e-3 * x * y,
    )
    found = lens.to_pixels([x, y, 1.0])
    assert np.allclose((found - lens.centre) / lens.focal_px, expected, rtol=1e-12)
    assert np.allclose(lens.to_image(found), (x, y), atol=1e-12)


def test_derivatives_are_those_of_differences():
    lens = lens_of(CameraModel(half_angle_deg=20.0, resolution_px=400), BENT)
    p = np.array([0.2, -0.3, 1.7])
    steps = 1e-6 * np.eye(3)
    differences = np.stack([(lens.to_pixels(p + s) - lens.to_pixels(p - s)) / 2e-6 for s in steps], axis=-1)
    assert np.allclose(lens.pixel_jacobian(p), differences, rtol=1e-6)
