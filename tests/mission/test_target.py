"""The target region against closed forms and against polygon clipping on the gnomonic plane."""

from functools import cache

import numpy as np
import pytest
import shapely

from swarm_mj.errors import MissionError
from swarm_mj.mission.mesh_cut import Cuts, cut_mesh, refine_mesh
from swarm_mj.mission.target import (
    automatic_cell_size,
    build_target,
    check_visiting_points,
    local_axes,
)
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_harmonics import build_shape

PAPER = dict(latitude_deg=0.0, longitude_deg=90.0, half_angle_deg=20.0)


@cache
def eros():
    return build_shape()


@cache
def eros_target(**changes):
    return build_target(eros(), **({"least_part": 0.0} | PAPER | changes))


def box(half_sides=(1.0, 1.0, 1.0)):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return ShapeModel(corners * half_sides, np.array(faces), "box")


def flat_target():
    """The square |x|, |z| <= 2 tan(60 deg) on the face y = 2 of a box."""
    shape = box((5.0, 2.0, 5.0))
    fine = ShapeModel(*refine_mesh(shape.vertices, shape.faces, np.full(12, True), 1.1)[:2])
    return build_target(fine, latitude_deg=0, longitude_deg=90, half_angle_deg=60, edges="side", least_part=0.0)


def is_closed(faces):
    directed = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    edges = set(map(tuple, directed.tolist()))
    return len(edges) == len(directed) and all((b, a) in edges for a, b in edges)


def gnomonic_area(shape, axes, slope):
    """Area of the surface inside the pyramid: clip on the plane tangent to the axis, then map back to each face."""
    east, north, up = axes
    total = 0.0
    for corners in shape.vertices[shape.faces]:
        height = corners @ up
        if (height <= 0).any():
            continue
        flat = shapely.Polygon(np.column_stack([corners @ east, corners @ north]) / height[:, None])
        part = flat.intersection(shapely.box(-slope, -slope, slope, slope))
        if part.is_empty or part.geom_type != "Polygon":
            continue
        xy = shapely.get_coordinates(part)[:-1]
        rays = xy[:, :1] * east + xy[:, 1:] * north + up
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        points = rays * ((normal @ corners[0]) / (rays @ normal))[:, None]
        fan = np.cross(points[1:-1] - points[0], points[2:] - points[0]).sum(axis=0)
        total += np.linalg.norm(fan) / 2
    return total


def polygons(region):
    """Numbers of the original mesh faces that lie at least partly, and wholly, inside the pyramid."""
    inside, everywhere = (
        np.bincount(region.parent[region.target], minlength=region.parent.max() + 1),
        np.bincount(region.parent),
    )
    return int((inside > 0).sum()), int((inside == everywhere).sum())


def test_the_target_of_the_paper_on_eros():
    region = eros_target()
    assert region.n_faces == region.n_cells == 170
    assert (*polygons(region), region.n_visiting) == (134, 72, 51)
    assert region.total_area == pytest.approx(14.61e6, rel=1e-4)
    assert np.degrees(region.side_half_angle) == pytest.approx(14.43, abs=0.01)


@pytest.mark.parametrize(
    ("latitude", "longitude", "half_angle", "edges"),
    [(0, 90, 20, "corner"), (0, 90, 20, "side"), (35, -120, 9, "corner"), (90, 40, 25, "corner"), (-90, 0, 60, "side")],
)
def test_the_target_area_is_that_of_the_polygons_clipped_on_the_gnomonic_plane(latitude, longitude, half_angle, edges):
    where = {"latitude_deg": latitude, "longitude_deg": longitude, "half_angle_deg": half_angle, "edges": edges}
    region = build_target(eros(), **where, least_part=0.0)
    slope = np.tan(np.radians(half_angle)) / (np.sqrt(2) if edges == "corner" else 1.0)
    exact = gnomonic_area(eros(), local_axes(latitude, longitude), slope)
    assert region.total_area == pytest.approx(exact, rel=1e-9)
    # By default pieces of less than a hundredth of their face are left out, and nothing else.
    by_default = build_target(eros(), **where)
    assert 0.999 * exact < by_default.total_area < exact
    share = region.area / eros().face_areas[region.parent[region.target]]
    assert by_default.total_area == pytest.approx(region.area[share >= 0.01].sum(), rel=1e-12)
    assert by_default.n_cells == (share >= 0.01).sum()


