"""Arguments of SwarmObserve-v0 and what may be drawn for an episode: what is refused by name, before anything flies."""

import re

import gymnasium
import numpy as np
import pytest
from swarm_mj.envs.arguments import flight_seed
from swarm_mj.envs.observe.catalogue import chosen_missions
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.draws import Randomisation

from swarm_mj.errors import ScenarioError

POOL = ("bennu-train-1", "eros-train-1")
CHANCE = "or a chance such as {'distribution': 'bernoulli', 'probability': 0.3}"


def law(kind, **parameters):
    return {"distribution": kind} | parameters


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"loss": 0.3}, f"loss = 0.3: must be a whole number from 0 to 1, or an array of them of shape (3,), {CHANCE}"),
        ({"camera_off": law("uniform", low=0.0, high=1.0)}, CHANCE),
        ({"spacecraft": 0}, "spacecraft = 0: must be a whole number from 1 to 3, or"),
        ({"spacecraft": 4}, "spacecraft = 4: must be a whole number from 1 to 3, or"),
        ({"spacecraft": law("integer", low=1, high=4)}, "must be a whole number from 1 to 3"),
        ({"spacecraft": law("uniform", low=1.0, high=3.0)}, "a distribution of such, integer or choice"),
        ({"mission": 2}, "mission = 2: must be a whole number from 0 to 1, or the name of a mission"),
        ({"mission": "eros-train-9"}, "'eros-train-9' is not in this environment's pool: bennu-train-1, eros-train-1"),
        ({"mission": law("choice", values=["eros-train-9"])}, "is not in this environment's pool"),
        ({"speed": law("uniform", low=0.1, high=5.0)}, "must be a number from 0.5 to 2, or a distribution of such"),
        ({"speed": law("normal", mean=9.0, std=0.1)}, "must be a number from 0.5 to 2"),
        ({"speed": law("choice", values=["fast"])}, "must be a number from 0.5 to 2"),
        ({"speed": {"low": 1.0, "high": 1.5}}, "distribution: missing; allowed: uniform"),
        ({"speed": float("nan")}, "speed = nan: must be a number from 0.5 to 2"),
    ],
)
def test_distributions_of_what_cannot_be_are_refused_before_anything_flies(given, told):
    with pytest.raises(ScenarioError, match=re.escape(told)) as caught:
        Randomisation(given, POOL, 3)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"loss": 0.3}, "reset option draw: loss = 0.3: must be a whole number from 0 to 1"),
        ({"spacecraft": 0}, "spacecraft = 0: must be a whole number from 1 to 3"),
        ({"mission": None}, "mission = None: must be a whole number from 0 to 1, or the name of a mission"),
        ({"altitude": [1.0, 1.0]}, "must be a number from 0.75 to 1.25, or an array of them of shape (3,)"),
        ({"sun_elevation_deg": "high"}, "sun_elevation_deg = 'high': must be a number from 0 to 90"),
    ],
)
def test_values_that_an_episode_cannot_have_are_refused(given, told):
    with pytest.raises(ScenarioError, match=re.escape(told)):
        Randomisation(None, POOL, 3).draw(0, given)


def test_a_chance_is_met_as_often_as_it_says_and_missions_are_chosen_by_name():
    given = {"loss": law("bernoulli", probability=0.3), "mission": law("choice", values=["eros-train-1"])}
    random = Randomisation(given | {"spacecraft": law("integer", low=2, high=3)}, POOL, 3)
    drawn = [random.draw(seed) for seed in range(400)]
    lost = np.mean([np.isfinite(one.fails[:, 0]) for one in drawn])
    assert abs(lost - 0.3) < 4.0 * (0.3 * 0.7 / 1200) ** 0.5
    assert {one.mission for one in drawn} == {1}
    assert {one.spacecraft for one in drawn} == {2, 3}


def test_tails_of_a_distribution_without_ends_are_cut():
    random = Randomisation({"altitude": law("normal", mean=1.0, std=0.5)}, POOL, 3)
    altitudes = np.array([random.draw(seed).altitude for seed in range(50)])
    assert altitudes.min() == 0.75 and altitudes.max() == 1.25


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"patches": "16"}, "patches = '16': must be a whole square number such as 4, 9, 16 or 25"),
        ({"patches": 16.0, "candidates": 4}, "patches = 16.0: must be a whole square number"),
        ({"patches": 10}, "patches = 10: must be a whole square number"),
        ({"missions": [["a"]]}, "['a'] is unknown"),
        ({"missions": 3.0}, "missions = 3.0: must be a whole number, 'all', or names such as 'eros-train-1'"),
        ({"missions": "eros-trian-1"}, "eros-train-1 to 10, bennu-train-1 to 10,"),
        ({"missions": "eros-trian-1"}, "did you mean 'eros-train-1'?"),
        ({"dispersions": {"mass_percent": "much"}}, "dispersions.mass_percent = 'much': must be a number"),
        ({"dispersions": {"mass_percent": 50}}, "dispersions.mass_percent = 50: must be less than or equal to 10"),
    ],
)
def test_arguments_are_refused_in_one_line_as_the_environment_is_made(given, told):
    with pytest.raises(ScenarioError, match=re.escape(told)) as caught:
        EnvConfig(**given)
    assert "\n" not in str(caught.value)


def test_numbers_of_missions_may_be_those_of_numpy():
    assert chosen_missions(np.int64(3), "train") == chosen_missions(3, "train")


def test_an_unknown_option_of_reset_is_told_all_that_there_are():
    with pytest.raises(ScenarioError, match=r"reset options \['draws'\]: unknown; allowed: flight_seed, draw$"):
        flight_seed({"draws": {}}, 1, ["draw"])


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ({"distribution": "gauss"}, r"speed.distribution = 'gauss': unknown; allowed: uniform, log_uniform, normal"),
        ({"low": 1.0}, r"speed.distribution: missing; allowed: uniform"),
        ({"distribution": "uniform", "low": 1.0}, r"speed.high: missing, a value is required"),
        ({"distribution": "uniform", "low": 2.0, "high": 1.0}, r"speed.high = 1: must be above low = 2"),
        ({"distribution": "uniform", "low": 1, "high": 2, "std": 3}, r"speed.std: unknown key. Allowed: .*low, high"),
    ],
)
def test_a_distribution_that_is_none_is_told_what_is_allowed(law, words):
    with pytest.raises(ScenarioError, match=f"^randomise: {words}"):
        EnvConfig(missions=["ellipsoid-train-1"], randomise={"speed": law})


def test_the_masks_are_offered_as_maskable_ppo_asks_for_them():
    env = gymnasium.make("swarm_mj.envs:SwarmObserve-v0", missions=["ellipsoid-train-1"]).unwrapped
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset before action_masks"):
        env.action_masks()
    info = env.reset(seed=1)[1]
    assert np.array_equal(env.action_masks(), info["action_mask"]) and env.action_masks().any()
    info = env.step(np.full(3, 16))[-1]
    assert np.array_equal(env.action_masks(), info["action_mask"])
    env.close()


def test_a_step_of_a_closed_environment_says_that_it_is_closed():
    env = gymnasium.make("swarm_mj.envs:SwarmObserve-v0", missions=["ellipsoid-train-1"]).unwrapped
    env.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="SwarmObserve-v0 was closed; make it anew"):
        env.step(np.zeros(3, np.int64))
