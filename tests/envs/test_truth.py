"""SwarmObserve-v0 tells nothing of the future, and rewards data that were sent and nothing else."""

import gymnasium
import numpy as np
import pytest
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.episodes import HELD_OUT_SEED, Episodes
from swarm_mj.envs.observe.parallel import SwarmObserveParallelEnv
from swarm_mj.envs.observe.rewards import ENDS, no_result, write_ends
from swarm_mj.envs.observe.tables import no_sheet
from swarm_mj.envs.observe.totals import no_totals
from swarm_mj.envs.policies.baselines import greedy, random_choices
from swarm_mj.envs.policies.leaderboard import TEST_SEEDS, VALIDATION_SEEDS, hidden_seeds

from swarm_mj.errors import ScenarioError

POOL = ["bennu-train-1", "ellipsoid-train-1"]
FAILURES = ("loss", "camera_off", "downlink_off")


def futures(seeds, share):
    """Episodes of the same seeds in which nothing fails, and in which everything does at a share of the flight."""
    for fails in (0, 1):
        episodes = Episodes(EnvConfig(missions=POOL), len(seeds))
        episodes.reset(
            dict(enumerate(seeds)), {name: fails for name in FAILURES} | {f"{n}_time": share for n in FAILURES}
        )
        yield episodes


def test_nothing_that_is_shown_or_told_knows_what_will_fail():
    """All columns, masks, infos and rewards until then, bit for bit, and another table as it has happened."""
    seeds, live = range(700, 732), np.ones(32, bool)
    sound, doomed = futures(seeds, 0.5)
    for step in range(16):
        told = [episodes.entities() | episodes.infos() | {"flat": episodes.flat()} for episodes in (sound, doomed)]
        alike = [name for name in told[0] if np.array_equal(told[0][name], told[1][name])]
        others = {"spacecraft", "pairs", "general", "alive", "flat", "action_mask"}
        assert set(told[0]) - set(alike) == (others if step == 15 else set())
        if step < 15:
            choice = greedy(told[0])
            results = [episodes.fly(choice, live) for episodes in (sound, doomed)]
            for mine, theirs in zip(*results, strict=True) if step < 14 else ():
                assert np.array_equal(mine, theirs)
    assert sound.totals.area.sum() > 0.0
    for episodes in (sound, doomed):
        episodes.close()


def held_for(choices, seeds, decision_s, held_s):
    """Data delivered, area seen, and what episodes come to where choices, shape (k, E, n), hold for `held_s` each."""
    episodes, live = Episodes(EnvConfig(missions=POOL, decision_s=decision_s), len(seeds)), np.ones(len(seeds), bool)
    episodes.reset(dict(enumerate(seeds)))
    terms = np.zeros((len(seeds), 2))
    for k in range(episodes.config.decisions):
        result = episodes.fly(choices[int(k * decision_s // held_s)], live)
        terms += result.terms
        live &= (result.end == 0) & ~result.truncated
        totals = episodes.totals
        kept = totals.stored.sum(axis=1) + totals.delivered.sum(axis=1) + totals.lost_bit
        assert np.array_equal(kept, totals.seen_bit)  # every bit is aboard, on Earth or lost
    episodes.close()
    return terms


def test_equal_choices_come_to_the_same_whatever_the_length_of_a_decision():
    """Patches and Earth in turn, among failures; links judged once a second are what the others must agree with."""
    seeds, rng = range(24), np.random.default_rng(0)
    choices = rng.integers(0, 16, (6, 24, 3))
    choices[rng.random(choices.shape) < 0.5] = 16
    choices[:, :, 0] = [[0], [5], [5], [16], [16], [16]]
    exact = held_for(choices, seeds, 1.0, 100.0)
    assert exact[:, 1].mean() > 0.02
    for decision_s in (10.0, 20.0, 50.0, 100.0):
        found = held_for(choices, seeds, decision_s, 100.0)
        assert found[:, 0] == pytest.approx(exact[:, 0], abs=1e-12)
        assert found[:, 1].mean() == pytest.approx(exact[:, 1].mean(), abs=0.002)
        assert np.abs(found - exact).max() < 0.04  # half a picture's interval of the link at most, at either end


def test_what_one_agent_for_all_is_shown_is_what_each_spacecraft_knows():
    """In missions of the catalogue all hear one another, and who falls silent is lost: bit for bit, whatever happens."""
    env, losses = SwarmObserveParallelEnv(missions=POOL), 0
    for seed in range(6):
        env.reset(options={"flight_seed": seed, "draw": {"spacecraft": 3, "loss": [0, seed % 2, 0], "loss_time": 0.37}})
        choose = random_choices(seed) if seed < 2 else greedy
        while env.agents:
            team, each = env.batch.entities(), env._knowledge.observed
            for j in np.flatnonzero(env.batch.sheet.present[0] & ~env.batch.totals.lost[0]):
                for name, rows in team.items():
                    assert np.array_equal(rows[0], each[name][j]), (name, seed, j)
            losses += env.batch.totals.lost[0].any()
            choice = choose(team)[0]
            env.step({agent: choice[env.possible_agents.index(agent)] for agent in env.agents})
    assert losses > 20
    env.close()


def test_an_episode_is_complete_when_all_is_seen_and_sent_by_those_who_are_left():
    totals, sheet, every = no_totals(5, 2, 0), no_sheet(5, 2), np.ones(5, bool)
    totals.area[:], sheet.complete_area[:] = [10.0, 10.0, 9.0, 10.0, 10.0], 10.0
    totals.stored[:] = [[0, 0], [0, 1], [0, 0], [0, 7], [5, 5]]
    totals.lost[3:] = [[False, True], [True, True]]
    result = no_result(5)
    write_ends(totals, sheet, every, np.array([0, 1, 0, 1, 1], bool), every, result)
    assert [ENDS[k] for k in result.end] == ["complete", "", "", "complete", "complete"]
    assert result.truncated.tolist() == [False, True, False, False, False]
    totals.area[4] = 9.0
    write_ends(totals, sheet, ~every, every, np.arange(5) > 3, result)
    assert [ENDS[k] for k in result.end] == ["complete", "", "", "complete", "diverged"]


def test_seeds_that_are_kept_for_tests_are_refused_by_environments():
    env = gymnasium.make("swarm_mj.envs:SwarmObserve-v0", missions=POOL[1:]).unwrapped
    agents = SwarmObserveParallelEnv(missions=POOL[1:])
    assert min(TEST_SEEDS) == HELD_OUT_SEED and max(VALIDATION_SEEDS) < HELD_OUT_SEED
    for seed in (TEST_SEEDS[0], hidden_seeds(5)[3]):
        for one in (env, agents):
            with pytest.raises(
                ScenarioError, match=f"flight_seed = {seed}: from 2147483648 on they are kept for tests"
            ):
                one.reset(options={"flight_seed": seed})
    env.reset(options={"flight_seed": HELD_OUT_SEED - 1})
    for one in (env, agents):
        one.close()


def test_hidden_episodes_follow_from_their_key_and_are_none_of_the_leaderboard():
    assert hidden_seeds(5) == hidden_seeds(5) != hidden_seeds(6)
    assert len(set(hidden_seeds(5))) == len(TEST_SEEDS) and min(hidden_seeds(5)) > max(TEST_SEEDS)
    with pytest.raises(ScenarioError, match="key = -1: must be a whole number of at least 0"):
        hidden_seeds(-1)
