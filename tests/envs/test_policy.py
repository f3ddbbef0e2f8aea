"""Policies as arrays: features against plain geometry, files that hold no code, and the same decisions in `swarm-mj run`."""

from dataclasses import replace

import numpy as np
import pytest
import swarm_mj.envs  # noqa: F401
from swarm_mj.envs.observe.observations import LAYOUT
from swarm_mj.envs.observe.task import make_task
from swarm_mj.envs.policies.baselines import POLICIES, fly
from swarm_mj.envs.policies.evaluation import fly_seeds
from swarm_mj.envs.policies.policy import (
    OWN,
    PER_PATCH,
    assign,
    geometry_of,
    load_policy,
    provenance,
    save_policy,
)
from swarm_mj.envs.policies.policy_behavior import PACKAGED, TrainedPolicy

from swarm_mj import __version__
from swarm_mj.errors import ScenarioError
from swarm_mj.io.resources import asset_path
from swarm_mj.scenarios.loading import load_scenario

SEED = 12


def test_features_hold_angles_distances_and_shares_as_plain_geometry_gives_them(roles):
    roles.reset(seed=1)
    for _ in range(50):
        observation, *_ = roles.step(np.array([1, 5, 9, 13, 16]))
    parts, state, task = roles.observation_layout.split(observation), roles.state, roles.task
    features = geometry_of(task).features(observation[None])[0]
    patch = features[:, OWN:].reshape(5, 16, PER_PATCH)
    for j, k in ((0, 1), (2, 7), (4, 15)):
        r_A = state.C_AN @ state.r_BN_N[j]
        toward = roles.patches.centre_A[k] - r_A
        distance = np.linalg.norm(toward)
        boresight_A = state.C_AN @ state.C_BN[j][2]
        assert patch[j, k, 4] == pytest.approx(min(1.5, np.arccos(boresight_A @ toward / distance)), abs=1e-3)
        cells = roles.patches.of_cell == k
        normal = np.average(roles.plan.region.normal_A[cells], axis=0, weights=roles.plan.region.area[cells])
        cosine = -toward @ normal / np.linalg.norm(normal) / distance
        gsd = distance * task.observer.camera.pixel_angle / max(cosine, 1e-3)
        assert patch[j, k, 3] == pytest.approx(min(gsd / 3.0, 2.0), rel=1e-4)
        unseen = 1.0 - parts["patches"][k]
        assert patch[j, k, 0] == pytest.approx(unseen * roles.patches.area[k] / roles.patches.area.mean(), rel=1e-5)
        omega_A = state.C_AN @ state.C_BN[j].T @ state.omega_BN_B[j]
        assert np.allclose(features[j, 12:15], omega_A / 0.1, atol=1e-4)


def test_assignment_gives_everyone_the_best_patch_that_is_left():
    worth = np.array([[[3.0, 2.0, 0.0], [3.0, 1.0, 0.0], [0.0, 0.0, 0.0]]])
    assert assign(worth).tolist() == [[0, 1, -1]]


def test_a_policy_acts_alike_on_one_and_on_many_observations(roles, random_policy):
    rows = [roles.reset(seed=seed)[0] for seed in range(6)]
    many = random_policy.act(np.array(rows))
    assert all(np.array_equal(random_policy.act(row), many[e]) for e, row in enumerate(rows))
    assert roles.action_space.contains(many[0])


def test_a_policy_survives_its_file_and_the_file_needs_no_pickle(tmp_path, roles, random_policy):
    file = tmp_path / "policy.npz"
    save_policy(file, random_policy)
    read = load_policy(file)
    observation, _ = roles.reset(seed=4)
    features = random_policy.geometry.features(observation[None])
    assert np.array_equal(read.geometry.features(observation[None]), features)
    assert np.allclose(read.logits(features), random_policy.logits(features), atol=1e-5)
    assert read.about == random_policy.about
    with np.load(file, allow_pickle=False) as data:
        assert all(array.dtype != object for array in data.values())
    assert [p.name for p in tmp_path.iterdir()] == ["policy.npz"]


def test_a_policy_of_another_environment_is_refused_by_its_name():
    with pytest.raises(
        ScenarioError, match="trained for environment = 'SwarmObserve-v1', but it is 'SwarmObserve-v0' here"
    ):
        load_policy(asset_path("policies/swarm-observe-v1.npz"))


def test_files_that_are_no_policy_are_refused_by_name(tmp_path, roles, random_policy):
    with pytest.raises(ScenarioError, match="nowhere.npz: cannot be read .no such file"):
        load_policy(tmp_path / "nowhere.npz")
    text = tmp_path / "text.npz"
    text.write_text("not a policy")
    with pytest.raises(ScenarioError, match="text.npz: cannot be read"):
        load_policy(text)
    pickled = tmp_path / "pickled.npz"
    np.savez(pickled, about=np.array([{"format": 1}], dtype=object))
    with pytest.raises(ScenarioError, match="pickled.npz: cannot be read"):
        load_policy(pickled)
    old = tmp_path / "old.npz"
    save_policy(old, random_policy)
    with np.load(old) as data:
        arrays = dict(data)
    arrays["about"] = np.array(str(arrays["about"]).replace('"format": 1', '"format": 0'))
    np.savez(old, **arrays)
    with pytest.raises(ScenarioError, match="format 0"):
        load_policy(old)


