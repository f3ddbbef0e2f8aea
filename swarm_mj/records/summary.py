"""The summary of a run: one JSON object with the numbers a reader asks for first."""

from __future__ import annotations

import json
import platform
from importlib.metadata import PackageNotFoundError, version
from math import isfinite
from typing import Any

import numpy as np
import xarray as xr

from swarm_mj import __version__
from swarm_mj.flight.coordination import coordination_summary
from swarm_mj.flight.mothership import osculating_orbit
from swarm_mj.flight.observe import ObservationResult, arrival_samples, picture_samples, watching_in
from swarm_mj.flight.plan import Plan
from swarm_mj.flight.spacecraft import notes_on
from swarm_mj.records.delivered import delivered_summary
from swarm_mj.records.encounters import encounters_summary
from swarm_mj.records.formation import formation_summary
from swarm_mj.records.modes import held_s
from swarm_mj.records.navigation import navigation_summary
from swarm_mj.records.observed import mapped_by_class, not_observed
from swarm_mj.records.optical import optical_summary
from swarm_mj.records.propulsion import propulsion_summary
from swarm_mj.records.rounding import by_name, rounded, spread
from swarm_mj.scenarios.itinerary import all_targets, itinerary, target_text
from swarm_mj.simulator.telemetry import MODES
from swarm_mj.typing import Array

#: Libraries whose versions decide the numbers.
LIBRARIES = ("mujoco", "numpy", "scipy", "numba", "moderngl", "embreex", "pymoo")


def summarise(plan: Plan, telemetry: xr.Dataset, result: ObservationResult, wall_s: dict[str, float]) -> dict[str, Any]:
    """Collect the summary of a run; plain Python numbers, ready for JSON."""
    scenario = plan.scenario
    return {
        "scenario": scenario.name,
        "description": scenario.description,
        "seed": scenario.seed,
        "epoch_tdb": scenario.epoch,
        "spacecraft": plan.n,
        "observers": plan.n_observers,
        "duration_s": scenario.duration_s,
        **_observed(plan, result),
        **delivered_summary(plan, result),
        **_pointed(plan, telemetry),
        **_flown(plan, telemetry),
        **encounters_summary(plan, telemetry),
        "encounter_findings": list(plan.encounter_findings),
        **propulsion_summary(plan, telemetry),
        **navigation_summary(plan),
        **optical_summary(plan, telemetry, arrival_miss_m(plan, telemetry)),
        **_stepped(plan, telemetry),
        **_faults(plan, telemetry),
        **coordination_summary(telemetry),
        **formation_summary(telemetry),
        "link_closed_percent": by_name(plan.names, 100.0 * telemetry["link_closed"].values.mean(axis=0), 2),
        "links_closed_final": int(telemetry["link_closed"].values[-1].sum()),
        "wall_s": {stage: round(seconds, 3) for stage, seconds in wall_s.items()},
        "versions": library_versions(),
    }


def _observed(plan: Plan, result: ObservationResult) -> dict[str, Any]:
    """The target and how much of it was seen."""
    scenario, region = plan.scenario, plan.region
    return {
        "target_vertices": region.n_visiting,
        "target_faces": region.n_faces,
        "target_cells": region.n_cells,
        "target_area_km2": rounded(region.total_area / 1e6, 6),
        "visiting_points": list(scenario.design.visiting_points),
        "coverage_percent": rounded(result.coverage.percent, 6),
        "target": target_text(scenario.target),
        "target_percent_of_body": rounded(100.0 * region.total_area / float(region.mesh.face_areas.sum()), 4),
        "weighted": region.is_weighted,
        **_by_target(plan, result),
        "coverage_percent_passage": rounded(result.passage.percent, 6),
        "coverage_percent_by_spacecraft": by_name(plan.names, result.coverage.percent_by_spacecraft, 4),
        "not_observed": not_observed(region.weighted_area, result.why, coming=bool(scenario.initial_states)),
        "classes": mapped_by_class(region, result.quality),
        "criterion": scenario.observation.criterion,
        "light": scenario.observation.light,
        "camera_half_angle_deg": scenario.camera.half_angle_deg,
        "gsd_m": spread(result.kept.by_best(result.kept.gsd_m)),
        "incidence_deg": spread(result.kept.by_best(result.kept.incidence_deg)),
        **_blurred(result),
        "gsd_pixel": "picture" if scenario.camera.detector_ifov_rad is None else "detector",
        "ground_resolution_m": scenario.camera.ground_resolution_m,
        "observer": result.observer,
        "observer_note": result.note,
        "images": result.images,
    }


