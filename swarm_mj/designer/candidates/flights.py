"""The flight of one spacecraft to every visiting point, pointed as the behaviour commands.

The designer chooses among points before anything is flown for real, so attitudes are the commanded ones: +z exactly on the
line of sight. The rotation about it is left to the initial attitude by the guidance, and that is random; by default only what
any rotation sees is counted, which for a square field of view is what its inscribed cone sees.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.flight.observe import schedule_from
from swarm_mj.flight.plan import Plan, as_planned, behavior_from, make_plan
from swarm_mj.mission.behaviors import MissionBehavior, SwarmView, TargetKind
from swarm_mj.mission.trajectories import propagate
from swarm_mj.observation.capture import camera_poses, watching
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.recorder import sample_times
from swarm_mj.spacecraft.attitude.guidance import LineOfSight, Reference, track_line_of_sight
from swarm_mj.spacecraft.attitude.mrp import dcm, mrp_from_quaternion
from swarm_mj.typing import Array, Mask


@dataclass(frozen=True, kw_only=True)
class CandidateFlights:
    """Where every candidate is, and how it is turned, at the times of its pictures.

    Attributes:
        plan: The plan in which every visiting point has an observer.
        times: Times of pictures past the epoch, shape (t,) [s].
        counts: Whether the scenario counts the pictures of that time, shape (t,).
        observing: Whether a candidate takes a picture then, shape (t, n).
        r_A: Positions in A, shape (t, n, 3) [m].
        C_CA: Commanded camera attitudes, shape (t, n, 3, 3).
        delta_v: Deployment speed relative to the mothership at the mean of all candidates, shape (n,) [m/s].
    """

    plan: Plan
    times: Array
    counts: Mask
    observing: Mask
    r_A: Array
    C_CA: Array
    delta_v: Array

    @property
    def n(self) -> int:
        """Number of candidates."""
        return self.r_A.shape[1]


def all_points(scenario: Scenario, n_points: int) -> Scenario:
    """The scenario with one observer on every visiting point."""
    design = scenario.design.model_copy(update={"visiting_points": tuple(range(1, n_points + 1))})
    return scenario.model_copy(update={"design": design})


def fly_candidates(scenario: Scenario) -> CandidateFlights:
    """Fly to every visiting point of the scenario's target.

    Raises:
        SwarmError: A point cannot be reached, the flight to it hits the body, or the behaviour must know the mission.
    """
    scenario = as_planned(scenario)
    if isinstance(behavior_from(scenario), MissionBehavior):
        raise MissionError(
            f"behavior.name = {scenario.behavior.name!r}: it can fly, but no design can be made with it: it needs the mission"
        )
    probe = scenario.model_copy(update={"design": scenario.design.model_copy(update={"visiting_points": (1,)})})
    n_points = make_plan(probe, check_separation=False).region.n_visiting
    plan = make_plan(all_points(scenario, n_points), check_separation=False)
    times, counts = _picture_times(scenario)
    n = plan.n_observers
    starts = np.broadcast_to(plan.deployment.r0_N, plan.deployment.v0_N.shape)
    r_N, v_N = propagate(plan.environment.acceleration_N, starts, plan.deployment.v0_N, times)
    observing, r_A, C_CA = _commanded(plan, times, r_N, v_N)
    return CandidateFlights(
        plan=plan,
        times=times,
        counts=counts,
        observing=observing[:, :n],
        r_A=r_A[:, :n],
        C_CA=C_CA[:, :n],
        delta_v=plan.deployment.delta_v[:n],
    )


def _picture_times(scenario: Scenario) -> tuple[Array, Mask]:
    """Times of all pictures of the passage [s], and which of them count."""
    times = sample_times(scenario.duration_s, scenario.telemetry.interval_s)
    schedule = schedule_from(scenario, scenario.telemetry.interval_s)
    ticks = replace(schedule, visit_only=False).ticks(len(times) - 1)
    return times[ticks], schedule.due(ticks)


def _commanded(plan: Plan, times: Array, r_N: Array, v_N: Array) -> tuple[Mask, Array, Array]:
    """Whether each spacecraft takes a picture, where its camera is and how it is commanded to turn, at every time."""
    n = plan.n
    q_RN = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    base = q_RN.copy()
    observing = np.zeros((len(times), n), dtype=np.bool_)
    r_A, C_CA = np.empty((len(times), n, 3)), np.empty((len(times), n, 3, 3))
    memory, zero, reference = None, np.zeros((n, 3)), Reference(q_RN, *(np.empty((n, 3)) for _ in range(3)))
    for k, t in enumerate(times):
        C_AN = plan.environment.C_AN(t)
        targets, memory = plan.behavior.targets(SwarmView(float(t), r_N[k], v_N[k], C_AN), memory)
        surface = targets.kind == TargetKind.SURFACE
        observing[k] = watching(plan.n_observers, targets.kind)
        # Where nothing is observed the attitude does not matter; the body's centre serves.
        rho = -r_N[k] + np.where(surface[:, None], targets.vector @ C_AN, 0.0)
        track_line_of_sight(LineOfSight(rho, zero, zero), base, np.full(n, k == 0), reference)
        r_A[k], C_CA[k] = camera_poses(r_N[k], dcm(mrp_from_quaternion(q_RN)), C_AN)
    return observing, r_A, C_CA
