"""The benchmark beside bsk_rl: the data it makes, how it times, and the page; with bsk_rl installed, its examples too."""

import importlib.util
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))  # the benchmarks are no part of the installed package

from benchmarks.bsk_rl import comparison, support_data  # noqa: E402
from benchmarks.bsk_rl.link import Peer  # noqa: E402
from benchmarks.bsk_rl.page import page  # noqa: E402
from benchmarks.bsk_rl.peer import Timed  # noqa: E402

DAYS = np.array([-300.0, 0.0, 1234.5, 8000.0])


class Episode:
    """Stands for an environment: steps of 7 s that take 2 ms, three to an episode; a reset takes 20 ms."""

    def __init__(self):
        self.seeds, self.count, self.action_space = [], 0, self

    def seed(self, seed):
        self.seeded = seed

    def sample(self):
        return 0

    def reset(self, seed):
        time.sleep(0.02)
        self.seeds.append(seed)
        self.count = 0

    def step(self, action):
        time.sleep(0.002)
        self.count += 1
        assert self.count <= 3, "stepped after its end"
        return None, 0.0, False, self.count == 3, {"d_ts": 7.0}


def test_earth_stands_where_astropy_has_it():
    coordinates = pytest.importorskip("astropy.coordinates")
    from astropy.time import Time

    for day in DAYS:
        moment = Time(2451545.0 + day, format="jd", scale="tdb")
        body, sun = (
            coordinates.get_body_barycentric(name, moment, ephemeris="builtin").xyz.to_value("km")
            for name in ("earth", "sun")
        )
        ours, theirs = support_data.earth_km(np.array(day)), body - sun
        assert np.linalg.norm(ours - theirs) < 3e-4 * np.linalg.norm(theirs)


def test_the_polynomials_give_the_orbit_between_their_nodes():
    days, terms = support_data.SEGMENTS[support_data.EARTH_MOON, support_data.SOLAR_SYSTEM]
    coefficients = support_data.chebyshev(days, terms, 5)
    assert coefficients.shape == (5, 3, terms)
    for record, place in ((0, -1.0), (2, 0.123), (4, 1.0)):
        day = support_data.FIRST_DAY + (record + 0.5 + 0.5 * place) * days
        found = np.polynomial.chebyshev.chebval(place, coefficients[record].T)
        assert np.linalg.norm(found - support_data.earth_km(np.array(day))) < 1e-3


def test_the_field_has_every_term_that_is_asked_for_and_earths_oblateness():
    rows = [[float(cell) for cell in line.split(",")] for line in support_data.gravity_field().splitlines()]
    assert len(rows) == 1 + 66 and rows[0][3:6] == [10, 10, 1]
    assert [row[:2] for row in rows[1:]] == [[n, m] for n in range(11) for m in range(n + 1)]
    c20 = next(row[2] for row in rows[1:] if row[:2] == [2, 0])
    assert -c20 * np.sqrt(5.0) == pytest.approx(1.0826e-3, rel=1e-4)  # J2


def test_steps_and_resets_are_timed_apart():
    env = Episode()
    found = Timed(env).run(0.3)
    assert found["simulated_s"] == 7.0 * found["steps"]
    assert found["resets"] == np.ceil(found["steps"] / 3)
    assert found["wall_s"] >= 0.002 * found["steps"]
    assert env.seeds == [0, *range(found["resets"])] and env.seeded == 0


def test_an_episode_goes_on_in_the_next_round():
    env = Episode()
    timed = Timed(env)
    total = sum(timed.run(0.0001)["resets"] for _ in range(6))
    assert total == 2


def test_rates_leave_the_peers_resets_out():
    answer = {"steps": 10, "simulated_s": 600.0, "wall_s": 2.0, "cpu_s": 0.5, "resets": 1, "reset_cpu_s": 1.5}
    assert list(comparison.their_rates(answer).values()) == [5.0, 20.0, 300.0, 1200.0]
    found = comparison.summary([answer, answer | {"resets": 0, "reset_cpu_s": 0.0}])
    assert found == {"step_s": 60.0, "reset_cpu_s": 1.5, "reset_share_cpu": 0.6}
    assert comparison.summary([answer | {"resets": 0, "reset_cpu_s": 0.0}])["reset_cpu_s"] is None


def made_results():
    ours = {"single": [comparison.our_rates(100.0, 400.0)] * 3}
    answers = {
        name: [{"steps": 10, "simulated_s": 600.0, "wall_s": wall, "cpu_s": 0.5, "resets": 1, "reset_cpu_s": 0.25}] * 3
        for name, wall in zip(comparison.EXAMPLES, (1.0, 2.0, 4.0), strict=True)
    }
    theirs = {name: [comparison.their_rates(answer) for answer in found] for name, found in answers.items()}
    return {
        "peer": {"bsk_rl": "1.2.3", "bsk": "4.5.6", "python": "3.11"},
        "rounds": 3,
        "seconds": 1.0,
        "examples": {name: comparison.summary(found) for name, found in answers.items()},
        "rows": [line.as_json() for line in comparison.rows(ours, theirs)],
    }


def test_ratios_are_ours_over_theirs_and_only_environment_steps_have_a_goal():
    found = {(line["group"], line["name"]): line for line in made_results()["rows"]}
    assert found["environment steps", "single / scanning"]["value"] == 10.0
    assert found["environment steps by processor time", "single / scanning"]["value"] == 20.0
    assert found["simulated time", "single / scanning"]["value"] == pytest.approx(1000.0 / 600.0)
    assert [name for (_, name), line in found.items() if line["met"] is True] == ["single / imaging"]
    assert {group for (group, _), line in found.items() if line["target"]} == {"environment steps"}


def test_the_page_shows_goals_that_are_met_and_missed():
    text = page(made_results(), {"processor": "a processor", "cores": 2, "python": "3.11", "mujoco": "4.0"})
    for word in ("1.2.3", "4.5.6", "a processor", "40 (40 to 40)", ">= 30: met", ">= 30: **missed**", "0.25 (33 % of"):
        assert word in text, word


@pytest.mark.parametrize("python", ["no/such/python", sys.executable])
def test_without_bsk_rl_the_command_says_so_and_succeeds(python):
    if python == sys.executable and importlib.util.find_spec("bsk_rl") is not None:
        pytest.skip("bsk_rl is installed")
    command = [sys.executable, "-m", "benchmarks.bsk_rl", "--peer-python", python]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0 and "skipped" in ended.stderr and "--peer-python" in ended.stderr


@pytest.mark.slow
def test_an_example_of_bsk_rl_steps_as_long_as_its_actions():
    pytest.importorskip("bsk_rl")
    pytest.importorskip("spiceypy")
    with Peer(sys.executable) as peer:
        answer = peer.measure("scanning_10s", 0.5)
    assert answer["steps"] > 0 and answer["simulated_s"] == pytest.approx(10.0 * answer["steps"])