def _blurred(result: ObservationResult) -> dict[str, Any]:
    """Motion blur at the arrival [px], each cell in its sharpest picture; nothing where the camera has no exposure."""
    if result.motion_blur_px is None:
        return {}
    shown = result.motion_blur_px[~np.isnan(result.motion_blur_px)]
    worst = {"median": rounded(np.median(shown), 6), "max": rounded(shown.max(), 6)} if len(shown) else {}
    return {"motion_blur_px_arrival": worst}


def _by_target(plan: Plan, result: ObservationResult) -> dict[str, Any]:
    """Of several targets: area and coverage of each, and what each observer was sent to; empty where there is one."""
    region, stops = plan.region, itinerary(plan.scenario)
    found: dict[str, Any] = {}
    if region.parts:
        shares = [result.coverage.percent_of(region.cells_of(k), part.area) for k, part in enumerate(region.parts)]
        found["coverage_percent_by_target"] = [rounded(share, 6) for share in shares]
        found["weight_by_target"] = [target.weight for target in all_targets(plan.scenario)]
        found["target_area_km2_by_target"] = [rounded(part.total_area / 1e6, 6) for part in region.parts]
    if plan.scenario.design.observers or plan.scenario.design.release_s:
        found["itinerary"] = {
            name: {**stop._asdict(), "arrival_s": stop.arrival_s} for name, stop in zip(plan.names, stops, strict=False)
        }
    return found


def _pointed(plan: Plan, telemetry: xr.Dataset) -> dict[str, Any]:
    """Pointing errors at the end and around every switch, and what the wheels did."""
    names, limits = plan.names, plan.properties
    error_deg = np.degrees(telemetry["pointing_error"].values)
    found_by_name, held = mode_switches(telemetry), held_s(telemetry)
    switches = {
        name: [_switch(switch, error_deg[:, j], held[:, j]) for switch in found_by_name[name]]
        for j, name in enumerate(names)
    }
    return {
        "pointing_error_deg_final": by_name(names, error_deg[-1], 9),
        **_pointed_at_pictures(plan, telemetry, error_deg),
        "pointing_error_deg_before_switch": {
            name: max(switch["error_before_deg"] for switch in found) for name, found in switches.items() if found
        },
        "target_held_s_final": by_name(names, held[-1], 3),
        "mode_switches": switches,
        "max_wheel_speed_fraction": rounded(telemetry["wheel_speed_peak"].max() / limits.max_wheel_speed, 6),
        "max_wheel_torque_fraction": rounded(telemetry["wheel_torque_peak"].max() / limits.max_wheel_torque, 6),
        "wheel_saturation_s": by_name(names, telemetry["wheel_saturation_time"].values, 3),
    }


def _pointed_at_pictures(plan: Plan, telemetry: xr.Dataset, error_deg: Array) -> dict[str, Any]:
    """Pointing errors of those that take pictures: at the arrival, and in the middle of all their pictures; their sensors."""
    scenario, who = plan.scenario, watching_in(plan.scenario, telemetry, plan.n_observers)
    samples, arrivals = picture_samples(scenario, telemetry), arrival_samples(scenario)
    taken = {j: samples[who[samples, j]] for j in range(plan.n_observers)}
    known = telemetry.get("attitude_knowledge_error")
    at_arrival = {"pointing_error_deg_arrival": error_deg}
    at_arrival |= {} if known is None else {"attitude_knowledge_error_deg_arrival": np.degrees(known.values)}
    there = [(j, k) for j, k in enumerate(arrivals) if who[k, j]]
    median = {plan.names[j]: rounded(np.median(error_deg[k, j]), 9) for j, k in taken.items() if len(k)}
    return {
        "sensors": scenario.spacecraft.sensors.name,
        **{key: {plan.names[j]: rounded(values[k, j], 9) for j, k in there} for key, values in at_arrival.items()},
        "pointing_error_deg_pictures_median": median,
    }


def _switch(switch: dict[str, Any], error_deg: Array, held: Array) -> dict[str, Any]:
    sample = switch["sample"]
    return {
        **{key: switch[key] for key in ("time_s", "from", "to")},
        "error_before_deg": rounded(error_deg[sample - 1], 9),
        "error_after_deg": rounded(error_deg[sample], 3),
        "target_held_s": rounded(held[sample - 1], 3),
    }


