"""The series against closed forms, SciPy's Legendre functions, and the polyhedron to which it is fitted."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import sph_legendre_p

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios import constants
from swarm_mj.smallbody.gravity import PointMass, Polyhedron, SphericalHarmonics, fit_harmonics
from swarm_mj.smallbody.shape_harmonics import load_eros
from swarm_mj.smallbody.shape_io import load_shape

NEAR_MODEL = Path(__file__).parents[4] / "shared" / "data" / "eros007790.tab"
GM, RADIUS = constants.EROS_GM, constants.EROS_REFERENCE_RADIUS


def around(radius, count, seed=0):
    directions = np.random.default_rng(seed).standard_normal((count, 3))
    return radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def random_field(degree, seed=5):
    c, s = np.random.default_rng(seed).standard_normal((2, degree + 1, degree + 1)) * 1e-2
    c, s = np.tril(c), np.tril(s)
    c[0, 0], s[:, 0] = 1.0, 0.0
    return SphericalHarmonics(GM, RADIUS, c, s)


@pytest.fixture(scope="module")
def polyhedron():
    return Polyhedron(load_eros(), gm=GM)


def closed_form_degree_2(r_A):
    """Attraction of central and un-normalised degree-2 terms, differentiated by hand in Cartesian coordinates."""
    (c20, _), (c21, s21), (c22, s22) = (constants.EROS_DEGREE_2[2, m] for m in range(3))
    zonal, tesseral, sectoral = np.sqrt(5.0), np.sqrt(5.0 / 3.0), np.sqrt(5.0 / 12.0)
    j, k = zonal * c20, 3.0 * tesseral * np.array([c21, s21])
    q = 3.0 * sectoral * np.array([c22, s22])
    # The degree-2 potential is GM R^2 r.M.r / r^5 with a symmetric traceless matrix M.
    M = np.array(
        [
            [-0.5 * j + q[0], q[1], 0.5 * k[0]],
            [q[1], -0.5 * j - q[0], 0.5 * k[1]],
            [0.5 * k[0], 0.5 * k[1], j],
        ]
    )
    r = np.linalg.norm(r_A, axis=1, keepdims=True)
    quadratic = np.einsum("ni,ij,nj->n", r_A, M, r_A)[:, None]
    return -GM * r_A / r**3 + GM * RADIUS**2 * (2.0 * r_A @ M / r**5 - 5.0 * quadratic * r_A / r**7)


@pytest.mark.parametrize("radius", [16e3, 22e3, 300e3])
def test_measured_field_of_eros_agrees_with_its_closed_form(radius):
    r_A = around(radius, 200)
    expected = closed_form_degree_2(r_A)
    np.testing.assert_allclose(SphericalHarmonics.eros_degree_2().acceleration(r_A), expected, rtol=1e-13, atol=1e-17)


def test_normalisation_gives_the_published_unnormalised_coefficients():
    field = SphericalHarmonics.eros_degree_2()
    assert field.c[2, 0] * np.sqrt(5.0) == pytest.approx(-0.1173082389, abs=1e-10)
    assert field.c[2, 2] * np.sqrt(5.0 / 12.0) == pytest.approx(0.0531885762, abs=1e-10)
    assert field.s[2, 2] * np.sqrt(5.0 / 12.0) == pytest.approx(-0.0181446403, abs=1e-10)


@pytest.mark.parametrize("degree", [0, 1, 3, 12, 60])
def test_potential_of_any_degree_agrees_with_legendre_functions_of_scipy(degree):
    field, r_A = random_field(degree), around(18e3, 20)
    r = np.linalg.norm(r_A, axis=1)
    colatitude, longitude = np.arccos(r_A[:, 2] / r), np.arctan2(r_A[:, 1], r_A[:, 0])
    expected = np.zeros(20)
    for n in range(degree + 1):
        for m in range(n + 1):
            geodetic = (-1) ** m * np.sqrt(4.0 * np.pi * (1 if m == 0 else 2)) * sph_legendre_p(n, m, colatitude)[0]
            wave = field.c[n, m] * np.cos(m * longitude) + field.s[n, m] * np.sin(m * longitude)
            expected += GM / r * (RADIUS / r) ** n * geodetic * wave
    np.testing.assert_allclose(field.potential(r_A), expected, rtol=1e-12)


@pytest.mark.parametrize("degree", [1, 2, 9, 40])
def test_attraction_of_any_degree_is_the_gradient_of_the_potential(degree):
    field, r_A, step = random_field(degree), around(20e3, 20), 2.0
    shifts = step * np.eye(3)
    near = np.stack([field.potential(r_A + h) - field.potential(r_A - h) for h in shifts], axis=1)
    far = np.stack([field.potential(r_A + 2 * h) - field.potential(r_A - 2 * h) for h in shifts], axis=1)
    attraction = field.acceleration(r_A)
    assert np.abs(attraction - (8 * near - far) / (12 * step)).max() < 1e-8 * np.abs(attraction).max()


@pytest.mark.parametrize("degree", [0, 2, 9, 40])
def test_gradient_is_symmetric_traceless_and_that_of_the_attraction(degree):
    field, r_A, step = random_field(degree), around(20e3, 20), 1.0
    gradient = field.gradient(r_A)
    size = np.abs(gradient).max()
    assert np.abs(np.trace(gradient, axis1=1, axis2=2)).max() < 1e-13 * size
    assert np.abs(gradient - gradient.transpose(0, 2, 1)).max() < 1e-13 * size
    shifts = step * np.eye(3)
    expected = np.stack([field.acceleration(r_A + h) - field.acceleration(r_A - h) for h in shifts], axis=-1) / (
        2 * step
    )
    assert np.abs(gradient - expected).max() < 1e-5 * size


def test_poles_are_no_singularity():
    field = random_field(8)
    poles = np.array([[0.0, 0.0, 2e4], [0.0, 0.0, -2e4]])
    beside = poles + [1e-3, -2e-3, 0.0]
    assert np.isfinite(field.acceleration(poles)).all()
    np.testing.assert_allclose(field.acceleration(poles), field.acceleration(beside), rtol=1e-5)


def test_degree_zero_is_the_point_mass():
    r_A = around(2e4, 5)
    field = SphericalHarmonics.from_coefficients(GM, RADIUS, {})
    np.testing.assert_allclose(field.acceleration(r_A), PointMass(GM).acceleration(r_A), rtol=1e-14)
    assert field.degree == 0


def test_fit_recovers_the_coefficients_of_a_band_limited_field():
    field = random_field(12)
    fitted = fit_harmonics(field.potential, GM, RADIUS, 12, 25e3)
    np.testing.assert_allclose(fitted.c, field.c, atol=1e-12)
    np.testing.assert_allclose(fitted.s, field.s, atol=1e-12)


def test_degree_2_of_the_homogeneous_body_follows_from_its_moments(polyhedron):
    shape = polyhedron.shape
    corners = shape.vertices[shape.faces] / RADIUS
    cones = np.linalg.det(corners)
    sums = corners.sum(axis=1)
    moments = (np.einsum("f,fi,fj->ij", cones, sums, sums) + np.einsum("f,fki,fkj->ij", cones, corners, corners)) / 20
    moments /= cones.sum()
    fitted = fit_harmonics(polyhedron.potential, GM, RADIUS, 2, 25e3, margin=30)
    c20, c22, s22 = fitted.c[2, 0] * 5**0.5, fitted.c[2, 2] * (5 / 12) ** 0.5, fitted.s[2, 2] * (5 / 12) ** 0.5
    assert c20 == pytest.approx(moments[2, 2] - (moments[0, 0] + moments[1, 1]) / 2, abs=1e-9)
    assert c22 == pytest.approx((moments[0, 0] - moments[1, 1]) / 4, abs=1e-9)
    assert s22 == pytest.approx(moments[0, 1] / 2, abs=1e-9)
    assert fitted.c[0, 0] == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(
        np.array([fitted.c[1, 1], fitted.s[1, 1], fitted.c[1, 0]]) * 3**0.5 * RADIUS, shape.centroid, atol=1e-4
    )


@pytest.mark.skipif(not NEAR_MODEL.exists(), reason="the NEAR plate model is not beside the checkout")
def test_homogeneous_near_plate_model_has_the_documented_degree_2_within_2_percent_of_the_measured_one():
    polyhedron = Polyhedron(load_shape(NEAR_MODEL), gm=GM)
    fitted = fit_harmonics(polyhedron.potential, GM, RADIUS, 2, 30e3)
    assert fitted.c[2, 0] * np.sqrt(5.0) == pytest.approx(-0.11852, abs=1e-5)
    assert fitted.c[2, 2] * np.sqrt(5.0 / 12.0) == pytest.approx(0.05386, abs=1e-5)
    assert fitted.s[2, 2] * np.sqrt(5.0 / 12.0) == pytest.approx(-0.01817, abs=1e-5)
    measured = SphericalHarmonics.eros_degree_2()
    for coefficient in ((fitted.c[2, 0], measured.c[2, 0]), (fitted.c[2, 2], measured.c[2, 2])):
        assert coefficient[0] == pytest.approx(coefficient[1], rel=0.02)


def test_fit_of_high_degree_converges_to_the_polyhedron_outside_18_km(polyhedron):
    tips = polyhedron.shape.vertices[np.linalg.norm(polyhedron.shape.vertices, axis=1) > 15e3]
    directions = np.vstack([around(1.0, 150), tips / np.linalg.norm(tips, axis=1, keepdims=True)])

    def errors(field, radius):
        expected = polyhedron.acceleration(radius * directions)
        difference = field.acceleration(radius * directions) - expected
        return np.linalg.norm(difference, axis=1) / np.linalg.norm(expected, axis=1)

    low, high = (fit_harmonics(polyhedron.potential, GM, RADIUS, degree, 20e3) for degree in (16, 40))
    at_18, at_20, at_25 = (errors(high, radius) for radius in (18e3, 20e3, 25e3))
    assert np.sqrt(np.mean(at_18[:150] ** 2)) < 5e-4 and at_18.max() < 5e-3
    assert at_20.max() < 5e-5
    assert at_25.max() < 5e-9
    assert errors(low, 18e3).max() > 5 * at_18.max()


@pytest.mark.parametrize(
    ("coefficients", "message"),
    [
        ({(2, 3): (0.1, 0.0)}, r"\(n, m\) = \(2, 3\): needs 0 <= m <= n"),
        ({(2, -1): (0.1, 0.0)}, "needs 0 <= m <= n"),
        ({(3, 1): (np.nan, 0.0)}, r"\(3, 1\): C = nan"),
        ({(3, 1): (0.0, np.inf)}, r"\(3, 1\): .* S = inf"),
    ],
)
def test_impossible_coefficients_are_named(coefficients, message):
    with pytest.raises(ScenarioError, match=message):
        SphericalHarmonics.from_coefficients(GM, RADIUS, coefficients)


def test_tables_and_radius_are_checked_and_frozen():
    with pytest.raises(ScenarioError, match=r"C \(3, 2\)"):
        SphericalHarmonics(GM, RADIUS, np.zeros((3, 2)), np.zeros((3, 2)))
    with pytest.raises(ScenarioError, match="reference_radius"):
        SphericalHarmonics(GM, 0.0, np.eye(3), np.eye(3))
    field = SphericalHarmonics.eros_degree_2()
    with pytest.raises(ValueError, match="read-only"):
        field.c[2, 0] = 0.0


@pytest.mark.parametrize("radii", [1.01, 1.75, 3.0, 10.0, 1e4])
def test_terms_that_a_bounded_series_leaves_out_are_lost_in_rounding(radii):
    """Coefficients as large as any mass within the reference radius can make them: all of it in a point at the pole."""
    c = np.zeros((61, 61))
    c[:, 0] = (2.0 * np.arange(61) + 1.0) ** -0.5
    full = SphericalHarmonics(GM, RADIUS, c, np.zeros_like(c))
    bounded = replace(full, bounded=True)
    r_A = radii * RADIUS * np.array([[0.0, 0.0, 1.0], [0.6, -0.8, 0.0], [-0.48, 0.6, 0.64]])
    for what in ("potential", "acceleration", "gradient"):
        expected = getattr(full, what)(r_A)
        assert np.abs(getattr(bounded, what)(r_A) - expected).max() <= 2e-15 * np.abs(expected).max()


def test_a_field_that_is_not_bounded_by_its_reference_radius_is_summed_to_the_end():
    c = np.zeros((41, 41))
    c[0, 0], c[40, 0] = 1.0, 1e36
    field = SphericalHarmonics(GM, RADIUS, c, np.zeros_like(c))
    pole_A = np.array([[0.0, 0.0, 10.0 * RADIUS]])
    of_all = GM / (10.0 * RADIUS) * (1.0 + 9.0 * 1e36 * 10.0**-40)  # sqrt(2 * 40 + 1) normalises degree 40
    assert field.potential(pole_A)[0] == pytest.approx(of_all, rel=1e-14)
    cut = replace(field, bounded=True).potential(pole_A)[0]
    assert cut == pytest.approx(GM / (10.0 * RADIUS), rel=1e-14)
