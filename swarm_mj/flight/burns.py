"""Planned burns held against the tank and the time, and who flies them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarm_mj.errors import PathError, ScenarioError
from swarm_mj.mission.deployer import BEYOND_THE_TANK, insert
from swarm_mj.mission.finite_burns import timed_burns
from swarm_mj.mission.trajectories import AccelerationN, Deployment, PlannedBurn, Push
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_propulsion import Thrusters
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.spacecraft.control.force import ForceView
from swarm_mj.spacecraft.own_spacecraft import OwnSpacecraft
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.spacecraft.thrusters import ThrusterAllocation, packaged_nozzles
from swarm_mj.typing import Array

#: Excess over a time that is rounding [s].
ROUNDING_S = 1e-6
#: How long before a burn spacecraft turn whose nozzles do not push in every direction [s]: wheels of 15 mN m s turn a 3U
#: CubeSat over in some 40 s, and the control law settles in as many.
TURN_S = 120.0
#: A burn is over when so much of it is left [m/s], or when it has taken so many times as long as planned.
DONE_M_S, TOO_LONG = 1e-9, 2.0
_REMEDY = "raise spacecraft.thrusters.propellant_kg or specific_impulse_s, or plan for less"


def push_of(properties: SpacecraftProperties, own: OwnSpacecraft | None) -> Push | None:
    """What the thrusters of a spacecraft give in every direction, or along their axis; None: it has none."""
    thrusters = properties.thrusters
    if thrusters is None:
        return None
    if own is None:
        strength = ThrusterAllocation(packaged_nozzles(thrusters.layout, properties.size), np.zeros(3)).strength
    else:
        strength = own.strength
    return Push(thrusters.thrust_n * strength, thrusters.exhaust_speed, properties.mass, thrusters.propellant_kg)


def with_insertion(
    scenario: Scenario, forces: AccelerationN, deployment: Deployment, push: Push | None, candidates: int | None
) -> Deployment:
    """The deployment with insertion burns where the deployer is too slow and there are thrusters that do nothing else.

    Raises:
        ScenarioError: What is beyond the deployer is refused, and corrections are asked for as well.
        PathError: It is refused, and a burn cannot be flown, see `insert`.
    """
    deployer = scenario.mothership.deployer
    told = deployer.beyond_max_speed == "told"
    if deployer.max_speed_m_s is None or push is None or (told and other_burns(scenario)):
        return deployment
    found = insert(
        forces,
        deployment,
        push,
        most_m_s=deployer.max_speed_m_s,
        after_s=deployer.insertion_after_s,
        lenient=told,
        candidates=candidates,
    )
    if found.burns and scenario.trajectory.corrections:
        raise ScenarioError(
            f"trajectory.corrections: cannot be flown beside insertion burns (mothership.deployer.max_speed_m_s = "
            f"{deployer.max_speed_m_s:g}); leave the corrections out, or set a speed that needs no burn"
        )
    return found


def other_burns(scenario: Scenario) -> str:
    """The key of what the thrusters do beside which no planned burns are flown; empty: nothing."""
    if scenario.swarm is not None and scenario.swarm.formation is not None:
        return "swarm.formation"
    return "trajectory.corrections" if scenario.trajectory.corrections else ""


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
    for j, burns in enumerate(timed_burns(deployment.burns, push, np.full(len(needed), push.mass))):
        free = float(deployment.release_s[j]), "it leaves the mothership"
        for burn in burns:
            if burn.start < free[0] - ROUNDING_S:
                raise PathError(
                    f"sc{j + 1}: its burn of {np.linalg.norm(burn.planned.delta_v_N):.4g} m/s about t = {burn.planned.t:g} s "
                    f"begins at t = {burn.start:.6g} s, before {free[1]} at t = {free[0]:.6g} s; burn later, or raise "
                    "spacecraft.thrusters.thrust_n",
                    "with a burn that begins too early",
                    [j],
                )
            free = burn.start + burn.duration, "its earlier burn ends"


def total_delta_v(burns: Sequence[PlannedBurn], n: int) -> Array:
    """Sum of the sizes of each spacecraft's burns, shape (n,) [m/s]."""
    total = np.zeros(n)
    for burn in burns:
        total[burn.spacecraft] += np.linalg.norm(burn.delta_v_N)
    return total


class PlannedBurns:
    """Flies planned burns, each centred at its instant.

    The thrust is the greatest that the nozzles give in every direction (or along their axis, if they must be turned). A burn
    goes on until the accelerometers say that its velocity has been gained, so that mass, pulses and errors of direction do not
    matter. Burns of one spacecraft follow each other.

    Args:
        burns: What is planned.
        thrusters: By which it is flown.
        allocation: Of their nozzles.
        mass: At the start, shape (n,) [kg].
    """

    def __init__(
        self, burns: Sequence[PlannedBurn], thrusters: Thrusters, allocation: ThrusterAllocation, mass: Array
    ) -> None:
        self.force = thrusters.thrust_n * allocation.strength
        self._n = len(mass)
        push = Push(self.force, thrusters.exhaust_speed, float(np.max(mass)), thrusters.propellant_kg)
        self.burns = timed_burns(burns, push, mass)

    def forces(self, view: ForceView, memory: tuple[Array, Array] | None) -> tuple[Array, tuple[Array, Array]]:
        """Full thrust for those whose burn it is, see `ForceLaw`; remembers burns done and velocities at their start."""
        done, before = (np.zeros(self._n, int), np.zeros((self._n, 3))) if memory is None else memory
        done, before = done.copy(), before.copy()
        wish = np.zeros((self._n, 3))
        for j in range(self._n):
            while done[j] < len(self.burns[j]) and view.t + view.period > self.burns[j][done[j]].start:
                burn = self.burns[j][done[j]]
                left_N = burn.planned.delta_v_N - (view.delta_v_N[j] - before[j])
                left = float(np.linalg.norm(left_N))
                late = view.t > burn.start + TOO_LONG * burn.duration + view.period
                if left > DONE_M_S and not late:
                    share = min(1.0, (view.t + view.period - burn.start) / view.period)
                    wish[j] = left_N / left * min(share * self.force, left * view.mass[j] / view.period)
                    break
                done[j] += 1
                before[j] = view.delta_v_N[j]
        return wish, (done, before)

    def directions(self, t: float) -> Array:
        """Directions of the burns under way or due within `TURN_S`, shape (n, 3)."""
        found = np.zeros((self._n, 3))
        for j, burns in enumerate(self.burns):
            for planned, start, duration, _ in burns:
                if start - TURN_S <= t <= start + duration:
                    found[j] = planned.delta_v_N / np.linalg.norm(planned.delta_v_N)
                    break
        return found


def fly_burns(simulation: Simulation, deployment: Deployment) -> None:
    """Let the thrusters of a simulation fly the planned burns, if there are any."""
    if not deployment.burns:
        return
    propulsion = simulation.propulsion
    assert propulsion is not None  # `check_burns` sees to that
    simulation.force_law = PlannedBurns(deployment.burns, propulsion.thrusters, propulsion.allocation, propulsion.mass)
