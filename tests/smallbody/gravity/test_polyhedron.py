"""The polyhedron against closed forms of a cuboid and a sphere, brute-force integration, and another program."""

from copy import copy

import numpy as np
import pytest

from swarm_mj.errors import ScenarioError, ShapeError
from swarm_mj.scenarios import constants
from swarm_mj.scenarios.constants import GRAVITATIONAL_CONSTANT as G
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.gravity import PointMass, Polyhedron, polyhedron
from swarm_mj.smallbody.gravity.polyhedron import CELL_NUMBERS, write_near_and_far
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_harmonics import build_shape
from swarm_mj.smallbody.solid_angle import points_inside

DENSITY = 2500.0
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
SIDES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip
HALF = np.array([400.0, 700.0, 1000.0])
OUTSIDE = np.array(
    [[900.0, 0, 0], [500.0, 800.0, 1200.0], [-420.0, 10.0, -30.0], [3e4, -2e4, 1e4], [400.0, 700.0, 1400.0]]
)
INSIDE = np.array([[0.0, 0, 0], [100.0, -200.0, 300.0], [-399.0, 699.0, 999.0]])


@pytest.fixture(scope="module")
def cuboid():
    return Polyhedron(ShapeModel(CORNERS * HALF, SIDES), density=DENSITY)


@pytest.fixture(scope="module")
def ball():
    directions, faces = geodesic_icosahedron(16)
    return Polyhedron(ShapeModel(1000.0 * directions, faces), density=DENSITY)


@pytest.fixture(scope="module")
def eros():
    return Polyhedron(build_shape("eros", 8), gm=constants.EROS_GM)


def attraction_of_points(r_A, half=HALF, gm=None, order=12):
    """Attraction of the cuboid as point masses at Gauss-Legendre nodes: terms of one sign, so that nothing cancels far away."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    points = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3) * half
    mass = np.einsum("i,j,k->ijk", weights, weights, weights).ravel() / 8.0
    d = points - r_A[:, None]
    return gm * np.einsum("p,npi->ni", mass, d / np.linalg.norm(d, axis=2, keepdims=True) ** 3)


@pytest.mark.parametrize("distance", [2.2e3, 2.3e3, 2.5e3, 3.3e3, 4e3, 1e4, 1e5, 1e7, 1e10])
def test_attraction_is_exact_from_near_to_as_far_as_anybody_flies(cuboid, distance):
    rng = np.random.default_rng(1)
    directions = rng.standard_normal((30, 3))
    r_A = distance * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    expected = attraction_of_points(r_A, gm=cuboid.gm, order=24)
    for field in (cuboid, cuboid.in_cells):
        error = np.linalg.norm(field.acceleration(r_A) - expected, axis=1) / np.linalg.norm(expected, axis=1)
        assert error.max() < 1e-12


def test_far_attraction_is_that_of_a_point_at_the_centroid_of_thousands_of_faces():
    eros = Polyhedron(build_shape("eros", 16), gm=constants.EROS_GM)
    a, b, c = np.moveaxis(eros.shape.vertices[eros.shape.faces], 1, 0)
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    centroid = volumes @ (a + b + c) / 4.0 / volumes.sum()
    r_A = 1e10 * np.array([[1.0, 0, 0], [0.6, -0.8, 0], [0.0, 0.28, 0.96]])
    d = centroid - r_A
    expected = eros.gm * d / np.linalg.norm(d, axis=1, keepdims=True) ** 3
    assert np.linalg.norm(eros.acceleration(r_A) - expected, axis=1).max() < 1e-9 * np.linalg.norm(expected[0])


def test_the_passage_to_the_far_field_is_smooth_in_potential_attraction_and_gradient(cuboid):
    """Differences of the potential give the attraction, and those of the attraction its gradient, all the way through."""
    radius, direction = cuboid.shape.max_radius, np.array([0.48, -0.6, 0.64])
    for x in np.linspace(1.6, 2.2, 25):
        r_A, h = x * radius * direction, 1e-3 * x * radius
        steps = h * np.vstack((np.eye(3), -np.eye(3)))
        potential, attraction = cuboid.potential(r_A + steps), cuboid.acceleration(r_A + steps)
        slope = (potential[:3] - potential[3:]) / (2.0 * h)
        assert np.allclose(slope, cuboid.acceleration(r_A[None])[0], rtol=1e-5, atol=0.0)
        gradient = (attraction[:3] - attraction[3:]) / (2.0 * h)
        assert np.allclose(gradient, cuboid.gradient(r_A[None])[0], rtol=1e-4, atol=1e-5 * np.abs(gradient).max())


def test_one_of_several_processes_starts_no_threads_for_its_sums(eros, monkeypatch):
    """Workers are told by the environment to keep to one core each; alone a process uses all, with the same sums."""
    started, pool = [], polyhedron.ThreadPoolExecutor
    monkeypatch.setattr(polyhedron, "ThreadPoolExecutor", lambda parts: started.append(parts) or pool(parts))
    monkeypatch.setattr("swarm_mj.io.machine.usable_cores", lambda: 3)
    r_A = np.outer(np.linspace(1.1, 1.7, 1000), eros.shape.max_radius * np.array([0.48, -0.6, 0.64]))
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    alone = eros.acceleration(r_A)
    assert not started
    monkeypatch.delenv("NUMBA_NUM_THREADS")
    assert np.array_equal(eros.acceleration(r_A), alone) and started == [3]


def test_the_far_field_is_kept_on_disk_bit_for_bit_and_not_believed_when_spoilt(cuboid, tmp_path, monkeypatch):
    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path))
    fitted = Polyhedron(cuboid.shape, gm=3.0).far_field
    (file,) = tmp_path.glob("harmonics/*.npy")
    assert np.array_equal(Polyhedron(cuboid.shape, gm=3.0).far_field.c, fitted.c)
    np.save(file, np.load(file)[:, :-1])
    assert np.array_equal(Polyhedron(cuboid.shape, gm=3.0).far_field.s, fitted.s)
    Polyhedron(cuboid.shape, gm=4.0).far_field  # noqa: B018
    assert len(list(tmp_path.glob("harmonics/*.npy"))) == 2


def log_of_sum(y, x, z, r):
    """ln(y + r) without cancellation for negative y; where y + r = 0 its factor in the sum is zero too."""
    conjugate = np.maximum(x * x + z * z, 1e-300) / (r + np.abs(y))
    return np.log(np.where(y > 0.0, y + r, conjugate))


def cuboid_attraction(r_A):
    """Attraction of a homogeneous cuboid (Nagy 1966): per corner x ln(y + r) + y ln(x + r) - z atan(xy / zr), cyclic."""
    total = np.zeros_like(r_A)
    for corner in CORNERS:
        d = corner * HALF - r_A
        r = np.linalg.norm(d, axis=1)
        for axis in range(3):
            z, x, y = d[:, axis], d[:, (axis + 1) % 3], d[:, (axis + 2) % 3]
            term = x * log_of_sum(y, x, z, r) + y * log_of_sum(x, y, z, r) - z * np.arctan(x * y / (z * r + (z == 0.0)))
            total[:, axis] += np.prod(corner) * term
    return -G * DENSITY * total


def cuboid_potential_by_quadrature(r_A, order=60):
    """Gauss-Legendre over the volume, accurate for points well outside."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    x, y, z = np.meshgrid(*(h * nodes for h in HALF), indexing="ij")
    mass = DENSITY * np.prod(HALF) * np.einsum("i,j,k->ijk", weights, weights, weights)
    return np.array([(G * mass / np.sqrt((x - p) ** 2 + (y - q) ** 2 + (z - s) ** 2)).sum() for p, q, s in r_A])


