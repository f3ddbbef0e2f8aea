"""What navigation by pictures came to in a flight, as numbers and sentences."""

from __future__ import annotations

import json
from collections import Counter
from typing import Any

import numpy as np
import xarray as xr

from swarm_mj.flight.observe import arrival_samples
from swarm_mj.flight.plan import Plan
from swarm_mj.records.rounding import by_name, rounded
from swarm_mj.simulator.telemetry import longest_sigma, position_covariance
from swarm_mj.typing import Array

#: Share of the camera's half-angle from which an error of aim at the arrival is worth a remark.
AIM_SHARE = 0.1
#: Reasons why pictures were not used that are told one by one.
MOST_REASONS = 3

Row = dict[str, Any]


def optical_summary(plan: Plan, telemetry: xr.Dataset, miss_m: Array) -> Row:
    """For summary.json where there was navigation by pictures; `miss_m` at the arrivals, shape (n,)."""
    if "r_BN_N_estimate" not in telemetry:
        return {}
    records: list[Row] = json.loads(telemetry.attrs.get("navigation", "[]"))
    used = [one for one in records if not one["why"]]
    off, arrivals, n = _errors(telemetry), arrival_samples(plan.scenario), plan.n_observers
    at = arrivals, np.arange(n)
    distance = np.linalg.norm(telemetry["r_BN_N"].values[at], axis=-1)
    aim_deg = np.degrees(_across(off[at], telemetry["r_BN_N"].values[at]) / distance)
    P = position_covariance(telemetry)
    sigma = longest_sigma(telemetry)
    # What is kept of correlations may be rounded to one.
    nees = np.einsum("jk,jkl,jl->j", off[at], np.linalg.pinv(P[at], hermitian=True), off[at])
    dof = sum(one["dof"] for one in used)
    found = {
        "used": dict(Counter(one["kind"] for one in used)),
        "not_used": [
            {"why": why, "count": count}
            for why, count in Counter(one["why"] for one in records if one["why"]).most_common()
        ],
        "position_error_m_arrival": by_name(plan.names[:n], np.linalg.norm(off[at], axis=-1), 3),
        "position_3_sigma_m_arrival": by_name(plan.names[:n], 3.0 * sigma[at], 3),
        "nees_per_component_arrival": by_name(plan.names[:n], nees / 3.0, 4),
        "aim_error_deg_arrival": by_name(plan.names[:n], aim_deg, 6),
        "position_error_m_largest": rounded(float(np.linalg.norm(off, axis=-1).max()), 3),
        "nis_per_component": rounded(sum(one["nis"] for one in used) / dof, 4) if dof else None,
    }
    return {"optical": {**found, "findings": [*_findings(plan, found, records), *_corrected(plan, miss_m)]}}


def _corrected(plan: Plan, miss_m: Array) -> list[str]:
    """What corrections left that go by pictures."""
    if not plan.scenario.trajectory.corrections:
        return []
    worst = int(miss_m.argmax())
    return [
        f"corrections went by what pictures tell, not by navigation.position_m: at its arrival {plan.names[worst]} is "
        f"{miss_m[worst]:.3g} m off, the farthest; what to expect beforehand: swarm-mj navigate --optical"
    ]


def _errors(telemetry: xr.Dataset) -> Array:
    found: Array = telemetry["r_BN_N_estimate"].values - telemetry["r_BN_N"].values
    return found


def _across(off: Array, r: Array) -> Array:
    """Length of errors across the line of sight to the body [m], shape (n,)."""
    towards = r / np.linalg.norm(r, axis=-1, keepdims=True)
    return np.linalg.norm(off - np.einsum("nk,nk->n", off, towards)[:, None] * towards, axis=-1)


