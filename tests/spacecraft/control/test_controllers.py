"""Control laws at single instants: what the torque does to an independently written plant."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swarm_mj.errors import ScenarioError
from swarm_mj.spacecraft.control import ControlInput, Controller, MrpFeedback, MrpSlidingMode

from .plant import WHEEL_INERTIA, Plant, State, sliding_variable, unit

N = 400
#: A full inertia matrix: product terms must enter the equations as well.
TILTED = np.array([[0.08, 0.004, -0.003], [0.004, 0.09, 0.002], [-0.003, 0.002, 0.02]])
AXES = np.eye(3)


class Moment:
    """Random spacecraft at one instant, with a reference that turns and accelerates steadily in N."""

    def __init__(self, seed: int, rate: float = 0.1) -> None:
        rng = np.random.default_rng(seed)
        self.state = State(
            unit(rng.normal(size=(N, 4))), rng.uniform(-rate, rate, (N, 3)), rng.uniform(-300, 300, (N, 3))
        )
        offset = Rotation.from_rotvec(rng.uniform(-1.6, 1.6, (N, 3)))
        self.R = Rotation.from_quat(self.state.q, scalar_first=True) * offset
        self.omega_RN_N, self.domega_RN_N = rng.uniform(-0.01, 0.01, (2, N, 3))
        self.domega_RN_N *= 0.1

    def errors(self, state: State, t: float) -> tuple[np.ndarray, ...]:
        """sigma_BR, omega_BR_B, omega_RN_B, domega_RN_B after the reference has moved for a short time t."""
        turned = Rotation.from_rotvec(t * self.omega_RN_N + 0.5 * t * t * self.domega_RN_N) * self.R
        body = Rotation.from_quat(state.q, scalar_first=True)
        omega_RN_B = body.inv().apply(self.omega_RN_N + t * self.domega_RN_N)
        sigma = (turned.inv() * body).as_mrp()
        return sigma, state.omega - omega_RN_B, omega_RN_B, body.inv().apply(self.domega_RN_N)

    def inputs(self, inertia: np.ndarray, period: float = 0.5) -> ControlInput:
        sigma, omega_BR, omega_RN, domega = self.errors(self.state, 0.0)
        J = np.ascontiguousarray(np.broadcast_to(inertia, (N, 3, 3)))
        momentum = WHEEL_INERTIA * self.state.wheels
        J_eff = J - WHEEL_INERTIA * np.eye(3)
        return ControlInput(sigma, omega_BR, self.state.omega, omega_RN, domega, momentum, J, J_eff, period)

    def derivative(self, plant: Plant, torque: np.ndarray, quantity) -> np.ndarray:
        """Central difference of quantity(sigma, omega_BR) along the true motion under a held torque."""
        h = 1e-4
        ahead = self.errors(plant.advance(0.0, self.state, -torque, h, 1), h)
        behind = self.errors(plant.advance(0.0, self.state, -torque, -h, 1), -h)
        return (quantity(*ahead[:2]) - quantity(*behind[:2])) / (2 * h)


@pytest.mark.parametrize("rate_limit", [None, 0.1])
def test_sliding_torque_gives_the_plant_the_designed_sliding_dynamics(rate_limit: float | None) -> None:
    law = MrpSlidingMode(rate_limit=rate_limit, inertia_uncertainty=0.0, disturbance_torque=0.0)
    moment = Moment(seed=1)
    inputs = moment.inputs(TILTED)
    torque, _ = law.torque(inputs, None)
    s = sliding_variable(law, inputs.sigma_BR, inputs.omega_BR_B)
    rate = moment.derivative(Plant(inertia=TILTED), torque, partial(sliding_variable, law))
    designed = -law.reaching_rate * np.clip(s / law.layer, -1, 1) - law.damping * s
    np.testing.assert_allclose(rate, designed, rtol=0, atol=2e-9)
    assert (np.abs(s) < law.layer).any()
    assert (np.abs(s) > law.layer).any()


def test_feedback_torque_gives_the_plant_the_designed_error_dynamics() -> None:
    law = MrpFeedback(integral_gain=0.02)
    moment = Moment(seed=2)
    inputs = moment.inputs(TILTED)
    memory = np.random.default_rng(3).normal(size=(N, 3))
    torque, integral = law.torque(inputs, memory)
    rate = moment.derivative(Plant(inertia=TILTED), torque, lambda sigma, omega: omega)
    assert integral is not None
    np.testing.assert_allclose(integral, memory + 0.5 * inputs.sigma_BR, rtol=0, atol=1e-15)
    z = 0.04 * integral + inputs.omega_BR_B
    designed = -0.04 * inputs.sigma_BR - 0.2 * inputs.omega_BR_B - 0.2 * 0.02 * z
    np.testing.assert_allclose(rate, designed, rtol=0, atol=2e-9)


@pytest.mark.parametrize(
    ("law", "reaches"), [(MrpSlidingMode(), True), (MrpSlidingMode(damping=0.0), True), (MrpFeedback(), False)]
)
def test_outside_the_layer_s_shrinks_at_eta_for_any_allowed_inertia_error_and_disturbance(
    law: Controller, reaches: bool
) -> None:
    """The reaching condition s_i ds_i/dt <= -eta |s_i|, point by point, at the worst corners of both uncertainties."""
    sliding = MrpSlidingMode()
    corners = np.array(np.meshgrid([0.8, 1.2], [0.8, 1.2], [0.8, 1.2])).reshape(3, -1).T
    violations = 0
    for seed, believed in enumerate(corners):
        moment = Moment(seed=10 + seed, rate=0.15)
        true_effective = np.array([0.0837, 0.0837, 0.01333])
        plant = Plant(inertia=np.diag(true_effective + WHEEL_INERTIA))
        inputs = moment.inputs(np.diag(believed * true_effective + WHEEL_INERTIA))
        s = sliding_variable(sliding, inputs.sigma_BR, inputs.omega_BR_B)
        plant.external = lambda t, state, s=s: 1e-4 * np.sign(s)
        torque, _ = law.torque(inputs, None)
        s_dot = moment.derivative(plant, torque, partial(sliding_variable, sliding))
        outside = np.abs(s) > sliding.layer
        violations += int(np.sum((s * s_dot > -sliding.reaching_rate * np.abs(s) + 1e-10)[outside]))
    assert (violations == 0) == reaches, f"{violations} of {8 * 3 * N} components leave"


def test_the_gain_is_no_larger_than_the_uncertainty_asks() -> None:
    """Twice the stated uncertainties must break the guarantee somewhere, or the gains would be needlessly high."""
    law = MrpSlidingMode(damping=0.0)
    moment = Moment(seed=20, rate=0.15)
    true_effective = np.array([0.0837, 0.0837, 0.01333])
    plant = Plant(inertia=np.diag(true_effective + WHEEL_INERTIA))
    inputs = moment.inputs(np.diag(0.6 * true_effective + WHEEL_INERTIA))
    s = sliding_variable(law, inputs.sigma_BR, inputs.omega_BR_B)
    plant.external = lambda t, state: 2e-4 * np.sign(s)
    torque, _ = law.torque(inputs, None)
    s_dot = moment.derivative(plant, torque, partial(sliding_variable, law))
    outside = np.abs(s) > law.layer
    assert (s * s_dot > -law.reaching_rate * np.abs(s))[outside].any()


@pytest.mark.parametrize("law", [MrpSlidingMode(), MrpFeedback()])
def test_equal_inputs_give_equal_bits_and_inputs_stay_untouched(law: Controller) -> None:
    inputs = Moment(seed=4).inputs(TILTED)
    copies = [np.copy(value) for value in inputs]
    first, _ = law.torque(inputs, None)
    second, memory = law.torque(inputs, None)
    assert isinstance(law, Controller)
    assert memory is None
    np.testing.assert_array_equal(first, second)
    for value, copy in zip(inputs, copies, strict=True):
        np.testing.assert_array_equal(value, copy)


def test_a_steadily_turning_body_on_its_reference_needs_only_the_gyroscopic_torque() -> None:
    inputs = Moment(seed=5).inputs(TILTED)
    omega = inputs.omega_BN_B
    zero = np.zeros((N, 3))
    on_track = inputs._replace(sigma_BR=zero, omega_BR_B=zero, omega_RN_B=omega, domega_RN_B=zero)
    expected = np.cross(omega, omega @ TILTED + inputs.wheel_momentum_B)
    for law in (MrpSlidingMode(), MrpFeedback()):
        np.testing.assert_allclose(law.torque(on_track, None)[0], expected, rtol=0, atol=1e-17)


@pytest.mark.parametrize("law", [MrpSlidingMode, MrpFeedback])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_gains_are_refused_by_name(law: type, value: float) -> None:
    key = "slope" if law is MrpSlidingMode else "frequency"
    with pytest.raises(ScenarioError, match=f"{law.name}: {key} = {value}.*above 0"):
        law(**{key: value})


def test_other_impossible_parameters_are_refused() -> None:
    for change in ({"rate_limit": 0.0}, {"damping": -0.1}, {"inertia_uncertainty": 1.0}, {"layer": 0.0}):
        with pytest.raises(ScenarioError, match=next(iter(change))):
            replace(MrpSlidingMode(), **change)


@pytest.mark.parametrize("law", [MrpSlidingMode(), MrpFeedback()])
def test_a_control_period_beyond_stability_is_refused(law: Controller) -> None:
    inputs = Moment(seed=6).inputs(TILTED)
    law.torque(inputs._replace(period=1.0), None)
    with pytest.raises(ScenarioError, match="control period of 30 s is too long"):
        law.torque(inputs._replace(period=30.0), None)


UNIFORM = np.diag([0.0837, 0.0837, 0.0133])


@pytest.mark.parametrize(
    "law", [MrpSlidingMode(), MrpSlidingMode(layer=0.013), MrpFeedback(frequency=0.67), MrpFeedback(frequency=160.0)]
)
def test_a_period_that_follows_the_message_is_accepted(law: Controller) -> None:
    inputs = Moment(seed=6).inputs(UNIFORM)
    with pytest.raises(ScenarioError, match="below") as refused:
        law.torque(inputs._replace(period=30.0), None)
    longest = float(str(refused.value).split("Shorten the period below ")[1].split(" s")[0])
    law.torque(inputs._replace(period=0.9999 * longest), None)
    with pytest.raises(ScenarioError):
        law.torque(inputs._replace(period=1.01 * longest), None)
