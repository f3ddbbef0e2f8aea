"""SwarmObserve-v0 as gymnasium asks for it: its own checker, determinism, episode ends, memory."""

import pickle
import subprocess
import sys
import warnings
from dataclasses import fields

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from swarm_mj.envs import SwarmObserveEnv
from swarm_mj.envs.observe.config import EnvConfig

from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.simulation import Simulation

from .flights import place, resident_mib

LEVELS = ("torque", "pointing", "role")


def make(control="role", **arguments):
    return gymnasium.make("SwarmObserve-v0", **({"control": control, "step_s": 10.0} | arguments))


@pytest.fixture(scope="module", params=LEVELS)
def env(request):
    env = make(request.param)
    yield env
    env.close()


def episode(env, seed, steps=None):
    """Observations, rewards and infos of an episode with random actions."""
    observation, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    rows, rewards, infos, done = [observation], [], [info], False
    while not done and (steps is None or len(rewards) < steps):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        rows.append(observation)
        rewards.append(reward)
        infos.append(info)
        done = terminated or truncated
    return np.array(rows), np.array(rewards), infos


@pytest.mark.parametrize("control", LEVELS)
def test_gymnasiums_checker_has_no_complaint(control):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*out of date", category=DeprecationWarning)  # there is a v1
        env = make(control)
        check_env(env.unwrapped, skip_render_check=True)
        env.close()


def test_observations_of_random_episodes_lie_in_the_space_and_are_finite(env):
    rows, rewards, _ = episode(env, seed=3)
    assert len(rows) == 151
    assert np.isfinite(rows).all()
    assert np.isfinite(rewards).all()
    assert all(row in env.observation_space for row in rows)
    assert np.isfinite(env.observation_space.low).all() and np.isfinite(env.observation_space.high).all()


def test_the_same_seed_gives_the_same_episode_and_another_seed_another(env):
    first, rewards, _ = episode(env, seed=5, steps=40)
    again, rewards_again, _ = episode(env, seed=5, steps=40)
    other, _, _ = episode(env, seed=6, steps=40)
    assert np.array_equal(first, again)
    assert np.array_equal(rewards, rewards_again)
    assert not np.array_equal(first[0], other[0])


def test_episodes_are_the_same_in_a_new_process():
    code = (
        "import gymnasium, numpy as np\n"
        f"for control in {LEVELS}:\n"
        "    env = gymnasium.make('swarm_mj.envs:SwarmObserve-v0', control=control, step_s=10.0)\n"
        "    rows = [env.reset(seed=11)[0]]; env.action_space.seed(11)\n"
        "    for _ in range(30): rows.append(env.step(env.action_space.sample())[0])\n"
        "    print(np.array(rows).tobytes().hex())\n"
    )
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    for control, rows in zip(LEVELS, there, strict=True):
        env = make(control)
        assert episode(env, seed=11, steps=30)[0].tobytes().hex() == rows
        env.close()


def test_successive_resets_without_a_seed_start_differently_and_reproducibly(roles):
    starts = []
    for _ in range(2):
        starts.append([roles.reset(seed=1)[0], roles.reset()[0], roles.reset()[0]])
    assert np.array_equal(starts[0], starts[1])
    assert not np.array_equal(starts[0][0], starts[0][1])
    assert not np.array_equal(starts[0][1], starts[0][2])


def test_observations_share_no_memory_with_each_other_or_the_environment(roles):
    rows = [roles.reset(seed=0)[0]]
    for _ in range(3):
        rows.append(roles.step(roles.action_space.sample())[0])
    kept = [row.copy() for row in rows]
    batch = roles.batch
    for i, row in enumerate(rows):
        assert not np.shares_memory(row, batch.observation) and not np.shares_memory(row, batch.flights.qpos)
        assert not any(np.shares_memory(row, other) for other in rows[:i])
        row[:] = 7.0
    follow, *_ = roles.step(np.full(5, 16))
    roles.reset(seed=0)
    roles.action_space.seed(None)
    assert not (follow == 7.0).any()
    assert all(row in roles.observation_space for row in kept)


def test_the_specification_survives_pickling_and_makes_the_same_environment(env):
    spec = pickle.loads(pickle.dumps(env.spec))
    twin = gymnasium.make(spec)
    assert twin.unwrapped.action_space == env.unwrapped.action_space
    assert np.array_equal(twin.reset(seed=4)[0], env.reset(seed=4)[0])
    twin.close()
    scenario = load_scenario("eros-observe", ["camera.half_angle_deg=4"])
    with_object = gymnasium.make(pickle.loads(pickle.dumps(make(scenario=scenario).spec)))
    assert with_object.unwrapped.plan.scenario == scenario


