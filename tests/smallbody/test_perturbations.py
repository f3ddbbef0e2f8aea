"""Perturbations against exact arithmetic and independent formulas."""

from fractions import Fraction

import numpy as np
import pytest

from swarm_mj.scenarios.constants import AU, EROS_GM, GM_SUN
from swarm_mj.smallbody.gravity import PointMass
from swarm_mj.smallbody.perturbations import gravity_gradient_torque, solar_radiation_pressure, solar_tide

SUN = np.array([1.2, -0.9, 0.3]) * AU
R = np.array([[20e3, -5e3, 11e3], [0.0, 0.0, -30e3], [1.0, 2.0, 3.0], [4e9, 1e9, -2e9]])


def exact_tide(r, sun):
    """gm ((s - r)/|s - r|^3 - s/|s|^3) with 60-digit square roots."""
    from decimal import Decimal, localcontext

    with localcontext() as context:
        context.prec = 60
        r, sun = ([Decimal(float(x)) for x in v] for v in (r, sun))
        away = [s - x for s, x in zip(sun, r, strict=True)]
        cubes = [sum(x * x for x in v).sqrt() ** 3 for v in (away, sun)]
        return [float(Decimal(GM_SUN) * (a / cubes[0] - s / cubes[1])) for a, s in zip(away, sun, strict=True)]


def test_solar_tide_keeps_its_digits_however_near_the_asteroid():
    expected = np.array([exact_tide(r, SUN) for r in R])
    np.testing.assert_allclose(solar_tide(R, SUN, GM_SUN), expected, rtol=1e-13)
    np.testing.assert_array_equal(solar_tide(np.zeros((1, 3)), SUN, GM_SUN), [[0.0, 0.0, 0.0]])


def test_solar_tide_stretches_along_the_sun_line_twice_as_much_as_it_squeezes_across():
    distance = 1.7 * AU
    tide = solar_tide(np.array([[1e4, 0, 0], [0, 1e4, 0]]), np.array([distance, 0, 0]), GM_SUN)
    unit = GM_SUN * 1e4 / distance**3
    np.testing.assert_allclose(tide, [[2 * unit, 0, 0], [0, -unit, 0]], rtol=1e-6, atol=1e-6 * unit)


def test_radiation_pressure_is_4_54_micropascal_at_1_au_and_falls_with_the_square():
    sun = np.array([[AU, 0.0, 0.0], [0.0, -2 * AU, 0.0]])
    near, far = (solar_radiation_pressure(np.zeros((1, 3)), s, 0.034, 8.0, 1.0)[0] for s in sun)
    pressure = float(Fraction(1361, 299_792_458))
    np.testing.assert_allclose(near, [-pressure * 0.034 / 8.0, 0.0, 0.0], rtol=1e-14)
    assert pressure == pytest.approx(4.54e-6, rel=1e-3)
    np.testing.assert_allclose(far, [0.0, pressure * 0.034 / 32.0, 0.0], rtol=1e-14)


def test_radiation_pressure_scales_with_reflectivity_and_area_over_mass():
    one = solar_radiation_pressure(R, SUN, 0.034, 8.0, 1.3)
    np.testing.assert_allclose(solar_radiation_pressure(R, SUN, 0.068, 4.0, 2.6), 8.0 * one, rtol=1e-14)


def test_gravity_gradient_torque_is_that_of_many_points_of_mass():
    rng = np.random.default_rng(2)
    half, half_masses = rng.standard_normal((500, 3)) * [0.05, 0.1, 0.2], rng.random(500)
    # Mirrored through the centre of mass, so that the next term, odd in the size over the distance, vanishes.
    points, masses = np.vstack([half, -half]), np.tile(half_masses, 2) * 4.0 / half_masses.sum()
    inertia = np.einsum("k,kij->ij", masses, [np.dot(p, p) * np.eye(3) - np.outer(p, p) for p in points])
    # So near that the differences of the field across the spacecraft are not lost in rounding.
    r_BN_B = np.array([[300.0, -200.0, 150.0], [0.0, 500.0, 10.0]])
    for r, torque in zip(r_BN_B, gravity_gradient_torque(r_BN_B, np.stack([inertia] * 2), EROS_GM), strict=True):
        forces = masses[:, None] * PointMass(EROS_GM).acceleration(r + points)
        expected = np.cross(points, forces).sum(axis=0)
        assert np.linalg.norm(torque - expected) < 1e-5 * np.linalg.norm(expected)


def test_gravity_gradient_torque_vanishes_along_a_principal_axis():
    inertia = np.diag([0.08, 0.08, 0.013])[None]
    np.testing.assert_array_equal(gravity_gradient_torque(np.array([[0.0, 0.0, 2e4]]), inertia, EROS_GM), [[0.0, 0, 0]])
