"""SwarmObserve-v0: episodes that differ, each a function of its seed alone, and where feedback pays."""

import pickle
from contextlib import nullcontext
from copy import deepcopy

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test
from scipy import stats
from swarm_mj.envs import batch_env
from swarm_mj.envs.observe.catalogue import CATALOGUE, mission_names
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.draws import NAMES, Randomisation
from swarm_mj.envs.observe.episodes import Episodes
from swarm_mj.envs.observe.parallel import swarm_observe_v0
from swarm_mj.envs.observe.tables import GENERAL, PAIRS, SPACECRAFT
from swarm_mj.envs.policies.baselines import fly, greedy, greedy_ahead, open_loop, sweep

from scripts.pages.open_loop import climbed
from swarm_mj.errors import ScenarioError
from swarm_mj.mission.trajectories import propagate

ID = "swarm_mj.envs:SwarmObserve-v0"
#: Two that are cheap to work out.
POOL = ["bennu-train-1", "ellipsoid-train-1"]


@pytest.fixture(scope="module")
def single():
    env = gymnasium.make(ID, missions=POOL, observation="flat").unwrapped
    yield env
    env.close()


@pytest.fixture(scope="module")
def episodes():
    flown = Episodes(EnvConfig(missions=POOL), 25)
    yield flown
    flown.close()


@pytest.mark.parametrize("observation", ["flat", "entities"])
def test_it_is_an_environment_of_gymnasium_and_pettingzoo(observation):
    env = gymnasium.make(ID, missions=POOL[:1], observation=observation)
    check_env(env.unwrapped, skip_render_check=True)
    env.close()
    agents = swarm_observe_v0.parallel_env(missions=POOL[:1], observation=observation, randomise={"spacecraft": 3})
    parallel_api_test(agents, num_cycles=40)
    agents.close()


def test_an_episode_is_a_function_of_its_seed_whatever_flies_beside_it(single):
    vector = gymnasium.make_vec(ID, num_envs=5, missions=POOL, threads=2, observation="flat")
    agents = swarm_observe_v0.parallel_env(missions=POOL)
    rows, _ = vector.reset(seed=3)
    alone, told = single.reset(seed=5)
    agents.reset(options={"flight_seed": told["flight_seed"]})
    rng = np.random.default_rng(0)
    for _ in range(12):
        actions = rng.integers(0, 20, (5, 3))
        rows, rewards, *_ = vector.step(actions)
        alone, reward, *_ = single.step(actions[2])
        _, rewards_by_agent, *_ = agents.step({a: actions[2][int(a[2:]) - 1] for a in agents.agents})
        assert np.array_equal(rows[2], alone)
        assert rewards[2] == reward
        assert set(rewards_by_agent.values()) == {reward}
        assert np.array_equal(agents.state(), alone)
    vector.close()
    agents.close()


def test_feedback_beats_a_list_of_choices_by_three_tenths(episodes):
    seeds = range(5000, 5050)
    feedback = fly(episodes, greedy, seeds).score.mean()
    assert feedback - fly(episodes, open_loop(), seeds).score.mean() > 0.3
    assert feedback - fly(episodes, sweep, seeds).score.mean() > 0.3


def test_a_list_that_hill_climbing_finds_is_better_where_it_was_sought(episodes):
    start = np.zeros((30, 3), np.int64)
    found, score = climbed(episodes, start, range(8), 3)
    assert score > fly(episodes, open_loop(start), range(8)).score.mean()
    assert fly(episodes, open_loop(found), range(8)).score.mean() == score


def test_places_of_test_are_never_part_of_those_of_training():
    for one in map(CATALOGUE.get, mission_names("train")):
        for other in map(CATALOGUE.get, mission_names("test")):
            a, b = (np.radians([s.latitude_deg, s.longitude_deg]) for s in (one, other))
            cosine = np.sin(a[0]) * np.sin(b[0]) + np.cos(a[0]) * np.cos(b[0]) * np.cos(a[1] - b[1])
            assert np.degrees(np.arccos(cosine)) > 2.0 * 34.0


