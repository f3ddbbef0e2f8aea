"""What the flights of a swarm share, and what compiled code is given of it: constants, gravity field, control law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarm_mj.errors import PluginError
from swarm_mj.plugins import failure_of, name_of, shown
from swarm_mj.simulator.faults.dispersions import unscaled
from swarm_mj.simulator.faults.schedule import FaultModel
from swarm_mj.simulator.flights import World
from swarm_mj.simulator.mujoco import timesteps_in
from swarm_mj.simulator.plugin_calls import ask_for_torque
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.gravity.compiled import POLYHEDRON, compiled_field
from swarm_mj.smallbody.gravity.point_mass import PointMass
from swarm_mj.smallbody.gravity.polyhedron import CELL_NUMBERS
from swarm_mj.spacecraft.attitude.guidance import PLAIN, Aiming
from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.spacecraft.control.compiled import CompiledController, CompiledLaw, LawFunction, compile_law, numbers_of
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array

#: The wheel-speed limiter aims this far below the limit, for what the gyroscopic terms add within a hold.
SPEED_MARGIN = 1e-4
#: Spacecraft for which a compiled law is compared with what it stands for.
MOST_COMPARED = 8


@dataclass(frozen=True, kw_only=True)
class FlightSetup:
    """What all flights of a batch have in common, but for behaviours and laws."""

    model: SwarmModel  #: the compiled swarm
    environment: Environment  #: gravity, rotation, Sun and Earth
    period: float = 0.5  #: how long torques and forces are held [s]; a whole multiple of the model's timestep
    gravity_gradient: bool = False  #: whether the torque of the central field acts; the field must know its `gm`
    fault_model: FaultModel | None = None  #: what may go wrong; None: nothing, all is as planned
    #: whether turns to new targets go by the minimum-time profile, see `Slews`, and not by the law's gains
    minimum_time_slews: bool = False
    aiming: Aiming = PLAIN  #: how spacecraft are turned to their lines of sight

    @property
    def properties(self) -> SpacecraftProperties:
        """Mass properties and wheel limits of every spacecraft, as planned."""
        return self.model.properties

    @property
    def gradient_gm(self) -> float:
        """Gravitational parameter whose gradient turns the spacecraft [m^3/s^2]; 0: none does.

        Raises:
            PluginError: The field does not know its gravitational parameter, and the gradient needs it.
        """
        gm = getattr(self.environment.gravity, "gm", None) if self.gravity_gradient else 0.0
        if gm is None:
            raise PluginError("the gravity-gradient torque needs a gravity field with an attribute gm [m^3/s^2]")
        return float(gm)


def make_world(setup: FlightSetup, environment: Environment, remembered: int) -> World:
    """The world of flights in which nothing is asked of Python and torques are held.

    Args:
        setup: What the flights share.
        environment: Gravity, rotation, Sun and Earth.
        remembered: Ticks for which flights of the same places share cells of a polyhedron.

    Raises:
        ScenarioError: The control period is no whole multiple of the timestep.
    """
    properties, n, period = setup.properties, setup.model.n, setup.period
    timestep = float(setup.model.mjmodel.opt.timestep)
    # A field in Python is asked in every period, and what stands here in its place never.
    field = compiled_field(unscaled(environment.gravity)[0]) or compiled_field(PointMass(1.0))
    assert field is not None
    gain = 1.0 / properties.wheel_spin_inertia + (1.0 / np.diag(properties.inertia_effective_B)).max()
    return World(
        period=float(period),
        timestep=timestep,
        timesteps=timesteps_in(period, timestep),
        inertia_B=np.repeat(properties.inertia_B[None], n, axis=0),
        inertia_effective_B=np.repeat(properties.inertia_effective_B[None], n, axis=0),
        phase0=float(environment.phase0),
        spin_rate=float(environment.spin_rate),
        spin_N=_writable(environment.spin_N),
        C_PN=_writable(environment.C_PN),
        earth_N=_writable(environment.earth.position),
        earth_velocity_N=_writable(environment.earth.velocity),
        sun_N=_writable(environment.sun.position),
        sun_velocity_N=_writable(environment.sun.velocity),
        sunlight=environment.sunlight,
        field=field,
        cells=np.zeros((max(remembered, 1) if field.kind == POLYHEDRON else 1, n, CELL_NUMBERS)),
        # Bodies of one's own are turned one by one, by MuJoCo's stepper.
        gradient_gm=setup.gradient_gm if setup.model.own is None else 0.0,
        wheel_inertia=float(properties.wheel_spin_inertia),
        wheel_axes_B=_writable(properties.wheel_axes_B),
        allocation=_writable(np.negative(np.linalg.pinv(properties.wheel_axes_B.T), dtype=np.float64)),
        speed_gain=float(period * gain),
        max_torque=float(properties.max_wheel_torque),
        max_speed=float((1.0 - SPEED_MARGIN) * properties.max_wheel_speed),
        asks=0,
        law_numbers=np.zeros(0),
        aiming=setup.aiming,
    )


def gravity_is_compiled(environment: Environment) -> bool:
    """Whether kernels know the gravity field, and it is the only one."""
    return environment.companion is None and compiled_field(unscaled(environment.gravity)[0]) is not None


def compiled_law_of(controller: Controller, world: World) -> tuple[LawFunction, Array] | None:
    """The C function of a controller's law and its numbers; None where it has none.

    Raises:
        ScenarioError: The control period is too long for the law.
        PluginError: The law cannot be compiled, or gives something else than the controller.
    """
    at_rest = ControlInput._make(
        (*np.zeros((6, *world.inertia_B.shape[:2])), world.inertia_B, world.inertia_effective_B, world.period)
    )
    ask_for_torque(controller, at_rest, None)  # refuses a control period that is too long, whatever the state
    law = controller.compiled() if isinstance(controller, CompiledController) else None
    if law is None:
        return None
    if not (isinstance(law, CompiledLaw) and callable(law.write_torque)):
        raise PluginError(
            f"the control law {name_of(controller)}: compiled must return a CompiledLaw or None, not {shown(law)}"
        )
    _compare(controller, law, at_rest)
    return compile_law(law.write_torque), numbers_of(law)


def _writable(array: Array) -> Array:
    """A copy. Numba compiles apart what takes an array that is read-only."""
    return np.array(array, np.float64, order="C")


def _compare(controller: Controller, law: CompiledLaw, like: ControlInput) -> None:
    """Try a compiled law on made-up errors, in Python, where it is seen to fail and to look beyond an array's end.

    Raises:
        PluginError: It fails, or gives other torques than `Controller.torque`.
    """
    n = min(len(like.sigma_BR), MOST_COMPARED)
    made_up = 0.01 * np.random.default_rng(0).standard_normal((6, n, 3))
    inputs = ControlInput._make((*made_up, like.inertia_B[:n], like.inertia_effective_B[:n], like.period))
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
