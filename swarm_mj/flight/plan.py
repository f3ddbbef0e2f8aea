"""From a scenario to a plan: everything that is fixed before the swarm is released."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import radians

import numpy as np

from swarm_mj import plugins
from swarm_mj.dataflow.link_budget import crosslink_range_m
from swarm_mj.dataflow.relays import check_relays
from swarm_mj.errors import PathError, ScenarioError
from swarm_mj.flight.burns import check_burns, other_burns, push_of, with_insertion
from swarm_mj.flight.coordination import coordinated
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.flight.feasibility import EncounterCheck
from swarm_mj.flight.mothership import check_approach, known_states, mothership_state
from swarm_mj.flight.spacecraft import own_spacecraft_from, properties_from
from swarm_mj.flight.targets import legs, pyramid_about, target_from, true_target, visiting_points, with_aims
from swarm_mj.mission.behaviors import AimedBehavior, Behavior, SelectiveBehavior
from swarm_mj.mission.deployer import check_deployer
from swarm_mj.mission.deployment import coasting, deploy, planned_paths
from swarm_mj.mission.links import Antennas
from swarm_mj.mission.safety import CloseApproach, Impact, check_times, close_approaches, find_impacts, foreseen_impacts
from swarm_mj.mission.target import TargetRegion
from swarm_mj.mission.trajectories import Deployment
from swarm_mj.observation.photometry import needed_surface
from swarm_mj.scenarios.itinerary import arrival_times, itinerary
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_faults import Dispersions
from swarm_mj.scenarios.schema_navigation import Navigation
from swarm_mj.scenarios.schema_propulsion import Trajectory
from swarm_mj.simulator.faults.schedule import check_faults
from swarm_mj.smallbody.companion import Companion
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.control.base import Controller
from swarm_mj.spacecraft.model import spacecraft_names
from swarm_mj.spacecraft.own_spacecraft import OwnSpacecraft
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Indices

#: How many impacts of a plan are told with time and place.
SHOWN_IMPACTS = 5


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A mission that is ready to fly.

    Attributes:
        scenario: What was asked for.
        shape: The body's mesh in A [m].
        environment: Gravity, rotation, Sun and Earth.
        region: The target, cut out of the mesh.
        points_A: The observers' visiting points, shape (n_obs, 3) [m].
        deployment: How the swarm leaves the mothership.
        behavior: Who points at what.
        controller: The attitude control law.
        properties: Of every spacecraft.
        own: What was read of a spacecraft's file; None: the packaged CubeSat flies.
        near_collisions: Pairs that come closer than the scenario allows.
        least_radius: Least distance of each spacecraft to the body's centre, shape (n,) [m].
        encounter_findings: What of the encounter may fall short, one sentence each.
    """

    scenario: Scenario
    shape: ShapeModel
    environment: Environment
    region: TargetRegion
    points_A: Array
    deployment: Deployment
    behavior: Behavior
    controller: Controller
    properties: SpacecraftProperties
    own: OwnSpacecraft | None
    near_collisions: list[CloseApproach]
    least_radius: Array
    encounter_findings: tuple[str, ...] = ()

    @property
    def n(self) -> int:
        """Number of spacecraft."""
        return len(self.deployment.v0_N)

    @property
    def n_observers(self) -> int:
        """Number of spacecraft that observe; they come first."""
        return len(self.points_A)

    @property
    def mothership_distance(self) -> float:
        """Of the mothership from the body's centre at the epoch [m]."""
        mothership = self.scenario.mothership
        return float(
            np.linalg.norm(mothership.position_A_m if mothership.way == "position_A_m" else self.deployment.r0_N)
        )

    @property
    def antennas(self) -> Antennas:
        """Of every spacecraft."""
        return antennas_from(self.scenario)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the spacecraft in gene order."""
        return spacecraft_names(self.n)


def make_plan(
    scenario: Scenario,
    *,
    check_separation: bool = True,
    progress: Callable[[float], None] | None = None,
    known: tuple[Deployment, Array] | None = None,
) -> Plan:
    """Work out target, visiting points, trajectories and plug-ins.

    Args:
        scenario: What is asked for.
        check_separation: Whether to look for near-collisions, and for an impact of the communications spacecraft; candidates of
            a design do not fly together, and the one that would go between all of them never flies.
        progress: Called with the share done, 0 to 1.
        known: Deployment and `least_radius` of this very scenario, which are then neither worked out nor checked again.

    Raises:
        SwarmError: Shape, target, plug-in or trajectory cannot be had; the message says why. A `PathError` says whose paths.
    """
    if scenario.navigation.mode == "optical":
        needed_surface(scenario.body)
    controller = controller_from(scenario)
    behavior = behavior_from(scenario)
    own = own_spacecraft_from(scenario)
    properties = properties_from(scenario) if own is None else own.properties
    shape = load_body_shape(scenario.body)
    environment = environment_from(scenario, shape, properties.mass)
    region = target_from(scenario, shape)
    if scenario.initial_states:
        coasts = _coasting(scenario, environment, behavior)
        arrivals = zip(coasts.destination_N, coasts.arrival_s.tolist(), strict=True)
        points_A = np.array([environment.C_AN(t) @ r_N for r_N, t in arrivals])
    else:
        coasts, points_A = None, visiting_points(scenario, shape, region)
    behavior = with_aims(scenario, behavior, region)
    region = true_target(scenario, shape, region)
    candidates = None if check_separation else len(points_A)

    def foresee(r0_N: Array, destinations_N: Array, span: tuple[float, float], who: Indices) -> None:
        counts = np.ones(len(who), np.bool_) if candidates is None else who < candidates
        impacts = foreseen_impacts(shape, environment, r0_N, destinations_N[counts], span, scenario.duration_s)
        _refuse_impacts(scenario, [replace(one, spacecraft=int(who[counts][one.spacecraft])) for one in impacts])

    push, most_m_s = push_of(properties, own), scenario.mothership.deployer.max_speed_m_s
    near_collisions: list[CloseApproach] = []
    if known is not None:
        deployment, least_radius = replace(known[0], push=push if known[0].burns else None), known[1]
    elif coasts is not None:
        deployment = coasts
        near_collisions, least_radius = _check_flight(scenario, shape, environment, deployment, candidates)
    else:
        mothership = mothership_state(scenario, environment)
        check_approach(scenario, shape, environment, mothership)
        deployment = deploy(
            environment,
            mothership_N=mothership.r_N,
            mothership_velocity=mothership.velocity,
            **legs(scenario, itinerary(scenario), points_A, behavior, region),
            progress=progress,
            foresee=foresee if push is None or most_m_s is None else None,  # insertion burns lead elsewhere
        )
        deployment = with_insertion(scenario, environment.acceleration_N, deployment, push, candidates)
        check_burns(deployment, push)
        check_deployer(scenario.mothership.deployer, deployment, candidates)
        check_relays(scenario.data.relays, len(deployment.v0_N))
        near_collisions, least_radius = _check_flight(scenario, shape, environment, deployment, candidates)
    encounter_findings: tuple[str, ...] = ()
    if check_separation:
        encounter_findings = EncounterCheck(
            scenario=scenario,
            behavior=behavior,
            properties=properties,
            environment=environment,
            region=region,
            deployment=deployment,
            least_radius=least_radius[: len(points_A)],
        ).findings()
    plan = Plan(
        scenario=scenario,
        shape=shape,
        environment=environment,
        region=region,
        points_A=points_A,
        deployment=deployment,
        behavior=behavior,
        controller=controller,
        properties=properties,
        own=own,
        near_collisions=near_collisions,
        least_radius=least_radius,
        encounter_findings=encounter_findings,
    )
    check_faults_of(plan, scenario)
    return plan


def _coasting(scenario: Scenario, environment: Environment, behavior: Behavior) -> Deployment:
    """The swarm that is on its way at the epoch.

    Raises:
        ScenarioError: A behaviour asks for one more spacecraft, which nobody releases.
    """
    if behavior.dedicated_communications:
        raise ScenarioError(
            f"behavior.name = {scenario.behavior.name}: adds a spacecraft for communications, which no mothership releases to "
            "those of initial_states; must be another, such as body_tracking or adaptable_roles"
        )
    return coasting(environment, *known_states(scenario, environment), arrival_times(scenario))


def check_faults_of(plan: Plan, scenario: Scenario) -> None:
    """See that a scenario's faults can happen to the spacecraft of a plan.

    Raises:
        ScenarioError: One cannot.
    """
    check_faults(scenario.faults, n=plan.n, n_wheels=plan.properties.n_wheels, duration_s=scenario.duration_s)


def check_plugins(scenario: Scenario) -> None:
    """See that the scenario's plug-ins are there and take its parameters, as far as that shows before anything is built.

    The file of a spacecraft is read as well.

    Raises:
        PluginError: One is not, or does not; the message names the key.
        ScenarioError: The file holds no spacecraft that can be flown.
    """
    own_spacecraft_from(scenario)
    controller_from(scenario)
    unchecked_behavior(scenario)
    with plugins.named("body.gravity.model"):
        plugins.find(plugins.GRAVITY, scenario.body.gravity.model)
    if scenario.companion is not None:
        with plugins.named("companion.body.gravity.model"):
            plugins.find(plugins.GRAVITY, scenario.companion.body.gravity.model)


def controller_from(scenario: Scenario) -> Controller:
    """The scenario's attitude control law.

    Raises:
        PluginError: There is none of that name, or its parameters do not fit.
    """
    with plugins.named("control.controller"):
        controller: Controller = plugins.create(
            plugins.CONTROLLERS, scenario.control.controller, scenario.control.parameters
        )
    return controller


def as_planned(scenario: Scenario) -> Scenario:
    """The scenario without faults, dispersions and the corrections of what they do: all that a design can count on.

    Thrusters that fly corrections go with them: no insertion burns are flown beside.
    """
    changes = {"faults": (), "dispersions": Dispersions(), "trajectory": Trajectory(), "navigation": Navigation()}
    if other_burns(scenario) == "trajectory.corrections":
        changes["spacecraft"] = scenario.spacecraft.model_copy(update={"thrusters": None})
    return scenario.model_copy(update=changes)


def behavior_from(scenario: Scenario) -> Behavior:
    """The scenario's behaviour, which may refuse the scenario.

    Raises:
        SwarmError: There is none of that name, its parameters do not fit, or it cannot fly this scenario.
    """
    behavior = unchecked_behavior(scenario)
    if isinstance(behavior, SelectiveBehavior):
        behavior.check_scenario(scenario)
    return behavior


def unchecked_behavior(scenario: Scenario) -> Behavior:
    """The scenario's behaviour, whether it can fly the scenario or not.

    Raises:
        SwarmError: There is none of that name, or its parameters do not fit.
    """
    with plugins.named("behavior.name"):
        behavior: Behavior = plugins.create(
            plugins.BEHAVIORS,
            scenario.behavior.name,
            scenario.behavior.parameters,
            len(scenario.design.visiting_points),
            scenario.behavior.imaging_radius_m,
        )
    aimed = behavior.aimed_at(pyramid_about(scenario.target)) if isinstance(behavior, AimedBehavior) else behavior
    return coordinated(aimed, scenario)


def antennas_from(scenario: Scenario) -> Antennas:
    """The scenario's antennas; ScenarioError where its radio does not exist."""
    link, boresight_B = scenario.link, np.array(scenario.link.hemispherical_boresight_B, np.float64)
    return Antennas(
        dish_half_angle=radians(link.dish_half_angle_deg),
        hemispherical_boresight_B=boresight_B / np.linalg.norm(boresight_B, axis=-1),
        hemispherical_half_angle=radians(link.hemispherical_half_angle_deg),
        max_range=crosslink_range_m(link),
        omnidirectional=link.crosslink.antenna == "omnidirectional",
    )


