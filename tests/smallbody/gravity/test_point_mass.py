"""The point mass against Newton's law, and what all fields have in common."""

import dataclasses

import numpy as np
import pytest

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios import constants
from swarm_mj.smallbody.gravity import Gravity, PointMass, Polyhedron, SphericalHarmonics
from swarm_mj.smallbody.shape_harmonics import build_shape


@pytest.fixture(scope="module")
def fields():
    return {
        "point mass": PointMass(constants.EROS_GM),
        "degree 2": SphericalHarmonics.eros_degree_2(),
        "polyhedron": Polyhedron(build_shape("eros", 6), gm=constants.EROS_GM),
    }


FIELDS = ("point mass", "degree 2", "polyhedron")


def around(radius, count, seed=0):
    directions = np.random.default_rng(seed).standard_normal((count, 3))
    return radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def derivative(function, r_A, step):
    """Fourth-order central differences of a scalar or vector field along x, y and z, stacked last."""
    shifts = step * np.eye(3)
    near = [function(r_A + h) - function(r_A - h) for h in shifts]
    far = [function(r_A + 2 * h) - function(r_A - 2 * h) for h in shifts]
    return np.stack([(8 * a - b) / (12 * step) for a, b in zip(near, far, strict=True)], axis=-1)


def test_point_mass_attracts_by_the_inverse_square():
    field = PointMass(4.0e5)
    np.testing.assert_allclose(field.acceleration(np.array([[0.0, 2e4, 0.0]])), [[0.0, -1e-3, 0.0]], rtol=1e-15)
    np.testing.assert_allclose(field.potential(np.array([[0.0, 0.0, -2e4]])), [20.0], rtol=1e-15)


@pytest.mark.parametrize("name", FIELDS)
def test_attraction_is_the_gradient_of_the_potential(fields, name):
    r_A = around(19e3, 40)
    attraction = fields[name].acceleration(r_A)
    expected = derivative(fields[name].potential, r_A, 20.0)
    assert np.abs(attraction - expected).max() < 1e-9 * np.abs(attraction).max()


@pytest.mark.parametrize("name", FIELDS)
def test_divergence_and_curl_of_the_attraction_vanish_outside(fields, name):
    tensor = derivative(fields[name].acceleration, around(19e3, 40, seed=1), 20.0)
    size = np.abs(tensor).max()
    assert np.abs(np.trace(tensor, axis1=1, axis2=2)).max() < 1e-8 * size
    assert np.abs(tensor - tensor.transpose(0, 2, 1)).max() < 1e-8 * size


@pytest.mark.parametrize("name", FIELDS)
def test_every_field_tends_to_the_point_mass_far_away(fields, name):
    r_A = around(2e7, 10)
    expected = PointMass(constants.EROS_GM).acceleration(r_A)
    assert np.abs(fields[name].acceleration(r_A) - expected).max() < 1e-4 * np.abs(expected).max()


@pytest.mark.parametrize("name", FIELDS)
def test_every_field_fits_the_protocol_and_takes_any_array_of_positions(fields, name):
    field = fields[name]
    assert isinstance(field, Gravity)
    r_A = around(25e3, 6)
    expected = field.acceleration(r_A)
    assert expected.shape == (6, 3) and expected.flags.c_contiguous
    np.testing.assert_array_equal(field.acceleration(np.asfortranarray(r_A)), expected)
    np.testing.assert_array_equal(field.acceleration(np.repeat(r_A, 2, axis=0)[::2]), expected)
    np.testing.assert_array_equal(field.acceleration(r_A[2:3]), expected[2:3])
    assert field.acceleration(np.empty((0, 3))).shape == (0, 3)
    with pytest.raises(ValueError, match=r"shape \(n, 3\), got \(3,\)"):
        field.acceleration(r_A[0])


@pytest.mark.parametrize("name", FIELDS)
def test_fields_cannot_be_changed(fields, name):
    with pytest.raises(dataclasses.FrozenInstanceError):
        fields[name].gm = 1.0


@pytest.mark.parametrize("gm", [0.0, -1.0, np.nan, np.inf])
def test_gravitational_parameter_must_be_positive(gm):
    for make in (PointMass, lambda gm: SphericalHarmonics.from_coefficients(gm, 16e3, {})):
        with pytest.raises(ScenarioError, match="gravity.gm = .*above 0"):
            make(gm)
