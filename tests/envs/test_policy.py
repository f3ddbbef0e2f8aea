"""Policies as arrays: features against plain geometry, files that hold no code, and the same decisions in `swarm-mj run`."""

import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import swarm_mj.envs  # noqa: F401
from swarm_mj.envs.baselines import POLICIES, fly
from swarm_mj.envs.evaluation import fly_seeds, interval
from swarm_mj.envs.policy import (
    OWN,
    PER_PATCH,
    WEIGHTS,
    ArrayPolicy,
    assign,
    describe,
    geometry_of,
    load_policy,
    save_policy,
)
from swarm_mj.envs.policy_behavior import PACKAGED, ScriptedPolicy, TrainedPolicy, policy_overrides

from swarm_mj.cli.main import main
from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.io.resources import asset_path
from swarm_mj.scenarios.loading import load_scenario

SEED = 12


@pytest.fixture(scope="module")
def env():
    env = gymnasium.make("SwarmObserve-v0").unwrapped
    yield env
    env.close()


@pytest.fixture(scope="module")
def random_policy(env):
    """A network that prefers everything now and then."""
    return random_network(env.task)


def random_network(task):
    rng, width, n, hidden, pointer = np.random.default_rng(3), OWN + 16 * PER_PATCH, task.plan.n, 8, 6
    shapes = [(hidden, width), (hidden,), (hidden, hidden), (hidden,), (pointer, hidden + PER_PATCH), (pointer,)]
    shapes += [(pointer,), (n + 3, hidden), (n + 3,)]
    weights = {name: rng.normal(0.0, 0.7, shape) for name, shape in zip(WEIGHTS, shapes, strict=True)}
    return ArrayPolicy(weights, geometry_of(task), describe(task))


def test_features_hold_angles_distances_and_shares_as_plain_geometry_gives_them(env):
    env.reset(seed=1)
    for _ in range(50):
        observation, *_ = env.step(np.array([1, 5, 9, 13, 16]))
    parts, state, task = env.observation_layout.split(observation), env.state, env.task
    features = geometry_of(task).features(observation[None])[0]
    patch = features[:, OWN:].reshape(5, 16, PER_PATCH)
    for j, k in ((0, 1), (2, 7), (4, 15)):
        r_A = state.C_AN @ state.r_BN_N[j]
        toward = env.patches.centre_A[k] - r_A
        distance = np.linalg.norm(toward)
        boresight_A = state.C_AN @ state.C_BN[j][2]
        assert patch[j, k, 4] == pytest.approx(min(1.5, np.arccos(boresight_A @ toward / distance)), abs=1e-3)
        cells = env.patches.of_cell == k
        normal = np.average(env.plan.region.normal_A[cells], axis=0, weights=env.plan.region.area[cells])
        cosine = -toward @ normal / np.linalg.norm(normal) / distance
        gsd = distance * task.observer.camera.pixel_angle / max(cosine, 1e-3)
        assert patch[j, k, 3] == pytest.approx(min(gsd / 3.0, 2.0), rel=1e-4)
        unseen = 1.0 - parts["patches"][k]
        assert patch[j, k, 0] == pytest.approx(unseen * env.patches.area[k] / env.patches.area.mean(), rel=1e-5)
        omega_A = state.C_AN @ state.C_BN[j].T @ state.omega_BN_B[j]
        assert np.allclose(features[j, 12:15], omega_A / 0.1, atol=1e-4)


def test_assignment_gives_everyone_the_best_patch_that_is_left():
    worth = np.array([[[3.0, 2.0, 0.0], [3.0, 1.0, 0.0], [0.0, 0.0, 0.0]]])
    assert assign(worth).tolist() == [[0, 1, -1]]


def test_a_policy_acts_alike_on_one_and_on_many_observations(env, random_policy):
    rows = [env.reset(seed=seed)[0] for seed in range(6)]
    many = random_policy.act(np.array(rows))
    assert all(np.array_equal(random_policy.act(row), many[e]) for e, row in enumerate(rows))
    assert env.action_space.contains(many[0])


