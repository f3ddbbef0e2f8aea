"""Agents that know what has reached them: groups told by hand, and an episode in which all hear all, or nobody anybody."""

import numpy as np
import pytest

pytest.importorskip("pettingzoo")

from swarm_mj.envs.observe.graph_knowledge import GraphKnowledge, News  # noqa: E402
from swarm_mj.envs.observe.multi_agent import swarm_observe_v0  # noqa: E402
from swarm_mj.envs.observe.patches import Patches  # noqa: E402

from swarm_mj.errors import ScenarioError  # noqa: E402
from swarm_mj.scenarios.loading import load_scenario  # noqa: E402

TWO = Patches(np.array([0, 0, 1, 1]), np.array([1.0, 1.0, 1.0, 3.0]), np.array([2.0, 4.0]), np.zeros((2, 3)))


def news(k, first_by, delivered=0.0, earthward=(False, False, False)):
    return News(
        np.full((3, 3), float(k)), np.full((3, 1), float(k)), np.array(first_by), delivered, np.array(earthward)
    )


def test_what_is_told_stays_in_the_group_and_goes_on_when_groups_meet():
    known = GraphKnowledge(3, 1, TWO)
    known.begin(news(0, [-1, -1, -1, -1]))
    known.tell(news(1, [0, -1, 2, -1], 0.5, (False, False, True)), [np.array([0, 1]), np.array([2])])
    assert known.cells.tolist() == [[True, False, False, False]] * 2 + [[False, False, True, False]]
    assert known.facts[0, :, 0].tolist() == [1.0, 1.0, 0.0] and known.facts[2, :, 0].tolist() == [0.0, 0.0, 1.0]
    assert known.delivered.tolist() == [0.0, 0.0, 0.5]
    patches, share, delivered = known.tail(1)
    assert patches.tolist() == [0.5, 0.0] and share == pytest.approx(1.0 / 6.0) and delivered == 0.0
    known.tell(news(2, [0, -1, 2, -1], 0.7), [np.array([1, 2])])
    assert known.cells[1].tolist() == [True, False, True, False] and known.cells[0].tolist() == [
        True,
        False,
        False,
        False,
    ]
    assert known.delivered.tolist() == [0.0, 0.5, 0.5]
    assert known.r_A[0, 2, 0] == 0.0 and known.r_A[1, 2, 0] == 2.0


def flown(scenario="eros-observe", steps=46, **arguments):
    env = swarm_observe_v0.parallel_env(scenario, **arguments)
    observations, _ = env.reset(seed=1)
    for _ in range(steps):
        observations, *_ = env.step(
            {agent: env.action_spaces[agent].n * 0 + 5 + 2 * k for k, agent in enumerate(env.agents)}
        )
    env.close()
    return observations


def test_where_all_hear_all_the_graph_tells_what_full_observation_does():
    full, graph = flown(), flown(observability="graph")
    for agent, whole in full.items():
        np.testing.assert_allclose(graph[agent], whole, atol=2e-6)
    assert any(whole[-2] > 0.0 for whole in full.values())


def test_where_nobody_hears_anybody_an_agent_knows_what_it_saw_first():
    deaf = load_scenario("eros-observe", ["link.max_range_m=1"])
    full, graph = flown(deaf), flown(deaf, observability="graph")
    shares = [whole[-2] for whole in graph.values()]
    assert 0.0 < max(shares) and sum(shares) == pytest.approx(full["sc1"][-2], abs=1e-5)
    assert len(set(shares)) > 1


def test_what_observability_there_is_not_is_refused():
    with pytest.raises(ScenarioError, match="observability"):
        swarm_observe_v0.parallel_env(observability="none")
