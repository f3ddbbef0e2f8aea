"""The VecEnv of stable-baselines3: its conventions, and the same flights as everywhere else."""

import csv
import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from stable_baselines3.common.env_util import make_vec_env  # noqa: E402
from stable_baselines3.common.monitor import Monitor  # noqa: E402
from stable_baselines3.common.vec_env import VecNormalize  # noqa: E402
from swarm_mj.envs.sb3 import SwarmObserveVecEnv  # noqa: E402

from swarm_mj.errors import ScenarioError  # noqa: E402

STEPS = 150
SCRIPT = Path(__file__).parents[2] / "examples" / "train_sb3.py"


@pytest.fixture(scope="module")
def venv():
    venv = SwarmObserveVecEnv(3, threads=1)
    yield venv
    venv.close()


@pytest.fixture(scope="module")
def episode(venv):
    """Every step of three flights and one step beyond, with random actions: (actions, start, answers)."""
    venv.seed(5)
    start = venv.reset()
    actions = np.random.default_rng(0).integers(0, 24, (STEPS + 1, 3, 5))
    return actions, start, [venv.step(action) for action in actions]


def test_it_does_what_stable_baselines3s_own_wrapper_of_single_environments_does(episode):
    actions, start, answers = episode
    theirs = make_vec_env("swarm_mj.envs:SwarmObserve-v0", n_envs=3, seed=5)
    assert np.array_equal(theirs.reset(), start)
    for action, (observations, rewards, dones, infos) in zip(actions, answers, strict=True):
        expected = theirs.step(action)
        assert np.array_equal(observations, expected[0])
        assert rewards.dtype == expected[1].dtype and np.array_equal(rewards, expected[1])
        assert np.array_equal(dones, expected[2])
        for own, other in zip(infos, expected[3], strict=True):
            assert own.keys() - {"TimeLimit.truncated"} == other.keys() - {"TimeLimit.truncated"}
            assert own.get("TimeLimit.truncated", False) == other.get("TimeLimit.truncated", False)
            assert own["reward_terms"] == other["reward_terms"]
            assert own["time_s"] == other["time_s"] and own["stored_bit"] == other["stored_bit"]
            if "episode" in own:
                assert own["episode"]["r"] == pytest.approx(other["episode"]["r"], abs=1e-5)
                assert own["episode"]["l"] == other["episode"]["l"] == STEPS
                assert np.array_equal(own["terminal_observation"], other["terminal_observation"])
    theirs.close()


def test_a_flight_that_ends_starts_anew_at_once(episode):
    _, _, answers = episode
    observations, _, dones, infos = answers[STEPS - 1]
    assert dones.all()
    for e in range(3):
        assert infos[e]["TimeLimit.truncated"]
        assert infos[e]["time_s"] == 1500.0
        assert not np.array_equal(infos[e]["terminal_observation"], observations[e])
    assert answers[STEPS][3][0]["time_s"] == 10.0


def test_seeds_repeat_flights_and_count_for_one_reset_only(venv, episode):
    _, start, _ = episode
    venv.seed(5)
    assert np.array_equal(venv.reset(), start)
    assert not np.array_equal(venv.reset(), start)


def test_flights_can_be_broken_off(venv):
    venv.reset()
    venv.step(np.zeros((3, 5), np.int64))
    observations = venv.restart(np.array([False, True, False]))
    *_, infos = venv.step(np.zeros((3, 5), np.int64))
    assert [info["time_s"] for info in infos] == [20.0, 10.0, 20.0]
    assert observations.shape == (3, *venv.observation_space.shape)
    assert venv.reset_infos[1]["flight_seed"] >= 0


