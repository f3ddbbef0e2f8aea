"""Polygons against closed forms on the sphere and against clipping by shapely on other bodies; bad ones are refused."""

import json
import os
from functools import cache

import numpy as np
import pytest
import shapely
import trimesh

from swarm_mj.errors import MissionError
from swarm_mj.mission.mesh_cut import refine_mesh
from swarm_mj.mission.polygon import polygon_from
from swarm_mj.mission.target import Pyramid, WholeBody, build_targets, local_axes, whole_body
from swarm_mj.scenarios.schema import Target
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape import ShapeModel, directed_edges
from swarm_mj.smallbody.shape_harmonics import build_ellipsoid

deg = np.radians


def frame(west, east, south, north):
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


def polygon(*rings, **keys):
    return polygon_from(Target(region="polygon", polygon=rings, **keys))


@cache
def ball():
    """A coarse one: edges of 9 deg, so that borders cross faces."""
    return ShapeModel(1000.0 * geodesic_icosahedron(8)[0], geodesic_icosahedron(8)[1], "ball")


@cache
def ring():
    mesh = trimesh.creation.torus(1100.0, 400.0, major_sections=24, minor_sections=12)
    return ShapeModel(mesh.vertices, mesh.faces, "ring")


def solid_angle(region):
    """Sum over the cells (van Oosterom and Strackee 1983), which does not know of the mesh's curvature."""
    a, b, c = np.moveaxis(region.corners_A, 1, 0)
    x, y, z = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    dots = [np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a))]
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    return float(2.0 * np.arctan2(volume, x * y * z + dots[0] * z + dots[1] * x + dots[2] * y).sum())


BANDS = {
    "a frame": ([frame(10, 40, 20, 50)], deg(30) * (np.sin(deg(50)) - np.sin(deg(20)))),
    "over the antimeridian": ([frame(170, 200, -20, 50)], deg(30) * (np.sin(deg(50)) + np.sin(deg(20)))),
    "a zone": ([frame(-180, 180, -10, 30)], 2 * np.pi * (np.sin(deg(10)) + np.sin(deg(30)))),
    "around the north pole": ([frame(-180, 180, 60, 90)], 2 * np.pi * (1 - np.sin(deg(60)))),
    "around the south pole": ([frame(0, 360, -90, -75)], 2 * np.pi * (1 - np.sin(deg(75)))),
    "an octant": ([frame(0, 90, 0, 90)], np.pi / 2),
    "with a hole": (
        [frame(0, 60, 0, 60), frame(20, 30, 20, 30)],
        deg(60) * np.sin(deg(60)) - deg(10) * (np.sin(deg(30)) - np.sin(deg(20))),
    ),
    # Below the straight line latitude = longitude / 2: the integral of sin(longitude / 2).
    "below a slanted edge": ([[[0, 0], [80, 0], [80, 40], [0, 0]]], 2 * (1 - np.cos(deg(40)))),
}


@pytest.mark.parametrize("name", BANDS)
def test_a_polygon_on_a_ball_has_its_area_in_closed_form(name):
    rings, exact = BANDS[name]
    region = build_targets(ball(), [polygon(*rings)], kind="polygon")
    assert solid_angle(region) == pytest.approx(exact, rel=2e-4)
    edges = np.sort(directed_edges(region.mesh.faces), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()  # closed as before
    assert region.mesh.face_areas.sum() == pytest.approx(ball().face_areas.sum(), rel=1e-12)


def clipped_area(shape, ring_deg):
    """Area of the surface below a ring whose edges are sampled finely, clipped face by face in longitude and latitude.

    Faces are split until the bend of their edges on that map no longer matters.
    """
    vertices, faces, _ = refine_mesh(shape.vertices, shape.faces, np.ones(len(shape.faces), bool), 40.0)
    corners = vertices[faces]
    corners = corners[corners[..., 0].min(axis=1) > 0.0]  # far from where longitudes jump
    x, y, z = np.moveaxis(corners, -1, 0)
    flat = np.degrees(np.stack((np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))), axis=-1))
    cells, inside = shapely.polygons(flat), shapely.Polygon(ring_deg)
    share = shapely.area(shapely.intersection(cells, inside)) / shapely.area(cells)
    return float(
        share @ np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    )


RING = [[-30, -15], [45, -8], [30, 10], [5, 2], [-20, 14], [-30, -15]]


@pytest.mark.parametrize(
    "shape", [ring, lambda: build_ellipsoid((900.0, 700.0, 500.0), "egg", 8)], ids=["torus", "ellipsoid"]
)
def test_the_area_is_that_of_polygon_clipping(shape):
    """A ray through a torus meets it twice and more: each crossing belongs to the target."""
    exact = clipped_area(shape(), RING)
    assert build_targets(shape(), [polygon(RING)]).total_area == pytest.approx(exact, rel=2e-3)


def test_what_a_polygon_holds_is_what_shapely_says_of_its_map():
    places = np.column_stack(
        (np.random.default_rng(1).uniform(-60, 60, 2000), np.random.default_rng(2).uniform(-30, 30, 2000))
    )
    directions = np.array([local_axes(latitude, longitude)[2] for longitude, latitude in places])
    inside = shapely.contains_xy(shapely.Polygon(RING), *places.T)
    near = shapely.distance(shapely.points(places), shapely.LineString(RING)) < 0.01
    assert 100 < inside.sum() < 1900
    assert (polygon(RING).holds(directions) == inside)[~near].all()


