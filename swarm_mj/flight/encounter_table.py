"""The encounter of a plan: the table that every spacecraft carries aboard, from the planned paths and the scenario's camera."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import radians
from typing import Any, NamedTuple

import numpy as np

from swarm_mj.coordination.allocation.problem import Allocation, Schedule, allocation_of
from swarm_mj.coordination.encounter import (
    Encounter,
    Track,
    aim_points,
    reach_of,
    settling_times,
    shown_cells,
    slots_between,
    turning_angles,
)
from swarm_mj.coordination.replanning import planned_alone, planned_together, problem_of
from swarm_mj.flight.observe import camera_from, schedule_from
from swarm_mj.flight.refusals import refuse_sequence
from swarm_mj.io.cache import cache_folder, hash_of, load_array, store_array
from swarm_mj.mission.deployment import planned_paths
from swarm_mj.observation.observer import make_observer
from swarm_mj.typing import Array

#: Pointing error at which a planned picture still counts, of the camera's half-angle.
TOLERANCE = 0.4
#: Raise when plans are made otherwise.
PLAN_VERSION = 2
#: Relative difference of value and bound that counts as none: bounds are kept in single precision.
PROVEN = 1e-6


class _Made(NamedTuple):
    """A table and what it was made from."""

    parts: tuple[Any, ...]
    settings: str
    encounter: Encounter


#: Tables of the last plans, newest last: a campaign flies the same plan again and again.
_MADE: list[_Made] = []
MOST_MADE = 16


def encounter_of(plan: Any, tolerance: float = TOLERANCE) -> Encounter:
    """What the observers of a `swarm_mj.flight.plan.Plan` can show when; made once for a plan that is flown again.

    Only the slots are kept in which anybody shows anything; others would be empty. A slew lasts until the pointing error is
    below `tolerance` of the camera's half-angle.
    """
    scenario = plan.scenario
    refuse_sequence(scenario, f"a swarm that plans its pictures (behavior.name = {scenario.behavior.name})")
    parts = (plan.deployment, plan.region, plan.environment, plan.controller, plan.properties)
    sections = (scenario.camera, scenario.observation, scenario.control, scenario.design)
    settings = f"{tolerance} {scenario.duration_s} {[section.model_dump_json() for section in sections]}"
    for made in _MADE:
        if made.settings == settings and all(a is b for a, b in zip(made.parts, parts, strict=True)):
            return made.encounter
    encounter = _made(plan, tolerance)
    _MADE[:] = [*_MADE[1 - MOST_MADE :], _Made(parts, settings, encounter)]
    return encounter


def _made(plan: Any, tolerance: float) -> Encounter:
    scenario = plan.scenario
    camera = camera_from(scenario).inscribed_cone
    period = scenario.control.period_s
    schedule = schedule_from(scenario, period)
    slot_s = period * schedule.ticks(round(scenario.duration_s / period)).astype(np.float64)
    track = track_of(plan, slot_s)
    takers = np.array([schedule.takers(round(t / period), plan.n)[: plan.n_observers] for t in slot_s])
    track = track._replace(free=track.free & takers)
    reach = reach_of(plan.region, scenario.observation, camera, track)
    slots = np.flatnonzero(reach.useful.any(axis=1))
    kept = np.arange(slots[0], slots[-1] + 1) if len(slots) else np.arange(len(slot_s))
    track, slot_s = Track(track.r_A[kept], track.v_A[kept], track.free[kept], track.sun_A[kept]), slot_s[kept]
    reach = reach._replace(useful=reach.useful[kept])
    aims_A, spacing = aim_points(plan.region, camera, reach)
    observer = make_observer(plan.region, camera, kind="horizon", occlusion=scenario.observation.occlusion)
    try:
        shows = shown_cells(observer, scenario.observation, aims_A, track, reach)
    finally:
        observer.close()
    table = settling_times(plan.controller, plan.properties, period, tolerance * radians(camera.half_angle_deg))
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
        spacing=spacing,
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
def together(
    encounter: Encounter, time_limit_s: float, budget: tuple[int, ...] | None = None, most: int | None = None
) -> Allocation:
    """`planned_together`, kept on disk: what a solver finds in its time may differ from run to run.

    Most pictures of each, `budget`, and of all together, `most`: None for any number.
    """
    problem = problem_of(encounter, budget=budget, most=most)
    packed = np.packbits(encounter.shows, axis=3)
    text = f"{PLAN_VERSION} {time_limit_s:g} {budget} {most}"
    key = hash_of(text, packed, encounter.slew, np.round(encounter.area, 3))
    file, shape = cache_folder() / "plans" / f"{key}.npy", (problem.n_agents + 1, problem.n_slots)
    kept = load_array(file, shape)
    if kept is None:
        kept, found = np.full(shape, -1.0, np.float32), planned_together(problem, time_limit_s)
        for agent, taken in enumerate(found.pictures):
            for slot, aim in taken:
                kept[agent, slot] = aim
        kept[-1, 0] = np.nextafter(np.float32(found.bound / problem.coverable), np.float32(1.0))
        store_array(file, kept)
    rows = (tuple((int(k), int(row[k])) for k in np.flatnonzero(row >= 0)) for row in kept[:-1])
    found = allocation_of(problem, tuple(rows), "time limit")
    bound = max(float(kept[-1, 0]) * problem.coverable, found.value)
    return replace(found, bound=bound, status="optimal" if found.value >= bound * (1.0 - PROVEN) else "time limit")
