"""Arguments and options that are no such thing: the project's own error, with key, value and what is allowed."""

import gymnasium
import numpy as np
import pytest
from swarm_mj.envs.observe.config import EnvConfig

from swarm_mj.errors import ScenarioError, SwarmError
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario

ID = "swarm_mj.envs:SwarmObserve-v0"
POOL = ["ellipsoid-train-1"]


def refused(words, make, arguments):
    with pytest.raises(SwarmError) as caught:
        make(ID, **arguments)
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"reward_weights": [1]}, ["reward_weights = [1]", "mapping", "seen, delivered"]),
        ({"reward_weights": {"seen": "1"}}, ["reward_weights['seen'] = '1'", "finite number"]),
        ({"decision_s": "10"}, ["decision_s = '10'", "divides 600 s"]),
        ({"scenario": "eros-observe", "decision_s": [10]}, ["decision_s = [10]", "number", "control.period_s = 0.5"]),
        ({"patches": 4.0}, ["patches = 4.0", "whole square number such as 4, 9"]),
        ({"patches": "16"}, ["patches = '16'", "whole square number"]),
        ({"patches": True}, ["patches = True"]),
        ({"complete": "99"}, ["complete = '99'", "number above 0 and at most 100"]),
        ({"scenario": 3}, ["scenario = 3", "packaged name", "YAML"]),
        ({"patches": 2**70}, ["patches = 1180591620717411303424", "one would hold no cell"]),
        ({"width": "640"}, ["width = '640'", "whole number of pixels from 64 to 8192"]),
        ({"height": 0}, ["height = 0", "whole number of pixels from 64 to 8192"]),
        ({"height": 100_000}, ["height = 100000", "from 64 to 8192"]),
        ({"scenario": "eros-obsreve"}, ["eros-obsreve", "Did you mean 'eros-observe'"]),
        ({"scenario": "/nowhere/a.yaml"}, ["/nowhere/a.yaml"]),
        ({"scenario": "eros-observe", "decision_s": 0.7}, ["decision_s = 0.7", "control.period_s"]),
        ({"scenario": "eros-observe", "decision_s": 7.0}, ["decision_s = 7.0", "duration_s = 1500"]),
        ({"scenario": "eros-observe", "decision_s": -10.0}, ["decision_s = -10.0"]),
        ({"scenario": "eros-observe", "missions": 3}, ["missions = 3: scenario= says that itself"]),
        ({"scenario": "eros-observe", "max_spacecraft": 3}, ["max_spacecraft = 3: scenario= says that itself"]),
        ({"scenario": "eros-observe", "randomise": {"speed": 1.0}}, ["speed is what scenario= says", "release_error"]),
        ({"target": "body"}, ["target = 'body'", "scenario="]),
        ({"target": "sky", "scenario": "eros-observe"}, ["target = 'sky'", "scenario, body"]),
        ({"knowledge": "graph"}, ["knowledge = 'graph'", "SwarmObserveParallelEnv"]),
        ({"patches": 15}, ["patches = 15", "square"]),
        ({"observer": "eyes"}, ["eyes", "raycast"]),
        ({"observer": "raycast"}, ["needs scenario=", "horizon maps"]),
        ({"complete": 0.0}, ["complete = 0.0"]),
        ({"reward_weights": {"fun": 1.0}}, ["fun", "seen, delivered"]),
        ({"reward_weights": {"seen": float("inf")}}, ["reward_weights['seen']", "finite"]),
        (
            {
                "scenario": load_scenario(
                    "eros-observe", {"designer.extra_targets": [{"latitude_deg": 0, "longitude_deg": 0}]}
                )
            },
            ["designer.extra_targets", "one environment for each"],
        ),
    ],
)
def test_arguments(arguments, words):
    refused(words, gymnasium.make, arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"num_envs": 2.5}, ["num_envs = 2.5", "whole number of at least 1"]),
        ({"num_envs": "2"}, ["num_envs = '2'", "whole number of at least 1"]),
        ({"num_envs": 2, "threads": 1.5}, ["threads = 1.5", "whole number of at least 1, or None"]),
        ({"num_envs": 2, "autoreset_mode": "nextstep"}, ["'nextstep'", "NextStep, SameStep, Disabled"]),
        ({"num_envs": 2, "autoreset_mode": None}, ["autoreset_mode = None", "NextStep, SameStep, Disabled"]),
    ],
)
def test_arguments_of_the_vector_environment(arguments, words):
    refused(words, gymnasium.make_vec, arguments)


@pytest.mark.parametrize(
    ("name", "argument", "words"),
    [
        ("SwarmObserve-v0", "patchs", "unknown argument patchs; did you mean patches.; .* it takes missions, split"),
        ("SwarmPointing-v0", "threads", "unknown argument threads; .* it takes scenario, observation"),
        ("SwarmDownlink-v0", "control", "unknown argument control; .* it takes scenario, step_s, horizon_s"),
    ],
)
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_an_argument_that_there_is_not_is_told_which_there_are(name, argument, words, make):
    with pytest.raises(ScenarioError, match=f"^{name}: {words}"):
        make(f"swarm_mj.envs:{name}", **{argument: 1})


@pytest.mark.parametrize("name", ["SwarmObserve-v0", "SwarmDownlink-v0"])
def test_more_episodes_than_memory_holds_are_refused_too(name):
    with pytest.raises(ScenarioError, match=r"num_envs = 10000000000: so many .* at most \d+ fit here"):
        gymnasium.make_vec(f"swarm_mj.envs:{name}", num_envs=10_000_000_000)