def test_a_turned_polygon_lies_elsewhere_and_is_as_large():
    from dataclasses import replace

    here, turn = polygon(RING), local_axes(50.0, 120.0).T @ local_axes(0.0, 0.0)
    there = replace(here, turn=turn)
    assert there.axes[2] == pytest.approx(turn @ here.axes[2])
    areas = [solid_angle(build_targets(ball(), [p])) for p in (here, there)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-9)


def test_the_pyramid_about_a_polygon_is_the_least_that_holds_it():
    angle = polygon(frame(-10, 10, -10, 10)).half_angle
    # Its corners stand farthest north: tan(10 deg) / cos(10 deg) of the axis.
    assert np.tan(angle) == pytest.approx(np.tan(deg(10)) / np.cos(deg(10)), rel=1e-6)
    assert polygon(frame(-180, 180, -10, 30)).half_angle == np.pi


def test_overlapping_features_count_once_by_the_largest_weight():
    crater = Pyramid(0.0, 0.0, 20.0, weight=5.0)
    region = build_targets(ball(), [WholeBody(), crater], kind="body")
    alone = build_targets(ball(), [crater])
    assert region.total_area == pytest.approx(whole_body(ball()).total_area)
    assert region.total_weighted_area == pytest.approx(region.total_area + 4.0 * alone.total_area, rel=1e-3)
    assert set(region.weight[region.cells_of(1)]) == {5.0}
    assert region.is_weighted and not alone.is_weighted


@pytest.mark.parametrize(
    ("rings", "words"),
    [
        ([[[0, 0], [20, 0], [0, 10], [10, 10], [0, 0]]], "cross: give its corners in order"),
        ([[[0, 0], [10, 0], [10, 10], [0, 10], [1, 0]]], "is open: its last corner must be its first, [0, 0]"),
        ([frame(0, 10, 0, 10), frame(20, 30, 0, 10)], "ring 2 is no hole in ring 1"),
        ([frame(179, -179, 0, 5)], "let longitudes run on past 180"),
        ([[[0, 0], [10, 0], [0, 0], [0, 0]]], "ring 1 encloses nothing"),
        ([[[-200, 0], [-60, 0], [100, 0], [180, 0], [0, 10], [-120, 10], [-200, 0]]], "at most 360"),
    ],
)
def test_a_polygon_that_means_nothing_is_refused_in_words(rings, words):
    with pytest.raises(MissionError) as refusal:
        polygon(*rings)
    assert words in str(refusal.value)


def test_geojson_of_every_kind_is_read(tmp_path):
    one, two = (
        {"type": "Polygon", "coordinates": [frame(0, 10, 0, 10)]},
        [[frame(0, 10, 0, 10)], [frame(20, 30, 0, 10)]],
    )
    several = {"type": "MultiPolygon", "coordinates": two}
    feature = {"type": "Feature", "properties": {}, "geometry": one}
    for data, count in (
        (one, 1),
        (several, 2),
        (feature, 1),
        ({"type": "FeatureCollection", "features": [feature] * 3}, 3),
    ):
        file = tmp_path / "place.geojson"
        file.write_text(json.dumps(data))
        assert len(polygon_from(Target(region="polygon", polygon_file=str(file))).polygons) == count


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"type": "Point", "coordinates": [0, 0]}', '{"type": "Polygon", "coordinates": [[1, 2]]}',
             '{"type": "Polygon", "coordinates": [[[0, 0], [10, 0], [10, 95], [0, 0]]]}',
             '{"type": "FeatureCollection", "features": []}', '{"type": "Feature", "geometry": null}'],
)  # fmt: skip
def test_a_file_that_holds_no_polygon_is_refused_by_its_name(tmp_path, text):
    file = tmp_path / "bad.geojson"
    file.write_text(text)
    with pytest.raises(MissionError, match=r"bad\.geojson"):
        polygon_from(Target(region="polygon", polygon_file=str(file)))


def test_a_path_that_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with open(tmp_path / "huge", "wb") as huge:
        huge.truncate(10**9)
    for name, words in (("nothing", "no such file"), ("pipe", "named pipe"), ("huge", "larger than"), ("", "folder")):
        with pytest.raises(MissionError, match=words):
            polygon_from(Target(region="polygon", polygon_file=str(tmp_path / name)))


def test_slivers_of_a_border_do_not_make_a_polygons_typical_cell():
    """Pieces at its sides are most of its cells and little of its area; whole faces of the mesh are what is typical."""
    region = build_targets(ball(), [polygon(frame(-20, 20, -20, 20))], kind="polygon")
    whole = float(np.median(ball().face_areas))
    assert np.median(region.area) < 0.5 * whole
    assert region.typical_area == pytest.approx(whole, rel=0.3)
    larger = region.area[region.area > region.typical_area].sum()
    assert larger <= 0.5 * region.total_area < larger + region.area[region.area == region.typical_area].sum()
