"""Thrusters in flight against the rocket equation, conservation laws, closed forms and another integrator."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from swarm_mj.errors import PluginError, SimulationError
from swarm_mj.flight.environment import environment_from
from swarm_mj.mission.behaviors import Targets
from swarm_mj.scenarios.constants import STANDARD_GRAVITY
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema_propulsion import Thrusters
from swarm_mj.simulator.faults.injection import NOTHING
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.propulsion import logarithmic_mean
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.simulator.state import InitialState
from swarm_mj.spacecraft.control.force import SumOfForces
from swarm_mj.spacecraft.model import build_model
from swarm_mj.spacecraft.properties import SpacecraftProperties

from .flying import numbers_of

COLD_GAS = Thrusters(min_impulse_bit_n_s=0.0)


class NoTorque:
    def torque(self, inputs, memory):
        return np.zeros_like(inputs.sigma_BR), memory


class HoldStill:
    """Pulls the attitude to that of N."""

    def torque(self, inputs, memory):
        return -0.02 * inputs.sigma_BR - 0.08 * inputs.omega_BN_B, memory


class Watch:
    """All look along a direction of N."""

    dedicated_communications = False

    def __init__(self, n, direction=(0.0, 0.0, 1.0)):
        self.answer = Targets(np.full(n, 4), np.zeros(n, int), np.tile(direction, (n, 1)).astype(float))

    def targets(self, view, memory):
        return self.answer, memory


class Push:
    """A force that stays."""

    def __init__(self, force, until=np.inf):
        self.force, self.until = np.atleast_2d(np.asarray(force, float)), until

    def forces(self, view, memory):
        self.view = view
        wish = np.broadcast_to(self.force, view.r_BN_N.shape)
        return (wish if view.t < self.until else np.zeros_like(wish)), memory


class NoGravity:
    def acceleration(self, r):
        return np.zeros_like(r)


@pytest.fixture(scope="module")
def surroundings(eros):
    return environment_from(load_scenario("eros-quick"), eros)


def swarm(eros, surroundings, law, *, n=1, properties=None, gravity=False, start=None, thrusters=COLD_GAS, **keys):
    properties = replace(properties or SpacecraftProperties(), thrusters=thrusters)
    model_keys = {k: keys.pop(k) for k in ("stepper", "geometry") if k in keys}
    model = build_model(n, shape=eros, properties=properties, **{"geometry": False, **model_keys})
    if change := keys.pop("change", None):
        change(model.mjmodel)
    behavior, controller = keys.pop("behavior", Watch(n)), keys.pop("controller", NoTorque())
    environment = surroundings if gravity else replace(surroundings, gravity=NoGravity())
    simulation = Simulation(
        FlightSetup(model=model, environment=environment, **keys), behavior, controller, force_law=law
    )
    far = {"r_BN_N": np.tile([40e3, 5e3, 0.0], (n, 1)), "v_BN_N": np.tile([-3.0, 1.0, 2.0], (n, 1))}
    still = {"sigma_BN": np.zeros((n, 3)), "omega_BN_B": np.zeros((n, 3))}
    wheels = {"wheel_speed": np.zeros((n, properties.n_wheels))}
    simulation.reset(InitialState(**{**far, **still, **wheels, **(start or {})}))
    return simulation


def velocity(simulation):
    return simulation.state.v_N.copy()


SPACECRAFT = {
    "3u": (SpacecraftProperties(), {}),
    "3u kernel": (SpacecraftProperties(), {"stepper": "kernel"}),
    "1u": (SpacecraftProperties(mass=1.4, size=(0.1, 0.1, 0.1136), wheel_mass=0.05, wheel_spin_inertia=1e-5), {}),
    "12u, four wheels": (
        SpacecraftProperties(mass=24.0, size=(0.2, 0.2, 0.34), wheel_layout="pyramid"),
        {"fault_model": NOTHING},
    ),
}


@pytest.mark.parametrize("name", SPACECRAFT)
def test_a_flight_obeys_the_rocket_equation_until_the_tank_is_empty(eros, surroundings, name):
    properties, keys = SPACECRAFT[name]
    gas = COLD_GAS.model_copy(update={"thrust_n": 2.0})  # a tank of 64 s
    flight = swarm(eros, surroundings, Push([0.0, 0.0, 2.0]), properties=properties, thrusters=gas, **keys)
    before = velocity(flight)
    flight.fly(100)
    used = 2.0 * 50.0 / gas.exhaust_speed
    assert flight.propulsion.propellant == pytest.approx(0.2 - used, rel=1e-8)
    expected = STANDARD_GRAVITY * 65.0 * np.log(properties.mass / (properties.mass - used))
    gained = velocity(flight) - before
    assert gained[0] == pytest.approx([0.0, 0.0, expected], abs=1e-8 * expected)
    flight.fly(60)
    all_of_it = STANDARD_GRAVITY * 65.0 * np.log(properties.mass / (properties.mass - 0.2))
    assert flight.propulsion.propellant[0] == 0.0
    assert velocity(flight)[0, 2] - before[0, 2] == pytest.approx(all_of_it, rel=1e-8)
    assert flight.propulsion.delta_v[0] == pytest.approx(all_of_it, rel=1e-8)
    assert flight.state.mass[0] == pytest.approx(properties.mass - 0.2, rel=1e-12)
    model = flight.model.mjmodel
    if flight.stepper == "mujoco":
        assert model.body_subtreemass[flight.model.hub_body[0]] == pytest.approx(properties.mass - 0.2, rel=1e-12)
        assert model.body_subtreemass[0] == pytest.approx(model.body_mass.sum(), rel=1e-12)
    flight.reset(
        InitialState(
            **{k: np.zeros((1, 3)) for k in ("v_BN_N", "sigma_BN", "omega_BN_B")},
            r_BN_N=np.ones((1, 3)),
            wheel_speed=np.zeros((1, properties.n_wheels)),
        )
    )
    assert flight.state.mass[0] == pytest.approx(properties.mass, rel=1e-12)
    assert model.body_subtreemass[flight.model.hub_body[0]] == pytest.approx(properties.mass, rel=1e-12)


def test_spacecraft_and_gas_together_keep_their_momentum(eros, surroundings):
    thrusters = COLD_GAS.model_copy(update={"thrust_n": 0.5})
    spin = {"omega_BN_B": np.array([[0.01, -0.02, 0.03]])}
    flight = swarm(eros, surroundings, Push([0.2, -0.1, 0.15]), thrusters=thrusters, start=spin)
    mass, v = flight.propulsion.mass, velocity(flight)
    first, gas = mass[:, None] * v, np.zeros((1, 3))
    for _ in range(100):
        flight.fly(1)
        force, now, v_now = flight.propulsion.force_N, flight.propulsion.mass, velocity(flight)
        # Gas leaves with the spacecraft's velocity, which grows as ln m, and pushes back with the force.
        k = np.log(mass / now)
        mean_v = v + (v_now - v) * ((mass - now - now * k) / ((mass - now) * k))[:, None]
        gas += (mass - now)[:, None] * mean_v - force * flight.period
        mass, v = now.copy(), v_now
    assert np.abs(force).max() > 0.1 and gas[0, 0] < -10.0
    assert mass[:, None] * v + gas == pytest.approx(first, abs=1e-11)


def shifted(model):
    """The nozzle at -x stands 2 cm towards +y; it pushes to +x."""
    model.site_pos[model.site("sc1_thruster_4").id, 1] = 0.02


@pytest.mark.parametrize("stepper", ["mujoco", "kernel"])
def test_a_nozzle_off_the_centre_of_mass_turns_the_spacecraft_as_the_closed_form_says(eros, surroundings, stepper):
    gas = COLD_GAS.model_copy(update={"specific_impulse_s": 1e9})  # the tank stays full
    along_x = Turning()
    flight = swarm(eros, surroundings, along_x, thrusters=gas, change=shifted, stepper=stepper)
    flight.fly(120)
    inertia = flight.properties.inertia_effective_B[2, 2]
    rate = -0.02 * 5e-4 * 60.0 / inertia  # r x F = 0.02 m y x 0.0005 N x
    assert flight.state.omega_B[0] == pytest.approx([0.0, 0.0, rate], rel=1e-6, abs=1e-12)
    angle = Rotation.from_quat(flight.state.q_BN[0], scalar_first=True).as_rotvec()
    assert angle == pytest.approx([0.0, 0.0, 0.5 * rate * 60.0], rel=1e-6, abs=1e-11)
    times = np.linspace(0.0, 60.0, 200_001)
    phase = 0.5 * rate / 60.0 * times**2
    expected = 5e-4 / 8.0 * np.trapezoid(np.column_stack((np.cos(phase), np.sin(phase))), times, axis=0)
    gained = flight.state.v_N[0, :2] - np.array([-3.0, 1.0])
    assert gained == pytest.approx(expected, rel=5e-4)


class Turning:
    """Always the same force in B."""

    def forces(self, view, memory):
        now = Rotation.from_quat(view.q_BN, scalar_first=True)
        if memory is None:
            memory = np.zeros((1, 3))
        # The attitude of the middle of the hold, of a spacecraft that turns evenly faster.
        step = (now * Rotation.from_rotvec(memory).inv()).as_rotvec() if view.t > 0 else np.zeros((1, 3))
        middle = now * Rotation.from_rotvec(0.5 * step)
        return middle.apply(np.array([[5e-4, 0.0, 0.0]])), now.as_rotvec()


@pytest.mark.parametrize("stepper", ["mujoco", "kernel"])
def test_a_thrusting_flight_near_eros_agrees_with_dop853_of_a_falling_mass(eros, surroundings, stepper):
    wish = np.array([[0.03, 0.01, -0.02], [-0.05, 0.0, 0.0]])
    r0, v0 = np.array([[20e3, 3e3, 5e3], [-19e3, 9e3, 2e3]]), np.array([[1.0, -4.0, 2.0], [2.0, 2.0, 0.0]])
    start = {"r_BN_N": r0, "v_BN_N": v0}
    flight = swarm(eros, surroundings, Push(wish), n=2, gravity=True, start=start, stepper=stepper)
    flight.fly(1200)
    flow = np.abs(wish).sum(axis=1) / COLD_GAS.exhaust_speed  # N and B are parallel: each component opens one nozzle

    def rhs(t, y):
        r, v = y.reshape(2, 2, 3)
        return np.concatenate((v, surroundings.acceleration_N(t, r) + wish / (8.0 - flow * t)[:, None])).ravel()

    y = solve_ivp(rhs, (0.0, 600.0), np.stack((r0, v0)).ravel(), method="DOP853", rtol=1e-12, atol=1e-9).y[:, -1]
    assert np.abs(flight.state.r_N - y.reshape(2, 2, 3)[0]).max() < 1e-3
    assert np.abs(flight.state.v_N - y.reshape(2, 2, 3)[1]).max() < 1e-5
    assert flight.propulsion.propellant == pytest.approx(0.2 - 600.0 * flow, rel=1e-7)
    if stepper == "mujoco":
        data, model = flight.data, flight.model.mjmodel
        mujoco.mj_energyVel(model, data)
        # By MuJoCo's own account too; its mass is the mean of the last hold.
        mass = 8.0 - flow * 599.75
        assert data.energy[1] == pytest.approx((0.5 * mass * (flight.state.v_N**2).sum(axis=1)).sum(), rel=1e-9)


def test_the_hub_s_inertia_falls_with_its_mass(eros, surroundings):
    flight = swarm(
        eros,
        surroundings,
        Push([0.0, 0.0, 5.0]),
        thrusters=COLD_GAS.model_copy(update={"thrust_n": 5.0, "propellant_kg": 2.0}),
    )
    hub = flight.model.hub_body[0]
    mass, inertia = flight.model.mjmodel.body_mass[hub], flight.model.mjmodel.body_inertia[hub].copy()
    flight.fly(600)
    left = flight.model.mjmodel.body_mass[hub]
    assert left == pytest.approx(mass - 2.0, rel=1e-12)
    assert flight.model.mjmodel.body_inertia[hub] == pytest.approx(inertia * left / mass, rel=1e-12)


@pytest.mark.parametrize("controller", [NoTorque(), None])
def test_closed_thrusters_change_nothing(eros, surroundings, controller):
    keys = {"n": 2, "gravity": True, "start": {"omega_BN_B": np.full((2, 3), 0.01)}}
    flights = [swarm(eros, surroundings, None, thrusters=gas, **keys) for gas in (COLD_GAS, None)]
    flights.append(swarm(eros, surroundings, Push([0.0, 0.0, 0.0]), **keys))
    for flight in flights:
        flight.fly(40)
    for other in flights[1:]:
        assert np.array_equal(numbers_of(flights[0].batch.flights), numbers_of(other.batch.flights))


def test_a_wish_beyond_the_nozzles_is_cut_and_keeps_its_direction(eros, surroundings):
    flight = swarm(eros, surroundings, Push([0.2, 0.1, 0.0]))
    flight.decide()
    assert flight.propulsion.force_N[0] == pytest.approx([0.055, 0.0275, 0.0], rel=1e-6)


def test_a_pulse_is_at_least_the_shortest_one_or_none(eros, surroundings):
    bit = COLD_GAS.model_copy(update={"min_impulse_bit_n_s": 0.001})  # 2 mN over half a second
    flight = swarm(eros, surroundings, Push([0.0009, 0.0011, 0.004]), thrusters=bit)
    flight.decide()
    assert flight.propulsion.force_N[0] == pytest.approx([0.0, 0.002, 0.004], rel=1e-6, abs=1e-12)


def test_a_law_is_asked_by_what_the_tank_holds_and_laws_add_up(eros, surroundings):
    one, other = Push([0.01, 0.0, 0.0]), Push([0.0, 0.02, 0.0])
    flight = swarm(eros, surroundings, SumOfForces([one, other]), n=2)
    flight.fly(3)
    used = 2 * 0.5 * 0.03 / COLD_GAS.exhaust_speed
    assert other.view.propellant == pytest.approx(0.2 - used, rel=1e-6)
    assert other.view.mass == pytest.approx(8.0 - used)
    assert other.view.delta_v_N[1] == pytest.approx([0.01 / 8.0, 0.02 / 8.0, 0.0], rel=1e-4)
    assert flight.propulsion.force_N[1] == pytest.approx([0.01, 0.02, 0.0])


def test_what_a_force_law_must_not_answer_is_told(eros, surroundings):
    for wrong, words in (([[np.nan, 0, 0]], "not finite"), ("much", "forces must return|force")):
        law = Push([0.0, 0.0, 0.0])
        law.forces = lambda view, memory, wrong=wrong: (wrong, memory)
        with pytest.raises(PluginError, match=words):
            swarm(eros, surroundings, law).decide()
    with pytest.raises(PluginError, match=r"have no thrusters; give spacecraft\.thrusters"):
        swarm(eros, surroundings, Push([0.0, 0.0, 0.0]), thrusters=None)
    with pytest.raises(SimulationError, match=r"propellant_kg = 7\.7: must be below the hub's 7\.61 kg"):
        swarm(eros, surroundings, None, thrusters=COLD_GAS.model_copy(update={"propellant_kg": 7.7}))


def test_the_logarithmic_mean_is_the_same_by_its_series():
    mass, used = np.array([8.0]), np.array([8.0 * 9.99e-4])
    assert logarithmic_mean(mass, used) == pytest.approx(used / np.log(mass / (mass - used)), rel=1e-13)