def _check_flight(
    scenario: Scenario, shape: ShapeModel, environment: Environment, deployment: Deployment, candidates: int | None
) -> tuple[list[CloseApproach], Array]:
    """Fly the trajectories ahead; an impact is an error, a near-collision is reported, except of so many `candidates`."""
    times = check_times(scenario.duration_s)
    r_N, _ = planned_paths(environment.acceleration_N, deployment, times)
    C_AN = np.array([environment.C_AN(t) for t in times])
    _refuse_impacts(scenario, find_impacts(shape, times, np.einsum("kij,knj->kni", C_AN, r_N)[:, :candidates]))
    if environment.companion is not None:
        _refuse_companion_hits(environment.companion, times, r_N[:, :candidates])
    least_radius = np.linalg.norm(r_N, axis=2).min(axis=0)
    if candidates is not None:
        return [], least_radius
    safety = scenario.safety
    near = close_approaches(
        times, r_N, closer_than=safety.min_separation_m, after=safety.separation_grace_s, release_s=deployment.release_s
    )
    return near, least_radius


def _refuse_companion_hits(companion: Companion, times: Array, r_N: Array) -> None:
    """Raise a PathError that names who hits the companion; positions at some times, shape (t, n, 3) [m]."""
    r_A = np.array(
        [(r - companion.position(t)) @ companion.C_AN(t).T for t, r in zip(times.tolist(), r_N, strict=True)]
    )
    if impacts := find_impacts(companion.shape, times, r_A):
        told = "; ".join(
            f"sc{i.spacecraft + 1} hits {companion.name} at t = {i.time:g} s" for i in impacts[:SHOWN_IMPACTS]
        )
        remedy = "change design.visiting_points, design.time_of_flight_s, the epoch or companion.orbit"
        raise PathError(f"{told}; {remedy}", f"hitting {companion.name}", [impact.spacecraft for impact in impacts])


def _refuse_impacts(scenario: Scenario, impacts: list[Impact]) -> None:
    """Raise a PathError that names the impacts, if there are any."""
    if not impacts:
        return
    raise PathError(
        "; ".join(
            f"sc{i.spacecraft + 1} hits {scenario.body.name} at t = {i.time:g} s, latitude {i.latitude_deg:.1f} deg, "
            f"longitude {i.longitude_deg:.1f} deg"
            for i in impacts[:SHOWN_IMPACTS]
        )
        + (f"; {len(impacts) - SHOWN_IMPACTS} more do" if len(impacts) > SHOWN_IMPACTS else "")
        + "; change design.visiting_points, design.imaging_altitude_m, design.time_of_flight_s or "
        f"mothership.{scenario.mothership.way}",
        f"hitting {scenario.body.name}",
        [impact.spacecraft for impact in impacts],
    )