def test_attributes_and_methods_reach_the_vector_environment(venv):
    assert venv.get_attr("num_envs", [0, 2]) == [3, 3]
    assert venv.get_attr("render_mode") == [None] * 3
    assert len(venv.env_method("reset", indices=[1])) == 1
    venv.set_attr("mark", 7)
    assert venv.get_attr("mark") == [7] * 3
    with pytest.raises(ScenarioError, match="indices"):
        venv.set_attr("mark", 7, [1])
    assert venv.env_is_wrapped(Monitor) == [True] * 3
    assert venv.env_is_wrapped(gymnasium.wrappers.TimeLimit) == [False] * 3
    venv.set_options({"flight_seed": 1})
    with pytest.raises(ScenarioError, match="options"):
        venv.reset()
    venv.set_options()


def test_a_wrapper_of_stable_baselines3_takes_it():
    venv = VecNormalize(SwarmObserveVecEnv(2, threads=1, control="pointing"))
    venv.reset()
    observations, rewards, dones, _ = venv.step(np.zeros((2, 10), np.float32))
    assert np.isfinite(observations).all() and rewards.shape == dones.shape == (2,)
    venv.close()


def test_the_network_in_torch_and_the_policy_in_numpy_give_the_same_logits(tmp_path):
    torch = pytest.importorskip("torch")
    from stable_baselines3 import PPO
    from swarm_mj.envs.policy import load_policy, save_policy
    from swarm_mj.envs.sb3_policy import SwarmActorCritic, VecPolicyFeatures, to_array_policy

    venv = SwarmObserveVecEnv(2, threads=1)
    view = VecPolicyFeatures(venv, 0.99)
    model = PPO(SwarmActorCritic, view, n_steps=8, batch_size=8, seed=1, device="cpu")
    with torch.no_grad():
        for weights in model.policy.parameters():
            weights.add_(0.1 * torch.randn_like(weights))
    save_policy(tmp_path / "p.npz", to_array_policy(model.policy, venv, view.geometry, note="a test"))
    policy = load_policy(tmp_path / "p.npz")
    features = view.reset()
    with torch.no_grad():
        expected = model.policy.mlp_extractor.forward_actor(torch.as_tensor(features)).numpy()
    logits = policy.logits(features.astype(np.float64))
    assert np.ptp(expected) > 0.1
    assert np.allclose(logits.reshape(2, -1), expected, atol=1e-4)
    action, _ = model.predict(features, deterministic=True)
    assert np.array_equal(action, logits.argmax(axis=2))
    venv.close()


def test_shaping_changes_the_return_of_an_episode_by_nothing_but_the_discount():
    pytest.importorskip("torch")
    from swarm_mj.envs.sb3_policy import VecPolicyFeatures

    venv = SwarmObserveVecEnv(2, threads=1)
    view = VecPolicyFeatures(venv, 1.0)
    view.seed(3)
    view.reset()
    total, done = np.zeros(2), np.zeros(2, bool)
    while not done.all():
        centre = np.full((2, 5), 16)
        _, rewards, done, infos = view.step(centre)
        total += rewards
    # Pictures were taken, nothing was sent: with no discount the shaping adds up to zero.
    assert sum(infos[0]["stored_bit"]) > 0.0 and infos[0]["delivered_bit"] == 0.0
    assert np.allclose(total, [info["episode"]["r"] for info in infos], atol=1e-5)
    assert infos[0]["terminal_observation"].shape == view.observation_space.shape
    venv.close()


def test_a_flight_broken_off_counts_its_data_as_delivered():
    pytest.importorskip("torch")
    from swarm_mj.envs.sb3_policy import VecPolicyFeatures

    venv = SwarmObserveVecEnv(2, threads=1)
    view = VecPolicyFeatures(venv, 1.0)
    view.horizon_s = 600.0
    view.seed(3)
    view.reset()
    total, done, steps = np.zeros(2), np.zeros(2, bool), 0
    while not done.all():
        _, rewards, done, infos = view.step(np.full((2, 5), 16))
        total, steps = total + rewards, steps + 1
    nominal = venv.vector.batch.task.nominal_bit
    assert steps == 60
    for e in range(2):
        aboard = sum(infos[e]["stored_bit"]) / nominal
        assert aboard > 0.0
        seen = infos[e]["coverage_percent"] / 100.0
        assert total[e] == pytest.approx(seen + aboard, abs=1e-3)
        assert infos[e]["episode"]["r"] == pytest.approx(total[e], abs=1e-5)
    venv.close()


