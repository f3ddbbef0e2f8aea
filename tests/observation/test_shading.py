"""Shaded pictures against rays, one by one, through the same mesh."""

import numpy as np
import pytest
import trimesh

from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.lens import Distortion, lens_of
from swarm_mj.observation.photometry import radiance_factors, surface_of
from swarm_mj.observation.raycast import RayTracer
from swarm_mj.observation.shading import ShadedBody
from swarm_mj.scenarios.schema_photometry import SETS, Photometry

HAPKE = surface_of(Photometry(**SETS["eros"]))
SUN = 1e11 * np.array([1.0, 0.5, 0.3])


def two_balls():
    """A body whose parts shade each other."""
    parts = [trimesh.creation.icosphere(3, radius) for radius in (1000.0, 500.0)]
    parts[1].apply_translation([1500.0, 700.0, 300.0])
    mesh = trimesh.util.concatenate(parts)
    return np.array(mesh.vertices), np.array(mesh.faces)


def traced(vertices, faces, surface, lens, pose, along, albedo=1.0):
    """Radiance factors of a picture by rays, several along each pixel."""
    tracer = RayTracer(vertices, faces)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    at = (np.arange(lens.width * along) + 0.5) / along, (np.arange(lens.height * along) + 0.5) / along
    columns, rows = np.meshgrid(*at)
    image = lens.to_image(np.stack((columns, rows), -1)).reshape(-1, 2)
    sight = np.column_stack((image, np.ones(len(image)))) @ pose.C_CA
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    face = tracer.first_hit(np.broadcast_to(pose.r_A, sight.shape), sight)
    hit = face >= 0
    n, d = normals[face[hit]], sight[hit]
    t = np.einsum("nk,nk->n", n, corners[face[hit], 0] - pose.r_A) / np.einsum("nk,nk->n", n, d)
    point, to_sun = pose.r_A + t[:, None] * d, SUN / np.linalg.norm(SUN)
    above = point + 1e-6 * 1000.0 * n
    lit = tracer.first_hit(above, np.broadcast_to(to_sun, above.shape)) < 0
    mu0, mu = n @ to_sun, -np.einsum("nk,nk->n", n, d)
    value = np.zeros(len(face))
    value[hit] = np.where(lit, albedo * radiance_factors(surface, mu0, mu, -d @ to_sun), 0.0)
    number = np.full(len(face), -1)
    number[hit] = face[hit]
    shape = lens.height, along, lens.width, along
    return value.reshape(shape).mean(axis=(1, 3)), number.reshape(shape), lit


@pytest.fixture(scope="module")
def scene():
    vertices, faces = two_balls()
    lens = lens_of(CameraModel(half_angle_deg=12.0, resolution_px=64, sides=(1.0, 0.75)))
    return vertices, faces, lens, look_at([-2000.0, 9000.0, 2500.0], [500.0, 300.0, 100.0], roll=0.4)


@pytest.mark.parametrize("surface", [HAPKE, surface_of(Photometry(law="lambert", albedo=1.0))])
def test_pictures_are_those_of_rays_with_cast_shadows(scene, surface):
    vertices, faces, lens, pose = scene
    # Both so fine that places of samples do not matter, which are others.
    drawn = ShadedBody(vertices, faces, surface).draw(lens, pose, SUN, samples=32).astype(float)
    expected, _, _ = traced(vertices, faces, surface, lens, pose, 28)
    assert drawn.sum() == pytest.approx(expected.sum(), rel=5e-4)
    off = np.abs(drawn - expected) / expected.max()
    assert off.max() < 1.0 / 64 and np.quantile(off, 0.99) < 1e-3
    without = ShadedBody(vertices[:642], faces[:1280], surface).draw(lens, pose, SUN, samples=32)
    shadow = without - drawn
    assert (shadow > 0.3 * expected.max()).sum() > 20  # one ball shades the other


