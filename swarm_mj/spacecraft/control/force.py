"""What asks for forces: the protocol of force laws, whose wishes thrusters realise.

A force law is asked once every control period, and its wish is held until the next. It says what it would like; what the
thrusters make of that (their directions, limits, shortest pulses, an empty tank) is `swarm_mj.simulator.propulsion`'s affair.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from swarm_mj import plugins
from swarm_mj.errors import PluginError
from swarm_mj.typing import Array, Mask

#: What error messages call a force law.
ROLE = "force law"


class ForceView(NamedTuple):
    """What n spacecraft know when they are asked for a force; copies, which a law may keep.

    Attributes:
        t: Time past the epoch at the start of the control period [s].
        period: Time for which the force will be held [s].
        r_BN_N: Positions, shape (n, 3) [m].
        v_BN_N: Velocities, shape (n, 3) [m/s].
        q_BN: Attitudes as their flight software has them, shape (n, 4).
        mass: With what is left in the tank, shape (n,) [kg].
        propellant: Left in the tank, shape (n,) [kg].
        delta_v_N: Velocity gained by thrust so far, as accelerometers have it, shape (n, 3) [m/s].
        working: Who is not lost and has left the mothership, shape (n,).
    """

    t: float
    period: float
    r_BN_N: Array
    v_BN_N: Array
    q_BN: Array
    mass: Array
    propellant: Array
    delta_v_N: Array
    working: Mask


@runtime_checkable
class ForceLaw(Protocol):
    """Who asks for forces; memory goes in and comes out, so that the same flight always gives the same forces."""

    def forces(self, view: ForceView, memory: Any) -> tuple[Array, Any]:
        """Return the forces wished for the coming control period, and what the law must remember.

        Args:
            view: What the spacecraft know.
            memory: What the previous call returned; None at the first of a flight.

        Returns:
            Forces in N, shape (n, 3) [N], mean of the control period, and the new memory.
        """
        ...


@runtime_checkable
class AimingForceLaw(ForceLaw, Protocol):
    """A force law that also says ahead of time in which directions it will push, for thrusters that must be turned there."""

    def directions(self, t: float) -> Array:
        """Directions in N of the forces that are due or coming soon, shape (n, 3); zeros where there are none.

        Args:
            t: Time past the epoch [s].
        """
        ...


class SumOfForces:
    """Several force laws at once: their wishes are added, and each keeps its own memory.

    Args:
        laws: At least one.
    """

    def __init__(self, laws: Sequence[ForceLaw]) -> None:
        self.laws = tuple(laws)

    def forces(self, view: ForceView, memory: Any) -> tuple[Array, Any]:
        """The sum of all wishes, see `ForceLaw`."""
        memories = (None,) * len(self.laws) if memory is None else memory
        answers = [ask_for_forces(law, view, kept) for law, kept in zip(self.laws, memories, strict=True)]
        return np.sum([forces for forces, _ in answers], axis=0), tuple(kept for _, kept in answers)

    def directions(self, t: float) -> Array:
        """The direction of the first law that gives one; of each spacecraft by itself."""
        given = [law.directions(t) for law in self.laws if isinstance(law, AimingForceLaw)]
        chosen = np.zeros((1, 3))
        for rows in given:
            chosen = np.where((chosen != 0.0).any(axis=1, keepdims=True), chosen, rows)
        return chosen


def ask_for_forces(law: ForceLaw, view: ForceView, memory: Any) -> tuple[Array, Any]:
    """Ask a force law.

    Raises:
        PluginError: It fails, or answers something else than finite forces of shape (n, 3).
    """
    answer = plugins.call(law, ROLE, "forces", view, memory)
    try:
        given, memory = answer
    except (TypeError, ValueError):
        raise PluginError(
            f"the {ROLE} {plugins.name_of(law)} answers {plugins.shown(answer)}: forces must return (forces_N, memory)"
        ) from None
    what = f"the {ROLE} {{}} answers a force that"
    forces = plugins.as_array(given, view.r_BN_N.shape, np.float64, law, what)
    if not np.isfinite(forces).all():
        raise PluginError(
            f"the {ROLE} {plugins.name_of(law)} asks at t = {view.t:g} s for a force that is not finite: must be numbers [N]"
        )
    return forces, memory
