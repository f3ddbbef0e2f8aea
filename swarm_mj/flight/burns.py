"""Planned burns held against the tank and the time, and who flies them."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from swarm_mj.errors import PathError, ScenarioError
from swarm_mj.mission.finite_burns import windows_of
from swarm_mj.mission.insertion import BEYOND_THE_TANK, insert
from swarm_mj.mission.trajectories import AccelerationN, Deployment, PlannedBurn, Push
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.planned_burns import PlannedBurns
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.spacecraft.own_spacecraft import OwnSpacecraft
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.spacecraft.thrusters import Allocation, packaged_nozzles, read_nozzles
from swarm_mj.typing import Array

#: Excess over a time that is rounding [s].
ROUNDING_S = 1e-6
_REMEDY = "raise spacecraft.thrusters.propellant_kg or specific_impulse_s, or plan for less"


def push_of(properties: SpacecraftProperties, own: OwnSpacecraft | None) -> Push | None:
    """What the thrusters of a spacecraft give in every direction, or along their axis; None: it has none."""
    thrusters = properties.thrusters
    if thrusters is None:
        return None
    if own is None:
        allocation = Allocation(packaged_nozzles(thrusters.layout, properties.size), np.zeros(3))
    else:
        model = mujoco.MjModel.from_xml_path(str(own.path))
        hub = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, own.hub)
        allocation = Allocation(read_nozzles(model, hub), model.body_ipos[hub])
    return Push(thrusters.thrust * allocation.strength, thrusters.exhaust_speed, properties.mass, thrusters.propellant)


def with_insertion(
    scenario: Scenario, forces: AccelerationN, deployment: Deployment, push: Push | None, candidates: int | None
) -> Deployment:
    """The deployment with insertion burns where the deployer is too slow and there are thrusters.

    Raises:
        ScenarioError: Corrections are asked for as well.
        PathError: A burn cannot be flown, see `insert`.
    """
    deployer = scenario.mothership.deployer
    if deployer.max_speed_m_s is None or push is None:
        return deployment
    found = insert(
        forces,
        deployment,
        push,
        most_m_s=deployer.max_speed_m_s,
        after_s=deployer.insertion_after_s,
        candidates=candidates,
    )
    if found.burns and scenario.trajectory.corrections:
        raise ScenarioError(
            f"trajectory.corrections: cannot be flown beside insertion burns (mothership.deployer.max_speed_m_s = "
            f"{deployer.max_speed_m_s:g}); leave the corrections out, or set a speed that needs no burn"
        )
    return found


def check_burns(deployment: Deployment, push: Push | None) -> None:
    """See that the tanks hold what the planned burns take, by the rocket equation, and that each can begin.

    Nozzles along the force are assumed, the least that a burn may take; six nozzles that share an oblique force take up to
    sqrt(3) times as much, and a tank that runs empty in flight ends the burn.

    Raises:
        ScenarioError: There are burns, and no thrusters.
        PathError: A tank cannot, or a burn begins aboard the mothership or before another ends; the message names spacecraft.
    """
    if not deployment.burns:
        return
    if push is None:
        raise ScenarioError("the plan has burns and the spacecraft no thrusters: give spacecraft.thrusters")
    needed, available = total_delta_v(deployment.burns, len(deployment.v0_N)), push.available
    beyond = np.flatnonzero(needed > available)
    if len(beyond):
        worst = int(np.argmax(needed))
        raise PathError(
            f"burn beyond the tank: sc{worst + 1} needs {needed[worst]:.4g} m/s and its tank gives {available:.4g} m/s "
            f"(spacecraft.thrusters.propellant_kg = {push.propellant:g}); {_REMEDY}",
            BEYOND_THE_TANK,
            beyond.tolist(),
        )
    for j, windows in enumerate(windows_of(deployment.burns, push, np.full(len(needed), push.mass))):
        free = float(deployment.release_s[j]), "it leaves the mothership"
        for window in windows:
            if window.start < free[0] - ROUNDING_S:
                raise PathError(
                    f"sc{j + 1}: its burn of {np.linalg.norm(window.burn.delta_v_N):.4g} m/s about t = {window.burn.t:g} s "
                    f"begins at t = {window.start:.6g} s, before {free[1]} at t = {free[0]:.6g} s; burn later, or raise "
                    "spacecraft.thrusters.thrust_n",
                    "with a burn that begins too early",
                    [j],
                )
            free = window.start + window.duration, "its earlier burn ends"


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