@pytest.mark.slow
def test_training_goes_on_where_it_stopped_and_beats_the_untrained_policy(tmp_path):
    pytest.importorskip("torch")

    def train(*more):
        command = [sys.executable, str(SCRIPT), "--minutes", "0.3", "--num-envs", "8", "--out", str(tmp_path), *more]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    first = train()
    steps = json.loads((tmp_path / "state.json").read_text())["steps"]
    second = train("--resume")
    assert json.loads((tmp_path / "state.json").read_text())["steps"] > steps > 0
    for answer in (first, second):
        low = float(answer.split("95 % interval ")[1].split(" to ")[0])
        assert low > 0.0
    assert "imitation" in first and "imitation" not in second
    curve = (tmp_path / "curve.csv").read_text().splitlines()
    assert curve[0].startswith("steps,seconds") and len(curve) > 4
    assert list((tmp_path / "log").glob("events.out.tfevents.*"))


@pytest.fixture
def training(monkeypatch):
    """The example as a module, with `returns` in place of flights: what the next validations bring; at the end 0."""
    pytest.importorskip("torch")
    from swarm_mj.envs.evaluation import Returns

    spec = importlib.util.spec_from_file_location("train_sb3", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "train_sb3", module)
    spec.loader.exec_module(module)
    module.returns = []

    def flown(policy, seeds, **arguments):
        mean = module.returns.pop(0) if seeds is module.VALIDATION else 0.0
        return Returns(np.full(len(seeds), mean), np.full(len(seeds), 50.0 * mean), np.zeros(len(seeds)))

    monkeypatch.setattr(module, "fly_seeds", flown)
    return module


#: Over before PPO's first update.
SHORT = ("--minutes", "1e-9", "--imitate", "1", "--num-envs", "2", "--out")


