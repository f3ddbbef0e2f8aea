"""Flights of the program's own simulation that the checks look at."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from swarm_mj.flight.environment import environment_from
from swarm_mj.mission.behaviors import SwarmView, Targets
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.simulation import FlightSamples, Simulation
from swarm_mj.simulator.state import InitialState
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_harmonics import load_eros
from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.spacecraft.model import Stepper, build_model
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array
from swarm_mj.verification.experiment import Bench
from swarm_mj.verification.reference import Gyrostat


class NoTorque:
    """A control law that never acts."""

    def torque(self, inputs: ControlInput, memory: Array | None) -> tuple[Array, Array | None]:
        """Zero torque."""
        return np.zeros_like(inputs.sigma_BR), memory


class WatchBody:
    """A behaviour in which everybody looks at the body's centre."""

    dedicated_communications: ClassVar[bool] = False

    def targets(self, view: SwarmView, memory: None) -> tuple[Targets, None]:
        """The body's centre for all."""
        n = len(view.r_BN_N)
        return Targets(np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros((n, 3))), None


def rotational_state(flight: FlightSamples, sample: int, spacecraft: int) -> Array:
    """State of `Gyrostat.rates`, shape (10,)."""
    return np.concatenate([flight.samples[key][sample, spacecraft] for key in ("q_BN", "omega_BN_B", "wheel_speed")])


def environment(bench: Bench) -> Environment:
    """Eros at the epoch of the packaged scenarios, with its field of degree 2."""
    return environment_from(load_scenario("eros-quick"), load_eros())


def ball(radius: float, frequency: int) -> ShapeModel:
    """A geodesic sphere of 20 frequency^2 faces [m]."""
    directions, faces = geodesic_icosahedron(frequency)
    return ShapeModel(radius * directions, faces.astype(np.int32), "sphere")


def gyrostat() -> Gyrostat:
    """The 8 kg 3U CubeSat."""
    properties = SpacecraftProperties()
    return Gyrostat(inertia=properties.inertia_B, wheel_inertia=properties.wheel_spin_inertia)


def fly(
    bench: Bench,
    initial: InitialState,
    duration: float,
    interval: float,
    *,
    timestep: float = 0.1,
    period: float = 0.5,
    controller: Controller | None = None,
    stepper: Stepper = "mujoco",
) -> FlightSamples:
    """Fly default CubeSats about Eros, with control and forces once a period; times in s, without a controller no torque."""
    # What is drawn plays no part in the flight, so that a coarse mesh does.
    model = build_model(len(initial.r_BN_N), shape=ball(16e3, 2), timestep=timestep, stepper=stepper)
    simulation = Simulation(
        FlightSetup(model=model, environment=bench.once(environment), period=period),
        WatchBody(),
        controller or NoTorque(),
    )
    simulation.reset(initial)
    return simulation.run(duration, interval)