def _flown(plan: Plan, telemetry: xr.Dataset) -> dict[str, Any]:
    """Deployment, trajectories and what came too close."""
    names = plan.names
    near = [
        {
            "spacecraft": [names[a.first], names[a.second]],
            "time_s": rounded(a.time, 3),
            "distance_m": rounded(a.distance, 3),
        }
        for a in plan.near_collisions
    ]
    return {
        "mothership": _mothership_orbit(plan),
        "deployer_max_speed_m_s": plan.scenario.mothership.deployer.max_speed_m_s,
        "deployment_delta_v_m_s": by_name(names, plan.deployment.delta_v, 6),
        "transfer_miss_mm": by_name(names, 1e3 * plan.deployment.miss_m, 6),
        "arrival_miss_mm": by_name(names, 1e3 * arrival_miss_m(plan, telemetry), 6),
        "least_distance_to_centre_km": by_name(names, plan.least_radius / 1e3, 3),
        "near_collisions": near,
    }


def _mothership_orbit(plan: Plan) -> dict[str, Any]:
    """How the mothership comes, to twelve digits and a micrometre: what is behind them is noise."""
    deployment = plan.deployment
    found = osculating_orbit(plan.scenario, plan.environment, deployment.r0_N, deployment.mothership_velocity_N)
    return {key: _without_noise(value, 6 if key.endswith("_m") else 12) for key, value in found.items()}


def _without_noise(value: Any, decimals: int) -> Any:
    if not isinstance(value, float):
        return value
    return round(float(f"{value:.12g}"), decimals) + 0.0 if isfinite(value) else None


def _stepped(plan: Plan, telemetry: xr.Dataset) -> dict[str, Any]:
    """How the flight was stepped and why, and what a reader of a spacecraft's own file should know."""
    own = plan.own
    return {
        "stepper": telemetry.attrs.get("stepper", ""),
        "spacecraft_file": None if own is None else str(own.path),
        "spacecraft_notes": [] if own is None else notes_on(plan.scenario, own),
    }


def _faults(plan: Plan, telemetry: xr.Dataset) -> dict[str, Any]:
    """Faults and what followed, in order of time, and who no longer worked at the end."""
    names, works = plan.names, telemetry.get("operational")
    return {
        "events": json.loads(telemetry.attrs.get("events", "[]")),
        "lost": [] if works is None else [name for name, on in zip(names, works.values[-1], strict=True) if not on],
    }


def working(summary: dict[str, Any], key: str) -> dict[str, Any]:
    """What a summary tells of each spacecraft, without those that no longer work at the end."""
    return {name: value for name, value in summary[key].items() if name not in summary.get("lost", ())}


def mode_switches(telemetry: xr.Dataset) -> dict[str, list[dict[str, Any]]]:
    """Every change of target after the release: per spacecraft a list of sample, time and the two modes."""
    mode, times = telemetry["mode"].values, telemetry["time"].values
    tracked = telemetry["tracked_spacecraft"].values
    changed = (np.diff(mode, axis=0) != 0) | (np.diff(tracked, axis=0) != 0)
    if "released" in telemetry:
        changed &= telemetry["released"].values[:-1] == 1

    def switch(j: int, k: int) -> dict[str, Any]:
        return {"sample": k, "time_s": float(times[k]), "from": MODES[mode[k - 1, j]], "to": MODES[mode[k, j]]}

    names = map(str, telemetry["spacecraft"].values)
    return {name: [switch(j, int(k) + 1) for k in np.flatnonzero(changed[:, j])] for j, name in enumerate(names)}


def library_versions() -> dict[str, str]:
    """Versions of this program, of Python and of the libraries that decide the numbers."""
    return {
        "swarm_mj": __version__,
        "python": platform.python_version(),
        **{name: _version(name) for name in LIBRARIES},
    }


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # embreex has no wheels for some machines
        return "not installed"


def arrival_miss_m(plan: Plan, telemetry: xr.Dataset) -> Array:
    """Distance of each spacecraft, as flown, from where it was to be at its arrival [m], shape (n,)."""
    arrivals = np.rint(plan.deployment.arrival_s / plan.scenario.telemetry.interval_s).astype(np.int64)
    flown = telemetry["r_BN_N"].values[arrivals, np.arange(plan.n)]
    return np.asarray(np.linalg.norm(flown - plan.deployment.destination_N, axis=-1))
