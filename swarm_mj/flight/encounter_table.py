"""The encounter of a plan: the table that every spacecraft carries aboard, from the planned paths and the scenario's camera."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import radians
from typing import Any, NamedTuple

import numpy as np

from swarm_mj.coordination.allocation.problem import Schedule
from swarm_mj.coordination.encounter import (
    Encounter,
    Track,
    aim_points,
    settling_times,
    shown_cells,
    slots_between,
    turning_angles,
)
from swarm_mj.coordination.replanning import planned_alone, planned_together
from swarm_mj.flight.observe import camera_from, schedule_from
from swarm_mj.io.cache import cache_folder, hash_of, load_array, store_array
from swarm_mj.mission.deployment import planned_paths
from swarm_mj.observation.observer import make_observer
from swarm_mj.typing import Array

#: Pointing error at which a planned picture still counts, of the camera's half-angle.
TOLERANCE = 0.4
#: Raise when plans are made otherwise.
PLAN_VERSION = 1


class _Made(NamedTuple):
    """A table and what it was made from."""

    parts: tuple[Any, ...]
    settings: str
    encounter: Encounter


#: Tables of the last plans, newest last: a campaign flies the same plan again and again.
_MADE: list[_Made] = []
MOST_MADE = 16


def encounter_of(plan: Any) -> Encounter:
    """What the observers of a `swarm_mj.flight.plan.Plan` can show when; made once for a plan that is flown again.

    Only the slots are kept in which anybody shows anything; others would be empty.
    """
    scenario = plan.scenario
    parts = (plan.deployment, plan.region, plan.environment, plan.controller, plan.properties)
    sections = (scenario.camera, scenario.observation, scenario.control, scenario.design)
    settings = f"{scenario.duration_s} {[section.model_dump_json() for section in sections]}"
    for made in _MADE:
        if made.settings == settings and all(a is b for a, b in zip(made.parts, parts, strict=True)):
            return made.encounter
    encounter = _made(plan)
    _MADE[:] = [*_MADE[1 - MOST_MADE :], _Made(parts, settings, encounter)]
    return encounter


def _made(plan: Any) -> Encounter:
    scenario = plan.scenario
    camera = replace(camera_from(scenario), shape="cone")
    period = scenario.control.period_s
    schedule = schedule_from(scenario, period)
    slot_s = period * schedule.ticks(round(scenario.duration_s / period)).astype(np.float64)
    track = track_of(plan, slot_s)
    takers = np.array([schedule.takers(round(t / period), plan.n)[: plan.n_observers] for t in slot_s])
    track = track._replace(free=track.free & takers)
    aims_A = aim_points(plan.region, camera, scenario.design.imaging_altitude_m)
    observer = make_observer(plan.region, camera, kind="horizon", occlusion=scenario.observation.occlusion)
    try:
        shows = shown_cells(observer, scenario.observation, aims_A, track)
    finally:
        observer.close()
    table = settling_times(plan.controller, plan.properties, period, TOLERANCE * radians(camera.half_angle_deg))
    angle = turning_angles(aims_A, track.r_A, np.asarray(shows.any(axis=(1, 3))))
    useful = np.flatnonzero(shows.any(axis=(0, 1, 3)))
    kept = np.arange(useful[0], useful[-1] + 1) if len(useful) else np.arange(len(slot_s))
    return Encounter(
        slot_s=slot_s[kept],
        aims_A=aims_A,
        shows=shows[:, :, kept],
        slew=slots_between(angle, table, scenario.observation.interval_s, period).astype(np.int64),
        area=plan.region.weighted_area,
        interval_s=scenario.observation.interval_s,
    )


def track_of(plan: Any, times: Array) -> Track:
    """Where a plan's observers will be at rising times past the epoch [s], shape (k,), releases and burns included."""
    environment, deployment, a = plan.environment, plan.deployment, plan.n_observers
    grid = np.concatenate([[0.0], times[times > 0.0]])
    states = planned_paths(environment.acceleration_N, deployment, grid)
    r_N, v_N = (state[len(grid) - len(times) :, :a] for state in states)
    C_AN = np.array([environment.C_AN(t) for t in times])
    v_N = v_N - np.cross(environment.spin_N, r_N)
    return Track(
        r_A=np.einsum("kij,knj->kni", C_AN, r_N),
        v_A=np.einsum("kij,knj->kni", C_AN, v_N),
        free=times[:, None] >= deployment.release_s[:a],
        sun_A=np.array([C @ environment.sun.at(t) for C, t in zip(C_AN, times, strict=True)]),
    )


@lru_cache(maxsize=MOST_MADE)
def alone(encounter: Encounter) -> tuple[Schedule, ...]:
    """The pictures of `planned_alone`."""
    return planned_alone(encounter).pictures


@lru_cache(maxsize=MOST_MADE)
def together(encounter: Encounter, time_limit_s: float) -> tuple[Schedule, ...]:
    """The pictures of `planned_together`, kept on disk: what a solver finds in its time may differ from run to run."""
    agents, _, slots, _ = encounter.shows.shape
    packed = np.packbits(encounter.shows, axis=3)
    key = hash_of(f"{PLAN_VERSION} {time_limit_s:g}", packed, encounter.slew, np.round(encounter.area, 3))
    file = cache_folder() / "plans" / f"{key}.npy"
    kept = load_array(file, (agents, slots))
    if kept is None:
        kept = np.full((agents, slots), -1.0, np.float32)
        for agent, taken in enumerate(planned_together(encounter, time_limit_s).pictures):
            for slot, aim in taken:
                kept[agent, slot] = aim
        store_array(file, kept)
    return tuple(tuple((int(k), int(row[k])) for k in np.flatnonzero(row >= 0)) for row in kept)
