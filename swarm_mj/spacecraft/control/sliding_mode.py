"""Sliding mode attitude tracking with reaction wheels, in Modified Rodrigues Parameters.

The sliding variable compares the rate error with the rate at which the attitude error shall be removed,

    s = omega_BR + m(sigma_BR),    m(sigma) = slope sigma / sqrt(1 + (slope |sigma| / rate_limit)^2),

and the torque drives every component of s into the boundary layer |s_i| <= layer no later than |s_i(0)| /
reaching_rate, whatever the inertia error and disturbance within the stated bounds, and holds it there:

    L = omega x (J omega + h_w) + J_eff (domega_RN - omega x omega_RN - dm/dt - v),
    v_i = kappa_i sat(s_i / layer) + damping s_i.

Inside the layer the law is linear, which keeps the sampled loop free of chatter. Derivation, proof and the reasons for
the gains: docs/theory/attitude_control.md. Sources: Kowalchuk & Hall, AIAA 2008-6260 (sliding mode with wheels); Slotine & Li,
Applied Nonlinear Control, chapter 7 (boundary layer, gain under uncertainty); Schaub & Junkins, chapters 3, 4 and 8.
"""

from dataclasses import dataclass
from functools import cached_property
from math import inf, sqrt
from typing import Any, ClassVar, NamedTuple

import numpy as np

from swarm_mj.compilation import jittable
from swarm_mj.errors import ScenarioError, at_most
from swarm_mj.spacecraft.attitude.algebra import (
    Vector,
    combine,
    cross,
    dot,
    matrix,
    put_vector,
    scaled,
    transformed,
    vector,
)
from swarm_mj.spacecraft.control.base import ControlInput, require_above
from swarm_mj.spacecraft.control.compiled import CompiledLaw, torque_by
from swarm_mj.typing import Array

#: A loop whose torque is held over a period is unstable when its rate gain times the period reaches this value.
_STABILITY_LIMIT = 2.0


class Gains(NamedTuple):
    """The parameters as compiled code takes them, in the order of `CompiledLaw.numbers`."""

    slope: float  #: of the manifold [1/s]
    rate_limit: float  #: largest slew rate on it [rad/s]; infinite: none
    reaching_rate: float  #: [rad/s^2]
    layer: float  #: half the width of the boundary layer [rad/s]
    damping: float  #: [1/s]
    disturbance: float  #: torque that is allowed for [N m]
    uncertainty: float  #: of the inertia, relative
    feed_forward: float  #: share of the reference acceleration that is fed to the wheels ahead of any error: 1 or 0


@dataclass(frozen=True, kw_only=True)
class MrpSlidingMode:
    """The sliding mode law; the defaults suit an 8 kg 3U CubeSat with wheels of 15 mN m s and 4 mN m.

    Attributes:
        slope: Rate commanded per unit of MRP near zero [rad/s]; small errors decay as exp(-slope t / 4).
        rate_limit: Largest slew rate commanded [rad/s], or None for no limit; keeps the wheels below their top speed.
        reaching_rate: Guaranteed approach of each component of s to its layer [rad/s^2] (eta).
        layer: Half-width of the boundary layer [rad/s] (phi).
        damping: Extra linear decay of s [1/s]; quickens the approach from afar without widening the layer.
        disturbance_torque: Largest external torque about each axis for which the guarantee holds [N m].
        inertia_uncertainty: Largest relative error of the principal moments of inertia given to the law, below 1.
        feed_forward: Whether the acceleration of the line of sight is commanded before it leaves an error.

    Raises:
        ScenarioError: A parameter is outside its range.
    """

    slope: float = 0.4
    rate_limit: float | None = 0.1
    reaching_rate: float = 4e-3
    layer: float = 0.02
    damping: float = 0.2
    disturbance_torque: float = 1e-4
    inertia_uncertainty: float = 0.2
    feed_forward: bool = True

    name: ClassVar[str] = "mrp_sliding_mode"

    def __post_init__(self) -> None:
        """Check the ranges of the parameters."""
        for key in ("slope", "reaching_rate", "layer"):
            require_above(self.name, key, getattr(self, key), 0.0)
        for key in ("damping", "disturbance_torque", "inertia_uncertainty"):
            require_above(self.name, key, getattr(self, key), 0.0, allow_low=True)
        if self.rate_limit is not None:
            require_above(self.name, "rate_limit", self.rate_limit, 0.0)
        if self.inertia_uncertainty >= 1.0:
            raise ScenarioError(
                f"{self.name}: inertia_uncertainty = {self.inertia_uncertainty} is not allowed; give a number below 1."
            )

    def torque(self, inputs: ControlInput, memory: Array | None) -> tuple[Array, Array | None]:
        """Return the torque on the bodies L_B [N m], shape (n, 3), and the memory unchanged: the law has none.

        Args:
            inputs: Errors, references and mass properties of n spacecraft.
            memory: Passed through.

        Raises:
            ScenarioError: The control period is too long for the boundary layer, so that the loop would oscillate.
        """
        gain = self._fastest_gain(inputs.inertia_effective_B)
        if gain * inputs.period >= _STABILITY_LIMIT:
            raise ScenarioError(
                f"{self.name}: a control period of {inputs.period:g} s is too long for layer = {self.layer:g} rad/s: "
                f"the loop, with a rate gain of {gain:.3g} 1/s, would oscillate. Shorten the period below "
                f"{at_most(_STABILITY_LIMIT / gain, 3)} s, widen the layer, or lower reaching_rate or disturbance_torque."
            )
        return torque_by(self.compiled(), inputs), memory

    def compiled(self) -> CompiledLaw:
        """See `CompiledController`."""
        return CompiledLaw(write_torque, self._numbers)

    @cached_property
    def _numbers(self) -> Array:
        """Parameters in the order of `Gains`, as compiled code takes them."""
        limit = inf if self.rate_limit is None else self.rate_limit
        layer, damping, disturbance = self.layer, self.damping, self.disturbance_torque
        ahead = float(self.feed_forward)
        return np.array(
            Gains(self.slope, limit, self.reaching_rate, layer, damping, disturbance, self.inertia_uncertainty, ahead)
        )

    def _fastest_gain(self, J_eff: Array) -> float:
        """Largest gain from rate to acceleration of an axis at rest in its layer [1/s]."""
        at_rest = _gain_at_rest(np.diagonal(J_eff, axis1=1, axis2=2), Gains(*self._numbers))
        decay = at_rest.max() / self.layer + self.damping + 0.25 * self.slope
        return float((1.0 + self.inertia_uncertainty) * decay)


