"""SwarmObserve-v0 with candidates: the best patches of each spacecraft, worked out anew one by one; all modes of use alike."""

import re

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.episodes import Episodes
from swarm_mj.envs.observe.layout import CANDIDATE, make_interface
from swarm_mj.envs.observe.single import SwarmObserveEnv
from swarm_mj.envs.observe.tables import PAIRS, PATCHES, SPACECRAFT
from swarm_mj.envs.observe.vector import SwarmObserveVectorEnv
from swarm_mj.envs.policies.policy_files import interface_of, open_policy, provenance
from swarm_mj.envs.policies.policy_network import save_network

from swarm_mj.errors import ScenarioError

from .test_policy_network import random_policy

ONE = {"missions": ["ellipsoid-train-1"], "max_spacecraft": 3, "candidates": 4}
PAIR = {name: k for k, name in enumerate(PAIRS)}
COLUMN = {name: k for k, name in enumerate(SPACECRAFT)}
K = 16


@pytest.fixture(scope="module")
def flown():
    """Tables of two episodes at six instants, flown with the best candidate of each."""
    episodes, found = Episodes(EnvConfig(**ONE), 2), []
    episodes.reset({0: 3, 1: 11})
    for _ in range(18):
        found.append(episodes.entities())
        episodes.step(np.zeros((2, 3), np.int64), np.ones(2, np.bool_))
    episodes.close()
    assert max((tables["pairs"][..., PAIR["worth"]] > 0.0).sum() for tables in found) > 6
    return found[::3]


def ranked(pairs, j):
    """Patches of spacecraft j from the best to the worst, by the words of the documentation."""

    def key(k):
        row = {name: float(pairs[j, k, column]) for name, column in PAIR.items()}
        if row["worth"] > 0.0:
            return (0, -row["worth"])
        return (1, -row["worth_next"]) if row["worth_next"] > 0.0 else (2, row["gsd"])

    return sorted(range(K), key=key)


def test_candidates_are_the_best_patches_in_their_order(flown):
    interface = make_interface(3, K, 4)
    for observed in flown:
        shown = interface.shown(observed)
        for e, j in np.ndindex(2, 3):
            wanted = ranked(observed["pairs"][e], j)[:4]
            for r, k in enumerate(wanted):
                row = [observed["pairs"][e, j, k, PAIR[name]] for name in CANDIDATE[:-1]]
                row.append(observed["patches"][e, k, PATCHES.index("unseen")])
                assert shown["candidates"][e, j, r].tolist() == row
                assert shown["action_mask"][e, j, r] == observed["action_mask"][e, j, k]
                assert interface.decoded(observed, np.full((2, 3), r))[e, j] == k
            assert shown["action_mask"][e, j, 4] == 1


def test_what_spacecraft_of_lower_number_like_best_is_told(flown):
    some = 0
    for observed in flown:
        worth, claimed = observed["pairs"][..., PAIR["worth"]], observed["pairs"][..., PAIR["claimed"]]
        for e, j, k in np.ndindex(2, 3, K):
            shares = [worth[e, i, k] / worth[e, i].max() for i in range(j) if worth[e, i].max() > 0.0]
            assert claimed[e, j, k] == pytest.approx(max(shares, default=0.0), abs=1e-6)
            some += claimed[e, j, k] > 0.0
    assert some > 10


def test_the_peak_is_the_largest_worth_of_the_instants_ahead():
    """On a straight way in the turning frame, of what is not seen meanwhile, as a spacecraft that holds finds it."""
    episodes = Episodes(EnvConfig(**ONE), 1)
    episodes.reset({0: 3}, {"camera_off": 0, "loss": 0, "spacecraft": 3})
    found = []
    for _ in range(20):
        found.append(episodes.entities()["pairs"][0])
        episodes.fly(np.array([[K + 1, K + 2, K + 3]]), np.ones(1, np.bool_))
    episodes.close()
    worth = np.array([pairs[..., PAIR["worth"]] for pairs in found])
    for now in (0, 4, 8):
        peak, peak_in = found[now][..., PAIR["peak"]], found[now][..., PAIR["peak_in"]]
        ahead = worth[now : now + 10]
        # The body's pull and its turn bend the way: what is at the limit of the ground sampling distance may change sides.
        assert np.median(np.abs(peak - ahead.max(axis=0))) < 0.02
        close = np.abs(peak - ahead.max(axis=0)) < 0.02
        assert close.mean() > 0.8
        later = np.rint(10.0 * peak_in).astype(np.int64)
        at_peak = np.take_along_axis(ahead, later[None], axis=0)[0]
        assert np.abs(at_peak - ahead.max(axis=0))[close].max() < 0.05
    assert peak.max() > 0.3


