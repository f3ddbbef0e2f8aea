"""Scores of SwarmObserve-v0: the bound that nobody passes, files of every kind, refusals by name, the command."""

import json
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.episodes import Episodes
from swarm_mj.envs.observe.layout import (
    CHOICE_SIZE,
    KINDS,
    OF_GENERAL,
    OF_SPACECRAFT,
    choice_rows,
    local_rows,
    make_interface,
)
from swarm_mj.envs.observe.tables import GENERAL, SPACECRAFT
from swarm_mj.envs.policies import leaderboard
from swarm_mj.envs.policies.baselines import greedy as greedy_rule
from swarm_mj.envs.policies.baselines import sweep
from swarm_mj.envs.policies.bound import Path as FlownPath
from swarm_mj.envs.policies.leaderboard import TEST_SEEDS, VALIDATION_SEEDS, FrozenEpisodes, Score, share_of
from swarm_mj.envs.policies.policy_files import LAYOUT, flat_rows, open_policy, provenance, sizes, tell_in_zip
from swarm_mj.envs.policies.policy_network import save_network

from swarm_mj.cli.main import main
from swarm_mj.errors import ScenarioError

from .test_policy_network import random_policy

#: One mission, whose maps are quickly made.
ONE = {"missions": ["ellipsoid-test-1"], "split": "test", "max_spacecraft": 4, "patches": 16, "decision_s": 20.0}
SEEDS = (20_000, 20_001, 20_003, 20_007)
#: What networks read.
ROWS = {"swarm": flat_rows, "spacecraft": local_rows, "choice": choice_rows}


@pytest.fixture(scope="module")
def test():
    """Four episodes of one mission."""
    with FrozenEpisodes(SEEDS, **ONE) as made:
        yield made


@pytest.fixture(scope="module")
def greedy(test):
    """What the rule comes to."""
    return test.fly(greedy_rule)


def network(*, reads="swarm", **about):
    """A random network that fits the environment."""
    config = EnvConfig(**ONE)
    flat, local, choices = sizes(config)
    readings = {"swarm": flat, "spacecraft": local, "choice": CHOICE_SIZE}[reads]
    told = provenance(config) | about
    return random_policy(reads=reads, readings=readings, spacecraft=4, choices=choices, **told)


def test_no_policy_passes_the_bound_and_it_is_no_idle_one(test, greedy):
    for flown in (greedy, test.fly(sweep)):
        assert (flown.seen <= test.bound.seen + 1e-9).all()
        assert (flown.delivered <= test.bound.delivered + 1e-9).all()
    assert greedy.seen.mean() > 0.4 * test.bound.seen.mean()


def test_the_bound_of_seen_area_is_what_cameras_that_look_everywhere_would_see(test):
    """At one instant all cells are judged by the observer itself, with the camera turned to each."""
    from swarm_mj.envs.policies.bound import best_pixels

    from swarm_mj.observation.camera import look_at
    from swarm_mj.observation.capture import keeps_limits, limits_of, pixels_on, sight

    task = test.episodes.mission_of(0)
    region = task.plan.region
    up = region.axes_A[2]
    places = np.array([[(np.linalg.norm(region.centroid_A, axis=1).max() + task.altitude_m) * up]])
    pixels, first = best_pixels(task.scene, places, np.ones((1, 1), bool), np.ones(region.n_cells, bool))
    limits = limits_of(task.criterion, task.observer.camera, task.plan.region)
    distance, height = sight(region, places[0, 0])
    for i in range(region.n_cells):
        pose = look_at(places[0, 0], region.centroid_A[i])
        shown = task.observer.visible_fraction(pose.r_A, pose.C_CA)[i] >= task.criterion.min_fraction
        counts = bool(shown and keeps_limits(limits, distance[i], height[i]))
        assert np.isfinite(first[i]) == counts
        assert pixels[i] == pytest.approx(counts * pixels_on(limits, region.area[i], distance[i], height[i]))
    assert 0 < np.isfinite(first).sum()


def test_paths_between_decisions_are_those_of_constant_acceleration():
    t = np.array([0.0, 20.0, 40.0])
    r0, v0, a = np.array([1e3, 2.0, 3.0]), np.array([80.0, -5.0, 0.0]), np.array([0.01, 0.02, -0.03])
    r = (r0 + v0 * t[:, None] + 0.5 * a * t[:, None] ** 2)[:, None]
    path = FlownPath(t, r, (v0 + a * t[:, None])[:, None])
    asked = np.array([0.0, 7.0, 20.0, 33.0])
    assert path.at(asked)[:, 0] == pytest.approx(r0 + v0 * asked[:, None] + 0.5 * a * asked[:, None] ** 2, abs=1e-9)
    # After the last decision straight on.
    assert path.at(np.array([50.0]))[0, 0] == pytest.approx(r[2, 0] + 10.0 * (v0 + 40.0 * a))


