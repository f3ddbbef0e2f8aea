"""Who can image what on a planned encounter: the problem of allocation for a `Plan`, along its undisturbed trajectories.

Class 3 and 4 swarms allocate this problem, before the encounter and in it. What is known better in flight (where others are,
who is lost, what is seen) changes its `Track`, or what is left of it (`coordination.allocation.losses`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from swarm_mj.coordination.allocation.geometry import (
    Patches,
    Track,
    agility_of,
    encounter_problem,
    patches_of,
)
from swarm_mj.coordination.allocation.problem import AllocationProblem
from swarm_mj.errors import MissionError
from swarm_mj.flight.observe import camera_from, criterion_from
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.trajectories import propagate
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.typing import Array


@dataclass(frozen=True, kw_only=True)
class EncounterSettings:
    """How an encounter is cut into aims and slots.

    Attributes:
        budget: Most pictures of each spacecraft.
        overlap: Radius of a group of cells, over the radius of a picture on the ground seen straight down from the imaging
            altitude.
        settle_s: Until the camera is still after a slew [s].
        wheel_share: Of the wheels' torque and speed that is free for slews.
        each_cell: See `encounter_problem`.
    """

    budget: int
    overlap: float = 0.8
    settle_s: float = 5.0
    wheel_share: float = 0.5
    each_cell: bool = True


@dataclass(frozen=True, eq=False, kw_only=True)
class Encounter:
    """A problem of allocation and what its numbers mean.

    Attributes:
        problem: Of all spacecraft; those that do not observe take no pictures.
        patches: What is aimed at: point `aim_A[m]` is aim m.
        times: Of the slots, past the epoch, shape (k,) [s].
    """

    problem: AllocationProblem
    patches: Patches
    times: Array


def encounter_of(plan: Plan, times: Array, settings: EncounterSettings) -> Encounter:
    """The problem of a planned encounter.

    Args:
        plan: Trajectories, target, camera and criterion.
        times: Of the slots, evenly apart, past the epoch, shape (k,) [s]; at least two.
        settings: How it is cut.

    Raises:
        MissionError: The times are not evenly apart.
    """
    steps = np.diff(times)
    if not len(steps) or times[0] < 0.0 or steps[0] <= 0.0 or not np.allclose(steps, steps[0]):
        raise MissionError(
            f"times: {len(times)} slots, but there must be two or more, evenly apart and not before the epoch"
        )
    camera = replace(camera_from(plan.scenario), shape="cone")
    ground_m = plan.scenario.design.imaging_altitude_m * camera.tan_half_angle
    patches = patches_of(plan.region, settings.overlap * ground_m)
    budget = np.where(np.arange(plan.n) < plan.n_observers, settings.budget, 0)
    problem = encounter_problem(
        HorizonObserver(plan.region, camera),
        criterion_from(plan.scenario),
        patches,
        track_of(plan, times),
        agility_of(plan.properties, settle_s=settings.settle_s, share=settings.wheel_share),
        slot_s=float(steps[0]),
        budget=budget,
        each_cell=settings.each_cell,
    )
    released = times >= plan.deployment.release_s[:, None]
    return Encounter(problem=replace(problem, available=released), patches=patches, times=times)


def track_of(plan: Plan, times: Array) -> Track:
    """Where everything will be at times past the epoch, shape (k,) [s], if nothing disturbs the plan."""
    environment, deployment = plan.environment, plan.deployment
    C_AN = np.array([environment.C_AN(t) for t in times])
    r_N, v_N = (np.empty((len(times), plan.n, 3)) for _ in range(2))
    for j in range(plan.n):
        # Before its release a spacecraft rides along and takes no pictures; its place then stands for itself.
        release = float(deployment.release_s[j])
        grid = np.concatenate([[release], times[times > release]])
        starts = deployment.release_r_N[j : j + 1], deployment.v0_N[j : j + 1]
        r, v = propagate(environment.acceleration_N, *starts, grid)
        late = len(times) - (len(grid) - 1)
        r_N[late:, j], v_N[late:, j] = r[1:, 0], v[1:, 0]
        r_N[:late, j], v_N[:late, j] = r[0, 0], v[0, 0]
    v_A = v_N - np.cross(environment.spin_N, r_N)
    return Track(
        r_A=np.einsum("kij,knj->kni", C_AN, r_N),
        v_A=np.einsum("kij,knj->kni", C_AN, v_A),
        C_AN=C_AN,
        sun_A=np.array([C @ environment.sun.at(t) for C, t in zip(C_AN, times, strict=True)]),
    )