def test_a_policy_survives_its_file_and_the_file_needs_no_pickle(tmp_path, env, random_policy):
    file = tmp_path / "policy.npz"
    save_policy(file, random_policy)
    read = load_policy(file)
    observation, _ = env.reset(seed=4)
    features = random_policy.geometry.features(observation[None])
    assert np.array_equal(read.geometry.features(observation[None]), features)
    assert np.allclose(read.logits(features), random_policy.logits(features), atol=1e-5)
    assert read.about == random_policy.about
    with np.load(file, allow_pickle=False) as data:
        assert all(array.dtype != object for array in data.values())
    assert [p.name for p in tmp_path.iterdir()] == ["policy.npz"]


def test_files_that_are_no_policy_are_refused_by_name(tmp_path, env, random_policy):
    with pytest.raises(ScenarioError, match="nowhere.npz: no such file"):
        load_policy(tmp_path / "nowhere.npz")
    text = tmp_path / "text.npz"
    text.write_text("not a policy")
    with pytest.raises(ScenarioError, match="text.npz: is not a policy file"):
        load_policy(text)
    pickled = tmp_path / "pickled.npz"
    np.savez(pickled, about=np.array([{"format": 1}], dtype=object))
    with pytest.raises(ScenarioError, match="pickled.npz: is not a policy file"):
        load_policy(pickled)
    old = tmp_path / "old.npz"
    save_policy(old, random_policy)
    with np.load(old) as data:
        arrays = dict(data)
    arrays["about"] = np.array(str(arrays["about"]).replace('"format": 1', '"format": 0'))
    np.savez(old, **arrays)
    with pytest.raises(ScenarioError, match="format 0"):
        load_policy(old)


def test_a_policy_for_another_swarm_is_refused(env, random_policy):
    random_policy.check(env.task)
    other = replace(random_policy, about={**random_policy.about, "spacecraft": 4})
    with pytest.raises(ScenarioError, match="spacecraft = 4, but it is 5 here"):
        other.check(env.task)


@pytest.mark.parametrize("rows", [-1, 100])
def test_a_policy_whose_arrays_give_other_choices_than_it_says_is_refused(rows, env, random_policy):
    weights = dict(random_policy.weights)
    size = weights["W4"].shape[0] + rows
    for name in ("W4", "b4"):
        weights[name] = np.resize(weights[name], (size, *weights[name].shape[1:]))
    for given in (weights, {**weights, "W4": random_policy.weights["W4"]}):
        with pytest.raises(ScenarioError, match=r"arrays offer 16 patches and .* but here are 16 and 8"):
            replace(random_policy, weights=given).check(env.task)


def test_a_choice_that_does_not_exist_is_refused_whoever_makes_it(env):
    env.reset(seed=0)
    for choice in (-1, 24, 10**12):
        with pytest.raises(gymnasium.error.InvalidAction, match="choices .* must be 0 to 23"):
            env.batch.step(np.full((1, 5), choice))
    env.batch.step(np.full((1, 5), 23))


def fly_in_environment(env, act):
    observation, info = env.reset(seed=0, options={"flight_seed": SEED})
    done = False
    while not done:
        observation, _, terminated, truncated, info = env.step(act(observation))
        done = terminated or truncated
    return info


def fly_as_behavior(behavior):
    plan = make_plan(load_scenario("eros-observe", ["observation.observer=horizon", f"seed={SEED}"]))
    plan = replace(plan, behavior=behavior)
    telemetry = simulate(plan)
    return telemetry, observe_flight(plan, telemetry)


def check_alike(env, telemetry, result):
    assert np.array_equal(env.state.omega_BN_B, telemetry["omega_BN_B"].values[-1])
    assert np.array_equal(env.first_seen_s, result.coverage.first_seen_s, equal_nan=True)
    assert result.coverage.percent > 5.0


