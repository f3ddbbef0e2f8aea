"""With w wheels an action of torques has w numbers for each spacecraft, its block of the observation 26 + w."""

import gymnasium
import numpy as np
import pytest

from swarm_mj.scenarios.loading import load_scenario

from .flights import ID

LAYOUTS = pytest.mark.parametrize(("layout", "w"), [("orthogonal", 3), ("pyramid", 4)])


def make(layout, **arguments):
    scenario = load_scenario("eros-observe", [f"spacecraft.wheel_layout={layout}"])
    return gymnasium.make(ID, scenario=scenario, **arguments).unwrapped


@LAYOUTS
def test_the_block_of_a_spacecraft_is_laid_out_as_the_docstring_says(layout, w):
    env = make(layout, control="torque")
    assert env.action_space.shape == (w * 5,)
    assert env.observation_space.shape == ((26 + w) * 5 + 16 + 3,)
    env.reset(seed=0)
    observation, *_ = env.step(np.random.default_rng(0).uniform(-0.2, 0.2, 5 * w).astype(np.float32))
    block, parts = observation[: 5 * (26 + w)].reshape(5, 26 + w), env.observation_layout.split(observation)
    assert block[:, 18 : 18 + w] == pytest.approx(env.state.wheel_speed / (6000.0 * np.pi / 30.0), rel=1e-6)
    places = {"imaging": slice(18 + w, 19 + w), "link": slice(19 + w, 20 + w), "stored": slice(20 + w, 21 + w)}
    for name, place in {**places, "role": slice(21 + w, 26 + w)}.items():
        assert np.array_equal(block[:, place], parts[name])
    assert (parts["role"].sum(axis=1) == 1.0).all()
    env.close()


def test_four_wheels_share_the_torque_that_the_action_would_exert():
    env = make("pyramid", control="torque")
    env.reset(seed=0)
    action = np.random.default_rng(0).uniform(-0.1, 0.1, (5, 4))
    env.step(action.ravel().astype(np.float32))
    axes, motor = env.plan.properties.wheel_axes_B, env.batch.flights.ctrl.reshape(5, 4)
    assert motor @ axes == pytest.approx(0.004 * action @ axes, rel=1e-5, abs=1e-10)
    # The least of all torques with that effect: nothing in the direction that has none.
    idle = np.linalg.svd(axes.T)[2][-1]
    assert motor @ idle == pytest.approx(np.zeros(5), abs=1e-12)
    assert np.abs(0.004 * action @ idle).min() > 1e-5
    env.close()


@LAYOUTS
def test_agents_have_the_same_and_a_state_in_its_space(layout, w):
    pytest.importorskip("pettingzoo")
    from swarm_mj.envs.multi_agent import swarm_observe_v0

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
