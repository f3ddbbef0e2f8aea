"""Planned burns: finite, centred, exact in velocity; refused where the tank cannot."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from swarm_mj.errors import PathError, ScenarioError
from swarm_mj.flight.burns import PlannedBurns, check_burns, push_of
from swarm_mj.flight.fly import initial_state, make_simulation, simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.finite_burns import propellant_for
from swarm_mj.mission.trajectories import PlannedBurn, propagate
from swarm_mj.records.propulsion import propulsion_summary
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.simulator.telemetry import VARIABLES

KEYS = ["duration_s=400", "design.time_of_flight_s=400"]


def plan_with(burns, *keys):
    plan = make_plan(load_scenario("eros-quick", parse_overrides([*KEYS, *keys])))
    return replace(plan, deployment=replace(plan.deployment, burns=tuple(burns)))


@pytest.fixture(scope="module")
def flights():
    """The flight with two burns by six nozzles, and the plan."""
    plan = plan_with(
        [PlannedBurn(0, 100.0, np.array([0.3, 0.0, -0.2])), PlannedBurn(1, 200.25, np.array([0.0, 0.5, 0.0]))],
        "spacecraft.thrusters={min_impulse_bit_n_s: 0}",
    )
    return plan, simulate(plan)


def test_a_flight_with_burns_is_that_with_impulses_at_their_middle(flights):
    plan, telemetry = flights
    assert isinstance(telemetry, xr.Dataset)
    for j, (burn, gap) in enumerate((b, 1e-3) for b in plan.deployment.burns):
        assert telemetry["delta_v_m_s"].values[-1, j] == pytest.approx(np.linalg.norm(burn.delta_v_N), rel=1e-4)
        start = plan.deployment.r0_N[None], plan.deployment.v0_N[j][None]
        r, v = propagate(plan.environment.acceleration_N, *start, np.array([0.0, burn.t]))
        r, v = propagate(plan.environment.acceleration_N, r[-1], v[-1] + burn.delta_v_N, np.array([burn.t, 400.0]))
        away = np.linalg.norm(telemetry["r_BN_N"].values[-1, j] - r[-1, 0])
        duration = propellant_for(float(np.linalg.norm(burn.delta_v_N)), 8.0, 65.0 * 9.80665) * 65.0 * 9.80665 / 0.055
        # The middle of the gain comes a little later, for the mass falls: by d dv / (12 v_e).
        assert away < 0.05 + duration * np.linalg.norm(burn.delta_v_N) * gap
        assert np.linalg.norm(telemetry["v_BN_N"].values[-1, j] - v[-1, 0]) < 2e-3
    moving = np.linalg.norm(telemetry["thrust_N"].values, axis=2) > 0.0
    times = telemetry["time"].values[moving[:, 1]]
    assert 0.5 * (times[0] + times[-1]) == pytest.approx(200.25, abs=1.5)


def test_what_the_telemetry_says_of_tanks_hangs_together(flights):
    plan, telemetry = flights
    left, mass = telemetry["propellant_kg"].values, telemetry["mass_kg"].values
    assert mass - left == pytest.approx(np.full_like(left, 7.8))
    assert left[0] == pytest.approx([0.2, 0.2]) and (np.diff(left, axis=0) <= 0.0).all()
    gained = telemetry["delta_v_m_s"].values[-1]
    least = 65.0 * 9.80665 * np.log(8.0 / mass[-1])
    assert (gained <= least + 1e-9).all() and (gained >= least / np.sqrt(3.0) - 1e-9).all()
    assert {"thrust_N", "propellant_kg", "mass_kg", "delta_v_m_s"} <= set(VARIABLES)


def test_four_nozzles_turn_the_spacecraft_along_its_burn():
    plan = plan_with(
        [PlannedBurn(1, 250.0, np.array([-0.4, 0.3, 0.2]))],
        "spacecraft.thrusters={layout: four_z, min_impulse_bit_n_s: 0}",
    )
    simulation = make_simulation(plan)
    gained = []
    for _ in range(800):
        simulation.fly(1)
        gained.append(simulation.propulsion.delta_v_N[1].copy())
    assert gained[-1] == pytest.approx([-0.4, 0.3, 0.2], abs=0.01)
    used = 0.2 - simulation.propulsion.propellant[1]
    assert used == pytest.approx(
        propellant_for(np.sqrt(0.29), 8.0, 65.0 * 9.80665) / np.cos(np.radians(15.0)), rel=0.02
    )


def test_a_second_flight_of_a_simulation_burns_again():
    plan = plan_with([PlannedBurn(0, 30.0, np.array([0.1, 0.0, 0.0]))], "spacecraft.thrusters={}")
    simulation, ends = make_simulation(plan), []
    for _ in range(2):
        simulation.reset(initial_state(plan))
        simulation.fly(120)
        ends.append((simulation.state.r_N.copy(), simulation.propulsion.propellant.copy()))
    assert np.array_equal(ends[0][0], ends[1][0]) and np.array_equal(ends[0][1], ends[1][1])
    assert ends[0][1][0] < 0.2


def test_burns_beyond_the_tank_are_refused():
    plan = plan_with([PlannedBurn(1, 100.0, np.array([0.0, 20.0, 0.0]))], "spacecraft.thrusters={}")
    with pytest.raises(PathError, match=r"beyond the tank: sc2 needs 20 m/s and its tank gives 16\.14 m/s .*raise"):
        check_burns(plan.deployment, push_of(plan.properties, None))
    without = replace(plan.properties, thrusters=None)
    with pytest.raises(ScenarioError, match=r"no thrusters: give spacecraft\.thrusters"):
        check_burns(plan.deployment, push_of(without, None))


def test_burns_of_one_spacecraft_share_its_tank_and_follow_each_other():
    plan = plan_with([], "spacecraft.thrusters={}")
    simulation = make_simulation(plan)
    propulsion, one = simulation.propulsion, np.array([1.0, 0.0, 0.0])
    law = PlannedBurns(
        [PlannedBurn(0, 300.0, one), PlannedBurn(0, 100.0, one)],
        propulsion.thrusters,
        propulsion.allocation,
        propulsion.mass,
    )
    (first, second), *others = law.burns
    assert first.planned.t == 100.0 and not any(others)
    assert second.duration == pytest.approx(first.duration * (8.0 - propellant_for(1.0, 8.0, 65.0 * 9.80665)) / 8.0)


def test_the_summary_tells_what_tanks_gave(flights):
    plan, telemetry = flights
    told = propulsion_summary(plan, telemetry)
    assert told["planned_burns_m_s"]["sc2"] == 0.5 and told["thrust_delta_v_m_s"]["sc2"] == pytest.approx(0.5, rel=1e-4)
    assert told["propellant_used_kg"]["sc1"] + told["propellant_left_kg"]["sc1"] == pytest.approx(0.2)
    assert propulsion_summary(plan, telemetry.drop_vars("propellant_kg")) == {}