def test_cuboid_attracts_as_its_closed_form_says_outside_and_inside(cuboid):
    r_A = np.vstack([OUTSIDE, INSIDE])
    expected = cuboid_attraction(r_A)
    assert np.abs(cuboid.acceleration(r_A) - expected).max() < 1e-11 * np.abs(expected).max()


def test_cuboid_potential_agrees_with_integration_over_its_volume(cuboid):
    far = OUTSIDE[[0, 1, 3]]
    np.testing.assert_allclose(cuboid.potential(far), cuboid_potential_by_quadrature(far), rtol=1e-10)


def test_fine_sphere_attracts_like_its_mass_outside_and_linearly_inside(ball):
    outside = np.array([[1500.0, 0, 0], [0, -900.0, 2000.0]])
    np.testing.assert_allclose(
        ball.acceleration(outside), PointMass(ball.gm).acceleration(outside), rtol=1e-5, atol=1e-12
    )
    inside = np.array([[300.0, 0.0, 0.0], [100.0, -200.0, 400.0]])
    expected = -4.0 / 3.0 * np.pi * G * DENSITY * inside
    np.testing.assert_allclose(ball.acceleration(inside), expected, rtol=2e-4, atol=1e-10)


def test_laplacian_is_zero_outside_and_poisson_inside(cuboid, eros):
    for field, inside, outside in (
        (cuboid, INSIDE, OUTSIDE),
        (eros, np.array([[0.0, 0, 0], [12e3, 0, 0]]), OUTSIDE * 40),
    ):
        poisson = -4.0 * np.pi * G * field.density
        np.testing.assert_allclose(field.laplacian(inside), poisson, rtol=1e-12)
        np.testing.assert_allclose(field.laplacian(outside), 0.0, atol=1e-12 * abs(poisson))
        np.testing.assert_allclose(np.trace(field.gradient(inside), axis1=1, axis2=2), poisson, rtol=1e-10)


