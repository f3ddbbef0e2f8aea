"""The built mesh of Eros against its own table, against NEAR's plate model and against the file in the package."""

from pathlib import Path

import numpy as np
import pytest
from scipy.special import sph_harm_y

from swarm_mj.errors import ShapeError
from swarm_mj.io.resources import asset_path
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape_harmonics import BODIES, build_shape, load_eros, radius_factor, read_harmonics
from swarm_mj.smallbody.shape_io import load_shape, save_shape

NEAR_MODEL = Path(__file__).parents[3] / "shared" / "data" / "eros007790.tab"


@pytest.fixture(scope="module")
def eros():
    return load_eros()


@pytest.mark.parametrize("frequency", [1, 2, 3, 7, 12])
def test_geodesic_icosahedron_covers_the_sphere_evenly(frequency):
    directions, faces = geodesic_icosahedron(frequency)
    assert (len(directions), len(faces)) == (10 * frequency**2 + 2, 20 * frequency**2)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-14)
    a, b, c = (directions[faces[:, k]] for k in range(3))
    doubled_areas = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) / np.linalg.norm(a + b + c, axis=1)
    assert doubled_areas.min() > 0.0
    assert doubled_areas.max() < 2.0 * doubled_areas.min()
    assert np.all(np.diff(np.round(directions[:, 2], 9)) <= 0.0)


@pytest.mark.parametrize("frequency", [0, -3, 501])
def test_frequency_out_of_range_is_refused(frequency):
    with pytest.raises(ShapeError, match="from 1 to 500"):
        geodesic_icosahedron(frequency)


def test_packaged_mesh_has_the_documented_size_and_volume(eros):
    assert (len(eros.vertices), len(eros.faces), len(eros.edges)) == (4002, 8000, 12000)
    assert eros.volume / 1e9 == pytest.approx(2518.15, abs=0.01)
    assert eros.name == "433 Eros"


def test_packaged_mesh_holds_51_vertices_in_the_target_pyramid(eros):
    x, y, z = eros.vertices.T
    side = np.tan(np.radians(20.0)) / np.sqrt(2.0)
    inside = (y > 0.0) & (np.abs(x) <= side * y) & (np.abs(z) <= side * y)
    assert inside.sum() == 51
    assert inside[eros.faces].all(axis=1).sum() == 72


def test_rebuilding_the_mesh_gives_the_packaged_bytes(tmp_path):
    for name in ("first.obj", "second.obj"):
        save_shape(build_shape(), tmp_path / name)
        assert (tmp_path / name).read_bytes() == asset_path("eros.obj").read_bytes()


def test_radius_agrees_with_complex_spherical_harmonics():
    harmonics = read_harmonics()
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    theta, phi = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    expected = np.zeros(20)
    for degree, m, a, b in harmonics:
        wave = sph_harm_y(int(degree), int(m), theta, phi)
        expected += (np.sqrt(2.0) if m else 1.0) * (a * wave.real + b * wave.imag)
    np.testing.assert_allclose(radius_factor(directions, harmonics), expected, rtol=1e-12)


@pytest.mark.skipif(not NEAR_MODEL.exists(), reason="the NEAR plate model is not beside the checkout")
def test_harmonics_lie_within_12_metres_rms_of_the_near_plates():
    near = load_shape(NEAR_MODEL)
    distance = np.linalg.norm(near.face_centroids, axis=1)
    scaled = near.face_centroids / BODIES["eros"].semi_axes_m
    length = np.linalg.norm(scaled, axis=1)
    radial = distance * (radius_factor(scaled / length[:, None], read_harmonics()) / length - 1.0)
    across = radial * np.einsum("ij,ij->i", near.face_normals, near.face_centroids) / distance
    assert np.sqrt(np.average(across**2, weights=near.face_areas)) < 12.5


@pytest.mark.skipif(not NEAR_MODEL.exists(), reason="the NEAR plate model is not beside the checkout")
def test_mesh_and_near_plate_model_enclose_the_same_body(eros):
    near = load_shape(NEAR_MODEL)
    assert eros.volume == pytest.approx(near.volume, rel=4e-3)
    np.testing.assert_allclose(eros.centroid, near.centroid, atol=10.0)
    assert eros.max_radius == pytest.approx(near.max_radius, rel=2e-3)
