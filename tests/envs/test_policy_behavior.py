"""Policies as behaviours: the decisions of the environment, from Python and by `swarm-mj run --policy`."""

import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from swarm_mj.envs.policies.baselines import POLICIES
from swarm_mj.envs.policies.policy import ArrayPolicy, load_policy, save_policy
from swarm_mj.envs.policies.policy_behavior import PACKAGED, ScriptedPolicy, TrainedPolicy, policy_overrides

from swarm_mj.cli.main import main
from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight import plan as planning
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.io.resources import asset_path
from swarm_mj.scenarios.loading import load_scenario

from .flights import ID, random_network

SEED = 12
RUN = ["run", "eros-observe", "--quiet", "--no-figures", "--no-report", "--set", "observation.observer=horizon"]


@pytest.mark.parametrize(("policy", "least"), [("trained", 90.0), ("greedy", 70.0), ("body_centre", 35.0)])
def test_a_policy_by_name_flies_a_scenario(policy, least, tmp_path, capsys):
    assert main([*RUN, "--policy", policy, "--out", str(tmp_path / "out")]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["coverage_percent"] > least
    assert "eros-observe" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("scenario", "policy", "change", "words"),
    [
        (
            "eros-quick",
            "trained",
            "seed=1",
            "trained for 5 spacecraft, but design.visiting_points of eros-quick gives 2",
        ),
        (
            "eros-config1",
            "trained",
            "seed=1",
            "trained for 5 spacecraft, but design.visiting_points of eros-config1 gives 5 and "
            "behavior.parameters.dedicated_communications = true one more",
        ),
        ("eros-observe", "trained", "duration_s=1505", "duration_s = 1505"),
        ("eros-observe", "greedy", "duration_s=1505", "duration_s = 1505"),
    ],
)
def test_a_scenario_that_does_not_fit_the_policy_is_refused_before_anything_is_planned(
    scenario, policy, change, words, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(planning, "load_body_shape", lambda body: pytest.fail("planned already"))
    arguments = [*RUN, "--policy", policy, "--set", change, "--out", str(tmp_path / "out")]
    assert main([scenario if part == "eros-observe" else part for part in arguments]) == 2
    assert words in capsys.readouterr().err


def test_one_of_several_scenarios_that_does_not_fit_is_refused_before_any_is_flown(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(planning, "load_body_shape", lambda body: pytest.fail("planned already"))
    several = [*RUN[:2], "eros-quick", *RUN[2:], "--policy", "trained", "--out", str(tmp_path / "out")]
    assert main(several) == 2
    assert "eros-quick gives 2" in capsys.readouterr().err


def test_a_design_with_a_policy_is_refused_for_what_it_is(tmp_path, capsys):
    arguments = ["design", "eros-observe", "--quiet", "--out", str(tmp_path / "out")]
    assert main([*arguments, "--set", "behavior={name: trained_policy}"]) == 2
    assert "no design can be made with it" in capsys.readouterr().err


def test_an_unknown_policy_is_a_clear_error(tmp_path, capsys):
    assert main([*RUN, "--policy", "gready", "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "gready" in error and "greedy" in error
    assert not (tmp_path / "out").exists()


def fly_in_environment(env, act):
    observation, info = env.reset(seed=0, options={"flight_seed": SEED})
    done = False
    while not done:
        observation, _, terminated, truncated, info = env.step(act(observation))
        done = terminated or truncated
    return info


def fly_as_behavior(behavior, *changes):
    plan = make_plan(load_scenario("eros-observe", ["observation.observer=horizon", f"seed={SEED}", *changes]))
    plan = replace(plan, behavior=behavior)
    telemetry = simulate(plan)
    return telemetry, observe_flight(plan, telemetry)


def check_alike(env, telemetry, result):
    assert np.array_equal(env.state.omega_BN_B, telemetry["omega_BN_B"].values[-1])
    assert np.array_equal(env.first_seen_s, result.coverage.first_seen_s, equal_nan=True)
    assert result.coverage.percent > 5.0


@pytest.mark.parametrize("name", ["sweep", "greedy"])
def test_a_scripted_policy_flies_the_same_as_behaviour_and_in_the_environment(roles, name):
    fly_in_environment(roles, lambda observation: POLICIES[name](roles.task, observation))
    check_alike(roles, *fly_as_behavior(ScriptedPolicy(5, 35_000.0, policy=name)))


def test_a_trained_policy_flies_the_same_as_behaviour_and_in_the_environment(roles, random_policy, tmp_path):
    file = tmp_path / "policy.npz"
    save_policy(file, random_policy)
    fly_in_environment(roles, load_policy(file).act)
    check_alike(roles, *fly_as_behavior(TrainedPolicy(5, 35_000.0, file=str(file))))


def test_run_works_out_a_policys_features_with_the_camera_that_flies():
    """The environment with that camera decides alike; with features of the camera of training it would decide otherwise."""
    narrow, rows = "camera.half_angle_deg=1.5", []
    env = gymnasium.make(ID, overrides=[narrow]).unwrapped
    stale = load_policy(asset_path(PACKAGED))
    fitted = stale.for_task(env.task)
    fly_in_environment(env, lambda row: rows.append(row) or fitted.act(row))
    assert any(not np.array_equal(stale.act(row), fitted.act(row)) for row in rows)
    check_alike(env, *fly_as_behavior(TrainedPolicy(5, 35_000.0), narrow))
    env.close()


@pytest.fixture(scope="module")
def relayed():
    """The environment of a scenario whose behaviour brings a dedicated communications spacecraft."""
    env = gymnasium.make(ID, scenario="eros-config1").unwrapped
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
