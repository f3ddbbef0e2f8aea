"""Many flights of many agents at once are bit for bit those of the multi-agent environment."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("pettingzoo")

from swarm_mj.envs import SwarmObserveParallelVectorEnv  # noqa: E402
from swarm_mj.envs.observe.multi_agent import swarm_observe_v0  # noqa: E402

from swarm_mj.errors import ScenarioError  # noqa: E402

from .flights import place  # noqa: E402

SHORT = {"step_s": 100.0}


def let_crash(batch, e, j):
    """Put spacecraft j of flight e just above the ground, falling."""
    above_A = batch.task.plan.points_A[1]
    above_N = above_A @ batch.task.plan.environment.C_AN(0.0)
    place(batch.flights, e, j, position=above_N, velocity=-above_N / 5.0)
    batch.now.r_A[e, j] = above_A


def test_actions_of_another_shape_are_refused():
    vector = SwarmObserveParallelVectorEnv(2, **SHORT)
    vector.reset(seed=0)
    with pytest.raises(ScenarioError, match=r"actions of sc1: must be an array of shape \(2,\), not \(3,\)"):
        vector.step({agent: np.zeros(3, np.int64) for agent in vector.agents})
    vector.close()


@pytest.mark.parametrize("control", ["role", "pointing"])
def test_flights_are_those_of_the_multi_agent_environment(control):
    vector = SwarmObserveParallelVectorEnv(2, threads=2, control=control, **SHORT)
    singles = [swarm_observe_v0.parallel_env(control=control, **SHORT) for _ in range(2)]
    seen, _ = vector.reset(seed=[3, 9])
    first = [env.reset(seed=seed)[0] for env, seed in zip(singles, (3, 9), strict=True)]
    for agent in vector.agents:
        assert np.array_equal(seen[agent], [each[agent] for each in first])
        assert seen[agent][0] in vector.observation_space(agent)
        vector.action_space(agent).seed(5)
    let_crash(*vector.vector.batch.locate(1), 2)
    let_crash(singles[1].batch, 0, 2)
    for step in range(15):
        actions = {agent: np.array([vector.action_space(agent).sample() for _ in range(2)]) for agent in vector.agents}
        seen, rewards, terminations, truncations, infos = vector.step(actions)
        for e, env in enumerate(singles):
            answer = env.step({agent: actions[agent][e] for agent in env.agents})
            for agent in answer[0]:
                assert np.array_equal(seen[agent][e], answer[0][agent])
            for agent in answer[1]:
                assert rewards[agent][e] == answer[1][agent]
                assert terminations[agent][e] == answer[2][agent] and truncations[agent][e] == answer[3][agent]
                assert infos["coverage_percent"][e] == answer[4][agent]["coverage_percent"]
            assert vector.flying[e].tolist() == [agent in env.agents for agent in vector.agents]
        assert vector.flying[1, 2] == False and (step == 0) == terminations["sc3"][1]  # noqa: E712
    assert not vector.flying.any() and all(truncations[agent][0] for agent in vector.agents)
    *_, infos = vector.step(actions)
    assert vector.flying.all() and infos["_flight_seed"].all() and infos["time_s"].tolist() == [0.0, 0.0]
    vector.close()


def test_actions_that_do_not_fit_are_refused():
    vector = SwarmObserveParallelVectorEnv(2, agent_prefix="sc_", **SHORT)
    with pytest.raises(gymnasium.error.ResetNeeded):
        vector.step({agent: np.zeros(2, int) for agent in vector.agents})
    vector.reset(seed=0)
    with pytest.raises(ScenarioError, match="give one array for each of sc_1, sc_2"):
        vector.step({"sc1": np.zeros(2, int)})
    with pytest.raises(gymnasium.error.InvalidAction):
        vector.step({agent: np.full(2, 99) for agent in vector.agents})
    vector.close()


@pytest.mark.parametrize("observation", ["flat", "entities"])
def test_episodes_of_v1_are_those_of_its_multi_agent_environment(observation):
    from swarm_mj.envs.missions.multi_agent import SwarmObserveV1ParallelEnv
    from swarm_mj.envs.missions.multi_agent_vector import SwarmObserveV1ParallelVectorEnv

    made = {"missions": ["ellipsoid-train-1"], "observation": observation, "decision_s": 60.0}
    # The first has two spacecraft, and loses one on the way; the second has all three to the end.
    drawn = {"loss": [1, 0, 0], "loss_time": 0.3}
    vector, singles = SwarmObserveV1ParallelVectorEnv(2, threads=2, **made), []
    seen, infos = vector.reset(options={"flight_seed": [4, 9], "draw": drawn})
    for seed in infos["flight_seed"]:
        singles.append(SwarmObserveV1ParallelEnv(**made))
        singles[-1].reset(options={"flight_seed": int(seed), "draw": drawn})
    rng, live = np.random.default_rng(0), np.ones(2, bool)
    while live.any():
        actions = {agent: rng.integers(0, vector.action_space(agent).n, 2) for agent in vector.agents}
        flew = vector.flying.copy()
        seen, rewards, terminations, truncations, infos = vector.step(actions)
        for e, env in enumerate(singles):
            assert flew[e].tolist() == [agent in env.agents for agent in vector.agents] or not live[e]
            if not live[e]:
                continue
            answer = env.step({agent: actions[agent][e] for agent in env.agents})
            for agent, own in answer[0].items():
                shown = seen[agent]
                if observation == "flat":
                    assert np.array_equal(shown[e], own) and own in vector.observation_space(agent)
                else:
                    assert all(np.array_equal(shown[name][e], part) for name, part in own.items())
            for agent in answer[1]:
                assert rewards[agent][e] == answer[1][agent]
                assert terminations[agent][e] == answer[2][agent] and truncations[agent][e] == answer[3][agent]
            assert np.array_equal(vector.state()[e], env.state())
            live[e] = bool(env.agents)
    vector.close()
