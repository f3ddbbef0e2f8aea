"""Corrections of a plan: when they are, what is not as planned, and what linear covariance and Monte Carlo say of the visit."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.corrections import Legs, plan_legs
from swarm_mj.mission.covariance import FlightErrors, Spread, spread
from swarm_mj.mission.transition import transitions
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array


@dataclass(frozen=True, kw_only=True)
class Navigated:
    """Linear covariance of a plan.

    Attributes:
        plan: What is to be flown.
        legs: Planned flights, cut at the corrections.
        errors: What is not as planned.
        spread: What that makes of the visit and of the burns.
    """

    plan: Plan
    legs: Legs
    errors: FlightErrors
    spread: Spread


def navigated(plan: Plan) -> Navigated:
    """Linear covariance of a plan from release to visit.

    Raises:
        ScenarioError: A correction is not between release and visit.
        MissionError: A correction has no solution.
    """
    legs, errors = legs_of(plan), errors_of(plan)
    return Navigated(plan=plan, legs=legs, errors=errors, spread=spread(legs, errors))


def legs_of(plan: Plan) -> Legs:
    """The planned flights, cut at the corrections.

    Raises:
        ScenarioError: A correction is not between release and visit.
        MissionError: A trajectory cannot be integrated.
    """
    deployment, acceleration = plan.deployment, plan.environment.acceleration_N
    if deployment.burns:
        raise ScenarioError(
            "trajectory.corrections: the plan has burns of its own, which corrections do not know; leave out one"
        )
    times = knots(plan.scenario, deployment.release_s, deployment.arrival_s)
    return plan_legs(acceleration, deployment.release_r_N, deployment.v0_N, times)


def knots(scenario: Scenario, release_s: Array, visit_s: Array) -> Array:
    """Release, corrections in order of time, visit of each spacecraft, shape (n, m + 2) [s].

    Raises:
        ScenarioError: A correction is not between release and visit, or is where another one is.
    """
    columns = []
    for k, correction in enumerate(scenario.trajectory.corrections):
        after, before = correction.after_release_s, correction.before_visit_s
        at = release_s + after if after is not None else visit_s - (before or 0.0)
        outside = np.flatnonzero(~((at > release_s) & (at < visit_s)))
        if len(outside):
            j = int(outside[0])
            raise ScenarioError(
                f"trajectory.corrections.{k}.{correction.key}: sc{j + 1} flies {visit_s[j] - release_s[j]:g} s from release to "
                "visit; must be less than that"
            )
        columns.append(at)
    times = np.sort(np.array(columns).reshape(-1, len(release_s)), axis=0)
    if (np.diff(times, axis=0) < scenario.control.period_s).any():
        raise ScenarioError(
            "trajectory.corrections: two are at the same time for a spacecraft; must lie at least control.period_s = "
            f"{scenario.control.period_s:g} s apart; leave one out"
        )
    return np.vstack((release_s, times, visit_s)).T


def errors_of(plan: Plan) -> FlightErrors:
    """What the scenario says is not as planned, at release, at corrections and in burns."""
    scenario = plan.scenario
    given, known = scenario.dispersions, scenario.navigation
    return FlightErrors(
        release=_release_covariance(plan),
        position=known.position_m,
        velocity=known.velocity_m_s,
        magnitude=0.01 * given.burn_magnitude_percent,
        pointing=radians(given.burn_pointing_deg),
    )


def _release_covariance(plan: Plan) -> Array:
    """Covariance of each state just after its release, shape (n, 6, 6): the mothership's, carried there, and the deployer's."""
    given, release_s = plan.scenario.dispersions, plan.deployment.release_s
    at_epoch = np.diag(np.repeat((given.mothership_position_m**2, given.mothership_velocity_m_s**2), 3))
    covariance = np.tile(at_epoch, (plan.n, 1, 1))
    if at_epoch.any() and release_s.max() > 0.0:
        carried = _mothership_transitions(plan, np.unique(np.append(0.0, release_s)))
        covariance = np.array([carried[t] @ at_epoch @ carried[t].T for t in release_s])
    covariance[:, 3:, 3:] += given.deployment_velocity_m_s**2 * np.eye(3)
    return covariance


def _mothership_transitions(plan: Plan, times: Array) -> dict[float, Array]:
    deployment = plan.deployment
    start = deployment.r0_N[None], deployment.mothership_velocity_N[None]
    flown = transitions(plan.environment.acceleration_N, *start, times)
    return {float(t): flown.phi[k, 0] for k, t in enumerate(times)}
