"""The mesh quantities against closed forms, and every defect that must be refused."""

import dataclasses

import numpy as np
import pytest

from swarm_mj.errors import ShapeError
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_check import check_shape

CUBE_FACES = [
    [0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
    [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7],
]  # fmt: skip
CUBE_CORNERS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]


def box(sides=(2000.0, 3000.0, 5000.0), centre=(0.0, 0.0, 0.0)):
    vertices = (np.array(CUBE_CORNERS) - 0.5) * sides + centre
    return vertices, np.array(CUBE_FACES)


def sphere(frequency=4, radius=1000.0):
    directions, faces = geodesic_icosahedron(frequency)
    return radius * directions, faces


def test_box_has_the_volume_area_and_centroid_of_its_closed_form():
    shape = check_shape(*box((2000.0, 3000.0, 5000.0), centre=(100.0, -50.0, 20.0)))
    assert shape.volume == pytest.approx(3e10, rel=1e-14)
    assert shape.surface_area == pytest.approx(2 * (6e6 + 15e6 + 10e6), rel=1e-14)
    np.testing.assert_allclose(shape.centroid, [100.0, -50.0, 20.0], rtol=1e-12)
    assert shape.max_radius == pytest.approx(np.linalg.norm([1100.0, 1550.0, 2520.0]), rel=1e-14)
    assert len(shape.edges) == 18
    assert shape.face_areas.sum() == pytest.approx(shape.surface_area)


