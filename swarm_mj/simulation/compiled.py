"""Whether a flight can be flown by compiled code alone, and what that code is given of the flight's world."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarm_mj.attitude.controllers.base import ControlInput, Controller
from swarm_mj.attitude.controllers.compiled import CompiledController, CompiledLaw, address_of, numbers_of
from swarm_mj.simulation.flight_kernels import Number, World
from swarm_mj.simulation.kernels import Slot
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics
from swarm_mj.spacecraft.properties import SpacecraftProperties

if TYPE_CHECKING:
    from swarm_mj.simulation.simulation import Simulation

Array = NDArray[np.float64]

#: The wheel-speed limiter aims this far below the limit, for what the gyroscopic terms add within a hold.
SPEED_MARGIN = 1e-4


def control_inputs(work: Array, properties: SpacecraftProperties, period: float) -> ControlInput:
    """What control laws are given, as views of the loop's work array, see `Slot`."""
    n = work.shape[1]
    return ControlInput(
        sigma_BR=work[Slot.SIGMA_BR],
        omega_BR_B=work[Slot.OMEGA_BR],
        omega_BN_B=work[Slot.OMEGA],
        omega_RN_B=work[Slot.OMEGA_R_B],
        domega_RN_B=work[Slot.DOMEGA_R_B],
        wheel_momentum_B=work[Slot.MOMENTUM],
        inertia_B=np.repeat(properties.inertia_B[None], n, axis=0),
        inertia_effective_B=np.repeat(properties.inertia_effective_B[None], n, axis=0),
        period=period,
    )


def law_of(controller: Controller | None) -> CompiledLaw | None:
    """The compiled law of a controller; None where it has none."""
    return controller.compiled() if isinstance(controller, CompiledController) else None


def why_not_compiled(simulation: Simulation, controller: Controller | None) -> str:
    """What of a simulation the compiled flight does not know, in words; empty if it can fly it.

    Args:
        simulation: One flight, as it would fly alone.
        controller: The control law; None where torques are held.
    """
    if simulation._adverse is not None:
        return "faults, dispersions or a fourth wheel"
    if controller is not None and law_of(controller) is None:
        return f"the control law {type(controller).__name__}"
    if type(simulation.environment.gravity) is not SphericalHarmonics:
        return f"the gravity field {type(simulation.environment.gravity).__name__}"
    if simulation.environment.perturbed or simulation._gradient_gm > 0.0:
        return "perturbations"
    return ""


def make_world(simulation: Simulation, controller: Controller | None) -> World:
    """What compiled code needs to know of a simulation for which `why_not_compiled` finds nothing.

    Raises:
        ScenarioError: The control period is too long for the law.
        PluginError: The law cannot be compiled.
    """
    environment, properties, gravity = simulation.environment, simulation.properties, simulation.environment.gravity
    assert isinstance(gravity, SphericalHarmonics)
    inputs, law = simulation._inputs, law_of(controller)
    if controller is not None:
        controller.torque(inputs, None)  # refuses a control period that is too long, whatever the state
    numbers = np.zeros(int(Number.LAW))
    numbers[Number.PHASE0], numbers[Number.SPIN_RATE] = environment.phase0, environment.spin_rate
    numbers[Number.PERIOD], numbers[Number.MASS] = simulation.period, properties.mass
    numbers[Number.WHEEL_INERTIA], numbers[Number.SPEED_GAIN] = properties.wheel_spin_inertia, simulation._speed_gain
    numbers[Number.MAX_TORQUE] = properties.max_wheel_torque
    numbers[Number.MAX_SPEED] = (1.0 - SPEED_MARGIN) * properties.max_wheel_speed
    numbers[Number.RADIUS] = gravity.reference_radius
    numbers[Number.Q_P : Number.Q_P + 4] = simulation._q_P
    moving = [environment.spin_N, environment.earth.position, environment.earth.velocity]
    return World(
        law=0 if law is None else address_of(law),
        hub=np.ascontiguousarray(simulation.model.hub_body, np.int64),
        numbers=numbers if law is None else np.append(numbers, numbers_of(law)),
        frames=np.array([environment.C_PN, properties.wheel_axes_B, simulation._allocation, moving], np.float64),
        inertia=np.array([inputs.inertia_B, inputs.inertia_effective_B]),
        table=gravity._table,
        series=gravity._acceleration_series,
    )
