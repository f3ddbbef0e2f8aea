"""The reward terms as the environment's docstring defines them, worked out from the flight by NumPy alone."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.scenarios.loading import load_scenario

from .flights import BOTH, CENTRE, EARTH, ID, LookAt, place

MAX_TORQUE, TOP_SPEED = 0.004, 6000.0 * 2.0 * np.pi / 60.0
SHARE = 10.0 / 1500.0  # of a step in the flight


@BOTH
def test_effort_is_the_mean_square_of_the_torques_that_an_action_asks_for(begin, kind):
    flights, rng = begin(kind, control="torque", step_s=10.0), np.random.default_rng(0)
    for sign in (1.0, -1.0) * 4:
        if sign > 0.0:
            action = rng.uniform(-0.25, 0.25, (flights.count, 15)).astype(np.float32)
        _, terms, _ = flights.step(np.float32(sign) * action)
        assert np.abs(flights.wheel_speed).max() < 0.9 * TOP_SPEED  # nothing is cut by a limit
        expected = -0.02 * SHARE * (action.astype(float) ** 2).mean(axis=1)
        assert terms["effort"] == pytest.approx(expected, rel=1e-12)


@BOTH
def test_effort_is_the_mean_square_of_the_torques_of_the_same_flight_on_the_command_line(begin, kind):
    seeds = (12, 13, 14)
    flights = begin(kind, seeds=seeds)
    terms = np.array([flights.step(np.full(5, CENTRE))[1]["effort"] for _ in range(40)]).T
    for e in range(flights.count):
        plan = make_plan(load_scenario("eros-observe", [f"seed={seeds[e]}", "telemetry.interval_s=0.5"]))
        torque = simulate(replace(plan, behavior=LookAt(TargetKind.ASTEROID)))["wheel_torque"].values[: 40 * 20]
        expected = -0.02 * SHARE * ((torque / MAX_TORQUE) ** 2).reshape(40, 20 * 5 * 3).mean(axis=1)
        assert terms[e] == pytest.approx(expected, rel=1e-9)
    assert terms[:, 0].max() < -1e-6  # the first slew takes torque


def test_friction_in_the_bearings_is_no_effort_of_the_motors(begin):
    scenario = load_scenario("eros-observe", ["dispersions.wheel_coulomb_n_m=1e-3"])
    flights = begin("single", control="torque", scenario=scenario, step_s=10.0)
    action = np.full(15, 0.2, np.float32)
    _, terms, _ = flights.step(action)
    slowed = np.abs(flights.wheel_speed).min() < 0.8 * np.abs(flights.wheel_speed).max()
    assert slowed and terms["effort"][0] == pytest.approx(-0.02 * SHARE * float(action[0]) ** 2, rel=1e-12)


@BOTH
def test_saturation_is_the_mean_of_the_last_tenth_below_top_speed(begin, kind):
    flights = begin(kind, control="torque", step_s=10.0)
    # Wheels reach their top speed, 15 mN m s, at different times and in both directions; a third of them never does.
    action = np.random.default_rng(1).uniform(0.1, 0.14, 15) * np.tile([1.0, -1.0, 0.0], 5)
    seen = []
    for _ in range(6):
        _, terms, _ = flights.step(action.astype(np.float32))
        part = np.clip((np.abs(flights.wheel_speed) / TOP_SPEED - 0.9) / 0.1, 0.0, 1.0)
        assert terms["saturation"] == pytest.approx(-0.1 * SHARE * part.mean(axis=(1, 2)), rel=1e-9, abs=1e-18)
        seen.append(part)
    seen = np.array(seen)
    assert (seen[0] == 0.0).all()
    assert ((seen > 0.05) & (seen < 0.95)).any()
    assert (seen[-1] > 0.99).mean() > 0.5


@BOTH
def test_approach_is_the_share_of_pairs_that_come_too_close_after_the_grace_time(begin, kind):
    least, grace = 500.0, 50.0
    changes = [f"safety.min_separation_m={least}", f"safety.separation_grace_s={grace}"]
    flights = begin(kind, scenario=load_scenario("eros-observe", changes))
    pairs, along, shares = np.triu_indices(5, 1), np.linspace(0.0, 1.0, 1001)[:, None, None, None], []
    for k in range(70):
        before = flights.r_N
        _, terms, _ = flights.step(np.full(5, CENTRE))
        r = before + along * (flights.r_N - before)
        distance = np.linalg.norm(r[:, :, pairs[0]] - r[:, :, pairs[1]], axis=3).min(axis=0)
        assert (np.abs(distance - least) > 0.1).all()  # no pair that rounding could decide
        share = (distance < least).mean(axis=1) if 10.0 * k >= grace else np.zeros(flights.count)
        assert terms["approach"] == pytest.approx(-0.1 * SHARE * share, rel=1e-9, abs=1e-18)
        shares.append(share[0])
    assert shares[:5] == [0.0] * 5 and shares[5] > 0.0  # all come from one place, but that is excused
    assert len(set(shares)) >= 3


def test_a_pair_that_passes_within_a_step_counts_though_it_is_far_apart_at_both_ends(begin):
    flights = begin("single")
    for _ in range(10):
        _, terms, _ = flights.step(np.full(5, CENTRE))
        assert terms["approach"][0] == 0.0
    inner = flights.batches[0].flights
    qpos, qvel = inner.qpos.reshape(5, 10), inner.qvel.reshape(5, 9)
    place(inner, 0, 1, position=qpos[0, :3] + (1500.0, 0.0, 0.0), velocity=qvel[0, :3] - (100.0, 0.0, 0.0))
    flights.step(np.full(5, CENTRE))
    apart = np.linalg.norm(qpos[1, :3] - qpos[0, :3])
    _, terms, _ = flights.step(np.full(5, CENTRE))
    assert apart > 400.0 and np.linalg.norm(qpos[1, :3] - qpos[0, :3]) > 400.0
    assert terms["approach"][0] == pytest.approx(-0.1 * SHARE / 10.0, rel=1e-9)


def test_rewards_sum_to_what_was_seen_and_delivered(roles):
    roles.reset(seed=3)
    rng = np.random.default_rng(0)
    totals, infos = dict.fromkeys(roles.reward_weights, 0.0), []
    for k in range(150):
        action = rng.integers(0, 17, 5) if k < 80 else np.array([EARTH, 17, 17, 17, 17])
        _, reward, terminated, truncated, info = roles.step(action)
        assert reward == sum(info["reward_terms"].values())
        infos.append(info)
        for name, value in info["reward_terms"].items():
            totals[name] += value
        if terminated or truncated:
            break
    assert totals["seen"] == pytest.approx(info["coverage_percent"] / 100.0, abs=1e-12)
    assert totals["delivered"] * roles.task.nominal_bit == pytest.approx(info["delivered_bit"], rel=1e-9)
    assert info["delivered_bit"] > 1e5
    assert totals["effort"] < 0.0
    # Nothing is lost on the way: what is aboard plus what was delivered only grows, and stays while nobody takes pictures.
    held = np.array([sum(i["stored_bit"]) + i["delivered_bit"] for i in infos])
    assert (np.diff(held) >= -1e-3).all()
    assert held[80:] == pytest.approx(held[-1], rel=1e-12)


def test_a_target_seen_and_delivered_ends_the_episode():
    env = gymnasium.make(ID, complete=2.0).unwrapped
    env.reset(seed=0)
    for k in range(150):
        action = np.full(5, 5)
        if k >= 52:
            action = np.full(5, EARTH)
        *_, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            break
    assert (terminated, truncated, info["end"]) == (True, False, "complete")
    assert info["coverage_percent"] >= 2.0 and sum(info["stored_bit"]) < 1.0
    env.close()