def test_a_flight_ends_by_truncation_at_the_scenarios_duration_and_asks_for_a_reset(roles):
    roles.reset(seed=0)
    for k in range(150):
        *_, terminated, truncated, info = roles.step(np.full(5, 16))
        assert (terminated, truncated) == (False, k == 149)
    assert info["time_s"] == 1500.0
    with pytest.raises(gymnasium.error.ResetNeeded):
        roles.step(np.full(5, 16))
    roles.reset()
    roles.step(np.full(5, 16))


def test_a_diverged_flight_terminates_with_the_last_finite_observation(roles):
    roles.reset(seed=0)
    before, *_ = roles.step(np.full(5, 16))
    place(roles.batch.flights, 0, 0, rate=np.nan)
    observation, reward, terminated, truncated, info = roles.step(np.full(5, 16))
    assert (terminated, truncated, info["end"]) == (True, False, "diverged")
    assert "sc1" in info["cause"]
    assert np.array_equal(observation, before)
    assert reward == -1.0
    observation, _ = roles.reset(seed=0)
    assert np.isfinite(observation).all()


def test_a_spacecraft_that_hits_the_body_ends_the_episode(roles):
    roles.reset(seed=0)
    above = roles.plan.points_A[0] @ roles.plan.environment.C_AN(0.0)
    batch = roles.batch
    place(batch.flights, 0, 0, position=above, velocity=-above / 5.0)
    batch.now.r_A[0, 0] = roles.plan.points_A[0]
    *_, terminated, truncated, info = roles.step(np.full(5, 16))
    assert (terminated, truncated, info["end"]) == (True, False, "impact")
    assert info["reward_terms"]["loss"] == -1.0


def test_a_thousand_resets_do_not_grow_the_process(roles):
    def use(times):
        for k in range(times):
            roles.reset(seed=k)
            roles.step(roles.action_space.sample())

    use(100)
    before = resident_mib()
    use(1000)
    assert resident_mib() - before < 8.0


def test_a_closed_environment_may_be_closed_again_but_not_flown():
    env = make("role")
    env.reset(seed=0)
    env.close()
    env.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        env.unwrapped.reset()


def test_a_simulation_is_built_once_and_flown_again(roles, monkeypatch):
    def refuse(*args, **keys):
        raise AssertionError("reset built a simulation")

    monkeypatch.setattr(Simulation, "__init__", refuse)
    roles.reset(seed=0)
    roles.step(np.full(5, 16))


@pytest.mark.slow
def test_it_works_in_a_spawned_worker_process():
    vector = gymnasium.make_vec(
        "swarm_mj.envs:SwarmObserve-v0", num_envs=1, vectorization_mode="async", vector_kwargs={"context": "spawn"}
    )
    single = make("role")
    observations, _ = vector.reset(seed=[2])
    actions = np.full((1, 5), 16)
    after, *_ = vector.step(actions)
    assert np.array_equal(single.reset(seed=2)[0], observations[0])
    assert np.array_equal(single.step(actions[0])[0], after[0])
    vector.close()
    single.close()


def table(section):
    """Rows of the first table of a section of the docstring, without its head."""
    text = SwarmObserveEnv.__doc__.split(f"## {section}\n")[1].split("\n    ## ")[0]
    lines = [line.strip() for line in text.splitlines() if line.strip().startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_the_docstring_has_the_weights_arguments_and_infos_that_there_are(roles):
    assert {name: float(weight) for name, weight, _ in table("Reward")} == roles.reward_weights
    defaults = {row[0]: row[1].strip('`"') for row in table("Arguments")}
    for item in fields(EnvConfig):
        assert defaults[item.name] == str(item.default) or float(defaults[item.name]) == item.default
    assert set(defaults) == {item.name for item in fields(EnvConfig)} | {"render_mode", "width, height"}
    _, start = roles.reset(seed=0)
    *_, later = roles.step(np.full(5, 16))
    assert {row[0] for row in table("Info")} == start.keys() | later.keys() | {"end", "cause"}
    entries = [(row[0], row[1], row[4]) for row in table("Observation space")]
    for entry, name, bounds in entries[:6]:
        first, last = (int(number) for number in entry.split("-"))
        low, high = (float(number) for number in bounds.split(","))
        assert roles.observation_layout.columns[name] == slice(first, last + 1)
        assert set(roles.observation_space.low[first : last + 1]) == {low}
        assert set(roles.observation_space.high[first : last + 1]) == {high}
    assert [name for _, name, _ in entries] == list(roles.observation_layout.columns)


def test_the_documented_name_of_version_0_1_still_works_with_a_warning(roles):
    with pytest.warns(DeprecationWarning, match="observation_layout"):
        assert roles.readings is roles.observation_layout