def test_inside_and_outside_are_told_apart_a_micrometre_from_the_surface(cuboid):
    faces = np.array([[400.0, 100.0, 200.0], [-30.0, -700.0, 50.0], [10.0, 20.0, 1000.0]])
    outward = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, 1.0]])
    assert points_inside(faces - 1e-6 * outward, cuboid.shape.vertices, cuboid.shape.faces).all()
    assert not points_inside(faces + 1e-6 * outward, cuboid.shape.vertices, cuboid.shape.faces).any()


def test_gradient_agrees_with_differences_of_the_attraction(cuboid):
    step = 1e-2
    for r_A in (OUTSIDE, INSIDE[:2]):
        gradient = cuboid.gradient(r_A)
        shifts = step * np.eye(3)
        columns = [cuboid.acceleration(r_A + h) - cuboid.acceleration(r_A - h) for h in shifts]
        assert np.abs(gradient - np.stack(columns, axis=-1) / (2 * step)).max() < 1e-7 * np.abs(gradient).max()


@pytest.mark.parametrize(
    "place", [(1.0, 0.2, 0.3), (1.0, 1.0, 0.3), (1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (1.0, 1.0, 2.0)],
    ids=["face", "edge", "corner", "diagonal of two faces", "extension of an edge"],
)  # fmt: skip
def test_attraction_is_finite_and_continuous_on_the_surface(cuboid, place):
    point = np.array(place) * HALF
    on = np.concatenate([cuboid.acceleration(point[None])[0], cuboid.potential(point[None])])
    assert np.isfinite(on).all()
    for direction in np.vstack([np.eye(3), -np.eye(3), [[0.3, -0.5, 0.7]]]):
        beside = (point + 1e-6 * direction)[None]
        near = np.concatenate([cuboid.acceleration(beside)[0], cuboid.potential(beside)])
        assert np.abs(near - on).max() < 1e-6 * np.abs(on).max()


def test_points_close_to_an_edge_lose_no_accuracy(cuboid):
    distance = 10.0 ** np.arange(-9.0, 2.0)
    points = np.array([400.0, 700.0, 123.0]) + distance[:, None] * [0.6, 0.8, 0.0]
    expected = cuboid_attraction(points)
    assert np.abs(cuboid.acceleration(points) - expected).max() < 1e-10 * np.abs(expected).max()


def places_above(height, count=40):
    """Places that are so far from the cuboid: above points of its faces, and aside of its corners."""
    rng, all_of_them = np.random.default_rng(3), np.arange(count)
    below, side, axis = HALF * rng.uniform(-1.0, 1.0, (count, 3)), rng.choice([-1.0, 1.0], (count, 3)), all_of_them % 3
    below[all_of_them, axis] = side[all_of_them, axis] * HALF[axis]
    away = side * np.eye(3)[axis]
    below[::4], away[::4] = side[::4] * HALF, side[::4] * np.array([0.48, 0.6, 0.64])
    return below + height * away


def with_cells(body, cell):
    other = copy(body.in_cells)
    object.__setattr__(other, "cell", cell)
    return other


@pytest.mark.parametrize("height", [1.0, 100.0, 700.0])
def test_what_cells_leave_out_is_of_second_order_and_within_its_bound(cuboid, height):
    coarse, errors = 2.0 ** np.floor(np.log2(height / 32.0)), []
    middles = coarse * np.rint(places_above(height) / coarse)
    for cell in (coarse, 0.5 * coarse):
        way, body = cell * np.array([0.45, -0.3, 0.4]), with_cells(cuboid, cell)
        both = body.acceleration(middles + way) + body.acceleration(middles - way)
        np.testing.assert_allclose(0.5 * both, cuboid.acceleration(middles), rtol=1e-9, atol=1e-18)
        error = body.acceleration(middles + way) - cuboid.acceleration(middles + way)
        errors.append(np.linalg.norm(error, axis=1))
        assert errors[-1].max() <= 12.0 * np.pi * G * DENSITY * (np.sqrt(0.75) * cell) ** 2 / (height - 2.0 * coarse)
    assert np.linalg.norm(errors[0]) / np.linalg.norm(errors[1]) == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("height", [1.0, 100.0, 700.0])
def test_cells_are_so_small_that_the_sums_are_as_exact_as_before(cuboid, height):
    cell = cuboid.in_cells.cell
    assert np.log2(cell) % 1.0 == 0.0 and 2.0**-29 < cell / cuboid.shape.max_radius <= 2.0**-28
    r_A = places_above(height)
    away = np.abs(r_A / cell - np.rint(r_A / cell))
    assert away.max() > 0.3  # not all in the middles
    exact = cuboid.acceleration(r_A)
    error = np.linalg.norm(cuboid.in_cells.acceleration(r_A) - exact, axis=1) / np.linalg.norm(exact, axis=1)
    rounding = np.linalg.norm(exact - cuboid_attraction(r_A), axis=1) / np.linalg.norm(exact, axis=1)
    assert error.max() < max(2.0 * rounding.max(), 1e-13)
    assert cuboid.cell == 0.0 and cuboid.in_cells is cuboid.in_cells.in_cells
    assert np.array_equal(cuboid.in_cells.gradient(r_A), cuboid.gradient(r_A))


def pulled(body, r_A, kept):
    a_A = body.far_field.acceleration(r_A[None])
    write_near_and_far(r_A[None], body.elements, body.cell, kept, a_A)
    return a_A[0]


@pytest.mark.parametrize("radii", [1.2, 1.8, 1.9, 2.5])
def test_attraction_in_cells_depends_on_the_place_alone_whoever_was_there_before(cuboid, radii):
    body, rng = cuboid.in_cells, np.random.default_rng(4)
    directions = rng.standard_normal((10, 3))
    first = radii * body.shape.max_radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    beside = first + 1e-10 * rng.standard_normal((10, 3))
    moved = first[:3] + 10.0 * body.cell * np.eye(3)
    r_A = np.vstack((first, beside, moved))
    r_A[0] = 0.0 if radii < 1.75 else r_A[0]  # where what is kept of no cell would be at home
    expected, kept = body.acceleration(r_A), np.zeros((1, CELL_NUMBERS))
    for i in (*range(23), *range(22, -1, -1), *rng.permutation(23), 0, 20, 1, 21, 2, 22):
        assert np.array_equal(pulled(body, r_A[i], kept), expected[i])


def test_the_sums_of_a_cell_are_taken_once(cuboid):
    body, r_A, kept = cuboid.in_cells, np.array([1300.3, 200.2, -1500.1]), np.zeros((1, CELL_NUMBERS))
    pull = pulled(body, r_A, kept)
    kept[0, 3:6] += 1.0  # to be found again
    np.testing.assert_allclose(pulled(body, r_A + 1e-10, kept), pull + 1.0, rtol=1e-12)
    np.testing.assert_allclose(pulled(body, r_A + 1e-3, kept), pull, rtol=1e-5)


def test_density_and_gravitational_parameter_follow_from_each_other(cuboid):
    assert cuboid.gm == pytest.approx(G * DENSITY * 8 * np.prod(HALF))
    assert Polyhedron(cuboid.shape, gm=cuboid.gm).density == pytest.approx(DENSITY)
    for wrong in ({}, {"density": 1.0, "gm": 1.0}):
        with pytest.raises(ScenarioError, match="exactly one of density"):
            Polyhedron(cuboid.shape, **wrong)
    for wrong in ({"density": 0.0}, {"gm": np.nan}, {"density": -2.0}):
        with pytest.raises(ScenarioError, match="above 0"):
            Polyhedron(cuboid.shape, **wrong)


def test_open_or_inverted_surface_is_refused(cuboid):
    with pytest.raises(ShapeError, match="hole"):
        Polyhedron(ShapeModel(cuboid.shape.vertices, cuboid.shape.faces[1:]), density=DENSITY)
    with pytest.raises(ShapeError, match="inwards"):
        Polyhedron(ShapeModel(cuboid.shape.vertices, cuboid.shape.faces[:, ::-1]), density=DENSITY)


def test_field_agrees_with_the_program_polyhedral_gravity(eros):
    other = pytest.importorskip("polyhedral_gravity")
    body = other.Polyhedron(
        (eros.shape.vertices, eros.shape.faces), eros.density, other.NormalOrientation.OUTWARDS,
        other.PolyhedronIntegrity.DISABLE,
    )  # fmt: skip
    directions = np.random.default_rng(0).standard_normal((12, 3))
    r_A = np.vstack([directions * [2e4, 1e4, 1e4], [[3e3, 100.0, -200.0], [0.0, 0.0, 3e4]]])
    potential, attraction, tensor = zip(*other.evaluate(body, r_A, False), strict=True)
    np.testing.assert_allclose(eros.potential(r_A), potential, rtol=1e-11)
    # That program returns the field with the opposite sign.
    assert np.abs(eros.acceleration(r_A) - np.array(attraction)).max() < 1e-11 * np.abs(attraction).max()
    rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    assert np.abs(eros.gradient(r_A)[:, rows, columns] - np.array(tensor)).max() < 1e-10 * np.abs(tensor).max()


def test_mesh_of_eros_needs_a_plausible_density():
    # NEAR measured 2,670 kg/m^3 +- 30 (Yeomans et al. 2000) with a volume of 2,503 +- 25 km^3.
    assert Polyhedron(build_shape(), gm=constants.EROS_GM).density == pytest.approx(2670.0, abs=30.0)
