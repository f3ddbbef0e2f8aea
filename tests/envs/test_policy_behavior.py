"""Policies as behaviours of `swarm-mj fly`: they decide as in the environment of the same flyby."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.episodes import Episodes
from swarm_mj.envs.policies.baselines import greedy_ahead
from swarm_mj.envs.policies.policy_behavior import PACKAGED, policy_overrides
from swarm_mj.envs.policies.policy_files import open_policy

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.io.resources import asset_path
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

#: Behaviours are given true attitudes, agents what sensors say.
IDEAL = "spacecraft.sensors=ideal"
KERNEL = ["physics.stepper=kernel", "telemetry.interval_s=10", IDEAL]


def flown_by(policy, *changes):
    """Telemetry of a run that a policy flies."""
    asked = parse_overrides([*KERNEL, *changes])
    scenario = load_scenario("eros-observe", asked | policy_overrides(policy, load_scenario("eros-observe", asked)))
    return simulate(make_plan(scenario))


@pytest.mark.parametrize("policy", ["greedy_ahead", "trained"])
def test_a_policy_flies_on_the_command_line_what_it_flies_in_the_environment(policy):
    config = EnvConfig(scenario=load_scenario("eros-observe", parse_overrides([IDEAL])))
    act = open_policy(asset_path(PACKAGED), config) if policy == "trained" else None
    episodes, choices = Episodes(config, 1), []
    episodes.reset({0: 7})
    for _ in range(50):
        tables = episodes.entities()
        choices.append(greedy_ahead(tables, 75) if act is None else act(tables))
        episodes.fly(choices[-1], np.ones(1, np.bool_))
    telemetry, at = flown_by(policy, "seed=7"), 100
    assert episodes.now.r[0] == pytest.approx(telemetry["r_BN_N"].values[at], abs=1e-6)
    dcm = Rotation.from_quat(episodes.now.q[0], scalar_first=True).as_matrix()
    mrp = telemetry["sigma_BN"].values[at]
    turn = Rotation.from_mrp(mrp).as_matrix()
    assert turn == pytest.approx(dcm, abs=1e-6)
    assert len({row.tobytes() for row in choices}) > 5
    episodes.close()


def test_a_dedicated_communications_spacecraft_flies_along_with_a_policy():
    given = load_scenario("bennu-slow")
    assert "dedicated_communications" in policy_overrides("greedy", given)["behavior.parameters"]
    plan = make_plan(load_scenario("bennu-slow", policy_overrides("greedy", given)))
    assert (plan.n, plan.n_observers) == (4, 3)


def test_what_cannot_fly_is_refused_by_name(tmp_path):
    scenario = load_scenario("eros-observe")
    with pytest.raises(MissionError, match="no such file, and no name; names are trained, sweep, greedy"):
        policy_overrides("gready", scenario)
    with pytest.raises(MissionError, match="is a folder, no regular file, and no name; names are trained"):
        policy_overrides(str(tmp_path), scenario)
    with pytest.raises(MissionError, match="behavior.parameters.policy = 'gready': must be one of sweep, greedy"):
        make_plan(
            load_scenario(
                "eros-observe", {"behavior.name": "scripted_policy", "behavior.parameters": {"policy": "gready"}}
            )
        )
    step = {"behavior.name": "scripted_policy", "behavior.parameters": {"policy": "greedy", "step_s": 7}}
    with pytest.raises(MissionError, match="step_s = 7"):
        make_plan(load_scenario("eros-observe", step))
    (tmp_path / "policy.npz").write_bytes(b"nothing")
    own = {"behavior.name": "trained_policy", "behavior.parameters": {"file": str(tmp_path / "policy.npz")}}
    with pytest.raises(ScenarioError, match="policy"):
        make_plan(load_scenario("eros-observe", own))
