"""What stands between two points, against the solution of three linear equations for every face."""

import numpy as np
import pytest

from swarm_mj.compilation import kernel
from swarm_mj.smallbody.occultation import occluder_of, segments_blocked, way_blocked
from swarm_mj.smallbody.shape import ShapeModel

#: One triangle on its own: a closed body hides many a mistake behind its other side.
TRIANGLE = ShapeModel(np.array([[300.0, -400.0, 200.0], [-500.0, 100.0, 250.0], [200.0, 600.0, -100.0]]), [[0, 1, 2]])


@kernel
def each_way_blocked(starts, ends, body):
    blocked = np.empty(len(starts), np.bool_)
    for i in range(len(starts)):
        blocked[i] = way_blocked(starts[i], ends[i], body)
    return blocked


def crossings(shape, starts, ends):
    """start + s way = a + u (b - a) + v (c - a), face by face."""
    blocked = np.zeros(len(starts), bool)
    for a, b, c in shape.vertices[shape.faces]:
        for i, (start, end) in enumerate(zip(starts, ends, strict=True)):
            u, v, s = np.linalg.solve(np.column_stack([b - a, c - a, start - end]), start - a)
            blocked[i] |= u >= 0 and v >= 0 and u + v <= 1 and 0 < s < 1
    return blocked


@pytest.fixture(scope="module")
def segments():
    rng = np.random.default_rng(4)
    return rng.uniform(-700.0, 700.0, (2, 3000, 3))


@pytest.mark.parametrize("stretch", [1.0, 0.5])
def test_a_triangle_stands_between_the_ends_of_those_segments_alone_that_cross_it(segments, stretch):
    starts, ends = segments[0], segments[0] + stretch * (segments[1] - segments[0])
    expected = crossings(TRIANGLE, starts, ends)
    assert 50 < expected.sum() < 1000
    found = segments_blocked(starts, ends, TRIANGLE.vertices, TRIANGLE.faces, TRIANGLE.max_radius)
    assert np.array_equal(found, expected)
    assert np.array_equal(each_way_blocked(starts, ends, occluder_of(TRIANGLE)), expected)


def test_ends_on_the_surface_do_not_count():
    corner, middle = TRIANGLE.vertices[0], TRIANGLE.vertices.mean(axis=0)
    away = np.array([0.0, 0.0, 1e3])
    starts, ends = np.array([middle, middle - away, corner]), np.array([middle + away, middle, corner - away])
    assert not segments_blocked(starts, ends, TRIANGLE.vertices, TRIANGLE.faces, TRIANGLE.max_radius).any()
