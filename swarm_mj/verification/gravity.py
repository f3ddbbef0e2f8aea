"""Gravity: attraction against differences of the potential, Laplace's equation, and one field against another."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module

import numpy as np

from swarm_mj.scenarios import constants
from swarm_mj.smallbody.gravity import PointMass, Polyhedron, SphericalHarmonics, fit_harmonics
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_harmonics import load_eros
from swarm_mj.typing import Array
from swarm_mj.verification.experiment import Bench, experiment

#: Weights of the fourth-order central difference at -2, -1, 1 and 2 steps.
STENCIL = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0
STEP_M = 40.0
#: Degree at which the series of the polyhedron is cut outside 20 km.
FIT_DEGREE = 40


#: Those that know their potential.
Field = PointMass | SphericalHarmonics | Polyhedron


def eros_shape(bench: Bench) -> ShapeModel:
    """The packaged mesh."""
    return load_eros()


def point_mass(bench: Bench) -> Field:
    """The point mass of Eros."""
    return PointMass(constants.EROS_GM)


def harmonics(bench: Bench) -> Field:
    """The measured field of Eros, degree 2."""
    return SphericalHarmonics.eros_degree_2()


def polyhedron(bench: Bench) -> Polyhedron:
    """The homogeneous polyhedron of Eros."""
    return Polyhedron(bench.once(eros_shape), gm=constants.EROS_GM)


def outside(count: int = 60) -> Array:
    """Positions 20 to 60 km from the centre in all directions, shape (count, 3) [m]."""
    rng = np.random.default_rng(1)
    directions = rng.standard_normal((count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True) * rng.uniform(20e3, 60e3, (count, 1))


def differences(values: Array) -> Array:
    """Derivatives along x, y and z from values on the stencil, shape (n, 3, 4, ...) -> (n, 3, ...)."""
    return np.einsum("s,nks...->nk...", STENCIL / STEP_M, values)


def stencil(r_A: Array) -> Array:
    """Positions around each given one, shape (n, 3, 4, 3)."""
    steps = STEP_M * np.array([-2.0, -1.0, 1.0, 2.0])
    return r_A[:, None, None] + steps[:, None] * np.eye(3)[:, None]


def field_gradient_error(make: Callable[[Bench], Field], bench: Bench) -> float:
    """Largest relative difference between attraction and gradient of the potential at 20 to 60 km."""
    field, r_A = bench.once(make), outside()
    around = stencil(r_A)
    expected = differences(field.potential(around.reshape(-1, 3)).reshape(around.shape[:3]))
    return _relative(field.acceleration(r_A), expected)


def divergence_error(field: Field, r_A: Array, expected: float = 0.0) -> float:
    """Largest difference between the attraction's divergence and `expected`, over the size of its terms."""
    around = stencil(r_A)
    tensor = differences(field.acceleration(around.reshape(-1, 3)).reshape(around.shape))
    size = np.linalg.norm(tensor, axis=(1, 2))
    return float(np.max(np.abs(np.trace(tensor, axis1=1, axis2=2) - expected) / size))


def field_divergence_error(make: Callable[[Bench], Field], bench: Bench) -> float:
    """Laplace's equation at 20 to 60 km."""
    return divergence_error(bench.once(make), outside())


@experiment("gravity-poisson-polyhedron", "Poisson's equation: -4 pi G rho", 1e-8)
def inside_error(bench: Bench) -> float:
    """Divergence of the attraction inside the polyhedron, relative to its gradient."""
    body = bench.once(polyhedron)
    expected = -4.0 * np.pi * constants.GRAVITATIONAL_CONSTANT * body.density
    return divergence_error(body, np.random.default_rng(2).uniform(-1e3, 1e3, (20, 3)), expected)


@experiment("gravity-series", f"its spherical harmonics of degree {FIT_DEGREE}, by quadrature", 1e-5)
def series_error(bench: Bench) -> float:
    """Attraction of the polyhedron outside 20 km, relative."""
    body = bench.once(polyhedron)
    series = fit_harmonics(body.potential, body.gm, 16e3, FIT_DEGREE, 20e3)
    return _relative(body.acceleration(outside()), series.acceleration(outside()))


@experiment("gravity-polyhedral-gravity", "program polyhedral_gravity", 1e-10, package="polyhedral_gravity")
def other_program_error(bench: Bench) -> float:
    """Attraction of the polyhedron from 1 km above the surface, relative."""
    other, body = import_module("polyhedral_gravity"), bench.once(polyhedron)
    mesh = other.Polyhedron(
        (body.shape.vertices, body.shape.faces),
        body.density,
        other.NormalOrientation.OUTWARDS,
        other.PolyhedronIntegrity.DISABLE,
    )
    # One kilometre above some faces, and far away.
    near = body.shape.face_centroids[::800] + 1e3 * body.shape.face_normals[::800]
    r_A = np.vstack([near, outside(10)])
    expected = np.array([result[1] for result in other.evaluate(mesh, r_A, False)])
    return _relative(body.acceleration(r_A), expected)


def _relative(measured: Array, expected: Array) -> float:
    return float(np.max(np.linalg.norm(measured - expected, axis=1) / np.linalg.norm(expected, axis=1)))


for _name, _make in (("point-mass", point_mass), ("harmonics", harmonics), ("polyhedron", polyhedron)):
    _whose = f"attraction of the {_name.replace('-', ' ')}"
    experiment(
        f"gravity-{_name}",
        "central differences of the potential",
        1e-8,
        what=f"{_whose.capitalize()} at 20 to 60 km, relative",
    )(partial(field_gradient_error, _make))
    experiment(
        f"gravity-laplace-{_name}",
        "Laplace's equation: 0",
        1e-8,
        what=f"Divergence of the {_whose}, relative to its gradient",
    )(partial(field_divergence_error, _make))
