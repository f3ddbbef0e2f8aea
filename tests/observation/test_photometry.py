"""Reflectance laws against closed forms, reciprocity, energy, the exact H function and published albedos."""

import numpy as np
import pytest

from swarm_mj.errors import ScenarioError
from swarm_mj.observation.photometry import (
    body_surface,
    radiance_factor,
    radiance_factors,
    sphere_phase_curve,
    surface_of,
)
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema_photometry import SETS, Photometry

PHASE = np.radians([5.0, 30.0, 70.0, 110.0, 150.0])
LAWS = ("lambert", "lommel_seeliger", "lunar_lambert", "akimov", "hapke")


def law(name, **keys):
    return surface_of(Photometry(law=name, **keys))


def directions(n, seed):
    """Pairs of unit vectors above the ground, shape (n, 2, 3)."""
    found = np.random.default_rng(seed).normal(size=(n, 2, 3))
    found[..., 2] = np.abs(found[..., 2]) + 1e-3
    return found / np.linalg.norm(found, axis=2, keepdims=True)


def test_a_lambert_sphere_has_its_phase_curve_in_closed_form():
    expected = 2.0 / 3.0 * (np.sin(PHASE) + (np.pi - PHASE) * np.cos(PHASE)) / np.pi
    assert np.allclose(sphere_phase_curve(law("lambert", albedo=1.0), PHASE), expected, rtol=1e-9)


def test_a_lommel_seeliger_sphere_has_its_phase_curve_in_closed_form():
    expected = 1.0 - np.sin(PHASE / 2) * np.tan(PHASE / 2) * np.log(1.0 / np.tan(PHASE / 4))
    found = sphere_phase_curve(law("lommel_seeliger", albedo=1.0), PHASE)
    assert np.allclose(found, expected, atol=2e-6)
    bent = sphere_phase_curve(law("lommel_seeliger", albedo=0.5, phase_exponents=(-0.02, 1e-4, 0.0)), PHASE)
    degrees = np.degrees(PHASE)
    assert np.allclose(bent, 0.5 * expected * np.exp(-0.02 * degrees + 1e-4 * degrees**2), atol=2e-6)