def test_the_share_is_the_ratio_of_means_and_its_interval_covers_it():
    rng = np.random.default_rng(0)
    found = []
    for _ in range(1000):
        bound = rng.uniform(1.0, 3.0, 60)
        found.append(share_of(bound * rng.uniform(0.4, 0.8, 60), bound))
    assert np.mean([abs(one.mean - 0.6) < one.half_width for one in found]) == pytest.approx(0.95, abs=0.025)
    assert share_of(np.array([1.0, 3.0]), np.array([2.0, 6.0])) == (0.5, 0.0)


def test_rows_of_a_policy_are_those_of_the_environments(test):
    parallel = pytest.importorskip("swarm_mj.envs.observe.parallel").SwarmObserveParallelEnv
    env = parallel(**ONE, observation="flat", knowledge="full")
    seen, _ = env.reset(options={"flight_seed": 5})
    observed = env.batch.entities()
    assert np.array_equal(flat_rows(observed)[0], env.state())
    for agent, row in seen.items():
        assert np.array_equal(local_rows(observed)[0, env.possible_agents.index(agent)], row)
    assert (env.state().size, next(iter(seen.values())).size) == sizes(env.config)[:2]
    env.close()


def test_a_row_of_a_choice_holds_what_is_known_of_it_and_nothing_of_others(test):
    rng, tables = np.random.default_rng(0), test.episodes.entities()
    observed = {name: rng.uniform(1.0, 2.0, rows.shape) for name, rows in tables.items()}
    E, n, K, width = observed["pairs"].shape
    rows = choice_rows(observed)
    assert rows.shape == (E, n, K + 1 + n, CHOICE_SIZE)
    own = [SPACECRAFT.index(name) for name in OF_SPACECRAFT]
    general = [GENERAL.index(name) for name in OF_GENERAL]
    for e, j, c in np.ndindex(E, n, K + 1 + n):
        to = c - K - 1
        kind = [c < K, c == K, c > K]
        whom = observed["spacecraft"][e, to, own] if c > K and to != j else np.zeros(len(own))
        patch = [*observed["pairs"][e, j, c], *observed["patches"][e, c, :2]] if c < K else np.zeros(width + 2)
        wanted = [*observed["spacecraft"][e, j, own], *observed["general"][e, general], *kind, *whom, *patch]
        assert rows[e, j, c] == pytest.approx(np.array(wanted, np.float64), rel=1e-6)
    assert len(KINDS) == 3


@pytest.mark.parametrize("reads", ROWS)
def test_a_file_of_a_network_flies_as_the_network_does(reads, test, tmp_path):
    policy, observed = network(reads=reads), test.episodes.entities()
    save_network(tmp_path / "policy.npz", policy)
    chosen = open_policy(tmp_path / "policy.npz", test.config)(observed)
    assert np.array_equal(chosen, policy.act(ROWS[reads](observed), observed["action_mask"]))
    assert (np.take_along_axis(observed["action_mask"], chosen[:, :, None], 2) == 1).all()


@pytest.mark.parametrize(
    ("about", "arguments", "words"),
    [
        (
            {"environment": "SwarmMap-v7"},
            {},
            "trained for environment = 'SwarmMap-v7', but it is 'SwarmObserve-v0'",
        ),
        ({"layout": LAYOUT + 1}, {}, f"trained for layout = {LAYOUT + 1}"),
        ({}, {"max_spacecraft": 5}, "trained for spacecraft = 4, but it is 5 here"),
        ({}, {"decision_s": 30.0}, "trained for decision_s = 20.0, but it is 30.0 here"),
        ({"arguments": {"patches": 25}}, {}, "trained for patches = 25, but it is 16 here"),
    ],
)
def test_a_policy_trained_for_something_else_is_refused_by_name(about, arguments, words, tmp_path):
    save_network(tmp_path / "policy.npz", network(**about))
    with pytest.raises(ScenarioError, match=words):
        open_policy(tmp_path / "policy.npz", EnvConfig(**ONE | arguments))


def test_files_that_do_not_fit_are_refused_whatever_they_tell(tmp_path):
    config = EnvConfig(**ONE)
    save_network(
        tmp_path / "policy.npz", replace(random_policy(), about=network().about | {"choices": 4, "spacecraft": 2})
    )
    with pytest.raises(ScenarioError, match="choices of each spacecraft = 4, must be 21 here"):
        open_policy(tmp_path / "policy.npz", config)
    for name, words in (("policy.pt", "must end in one of .npz, .onnx, .zip"), ("none.npz", "no such file")):
        with pytest.raises(ScenarioError, match=words):
            open_policy(tmp_path / name, config)


