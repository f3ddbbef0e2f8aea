"""The flight of one spacecraft to every visiting point, pointed as the behaviour commands.

The designer chooses among points before anything is flown for real, so attitudes are the commanded ones: +z exactly on the
line of sight. Pictures that are taken while a spacecraft may still turn there, after its release or from another target, do not
count. The rotation about the line of sight is left to the initial attitude by the guidance, and that is random; by default only
what any rotation sees is counted, which for a square field of view is what its inscribed cone sees.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import radians
from typing import Any

import numpy as np

from swarm_mj.coordination.encounter import settling_times
from swarm_mj.errors import MissionError, PathError, ScenarioError
from swarm_mj.flight.burns import total_delta_v
from swarm_mj.flight.environment import load_body_shape
from swarm_mj.flight.observe import schedule_from
from swarm_mj.flight.plan import Plan, as_planned, behavior_from, make_plan
from swarm_mj.flight.refusals import refuse_known_states
from swarm_mj.flight.targets import target_from
from swarm_mj.mission.behaviors import MissionBehavior, SwarmView, TargetKind
from swarm_mj.mission.deployer import beyond
from swarm_mj.mission.deployment import planned_paths
from swarm_mj.mission.trajectories import NO_TRAJECTORY, Progress
from swarm_mj.observation.capture import camera_poses, watching
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.simulation import sample_times
from swarm_mj.smallbody.conic import hyperbola_of_state
from swarm_mj.spacecraft.attitude.guidance import LineOfSight, Reference, track_line_of_sight
from swarm_mj.spacecraft.attitude.mrp import dcm, mrp_from_quaternion
from swarm_mj.typing import Array, Indices, Mask

#: A turn is over when so little of it is left, of the camera's half-angle.
SETTLED = 0.01


@dataclass(frozen=True, kw_only=True)
class CandidateFlights:
    """Where every candidate is, and how it is turned, at the times of its pictures.

    Attributes:
        plan: The plan in which every visiting point has an observer.
        times: Times of pictures past the epoch, shape (t,) [s].
        counts: Whether the scenario counts the pictures of that time, shape (t,).
        observing: Whether a candidate takes a picture then, shape (t, n).
        settled: Whether it has observed so long that the longest turn to the body is over, shape (t, n).
        r_A: Positions in A, shape (t, n, 3) [m].
        C_CA: Commanded camera attitudes, shape (t, n, 3, 3).
        v_A: Velocities in A relative to A, shape (t, n, 3) [m/s].
        omega_C: Commanded angular velocities of the cameras relative to A, in C, shape (t, n, 3) [rad/s].
        delta_v: Deployment speed relative to the mothership at the mean of all candidates, with insertion burns, shape (n,)
            [m/s].
        beyond: Whether the deployer cannot give it, shape (n,).
        points: The visiting point of each candidate, numbered from 1.
        left_out: Visiting points to which no flight goes, and why, in a few words.
    """

    plan: Plan
    times: Array
    counts: Mask
    observing: Mask
    settled: Mask
    r_A: Array
    C_CA: Array
    v_A: Array
    omega_C: Array
    delta_v: Array
    beyond: Mask
    points: tuple[int, ...]
    left_out: dict[int, str]

    @property
    def n(self) -> int:
        """Number of candidates."""
        return self.r_A.shape[1]


class Unreachable(MissionError):
    """No visiting point of a target can be flown to.

    Attributes:
        left_out: Why not, in a few words, by visiting point.
    """

    def __init__(self, message: str, left_out: dict[int, str]) -> None:
        super().__init__(message)
        self.left_out = left_out


def at_points(scenario: Scenario, points: Sequence[int]) -> Scenario:
    """The scenario with one observer on each of these visiting points, numbered from 1."""
    design = scenario.design.model_copy(update={"visiting_points": tuple(points), "observers": ()})
    return scenario.model_copy(update={"design": design})


def fly_candidates(scenario: Scenario, progress: Progress | None = None) -> CandidateFlights:
    """Fly to the visiting points of the scenario's target, at most `designer.max_points`, that can be reached safely.

    The share that is done, 0 to 1, is told to `progress`.

    Raises:
        Unreachable: No point can be.
        SwarmError: The behaviour must know the mission.
    """
    refuse_known_states(scenario, "a design")
    scenario = as_planned(scenario)
    if isinstance(behavior_from(scenario), MissionBehavior):
        raise MissionError(
            f"behavior.name = {scenario.behavior.name!r}: it can fly, but no design can be made with it: it needs the mission"
        )
    _check_deployer(scenario)
    region = target_from(scenario, load_body_shape(scenario.body))
    points = farthest_apart(region.vertices[region.visiting_vertex], scenario.designer.max_points)
    plan, left_out = _reachable(scenario, [int(k) + 1 for k in points], progress)
    if plan.deployment.burns:
        _require_known_velocity(scenario, "so do insertion burns (mothership.deployer.max_speed_m_s: null flies none)")
    times, _ = _picture_times(scenario)
    n = plan.n_observers
    r_N, v_N = planned_paths(plan.environment.acceleration_N, plan.deployment, times)
    observing, r_A, C_CA, v_A, omega_C = _commanded(plan, times, r_N, v_N)
    return flights_of(
        plan,
        left_out,
        observing=observing[:, :n] & _released(plan, times),
        settled=_settled(plan, times),
        r_A=r_A[:, :n],
        C_CA=C_CA[:, :n],
        v_A=v_A[:, :n],
        omega_C=omega_C[:, :n],
    )


def flights_of(plan: Plan, left_out: dict[int, str], **flown: Any) -> CandidateFlights:
    """The flights of a plan with an observer for each point, from what of them takes long to work out."""
    times, counts = _picture_times(plan.scenario)
    return CandidateFlights(
        plan=plan,
        times=times,
        counts=counts,
        delta_v=(plan.deployment.delta_v + total_delta_v(plan.deployment.burns, plan.n))[: plan.n_observers],
        beyond=beyond(plan.deployment, plan.scenario.mothership.deployer.max_speed_m_s)[: plan.n_observers],
        points=plan.scenario.design.visiting_points,
        left_out=left_out,
        **flown,
    )


def farthest_apart(points_A: Array, count: int | None) -> Indices:
    """Numbers of `count` of some points, each in turn the farthest from those before, ascending; all where they are as few.

    The first is the one farthest from the centre of A. No point is then farther from a chosen one than twice the least that
    any choice of as many could do (Gonzalez 1985). `points_A`: shape (n, 3) [m].
    """
    if count is None or count >= len(points_A):
        return np.arange(len(points_A))
    chosen = [int(np.argmax(np.linalg.norm(points_A, axis=1)))]
    apart = np.linalg.norm(points_A - points_A[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(apart)))
        apart = np.minimum(apart, np.linalg.norm(points_A - points_A[chosen[-1]], axis=1))
    return np.sort(chosen)


def b_plane_of(flights: CandidateFlights) -> Array:
    """B.T and B.R [m] and the speed on the incoming asymptote [m/s] of each candidate's path, shape (n, 3).

    Of the two-body orbit at its release, with the pole of the ecliptic, see `swarm_mj.smallbody.conic`; NaN of a bound one, of
    one along the pole, and of a field without GM.
    """
    plan, found = flights.plan, np.full((flights.n, 3), np.nan)
    gm = float(getattr(plan.environment.gravity, "gm", None) or np.nan)
    for j in range(flights.n if np.isfinite(gm) else 0):
        flyby = hyperbola_of_state(plan.deployment.release_r_N[j], plan.deployment.v0_N[j], gm)
        if flyby is not None:
            found[j, 2] = flyby.speed
            with suppress(MissionError):
                found[j, :2] = flyby.components(np.array([0.0, 0.0, 1.0]))
    return found


def _check_deployer(scenario: Scenario) -> None:
    """See that a candidate alone tells whether the deployer can release it."""
    limits = scenario.mothership.deployer
    if limits.spacing_s is not None:
        raise MissionError(
            f"mothership.deployer.spacing_s = {limits.spacing_s:g}: a design does not look at it; set null, and give release_s "
            "in design.observers of what it finds"
        )
    if limits.max_speed_m_s is not None and limits.beyond_max_speed == "refused":
        _require_known_velocity(scenario, "so does whom mothership.deployer.max_speed_m_s leaves out")
    if limits.cone_axis_N is not None:
        _require_known_velocity(scenario, "so does whom mothership.deployer.cone_axis_N leaves out")
    if len(scenario.designer.releases_s) > 1:
        _require_known_velocity(scenario, "so do the places of designer.releases_s")


def _require_known_velocity(scenario: Scenario, what: str) -> None:
    """See that the mothership's path does not depend on who is chosen; else the error says `what` follows from that."""
    if scenario.mothership.way == "position_A_m" and scenario.mothership.velocity == "mean":
        raise MissionError(
            f"mothership.velocity = 'mean' depends on who is chosen, and {what}; give 'rest' or three components in N, or "
            "mothership.elements, approach or ephemeris"
        )


