"""Pages about learning, from curves that are made up."""

import numpy as np
import pytest
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.episodes import Episodes
from swarm_mj.envs.policies.baselines import Flown, greedy
from swarm_mj.envs.policies.leaderboard import Score

from scripts.pages import hindsight, leaderboard, learning
from swarm_mj.coordination.allocation.problem import Allocation


@pytest.fixture
def curves(tmp_path, monkeypatch):
    """Five runs of one method, of which the third is far off and one goes on for longer."""
    monkeypatch.setattr(learning, "CURVES", tmp_path)
    monkeypatch.setattr(learning, "PICTURE", tmp_path / "curves.png")
    for seed, offset in enumerate((0.0, 0.1, 9.0, -0.1, 0.0)):
        rows = [f"{step},{step / 10},{step / 100 + offset},0,0,nan" for step in (0, 50, 100, 150)]
        rows = rows if seed == 1 else rows[:3]
        text = "\n".join(["steps,seconds,score,seen,delivered,sampled_score", *rows]) + "\n"
        (tmp_path / f"ppo-{seed + 1}.csv").write_text(text)
    return learning.read("ppo")


def test_a_curve_is_the_interquartile_mean_at_the_points_that_all_runs_have(curves):
    assert curves.steps.tolist() == [0.0, 50.0, 100.0]
    means = [one.mean for one in curves.aggregates]
    # Of five the middle three, whatever the run that is far off.
    assert means == pytest.approx([x + 0.1 / 3.0 for x in (0.0, 0.5, 1.0)])
    assert (curves.passes(0.4), curves.passes(0.9), curves.passes(2.0)) == (50.0, 100.0, np.inf)


def test_a_rule_counts_as_passed_from_where_it_stays_passed():
    scores = np.array([[0.0, 1.0, 0.2, 1.0, 1.1]] * 5)
    assert learning.Learned(np.arange(5.0), scores, 1.0).passes(0.5) == 3.0


def test_page_picture_and_numbers_tell_the_same(curves, tmp_path):
    lines = {"random": 0.1, "sweep": 0.3, "greedy": 0.4, "greedy_ahead": 0.9, "planner": 1.2, "bound": 3.0}
    text = learning.page({"ppo": curves}, lines, "+0.125 +- 0.250")
    assert "all runs lie above *greedy* (0.400) with: PPO in one file, with masks." in text
    assert learning.numbers({"ppo": curves}, lines)["curves"]["ppo"]["interquartile_mean"][2][0] == 1.0333
    learning.draw({"ppo": curves}, lines)
    assert (tmp_path / "curves.png").stat().st_size > 1000


def test_the_leaderboard_compares_the_same_episodes():
    bound = Flown(*np.full((3, 4), 2.0))
    made = {"greedy": [1.0, 0.0, 1.0, 2.0], "random": [0.5, -0.5, 0.5, 1.5]}
    scores = [Score(name, "full", (1, 2, 3, 4), Flown(*np.array([x, x, x])), bound) for name, x in made.items()]
    plans = [Allocation(pictures=(), value=1.0, bound=bound) for bound in (1.0, 1.5)]
    sound = {name: Flown(*np.full((3, 4), score)) for name, score in (("greedy", 0.7), ("planner", 0.8))}
    text = leaderboard.page(scores, np.array([1.0, 0.5, 1.5, 2.0]), plans, sound)
    assert "no plan of that kind is worth more than 1.250" in text and "*greedy* comes to\n  0.700" in text
    assert "| random | full | 0.250 +- " in text and "| 0.400 +- " in text and "-0.500 +- 0.000" in text
    assert "| *best known* | hindsight | 0.625 +- " in text and "| *bound* | hindsight | 1 | - | 2.000 |" in text


def test_the_best_known_choices_of_an_episode_are_those_of_the_search_or_of_a_policy(tmp_path, monkeypatch):
    monkeypatch.setattr(leaderboard, "HINDSIGHT", tmp_path / "found.json")
    (tmp_path / "found.json").write_text('{"rounds": 3, "scores": {"7": 1.0, "8": 0.25}}')
    bound = Flown(*np.full((3, 2), 2.0))
    score = Score("greedy", "full", (7, 8), Flown(*np.array([[0.5, 0.75]] * 3)), bound)
    assert leaderboard.best_known([score]).tolist() == [1.0, 0.75]


def test_the_search_never_ends_below_what_it_began_with_and_changes_one_spacecraft_of_each_episode():
    episodes = Episodes(EnvConfig(missions=["ellipsoid-train-1"]), 3)
    start, _ = hindsight.recorded(episodes, (4, 5, 6), greedy)
    best = hindsight.climbed(episodes, (4, 5, 6), (greedy,), 6)
    assert (best >= start).all() and (best > start).any()
    choices = np.random.default_rng(0).integers(0, 16, (30, 3, 3))
    other = hindsight.changed(choices, episodes, np.random.default_rng(1))
    assert ((choices != other).any(axis=0).sum(axis=1) <= 1).all() and (choices != other).any()
    episodes.close()
