"""With noise or delay of the sensors the agent reads what the flight software knows; reward and physics stay on the truth."""

import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from swarm_mj.flight.fly import initial_state, make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.scenarios.loading import load_scenario

from .flights import CENTRE, HOLD, ID, Flights, LookAt, rotation

NOISE = ["dispersions.gyro_angular_random_walk_deg_sqrt_h=5", "dispersions.star_tracker_noise_arcsec=1800"]
#: Sensors that fail at the very instant at which a step ends.
FAILING = [
    {"kind": "star_tracker_dropout", "spacecraft": "sc2", "at_s": 50},
    {"kind": "gyro_bias", "spacecraft": "sc3", "at_s": 70, "bias_deg_h": [900, 0, 0]},
]


def noisy(*more):
    return load_scenario("eros-observe", [*NOISE, *more])


def what_the_controller_is_given(plan, seed, periods):
    """Of a flight by itself that looks at the body's centre: known attitudes and rates, true attitudes, by control period."""
    plan = replace(plan, behavior=LookAt(TargetKind.ASTEROID), scenario=plan.scenario.model_copy(update={"seed": seed}))
    simulation, given, controller = make_simulation(plan), [], plan.controller
    law = controller.torque

    class Listening:
        def torque(self, inputs, memory):
            sensing = simulation.injection.faults.sensing
            given.append((sensing.knowledge.q_BN.copy(), inputs.omega_BN_B.copy(), simulation.data.qpos.copy()))
            return law(inputs, memory)

    simulation.controller = Listening()
    simulation.reset(initial_state(plan))
    for _ in range(periods + 1):
        simulation.decide()
        simulation.advance()
    return given


@pytest.mark.parametrize("kind", ["single", "vector"])
def test_observations_are_what_the_controller_is_given_at_that_instant_and_reading_changes_no_flight(kind):
    scenario = noisy("dispersions.delay_s=1.5", f"faults={json.dumps(FAILING)}")
    flights, seeds = Flights(kind, scenario=scenario), (4, 5, 6)
    rows = [flights.parts(flights.reset(*seeds))]
    truth = [flights.gather(lambda batch: batch.flights.qpos)]
    for _ in range(12):
        rows.append(flights.parts(flights.step(np.full(5, CENTRE))[0]))
        truth.append(flights.gather(lambda batch: batch.flights.qpos))
    off = []
    for e in range(flights.count):
        given = what_the_controller_is_given(make_plan(scenario), seeds[e], 240)
        for k, row in enumerate(rows):
            q, omega, qpos = given[20 * k]
            assert np.array_equal(truth[k][e], qpos)
            C_AN, turn = flights.plan.environment.C_AN(10.0 * k), rotation(q)
            assert row["boresight"][e] == pytest.approx(turn[..., 2] @ C_AN.T, abs=1e-6)
            assert row["x_axis"][e] == pytest.approx(turn[..., 0] @ C_AN.T, abs=1e-6)
            assert row["rate"][e] == pytest.approx(np.clip(omega / 0.1, -10.0, 10.0), abs=1e-6)
            true = rotation(qpos.reshape(5, 10)[:, 3:7])
            off.append(np.degrees(np.linalg.norm(true[..., 2] - turn[..., 2], axis=1)))
    assert np.median(off) > 0.05
    flights.close()


def test_late_sensors_show_the_attitude_of_two_seconds_ago():
    late = [{"kind": "sensor_delay", "spacecraft": f"sc{j + 1}", "at_s": 0, "delay_s": 2} for j in range(5)]
    scenario = load_scenario("eros-observe", [f"faults={json.dumps(late)}"])
    flights = Flights("single", scenario=scenario, step_s=2.0)
    flights.reset(1)
    turned = []
    for _ in range(20):
        before = flights.C_BN[0]
        row = flights.parts(flights.step(np.full(5, CENTRE))[0])
        C_AN = flights.plan.environment.C_AN(flights.t)
        assert row["boresight"][0] == pytest.approx(before[:, 2] @ C_AN.T, abs=1e-6)
        turned.append(np.linalg.norm(flights.C_BN[0, :, 2] - before[:, 2], axis=1).max())
    assert max(turned) > 0.02
    flights.close()