def test_a_policy_for_another_swarm_is_refused(roles, random_policy):
    random_policy.check(roles.task)
    other = replace(random_policy, about={**random_policy.about, "spacecraft": 4})
    with pytest.raises(ScenarioError, match="spacecraft = 4, but it is 5 here"):
        other.check(roles.task)


def told(policy, tmp_path, **about):
    """The policy as its file gives it back, with something else told of it."""
    file = tmp_path / "told.npz"
    save_policy(file, replace(policy, about={**policy.about, **about}))
    return load_policy(file)


def test_a_file_tells_what_its_policy_was_trained_for(tmp_path, random_policy):
    task = make_task(scenario=load_scenario("eros-observe"), overrides=["camera.half_angle_deg=3.5"], complete=90.0)
    about = told(random_policy, tmp_path, **provenance(task)).about
    task.close()
    assert about["environment"] == "SwarmObserve-v0"
    assert about["arguments"] == {
        "scenario": "eros-observe",
        "overrides": ["camera.half_angle_deg=3.5"],
        "complete": 90.0,
    }
    assert (about["layout"], about["package"]) == (LAYOUT, __version__)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        (
            "environment",
            "SwarmObserve-v9",
            "trained for environment = 'SwarmObserve-v9', but it is 'SwarmObserve-v0' here",
        ),
        (
            "layout",
            LAYOUT + 1,
            f"trained for layout = {LAYOUT + 1} of the observation .swarm_mj 9.9., but it is {LAYOUT} here",
        ),
    ],
)
def test_a_policy_of_another_environment_or_layout_is_refused_wherever_it_is_flown(
    name, value, words, tmp_path, roles, random_policy
):
    policy = told(random_policy, tmp_path, package="9.9", **{name: value})
    with pytest.raises(ScenarioError, match=words):
        fly_seeds(policy, [1])
    with pytest.raises(ScenarioError, match=words):
        TrainedPolicy(5, 35_000.0, file=str(tmp_path / "told.npz")).check_scenario(load_scenario("eros-observe"))
    # Files of before did not tell.
    about = {key: value for key, value in random_policy.about.items() if key not in ("environment", "layout")}
    replace(random_policy, about=about).check(roles.task)


def test_many_flights_fit_a_policy_to_the_camera_and_the_patches_that_are_there(random_policy):
    """Features of the old camera would have the picture's worth and the angles wrong."""
    seen = []

    class Watched:
        def for_task(self, task):
            seen.append((task, random_policy.for_task(task)))
            return seen[-1][1]

    changes = ["camera.half_angle_deg=3.5"]
    flown = fly_seeds(Watched(), [3], overrides=changes)
    task, fitted = seen[0]
    assert fitted.geometry.half_angle == pytest.approx(np.radians(3.5))
    # In the middle of the picture a pixel is as wide as the picture's tangents say.
    assert fitted.geometry.pixel_angle == pytest.approx(2.0 * np.tan(np.radians(3.5)) / 512.0, rel=1e-3)
    assert fly_seeds(fitted.act, [3], overrides=changes).total == flown.total


def test_a_policy_flown_on_another_target_sees_the_patches_that_are_there(roles, random_policy):
    assert random_policy.for_task(roles.task) is random_policy
    moved = make_task(scenario=load_scenario("eros-observe", ["target.longitude_deg=0", "camera.half_angle_deg=3.5"]))
    flown = random_policy.for_task(moved).geometry
    assert np.array_equal(flown.centre_A, moved.patches.centre_A)
    assert flown.half_angle == pytest.approx(np.radians(3.5))
    # The old patches lie 90 deg away, so far that nothing of them would be seen.
    assert (
        np.sum(flown.centre_A * random_policy.geometry.centre_A, axis=1) < 0.5 * np.sum(flown.centre_A**2, axis=1)
    ).all()
    moved.close()


@pytest.mark.parametrize("rows", [-1, 100])
def test_a_policy_whose_arrays_give_other_choices_than_it_says_is_refused(rows, roles, random_policy):
    weights = dict(random_policy.weights)
    size = weights["W4"].shape[0] + rows
    for name in ("W4", "b4"):
        weights[name] = np.resize(weights[name], (size, *weights[name].shape[1:]))
    for given in (weights, {**weights, "W4": random_policy.weights["W4"]}):
        with pytest.raises(ScenarioError, match=r"arrays offer 16 patches and .* but here are 16 and 8"):
            replace(random_policy, weights=given).check(roles.task)


def test_the_packaged_policy_beats_every_scripted_one(roles):
    """On two seeds; docs/results/learning.md has a hundred."""
    policy = load_policy(asset_path(PACKAGED))
    policy.check(roles.task)
    trained = fly_seeds(policy.act, [77, 78], threads=2).total
    for name, scripted in POLICIES.items():
        assert (trained > [fly(roles, scripted, seed).total_reward for seed in (77, 78)]).all(), name


def test_the_packaged_policy_is_small():
    with asset_path(PACKAGED).open("rb") as file:
        assert len(file.read()) < 200_000
