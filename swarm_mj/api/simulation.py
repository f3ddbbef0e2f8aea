"""A scenario in flight: MuJoCo's own objects, step by step, and the live viewer."""

from __future__ import annotations

from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios import schema
from swarm_mj.simulator.simulation import Simulation


def simulation(scenario: schema.Scenario, *, geometry: bool = False) -> Simulation:
    """The simulation of a scenario at its start, to be stepped by hand.

    `sim.step()` decides and integrates one control period; `sim.data` and `sim.model.mjmodel` are MuJoCo's MjData and MjModel,
    live; `sim.time` is the time of the flight [s].

    Args:
        scenario: What to fly, see `load`.
        geometry: Whether the model holds shapes, cameras and light as well, for MuJoCo's own viewers and renderer.

    Raises:
        SwarmError: The scenario cannot be flown.
    """
    return make_simulation(make_plan(scenario), geometry=geometry)


def view(
    scenario: schema.Scenario, *, speed: float = 10.0, web: bool = False, port: int = 0, host: str | None = None
) -> None:
    """Fly a scenario in MuJoCo's viewer until that is closed, or in the browser where there is no display.

    Args:
        scenario: What to fly.
        speed: Seconds of flight per second at the start.
        web: Use the browser even where there is a display; so does a port or a host.
        port: Of the browser's page; 0: the first free one from 8080.
        host: Address that the page is served on; None: 127.0.0.1, for this machine alone.

    Raises:
        SwarmError: The scenario cannot be flown, no viewer can be opened, or speed or port are out of range.
    """
    from swarm_mj.rendering.viewer import run_view

    run_view(scenario, speed=speed, web=web, port=port, host=host)