def test_centroid_of_a_tetrahedron_is_the_mean_of_its_corners():
    vertices = np.array([[0, 0, 0], [3, 0, 0], [0, 5, 0], [0, 0, 7.0]])
    shape = ShapeModel(vertices, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    np.testing.assert_allclose(shape.centroid, vertices.mean(axis=0), rtol=1e-14)
    assert shape.volume == pytest.approx(3 * 5 * 7 / 6)


def test_normals_of_a_sphere_point_outwards():
    shape = check_shape(*sphere())
    radial = shape.face_centroids / np.linalg.norm(shape.face_centroids, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", radial, shape.face_normals).min() > 0.99
    assert np.einsum("ij,ij->i", shape.vertices / 1000.0, shape.vertex_normals).min() > 0.99
    np.testing.assert_allclose(np.linalg.norm(shape.face_normals, axis=1), 1.0, rtol=1e-14)


def test_shape_is_immutable_and_copies_what_it_is_given():
    vertices, faces = box()
    shape = ShapeModel(vertices, faces)
    vertices[0] = 7.0
    assert shape.vertices[0, 0] == -1000.0
    for array in (shape.vertices, shape.faces, shape.face_normals, shape.face_areas, shape.edges, shape.centroid):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        shape.name = "other"
    assert (shape.vertices.dtype, shape.faces.dtype) == (np.float64, np.int32)


def test_arrays_of_another_shape_are_refused():
    with pytest.raises(ShapeError, match=r"vertices must have shape \(n, 3\), got \(4,\)"):
        ShapeModel([1.0, 2.0, 3.0, 4.0], [[0, 1, 2]])
    with pytest.raises(ShapeError, match="faces .*whole numbers"):
        ShapeModel(np.zeros((3, 3)), [[0.5, 1, 2]])
    with pytest.raises(ShapeError, match="faces must be numbers"):
        ShapeModel(np.zeros((3, 3)), [["a", "b", "c"]])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_vertex_that_is_not_finite_is_named(value):
    vertices, faces = box()
    vertices[5, 1] = value
    with pytest.raises(ShapeError, match="vertex 5 .*not finite"):
        check_shape(vertices, faces)


def test_absurdly_distant_vertex_is_refused_before_anything_overflows():
    vertices, faces = box()
    vertices[5, 1] = 1e200
    with pytest.raises(ShapeError, match="no body"):
        check_shape(vertices, faces)


@pytest.mark.parametrize("index", [8, -1, 2**32, 2**40])
def test_face_with_an_index_out_of_range_is_named(index):
    vertices, faces = box()
    faces = faces.astype(np.int64)
    faces[7, 2] = index
    with pytest.raises(ShapeError, match="face 7 uses vertices .*only 8"):
        check_shape(vertices, faces)


def test_point_cloud_is_refused():
    with pytest.raises(ShapeError, match="no faces"):
        check_shape(np.ones((4, 3)), np.empty((0, 3)))


def test_vertex_without_faces_is_named():
    vertices, faces = box()
    with pytest.raises(ShapeError, match="vertex 8 belongs to no face.*remove_unreferenced_vertices"):
        check_shape(np.vstack([vertices, [[0.0, 0.0, 0.0]]]), faces)


def test_face_without_area_is_named():
    vertices, faces = box()
    repeated = np.vstack([faces, [[0, 0, 1]]])
    with pytest.raises(ShapeError, match=r"face 12 \(vertices \[0, 0, 1\]\) has no area"):
        check_shape(vertices, repeated)
    vertices, faces = sphere()
    faces_with_needle = np.vstack([faces, [[0, 1, len(vertices)]]])
    middle = vertices[[0, 1]].mean(axis=0)
    with pytest.raises(ShapeError, match=f"face {len(faces)} .*has no area"):
        check_shape(np.vstack([vertices, middle]), faces_with_needle)


def test_hole_is_named_by_a_face_and_the_vertices_of_its_open_edge():
    vertices, faces = sphere()
    removed = set(faces[10].tolist())
    with pytest.raises(ShapeError, match="fill_holes") as caught:
        check_shape(vertices, np.delete(faces, 10, axis=0))
    words = str(caught.value).replace("(", " ").split()
    named = {int(words[words.index("vertices") + 1]), int(words[words.index("and") + 1])}
    assert named <= removed
    assert "3 such edges" in str(caught.value)
    face = int(words[words.index("face") + 1])
    assert named <= set(np.delete(faces, 10, axis=0)[face].tolist())


def test_edge_shared_by_three_faces_is_named():
    vertices, faces = box()
    pocket = np.vstack([faces, faces[3:4], faces[3:4][:, ::-1]])
    with pytest.raises(ShapeError, match="not a manifold .3 such edges.*unique_faces") as caught:
        check_shape(vertices, pocket)
    assert any(f"{vertices[i][0]:g}, {vertices[i][1]:g}, {vertices[i][2]:g}" in str(caught.value) for i in faces[3])


@pytest.mark.parametrize("turned", [0, 37, 100])
def test_single_turned_face_is_the_one_that_is_named(turned):
    vertices, faces = sphere()
    faces[turned] = faces[turned, ::-1]
    with pytest.raises(ShapeError, match=f"face {turned} winds against its neighbours.*fix_normals"):
        check_shape(vertices, faces)


def test_inside_out_body_is_refused():
    vertices, faces = box()
    with pytest.raises(ShapeError, match="point inwards.*fix_inversion"):
        check_shape(vertices, faces[:, ::-1])


def test_two_bodies_in_one_mesh_are_refused_naming_the_smaller():
    vertices, faces = sphere(frequency=4)
    moon, moon_faces = sphere(frequency=1, radius=100.0)
    with pytest.raises(ShapeError, match=f"2 separate surfaces; face {len(faces)} .*split"):
        check_shape(np.vstack([vertices, moon + 3000.0]), np.vstack([faces, moon_faces + len(vertices)]))


def test_origin_far_from_the_body_is_refused():
    vertices, faces = box()
    with pytest.raises(ShapeError, match="centroid .*center_mass"):
        check_shape(vertices + [0.0, 9000.0, 0.0], faces)


def test_kilometres_taken_for_metres_are_recognised():
    vertices, faces = sphere(radius=17.7)
    with pytest.raises(ShapeError, match='kilometres taken for metres: pass unit="km"'):
        check_shape(vertices, faces)
    assert check_shape(vertices, faces, expect_radius_m=(10.0, 30.0)).max_radius == pytest.approx(17.7)


def test_metres_taken_for_kilometres_are_recognised():
    vertices, faces = sphere(radius=17.7e6)
    with pytest.raises(ShapeError, match='metres taken for kilometres: pass unit="m"'):
        check_shape(vertices, faces)


def test_the_centroid_of_a_pyramid_lies_a_quarter_of_its_height_above_its_base():
    # The mean of the five vertices lies a fifth above it, and that of the faces elsewhere again.
    vertices = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0], [0, 0, 8]], float)
    faces = [[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    pyramid = ShapeModel(100.0 * vertices, faces)
    assert pyramid.volume == pytest.approx(4e4 * 800.0 / 3)
    assert pyramid.centroid == pytest.approx([0.0, 0.0, 200.0])


def test_the_normal_at_a_corner_of_a_tetrahedron_is_against_that_of_the_face_beyond():
    # The area vectors of a closed surface add up to nothing.
    vertices = np.array([[0, 0, 0], [3, 0, 0], [1, 5, 0], [0.5, 0.3, 7.0]])
    shape = ShapeModel(vertices, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    for vertex, opposite in ((0, 2), (1, 3), (2, 1), (3, 0)):
        np.testing.assert_allclose(shape.vertex_normals[vertex], -shape.face_normals[opposite], rtol=1e-12, atol=1e-15)