@pytest.mark.parametrize("changes", [[], ["dispersions.mass_percent=2"], ["spacecraft.wheel_layout=pyramid"]])
def test_without_noise_and_delay_the_flight_software_knows_the_truth_bit_for_bit(changes):
    env = gymnasium.make(ID, scenario=load_scenario("eros-observe", changes)).unwrapped
    env.reset(seed=0)
    for _ in range(5):
        observation, *_ = env.step(np.full(5, CENTRE))
        batch, state = env.batch, env.state
        assert np.array_equal(batch.estimate.C_BN, batch.now.C_BN)
        rate = (state.omega_BN_B / 0.1).astype(np.float32)
        assert np.array_equal(env.observation_layout.split(observation)["rate"], rate)
    env.close()


def test_the_agent_does_not_see_the_truth_but_state_and_coverage_are_true():
    env = gymnasium.make(ID, scenario=noisy()).unwrapped
    env.reset(seed=0)
    for _ in range(60):
        observation, *_ = env.step(np.full(5, CENTRE))
    parts, state = env.observation_layout.split(observation), env.state
    true = state.boresight_N @ state.C_AN.T
    assert (np.linalg.norm(parts["boresight"] - true, axis=1) > 1e-5).all()
    assert np.array_equal(state.C_BN, env.batch.now.C_BN[0])
    # What it believes is on the centre; the truth is off by the error of the estimate.
    assert parts["position"] * 35_000.0 == pytest.approx(state.r_BN_N @ state.C_AN.T, abs=0.01)
    env.close()


@pytest.mark.parametrize("control", ["role", "pointing", "torque"])
def test_a_vector_of_noisy_flights_is_bit_for_bit_that_of_single_ones(control):
    scenario = noisy("dispersions.delay_s=1")
    vector = gymnasium.make_vec(ID, num_envs=3, scenario=scenario, control=control, threads=2)
    singles = [gymnasium.make(ID, scenario=scenario, control=control).unwrapped for _ in range(3)]
    start, _ = vector.reset(seed=8)
    assert np.array_equal(start, [env.reset(seed=8 + e)[0] for e, env in enumerate(singles)])
    vector.action_space.seed(0)
    for _ in range(15):
        actions = vector.action_space.sample()
        observations, rewards, *_ = vector.step(actions)
        rows = [env.step(actions[e])[:2] for e, env in enumerate(singles)]
        assert np.array_equal(observations, [row for row, _ in rows])
        assert rewards.tolist() == [reward for _, reward in rows]
    for env in (vector, *singles):
        env.close()


def test_hold_holds_where_the_spacecraft_believes_to_look():
    env = gymnasium.make(ID, scenario=noisy()).unwrapped
    env.reset(seed=0)
    for _ in range(20):
        observation, *_ = env.step(np.full(5, CENTRE))
    believed = env.observation_layout.split(observation)["boresight"] @ env.state.C_AN
    env.step(np.full(5, HOLD))
    assert (env.batch.flights.kind == TargetKind.DIRECTION).all()
    assert env.batch.level.held.vector[0] == pytest.approx(believed, abs=1e-6)
    env.close()


def test_the_place_of_the_target_belongs_to_the_environment_and_not_to_the_flight():
    def axis(*changes):
        scenario = load_scenario("eros-observe", ["dispersions.target_m=300", *changes])
        # Horizon maps take 10 s for each place.
        env = gymnasium.make(ID, scenario=scenario, observer="raycast").unwrapped
        env.reset(options={"flight_seed": 3})
        first = env.plan.region.axes_A[2].copy()
        env.reset(options={"flight_seed": 4})
        assert np.array_equal(env.plan.region.axes_A[2], first)
        env.close()
        return first

    planned = gymnasium.make(ID).unwrapped.plan.region.axes_A[2]
    places = [planned, axis("seed=7"), axis("seed=8")]
    away = [np.linalg.norm(a - b) for a, b in zip(places, places[1:] + places[:1], strict=True)]
    assert min(away) > 0.002  # some 30 m