@pytest.mark.parametrize("name", LAWS)
def test_light_and_camera_can_be_exchanged(name):
    surface = law(name)
    for s, e in directions(200, 1):
        there = radiance_factor(surface, s[2], e[2], float(s @ e)) / s[2]
        back = radiance_factor(surface, e[2], s[2], float(s @ e)) / e[2]
        assert there == pytest.approx(back, rel=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_no_more_light_goes_out_than_comes_in(name):
    # The others are laws of dark surfaces: single scattering gives an eighth of the albedo of its particles.
    keys = {"albedo": 0.999} if name in ("hapke", "lambert") else {"albedo": 0.12}
    surface, rng = law(name, **keys, opposition_amplitude=0.0), np.random.default_rng(0)
    for mu0 in (0.15, 0.5, 0.95):
        mu, azimuth = np.sqrt(rng.random(20_000)), 2.0 * np.pi * rng.random(20_000)
        cos_phase = mu0 * mu + np.sqrt((1 - mu0**2) * (1 - mu**2)) * np.cos(azimuth)
        # Directions by their cosine: the mean of I/F over mu0 is the share that goes out.
        share = radiance_factors(surface, np.full(len(mu), mu0), mu, cos_phase).mean() / mu0
        assert share < 1.02
        if name == "lambert":
            assert share == pytest.approx(0.999, rel=1e-6)


def test_the_phase_angle_is_no_sum_of_incidence_and_emission():
    surface = law("hapke")
    beside, opposite = (radiance_factor(surface, 0.6, 0.6, cosine) for cosine in (1.0, 2 * 0.36 - 1.0))
    assert beside > 1.5 * opposite


def exact_h(x, w):
    """Chandrasekhar's H by iteration of its integral equation."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    H = np.ones(64)
    for _ in range(400):
        H = 1.0 / (np.sqrt(1.0 - w) + 0.5 * w * (weights * nodes * H) @ (1.0 / (nodes[:, None] + nodes)))
    return 1.0 / (np.sqrt(1.0 - w) + 0.5 * w * ((weights * nodes * H) / (x + nodes)).sum())


def test_a_smooth_hapke_surface_is_that_of_the_exact_h_function():
    w, mu0, mu, phase = 0.6, 0.8, 0.4, 0.7
    surface = law("hapke", albedo=w, asymmetry=0.0, opposition_amplitude=0.0, roughness_deg=0.0)
    exact = w / 4.0 * mu0 / (mu0 + mu) * exact_h(mu0, w) * exact_h(mu, w)
    assert radiance_factor(surface, mu0, mu, np.cos(phase)) == pytest.approx(exact, rel=0.01)


def test_roughness_under_the_sun_in_the_zenith_is_its_closed_form():
    # Without a tilt of the light nothing depends on azimuth, and no shadow is seen.
    w, emission, t = 0.4, np.radians(55.0), np.tan(np.radians(25.0))
    chi, cot = 1.0 / np.sqrt(1.0 + np.pi * t**2), 1.0 / t / np.tan(emission)
    e1, e2 = np.exp(-2.0 / np.pi * cot), np.exp(-(cot**2) / np.pi)
    tilted = chi * (np.cos(emission) + np.sin(emission) * t * e2 / (2.0 - e1))
    rough = law("hapke", albedo=w, asymmetry=0.0, opposition_amplitude=0.0, roughness_deg=25.0)
    smooth = law("hapke", albedo=w, asymmetry=0.0, opposition_amplitude=0.0, roughness_deg=0.0)
    found = radiance_factor(rough, 1.0, np.cos(emission), np.cos(emission))
    # A smooth surface at the effective angles; its phase angle plays no part here.
    assert found == pytest.approx(radiance_factor(smooth, chi, tilted, np.cos(emission)), rel=1e-6)


def test_roughness_shades_at_large_angles_and_leaves_the_zenith():
    smooth, rough = law("hapke", roughness_deg=0.0), law("hapke", roughness_deg=30.0)
    zenith = [radiance_factor(each, 1.0, 1.0, 1.0) for each in (smooth, rough)]
    assert zenith[1] == pytest.approx(zenith[0], rel=0.1)
    # Seen from the other side, shadows are; from that of the Sun, they are not.
    mu = np.cos(np.radians(60.0))
    ahead, behind = np.cos(np.radians(120.0)), 1.0
    ratio = [radiance_factor(rough, mu, mu, c) / radiance_factor(smooth, mu, mu, c) for c in (ahead, behind)]
    assert ratio[0] < 0.5 < 0.6 < ratio[1]


@pytest.mark.parametrize(("name", "albedo"), [("eros", 0.23), ("bennu", 0.047), ("lutetia", 0.195)])
def test_published_sets_give_the_published_geometric_albedo(name, albedo):
    # Li et al. 2004: 0.23 +- 0.01; Takir et al. 2015: 0.047; Sierks et al. 2011: 0.19 +- 0.01.
    assert float(sphere_phase_curve(surface_of(Photometry(**SETS[name])), 0.0)) == pytest.approx(albedo, abs=0.01)


def test_akimov_is_flat_at_opposition_and_dark_at_the_limb_of_the_sun():
    surface = law("akimov", albedo=0.3)
    assert radiance_factor(surface, 0.3, 0.3, 1.0) == pytest.approx(0.3)
    assert radiance_factor(surface, 1e-9, 0.5, 0.5) < 1e-6


def test_a_body_reflects_as_it_is_told_or_by_its_shape():
    assert body_surface(load_scenario("eros-config2").body) == surface_of(Photometry(**SETS["eros"]))
    dark = load_scenario("eros-config2", {"body.albedo": 0.1})
    assert body_surface(dark.body) == law("lambert", albedo=0.1)
    own = load_scenario("eros-config2", {"body.photometry": "itokawa", "body.albedo": 0.1})
    assert body_surface(own.body) == surface_of(Photometry(**SETS["itokawa"]))
    with pytest.raises(ScenarioError, match=r"photometry.*'eross'.*eros or bennu"):
        load_scenario("eros-config2", {"body.photometry": "eross"})
