"""What cameras of an environment see: the body where geometry says it is, lit from where the Sun is."""

import gymnasium
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from swarm_mj.envs.observe.parallel import SwarmObserveParallelEnv
from swarm_mj.envs.pixels import MOST_FACES
from swarm_mj.envs.pointing.batch import PointingBatch
from swarm_mj.envs.pointing.task import make_pointing_task

from swarm_mj.errors import ScenarioError
from swarm_mj.observation.photometry import body_surface, radiance_factors


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


def test_the_swarms_cameras_show_what_has_been_seen_in_true_light():
    """Pixels of SwarmObserve-v0 against rays: marked ones lie on cells that count as seen, bright ones are so by the law."""
    env = gymnasium.make("swarm_mj.envs:SwarmObserve-v0", scenario="eros-observe", observation="pixels")
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation) and not observation["image"][:, 1].any()
    inner = env.unwrapped
    while float(inner.batch.infos()["coverage_percent"][0]) < 5.0:
        observation, *_ = env.step(np.full(5, 5))
    plan, now = inner.batch.mission_of(0).plan, inner.batch.now
    region, surface = plan.region, body_surface(plan.scenario.body)
    mesh = trimesh.Trimesh(region.mesh.vertices, region.mesh.faces, process=False)
    seen = np.zeros(len(region.mesh.faces), bool)
    seen[region.target[inner.batch.totals.seen[0, : region.n_cells]]] = True
    sun_A = now.C_AN[0] @ plan.environment.sun.at(float(now.t[0]))
    sun_A /= np.linalg.norm(sun_A)
    at, marked = ((np.arange(64) + 0.5) / 32.0 - 1.0) * np.tan(np.radians(2.5)), 0
    y, x = np.meshgrid(at, at, indexing="ij")
    for j in range(5):
        rays = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3) @ now.C_BN[0, j] @ now.C_AN[0].T
        r_A = now.C_AN[0] @ now.r[0, j]
        face = mesh.ray.intersects_first(np.tile(r_A, (len(rays), 1)), rays)
        hit, expected = face >= 0, (face >= 0) & seen[face]
        assert ((observation["image"][j, 1] == 255).ravel() != expected).mean() < 0.005
        marked += expected.sum()
        if not hit.any():
            assert not observation["image"][j].any()
            continue
        normal, corner = mesh.face_normals[face[hit]], mesh.triangles[face[hit], 0]
        depth = np.einsum("nk,nk->n", normal, corner - r_A) / np.einsum("nk,nk->n", normal, rays[hit])
        place = r_A + depth[:, None] * rays[hit]
        back = -rays[hit] / np.linalg.norm(rays[hit], axis=1, keepdims=True)
        light = radiance_factors(surface, normal @ sun_A, np.einsum("nk,nk->n", normal, back), back @ sun_A)
        light[mesh.ray.intersects_any(place + 0.1 * normal, np.tile(sun_A, (len(place), 1)))] = 0.0
        grey = np.zeros(len(face))
        grey[hit] = 255.0 * light / light.max()
        off = np.abs(observation["image"][j, 0].ravel() - grey) > 3.0
        assert off.mean() < 0.02
    assert marked > 500
    env.close()


def test_episodes_at_once_see_what_one_sees_and_light_can_come_from_the_camera():
    """Bit for bit; by a headlight no place that is seen is dark."""
    one = gymnasium.make("swarm_mj.envs:SwarmObserve-v0", missions=1, observation="pixels")
    many = gymnasium.make_vec("swarm_mj.envs:SwarmObserve-v0", 2, missions=1, observation="pixels")
    many.reset(options={"flight_seed": [3, 4]})
    several = [many.step(np.full((2, 3), 5))[0] for _ in range(3)][-1]
    for e, seed in enumerate((3, 4)):
        one.reset(options={"flight_seed": seed})
        alone = [one.step(np.full(3, 5))[0] for _ in range(3)][-1]
        assert np.array_equal(alone["image"], several["image"][e]) and alone["image"].any()
    agents = SwarmObserveParallelEnv(missions=1, observation="pixels")
    agents.reset(options={"flight_seed": 4})
    each = [agents.step(dict.fromkeys(agents.agents, 5))[0] for _ in range(3)][-1]
    assert agents.observation_space("sc1").contains(each["sc1"])
    assert np.array_equal(each["sc2"]["image"], several["image"][1, 1])
    lit = gymnasium.make("swarm_mj.envs:SwarmObserve-v0", missions=1, observation="pixels", light="headlight")
    lit.reset(options={"flight_seed": 4})
    shown = [lit.step(np.full(3, 5))[0] for _ in range(3)][-1]
    near = shown["image"][:, 2] > 0
    assert near.any() and (shown["image"][:, 0][near] > 0).all()
    for env in (one, many, agents, lit):
        env.close()


@pytest.mark.parametrize("wrong", [{"camera_half_angle_deg": 90.0}, {"light": "moon"}, {"observation": "flat"}])
def test_arguments_of_pictures_are_checked(wrong):
    given = {"observation": "pixels", "camera_half_angle_deg": 5.0, **wrong}
    with pytest.raises(ScenarioError, match=next(iter(wrong))):
        gymnasium.make("swarm_mj.envs:SwarmObserve-v0", missions=1, **given)