def test_seeds_of_tests_and_of_validation_are_frozen_and_apart():
    assert TEST_SEEDS == tuple(range(2**31, 2**31 + 1000)) and VALIDATION_SEEDS == tuple(range(30_000, 30_096))


def onnx_model(file, *, masked, choices, flat, told):
    """A linear layer, and where it is masked: a choice that the mask rules out is a million worse."""
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    weight = np.random.default_rng(0).normal(size=(flat, 4 * choices)).astype(np.float32)
    nodes = [helper.make_node("MatMul", ["observation", "W"], ["plain"])]
    shape = onnx.numpy_helper.from_array(np.array([-1, 4, choices]), "shape")
    nodes.append(helper.make_node("Reshape", ["plain", "shape"], ["logits"]))
    inputs = [helper.make_tensor_value_info("observation", kind, ["E", flat])]
    if masked:
        inputs.append(helper.make_tensor_value_info("action_mask", kind, ["E", 4, choices]))
        nodes.append(helper.make_node("Mul", ["logits", "action_mask"], ["allowed"]))
    out = helper.make_tensor_value_info("allowed" if masked else "logits", kind, ["E", 4, choices])
    graph = helper.make_graph(nodes, "policy", inputs, [out], [onnx.numpy_helper.from_array(weight, "W"), shape])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(model, {"swarm_mj": json.dumps(told)})
    onnx.save(model, file)
    return weight


@pytest.mark.parametrize("masked", [False, True])
def test_an_onnx_model_flies_and_its_metadata_are_heeded(masked, test, tmp_path):
    file, (flat, _, choices) = tmp_path / "policy.onnx", sizes(test.config)
    weight = onnx_model(file, masked=masked, choices=choices, flat=flat, told=provenance(test.config))
    observed = test.episodes.entities()
    chosen = open_policy(file, test.config)(observed)
    logits = (flat_rows(observed) @ weight).reshape(-1, 4, choices)
    mask = observed["action_mask"]
    assert np.array_equal(chosen, np.where(mask > 0, logits, -np.inf).argmax(axis=2))
    onnx_model(
        file, masked=masked, choices=choices, flat=flat, told=provenance(test.config) | {"environment": "Other-v3"}
    )
    with pytest.raises(ScenarioError, match="trained for environment = 'Other-v3'"):
        open_policy(file, test.config)


