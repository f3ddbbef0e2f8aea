"""Compiled drawing, counting and sampling against brute force in plain numpy: all faces at all pixels, all rays one by one."""

from contextlib import closing

import numpy as np
import pytest

from swarm_mj.observation import faceid
from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.faceid import FaceIdObserver
from swarm_mj.observation.projection import WHOLE_PICTURE, PictureWindow, project
from swarm_mj.observation.raster import CompiledFaces
from swarm_mj.observation.raycast import RayTracer, faces_camera, sampled_fraction

from .scenes import eros_target, random_views

POSE = look_at([0.0, -10.0, 0.0], [0.0, 0.0, 0.0], roll=0.4)
PART = PictureWindow(np.array([-0.35, -0.6]), np.array([0.8, 0.15]))


def pixel_rays(camera, pose, window):
    """Directions through the pixel centres, bottom row first."""
    across, up = ((np.arange(camera.resolution_px) + 0.5) / camera.resolution_px for _ in range(2))
    x = window.low[0] + across * (window.high - window.low)[0]
    y = window.high[1] - up * (window.high - window.low)[1]
    u, v = np.meshgrid(x, y)
    t = camera.tan_half_angle
    return np.stack([t * u, t * v, np.ones_like(u)], axis=-1).reshape(-1, 3) @ pose.C_CA


def nearest_front_face(vertices, faces, camera, pose, window):
    """Face plus one under each pixel, and whether it is clearly the nearest, by solving for every ray and every face."""
    rays = pixel_rays(camera, pose, window)
    best, second = np.full(len(rays), np.inf), np.full(len(rays), np.inf)
    number = np.zeros(len(rays), int)
    for f, (a, b, c) in enumerate(vertices[faces]):
        # rays t = (a - r) + u (b - a) + v (c - a) by Cramer's rule.
        edge, other, start = b - a, c - a, a - pose.r_A
        normal = np.cross(edge, other)
        if normal @ start >= 0.0:
            continue
        facing = rays @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (normal @ start) / facing
            point = rays * t[:, None] - start
            u = np.cross(point, other) @ normal / (normal @ normal)
            v = np.cross(edge, point) @ normal / (normal @ normal)
        hit = (facing < 0.0) & (t > 0.0) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
        nearer = hit & (t < best)
        second = np.where(nearer, best, np.where(hit & (t < second), t, second))
        best, number = np.where(nearer, t, best), np.where(nearer, f + 1, number)
    if camera.shape == "cone":
        x, y, z = (rays @ pose.C_CA.T).T
        number[np.hypot(x, y) > z * camera.tan_half_angle] = 0
    return number, np.isinf(best) | (second > best * (1.0 + 1e-6))


def soup(seed, count):
    """Triangles of all sizes and turns in view, beside it and across the camera's plane."""
    rng = np.random.default_rng(seed)
    depth = 10.0 ** rng.uniform(0.0, 1.5, (count, 1, 1))
    size = depth * 10.0 ** rng.uniform(-2.5, -0.8, (count, 1, 1))
    size[::60] = 0.8 * depth[::60]
    corners_C = depth * rng.uniform([-1.0, -1.0, 1.0], [1.0, 1.0, 1.0], (count, 1, 3)) + size * rng.normal(
        size=(count, 3, 3)
    )
    thin = rng.random(count) < 0.2
    corners_C[thin, 2] = corners_C[thin, 1] + 0.01 * (corners_C[thin, 2] - corners_C[thin, 0])
    return (corners_C @ POSE.C_CA + POSE.r_A).reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


@pytest.mark.parametrize("window", [WHOLE_PICTURE, PART], ids=["whole", "part"])
@pytest.mark.parametrize("shape", ["square", "cone"])
@pytest.mark.parametrize("size", [16, 61, 96])
def test_every_pixel_shows_the_nearest_of_all_faces(size, shape, window):
    camera = CameraModel(half_angle_deg=35.0, resolution_px=size, shape=shape)
    shown = cut = 0
    for seed in range(6):
        vertices, faces = soup(seed, 600)
        drawn = CompiledFaces(vertices, faces, camera).draw(POSE, window).ravel()
        expected, clear = nearest_front_face(vertices, faces, camera, POSE, window)
        assert clear.mean() > 0.99
        assert (drawn[clear] == expected[clear]).all()
        found = np.unique(drawn[drawn > 0]) - 1
        shown += len(found)
        cut += ((vertices[faces[found]] - POSE.r_A) @ POSE.C_CA[2] < 0.0).any(axis=1).sum()
    assert shown > 50
    assert cut > 0