def _reachable(scenario: Scenario, points: Sequence[int], progress: Progress | None) -> tuple[Plan, dict[int, str]]:
    """A plan for all points that can be flown to, and why the others cannot; `Unreachable` where none can."""
    left_out: dict[int, str] = {}
    first: MissionError | None = None  # it numbers spacecraft as points
    while True:
        try:
            plan = make_plan(at_points(scenario, points), check_separation=False, progress=progress)
            return plan, dict(sorted(left_out.items()))
        except MissionError as error:
            first, bad = first or error, _who_fails(scenario, points, error)
            left_out |= bad
            points = [point for point in points if point not in bad]
            if not bad or not points:
                raise Unreachable(f"no visiting point of the target can be flown to: {first}", left_out) from error


def _who_fails(scenario: Scenario, points: Sequence[int], error: MissionError) -> dict[int, str]:
    """Which points make a plan fail, and why: those that the error names, else found by halving."""
    if isinstance(error, PathError):
        return {points[k]: error.reason for k in error.spacecraft if k < len(points)}
    if len(points) == 1:
        return {points[0]: NO_TRAJECTORY}
    found: dict[int, str] = {}
    for half in (points[: len(points) // 2], points[len(points) // 2 :]):
        try:
            make_plan(at_points(scenario, half), check_separation=False)
        except MissionError as worse:
            found |= _who_fails(scenario, half, worse)
    return found


def _released(plan: Plan, times: Array) -> Mask:
    """Whether each candidate has left the mothership, shape (t, n): aboard it takes no picture."""
    return np.asarray(times[:, None] >= plan.deployment.release_s[: plan.n_observers] * (1.0 - 1e-12))


def _settled(plan: Plan, times: Array) -> Mask:
    """Whether each candidate observed already before the longest turn, shape (t, n)."""
    tolerance = SETTLED * radians(plan.scenario.camera.half_angle_deg)
    turn_s = settling_times(plan.controller, plan.properties, plan.scenario.control.period_s, tolerance)[1][-1]
    moments, which = np.unique(np.append(0.0, (times - turn_s).clip(0.0)), return_inverse=True)
    r_N, v_N = planned_paths(plan.environment.acceleration_N, plan.deployment, moments)
    observing, memory = _released(plan, moments), None
    for k, t in enumerate(moments):
        view = SwarmView(float(t), r_N[k], v_N[k], plan.environment.C_AN(t))
        targets, memory = plan.behavior.targets(view, memory)
        observing[k] &= watching(plan.n_observers, targets.kind)[: plan.n_observers]
    return observing[which.ravel()[1:]] & (times >= turn_s)[:, None]


def _picture_times(scenario: Scenario) -> tuple[Array, Mask]:
    """Times of all pictures of the passage [s], and which of them count.

    Raises:
        ScenarioError: A table names who takes them, which is for the design to say.
    """
    for k, picture in enumerate(scenario.observation.sequence):
        if picture.spacecraft is not None:
            raise ScenarioError(
                f"observation.sequence.{k}.spacecraft = {picture.spacecraft}: a design decides who flies; leave it out"
            )
    times = sample_times(scenario.duration_s, scenario.telemetry.interval_s)
    schedule = schedule_from(scenario, scenario.telemetry.interval_s)
    ticks = replace(schedule, arrival_only=False).ticks(len(times) - 1)
    return times[ticks], schedule.due(ticks)


def _commanded(plan: Plan, times: Array, r_N: Array, v_N: Array) -> tuple[Mask, Array, Array, Array, Array]:
    """Whether each spacecraft takes a picture, where its camera is, how it is turned and how both change, at every time."""
    n, spin_N = plan.n, plan.environment.spin_N
    q_RN = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    base = q_RN.copy()
    observing = np.zeros((len(times), n), dtype=np.bool_)
    C_CA = np.empty((len(times), n, 3, 3))
    r_A, v_A, omega_C = (np.empty((len(times), n, 3)) for _ in range(3))
    memory, zero, reference = None, np.zeros((n, 3)), Reference(q_RN, *(np.empty((n, 3)) for _ in range(3)))
    for k, t in enumerate(times):
        C_AN = plan.environment.C_AN(t)
        targets, memory = plan.behavior.targets(SwarmView(float(t), r_N[k], v_N[k], C_AN), memory)
        surface = targets.kind == TargetKind.SURFACE
        observing[k] = watching(plan.n_observers, targets.kind)
        # Where nothing is observed the attitude does not matter; the body's centre serves.
        point_N = np.where(surface[:, None], targets.vector @ C_AN, 0.0)
        rho, rho_dot = point_N - r_N[k], np.cross(spin_N, point_N) - v_N[k]
        track_line_of_sight(LineOfSight(rho, rho_dot, zero), base, np.full(n, k == 0), reference)
        C_BN = dcm(mrp_from_quaternion(q_RN))
        r_A[k], C_CA[k] = camera_poses(r_N[k], C_BN, C_AN)
        v_A[k] = (v_N[k] - np.cross(spin_N, r_N[k])) @ C_AN.T
        omega_C[k] = np.einsum("jab,jb->ja", C_BN, reference.omega_RN_N - spin_N)
    return observing, r_A, C_CA, v_A, omega_C
