"""Training with PPO: imitated, validated, kept, resumed, and never worse than what stood in the folder before."""

import csv
import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
from swarm_mj.envs.policies.evaluation import Returns  # noqa: E402
from swarm_mj.envs.training import sb3_training  # noqa: E402
from swarm_mj.envs.training.sb3_options import command_line  # noqa: E402

SCRIPT = Path(__file__).parents[2] / "examples" / "train_sb3.py"


@pytest.mark.slow
def test_training_goes_on_where_it_stopped_and_beats_the_untrained_policy(tmp_path):
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


class Example:
    """The example as a module, with `returns` in place of flights: what the next validations bring; at the end 0."""

    def __init__(self):
        spec = importlib.util.spec_from_file_location("train_sb3", SCRIPT)
        self._module, self.returns = importlib.util.module_from_spec(spec), []
        spec.loader.exec_module(self._module)

    def main(self, argv):
        """What the example does with a command line; its exit status."""
        return command_line(self._module.train, argv=argv)

    def fly_seeds(self, policy, seeds, **arguments):
        """Instead of `swarm_mj.envs.policies.evaluation.fly_seeds`."""
        mean = self.returns.pop(0) if seeds is sb3_training.VALIDATION else 0.0
        return Returns(np.full(len(seeds), mean), np.full(len(seeds), 50.0 * mean), np.zeros(len(seeds)))


@pytest.fixture
def training(monkeypatch):
    """The example, which flies nothing to validate."""
    example = Example()
    monkeypatch.setattr(sb3_training, "fly_seeds", example.fly_seeds)
    return example


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
        patch.setattr(sb3_training, "imitate", interrupted)
        assert training.main([*SHORT, str(tmp_path / "none")]) == 130
        assert "interrupted; nothing was kept yet" in capsys.readouterr().out
    training.returns[:] = [1.0]
    monkeypatch.setattr(sb3_training.PPO, "learn", interrupted)
    assert training.main([*SHORT, str(tmp_path)]) == 130
    assert "--resume goes on" in capsys.readouterr().out
    assert json.loads((tmp_path / "state.json").read_text())["best"] == 1.0
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
    assert set(before) == {"checkpoint.zip", "curve.csv", "policy.npz", "state.json"}
    # Begun anew and ended while it imitates: the earlier run stays as it was.
    monkeypatch.setattr(sb3_training, "imitate", interrupted)
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
    (tmp_path / "state.json").write_text('{"steps": "3"}')
    assert training.main([*SHORT, str(tmp_path), "--resume"]) == 2
    assert "it is no state of training" in capsys.readouterr().err
    # Begun anew, the curve is, too.
    training.returns[:] = [0.5, 0.7]
    assert training.main([*SHORT, str(tmp_path)]) == 0
    assert len((tmp_path / "curve.csv").read_text().splitlines()) == 3
