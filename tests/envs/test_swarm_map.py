"""SwarmMap-v0: all of a body is the target, in daylight, and looking at what is missing pays."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from swarm_mj.envs.observe.patches import make_sphere_patches
from swarm_mj.envs.observe.swarm_map import LONG_STAY, mapped
from swarm_mj.envs.policies.baselines import fly
from swarm_mj.envs.policies.map_baselines import MAP_POLICIES

from swarm_mj.errors import ScenarioError
from swarm_mj.mission.target import whole_body
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_harmonics import load_body

ID = "swarm_mj.envs:SwarmMap-v0"
#: The resolution that a camera of 40 deg needs to have the limit of range of the scenario's of 1 deg.
WIDE = (np.tan(np.radians(40.0)) / 8192) / (np.tan(np.radians(1.0)) / 1024)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Changes of the scenario: a body of 500 faces, whose maps are made at once."""
    directions, faces = geodesic_icosahedron(5)
    file = tmp_path_factory.mktemp("body") / "egg.obj"
    rows = [f"v {x:.3f} {y:.3f} {z:.3f}" for x, y, z in directions * [280.0, 240.0, 220.0]]
    file.write_text("\n".join([*rows, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces)]))
    return [f"body.shape={file}", "target.cell_size_m=1000", "design.visiting_points=[1,2,3]"]


@pytest.fixture(scope="module")
def env(small):
    env = gymnasium.make(ID, patches=96, overrides=small).unwrapped
    yield env
    env.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="SwarmMap-v0 was closed"):
        env.reset()


def test_the_target_is_the_whole_surface_and_every_cell_has_the_patch_of_its_direction():
    shape = load_body("bennu")
    region = whole_body(shape)
    assert region.total_area == pytest.approx(shape.face_areas.sum(), rel=1e-12)
    patches = make_sphere_patches(region, 54)
    assert patches.area.sum() == pytest.approx(region.total_area) and patches.area.min() > 0.0
    for cell in (0, 777, 4321, 7999):
        x, y, z = region.centroid_A[cell]
        face = int(np.argmax([x, -x, y, -y, z, -z]))
        first, second = [(y, z), (x, z), (x, y)][face // 2]
        # Thirds of the face's 90 deg, from -45 deg on.
        degrees = np.degrees(np.arctan2([first, second], [x, -x, y, -y, z, -z][face])) + 45.0
        column, row = (degrees // 30.0).astype(int)
        assert patches.of_cell[cell] == 9 * face + 3 * row + column
    cut = whole_body(shape, cell_size_m=12.0)
    assert cut.n_cells > region.n_cells and cut.total_area == pytest.approx(region.total_area, rel=1e-9)


def test_gymnasium_accepts_it(env):
    check_env(env, skip_render_check=True)
    assert env.action_space.nvec.tolist() == [102, 102, 102]


def test_what_counts_was_lit_near_enough_and_turned_to_a_spacecraft(env):
    fly(env, MAP_POLICIES["greedy"], 1)
    region, totals, surroundings = env.plan.region, env.batch.totals, env.plan.environment
    seen = np.flatnonzero(totals.seen[0])
    assert 0.2 * region.n_cells < len(seen) < region.n_cells
    for cell in seen:
        t = totals.first_seen[0, cell]
        sun_A = surroundings.C_AN(t) @ surroundings.sun.at(t)
        assert region.normal_A[cell] @ sun_A >= np.cos(np.radians(80.0)) * np.linalg.norm(sun_A) * (1.0 - 1e-9)
    assert totals.percent[0] == pytest.approx(100.0 * region.area[seen].sum() / region.total_area)


def test_light_judged_at_once_for_all_is_light_judged_picture_by_picture(env, small):
    single = gymnasium.make(ID, patches=96, overrides=small).unwrapped
    single.task.scene = None  # so that every picture is judged by itself
    for each in (env, single):
        fly(each, MAP_POLICIES["sweep"], 2)
    assert np.array_equal(env.batch.totals.seen, single.batch.totals.seen)
    assert np.array_equal(env.batch.totals.first_seen, single.batch.totals.first_seen, equal_nan=True)
    assert env.batch.totals.seen.any()


def test_looking_at_what_is_missing_pays_and_nobody_sees_more_than_a_camera_that_sees_all(env, small):
    share = {name: fly(env, policy, 1).coverage_percent for name, policy in MAP_POLICIES.items()}
    assert share["greedy"] > share["sweep"] + 3.0
    assert share["sweep"] > share["body centre"] + 10.0
    wide = [*small, "camera.half_angle_deg=40", "camera.resolution_px=8192", f"observation.max_gsd_m={0.15 * WIDE}"]
    everything = gymnasium.make(ID, patches=96, overrides=wide).unwrapped
    bound = fly(everything, MAP_POLICIES["body centre"], 1).coverage_percent
    assert share["greedy"] < bound < 100.0


def test_the_vector_flies_the_same_maps_as_single_environments(env, small):
    vector = gymnasium.make_vec(
        ID, num_envs=2, vectorization_mode="vector_entry_point", patches=96, overrides=small, threads=1
    )
    rows, _ = vector.reset(seed=4)
    actions = np.random.default_rng(0).integers(0, 102, (20, 2, 3))
    flown = [vector.step(each) for each in actions]
    for e in range(2):
        own, _ = env.reset(seed=4 + e)
        assert np.array_equal(rows[e], own)
        for k, each in enumerate(actions):
            observation, reward, *_ = env.step(each[e])
            assert np.array_equal(observation, flown[k][0][e]) and reward == flown[k][1][e]
    vector.close()


def test_what_does_not_fit_a_whole_body_is_refused(small):
    with pytest.raises(ScenarioError, match="six times a square"):
        gymnasium.make(ID, patches=16, overrides=small)
    with pytest.raises(ScenarioError, match="target = 'body'"):
        gymnasium.make(ID, control="pointing", overrides=small)
    assert mapped("itokawa-slow") == "itokawa-slow"
    assert mapped(None).duration_s == 14_400.0 and "duration_s=14400" in LONG_STAY
    with pytest.raises(ScenarioError, match="holds no cell"):
        make_sphere_patches(whole_body(ShapeModel(*cube())), 24)


def cube():
    """Vertices and faces of a cube with two triangles to each side."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    return corners, np.array(faces, np.int32), "cube"
