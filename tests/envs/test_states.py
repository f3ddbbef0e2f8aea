"""States of flights to go back to, and environments that are copied and pickled."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest

from swarm_mj.errors import ScenarioError

from .flights import ID, place

DUPLICATES = (copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env)))
LEVELS = ("role", "pointing", "torque")
FAST = ("physics.wheels=gyrostat", "physics.stepper=kernel")
#: Noise, delay, failures in flight, masses and gravity of one's own, four wheels; flown by Python.
WRONG = (
    "spacecraft.wheel_layout=pyramid",
    "dispersions.star_tracker_noise_arcsec=30",
    "dispersions.gyro_angular_random_walk_deg_sqrt_h=1",
    "dispersions.mass_percent=5",
    "dispersions.gravity_percent=1",
    "dispersions.delay_s=1",
    "faults=[{kind: wheel_lost, spacecraft: sc1, wheel: 1, at_s: 25}, {kind: camera_off, spacecraft: any, at_s: 12, "
    "duration_s: 20}, {kind: spacecraft_lost, spacecraft: sc3, at_s: 33, detection_s: 15}]",
)


def same(a, b):
    """Whether two answers of an environment are the same, bit for bit."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (tuple, list)):
        return len(a) == len(b) and all(same(*pair) for pair in zip(a, b, strict=True))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return type(a) is type(b) and a == b


def flown(env, actions):
    """What steps answer; a flight that ends is reset, which draws its seed."""
    answers = []
    for action in actions:
        answers.append(env.step(action))
        if answers[-1][2] or answers[-1][3]:
            answers.append(env.reset())
    return answers


@pytest.mark.parametrize("control", LEVELS)
@pytest.mark.parametrize("overrides", [(), FAST, WRONG], ids=["plain", "kernel", "faults"])
def test_a_flight_goes_on_from_its_state_bit_for_bit(control, overrides):
    env = gymnasium.make(ID, control=control, overrides=list(overrides), step_s=10.0).unwrapped
    other = gymnasium.make(ID, control=control, overrides=list(overrides), step_s=10.0).unwrapped
    env.action_space.seed(1)
    env.reset(seed=4)
    flown(env, [env.action_space.sample() for _ in range(2)])
    state, observation = env.get_state(), env.batch.observation[0].copy()
    actions = [env.action_space.sample() for _ in range(4)]
    first = flown(env, actions)
    env.step(env.action_space.sample())
    again, info = env.set_state(state)
    assert np.array_equal(again, observation) and info["time_s"] == 20.0
    assert same(flown(env, actions), first)
    other.reset(seed=99)
    flown(other, actions[:1])
    other.set_state(pickle.loads(pickle.dumps(state)))
    assert same(flown(other, actions), first)


def test_a_state_holds_the_seeds_of_the_resets_to_come(roles):
    roles.reset(seed=5)
    state = roles.get_state()
    seeds = [roles.reset()[1]["flight_seed"] for _ in range(2)]
    roles.set_state(state)
    assert [roles.reset()[1]["flight_seed"] for _ in range(2)] == seeds


def test_states_of_single_and_vector_environments_are_the_same_and_leave_the_others_alone(roles):
    vector = gymnasium.make_vec(ID, num_envs=3, threads=2)
    vector.reset(seed=7)
    roles.reset(seed=0)
    roles.action_space.seed(2)
    for _ in range(3):
        roles.step(roles.action_space.sample())
    before, seen = vector.get_state(1), vector.batch.observation[1]
    assert np.array_equal(vector.set_state(2, roles.get_state()), roles.batch.observation[0])
    action = roles.action_space.sample()
    answer = roles.step(action)
    observations, rewards, *_ = vector.step(np.tile(action, (3, 1)))
    assert np.array_equal(observations[2], answer[0]) and rewards[2] == answer[1]
    assert np.array_equal(roles.set_state(before)[0], seen)
    assert np.array_equal(roles.step(action)[0], observations[1])
    vector.close()


def test_who_holds_a_direction_goes_on_holding_it(roles):
    hold = np.full(5, 23)
    roles.reset(seed=1)
    roles.step(hold)
    state = roles.get_state()
    first = [roles.step(hold) for _ in range(3)]
    roles.step(np.full(5, 16))
    roles.set_state(state)
    assert same([roles.step(hold) for _ in range(3)], first)


def test_states_of_others_are_refused_by_name(roles):
    roles.reset(seed=0)
    other = gymnasium.make(ID, overrides=["camera.half_angle_deg=3"]).unwrapped
    with pytest.raises(gymnasium.error.ResetNeeded):
        other.get_state()
    with pytest.raises(ScenarioError, match="environment with other arguments"):
        other.set_state(roles.get_state())
    with pytest.raises(ScenarioError, match="state = int: must be what get_state"):
        roles.set_state(3)
    other.close()