@pytest.mark.parametrize(
    ("where", "given", "told"),
    [
        ("randomise", {"sped": 1.0}, "sped"),
        ("randomise", {"speed": {"distribution": "uniform", "low": 2.0, "high": 1.0}}, "speed"),
        ("randomise", {"speed": 9.0}, "speed = 9.0: must be a number from 0.5 to 2"),
        ("missions", "eros-test-1", "is one of split = 'test'"),
        ("missions", 99, "missions = 99: must be from 1 to 40"),
        ("decision_s", 21, "decision_s = 21"),
        ("patches", 5, "patches = 5"),
        ("patches", 225, "patches = 225: one would hold no cell of the target of mission bennu"),
        ("dispersions", {"target_m": 3.0}, "'target_m' is not drawn here"),
        ("sensors", "perfect", "spacecraft.sensors = 'perfect': must be ideal or cubesat"),
    ],
)
def test_what_is_not_allowed_is_refused_by_name(where, given, told):
    with pytest.raises(ScenarioError, match=told.replace("(", r"\(")):
        gymnasium.make(ID, **({"missions": POOL} | {where: given}))


def test_a_given_value_changes_nothing_else_that_is_drawn(single):
    single.reset(seed=1, options={"flight_seed": 7})
    drawn = single.batch.draws[0]
    single.reset(seed=1, options={"flight_seed": 7, "draw": {"speed": 1.25}})
    given = single.batch.draws[0]
    assert given.speed == 1.25
    for name in set(drawn._fields) - {"speed"}:
        assert np.array_equal(getattr(drawn, name), getattr(given, name)), name
    with pytest.raises(ScenarioError, match=f"there are {', '.join(NAMES)}"):
        single.reset(options={"draw": {"weather": 1.0}})


def test_each_name_draws_from_its_own_column_of_uniform_numbers():
    """By scipy's quantiles, one name after the other, and cut to what is allowed."""
    given = {"altitude": {"distribution": "normal", "mean": 1.0, "std": 0.2}, "rate_rad_s": 0.01, "mission": 1}
    drawn = Randomisation(given, tuple("ab"), 3).draw(11)
    sizes = [max(1, 3 * size) for size, *_ in NAMES.values()]
    columns = dict(
        zip(NAMES, np.split(np.random.default_rng(11).random(sum(sizes)), np.cumsum(sizes)[:-1]), strict=True)
    )
    assert (drawn.mission, drawn.spacecraft) == (1, int(columns["spacecraft"][0] * 3) + 1)
    assert drawn.speed == pytest.approx(stats.loguniform(0.55, 1.8).ppf(columns["speed"][0]), rel=1e-12)
    altitude = np.clip(stats.norm(1.0, 0.2).ppf(columns["altitude"]), *NAMES["altitude"][1:3])
    np.testing.assert_allclose(drawn.altitude, altitude, rtol=1e-12)
    np.testing.assert_allclose(drawn.sigma_BN.ravel(), 2.0 * columns["attitude_mrp"] - 1.0, rtol=1e-12)
    np.testing.assert_allclose(drawn.release_error.ravel(), 0.06 * stats.norm.ppf(columns["release_error"]), rtol=1e-9)
    assert (drawn.omega_BN_B == 0.01).all()
    for k, (name, chance) in enumerate({"loss": 0.12, "camera_off": 0.15, "downlink_off": 0.15}.items()):
        _, low, high, _ = NAMES[f"{name}_time"]
        law = {"loss": (0.2, 0.6), "camera_off": (0.2, 0.4), "downlink_off": (0.0, 0.8)}[name]
        when = np.clip(law[0] + law[1] * columns[f"{name}_time"], low, high)
        np.testing.assert_allclose(drawn.fails[:, k], np.where(columns[name] >= 1.0 - chance, when, np.inf), rtol=1e-12)


