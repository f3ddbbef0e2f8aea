"""Whether a flight can be flown by compiled code alone, and what that code is given of the flight's world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from swarm_mj.errors import PluginError
from swarm_mj.plugins import failure_of, name_of, shown
from swarm_mj.simulator.fast.flight_kernels import Number, World
from swarm_mj.simulator.fast.kernels import Slot
from swarm_mj.simulator.plugin_calls import ask_for_torque
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics
from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.spacecraft.control.compiled import CompiledController, CompiledLaw, address_of, numbers_of
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array

if TYPE_CHECKING:
    from swarm_mj.simulator.simulation import Simulation


#: Spacecraft for which a compiled law is compared with what it stands for.
MOST_COMPARED = 8
#: The wheel-speed limiter aims this far below the limit, for what the gyroscopic terms add within a hold.
SPEED_MARGIN = 1e-4


#: What a control law is given of the loop's work array, in the order of `ControlInput`.
LAW_SLOTS = [Slot.SIGMA_BR, Slot.OMEGA_BR, Slot.OMEGA, Slot.OMEGA_R_B, Slot.DOMEGA_R_B, Slot.MOMENTUM]


def control_inputs(work: Array, properties: SpacecraftProperties, period: float) -> ControlInput:
    """What control laws are given, as views of the loop's work array, see `Slot`."""
    n = work.shape[1]
    inertia_B = np.repeat(properties.inertia_B[None], n, axis=0)
    inertia_effective_B = np.repeat(properties.inertia_effective_B[None], n, axis=0)
    return inputs_from([work[slot] for slot in LAW_SLOTS], inertia_B, inertia_effective_B, period)


def inputs_from(
    vectors: Sequence[Array] | Array, inertia_B: Array, inertia_effective_B: Array, period: float
) -> ControlInput:
    """What control laws are given, from vectors in the order of `LAW_SLOTS`, shape (6, n, 3)."""
    sigma_BR, omega_BR, omega, omega_R, domega_R, momentum = vectors
    return ControlInput(sigma_BR, omega_BR, omega, omega_R, domega_R, momentum, inertia_B, inertia_effective_B, period)


def law_of(controller: Controller | None) -> CompiledLaw | None:
    """The compiled law of a controller; None where it has none."""
    if not isinstance(controller, CompiledController):
        return None
    law = controller.compiled()
    if law is not None and not (isinstance(law, CompiledLaw) and callable(law.write_torque)):
        raise PluginError(
            f"the control law {name_of(controller)}: compiled must return a CompiledLaw or None, not {shown(law)}"
        )
    return law


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
        ask_for_torque(controller, inputs, None)  # refuses a control period that is too long, whatever the state
    address = 0 if law is None else address_of(law)
    if controller is not None and law is not None:
        _compare(controller, law, inputs)
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
        law=address,
        hub=np.ascontiguousarray(simulation.model.hub_body, np.int64),
        numbers=numbers if law is None else np.append(numbers, numbers_of(law)),
        frames=np.array([environment.C_PN, properties.wheel_axes_B, simulation._allocation, moving], np.float64),
        inertia=np.array([inputs.inertia_B, inputs.inertia_effective_B]),
        table=gravity._table,
        series=gravity._acceleration_series,
    )


def _compare(controller: Controller, law: CompiledLaw, like: ControlInput) -> None:
    """Try a compiled law on made-up errors, in Python, where it is seen to fail and to look beyond an array's end.

    Raises:
        PluginError: It fails, or gives other torques than `Controller.torque`.
    """
    n = min(len(like.sigma_BR), MOST_COMPARED)
    made_up = 0.01 * np.random.default_rng(0).standard_normal((len(LAW_SLOTS), n, 3))
    inputs = inputs_from(made_up, like.inertia_B[:n], like.inertia_effective_B[:n], like.period)
    expected, _ = ask_for_torque(controller, inputs, None)
    found = np.full((n, 3), np.nan)
    try:
        getattr(law.write_torque, "py_func", law.write_torque)(*inputs[:8], numbers_of(law), found)
    except Exception as error:
        raise failure_of(controller, "control law", "CompiledLaw.write_torque", error) from error
    if not np.allclose(found, expected, rtol=1e-6, atol=1e-12):
        j = int(np.argmax(~np.isclose(found, expected, rtol=1e-6, atol=1e-12).all(axis=1)))
        raise PluginError(
            f"the control law {name_of(controller)}: its CompiledLaw gives the torque {found[j].tolist()} N m where torque "
            f"gives {expected[j].tolist()}"
        )