@pytest.mark.parametrize(("turn", "most"), [(0.0, 1e-5), (0.2, 1e-3), (0.6, 3e-3), (np.pi / 2.0, 1e-5)])
def test_pixels_that_an_edge_parts_have_its_share_of_light(turn, most):
    # A plate of two halves, one half as bright, that faces a camera whose pixels see 1 m.
    half = np.array([[0.0, -1.0], [1.0, -1.0], [1.0, 1.0], [0.0, 1.0]]) * [4.3, 3.7]
    cosine, sine = np.cos(turn), np.sin(turn)
    corners = np.vstack((half * [-1.0, 1.0], half)) @ np.array([[cosine, sine], [-sine, cosine]])
    plate = np.column_stack((corners, np.zeros(8)))[[0, 1, 2, 3, 5, 6]]
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 5], [0, 5, 3]])
    body = ShadedBody(plate, faces, surface_of(Photometry(law="lambert", albedo=1.0)), np.array([0.5, 0.5, 1.0, 1.0]))
    lens = lens_of(CameraModel(half_angle_deg=10.0, resolution_px=24))
    pose = look_at([0.13, -0.21, lens.focal_px], [0.13, -0.21, 0.0])
    finest = body.draw(lens, pose, [0.0, 0.0, 1.0], samples=43).astype(float)
    assert finest.sum() == pytest.approx(0.75 * 4.0 * 4.3 * 3.7, rel=2e-5)
    off = np.sort(np.abs(body.draw(lens, pose, [0.0, 0.0, 1.0], samples=4) - finest).ravel())
    # But for pixels where edges meet, or leave one for the next: a part of one sample of 16.
    assert off[-13] < most and off[-1] < 0.5 / 16


def test_the_outermost_outline_bounds_the_body():
    # A plate between two narrower ones nearer to the camera, whose edges lie a fifth of a sample within its own.
    lens = lens_of(CameraModel(half_angle_deg=10.0, resolution_px=24))
    square = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    near = lens.focal_px - 1.0
    vertices = np.vstack(
        [
            square * [half * far / lens.focal_px, half * far / lens.focal_px, 0.0] + [0.0, 0.0, lens.focal_px - far]
            for half, far in ((4.25, near), (4.3, lens.focal_px), (4.25, near - 1.0))
        ]
    )
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    body = ShadedBody(
        vertices, np.vstack((faces, faces + 4, faces + 8)), surface_of(Photometry(law="lambert", albedo=1.0))
    )
    drawn = body.draw(lens, look_at([0.0, 0.0, lens.focal_px], [0.0, 0.0, 0.0]), [0.0, 0.0, 1.0], samples=4).astype(
        float
    )
    assert drawn[12, 7] == pytest.approx(0.3, abs=1e-4) and drawn[7, 12] == pytest.approx(0.3, abs=1e-4)


def test_a_bent_lens_shows_what_rays_through_it_meet(scene):
    vertices, faces, lens, pose = scene
    bent = lens_of(CameraModel(half_angle_deg=12.0, resolution_px=64), Distortion(k1=-0.8, p1=0.02))
    body = ShadedBody(vertices, faces, HAPKE)
    expected, number, _ = traced(vertices, faces, HAPKE, bent, pose, 9)
    drawn = body.draw(bent, pose, SUN, samples=12).astype(float)
    assert np.abs(drawn - expected).max() < 0.06 * expected.max()  # samples lie elsewhere along edges
    assert drawn.sum() == pytest.approx(expected.sum(), rel=3e-3)
    assert (body.labels(bent, pose, SUN).face == number[:, 4, :, 4]).mean() > 0.97  # to an eighth of a pixel


def test_labels_tell_what_is_under_the_centre_of_each_pixel(scene):
    vertices, faces, lens, pose = scene
    body = ShadedBody(vertices, faces, HAPKE)
    labels = body.labels(lens, pose, SUN)
    _, number, _ = traced(vertices, faces, HAPKE, lens, pose, 1)
    assert (labels.face == number[:, 0, :, 0]).mean() > 0.998
    hit = labels.face >= 0
    rows, columns = np.nonzero(hit)
    image = lens.to_image(np.column_stack((columns + 0.5, rows + 0.5)))
    points = np.column_stack((image, np.ones(len(image)))) * labels.depth[hit][:, None] @ pose.C_CA + pose.r_A
    plane = vertices[faces[labels.face[hit], 0]]
    assert np.abs(np.einsum("nk,nk->n", labels.normal[hit], points - plane)).max() < 1e-2
    to_sun, to_camera = SUN / np.linalg.norm(SUN), pose.r_A - points
    to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
    assert np.allclose(labels.phase[hit], np.degrees(np.arccos(to_camera @ to_sun)), atol=1e-3)
    assert np.allclose(np.cos(np.radians(labels.incidence[hit])), labels.normal[hit] @ to_sun, atol=1e-6)
    assert not labels.lit[hit][labels.incidence[hit] > 90.0].any() and labels.lit.any()


