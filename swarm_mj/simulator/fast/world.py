"""Whether a flight can be flown by compiled code alone, and what that code is given of the flight's world."""

from __future__ import annotations

import numpy as np

from swarm_mj.errors import PluginError
from swarm_mj.plugins import failure_of, name_of, shown
from swarm_mj.simulator.fast.flights import World
from swarm_mj.simulator.faults.dispersions import unscaled
from swarm_mj.simulator.loop_state import LAW_SLOTS, LoopState, control_input
from swarm_mj.simulator.plugin_calls import ask_for_torque
from swarm_mj.smallbody.gravity.compiled import POLYHEDRON, compiled_field, knows
from swarm_mj.smallbody.gravity.polyhedron import CELL_NUMBERS
from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.spacecraft.control.compiled import CompiledController, CompiledLaw, address_of, numbers_of
from swarm_mj.typing import Array

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
    """What of forces and law the compiled loop does not know, in words; empty if it can fly them.

    Args:
        state: Of the flight.
        controller: The control law; None where torques are held.
    """
    gravity, _ = unscaled(state.environment.gravity)
    if controller is not None and law_of(controller) is None:
        return f"the control law {type(controller).__name__}"
    if not knows(gravity):
        return f"the gravity field {type(gravity).__name__}"
    return ""


def make_world(state: LoopState, controller: Controller | None, *, remembered: int = 0) -> World:
    """What compiled code needs to know of a flight for which `why_not_compiled` finds nothing.

    Args:
        state: Of the flight.
        controller: The control law; None where torques are held.
        remembered: Ticks for which flights of the same places share what gravity is there.

    Raises:
        ScenarioError: The control period is too long for the law.
        PluginError: The law cannot be compiled.
    """
    environment, properties = state.environment, state.properties
    field = compiled_field(unscaled(environment.gravity)[0])
    assert field is not None
    polyhedral = field.kind == POLYHEDRON
    inputs, law = state.inputs, law_of(controller)
    if controller is not None:
        ask_for_torque(controller, inputs, None)  # refuses a control period that is too long, whatever the state
    address = 0 if law is None else address_of(law)
    if controller is not None and law is not None:
        _compare(controller, law, inputs)
    return World(
        period=float(state.period),
        mass=float(properties.mass),
        hub=state.hub,
        inertia_B=inputs.inertia_B,
        inertia_effective_B=inputs.inertia_effective_B,
        phase0=float(environment.phase0),
        spin_rate=float(environment.spin_rate),
        spin_N=state.spin_N,
        C_PN=state.C_PN,
        q_P=state.q_P,
        earth_N=_writable(environment.earth.position),
        earth_velocity_N=_writable(environment.earth.velocity),
        sun_N=_writable(environment.sun.position),
        sun_velocity_N=_writable(environment.sun.velocity),
        sunlight=environment.sunlight,
        field=field,
        pulls=np.zeros((0 if polyhedral else remembered, state.model.n, 6)),
        cells=np.zeros((max(remembered, 1) if polyhedral else 1, state.model.n, CELL_NUMBERS)),
        frames=np.zeros((remembered, 23)),
        gradient_gm=float(state.gradient_gm),
        wheel_inertia=float(properties.wheel_spin_inertia),
        wheel_axes_B=state.wheel_axes_B,
        allocation=state.allocation,
        speed_gain=state.speed_gain,
        max_torque=float(properties.max_wheel_torque),
        max_speed=float(state.max_wheel_speed),
        law=address,
        law_numbers=np.empty(0) if law is None else numbers_of(law),
    )


def _writable(array: Array) -> Array:
    """A copy. Numba compiles apart what takes an array that is read-only."""
    return np.array(array, np.float64, order="C")


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
