"""Small pictures against rays of their own, face by face in double precision, and against what Lambert's law says."""

import numpy as np
import pytest

from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.photometry import radiance_factors, surface_of
from swarm_mj.observation.thumbnails import ThumbnailDrawer
from swarm_mj.scenarios.schema_photometry import Photometry

SIDE, HALF_DEG = 64, 30.0


def blob(seed=1, rings=9, turns=16):
    """A lumpy closed body of some 220 faces, radius about 1 km, with a hollow that hides parts of it."""
    rng = np.random.default_rng(seed)
    latitude = np.linspace(-0.5, 0.5, rings)[1:-1] * np.pi
    longitude = np.arange(turns) * 2.0 * np.pi / turns
    b, along = np.meshgrid(latitude, longitude, indexing="ij")
    radius = 1e3 * (1.0 + 0.3 * np.cos(2.0 * along) * np.cos(b) + 0.04 * rng.standard_normal(b.shape))
    ring = np.stack([np.cos(b) * np.cos(along), np.cos(b) * np.sin(along), np.sin(b)], -1) * radius[..., None]
    vertices = np.vstack([ring.reshape(-1, 3), [[0, 0, -900.0], [0, 0, 900.0]]])
    faces, last = [], len(vertices) - 2
    for i in range(rings - 3):
        for j in range(turns):
            a, b_, c, d = (
                i * turns + j,
                i * turns + (j + 1) % turns,
                (i + 1) * turns + j,
                (i + 1) * turns + (j + 1) % turns,
            )
            faces += [(a, b_, d), (a, d, c)]
    top = (rings - 3) * turns
    for j in range(turns):
        faces += [(last, (j + 1) % turns, j), (last + 1, top + j, top + (j + 1) % turns)]
    return vertices, np.array(faces)


def first_hits(origin, rays, vertices, faces):
    """Nearest face and its ray parameter by Moeller and Trumbore, every ray with every face; -1 and inf for none."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    e1, e2, s = b - a, c - a, origin - a
    q = np.cross(s, e1)
    det = rays @ np.cross(e2, e1).T
    with np.errstate(divide="ignore"):
        u, v = rays @ np.cross(e2, s).T / det, rays @ q.T / det
        t = (e2 * q).sum(1) / det
    t = np.where((u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0), t, np.inf)
    who, best = t.argmin(1), t.min(1)
    return np.where(best < np.inf, who, -1).reshape(SIDE, SIDE), best.reshape(SIDE, SIDE)


@pytest.fixture(scope="module")
def drawer():
    return ThumbnailDrawer(*blob(), CameraModel(half_angle_deg=HALF_DEG, resolution_px=SIDE))


def drawn(drawer, poses, light=None, marked=None):
    out = drawer.blank(len(poses))
    marked = np.ones((1, len(blob()[1])), bool) if marked is None else marked
    lights = None if light is None else np.tile(light, (len(poses), 1))
    drawer.draw(np.array([p.r_A for p in poses]), np.array([p.C_CA for p in poses]), lights, marked, out)
    return out


def rays_of(pose):
    """Through the centres of the pixels, by rows from the top, Z = 1, in A, shape (SIDE^2, 3)."""
    tan = np.tan(np.radians(HALF_DEG))
    at = (np.arange(SIDE) + 0.5) / SIDE * 2.0 - 1.0
    y, x = np.meshgrid(at * tan, at * tan, indexing="ij")  # y down, as rows
    return np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3) @ pose.C_CA


def test_silhouette_depth_and_shade_are_those_of_rays(drawer):
    vertices, faces = blob()
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    light = np.array([0.6, -0.5, 0.3])
    light /= np.linalg.norm(light)
    marked = np.random.default_rng(0).uniform(size=len(faces)) < 0.5
    poses = [
        look_at([2600.0, 900.0, 400.0], [100.0, 0.0, -200.0], roll=0.7),
        look_at([-300.0, 1900.0, -1500.0], [400.0, 300.0, 0.0], roll=-2.0),
        look_at([900.0, -900.0, 300.0], [0.0, 600.0, 500.0], roll=0.1),  # near, with parts behind the camera
    ]
    pictures = drawn(drawer, poses, light, marked[None])
    for k, pose in enumerate(poses):
        who, depth = first_hits(pose.r_A, rays_of(pose), vertices, faces)
        body, seen = who >= 0, pictures.depth[k] > 0.0
        assert 0.05 < body.mean() < 0.95 or k == 2
        assert (body != seen).sum() <= 2  # a centre on an edge, to rounding
        both = body & seen
        relative = np.abs(pictures.depth[k][both] / depth[both] - 1.0)
        assert np.quantile(relative, 0.995) < 1e-6
        same = np.isclose(pictures.depth[k], np.where(body, depth, 0.0), rtol=1e-6)
        shade = np.maximum(0.0, normals[who] @ light)
        agree = np.isclose(pictures.grey[k], np.where(body, shade, 0.0), atol=1e-5) & (
            pictures.mask[k] == (marked[who] & body)
        )
        assert agree[same].mean() > 0.995  # the other face of an edge may win where their depths are equal


def test_light_follows_the_law_and_the_body_shades_itself():
    """Against the law for the face's normal, and rays from each place to the Sun, with all faces but its own."""
    vertices, faces = blob()
    surface = surface_of(
        Photometry(law="lunar_lambert", albedo=0.2, phase_exponents=(-0.02, 0.0, 0.0), partition=(-0.01, 0.0, 0.0))
    )
    drawer = ThumbnailDrawer(vertices, faces, CameraModel(half_angle_deg=HALF_DEG, resolution_px=SIDE), surface)
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    poses = [
        look_at([2600.0, 900.0, 400.0], [0.0, 0.0, 0.0], roll=0.7),
        look_at([300.0, 2600.0, -500.0], [0.0, 0.0, 0.0]),
    ]
    shaded = 0
    for light in ([0.2, 0.95, 0.1], [0.9, 0.1, 0.3]):
        light = np.array(light) / np.linalg.norm(light)
        pictures = drawn(drawer, poses, light)
        for k, pose in enumerate(poses):
            rays = rays_of(pose)
            who, depth = (each.ravel() for each in first_hits(pose.r_A, rays, vertices, faces))
            hit = np.flatnonzero(who >= 0)
            place = pose.r_A + depth[hit, None] * rays[hit]
            back = -rays[hit] / np.linalg.norm(rays[hit], axis=1, keepdims=True)
            n = normals[who[hit]]
            grey = np.zeros(len(who))
            grey[hit] = radiance_factors(surface, n @ light, np.einsum("nk,nk->n", n, back), back @ light)
            for pixel, point in zip(hit, place, strict=True):
                other = np.delete(faces, who[pixel], axis=0)
                covered = grey[pixel] > 0.0 and crossed(point, light, vertices, other)
                shaded += covered
                grey[pixel] = 0.0 if covered else grey[pixel]
            same = np.isclose(pictures.grey[k].ravel(), grey, atol=2e-5)
            assert same.mean() > 0.985
    assert shaded > 200


