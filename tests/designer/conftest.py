"""Random geometric cover problems: discs over a triangulated patch, as footprints lie on a target."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from swarm_mj.designer.problem import CoverProblem


def disc_problem(seed, n_points=None, n_vertices=94, radius=None, **parameters):
    """Faces of a triangulated unit square, each seen from the points whose disc holds its centre."""
    rng = np.random.default_rng(seed)
    corners = rng.random((n_vertices, 2))
    corners = corners[Delaunay(corners).simplices]
    edges = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.abs(np.linalg.det(edges))
    n_points = int(rng.integers(50, 201)) if n_points is None else n_points
    radius = rng.uniform(0.17, 0.36) if radius is None else radius
    offset = rng.random((n_points, 1, 2)) - corners.mean(axis=1)
    return CoverProblem(sees=np.linalg.norm(offset, axis=2) < radius, area=area, **parameters)


@pytest.fixture(scope="session")
def make_discs():
    return disc_problem


@pytest.fixture
def rng():
    return np.random.default_rng(20190501)
