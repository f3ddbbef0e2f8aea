"""MuJoCo's `mj_step` and the kernel fly packaged scenarios to the same places: wheels as bodies, and as momenta."""

import numpy as np
import pytest

from swarm_mj.flight.fly import make_simulation

from .flying import DISPERSIONS, FAULTS, angle, fly, near_polyhedron, plan_of

FINE = "physics.timestep_s=0.1"
GAS = "spacecraft.thrusters={layout: six, thrust_n: 0.055, specific_impulse_s: 65, propellant_kg: 0.2}"
LATE = "design.observers=[{visiting_point: 12}, {visiting_point: 40, release_s: 40}]"
CASES = {
    "as planned": ("eros-quick", [FINE]),
    "faults": ("eros-faults", [FINE]),
    "much goes wrong": ("eros-config2", [*DISPERSIONS, FAULTS]),
    "thrusters": (
        "eros-quick",
        [FINE, GAS, "trajectory.corrections=[{after_release_s: 20}]", "dispersions.deployment_velocity_m_s=0.05"],
    ),
    "late releases": ("eros-quick", [FINE, LATE]),
    "four wheels": ("eros-quick", [FINE, "spacecraft.wheel_layout=pyramid"]),
    "polyhedron": ("eros-quick", [FINE]),
    "minimum-time slews": ("eros-quick", [FINE, "control.slew=time_optimal"]),
}


@pytest.mark.parametrize("case", CASES)
def test_both_steppers_fly_the_same(case):
    name, overrides = CASES[case]
    flown = []
    for stepper in ("mujoco", "kernel"):
        plan = plan_of(name, *overrides, f"physics.stepper={stepper}")
        plan = near_polyhedron(plan) if case == "polyhedron" else plan
        simulation = make_simulation(plan)
        assert simulation.stepper == stepper
        flown.append((simulation, simulation.run(100.0, 1.0)))
    (one, by_mujoco), (other, by_kernel) = flown
    assert np.abs(by_mujoco.samples["r_BN_N"] - by_kernel.samples["r_BN_N"]).max() < 1e-9
    assert angle(by_mujoco.samples["q_BN"], by_kernel.samples["q_BN"]).max() < 1e-8
    speed, same = by_mujoco.samples["wheel_speed"], by_kernel.samples["wheel_speed"]
    assert np.abs(speed - same).max() < 1e-6 * np.abs(speed).max()
    for name in ("mode", "tracked_spacecraft"):
        assert np.array_equal(by_mujoco.samples[name], by_kernel.samples[name])
    assert [(e.time_s, e.kind) for e in one.events] == [(e.time_s, e.kind) for e in other.events]
    if case == "thrusters":
        assert one.propulsion.delta_v.max() > 1e-3
        np.testing.assert_allclose(one.propulsion.propellant, other.propulsion.propellant, rtol=1e-9)


def test_a_large_step_costs_both_little():
    plans = [plan_of("eros-quick", f"physics.stepper={stepper}") for stepper in ("mujoco", "kernel")]
    one, other = (fly(plan, 600).state for plan in plans)
    assert angle(one.q_BN, other.q_BN).max() < 1e-7
