"""The multi-agent environment: PettingZoo's own tests, local observations, and agents that are lost."""

import warnings

import gymnasium
import numpy as np
import pytest

pettingzoo_test = pytest.importorskip("pettingzoo.test")

from swarm_mj.envs.observe.multi_agent import swarm_observe_v0  # noqa: E402

from swarm_mj.errors import ScenarioError  # noqa: E402
from swarm_mj.scenarios.loading import load_scenario  # noqa: E402

from .flights import place  # noqa: E402

LEVELS = ("role", "pointing", "torque")
CENTRE = 16


@pytest.fixture
def env():
    env = swarm_observe_v0.parallel_env()
    yield env
    env.close()


@pytest.mark.parametrize("control", LEVELS)
def test_pettingzoos_api_test_has_no_complaint(control):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = swarm_observe_v0.parallel_env(control=control)
        pettingzoo_test.parallel_api_test(env, num_cycles=200)
        env.close()


@pytest.mark.parametrize("control", LEVELS)
def test_pettingzoos_seed_test_has_no_complaint(control):
    pettingzoo_test.parallel_seed_test(lambda: swarm_observe_v0.parallel_env(control=control), num_cycles=20)


def test_all_agents_together_fly_what_the_single_environment_flies(env):
    single = gymnasium.make("swarm_mj.envs:SwarmObserve-v0").unwrapped
    env.reset(seed=3)
    single.reset(seed=3)
    rng = np.random.default_rng(0)
    for _ in range(70):
        action = rng.integers(0, 24, 5)
        observations, rewards, *_ = env.step(dict(zip(env.agents, action, strict=True)))
        row, reward, *_ = single.step(action)
    assert set(rewards.values()) == {reward}
    assert np.array_equal(env.state(), row)
    assert all(np.array_equal(observations[f"sc{j + 1}"][:29], row[29 * j : 29 * j + 29]) for j in range(5))
    single.close()


def test_neighbours_are_seen_where_they_are(env):
    env.reset(seed=0)
    for _ in range(40):
        observations, *_ = env.step(dict.fromkeys(env.agents, CENTRE))
    first, second = observations["sc1"], observations["sc2"]
    own = [observations[name][:3].astype(float) * 35_000.0 for name in ("sc1", "sc2")]
    # The first neighbour of sc1 is sc2, the first of sc2 is sc1; single precision of 35 km.
    assert np.allclose(first[29:32] * 10_000.0, own[1] - own[0], atol=0.02)
    assert np.allclose(second[29:32], -first[29:32], atol=1e-6)
    assert first[34] == 1.0 and first[33] == second[21]
    assert all(observations[a] in env.observation_space(a) for a in env.agents)


def test_an_agent_that_hits_the_body_leaves_and_the_others_go_on(env):
    env.reset(seed=0)
    batch = env.batch
    above = batch.task.plan.points_A[1]
    above_N = above @ batch.task.plan.environment.C_AN(0.0)
    place(batch.flights, 0, 1, position=above_N, velocity=-above_N / 5.0)
    batch.now.r_A[0, 1] = above
    _, rewards, terminations, truncations, infos = env.step(dict.fromkeys(env.agents, CENTRE))
    assert terminations == {"sc1": False, "sc2": True, "sc3": False, "sc4": False, "sc5": False}
    assert not any(truncations.values())
    assert infos["sc1"]["reward_terms"]["loss"] == -1.0 and rewards["sc1"] < -0.9
    assert env.agents == ["sc1", "sc3", "sc4", "sc5"]
    for _ in range(149):
        observations, rewards, terminations, truncations, infos = env.step(dict.fromkeys(env.agents, CENTRE))
        assert infos["sc1"]["reward_terms"]["loss"] == 0.0
    assert set(observations) == {"sc1", "sc3", "sc4", "sc5"}
    assert observations["sc1"][34] == 0.0  # sc2 is known to be lost
    assert all(truncations.values()) and env.agents == []
    assert infos["sc1"]["coverage_percent"] > 10.0
    assert np.isfinite(env.state()).all()


@pytest.mark.parametrize("what", ["position", "velocity"])
def test_a_flight_that_diverges_ends_with_its_cause_and_its_last_finite_observations(env, what):
    env.reset(seed=0)
    before, *_ = env.step(dict.fromkeys(env.agents, CENTRE))
    place(env.batch.flights, 0, 0, **{what: [np.nan] * 3})
    observations, _, terminations, _, infos = env.step(dict.fromkeys(env.agents, CENTRE))
    assert all(terminations.values()) and infos["sc1"]["end"] == "diverged" and "sc1" in infos["sc1"]["cause"]
    assert all(observations[name] in env.observation_space(name) for name in observations)
    assert np.array_equal(observations["sc2"], before["sc2"])


def test_there_is_nothing_to_draw_before_the_first_reset():
    env = swarm_observe_v0.parallel_env(render_mode="rgb_array")
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.render()
    env.close()


def test_missing_strange_and_impossible_actions_are_clear_errors(env):
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step({})
    env.reset(seed=0)
    with pytest.raises(ScenarioError, match=r"missing for \['sc5'\]"):
        env.step(dict.fromkeys(env.agents[:4], CENTRE))
    with pytest.raises(ScenarioError, match=r"not asked for \['sc9'\]"):
        env.step(dict.fromkeys([*env.agents, "sc9"], CENTRE))
    with pytest.raises(gymnasium.error.InvalidAction):
        env.step(dict.fromkeys(env.agents, 99))
    with pytest.raises(ScenarioError, match="actions = None: must be a mapping"):
        env.step(None)


@pytest.mark.parametrize(("layout", "w"), [("orthogonal", 3), ("pyramid", 4)])
def test_with_w_wheels_an_agent_has_w_torques_and_a_block_of_26_and_w_numbers(layout, w):
    scenario = load_scenario("eros-observe", [f"spacecraft.wheel_layout={layout}"])
    env = swarm_observe_v0.parallel_env(scenario, control="torque")
    env.reset(seed=0)
    assert env.action_space("sc1").shape == (w,)
    assert env.observation_space("sc1").shape == (26 + w + 4 * 6 + 16 + 3,)
    observations, *_ = env.step({agent: np.full(w, 0.1, np.float32) for agent in env.agents})
    assert env.state_space.shape == env.state().shape == ((26 + w) * 5 + 16 + 3,)
    assert env.state() in env.state_space
    assert np.array_equal(observations["sc2"][: 26 + w], env.state()[26 + w : 2 * (26 + w)])
    env.close()
