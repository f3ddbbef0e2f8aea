"""Solid angles and what they say of inside and outside."""

import numpy as np
import pytest
import trimesh

from swarm_mj.smallbody.solid_angle import points_inside, solid_angles


def mesh_of(body):
    return np.asarray(body.vertices, float), np.asarray(body.faces, np.int32)


def test_a_closed_surface_fills_the_sphere_from_inside_and_nothing_from_outside():
    cube = mesh_of(trimesh.creation.box(extents=(2, 2, 2)))
    points = np.array([[0.3, -0.2, 0.999], [0.3, -0.2, 1.001]])
    assert solid_angles(points, *cube) == pytest.approx([4 * np.pi, 0.0], abs=1e-12)


def test_points_inside_agree_with_a_sphere():
    ball = mesh_of(trimesh.creation.icosphere(subdivisions=3, radius=8e3))
    points = np.random.default_rng(2).uniform(-9e3, 9e3, (500, 3))
    radius = np.linalg.norm(points, axis=1)
    inside = points_inside(points, *ball)
    assert inside[radius < 7.9e3].all()
    assert not inside[radius > 8.001e3].any()