def _findings(plan: Plan, found: Row, records: list[Row]) -> list[str]:
    """What a reader should know, one sentence each; where knowledge is too poor, what to change."""
    used = sum(found["used"].values())
    if not used:
        why = _reasons(found)
        words = (
            f"navigation by pictures: none of {len(records)} told anything, all was flown by the first knowledge; {why}"
        )
        if not any("saturated" in one["why"] for one in found["not_used"]):
            words += "; begin with better knowledge (navigation.optical.initial_position_m), with a wider camera, or in other "
            words += "light"
        return [words, *_aimed_off(plan, found, [])]
    ways = ", ".join(f"{count} by {way}" for way, count in found["used"].items() if way != "range")
    counts = [f"{_used(records, ranges=False)} pictures were used{f' ({ways})' if ways else ''}"]
    counts += [f"{_used(records, ranges=True)} ranges"] if any(one["kind"] == "range" for one in records) else []
    errors, sigmas = (found[key] for key in ("position_error_m_arrival", "position_3_sigma_m_arrival"))
    said = [
        f"navigation by pictures: {' and '.join(counts)}; positions at the arrivals err by up to "
        f"{max(errors.values()):.3g} m, 3 sigma up to {max(sigmas.values()):.3g} m; stars, stray light and terrain finer "
        "than the mesh are left out"
    ]
    if len(records) > used:
        said[0] += f"; not used: {_reasons(found)}"
    far = [f"{name} by {errors[name]:.3g} m of {sigmas[name]:.3g} m" for name in errors if errors[name] > sigmas[name]]
    if far:
        said.append(f"positions at the arrivals err by more than their 3 sigma: {', '.join(far)}")
    return said + _aimed_off(plan, found, records)


def _used(records: list[Row], *, ranges: bool) -> str:
    kind = [one for one in records if (one["kind"] == "range") == ranges]
    return f"{sum(not one['why'] for one in kind)} of {len(kind)}"


def _aimed_off(plan: Plan, found: Row, records: list[Row]) -> list[str]:
    """Who aimed off by more than a share of the field of view, and what to change; `records` empty: that was said."""
    limit = AIM_SHARE * plan.scenario.camera.half_angle_deg
    late = {name: value for name, value in found["aim_error_deg_arrival"].items() if value > limit}
    if not late:
        return []
    worst = max(late, key=late.__getitem__)
    remedy = f"; {_remedy(plan, found, worst, records)}" if records else ""
    return [
        f"navigation by pictures is too poor for the camera: {', '.join(late)} aimed off at the arrival, {worst} by "
        f"{late[worst]:.3g} deg of camera.half_angle_deg = {plan.scenario.camera.half_angle_deg:g}{remedy}"
    ]


def _reasons(found: Row) -> str:
    told = [f"{one['count']} for {one['why']}" for one in found["not_used"][:MOST_REASONS]]
    others = sum(one["count"] for one in found["not_used"][MOST_REASONS:])
    return "; ".join([*told, *([f"{others} for other reasons (summary.json)"] if others else [])])


def _remedy(plan: Plan, found: Row, worst: str, records: list[Row]) -> str:
    """Which instrument to change, by what limits the knowledge of the one that aimed off the most."""
    asked, sensors = plan.scenario.navigation.optical, plan.scenario.spacecraft.sensors
    if found["not_used"] and "saturated" in found["not_used"][0]["why"]:
        return "most pictures were saturated, see above"
    own = [one for one in records if one["spacecraft"] == worst and one["kind"] != "range"]
    if all(one["why"] for one in own):
        return (
            f"none of its {len(own)} pictures told anything: begin with better knowledge "
            "(navigation.optical.initial_position_m), or with a wider camera"
        )
    pixel_arcsec = 3600.0 * np.degrees(2.0 * np.tan(np.radians(plan.scenario.camera.half_angle_deg)))
    pixel_arcsec /= plan.scenario.camera.resolution_px
    if sensors.star_tracker_bias_arcsec > pixel_arcsec:
        return (
            f"the star tracker is mounted less exactly ({sensors.star_tracker_bias_arcsec:g} arcsec) than the camera resolves "
            f"({pixel_arcsec:.3g} arcsec): calibrate it (spacecraft.sensors.star_tracker_bias_arcsec)"
        )
    if asked.range_m is None and set(found["used"]) <= {"centroid"}:
        return (
            "far away directions alone are seen, not distances: range between spacecraft (navigation.optical.range_m), or take "
            "pictures nearer (interval_share)"
        )
    return "take pictures more often (navigation.optical.interval_share, interval_s), or with a finer camera"
