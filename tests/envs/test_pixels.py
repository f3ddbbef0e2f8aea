"""What cameras of an environment see: the body where geometry says it is, lit from where the Sun is."""

import gymnasium
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from swarm_mj.envs.observe.camera import CameraObservation
from swarm_mj.envs.pixels import MOST_FACES
from swarm_mj.envs.pointing.batch import PointingBatch
from swarm_mj.envs.pointing.task import make_pointing_task

from swarm_mj.errors import ScenarioError


@pytest.fixture(scope="module")
def task():
    return make_pointing_task(observation="camera")


def begun(task, count=6):
    batch = PointingBatch(task, count)
    for e in range(count):
        batch.reset({e: e})
    return batch


def rays_N(batch, e):
    """Through the centres of the pixels in N, shape (64, 64, 3), by camera +x right, +y down, 45 deg."""
    at = (np.arange(64) + 0.5) / 32.0 - 1.0
    y, x = np.meshgrid(at, at, indexing="ij")
    C_NB = Rotation.from_quat(batch.flights.state(e).q_BN[0], scalar_first=True).as_matrix()
    return np.stack([x, y, np.ones_like(x)], -1) @ C_NB.T


def test_the_silhouette_is_the_bodys_within_two_pixels(task):
    """Rays with the body's own mesh, of four times as many faces: what is simplified shifts the limb by no more."""
    batch = begun(task, 3)
    assert len(task.pictures.kept) <= MOST_FACES < len(task.plan.shape.faces)
    for e in range(batch.count):
        C_AN = task.plan.environment.C_AN(float(batch.time_s[e]))
        r_A = C_AN @ batch.flights.state(e).r_N[0]
        rays = rays_N(batch, e).reshape(-1, 3) @ C_AN.T
        mesh = trimesh.Trimesh(task.plan.shape.vertices, task.plan.shape.faces, process=False)
        hit = mesh.ray.intersects_any(np.tile(r_A, (len(rays), 1)), rays).reshape(64, 64)
        mask = batch.image[e, 1] == 255
        assert hit.any()
        assert not (mask & ~grown(hit, 2)).any() and not (hit & ~grown(mask, 2)).any()
        assert (mask != hit).mean() < 0.03


def grown(mask, by):
    out = mask.copy()
    for axis in (0, 1):
        for shift in range(-by, by + 1):
            moved = np.roll(mask, shift, axis)
            out |= np.roll(moved, by, 1 - axis) | np.roll(moved, -by, 1 - axis) | moved
    return out


def test_the_sunlit_side_is_bright(task):
    """Where the ray's point faces the Sun by the sphere through it, grey is above what it is on the other side."""
    batch = begun(task)
    lit, dark = [], []
    for e in range(batch.count):
        sun = np.asarray(task.plan.environment.sun.at(float(batch.time_s[e])))
        sun = sun / np.linalg.norm(sun)
        grey, near = batch.image[e, 0].astype(float), batch.image[e, 2].astype(float)
        body = (batch.image[e, 1] > 0) & (near > 0) & (near < 255)
        depth = 255.0 * task.plan.shape.max_radius / np.maximum(near, 1.0)
        points = batch.flights.state(e).r_N[0] + rays_N(batch, e) * depth[..., None]
        cosine = (points / np.linalg.norm(points, axis=-1, keepdims=True)) @ sun
        lit += grey[body & (cosine > 0.5)].tolist()
        dark += grey[body & (cosine < -0.5)].tolist()
    assert len(lit) > 200 and np.mean(lit) > 100.0
    assert not dark or np.mean(dark) < 40.0


def test_nearness_is_the_depth_along_the_camera(task):
    batch = begun(task, 3)
    pictures = batch.pictures(np.array([True, False, True]))
    for k, e in enumerate((0, 2)):
        depth = pictures.depth[k]
        near = np.where(depth > 0.0, np.minimum(1.0, task.plan.shape.max_radius / np.maximum(depth, 1.0)), 0.0)
        assert np.abs(batch.image[e, 2] - 255.0 * near).max() <= 0.51
        distance = np.linalg.norm(batch.flights.state(e).r_N[0])
        assert abs(np.median(depth[depth > 0.0]) - distance) < task.plan.shape.max_radius


def test_a_step_shows_the_body_where_it_is_then(task):
    batch = begun(task, 2)
    before = batch.image.copy()
    for _ in range(8):
        batch.step(np.array([[0.5, 0.0, 0.0], [0.0, -0.5, 0.0]]), np.array([True, False]))
    assert (batch.image[0] != before[0]).any() and np.array_equal(batch.image[1], before[1])
    assert np.array_equal(batch.task.pictures.images(batch.pictures(np.ones(2, bool))), batch.image)


def test_the_swarms_cameras_show_what_has_been_seen():
    """The mask of SwarmObserve-v0 against rays: a marked pixel lies on a cell that counts as seen, and the others do not."""
    env = CameraObservation(gymnasium.make("swarm_mj.envs:SwarmObserve-v0", scenario="eros-observe"))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation) and not observation["image"][:, 1].any()
    inner = env.unwrapped
    while float(inner.batch.infos()["coverage_percent"][0]) < 5.0:
        observation, *_ = env.step(np.full(5, 5))
    region, now = inner.batch.mission_of(0).plan.region, inner.batch.now
    mesh = trimesh.Trimesh(region.mesh.vertices, region.mesh.faces, process=False)
    seen = np.zeros(len(region.mesh.faces), bool)
    seen[region.target[inner.batch.totals.seen[0, : region.n_cells]]] = True
    at, marked = ((np.arange(64) + 0.5) / 32.0 - 1.0) * np.tan(np.radians(2.5)), 0
    y, x = np.meshgrid(at, at, indexing="ij")
    for j in range(5):
        rays = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3) @ now.C_BN[0, j] @ now.C_AN[0].T
        face = mesh.ray.intersects_first(np.tile(now.C_AN[0] @ now.r[0, j], (len(rays), 1)), rays).reshape(64, 64)
        expected = (face >= 0) & seen[face]
        assert ((observation["image"][j, 1] == 255) != expected).mean() < 0.005
        marked += expected.sum()
    assert marked > 500
    with pytest.raises(ScenarioError, match="half_angle_deg"):
        CameraObservation(inner, half_angle_deg=90.0)
    env.close()
