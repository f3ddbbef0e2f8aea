"""The encounter of a plan: the table that every spacecraft carries aboard, from the planned paths and the scenario's camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import radians
from typing import Any

import numpy as np

from swarm_mj.coordination.allocation.problem import Allocation
from swarm_mj.coordination.encounter import Encounter, aim_points, shown_cells, turning_angles
from swarm_mj.coordination.roles import Pictures
from swarm_mj.coordination.slewing import settling_times, slots_between
from swarm_mj.flight.observe import camera_from, criterion_from, schedule_from
from swarm_mj.io.cache import cache_folder, hash_of, load_array, store_array
from swarm_mj.mission.deployment import planned_paths
from swarm_mj.observation.observer import make_observer
from swarm_mj.typing import Array

#: Pointing error at which a planned picture still counts, of the camera's half-angle.
TOLERANCE = 0.4
#: Raise when plans are made otherwise.
PLAN_VERSION = 1


def encounter_of(plan: Any) -> Encounter:
    """What the observers of a `swarm_mj.flight.plan.Plan` can show when.

    Only the slots are kept in which anybody shows anything; others would be empty.
    """
    scenario = plan.scenario
    camera = replace(camera_from(scenario), shape="cone")
    period = scenario.control.period_s
    schedule = schedule_from(scenario, period)
    slot_s = period * schedule.ticks(round(scenario.duration_s / period)).astype(np.float64)
    r_A = planned_places(plan, slot_s)
    aims_A = aim_points(plan.region, camera, scenario.design.imaging_altitude_m)
    observer = make_observer(plan.region, camera, kind="horizon", occlusion=scenario.observation.occlusion)
    sun_A = np.array([plan.environment.C_AN(t) @ plan.environment.sun.at(t) for t in slot_s])
    try:
        shows = shown_cells(observer, criterion_from(scenario), aims_A, r_A, sun_A)
    finally:
        observer.close()
    table = settling_times(plan.controller, plan.properties, period, TOLERANCE * radians(camera.half_angle_deg))
    angle = turning_angles(aims_A, r_A, np.asarray(shows.any(axis=(1, 3))))
    some = np.flatnonzero(shows.any(axis=(0, 1, 3)))
    kept = np.arange(some[0], some[-1] + 1) if len(some) else np.arange(len(slot_s))
    return Encounter(
        slot_s=slot_s[kept],
        aims_A=aims_A,
        shows=shows[:, :, kept],
        slew=slots_between(angle, table, scenario.observation.interval_s, period).astype(np.int64),
        area=plan.region.area,
    )


def planned_places(plan: Any, times: Array) -> Array:
    """Where the observers are planned to be in A, shape (k, a, 3) [m]."""
    deployment, grid = plan.deployment, np.concatenate([[0.0], times[times > 0.0]])
    r_N = planned_paths(plan.environment.acceleration_N, deployment, grid)[0][:, : plan.n_observers]
    r_N = r_N if times[0] == 0.0 else r_N[1:]
    C_AN = np.array([plan.environment.C_AN(t) for t in times])
    places: Array = np.einsum("kab,knb->kna", C_AN, r_N)
    return places


def kept_plan(
    encounter: Encounter, time_limit_s: float, plan: Callable[[Encounter, float], Allocation]
) -> tuple[Pictures, ...]:
    """The pictures of a plan, made once and kept on disk: what a solver finds in its time may differ from run to run.

    Args:
        encounter: What can be shown.
        time_limit_s: For the plan [s].
        plan: Makes it.
    """
    agents, _, slots, _ = encounter.shows.shape
    packed = np.packbits(encounter.shows, axis=3)
    key = hash_of(f"{PLAN_VERSION} {time_limit_s:g}", packed, encounter.slew, np.round(encounter.area, 3))
    file = cache_folder() / "plans" / f"{key}.npy"
    kept = load_array(file, (agents, slots))
    if kept is None:
        kept = np.full((agents, slots), -1.0, np.float32)
        for agent, taken in enumerate(plan(encounter, time_limit_s).pictures):
            for slot, aim in taken:
                kept[agent, slot] = aim
        store_array(file, kept)
    return tuple(tuple((int(k), int(row[k])) for k in np.flatnonzero(row >= 0)) for row in kept)
