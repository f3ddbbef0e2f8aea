"""A scenario in flight: MuJoCo's own objects, step by step, and the live viewer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from swarm_mj.api.scenario import load
from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import NO_OVERRIDES, ScenarioSource
from swarm_mj.simulator.simulation import Simulation


def simulation(
    scenario: ScenarioSource, overrides: Mapping[str, Any] = NO_OVERRIDES, *, geometry: bool = False
) -> Simulation:
    """The simulation of a scenario at its start, to be stepped by hand.

    `sim.step()` decides and integrates one control period; `sim.data` and `sim.model.mjmodel` are MuJoCo's MjData and MjModel,
    live; `sim.time` is the time of the flight [s].

    Args:
        scenario: What to fly, as `load` takes it.
        overrides: Values by dotted key that change it.
        geometry: Whether the model holds shapes, cameras and light as well, for MuJoCo's own viewers and renderer.

    Raises:
        SwarmError: The scenario cannot be flown.
    """
    return make_simulation(make_plan(load(scenario, overrides)), geometry=geometry)


def view(scenario: ScenarioSource, overrides: Mapping[str, Any] = NO_OVERRIDES, *, speed: float = 10.0) -> None:
    """Fly a scenario in MuJoCo's viewer until its window is closed; needs a display.

    Args:
        scenario: What to fly, as `load` takes it.
        overrides: Values by dotted key that change it.
        speed: Seconds of flight per second at the start.

    Raises:
        SwarmError: The scenario cannot be flown, no window can be opened, or the speed is out of range.
    """
    from swarm_mj.rendering.viewer import run_view

    run_view(load(scenario, overrides), speed=speed)
