"""MRP feedback with reaction wheels: the linear attitude law with full feed-forward.

The torque cancels the gyroscopic terms, follows the reference acceleration and adds a linear restoring acceleration,

    L = omega x (J omega + h_w) + J_eff (domega_RN - omega x omega_RN - K sigma_BR - P omega_BR - P K_i z),
    z = K int sigma_BR dt + omega_BR,

so that d omega_BR / dt = -K sigma_BR - P omega_BR without the integral and V = |omega_BR|^2 / 2 + 2 K ln(1 + sigma^2)
falls as dV/dt = -P |omega_BR|^2. The gains are accelerations, the same for every axis, given by the natural frequency
and damping ratio of small errors (sigma = angle / 4): K = 4 frequency^2, P = 2 damping_ratio frequency.
Source: Schaub & Junkins, Analytical Mechanics of Space Systems, sections 8.4 and 8.5.1, there with scalar torque gains.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from swarm_mj.errors import ScenarioError, at_most
from swarm_mj.spacecraft.attitude.algebra import combine, cross, put_vector, times, vector
from swarm_mj.spacecraft.control.base import ControlInput, require_above
from swarm_mj.spacecraft.control.compiled import CompiledLaw, torque_by
from swarm_mj.typing import Array


@dataclass(frozen=True, kw_only=True)
class MrpFeedback:
    """The feedback law; the defaults suit an 8 kg 3U CubeSat with wheels of 15 mN m s and 4 mN m.

    Attributes:
        frequency: Natural frequency of small attitude errors [rad/s].
        damping_ratio: Their damping ratio; 1 is critical.
        integral_gain: Gain on the integral term z [1/s]; 0 switches it off. It removes the error that a constant
            disturbance leaves, at the price of overshoot after large slews.
        feed_forward: Whether the acceleration of the line of sight is commanded before it leaves an error.

    Raises:
        ScenarioError: A parameter is outside its range.
    """

    frequency: float = 0.1
    damping_ratio: float = 1.0
    integral_gain: float = 0.0
    feed_forward: bool = True

    name: ClassVar[str] = "mrp_feedback"

    def __post_init__(self) -> None:
        """Check the ranges of the parameters."""
        require_above(self.name, "frequency", self.frequency, 0.0)
        require_above(self.name, "damping_ratio", self.damping_ratio, 0.0)
        require_above(self.name, "integral_gain", self.integral_gain, 0.0, allow_low=True)

    @property
    def attitude_gain(self) -> float:
        """K [rad/s^2]: restoring acceleration per unit of MRP."""
        return 4.0 * self.frequency**2

    @property
    def rate_gain(self) -> float:
        """P [1/s]: damping acceleration per unit of rate."""
        return 2.0 * self.damping_ratio * self.frequency

    @property
    def longest_period(self) -> float:
        """Control period at which the loop with held torque becomes unstable [s], the integral term being off."""
        return min(1.0 / self.damping_ratio, 4.0 * self.damping_ratio) / self.frequency

    def torque(self, inputs: ControlInput, memory: Array | None) -> tuple[Array, Array | None]:
        """Return the torque on the bodies and the integral of the attitude error.

        Args:
            inputs: Errors, references and mass properties of n spacecraft.
            memory: Integral of sigma_BR so far [s], shape (n, 3), or None for zero.

        Returns:
            L_B [N m], shape (n, 3), and the integral including this period; None where the integral term is off.

        Raises:
            ScenarioError: The control period is too long for the gains, so that the loop would oscillate.
        """
        if inputs.period >= self.longest_period:
            raise ScenarioError(
                f"{self.name}: a control period of {inputs.period:g} s is too long for frequency = {self.frequency:g} "
                f"rad/s and damping_ratio = {self.damping_ratio:g}: the loop would oscillate. Shorten the period below "
                f"{at_most(self.longest_period, 3)} s or lower the frequency."
            )
        torque_B = torque_by(CompiledLaw(write_torque, self._numbers), inputs)
        if self.integral_gain == 0.0:
            return torque_B, None
        integral = inputs.period * inputs.sigma_BR + (0.0 if memory is None else memory)
        z = self.attitude_gain * integral + inputs.omega_BR_B
        torque_B -= self.rate_gain * self.integral_gain * (inputs.inertia_effective_B @ z[..., None])[..., 0]
        return torque_B, integral

    def compiled(self) -> CompiledLaw | None:
        """See `CompiledController`; None with the integral term, which needs memory."""
        return CompiledLaw(write_torque, self._numbers) if self.integral_gain == 0.0 else None

    @cached_property
    def _numbers(self) -> Array:
        """Gains in the order in which compiled code takes them."""
        return np.array((self.attitude_gain, self.rate_gain, float(self.feed_forward)))


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
    """Write the torques without the integral term; see `CompiledLaw`."""
    attitude_gain, rate_gain, ahead = numbers[0], numbers[1], numbers[2]
    for i in range(sigma_BR.shape[0]):
        omega, error = vector(omega_BN_B, i), vector(omega_BR_B, i)
        restoring = combine(-attitude_gain, vector(sigma_BR, i), -rate_gain, error)
        following = combine(ahead, vector(domega_RN_B, i), -1.0, cross(omega, vector(omega_RN_B, i)))
        inertial = times(inertia_effective_B[i], combine(1.0, following, 1.0, restoring))
        momentum = combine(1.0, times(inertia_B[i], omega), 1.0, vector(wheel_momentum_B, i))
        put_vector(torque_B, i, combine(1.0, cross(omega, momentum), 1.0, inertial))
