"""The vector environment flies, bit for bit, what single environments fly; autoreset, seeds, infos, threads."""

import warnings

import gymnasium
import numpy as np
import pytest
import swarm_mj.envs  # noqa: F401
from gymnasium.vector import AutoresetMode

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.fly import make_simulation
from swarm_mj.scenarios.loading import load_scenario

from .flights import place

ID = "swarm_mj.envs:SwarmObserve-v0"


def single_twins(count, seed, **arguments):
    envs = [gymnasium.make(ID, **arguments).unwrapped for _ in range(count)]
    return envs, np.array([env.reset(seed=seed + e)[0] for e, env in enumerate(envs)])


def actions_of(space, steps, seed=0):
    space.seed(seed)
    return [space.sample() for _ in range(steps)]


@pytest.mark.parametrize("control", ["role", "pointing", "torque"])
def test_every_flight_is_bit_for_bit_that_of_a_single_environment(control):
    vector = gymnasium.make_vec(ID, num_envs=5, control=control, threads=2, step_s=10.0)
    singles, start = single_twins(5, 40, control=control, step_s=10.0)
    observations, _ = vector.reset(seed=40)
    assert np.array_equal(observations, start)
    over = np.zeros(5, bool)
    for action in actions_of(vector.action_space, 156):
        observations, rewards, terminated, truncated, infos = vector.step(action)
        for e, env in enumerate(singles):
            if over[e]:
                row, reward, ends = env.reset()[0], 0.0, (False, False)
            else:
                row, reward, *ends, info = env.step(action[e])
                assert info["coverage_percent"] == infos["coverage_percent"][e]
                assert info["reward_terms"]["seen"] == infos["reward_terms"]["seen"][e]
            assert np.array_equal(row, observations[e])
            assert reward == rewards[e]
            assert tuple(ends) == (terminated[e], truncated[e])
            over[e] = any(ends)
    assert infos["time_s"].max() == 60.0 or infos["time_s"].max() == 50.0  # all have begun a second flight
    vector.close()
    for env in singles:
        env.close()


def test_neither_the_number_of_flights_nor_of_threads_changes_a_flight():
    rows = []
    for count, threads in ((1, 1), (3, 1), (8, 2), (8, 3)):
        vector = gymnasium.make_vec(ID, num_envs=count, threads=threads)
        vector.reset(seed=7)
        action = np.random.default_rng(1).integers(0, 24, (40, 5))
        for k in range(40):
            observations, *_ = vector.step(np.tile(action[k], (count, 1)))
        rows.append(observations[0].copy())
        vector.close()
    assert all(np.array_equal(rows[0], row) for row in rows[1:])


def test_a_perturbed_flight_in_compiled_code_is_the_same_too():
    scenario = load_scenario("eros-observe", ["perturbations.solar_tide=true"])
    vector = gymnasium.make_vec(ID, num_envs=3, scenario=scenario)
    assert not vector.batch.batches[0].why_python
    singles, start = single_twins(3, 2, scenario=scenario)
    observations, _ = vector.reset(seed=2)
    assert np.array_equal(observations, start)
    for action in actions_of(vector.action_space, 10):
        observations, *_ = vector.step(action)
        assert np.array_equal(observations, np.array([env.step(action[e])[0] for e, env in enumerate(singles)]))
    vector.close()


@pytest.mark.parametrize("wheels", ["bodies", "gyrostat"])
@pytest.mark.parametrize("control", ["role", "pointing", "torque"])
def test_separate_simulations_fly_bit_for_bit_what_the_batch_flies(control, wheels, monkeypatch):
    """Among others: the batch asks behaviours seldom, separate simulations at every instant."""

    def fly():
        scenario = load_scenario("eros-observe", [f"physics.wheels={wheels}"])
        env = gymnasium.make(ID, control=control, scenario=scenario, step_s=10.0).unwrapped
        env.reset(seed=3)
        rows, aims, over = [], set(), False
        for action in actions_of(env.action_space, 200):
            if over:
                break
            row, _, *ends, _ = env.step(action)
            over = any(ends)
            rows.append(row)
            if not env.batch.why_python:
                aims.add(tuple(env.batch.flights.kind[0].tolist()))
        compiled = not env.batch.why_python
        env.close()
        assert not compiled or len(aims) > 1
        return compiled, np.array(rows)

    compiled, rows = fly()

    def refused(plan):
        simulation = make_simulation(plan)
        simulation.why_not_compiled = lambda law: "the test says so"
        return simulation

    monkeypatch.setattr("swarm_mj.envs.observe.task.make_simulation", refused)
    separate, others = fly()
    assert (compiled, separate) == (True, False)
    assert np.array_equal(rows, others)