@pytest.mark.parametrize("cell_size", [None, 245.0])
def test_cutting_keeps_the_mesh_closed_and_its_volume_and_area(cell_size):
    region = eros_target(cell_size_m=cell_size)
    assert is_closed(region.faces)
    assert region.mesh.volume == pytest.approx(eros().volume, rel=1e-12)
    assert region.mesh.surface_area == pytest.approx(eros().surface_area, rel=1e-12)
    assert (region.vertices[: len(eros().vertices)] == eros().vertices).all()


@pytest.mark.parametrize("cell_size", [None, 245.0])
def test_pieces_lie_on_their_original_face_and_keep_its_orientation(cell_size):
    region = eros_target(cell_size_m=cell_size)
    normal = eros().face_normals[region.parent]
    height = np.einsum("fcd,fd->fc", region.vertices[region.faces], normal)
    ground = np.einsum("fd,fd->f", eros().vertices[eros().faces[region.parent, 0]], normal)
    assert np.abs(height - ground[:, None]).max() < 1e-9
    large = region.mesh.face_areas > 1.0
    assert np.einsum("ij,ij->i", region.mesh.face_normals, normal)[large].min() > 1 - 1e-9
    assert np.bincount(region.parent, region.mesh.face_areas) == pytest.approx(eros().face_areas, rel=1e-10)


def test_visiting_points_are_the_vertices_inside_in_mesh_order():
    region = eros_target()
    x, y, z = eros().vertices.T
    slope = np.tan(np.radians(20)) / np.sqrt(2)
    expected = np.flatnonzero((y > 0) & (np.abs(x) <= slope * y) & (np.abs(z) <= slope * y))
    assert (region.visiting_vertex == expected).all()
    assert len(expected) == 51


def test_corner_edges_lie_at_the_half_angle():
    region = eros_target()
    corners = region.vertices[np.unique(region.faces[region.target])]
    angle = np.degrees(np.arccos(corners @ region.axes_A[2] / np.linalg.norm(corners, axis=1)))
    assert angle.max() == pytest.approx(20.0, abs=1e-9)


def test_side_planes_lie_at_the_half_angle():
    region = eros_target(edges="side")
    corners = region.vertices[np.unique(region.faces[region.target])]
    tilt = np.degrees(np.arctan2(np.abs(corners @ region.axes_A[0]), corners @ region.axes_A[2]))
    assert tilt.max() == pytest.approx(20.0, abs=1e-9)


def test_the_pyramid_cuts_a_square_out_of_a_box():
    region = flat_target()
    assert region.total_area == pytest.approx((2 * 2 * np.tan(np.pi / 3)) ** 2, rel=1e-14)
    assert region.normal_A == pytest.approx(np.tile([0.0, 1.0, 0.0], (region.n_cells, 1)))


def test_planes_through_vertices_and_edges_make_no_slivers():
    shape = box()
    vertices, faces, parent = cut_mesh(
        shape.vertices, shape.faces, Cuts(np.array([[1, 1, 0], [1, -1, 0]]) / np.sqrt(2))
    )
    assert is_closed(faces)
    assert ShapeModel(vertices, faces).face_areas.min() > 0.1
    with pytest.raises(MissionError, match="no mesh vertex"):
        build_target(box(), latitude_deg=0, longitude_deg=0, half_angle_deg=20)
    touching = build_target(box(), latitude_deg=0, longitude_deg=0, half_angle_deg=45, edges="side")
    assert (touching.total_area, touching.n_visiting) == (pytest.approx(4.0, rel=1e-14), 4)


