"""The environment flies what `swarm-mj run` flies: the same attitudes, coverage and links for the same targets and seed."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.scenarios.loading import load_scenario

from .flights import CENTRE, ID, LookAt, fly

SEED = 12
SEEN = ["observation.observer=horizon", f"seed={SEED}"]


@pytest.mark.parametrize("patch", [None, 5, 12])
def test_a_held_role_flies_and_sees_what_the_command_line_does(roles, patch):
    fly(roles, np.full(5, CENTRE if patch is None else patch), SEED)
    plan = make_plan(load_scenario("eros-observe", SEEN))
    if patch is None:
        behavior = LookAt(TargetKind.ASTEROID)
    else:
        behavior = LookAt(TargetKind.SURFACE, tuple(roles.patches.centre_A[patch]))
    plan = replace(plan, behavior=behavior)
    telemetry = simulate(plan)
    result = observe_flight(plan, telemetry)
    assert np.array_equal(roles.state.r_BN_N, telemetry["r_BN_N"].values[-1])
    assert np.array_equal(roles.state.omega_BN_B, telemetry["omega_BN_B"].values[-1])
    assert np.array_equal(roles.first_seen_s, result.coverage.first_seen_s, equal_nan=True)
    assert roles.batch.totals.percent[0] == result.coverage.percent > 5.0


def test_what_goes_wrong_is_drawn_anew_for_every_episode_and_replays():
    changes = [
        "mass_percent=5",
        "gyro_angular_random_walk_deg_sqrt_h=0.15",
        "attitude_deg=10",
        "wheel_coulomb_n_m=1e-5",
    ]
    scenario = load_scenario("eros-observe", [f"dispersions.{change}" for change in changes])
    env = gymnasium.make(ID, scenario=scenario).unwrapped
    assert not env.batch.why_python

    def fly_some(seed):
        env.reset(options={"flight_seed": seed})
        return np.array([env.step(np.full(5, CENTRE))[0] for _ in range(20)])

    first, again, other = fly_some(1), fly_some(1), fly_some(2)
    assert np.array_equal(first, again)
    assert not np.allclose(first[:, 6:9], other[:, 6:9], atol=1e-3)
    env.close()


def test_a_spacecraft_lost_to_a_fault_takes_no_more_pictures_and_the_others_go_on():
    lost = '[{"kind": "spacecraft_lost", "spacecraft": "sc2", "at_s": 200}]'
    env = gymnasium.make(ID, scenario=load_scenario("eros-observe", [f"faults={lost}"])).unwrapped
    whole = gymnasium.make(ID).unwrapped
    seen, terms = [], []
    for each in (env, whole):
        each.reset(options={"flight_seed": 3})
        for _ in range(80):
            observation, _, terminated, truncated, info = each.step(np.array([5, 6, 9, 10, CENTRE]))
            assert not (terminated or truncated)
            terms.append(info["reward_terms"]["loss"])
        seen.append(info["coverage_percent"])
    assert env.batch.totals.lost[0].tolist() == [False, True, False, False, False]
    assert 1.0 < seen[0] < seen[1]
    imaging = env.observation_layout.split(env.batch.observation[0])["imaging"].ravel()
    assert imaging.tolist() == [1.0, 0.0, 1.0, 1.0, 1.0]
    assert set(terms) == {0.0}  # a fault is nobody's mistake
    env.close()