def test_far_away_and_close_up_the_light_adds_up(scene):
    vertices, faces, _, _ = scene
    body = ShadedBody(vertices, faces, HAPKE)
    lens = lens_of(CameraModel(half_angle_deg=5.0, resolution_px=128))
    near = look_at([-2e4, 9e4, 2.5e4], [0.0, 0.0, 0.0])
    far = look_at([-2e6, 9e6, 2.5e6], [0.0, 0.0, 0.0])
    light = [float(body.draw_spread(lens, pose, SUN, 0.6).sum()) for pose in (near, far)]
    assert light[1] == pytest.approx(1e-4 * light[0], rel=0.02)  # a fifth of a pixel
    close = body.draw(lens, look_at([0.0, 1010.0, 0.0], [0.0, 0.0, 0.0]), SUN)
    assert np.isfinite(close).all() and (close > 0.0).all()
    behind = look_at([0.0, 9000.0, 0.0], [0.0, 20_000.0, 0.0])
    assert not body.draw(lens, behind, SUN).any() and (body.labels(lens, behind, SUN).face < 0).all()


def test_a_small_bodys_place_within_a_pixel_is_kept(scene):
    vertices, faces, _, _ = scene
    body, lens = ShadedBody(vertices, faces, HAPKE), lens_of(CameraModel(half_angle_deg=5.0, resolution_px=128))
    at = np.arange(128) + 0.5
    for k in range(4):
        pose = look_at([-2e6, 9e6, 2.5e6], [700.0 * k, 1100.0 * k, 400.0 * k])
        drawn = body.draw_spread(lens, pose, SUN, 0.6).astype(float)
        centre = np.array([drawn.sum(axis=0) @ at, drawn.sum(axis=1) @ at]) / drawn.sum()
        finer = body.draw(lens.zoomed(np.array([56, 56]), np.array([72, 72]), 32), pose, SUN).astype(float)
        fine = np.arange(512) + 0.5
        expected = 56 + np.array([finer.sum(axis=0) @ fine, finer.sum(axis=1) @ fine]) / finer.sum() / 32
        assert np.abs(centre - expected).max() < 0.01


def test_faces_have_their_own_albedo_and_vertices_may_move(scene):
    vertices, faces, lens, pose = scene
    plain = ShadedBody(vertices, faces, HAPKE)
    half = ShadedBody(vertices, faces, HAPKE, np.full(len(faces), 0.5))
    assert np.allclose(half.draw(lens, pose, SUN), 0.5 * plain.draw(lens, pose, SUN), rtol=1e-5)
    half.move(vertices + [0.0, 0.0, 400.0])
    moved = look_at(pose.r_A + [0.0, 0.0, 400.0], [500.0, 300.0, 500.0], roll=0.4)
    assert np.allclose(half.draw(lens, moved, SUN), 0.5 * plain.draw(lens, pose, SUN), atol=2e-3)


def test_shadows_that_are_kept_are_those_of_the_light_and_the_place(scene):
    vertices, faces, lens, pose = scene

    def fresh(places, camera, sun):
        return ShadedBody(places, faces, HAPKE).draw(lens, camera, sun)

    body, other = ShadedBody(vertices, faces, HAPKE), np.array([-0.2, 1.0, -0.9])
    near = look_at([1600.0, 1700.0, 250.0], [1500.0, 700.0, 300.0])
    for camera, sun in ((pose, SUN), (pose, other), (near, SUN), (pose, SUN)):
        assert np.array_equal(body.draw(lens, camera, sun), fresh(vertices, camera, sun))
        body.depths(lens, camera)
    squeezed = vertices * [1.0, 1.0, 0.4]
    body.move(squeezed)
    assert np.array_equal(body.draw(lens, pose, SUN), fresh(squeezed, pose, SUN))


def test_no_light_falls_between_the_faces_of_what_is_far_above():
    balls = [trimesh.creation.icosphere(4, radius) for radius in (1000.0, 600.0)]
    balls[1].apply_translation(-2500.0 * SUN / np.linalg.norm(SUN))
    mesh = trimesh.util.concatenate(balls)
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    middle, lens = (
        vertices[len(balls[0].vertices) :].mean(axis=0),
        lens_of(CameraModel(half_angle_deg=6.0, resolution_px=128)),
    )
    sideways = np.cross(SUN, [0.0, 0.0, 1.0])
    pose = look_at(middle + 4000.0 * (SUN / np.linalg.norm(SUN) + 1.5 * sideways / np.linalg.norm(sideways)), middle)
    body = ShadedBody(vertices, faces, HAPKE)
    labels = body.labels(lens, pose, SUN)
    assert (labels.incidence[labels.face >= 0] < 80.0).mean() > 0.5 and not labels.lit.any()
    assert body.draw(lens, pose, SUN, samples=8).max() == 0.0