def crossed(origin, direction, vertices, faces):
    """Whether a ray meets any face."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    e1, e2, s = b - a, c - a, origin - a
    p, q = np.cross(direction, e2), np.cross(s, e1)
    det = np.einsum("nk,nk->n", e1, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v, t = np.einsum("nk,nk->n", s, p) / det, q @ direction / det, np.einsum("nk,nk->n", e2, q) / det
    return bool(((u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 1e-6)).any())


def test_a_light_at_the_camera_lights_all_that_is_seen(drawer):
    (grey,), _, (depth,) = drawn(drawer, [look_at([3000.0, 0.0, 0.0], [0.0, 0.0, 0.0])])
    assert (grey[depth > 0.0] > 0.0).all() and (grey[depth == 0.0] == 0.0).all()
    assert grey[SIDE // 2, SIDE // 2] > 0.7


def test_the_right_is_right_and_the_top_is_up(drawer):
    pose = look_at(
        [3000.0, 0.0, 0.0], [0.0, -900.0, 0.0]
    )  # +y of A is to the right of a camera on +x: aim left of the body
    (_, (mask,), _) = drawn(drawer, [pose])
    x = pose.to_camera(np.zeros(3))
    column, row = (SIDE * (0.5 + 0.5 * part / x[2] / np.tan(np.radians(HALF_DEG))) for part in x[:2])
    rows, columns = np.nonzero(mask)
    assert abs(columns.mean() + 0.5 - column) < 3.0 and abs(rows.mean() + 0.5 - row) < 3.0
    assert abs(column - SIDE / 2) > 10.0
    pose = look_at([3000.0, 0.0, 0.0], [0.0, 0.0, 900.0])  # aims above: the body is low in the picture, at large rows
    rows, _ = np.nonzero(drawn(drawer, [pose]).mask[0])
    assert rows.mean() > SIDE / 2 + 8


def test_pictures_do_not_depend_on_those_before_and_none_is_left_where_the_body_is_out_of_sight(drawer):
    pose, away = look_at([3000.0, 0.0, 0.0], [0.0, 0.0, 0.0]), look_at([3000.0, 0.0, 0.0], [6000.0, 0.0, 0.0])
    aside = look_at([3000.0, 0.0, 0.0], [2000.0, 3000.0, 0.0])
    many, alone = drawn(drawer, [pose, away, aside, pose]), drawn(drawer, [pose])
    for part, one in zip(many, alone, strict=True):
        assert np.array_equal(part[0], one[0]) and np.array_equal(part[3], one[0])
        assert not part[1].any() and not part[2].any()
    reused = drawn(drawer, [pose])
    drawer.draw(away.r_A[None], away.C_CA[None], None, np.ones((1, len(blob()[1])), bool), reused)
    assert not any(part.any() for part in reused)


def test_the_bounding_sphere_never_hides_what_rays_find(drawer):
    vertices, faces = blob()
    rng, empty = np.random.default_rng(5), 0
    for _ in range(60):
        r = rng.standard_normal(3)
        r *= rng.uniform(1400.0, 4000.0) / np.linalg.norm(r)
        pose = look_at(r, r + rng.standard_normal(3) * 1000.0, roll=rng.uniform(0.0, 6.0))
        found = drawn(drawer, [pose]).depth[0] > 0.0
        corners = pose.to_camera(vertices)
        inside = (corners[:, 2] > 0) & (
            np.abs(corners[:, :2]).max(1) < 0.95 * np.tan(np.radians(HALF_DEG)) * corners[:, 2]
        )
        empty += not found.any()
        assert found.any() or not inside.any()
    assert 10 < empty < 50