@pytest.mark.parametrize("name", ["sweep", "greedy"])
def test_a_scripted_policy_flies_the_same_as_behaviour_and_in_the_environment(env, name):
    fly_in_environment(env, lambda observation: POLICIES[name](env.task, observation))
    check_alike(env, *fly_as_behavior(ScriptedPolicy(5, 35_000.0, policy=name)))


def test_a_trained_policy_flies_the_same_as_behaviour_and_in_the_environment(env, random_policy, tmp_path):
    file = tmp_path / "policy.npz"
    save_policy(file, random_policy)
    fly_in_environment(env, load_policy(file).act)
    check_alike(env, *fly_as_behavior(TrainedPolicy(5, 35_000.0, file=str(file))))


@pytest.fixture(scope="module")
def relayed():
    """The environment of a scenario whose behaviour brings a dedicated communications spacecraft."""
    env = gymnasium.make("SwarmObserve-v0", scenario="eros-config1").unwrapped
    yield env
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["trained", "scripted"])
def test_run_flies_the_swarm_of_the_environment_with_its_communications_spacecraft(
    kind, relayed, tmp_path, monkeypatch
):
    assert relayed.task.plan.n == 6 and relayed.task.plan.n_observers == 5
    name, act = "greedy", lambda observation: POLICIES["greedy"](relayed.task, observation)
    read = []
    if kind == "trained":
        name = str(tmp_path / "policy.npz")
        # Turned to what the greedy rule says, so that there is something to compare; for the rest at random.
        network = random_network(relayed.task)
        network.weights["W3"][:, -1] += 9.0
        network.weights["v"][:] = 3.0
        save_policy(name, network)
        act = load_policy(name).act
        logits = ArrayPolicy.logits
        monkeypatch.setattr(
            ArrayPolicy, "logits", lambda policy, features: (read.append(features), logits(policy, features))[1]
        )
    covered = fly_in_environment(relayed, act)["coverage_percent"]
    here, read[:] = list(read), []
    out = tmp_path / "out"
    command = ["run", "eros-config1", "--policy", name, "--quiet", "--no-figures", "--no-report", "--out", str(out)]
    assert main([*command, "--set", "observation.observer=horizon", "--set", f"seed={SEED}"]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["spacecraft"] == 6
    # As many digits as the summary has; the cells themselves and their times are the same.
    assert summary["coverage_percent"] == round(covered, 5) > 5.0
    with np.load(out / "coverage.npz") as cells:
        assert np.array_equal(cells["first_seen_s"], relayed.first_seen_s, equal_nan=True)
    assert len(here) == len(read) == (120 if kind == "trained" else 0)
    assert all(np.array_equal(a, b) for a, b in zip(here, read, strict=True))


@pytest.mark.parametrize("policy", ["greedy", "trained", "some/file.npz"])
@pytest.mark.parametrize(("name", "dedicated"), [("eros-observe", False), ("eros-config1", True)])
def test_overrides_make_a_scenario_that_flies_the_policy(policy, name, dedicated, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "some").mkdir()
    (tmp_path / "some" / "file.npz").touch()
    overrides = policy_overrides(policy, load_scenario(name))
    flown = load_scenario(name, overrides)
    behavior = flown.behavior
    known = {"scripted_policy": ScriptedPolicy, "trained_policy": TrainedPolicy}
    built = known[behavior.name](5, behavior.imaging_radius_m, **behavior.parameters)
    expected = {"greedy": ("policy", "greedy"), "trained": ("file", "")}.get(policy, ("file", policy))
    assert getattr(built, expected[0]) == expected[1]
    assert built.dedicated_communications is dedicated
    # A scenario that a policy flies already keeps its swarm.
    assert policy_overrides(policy, flown) == overrides


def test_a_lost_spacecraft_does_not_stop_the_policy():
    fault = "faults=[{kind: spacecraft_lost, spacecraft: sc2, at_s: 450}]"
    plan = make_plan(load_scenario("eros-observe", ["observation.observer=horizon", f"seed={SEED}", fault]))
    plan = replace(plan, behavior=ScriptedPolicy(5, 35_000.0))
    result = observe_flight(plan, simulate(plan))
    assert 1.0 < result.coverage.percent < 50.0


def test_a_policy_as_behaviour_says_why_it_cannot(random_policy, tmp_path):
    with pytest.raises(MissionError, match="'random': must be one of body_centre"):
        ScriptedPolicy(5, 35_000.0, policy="random")
    for behavior in (ScriptedPolicy, TrainedPolicy):
        with pytest.raises(MissionError, match="dedicated_communications = 'no': must be true or false"):
            behavior(5, 35_000.0, dedicated_communications="no")
    plan = make_plan(load_scenario("eros-observe", ["duration_s=1505"]))
    with pytest.raises(MissionError, match="step_s"):
        ScriptedPolicy(5, 35_000.0).for_flight(plan)
    with pytest.raises(MissionError, match="no design can be made"):
        ScriptedPolicy(5, 35_000.0).targets(None, None)
    four = make_plan(load_scenario("eros-observe", ["spacecraft.wheel_layout=pyramid"]))
    with pytest.raises(ScenarioError, match="spacecraft.wheel_layout = 'pyramid': .* not of 4; must be orthogonal"):
        simulate(replace(four, behavior=ScriptedPolicy(5, 35_000.0, policy="greedy_ahead")))
    file = tmp_path / "policy.npz"
    save_policy(file, replace(random_policy, about={**random_policy.about, "spacecraft": 6}))
    with pytest.raises(ScenarioError, match="gives 5; behavior.parameters.dedicated_communications = true would add"):
        TrainedPolicy(5, 35_000.0, file=str(file)).check_scenario(load_scenario("eros-observe"))
    save_policy(file, replace(random_policy, about={**random_policy.about, "spacecraft": 4}))
    with pytest.raises(ScenarioError, match="spacecraft = 4"):
        TrainedPolicy(5, 35_000.0, file=str(file)).for_flight(make_plan(load_scenario("eros-observe")))


def test_seeds_flown_together_give_the_returns_of_single_episodes(env):
    def act(observations):
        return np.array([POLICIES["sweep"](env.task, row) for row in observations])

    flown = fly_seeds(act, [8, 3, 5], threads=2)
    alone = [fly(env, POLICIES["sweep"], seed) for seed in (8, 3, 5)]
    assert np.allclose(flown.total, [outcome.total_reward for outcome in alone], rtol=0.0, atol=1e-9)
    assert np.array_equal(flown.coverage_percent, [outcome.coverage_percent for outcome in alone])
    assert np.array_equal(flown.delivered_bit, [outcome.delivered_bit for outcome in alone])


def test_the_interval_covers_the_true_mean_nineteen_times_in_twenty():
    rng = np.random.default_rng(0)
    found = [interval(rng.normal(2.0, 1.0, 8)) for _ in range(4000)]
    covered = np.mean([abs(mean - 2.0) < half for mean, half in found])
    assert covered == pytest.approx(0.95, abs=0.01)


def test_the_packaged_policy_beats_every_scripted_one(env):
    """On two seeds; docs/results/learning.md has a hundred."""
    policy = load_policy(asset_path(PACKAGED))
    policy.check(env.task)
    trained = fly_seeds(policy.act, [77, 78], threads=2).total
    for name, scripted in POLICIES.items():
        assert (trained > [fly(env, scripted, seed).total_reward for seed in (77, 78)]).all(), name


def test_the_packaged_policy_is_small():
    with asset_path(PACKAGED).open("rb") as file:
        assert len(file.read()) < 200_000
