"""Many flights of many agents at once are bit for bit those of the multi-agent environment."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("pettingzoo")

from swarm_mj.envs import SwarmObserveParallelVectorEnv  # noqa: E402
from swarm_mj.envs.multi_agent import swarm_observe_v0  # noqa: E402

from swarm_mj.errors import ScenarioError  # noqa: E402

from .flights import place  # noqa: E402

SHORT = {"step_s": 100.0}


def let_crash(batch, e, j):
    """Put spacecraft j of flight e just above the ground, falling."""
    above_A = batch.task.plan.points_A[1]
    above_N = above_A @ batch.task.plan.environment.C_AN(0.0)
    place(batch.flights, e, j, position=above_N, velocity=-above_N / 5.0)
    batch.now.r_A[e, j] = above_A


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