@pytest.mark.parametrize("control", ["role", "pointing", "torque"])
def test_a_flight_of_gyrostats_is_that_of_a_single_environment_and_close_to_that_of_wheels_as_bodies(control):
    scenario = load_scenario("eros-observe", ["physics.wheels=gyrostat"])
    vector = gymnasium.make_vec(ID, num_envs=3, control=control, scenario=scenario, threads=2)
    bodies = gymnasium.make_vec(ID, num_envs=3, control=control, threads=2)
    singles, start = single_twins(3, 11, control=control, scenario=scenario)
    observations, _ = vector.reset(seed=11)
    others, _ = bodies.reset(seed=11)
    assert np.array_equal(observations, start)
    for action in actions_of(vector.action_space, 30):
        observations, rewards, *_ = vector.step(action)
        others, others_rewards, *_ = bodies.step(action)
        rows = [env.step(action[e]) for e, env in enumerate(singles)]
        assert np.array_equal(observations, np.array([row[0] for row in rows]))
        assert np.array_equal(rewards, np.array([row[1] for row in rows]))
        if (
            control != "torque"
        ):  # without control the swarm tumbles ever faster, and steps of 0.5 s tell the models apart
            assert np.allclose(observations, others, atol=1e-5)
            assert np.allclose(rewards, others_rewards, atol=1e-5)
    vector.close()
    bodies.close()


def short():
    return load_scenario("eros-observe", ["duration_s=120", "design.time_of_flight_s=60"])


@pytest.fixture
def scenario():
    try:
        return short()
    except ScenarioError:
        pytest.skip("the short scenario is not allowed")


def test_next_step_mode_starts_anew_in_the_call_after_an_end(scenario):
    vector = gymnasium.make_vec(ID, num_envs=2, scenario=scenario)
    assert vector.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    vector.reset(seed=0)
    action = np.full((2, 5), 16)
    for _ in range(12):
        _, _, terminated, truncated, _ = vector.step(action)
    assert (terminated | truncated).all()
    observations, rewards, terminated, truncated, infos = vector.step(action)
    assert (rewards == 0.0).all() and not (terminated | truncated).any()
    assert (infos["time_s"] == 0.0).all() and infos["_flight_seed"].all()
    left = vector.batch.task.observation_layout.split(observations[0])["time_left"]
    assert left == 1.0
    vector.close()


def test_same_step_mode_gives_the_end_in_final_obs_and_goes_on(scenario):
    vector = gymnasium.make_vec(ID, num_envs=2, scenario=scenario, autoreset_mode="SameStep")
    twin = gymnasium.make(ID, scenario=scenario).unwrapped
    vector.reset(seed=5)
    twin.reset(seed=5)
    action = np.full((2, 5), 16)
    for _ in range(12):
        observations, rewards, terminated, truncated, infos = vector.step(action)
        last, reward, *_ = twin.step(action[0])
    assert (terminated | truncated).all() and rewards[0] == reward
    assert infos["_final_obs"].all() and np.array_equal(infos["final_obs"][0], last)
    assert infos["final_info"]["time_s"][0] == 120.0 and infos["time_s"][0] == 0.0
    assert np.array_equal(observations[0], twin.reset()[0])
    vector.close()