def write_torque(
    sigma_BR: Array,
    omega_BR_B: Array,
    omega_BN_B: Array,
    omega_RN_B: Array,
    domega_RN_B: Array,
    wheel_momentum_B: Array,
    inertia_B: Array,
    inertia_effective_B: Array,
    numbers: Array,
    torque_B: Array,
) -> None:
    """Write the torques; see `CompiledLaw`."""
    gains = _gains_of(numbers)
    for i in range(sigma_BR.shape[0]):
        J, J_eff = matrix(inertia_B, i), matrix(inertia_effective_B, i)
        omega, error = vector(omega_BN_B, i), vector(omega_BR_B, i)
        slew, slew_dot = _slew(vector(sigma_BR, i), error, gains.slope, gains.rate_limit)
        turning = cross(omega, vector(omega_RN_B, i))
        on_manifold = combine(1.0, combine(gains.feed_forward, vector(domega_RN_B, i), -1.0, turning), -1.0, slew_dot)
        # The gyroscopic torque of an axis comes of what turns about the other two.
        gyroscopic_x = abs(omega[1] * omega[2]) * (J[1][1] + J[2][2])
        gyroscopic_y = abs(omega[2] * omega[0]) * (J[2][2] + J[0][0])
        gyroscopic_z = abs(omega[0] * omega[1]) * (J[0][0] + J[1][1])
        commanded = (
            _commanded(error[0] + slew[0], on_manifold[0], J_eff[0][0], gyroscopic_x, gains),
            _commanded(error[1] + slew[1], on_manifold[1], J_eff[1][1], gyroscopic_y, gains),
            _commanded(error[2] + slew[2], on_manifold[2], J_eff[2][2], gyroscopic_z, gains),
        )
        momentum = combine(1.0, transformed(J, omega), 1.0, vector(wheel_momentum_B, i))
        torque = combine(1.0, cross(omega, momentum), 1.0, transformed(J_eff, commanded))
        put_vector(torque_B, i, torque)


@jittable
def _gains_of(numbers: Array) -> Gains:
    return Gains(numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6], numbers[7])


@jittable
def _gain_at_rest(J_eff: Any, gains: Gains) -> Any:
    """Return the acceleration that drives s to its layer where nothing turns [rad/s^2], of a number or of an array of them."""
    uncertainty = gains.uncertainty
    return (gains.reaching_rate + (1.0 + uncertainty) * gains.disturbance / J_eff) / (1.0 - uncertainty)


@jittable
def _commanded(s: float, on_manifold: float, J_eff: float, gyroscopic: float, gains: Gains) -> float:
    """Return the acceleration that is commanded of an axis [rad/s^2]."""
    spoiled = _model_error(on_manifold, gyroscopic / J_eff, gains.uncertainty) / (1.0 - gains.uncertainty)
    saturation = min(1.0, max(-1.0, s / gains.layer))
    return on_manifold - (_gain_at_rest(J_eff, gains) + spoiled) * saturation - gains.damping * s


@jittable
def _slew(sigma: Vector, omega_BR: Vector, slope: float, rate_limit: float) -> tuple[Vector, Vector]:
    """Return m(sigma) = slope sigma / sqrt(1 + (slope |sigma| / rate_limit)^2) [rad/s] and dm/dt [rad/s^2]."""
    square, along = dot(sigma, sigma), dot(sigma, omega_BR)
    sigma_dot = combine(0.25 * (1.0 - square), omega_BR, 0.5, cross(sigma, omega_BR))
    sigma_dot = combine(1.0, sigma_dot, 0.5 * along, sigma)
    steepness = (slope / rate_limit) ** 2
    factor = slope / sqrt(1.0 + steepness * square)
    bend = factor * steepness * dot(sigma, sigma_dot) / (1.0 + steepness * square)
    return scaled(factor, sigma), combine(factor, sigma_dot, -bend, sigma)


@jittable
def _model_error(on_manifold: float, gyroscopic: float, uncertainty: float) -> float:
    """Return how much of the commanded acceleration of an axis a wrong inertia can spoil [rad/s^2].

    The gyroscopic torque of axis j is omega_k omega_l (J_l - J_k), and each true moment of inertia is at most
    1 / (1 - uncertainty) of the one given; dividing by the true J_eff costs at most a factor 1 + uncertainty.
    `gyroscopic` is |omega_k omega_l| (J_k + J_l) / J_eff [rad/s^2].
    """
    return uncertainty * (abs(on_manifold) + (1.0 + uncertainty) / (1.0 - uncertainty) * gyroscopic)