def test_time_that_ends_before_the_first_update_loses_nothing(training, tmp_path, capsys):
    training.returns[:] = [1.0, 1.5]
    assert training.main([*SHORT, str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "imitation 1 of 1" in told
    assert "PPO made 0 updates and 2 steps in this run, 2 steps in all" in told
    assert "1.000 before its first update, 1.500 at best" in told
    state = json.loads((tmp_path / "state.json").read_text())
    assert (state["steps"], state["start"], state["best"]) == (2, 1.0, 1.5)
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "checkpoint.zip",
        "curve.csv",
        "log",
        "policy.npz",
        "state.json",
    ]
    training.returns[:] = [1.2]
    assert training.main([*SHORT, str(tmp_path), "--resume"]) == 0
    told = capsys.readouterr().out
    assert "imitation" not in told and "2 steps in this run, 4 steps in all" in told


@pytest.mark.parametrize("state", ["kept", "older", "missing"])
def test_training_that_goes_on_never_replaces_a_policy_by_a_worse_one(state, training, tmp_path):
    training.returns[:] = [1.0, 1.5]
    training.main([*SHORT, str(tmp_path)])
    file = tmp_path / "state.json"
    kept = json.loads(file.read_text())
    if state == "older":
        # As if ended between writing the policy and the state.
        file.write_text(json.dumps(kept | {"best": 1.0, "steps": 0}))
    elif state == "missing":
        file.unlink()
    best = (tmp_path / "policy.npz").read_bytes()
    training.returns[:] = [1.2]
    training.main([*SHORT, str(tmp_path), "--resume"])
    assert (tmp_path / "policy.npz").read_bytes() == best
    assert json.loads(file.read_text())["best"] == 1.5 and json.loads(file.read_text())["steps"] == 4
    training.returns[:] = [1.7]
    training.main([*SHORT, str(tmp_path), "--resume"])
    assert (tmp_path / "policy.npz").read_bytes() != best
    assert json.loads(file.read_text())["best"] == 1.7
    with (tmp_path / "curve.csv").open() as lines:
        assert [float(row["validation_return"]) for row in csv.DictReader(lines)] == [1.0, 1.5, 1.2, 1.7]


def test_what_was_imitated_is_kept_when_training_is_interrupted(training, tmp_path, monkeypatch, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(training, "imitate", interrupted)
        assert training.main([*SHORT, str(tmp_path / "none")]) == 130
        assert "interrupted; nothing was kept yet" in capsys.readouterr().out
    training.returns[:] = [1.0]
    monkeypatch.setattr(training.PPO, "learn", interrupted)
    assert training.main([*SHORT, str(tmp_path)]) == 130
    assert "--resume goes on" in capsys.readouterr().out
    assert json.loads((tmp_path / "state.json").read_text())["best"] == 1.0
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
    assert set(before) == {"checkpoint.zip", "curve.csv", "policy.npz", "state.json"}
    # Begun anew and ended while it imitates: the earlier run stays as it was.
    monkeypatch.setattr(training, "imitate", interrupted)
    assert training.main([*SHORT, str(tmp_path)]) == 130
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()} == before


def test_validations_go_to_tensorboard(training, tmp_path):
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    training.returns[:] = [1.0, 1.5]
    training.main([*SHORT, str(tmp_path)])
    events = accumulator.EventAccumulator(str(tmp_path / "log"))
    events.Reload()
    for name, values in (("validation/return", [1.0, 1.5]), ("validation/coverage_percent", [50.0, 75.0])):
        assert [(event.step, event.value) for event in events.Scalars(name)] == list(zip([0, 2], values, strict=True))


def test_training_refuses_what_it_cannot_do_in_one_line(training, tmp_path, capsys):
    out = tmp_path / "out"
    assert training.main([*SHORT, str(out), "--scenario", "eros-faults"]) == 2
    error = capsys.readouterr().err
    assert "spacecraft.wheel_layout = 'pyramid'" in error and "must be orthogonal" in error
    assert training.main([*SHORT, str(out), "--scenario", "eros-obs"]) == 2
    assert "Did you mean 'eros-observe'" in capsys.readouterr().err
    assert training.main([*SHORT, str(out), "--resume"]) == 2
    assert "there is no" in capsys.readouterr().err
    assert not out.exists()
    for option, value, allowed in (
        ("--minutes", "0", "a positive number"),
        ("--minutes", "long", "a positive number"),
        ("--num-envs", "0", "at least 1"),
        ("--imitate", "-1", "at least 0"),
        ("--seed", "4294967296", "at most 4294967295"),
    ):
        with pytest.raises(SystemExit) as ended:
            training.main([option, value])
        assert ended.value.code == 2
        error = capsys.readouterr().err
        assert option in error and repr(value) in error and allowed in error


def test_a_checkpoint_of_another_swarm_is_refused(training, tmp_path, capsys):
    training.returns[:] = [1.0, 1.5]
    training.main([*SHORT, str(tmp_path)])
    assert training.main([*SHORT, str(tmp_path), "--resume", "--scenario", "eros-quick"]) == 2
    error = capsys.readouterr().err
    assert "--scenario eros-quick" in error and "checkpoint.zip does not fit" in error


def test_a_folder_without_its_policy_gets_one_and_one_with_a_broken_state_is_refused(training, tmp_path, capsys):
    training.returns[:] = [1.0, 1.5]
    training.main([*SHORT, str(tmp_path)])
    (tmp_path / "policy.npz").unlink()
    training.returns[:] = [1.2]
    assert training.main([*SHORT, str(tmp_path), "--resume"]) == 0
    assert json.loads((tmp_path / "state.json").read_text())["best"] == 1.2
    (tmp_path / "state.json").write_text('{"steps": 3, "points": 4}')
    assert training.main([*SHORT, str(tmp_path), "--resume"]) == 2
    assert "state.json: is no state of training" in capsys.readouterr().err
    # Begun anew, the curve is, too.
    training.returns[:] = [0.5, 0.7]
    assert training.main([*SHORT, str(tmp_path)]) == 0
    assert len((tmp_path / "curve.csv").read_text().splitlines()) == 3
