"""What a control law is given and what it returns: the protocol of all controllers.

A controller commands the torque L that the reaction wheels exert on the body. The plant it acts on is a gyrostat,

    J_eff domega/dt = -omega x (J omega + h_w) + L + L_ext,

with omega = omega_BN_B, J the inertia of hub and locked wheels, J_eff = J - sum J_s a a^T over the wheels of axial
inertia J_s and axis a, and h_w = sum J_s Omega a their momentum relative to the body (Schaub & Junkins, section 4.5).
The simulation maps L to motor torques, u = -A^+ L, clips these at the motors' limits and holds them for one period.
"""

from math import isfinite
from typing import NamedTuple, Protocol, runtime_checkable

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array


class ControlInput(NamedTuple):
    """What n spacecraft know when they compute their torques; all components in B. Inertias are not to be changed.

    Attributes:
        sigma_BR: Attitude error, MRP with |sigma| <= 1, shape (n, 3).
        omega_BR_B: Rate error [rad/s], shape (n, 3).
        omega_BN_B: Body rate [rad/s], shape (n, 3).
        omega_RN_B: Reference rate [rad/s], shape (n, 3).
        domega_RN_B: Inertial derivative of the reference rate [rad/s^2], shape (n, 3).
        wheel_momentum_B: Momentum of the wheels relative to the body, sum J_s Omega a [kg m^2/s], shape (n, 3).
        inertia_B: Inertia of hub and locked wheels about the centre of mass [kg m^2], shape (n, 3, 3).
        inertia_effective_B: The same less the wheels' axial inertia, J - sum J_s a a^T [kg m^2], shape (n, 3, 3).
        period: Time for which the torque will be held [s].
    """

    sigma_BR: Array
    omega_BR_B: Array
    omega_BN_B: Array
    omega_RN_B: Array
    domega_RN_B: Array
    wheel_momentum_B: Array
    inertia_B: Array
    inertia_effective_B: Array
    period: float


@runtime_checkable
class Controller(Protocol):
    """A control law; state goes in and comes out, so that the same inputs always give the same torques."""

    def torque(self, inputs: ControlInput, memory: Array | None) -> tuple[Array, Array | None]:
        """Return the torque on the bodies and what the law must remember.

        Args:
            inputs: Errors, references and mass properties of n spacecraft.
            memory: What the previous call returned; None at the first.

        Returns:
            Torque that the wheels shall exert on the bodies, L_B [N m], shape (n, 3), and the new memory.
        """
        ...


def require_above(law: str, key: str, value: float, low: float, *, allow_low: bool = False) -> None:
    """Check a parameter of a control law.

    Args:
        law: Name of the control law, for the message.
        key: Name of the parameter.
        value: Its value.
        low: Lower bound.
        allow_low: Whether the bound itself is allowed.

    Raises:
        ScenarioError: The value is not a finite number above the bound.
    """
    if not (isfinite(value) and (value > low or (allow_low and value == low))):
        raise ScenarioError(
            f"{law}: {key} = {value} is not allowed; give a number {'of at least' if allow_low else 'above'} {low:g}."
        )
