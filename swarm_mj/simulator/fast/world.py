"""Whether a flight can be flown by compiled code alone, and what that code is given of the flight's world."""

from __future__ import annotations

import numpy as np

from swarm_mj.errors import PluginError
from swarm_mj.plugins import failure_of, name_of, shown
from swarm_mj.simulator.fast.flight_kernels import Number, World
from swarm_mj.simulator.loop_state import LAW_SLOTS, LoopState, control_input
from swarm_mj.simulator.plugin_calls import ask_for_torque
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics
from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.spacecraft.control.compiled import CompiledController, CompiledLaw, address_of, numbers_of

#: Spacecraft for which a compiled law is compared with what it stands for.
MOST_COMPARED = 8


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


def why_not_compiled(state: LoopState, controller: Controller | None) -> str:
    """What of a flight without faults the compiled loop does not know, in words; empty if it can fly it.

    Args:
        state: Of the flight.
        controller: The control law; None where torques are held.
    """
    gravity = state.environment.gravity
    if controller is not None and law_of(controller) is None:
        return f"the control law {type(controller).__name__}"
    if type(gravity) is not SphericalHarmonics:
        return f"the gravity field {type(gravity).__name__}"
    if state.environment.perturbed or state.gradient_gm > 0.0:
        return "perturbations"
    return ""


def make_world(state: LoopState, controller: Controller | None) -> World:
    """What compiled code needs to know of a flight for which `why_not_compiled` finds nothing.

    Raises:
        ScenarioError: The control period is too long for the law.
        PluginError: The law cannot be compiled.
    """
    environment, properties, gravity = state.environment, state.properties, state.environment.gravity
    assert isinstance(gravity, SphericalHarmonics)
    inputs, law = state.inputs, law_of(controller)
    if controller is not None:
        ask_for_torque(controller, inputs, None)  # refuses a control period that is too long, whatever the state
    address = 0 if law is None else address_of(law)
    if controller is not None and law is not None:
        _compare(controller, law, inputs)
    numbers = np.zeros(int(Number.LAW))
    numbers[Number.PHASE0], numbers[Number.SPIN_RATE] = environment.phase0, environment.spin_rate
    numbers[Number.PERIOD], numbers[Number.MASS] = state.period, properties.mass
    numbers[Number.WHEEL_INERTIA], numbers[Number.SPEED_GAIN] = properties.wheel_spin_inertia, state.speed_gain
    numbers[Number.MAX_TORQUE] = properties.max_wheel_torque
    numbers[Number.MAX_SPEED] = state.max_wheel_speed
    numbers[Number.RADIUS] = gravity.reference_radius
    numbers[Number.Q_P : Number.Q_P + 4] = state.q_P
    moving = [environment.spin_N, environment.earth.position, environment.earth.velocity]
    return World(
        law=address,
        hub=state.hub,
        numbers=numbers if law is None else np.append(numbers, numbers_of(law)),
        frames=np.array([environment.C_PN, properties.wheel_axes_B, state.allocation, moving], np.float64),
        inertia=np.array([inputs.inertia_B, inputs.inertia_effective_B]),
        table=gravity.recursion,
        series=gravity.acceleration_series,
    )


def _compare(controller: Controller, law: CompiledLaw, like: ControlInput) -> None:
    """Try a compiled law on made-up errors, in Python, where it is seen to fail and to look beyond an array's end.

    Raises:
        PluginError: It fails, or gives other torques than `Controller.torque`.
    """
    n = min(len(like.sigma_BR), MOST_COMPARED)
    made_up = 0.01 * np.random.default_rng(0).standard_normal((len(LAW_SLOTS), n, 3))
    inputs = control_input(made_up, like.inertia_B[:n], like.inertia_effective_B[:n], like.period)
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
