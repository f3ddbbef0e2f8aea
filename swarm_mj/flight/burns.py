"""Planned burns held against the tank and the time, and who flies them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarm_mj.errors import PathError, ScenarioError
from swarm_mj.mission.trajectories import Deployment, PlannedBurn
from swarm_mj.simulator.planned_burns import PlannedBurns
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array

#: Why a plan with burns cannot be flown, in a few words.
BEYOND_THE_TANK = "beyond the tank"
_REMEDY = "raise spacecraft.thrusters.propellant_kg or specific_impulse_s, or plan for less"


def check_burns(deployment: Deployment, properties: SpacecraftProperties) -> None:
    """See that the tanks hold what the planned burns take, by the rocket equation.

    Nozzles along the force are assumed, the least that a burn may take; six nozzles that share an oblique force take up to
    sqrt(3) times as much, and a tank that runs empty in flight ends the burn.

    Raises:
        ScenarioError: There are burns, and no thrusters.
        PathError: A tank cannot; the message names the spacecraft, what it needs and what it has.
    """
    if not deployment.burns:
        return
    thrusters = properties.thrusters
    if thrusters is None:
        raise ScenarioError("the plan has burns and the spacecraft no thrusters: give spacecraft.thrusters")
    needed = total_delta_v(deployment.burns, len(deployment.v0_N))
    available = thrusters.exhaust_speed * np.log(properties.mass / (properties.mass - thrusters.propellant))
    beyond = np.flatnonzero(needed > available)
    if len(beyond):
        worst = int(np.argmax(needed))
        raise PathError(
            f"burn beyond the tank: sc{worst + 1} needs {needed[worst]:.4g} m/s and its tank gives {available:.4g} m/s "
            f"(spacecraft.thrusters.propellant_kg = {thrusters.propellant:g}); {_REMEDY}",
            BEYOND_THE_TANK,
            beyond.tolist(),
        )


def total_delta_v(burns: Sequence[PlannedBurn], n: int) -> Array:
    """Sum of the sizes of each spacecraft's burns, shape (n,) [m/s]."""
    total = np.zeros(n)
    for burn in burns:
        total[burn.spacecraft] += np.linalg.norm(burn.delta_v_N)
    return total


def fly_burns(simulation: Simulation, deployment: Deployment) -> None:
    """Let the thrusters of a simulation fly the planned burns, if there are any."""
    if not deployment.burns:
        return
    propulsion = simulation.propulsion
    if propulsion is None:
        raise ScenarioError("the plan has burns and the spacecraft no thrusters: give spacecraft.thrusters")
    simulation.force_law = PlannedBurns(deployment.burns, propulsion.thrusters, propulsion.allocation, propulsion.mass)