def test_cells_in_the_light_are_those_that_a_camera_where_the_sun_is_would_see(episodes):
    """The quick way, which looks only at cells whose horizons are as high as the Sun stands, against the observer's."""
    rng = np.random.default_rng(3)
    episodes.reset({0: 1}, {"sun_elevation_deg": 10.0})
    lit = episodes.mission_of(0).lit(episodes.sheet.sun_A[0])
    assert np.array_equal(episodes.totals.target[0, : len(lit)], lit) and 0 < lit.sum() < len(lit)
    for k in range(2):
        mission = episodes.pool[k]
        observer, radius = mission.observer, mission.plan.region.mesh.max_radius
        for sun in rng.standard_normal((12, 3)) + 0.7 * mission.axes_A[2]:
            sun /= np.linalg.norm(sun)
            right = np.cross(sun, rng.standard_normal(3))
            right /= np.linalg.norm(right)
            C_CA = np.array([right, np.cross(-sun, right), -sun])
            high = mission.plan.region.normal_A @ sun >= np.cos(np.radians(85.0))
            seen = observer.visible_fraction(1e4 * radius * sun, C_CA) >= 0.5
            assert np.array_equal(mission.lit(sun), high & seen)


def test_what_fails_shows_in_the_observation_and_in_the_mask(single):
    off = {"spacecraft": 3, "loss": [1, 0, 0], "loss_time": 0.1, "camera_off": [0, 1, 0], "camera_off_time": 0.1}
    off |= {"downlink_off": [0, 0, 1], "downlink_off_time": 0.1}
    single.reset(seed=1, options={"draw": off})
    single.batch.totals.stored[0] = 1.0  # something to send
    for _ in range(3):  # what fails after 60 s shows after 60 s
        observation, *_, info = single.step(np.array([17, 18, 19]))  # all hold
    table = single.batch.layout.split(observation)["spacecraft"][0]
    assert table[:, :3].tolist() == [[0, 0, 0], [1, 0, 1], [1, 1, 0]]
    assert info["alive"] == [False, True, True]
    mask = info["action_mask"]
    assert mask[0].tolist() == [0] * 17 + [1, 0, 0]
    assert not mask[1, :16].any()
    assert mask[1, 16]
    assert not mask[2, 16]


def test_states_go_from_one_environment_to_another_and_copies_go_on(single):
    vector = gymnasium.make_vec(ID, num_envs=2, missions=POOL, threads=1, observation="flat")
    agents = swarm_observe_v0.parallel_env(missions=POOL)
    vector.reset(seed=3)
    single.reset(seed=8, options={"draw": {"spacecraft": 3, "loss": 0}})
    agents.reset(options={"flight_seed": 11, "draw": {"spacecraft": 2, "loss": 0}})
    actions = np.random.default_rng(1).integers(0, 20, (16, 3))
    for action in actions[:8]:
        single.step(action)
        agents.step({a: action[int(a[2:]) - 1] for a in agents.agents})
    state, twin, other = single.get_state(), pickle.loads(pickle.dumps(single)), deepcopy(agents)
    vector.set_state(1, state)
    for action in actions[8:]:
        observation, reward, *_ = single.step(action)
        assert np.array_equal(twin.step(action)[0], observation)
        rows, rewards, *_ = vector.step(np.stack([action, action]))
        assert np.array_equal(rows[1], observation)
        assert rewards[1] == reward
        choice = {a: action[int(a[2:]) - 1] for a in agents.agents}
        assert agents.step(choice)[1] == other.step(choice)[1]
    again, _ = single.set_state(state)
    assert np.array_equal(vector.set_state(0, state), again)
    for env in (twin, other, vector, agents):
        env.close()


def test_cells_in_the_dark_are_those_from_which_a_ray_to_the_sun_is_blocked(episodes):
    mission, agree, shadowed = episodes.pool[0], [], 0
    east, north, up = mission.axes_A
    region, tracer = mission.plan.region, mission.observer.tracer
    start = region.centroid_A + 1e-4 * region.mesh.max_radius * region.normal_A
    for azimuth in np.radians(np.arange(0.0, 360.0, 30.0)):
        low = np.radians(8.0)
        sun = np.sin(low) * up + np.cos(low) * (np.sin(azimuth) * east + np.cos(azimuth) * north)
        faces, lit = region.normal_A @ sun >= np.cos(np.radians(85.0)), mission.lit(sun)
        hit = tracer.first_hit(start, np.tile(sun, (len(start), 1))) >= 0
        assert not lit[~faces].any()
        agree.append(np.mean(lit == (faces & ~hit)))
        shadowed += np.sum(faces & hit & ~lit)
    # Cells that shadow cuts in two may go either way.
    assert np.mean(agree) > 0.95
    assert shadowed > 0