@pytest.mark.parametrize(
    ("alive", "hears", "wanted"),
    [
        ([1, 1, 1], [1, 1, 1], [K, K, K]),
        ([1, 1, 1], [0, 1, 1], [K + 2, K, K]),
        ([0, 1, 1], [1, 0, 1], [K + 3, K + 3, K]),
        ([1, 1, 1], [0, 0, 0], [K, K, K]),
    ],
)
def test_who_does_not_hear_earth_sends_by_the_first_who_does(alive, hears, wanted, flown):
    observed = {name: rows[:1].copy() for name, rows in flown[0].items()}
    observed["spacecraft"][0, :, COLUMN["alive"]] = alive
    observed["spacecraft"][0, :, COLUMN["downlink"]] = hears
    assert make_interface(3, K, 4).decoded(observed, np.full((1, 3), 4))[0].tolist() == wanted


@pytest.mark.parametrize("observation", ["flat", "entities"])
def test_single_vector_and_agents_see_and_fly_the_same(observation):
    single = SwarmObserveEnv(**ONE, observation=observation)
    vector = SwarmObserveVectorEnv(2, **ONE, observation=observation)
    seen, info = single.reset(options={"flight_seed": 7})
    vector.reset(options={"flight_seed": [5, 7]})
    rng = np.random.default_rng(0)
    for _ in range(8):
        action = rng.integers(0, 5, (2, 3))
        seen, reward, *_, info = single.step(action[1])
        rows, rewards, *_, infos = vector.step(action)
        assert reward == rewards[1] and np.array_equal(info["action_mask"], infos["action_mask"][1])
        for name in seen if observation == "entities" else [slice(None)]:
            part, row = (seen[name], rows[name][1]) if observation == "entities" else (seen, rows[1])
            assert np.array_equal(part, row)
    if observation == "flat":
        parts = single.batch.layout.split(seen)
        assert np.array_equal(parts["candidates"][0], single.batch.shown()["candidates"][0])
    single.close()
    vector.close()


def test_agents_see_their_own_candidates():
    parallel = pytest.importorskip("swarm_mj.envs.observe.parallel").SwarmObserveParallelEnv
    env = parallel(**ONE, observation="entities")
    seen, infos = env.reset(options={"flight_seed": 7, "draw": {"spacecraft": 3}})
    shown = env.batch.shown()
    for j, agent in enumerate(env.agents):
        assert env.observation_space(agent).contains(seen[agent]) and env.action_space(agent).n == 5
        assert np.array_equal(seen[agent]["candidates"], shown["candidates"][0, j])
        assert seen[agent]["action_mask"].tolist() == shown["action_mask"][0, j].tolist()
        assert "action_mask" not in infos[agent]
    env.step(dict.fromkeys(env.agents, 4))
    env.close()


def test_gymnasium_finds_nothing_to_complain_of():
    env = SwarmObserveEnv(**ONE)
    check_env(env, skip_render_check=True)
    env.close()


@pytest.mark.parametrize("given", [17, 10**12, 0, -3, True, 2.5, 4.0, "4", [4]])
def test_numbers_of_candidates_that_there_are_not_are_refused(given, tmp_path):
    told = f"candidates = {given!r}: must be a whole number, at least 1 and at most patches = 16, or None for all"
    with pytest.raises(ScenarioError, match=re.escape(told)):
        EnvConfig(candidates=given)
    with pytest.raises(ScenarioError, match=re.escape(told)):
        gymnasium.make("swarm_mj.envs:SwarmObserve-v0", missions=ONE["missions"], candidates=given)
    file = tmp_path / "policy.npz"
    save_network(file, random_policy(environment="SwarmObserve-v0", arguments={"patches": K, "candidates": given}))
    with pytest.raises(ScenarioError, match=re.escape(f"policy {file}: trained for {told}")) as refused:
        open_policy(file, EnvConfig())
    assert "\n" not in str(refused.value) and str(refused.value).endswith("choose among fewer, or among all")


def test_a_policy_trained_with_candidates_says_so_and_flies_among_all_patches(flown):
    about = provenance(EnvConfig(**ONE))
    assert about["arguments"]["candidates"] == 4
    found = interface_of(about, EnvConfig(max_spacecraft=3))
    assert (found.choices, found.layout.size) == (5, make_interface(3, K, 4).layout.size)
    assert interface_of({}, EnvConfig(max_spacecraft=3)).choices == K + 4