def test_same_step_mode_tells_the_reward_terms_of_the_flights_that_go_on(scenario):
    vector = gymnasium.make_vec(ID, num_envs=2, scenario=scenario, autoreset_mode="SameStep")
    vector.reset(seed=5)
    action = np.full((2, 5), 16)
    for _ in range(5):
        vector.step(action)
    vector.reset(options={"reset_mask": np.array([True, False])})
    for _ in range(7):
        _, rewards, _, truncated, infos = vector.step(action)
    assert truncated.tolist() == [False, True] and infos["_reward_terms"].tolist() == [True, False]
    assert sum(term[0] for term in infos["reward_terms"].values()) == pytest.approx(rewards[0], abs=1e-12)
    vector.close()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_flights_that_were_never_begun_are_not_flown(mode):
    vector = gymnasium.make_vec(ID, num_envs=2, autoreset_mode=mode)
    vector.reset(seed=0, options={"reset_mask": np.array([True, False])})
    with pytest.raises(gymnasium.error.ResetNeeded):
        vector.step(np.full((2, 5), 16))
    vector.reset(options={"reset_mask": np.array([False, True])})
    _, _, terminated, _, _ = vector.step(np.full((2, 5), 16))
    assert not terminated.any()
    vector.close()


def test_disabled_mode_asks_for_a_reset_of_the_flights_that_ended(scenario):
    vector = gymnasium.make_vec(ID, num_envs=3, scenario=scenario, autoreset_mode="Disabled")
    vector.reset(seed=0)
    for _ in range(12):
        *_, truncated, _ = vector.step(np.full((3, 5), 16))
    assert truncated.all()
    with pytest.raises(gymnasium.error.ResetNeeded):
        vector.step(np.full((3, 5), 16))
    mask = np.array([True, False, True])
    _, infos = vector.reset(options={"reset_mask": mask})
    assert infos["_flight_seed"].tolist() == mask.tolist()
    assert infos["time_s"].tolist() == [0.0, 120.0, 0.0]
    vector.reset(options={"reset_mask": ~mask})
    vector.step(np.full((3, 5), 16))
    vector.close()


def test_flight_seeds_can_be_given_and_start_the_flight_of_the_command_line():
    vector = gymnasium.make_vec(ID, num_envs=2)
    observations, infos = vector.reset(options={"flight_seed": [12, 13]})
    assert infos["flight_seed"].tolist() == [12, 13]
    single = gymnasium.make(ID)
    assert np.array_equal(single.reset(options={"flight_seed": 13})[0], observations[1])
    vector.close()


def test_a_diverged_flight_ends_alone_with_its_cause():
    vector = gymnasium.make_vec(ID, num_envs=3, threads=1)
    vector.reset(seed=0)
    vector.step(np.full((3, 5), 16))
    place(vector.batch.batches[0].flights, 1, 1, velocity=np.nan)
    _, rewards, terminated, _, infos = vector.step(np.full((3, 5), 16))
    assert terminated.tolist() == [False, True, False]
    assert rewards[1] == -1.0
    assert infos["end"][1] == "diverged" and "sc2" in infos["cause"][1]
    observations, *_ = vector.step(np.full((3, 5), 16))
    assert np.isfinite(observations).all()
    vector.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"num_envs": 0}, "num_envs = 0"),
        ({"num_envs": 1, "threads": 0}, "threads = 0"),
        ({"num_envs": 1, "render_mode": "human"}, "render_mode = 'human': must be None or one of rgb_array"),
        ({"num_envs": 1, "render_flights": 0}, "render_flights = 0"),
        ({"num_envs": 1, "patches": 15}, "patches = 15"),
    ],
)
def test_bad_arguments_are_clear_errors(arguments, words):
    with pytest.raises(ScenarioError, match=words):
        gymnasium.make_vec(ID, **arguments)


def test_bad_options_seeds_and_actions_are_clear_errors():
    vector = gymnasium.make_vec(ID, num_envs=2)
    with pytest.raises(gymnasium.error.ResetNeeded):
        vector.step(np.full((2, 5), 16))
    with pytest.raises(ScenarioError, match="reset_mask"):
        vector.reset(options={"reset_mask": [1, 0]})
    with pytest.raises(ScenarioError, match="3 values for 2"):
        vector.reset(seed=[1, 2, 3])
    with pytest.raises(ScenarioError, match="wind"):
        vector.reset(options={"wind": 1})
    vector.reset(seed=0)
    with pytest.raises(gymnasium.error.InvalidAction):
        vector.step(np.full((2, 5), 99))
    vector.close()
    vector.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        vector.reset()


def test_making_it_raises_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Gymnasium tells everyone who asks for v0 that there is a v1.
        warnings.filterwarnings("ignore", message=".*out of date", category=DeprecationWarning)
        gymnasium.make_vec(ID, num_envs=2).close()