def test_paths_lead_over_their_visiting_points_at_any_speed_however_the_body_turns(episodes):
    mission = episodes.pool[0]
    plan, environment = mission.plan, mission.plan.environment
    for speed in (0.6, 1.0, 1.7):
        v_N = mission.velocity_N(np.array([0.3]), np.array([0.9]), speed)
        arrival = 200.0 / speed
        path, _ = propagate(environment.acceleration_N, plan.deployment.r0_N[None], v_N, np.array([0.0, arrival]))
        there_A = environment.C_AN(arrival) @ path[-1, 0]
        points = plan.region.visiting_points_A(0.9 * mission.altitude_m)
        off = np.linalg.norm(points - there_A, axis=1).min() / mission.altitude_m
        assert off < (1e-3 if speed == 1.0 else 0.03)


def test_what_is_possible_bounds_what_is_seen(episodes):
    flown = fly(episodes, greedy, range(25))
    assert flown.seen.max() <= 1.0 + 1e-9
    assert 0.4 < flown.seen.mean() < 0.9


def test_masses_differ_from_flight_to_flight_and_are_those_of_the_seed():
    wrong = {"dispersions": {"mass_percent": 5.0, "wheel_coulomb_n_m": 2e-5}, "sensors": "cubesat"}
    dispersed, plain = (Episodes(EnvConfig(missions=POOL[:1], **given), 3) for given in (wrong, {}))
    rates = []
    for flown in (dispersed, plain):
        flown.reset({0: 5, 1: 5, 2: 6}, {"spacecraft": 3, "loss": 0, "attitude_mrp": 0.3, "rate_rad_s": 0.01})
        for _ in range(2):
            flown.step(np.zeros((3, 3), np.int64), np.ones(3, np.bool_))
        rates.append(flown.tables.spacecraft[:, :, 20].copy())
        flown.close()
    assert np.array_equal(rates[0][0], rates[0][1])
    assert not np.array_equal(rates[0][0], rates[0][2])
    assert not np.array_equal(rates[0][0], rates[1][0])


@pytest.mark.parametrize(("decisions", "talks"), [(30, True), (60, False)])
def test_who_looks_ahead_sends_where_the_time_left_is_short_for_what_is_stored(decisions, talks):
    shapes = {"spacecraft": (2, len(SPACECRAFT)), "pairs": (2, 4, len(PAIRS)), "general": (len(GENERAL),)}
    observed = {name: np.zeros((1, *shape), np.float32) for name, shape in shapes.items()}
    observed["pairs"][..., PAIRS.index("worth")] = [[0.3, 0.2, 0.1, 0.0], [0.1, 0.2, 0.1, 0.0]]
    for name in ("alive", "camera", "downlink", "earth_in_sight"):
        observed["spacecraft"][..., SPACECRAFT.index(name)] = 1.0
    observed["spacecraft"][..., SPACECRAFT.index("stored")] = 0.65
    observed["general"][0, GENERAL.index("time_left")] = 0.5
    # In the half of 30 decisions that is left Earth hears 1.5 of the nominal volume, in that of 60 decisions 3.
    observed["general"][0, GENERAL.index("heard")] = 0.1
    choices = greedy_ahead(observed, decisions)
    assert choices.tolist() == [[0, 4 if talks else 1]]


def test_first_calls_say_what_takes_long_and_later_ones_say_nothing(monkeypatch):
    said = []
    monkeypatch.setattr(batch_env, "said_when_late", lambda words: said.append(words) or nullcontext())
    env = gymnasium.make(ID, missions=["ellipsoid-train-1"]).unwrapped
    for _ in range(2):
        env.reset(seed=0)
        env.step(env.action_space.sample())
    assert [words.split(":")[1] for words in said] == [" first reset", " first step"] and "compiling" in said[0]