def test_the_axes_are_right_handed_east_north_up_even_at_the_poles():
    assert local_axes(0, 90) == pytest.approx(np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0]]), abs=1e-15)
    for latitude, longitude in ((90, 30), (-90, 30), (12, 200)):
        east, north, up = local_axes(latitude, longitude)
        assert np.cross(east, north) == pytest.approx(up, abs=1e-15)
    assert local_axes(90, 30)[0] == pytest.approx(local_axes(89.9999, 30)[0], abs=1e-5)


def test_radial_visiting_points_stand_above_their_vertex():
    region = eros_target()
    points, ground = region.visiting_points_A(14e3), eros().vertices[region.visiting_vertex]
    assert np.linalg.norm(points, axis=1) - np.linalg.norm(ground, axis=1) == pytest.approx(14e3, rel=1e-12)
    assert np.abs(np.cross(points, ground)).max() < 1e-6


def test_normal_visiting_points_stand_straight_above_flat_ground_and_radial_ones_do_not():
    region = flat_target()
    ground = region.vertices[region.visiting_vertex]
    up = np.tile([0.0, 7.0, 0.0], (len(ground), 1))
    assert region.visiting_points_A(7.0, projection="normal") - ground == pytest.approx(up, abs=1e-12)
    assert np.abs(region.visiting_points_A(7.0) - ground - up).max() > 1.0


def test_visiting_points_at_imaging_altitude_pass_and_a_sunken_one_is_named():
    points = eros_target().visiting_points_A(14e3)
    check_visiting_points(eros(), points)
    points[6] *= 0.2
    with pytest.raises(MissionError, match=r"visiting point 7 at .* below the surface"):
        check_visiting_points(eros(), points)


def test_cells_divide_the_target_without_changing_it():
    whole, fine = eros_target(), eros_target(cell_size_m=245.0)
    assert (fine.n_faces, *polygons(fine)) == (170, 134, 72)
    assert np.bincount(fine.group, fine.area) == pytest.approx(whole.area, rel=1e-9)
    assert (fine.parent[fine.target] == whole.parent[whole.target][fine.group]).all()
    edges = np.roll(fine.corners_A, -1, axis=1) - fine.corners_A
    assert np.linalg.norm(edges, axis=2).max() <= 245.0


def test_refining_one_face_splits_its_neighbours_along():
    shape = box()
    chosen = np.arange(12) == 0
    vertices, faces, parent = refine_mesh(shape.vertices, shape.faces, chosen, 0.3)
    assert is_closed(faces)
    assert np.bincount(parent, ShapeModel(vertices, faces).face_areas) == pytest.approx(shape.face_areas, rel=1e-14)
    edges = np.roll(vertices[faces[parent == 0]], -1, axis=1) - vertices[faces[parent == 0]]
    assert np.linalg.norm(edges, axis=2).max() <= 0.3


def test_the_camera_of_the_paper_needs_no_cells_and_a_narrow_one_does():
    edges = np.roll(eros_target().corners_A, -1, axis=1) - eros_target().corners_A
    longest = np.linalg.norm(edges, axis=2).max()
    assert automatic_cell_size(14e3, 21.5) > longest
    assert automatic_cell_size(14e3, 3.0) == pytest.approx(2 * 14e3 * np.tan(np.radians(3)) / 6)


def test_a_target_without_a_vertex_is_refused():
    with pytest.raises(MissionError, match="no mesh vertex"):
        build_target(eros(), latitude_deg=0.0, longitude_deg=91.5, half_angle_deg=0.5)


def test_a_target_off_the_body_is_refused():
    away = ShapeModel(box().vertices + [10.0, 0.0, 0.0], box().faces, "box beside the origin")
    with pytest.raises(MissionError, match="target off the body"):
        build_target(away, latitude_deg=0, longitude_deg=180, half_angle_deg=20)
    assert build_target(away, latitude_deg=0, longitude_deg=0, half_angle_deg=20).n_visiting == 8