def test_a_zip_of_stable_baselines3_flies_and_what_it_was_trained_for_is_heeded(test, tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    from swarm_mj.envs.training.sb3 import SwarmObserveVecEnv

    venv = SwarmObserveVecEnv(2, **ONE, observation="flat")
    model = sb3.PPO("MlpPolicy", venv, n_steps=8, batch_size=8, seed=0, device="cpu").learn(16)
    venv.close()
    model.save(tmp_path / "policy.zip")
    tell_in_zip(tmp_path / "policy.zip", test.config)
    observed = test.episodes.entities()
    chosen = open_policy(tmp_path / "policy.zip", test.config)(observed)
    assert np.array_equal(chosen, model.predict(flat_rows(observed), deterministic=True)[0])
    with pytest.raises(ScenarioError, match="trained for patches = 16, but it is 9 here"):
        open_policy(tmp_path / "policy.zip", EnvConfig(**ONE | {"patches": 9}))


def test_a_zip_that_tells_nothing_and_does_not_fit_is_told_how_to_tell(test, tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    env = gymnasium.make("swarm_mj.envs:SwarmObserve-v0", **ONE, candidates=4, observation="flat")
    model = sb3.PPO("MlpPolicy", env, n_steps=8, batch_size=8, device="cpu")
    file = tmp_path / "policy.zip"
    model.save(file)
    with pytest.raises(ScenarioError, match=r"numbers of an observation = .* tell_in_zip\(file, EnvConfig\(...\)\)"):
        open_policy(file, test.config)
    tell_in_zip(file, EnvConfig(**ONE, candidates=4))
    assert open_policy(file, test.config)(test.episodes.entities()).shape[1] == test.config.spacecraft
    env.close()


@pytest.mark.parametrize("given", [{}, {"candidates": 4}])
def test_a_zip_of_maskable_ppo_chooses_what_makes_sense(given, test, tmp_path):
    contrib = pytest.importorskip("sb3_contrib")
    env = gymnasium.make("swarm_mj.envs:SwarmObserve-v0", **ONE, **given, observation="flat")
    model, file = (
        contrib.MaskablePPO("MlpPolicy", env, n_steps=8, batch_size=8, seed=0, device="cpu"),
        tmp_path / "p.zip",
    )
    model.save(file)
    tell_in_zip(file, EnvConfig(**ONE, **given))
    test.episodes.reset(dict(enumerate(SEEDS)))
    observed = test.episodes.entities()
    chosen = open_policy(file, test.config)(observed)
    interface = make_interface(test.config.spacecraft, test.config.patches, given.get("candidates"))
    mask = interface.shown(observed)["action_mask"].reshape(len(chosen), -1)
    likeliest = model.predict(interface.flat(observed), deterministic=True, action_masks=mask)[0]
    assert np.array_equal(chosen, interface.decoded(observed, likeliest))
    if not given:
        assert np.take_along_axis(observed["action_mask"], chosen[..., None], axis=2).all()
    env.close()


def test_a_zip_that_reads_what_one_spacecraft_is_told_chooses_for_all(test, tmp_path):
    sb3 = pytest.importorskip("stable_baselines3")
    from swarm_mj.envs.training.sb3 import SwarmObserveSharedVecEnv

    given = ONE | {"candidates": 3}
    venv, config = SwarmObserveSharedVecEnv(1, **given), EnvConfig(**given)
    model = sb3.PPO("MlpPolicy", venv, n_steps=8, batch_size=8, seed=0, device="cpu").learn(16)
    venv.close()
    file = tmp_path / "policy.zip"
    model.save(file)
    tell_in_zip(file, config, reads="spacecraft")
    observed, interface = test.episodes.entities(), make_interface(config.spacecraft, config.patches, 3)
    rows = local_rows(interface.layout.split(interface.flat(observed)))
    likeliest = [model.predict(rows[:, j], deterministic=True)[0] for j in range(rows.shape[1])]
    wanted = interface.decoded(observed, np.stack(likeliest, axis=1))
    assert np.array_equal(open_policy(file, test.config)(observed), wanted)
    with pytest.raises(ScenarioError, match="trained for spacecraft"):
        open_policy(file, EnvConfig(**ONE | {"max_spacecraft": config.spacecraft + 1}))


def test_the_command_writes_a_table_and_all_numbers(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(leaderboard, "TEST", ONE)
    file = tmp_path / "policy.npz"
    save_network(file, network())
    assert main(["score", "greedy", str(file), "--episodes", "2", "--quiet", "--out", str(tmp_path / "out.json")]) == 0
    said = capsys.readouterr().out
    assert "SwarmObserve-v0, 2 test episodes" in said and "policy.npz" in said
    first, second = json.loads((tmp_path / "out.json").read_text())
    assert (first["policy"], Path(second["policy"]).name) == ("greedy", "policy.npz")
    assert first["share"] == pytest.approx(sum(first["scores"]) / sum(first["bounds"]), abs=1e-4)
    assert first["information"] == "full" and first["seeds"] == [2**31, 2**31 + 1] and first["share"] > second["share"]


def test_files_of_one_name_are_told_apart_in_the_table(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(leaderboard, "TEST", ONE)
    files = [tmp_path / run / "policy.npz" for run in ("first", "second")]
    for file in files:
        file.parent.mkdir()
        save_network(file, network())
    assert main(["score", *map(str, files), "greedy", "--episodes", "2", "--quiet"]) == 0
    said = capsys.readouterr().out
    assert "first/policy.npz" in said and "second/policy.npz" in said and tmp_path.name not in said


def test_the_command_refuses_what_it_cannot_fly_before_it_flies(tmp_path, capsys, monkeypatch):
    for work in ("fly", "prepare"):
        monkeypatch.setattr(FrozenEpisodes, work, lambda *_: pytest.fail("flown already"))
    for given, words in (
        (["gready"], "policy 'gready': no such file, and no name; names are random, "),
        ([str(tmp_path)], "is a folder, no regular file, and no name; names are random, "),
        (["greedy", "--episodes", "1001"], "episodes = 1001: must be from 2 to 1000"),
        (["greedy", "--out", str(tmp_path / "none" / "out.json")], "out.json: cannot be written (No such file"),
    ):
        assert main(["score", *given, "--quiet"]) == 2
        assert words in capsys.readouterr().err


def test_a_score_is_the_same_however_many_fly_at_once(test, greedy):
    episodes = Episodes(test.config, 3)
    flown = leaderboard.fly(episodes, greedy_rule, SEEDS)
    episodes.close()
    assert np.array_equal(flown.score, greedy.score)
    assert Score("greedy", "full", SEEDS, greedy, test.bound).share.mean == pytest.approx(
        greedy.score.sum() / test.bound.score.sum()
    )


def test_no_mission_of_the_leaderboard_leads_into_the_body():
    """Of the most uneven body; plans are made without the maps, which take long."""
    from swarm_mj.envs.observe.catalogue import CATALOGUE
    from swarm_mj.envs.observe.flybys import flyby

    from swarm_mj.flight.plan import make_plan
    from swarm_mj.scenarios.loading import load_scenario

    for name, spec in CATALOGUE.items():
        if name.startswith("itokawa-test"):
            plan = make_plan(load_scenario(flyby(spec, 4, 16)[0]))
            assert plan.scenario.name == name