@pytest.mark.parametrize("size", [1, 2, 7, 15, 16, 17, 33, 100])
def test_two_triangles_that_fill_the_picture_leave_no_pixel_out(size):
    corners = np.array([[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]])
    artist = CompiledFaces(20.0 * corners, np.array([[0, 1, 2], [0, 2, 3]]), CameraModel(resolution_px=size))
    for roll in np.linspace(0.0, 6.0, 25):
        picture = artist.draw(look_at([0.0, -10.0, 0.0], [0.0, 0.0, 0.0], roll=roll), WHOLE_PICTURE)
        assert picture.shape == (size, size)
        assert picture.min() > 0
        assert picture.max() <= 2


def test_a_picture_does_not_depend_on_the_one_before():
    vertices, faces = soup(1, 300)
    camera = CameraModel(half_angle_deg=35.0, resolution_px=61)
    artist = CompiledFaces(vertices, faces, camera)
    first = artist.draw(POSE, WHOLE_PICTURE).copy()
    artist.draw(look_at([3.0, -8.0, 2.0], [0.0, 0.0, 0.0]), PART)
    assert (artist.draw(POSE, WHOLE_PICTURE) == first).all()


@pytest.fixture(params=[pytest.param("opengl", marks=pytest.mark.gl), "compiled"])
def drawing(request):
    return request.param


@pytest.mark.parametrize("crop", [True, False])
@pytest.mark.parametrize(("resolution", "shape"), [(512, "square"), (300, "cone")])
def test_no_pixel_of_a_cell_is_missed_when_they_are_counted(resolution, shape, crop, drawing):
    region, camera = eros_target(), CameraModel(resolution_px=resolution, shape=shape)
    counted = 0
    with closing(FaceIdObserver(region, camera, crop=crop, drawing=drawing)) as observer:
        for pose in random_views(8, seed=6, off_deg=20.0):
            fraction = observer.visible_fraction(pose.r_A, pose.C_CA)
            cells = project(pose.to_camera(region.corners_A), camera)
            candidate = cells.in_picture & faces_camera(region, pose)
            if not candidate.any():
                continue
            window = cells.window(candidate) if crop else WHOLE_PICTURE
            pixels = np.bincount(observer.face_ids(pose, window).ravel(), minlength=len(region.faces) + 1)
            area, inradius = cells.pixels(window, resolution)
            large = candidate & cells.ahead & (inradius >= faceid.MIN_INRADIUS_PX)
            expected = np.minimum(pixels[region.target[large] + 1] / area[large], 1.0)
            assert (fraction[large] == expected).all()
            counted += (expected > 0).sum()
    assert counted > 20


def test_thin_cells_are_counted_over_the_whole_picture_with_the_same_result(drawing, monkeypatch):
    region, pose = eros_target(600.0), random_views(1, seed=6)[0]
    with closing(FaceIdObserver(region, CameraModel(), drawing=drawing)) as observer:
        in_boxes = observer.visible_fraction(pose.r_A, pose.C_CA)
        monkeypatch.setattr(faceid, "MAX_BOX_PIXELS", 0.0)
        monkeypatch.setattr(faceid, "count_pixels", None)
        assert (observer.visible_fraction(pose.r_A, pose.C_CA) == in_boxes).all()
    assert in_boxes.max() == 1.0


@pytest.mark.parametrize("window", [WHOLE_PICTURE, PART], ids=["whole", "part"])
def test_boxes_hold_the_cells_with_a_margin_of_one_pixel(window):
    camera = CameraModel(half_angle_deg=35.0, resolution_px=100)
    corners = np.random.default_rng(3).uniform([-3.0, -3.0, 1.0], [3.0, 3.0, 3.0], (500, 1, 3))
    corners = corners + np.random.default_rng(4).uniform(-0.4, 0.4, (500, 3, 3))
    boxes = project(corners, camera).boxes(window, 100)
    x, y = np.moveaxis(corners[..., :2] / corners[..., 2:] / camera.tan_half_angle, -1, 0)
    column = 100 * (x - window.low[0]) / (window.high[0] - window.low[0])
    row = 100 * (window.high[1] - y) / (window.high[1] - window.low[1])
    for at, first, last in ((column, boxes[:, 0], boxes[:, 2]), (row, boxes[:, 1], boxes[:, 3])):
        low, high = at.min(axis=1), at.max(axis=1)
        inside = (high > -1.0) & (low < 101.0)
        assert inside.sum() > 100
        assert (~inside).sum() > 2
        assert (np.abs(first - np.clip(low - 1.0, 0, 100))[inside] <= 1.0).all()
        assert (first <= np.clip(low - 1.0, 0, 100))[inside].all()
        assert (last >= np.clip(high, 0, 99) - 1.0)[inside].all()
        assert (last >= np.floor(np.clip(high, 0, 99)))[inside].all()
        assert (last <= np.clip(high + 1.0, 0, 99))[inside].all()
        assert (first > last)[~inside].all()