@pytest.mark.parametrize("duplicate", DUPLICATES, ids=["copy", "pickle"])
@pytest.mark.parametrize("wrapped", [True, False])
def test_a_copied_environment_flies_on_as_the_first_and_apart_from_it(duplicate, wrapped):
    env = gymnasium.make(ID, overrides=["camera.half_angle_deg=3"])
    env = env if wrapped else env.unwrapped
    fresh = duplicate(env)
    assert np.array_equal(fresh.reset(seed=3)[0], env.reset(seed=3)[0])
    env.action_space.seed(1)
    env.step(env.action_space.sample())
    other = duplicate(env)
    actions = [env.action_space.sample() for _ in range(3)]
    assert np.array_equal([other.action_space.sample() for _ in range(3)], actions)
    assert same(flown(other, actions), flown(env, actions))
    assert other.unwrapped.spec == env.unwrapped.spec


@pytest.mark.parametrize("duplicate", DUPLICATES, ids=["copy", "pickle"])
def test_a_copied_vector_environment_flies_on_as_the_first(duplicate):
    env = gymnasium.make_vec(ID, num_envs=3, threads=2, overrides=["duration_s=1500"])
    env.reset(seed=3)
    actions = [env.action_space.sample() for _ in range(3)]
    env.step(actions[0])
    other = duplicate(env)
    assert same([other.step(action) for action in actions], [env.step(action) for action in actions])
    other.close()
    env.close()


def test_overrides_and_other_arguments_go_through_json():
    env = gymnasium.make(ID, control="pointing", overrides=["physics.wheels=gyrostat", "camera.half_angle_deg=4"])
    spec = gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json())
    again = gymnasium.make(spec)
    assert again.unwrapped.plan.scenario.physics.wheels == "gyrostat"
    assert again.unwrapped.plan.scenario.camera.half_angle_deg == 4.0
    assert np.array_equal(again.reset(seed=1)[0], env.reset(seed=1)[0])


def test_the_horizon_may_end_a_flight():
    env = gymnasium.make(ID, horizon_terminates=True).unwrapped
    usual = gymnasium.make(ID).unwrapped
    for each in (env, usual):
        each.reset(seed=0)
        answers = flown_to_the_end(each)
        *_, terminated, truncated, info = answers[-1]
        assert (terminated, truncated, info.get("end")) == (
            each is env,
            each is usual,
            "horizon" if each is env else None,
        )
        assert not any(answer[2] or answer[3] for answer in answers[:-1])
    vector = gymnasium.make_vec(ID, num_envs=2, horizon_terminates=True)
    vector.reset(seed=0)
    for _ in range(len(answers)):
        *_, terminated, truncated, infos = vector.step(np.full((2, 5), 16))
    assert terminated.all() and not truncated.any() and list(infos["end"]) == ["horizon"] * 2
    vector.close()


def flown_to_the_end(env):
    """All answers of a flight that looks at the body's centre."""
    answers = [env.step(np.full(5, 16))]
    while not (answers[-1][2] or answers[-1][3]):
        answers.append(env.step(np.full(5, 16)))
    return answers


@pytest.mark.parametrize("observability", ["full", "graph"])
@pytest.mark.parametrize("duplicate", [*DUPLICATES, None], ids=["copy", "pickle", "state"])
def test_a_flight_of_agents_goes_on_from_its_state_and_from_a_copy(duplicate, observability):
    pytest.importorskip("pettingzoo")
    from swarm_mj.envs.observe.multi_agent import swarm_observe_v0

    deaf = ["link.crosslink.power_w=1e-9"] if observability == "graph" else []
    env = swarm_observe_v0.parallel_env(agent_prefix="sc_", observability=observability, overrides=deaf)
    assert env.possible_agents == ["sc_1", "sc_2", "sc_3", "sc_4", "sc_5"]
    env.reset(seed=0)
    above_N = env.task.plan.points_A[1] @ env.task.plan.environment.C_AN(0.0)
    place(env.batch.flights, 0, 1, position=above_N, velocity=-above_N / 5.0)
    env.batch.now.r_A[0, 1] = env.task.plan.points_A[1]
    env.step(dict.fromkeys(env.agents, 16))
    assert env.agents == ["sc_1", "sc_3", "sc_4", "sc_5"]
    state = env.get_state()
    actions = [{agent: k for k, agent in enumerate(env.agents)}, dict.fromkeys(env.agents, 22)]
    other = env if duplicate is None else duplicate(env)
    first = [env.step(action) for action in actions]
    if duplicate is None:
        assert set(env.set_state(state)) == {"sc_1", "sc_3", "sc_4", "sc_5"}
    assert same([other.step(action) for action in actions], first)


def test_agents_are_named_by_a_text():
    pytest.importorskip("pettingzoo")
    from swarm_mj.envs.observe.multi_agent import swarm_observe_v0

    with pytest.raises(ScenarioError, match="agent_prefix = ''"):
        swarm_observe_v0.parallel_env(agent_prefix="")