def test_an_action_of_many_flights_is_refused_in_one_line():
    vector = gymnasium.make_vec("swarm_mj.envs:SwarmObserve-v0", num_envs=2, missions=["ellipsoid-train-1"])
    vector.reset(seed=0)
    with pytest.raises(gymnasium.error.InvalidAction, match=r"^action .*20.* does not lie in .*$") as caught:
        vector.step(np.full((2, 3), 20))
    assert "\n" not in str(caught.value)
    vector.close()


def test_options_and_seeds_of_the_vector_environment():
    vector = gymnasium.make_vec(ID, num_envs=2, missions=POOL, observation="flat")
    bad = [
        ({"options": {"flight_seed": [1, 2, 3]}}, r"flight_seed = \[1, 2, 3\].*each of the 2 flights, not 3"),
        ({"options": {"flight_seed": [1]}}, r"flight_seed = \[1\].*each of the 2 flights, not 1"),
        ({"options": {"flight_seed": [1, 2.5]}}, r"flight_seed = 2.5: must be a whole number"),
        ({"options": {"flight_seed": "a"}}, r"flight_seed = 'a': must be a whole number"),
        ({"options": {"flight_seed": 2**63}}, r"flight_seed = 9223372036854775808: must be .* to 9223372036854775807"),
        ({"options": {"foo": 1, 3: 2}}, r"reset options \['3', 'foo'\]: unknown; allowed: flight_seed, draw"),
        ({"options": {"reset_mask": [True, [False]]}}, r"reset_mask: must be 2 booleans"),
        ({"options": [1]}, r"reset options = \[1\]: must be a mapping"),
        ({"seed": 2.5}, r"seed = 2.5: must be a whole number"),
        ({"seed": [1, "b"]}, r"seed = 'b': must be a whole number"),
        ({"seed": -1}, r"seed = -1: must be a whole number of at least 0"),
    ]
    for arguments, words in bad:
        with pytest.raises(ScenarioError, match=words):
            vector.reset(**arguments)
    for given in (7, np.int64(7), np.array(7), [7, 7], (7, 7), np.array([7, 7])):
        assert vector.reset(options={"flight_seed": given})[1]["flight_seed"].tolist() == [7, 7]
    _, infos = vector.reset(options={"flight_seed": [None, 7]}, seed=np.array([3, 4]))
    again, _ = vector.reset(seed=3)
    assert infos["flight_seed"][1] == 7
    assert np.array_equal(again[0], vector.reset(options={"flight_seed": int(infos["flight_seed"][0])})[0][0])
    vector.close()


@pytest.mark.parametrize("options", [[1], "flight_seed", 3])
def test_options_of_the_single_environment(options):
    env = gymnasium.make(ID, missions=POOL).unwrapped
    with pytest.raises(ScenarioError, match=r"reset options = .*must be a mapping"):
        env.reset(options=options)
    env.close()


def test_actions_that_are_no_numbers_or_none_of_this_size_are_refused_and_the_environment_goes_on():
    env = gymnasium.make(ID, missions=POOL, disable_env_checker=True, observation="flat").unwrapped
    env.reset(seed=0)
    size = env.action_space.shape[0]
    strange = [["0.5"] * size, [0.5 + 1j] * size, [10**400] * size, [2**70] * size, [None] * size]
    for action in [*strange, np.zeros(size, "m8[s]"), [b"0"] * size]:
        with pytest.raises(gymnasium.error.InvalidAction, match="does not lie in the action space"):
            env.step(action)
    assert np.isfinite(env.step(env.action_space.sample())[0]).all()
    env.close()


def test_an_unknown_render_mode_and_unknown_reset_options_are_clear_errors():
    roles = gymnasium.make(ID, missions=POOL).unwrapped
    with pytest.raises(ScenarioError, match="render_mode = 'ansi'"):
        type(roles)(render_mode="ansi")
    with pytest.raises(ScenarioError, match="flight_sede"):
        roles.reset(options={"flight_sede": 3})
    with pytest.raises(ScenarioError, match="flight_seed = -3"):
        roles.reset(options={"flight_seed": -3})


@pytest.mark.parametrize(
    ("given", "other"),
    [
        ({"patches": 9, "candidates": 3, "max_spacecraft": 2}, {"candidates": 4}),
        ({"horizon_terminates": True, "complete": 99, "reward_weights": {"seen": 2}}, {"horizon_terminates": False}),
        ({"dispersions": {"mass_percent": 3}}, {"dispersions": {"mass_percent": 4}}),
        ({"scenario": "eros-observe", "patches": 4, "decision_s": 10}, {"patches": 9}),
    ],
)
def test_numbers_of_numpy_and_of_python_make_one_task_and_other_numbers_another(given, other):
    def in_numpy(value):
        return {key: in_numpy(one) for key, one in value.items()} if isinstance(value, dict) else np.array(value)[()]

    numbers = {name: value if isinstance(value, str) else in_numpy(value) for name, value in given.items()}
    config = EnvConfig(**given)
    assert EnvConfig(**numbers).fingerprint == config.fingerprint != EnvConfig(**given | other).fingerprint


def test_sensors_by_name_and_written_out_make_one_task():
    named, written = (
        EnvConfig(sensors=one)
        for one in ("cubesat", Scenario(name="a", spacecraft={"sensors": "cubesat"}).spacecraft.sensors.model_dump())
    )
    assert named.fingerprint == written.fingerprint != EnvConfig().fingerprint
