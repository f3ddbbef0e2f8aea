"""Counts of a detector against the statistics that its noise must have."""

import numpy as np
import pytest

from swarm_mj.observation.detector import DetectorModel
from swarm_mj.observation.radiometry import electrons
from swarm_mj.scenarios.constants import AU
from swarm_mj.scenarios.schema_detector import Detector
from swarm_mj.scenarios.schema_imaging import Camera

SHAPE = (200, 200)


def model(exposure_s=None, read_noise=10.0, **keys):
    plain = {"psf_sigma_px": 0.0, "hot_share": 0.0}
    camera = Camera(exposure_s=exposure_s, read_noise=read_noise, detector=Detector(**{**plain, **keys}))
    return camera, DetectorModel(camera, 1e-4, SHAPE)


def test_means_and_variances_are_those_of_shot_dark_and_read_noise():
    camera, detector = model(exposure_s=2e-5, dark_e_s=1e6, full_well_e=60_000.0, bits=14)
    factor = np.full(SHAPE, 0.1, np.float32)
    mean = float(electrons(camera, 1e-4, np.array(0.1), AU))
    found = detector.expose(factor, AU, np.random.default_rng(0))
    assert found.signal.mean() == pytest.approx(mean, rel=3e-3)
    variance = mean + 1e6 * 2e-5 + 10.0**2 + found.gain**2 / 12.0
    assert found.signal.var() == pytest.approx(variance, rel=0.03)
    assert found.variance.mean() == pytest.approx(variance, rel=0.01)
    assert found.electrons_per_factor * 0.1 == pytest.approx(mean)


def test_wells_are_full_and_counts_end():
    _, detector = model(exposure_s=1.0, bits=10, bias_dn=20)
    found = detector.expose(np.full(SHAPE, 0.5, np.float32), AU, np.random.default_rng(0))
    assert found.counts.max() == 1023 and found.saturated.mean() > 0.99
    dark = detector.expose(np.zeros(SHAPE, np.float32), AU, np.random.default_rng(0))
    assert dark.signal.mean() == pytest.approx(0.0, abs=0.2) and not dark.saturated.any()


def test_automatic_exposure_fills_the_share_that_is_asked_for():
    _, detector = model(exposure_share=0.5)
    factor = np.zeros(SHAPE, np.float32)
    factor[50:80, 50:80] = 0.2
    found = detector.expose(factor, 2.0 * AU, None)
    assert found.signal.max() == pytest.approx(0.5 * 20_000.0, rel=0.01)
    again = detector.expose(factor, AU, None)
    assert again.exposure_s == pytest.approx(0.25 * found.exposure_s, rel=1e-6)


def test_hot_pixels_stay_where_they_are():
    _, detector = model(exposure_s=1e-2, hot_share=1e-3, hot_e_s=1e6)
    sky = np.zeros(SHAPE, np.float32)
    hot = [detector.expose(sky, AU, np.random.default_rng(k)).signal > 500.0 for k in (0, 1)]
    assert hot[0].sum() > 10 and (hot[0] == hot[1]).mean() > 0.9999