def quarter(corners):
    """Four similar triangles of equal area from each, shape (4 n, 3, 3), those of a triangle in a row."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
    return np.moveaxis(parts, 2, 0).reshape(-1, 3, 3)


@pytest.mark.parametrize("shape", ["square", "cone"])
def test_every_sliver_is_judged_by_sixteen_rays_of_its_own(shape, drawing):
    region, camera = eros_target(), CameraModel(resolution_px=300, shape=shape)
    tracer = RayTracer(region.vertices, region.faces, use_embree=False)
    judged = shared = 0
    with closing(FaceIdObserver(region, camera, crop=False, drawing=drawing)) as observer:
        observer.tracer = tracer
        for pose in random_views(5, seed=12, spread_deg=80.0, off_deg=25.0):
            cells = project(pose.to_camera(region.corners_A), camera)
            _, inradius = cells.pixels(WHOLE_PICTURE, 300)
            slivers = np.flatnonzero(cells.in_picture & cells.ahead & (inradius < faceid.MIN_INRADIUS_PX))
            points = quarter(quarter(region.corners_A[slivers])).mean(axis=1)
            hit = tracer.first_hit(pose.r_A, points - pose.r_A)
            reached = (hit >= 0) & (region.parent[hit] == np.repeat(region.parent[region.target[slivers]], 16))
            reached &= camera.contains(pose.to_camera(points))
            outward = ((pose.r_A - region.centroid_A) * region.normal_A).sum(axis=1)[slivers] > 0
            reached &= np.repeat(outward, 16)
            expected = reached.reshape(-1, 16).mean(axis=1)
            assert (observer.visible_fraction(pose.r_A, pose.C_CA)[slivers] == expected).all()
            judged, shared = judged + (expected > 0).sum(), shared + ((expected > 0) & (expected < 1)).sum()
    assert judged > 100
    assert shared > 10


def test_cells_keep_their_order_when_only_some_are_sampled():
    region, camera, pose = eros_target(), CameraModel(), random_views(5, seed=12, spread_deg=80.0)[2]
    tracer, cells = RayTracer(region.vertices, region.faces), np.arange(region.n_cells)
    every = sampled_fraction(tracer, region, cells, camera, pose, 16)
    some = cells[::-3]
    assert (sampled_fraction(tracer, region, some, camera, pose, 16) == every[some]).all()
    assert 0.0 < every.mean() < 1.0


def test_projection_of_many_cells_agrees_with_plain_numpy():
    camera = CameraModel(half_angle_deg=30.0, resolution_px=200)
    corners_C = np.random.default_rng(8).normal(size=(2000, 3, 3)) * [1.0, 1.0, 0.7] + [0.0, 0.0, 1.0]
    cells = project(corners_C, camera)
    depth = corners_C[..., 2]
    assert (cells.ahead == (depth > 0).all(axis=1)).all()
    flat = corners_C[..., :2] / (depth * camera.tan_half_angle)[..., None]
    low, high = flat.min(axis=1), flat.max(axis=1)
    overlaps = ((low < 1) & (high > -1)).all(axis=1)
    assert (cells.in_picture == np.where(cells.ahead, overlaps, (depth > 0).any(axis=1))).all()
    assert 100 < cells.in_picture.sum() < 1900
    area, inradius = cells.pixels(PART, 200)
    corner = (flat * 200 / (PART.high - PART.low))[cells.ahead]
    a, b, c = (np.hypot(*(corner[:, (k + 1) % 3] - corner[:, k]).T) for k in range(3))
    half = (a + b + c) / 2
    plain = np.abs(np.linalg.det(corner[:, 1:] - corner[:, :1])) / 2
    assert area[cells.ahead] == pytest.approx(plain, rel=1e-9)
    assert inradius[cells.ahead] == pytest.approx(plain / half, rel=1e-9)
