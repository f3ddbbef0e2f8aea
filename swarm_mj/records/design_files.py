"""The files of a design: design.json, sightings.npz and pictures; and for which runs a design's proof holds."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from swarm_mj.designer.candidates.visibility import Visibility
from swarm_mj.designer.class_problem import ClassProblem
from swarm_mj.designer.deadline import HOUR
from swarm_mj.designer.robust import Level
from swarm_mj.designer.study import Growth, Study, describe
from swarm_mj.io.atomic import write_text
from swarm_mj.io.records import read_record
from swarm_mj.records.run_record import read_scenario
from swarm_mj.records.summary import library_versions
from swarm_mj.records.summary_schema import GrowthRow
from swarm_mj.scenarios.design_record import DesignRecord
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.smallbody.shape_check import shown_size
from swarm_mj.typing import Array, Ints

if TYPE_CHECKING:
    from swarm_mj.designer.genetic import GeneticResult

#: What decides where the candidates fly, how they are turned and how the body moves beneath them, besides its mesh. How
#: finely the target's area is measured is left out, and so is what moves a flight by less than a metre.
DECIDING = {
    "body": ("gravity", "rotation", "orbit"),
    "target": (
        "region",
        "polygon",
        "polygon_file",
        "lit_at",
        "latitude_deg",
        "longitude_deg",
        "half_angle_deg",
        "edges",
    ),
    "design": ("imaging_altitude_m", "projection", "time_of_flight_s", "release_s", "aim"),
    "mothership": ("position_A_m", "velocity", "approach", "elements", "ephemeris"),
    "behavior": ("name", "parameters", "imaging_radius_m"),
}
#: Powers of a length in the keys that tell a mesh from another, whatever its file is called.
MESH_KEYS = {"body.volume_m3": 3, "body.area_m2": 2}
#: Largest relative difference of the volumes and areas of one mesh, once in double and once in single precision.
SAME_MESH = 1e-5
#: Behaviours whose observers look at the body's centre inside the imaging radius, and so see the same.
ALIKE = {"dedicated_communications", "adaptable_roles"}
#: Parts of `observation` and `camera` that do not change what a candidate sees, or hardly.
SEEN_ALIKE = ("classes", "observer", "interval_s", "resolution_px", "ground_resolution_m", "aperture_m", "wavelength_m")
#: Farthest that a visiting point may lie from the design's, as a fraction of the imaging altitude.
SAME_POINT = 1e-3
#: What a level says of its design's probability.
PROMISES = ("sought", "promised", "low", "high")
#: What to do about a file of a design that cannot be read.
REMEDY = "make the design again with `swarm-mj design`"


def design_record(study: Study) -> dict[str, Any]:
    """A design as plain numbers, ready for JSON; `visiting_points` is what a scenario's `design.reference` reads."""
    scenario, seen, exact = study.scenario, study.visibility, study.exact
    chosen = [seen.candidates[p - 1] for p in study.selected]
    return {
        "scenario": scenario.name,
        "n_observers": len(chosen),
        "visiting_points": [candidate.point for candidate in chosen],
        "gene_map": [len(chosen), *(int(p) for p in study.selected)],
        "observers": study.observers,
        "candidates": [describe(candidate, seen) for candidate in chosen],
        "visiting_points_A_m": [[round(float(x), 3) for x in seen.point_A[p - 1]] for p in study.selected],
        "delta_v_m_s": [round(float(seen.delta_v[p - 1]), 6) for p in study.selected],
        "b_plane": [_b_plane_record(seen.b_plane[p - 1]) for p in study.selected],
        "deployer_max_speed_m_s": scenario.mothership.deployer.max_speed_m_s,
        "beyond_deployer": int(study.problem.avoided[study.selected - 1].sum()),
        "covered_percent": round(study.problem.covered_percent(study.selected), 6),
        "selected_by": study.selected_by,
        "proof": {
            "minimum": exact.n_observers,
            "lower_bound": exact.bound,
            "status": exact.status,
            "visiting_points": [int(p) for p in exact.points],
            "covered_percent": round(exact.covered_percent, 6),
            "seconds": round(exact.seconds, 3),
        },
        "gap": study.gap,
        "genetic": {name: _genetic_record(result) for name, result in study.genetic.items()},
        **_class_record(study),
        "tolerance_percent": scenario.designer.tolerance_percent,
        "fold": scenario.designer.fold,
        "any_roll": scenario.designer.any_roll,
        "criterion": scenario.observation.model_dump(mode="json"),
        "camera": scenario.camera.model_dump(mode="json"),
        "made_for": made_for(scenario, seen.region.mesh.vertices[seen.region.mesh.faces]),
        "candidates_count": len(seen.candidates),
        "candidates_left_out": [
            {"candidate": describe(candidate, seen), "why": why} for candidate, why in seen.left_out
        ],
        "candidates_thinned": len(seen.thinned),
        "interrupted": study.interrupted or None,
        "candidates_unjudged": seen.unjudged,
        "target_faces": seen.region.n_faces,
        "target_cells": len(seen.area),
        **_delivery_record(study),
        **_certainty_record(study),
        "seed": scenario.seed,
        "wall_s": {name: round(seconds, 3) for name, seconds in study.wall_s.items()},
        "versions": library_versions(),
    }


def _b_plane_record(of: Array) -> dict[str, float | None]:
    """B.T and B.R [m] and the speed on the asymptote [m/s] of a path; None where it has none."""
    names = ("b_t_m", "b_r_m", "v_infinity_m_s")
    return {name: round(float(x), 6) if np.isfinite(x) else None for name, x in zip(names, of, strict=True)}


def _class_record(study: Study) -> dict[str, Any]:
    """The quality class that was designed for, and what no set of candidates maps; empty where none was asked for."""
    quality_class, problem = study.scenario.designed_class, study.problem
    if quality_class is None or not isinstance(problem, ClassProblem):
        return {}
    return {
        "quality_class": quality_class.model_dump(mode="json"),
        "seen_percent": round(_seen_percent(study), 6),
        "mappable_percent": round(problem.coverable_percent, 6),
        "not_mappable": {words: round(share, 6) for words, share in problem.causes().items()},
    }


def _seen_percent(study: Study) -> float:
    """Share of the target that the selected design sees, at whatever quality [%]."""
    seen = study.visibility
    return float(100.0 * seen.area[seen.sees[study.selected - 1].any(axis=0)].sum() / seen.area.sum())


def _delivery_record(study: Study) -> dict[str, Any]:
    """When designs are on Earth; empty where that was not asked for."""
    deadline = study.deadline
    if deadline is None:
        return {}
    evolved = {name: result.points for name, result in study.genetic.items()}
    return {
        "deliver_within_h": study.scenario.designer.deliver_within_h,
        "delivered_by_h": _delivered_by_h(study, study.selected),
        "delivery_checked": deadline.known(study.selected) is not None,
        "delivered_in_time": study.in_time(study.selected),
        "genetic_delivered_by_h": {name: _delivered_by_h(study, points) for name, points in evolved.items()},
        "genetic_delivered_in_time": {name: study.in_time(points) for name, points in evolved.items()},
        "delivery_bound_h": _hours(deadline.needs.soonest_s()),
        "designs_flown": len(deadline.arrivals),
        "delivery_cuts": len(deadline.cuts),
    }


def _certainty_record(study: Study) -> dict[str, Any]:
    """What probabilities cost, and what a campaign says of the promise; empty where no probability was asked for."""
    if not study.certainty:
        return {}
    verified, designer = study.verified, study.scenario.designer
    return {
        "probability": designer.probability,
        "nominal_minimum": None if study.nominal is None else study.nominal.n_observers,
        "realisations": designer.realisations,
        "check_flights": designer.check_flights if designer.realisations else 0,
        "certainty": [_level_record(level) for level in study.certainty],
        "verified": None if verified is None else {**verified._asdict(), "inside": verified.inside},
    }


def _level_record(level: Level) -> dict[str, Any]:
    return {
        "probability": level.asked,
        "n_observers": None if level.points is None else len(level.points),
        "lower_bound": level.bound,
        "candidates": [] if level.points is None else [int(p) for p in level.points],
        "refused": level.refused,
        **{name: None if np.isnan(value := getattr(level, name)) else round(value, 6) for name in PROMISES},
    }


def _delivered_by_h(study: Study, points: Ints) -> float | None:
    arrival = None if study.deadline is None else study.deadline.known(points)
    return None if arrival is None else _hours(arrival.full_s)


def _hours(seconds: float) -> float | None:
    return round(seconds / HOUR, 6) if np.isfinite(seconds) else None


def left_out_words(seen: Visibility) -> str:
    """How many candidates nobody can fly to, and why; and how many need not be judged. Empty: none is left out."""
    counts = Counter(why for _, why in seen.left_out)
    if seen.thinned:
        counts["seeing no more than others, before their pictures were judged (designer.thin_from)"] = len(seen.thinned)
    reasons = ", ".join(f"{count} {why}" for why, count in counts.most_common())
    total = counts.total()
    return f"{total} of {len(seen.candidates) + total} candidates are left out: {reasons}" if total else ""


def made_for(scenario: Scenario, corners_A: Array) -> dict[str, Any]:
    """What decides a scenario's candidates, by dotted key; `corners_A`: the body's faces in A [m], shape (f, 3, 3)."""
    a, b, c = np.moveaxis(np.asarray(corners_A, dtype=np.float64), 1, 0)
    normals = np.cross(b - a, c - a)
    data = scenario.model_dump(mode="json")
    found: dict[str, Any] = {
        "body.volume_m3": float(np.einsum("fi,fi->", a, normals) / 6.0),
        "body.area_m2": float(np.linalg.norm(normals, axis=1).sum() / 2.0),
        "epoch": data["epoch"],
        "duration_s": data["duration_s"],
    }
    for section, keys in DECIDING.items():
        for key in keys:
            value = data[section][key]
            inner = value if isinstance(value, dict) and key != "parameters" else {"": value}
            found |= {f"{section}.{key}.{name}".rstrip("."): part for name, part in inner.items()}
    return found


def design_differences(
    record: dict[str, Any], scenario: Scenario, corners_A: Array, points_A: Array | None = None
) -> list[str]:
    """How a run differs from what a design was made for, in words; what the record does not tell is not compared.

    Args:
        record: The design, from `design_record` or an earlier version of it.
        scenario: What was flown.
        corners_A: Faces of the body that was flown past in A [m], shape (f, 3, 3).
        points_A: Where the observers were at the arrival, in A [m], shape (n_obs, 3); None where that is not the plan.
    """
    there, here = record.get("made_for", {}), made_for(scenario, corners_A)
    found = []
    for key in here.keys() & there.keys() - _without_effect(scenario, there):
        if (power := MESH_KEYS.get(key)) is not None:
            if not np.isclose(there[key], here[key], rtol=SAME_MESH, atol=0.0):
                sizes = shown_size(there[key], power), shown_size(here[key], power)
                found.append(f"{key.rpartition('_')[0]}: {sizes[0]} there, {sizes[1]} here")
        elif there[key] != here[key]:
            found.append(f"{key}: {there[key]} there, {here[key]} here")
    return [*_seeing_differences(record, scenario), *sorted(found), *_point_differences(record, scenario, points_A)]


def _without_effect(scenario: Scenario, there: dict[str, Any]) -> set[str]:
    """Keys that do not matter to what the candidates of this scenario see."""
    observation = scenario.observation
    keys = set()
    if observation.criterion == "arrival":
        keys |= {"duration_s", "body.gravity.model", "body.gravity.parameters"}
    if not observation.needs_sun:
        keys |= {key for key in there if key.startswith("body.orbit.")}
    if {scenario.behavior.name, there.get("behavior.name")} <= ALIKE:
        keys |= {"behavior.name", "behavior.parameters"}
    return keys


def _seeing_differences(record: dict[str, Any], scenario: Scenario) -> list[str]:
    return [
        f"{section}.{key}: {record[part][key]} there, {value} here"
        for part, section in (("criterion", "observation"), ("camera", "camera"))
        for key, value in getattr(scenario, section).model_dump(mode="json").items()
        if key in record.get(part, {}) and record[part][key] != value and key not in SEEN_ALIKE
    ]


def _point_differences(record: dict[str, Any], scenario: Scenario, points_A: Array | None) -> list[str]:
    there = np.array(record.get("visiting_points_A_m", []), dtype=np.float64)
    if points_A is None or there.shape != np.shape(points_A):
        return []
    farthest = float(np.linalg.norm(there - points_A, axis=1).max())
    if farthest <= SAME_POINT * scenario.design.imaging_altitude_m:
        return []
    return [f"its visiting points lie elsewhere, up to {shown_size(farthest, 1)} away"]


def _genetic_record(result: GeneticResult) -> dict[str, Any]:
    return {
        "n_observers": result.n_observers,
        "gene_map": [int(g) for g in result.genes],
        "feasible": bool(result.feasible),
        "covered_percent": round(result.covered_percent, 6),
        "generations": result.generations,
        "designs_explored": result.explored,
        "stopped_by": result.stopped_by,
        "seconds": round(result.seconds, 3),
    }


def write_design(folder: Path, study: Study) -> dict[str, Any]:
    """Write everything but the pictures; returns the record in design.json."""
    seen = study.visibility
    arrays = {
        "sees": seen.sees,
        "area": seen.area,
        "delta_v": seen.delta_v,
        "candidates": np.array([c[:5] for c in seen.candidates]),
        "b_plane": seen.b_plane,
    }
    arrays |= {f"history_{name}": np.column_stack(result.history) for name, result in study.genetic.items()}
    np.savez_compressed(folder / "sightings.npz", **arrays)  # type: ignore[arg-type]
    write_text(folder / "scenario.yaml", yaml.safe_dump(study.scenario.model_dump(mode="json"), sort_keys=False))
    if study.front is not None:
        write_text(folder / "pareto.json", json.dumps(_front_record(study), indent=2) + "\n")
    record = design_record(study)
    for name in ("design.json", "summary.json"):  # a result folder is known by its summary
        write_text(folder / name, json.dumps(record, indent=2) + "\n")
    return record


def _front_record(study: Study) -> list[dict[str, Any]]:
    front = study.front
    assert front is not None
    rows = zip(front.n_observers, front.delta_v, front.uncovered_percent, front.points, strict=True)
    return [
        {
            "n_observers": int(n),
            "delta_v_m_s": round(float(delta_v), 6),
            "covered_percent": round(100.0 - float(missing), 6),
            "visiting_points": [int(p) for p in points],
        }
        for n, delta_v, missing, points in rows
    ]


def write_growth(folder: Path, rows: Sequence[Growth]) -> None:
    """Write the proven minimum under each extension as JSON."""
    write_text(folder / "growth.json", json.dumps([row._asdict() for row in rows], indent=2) + "\n")


def read_design_folder(folder: Path) -> tuple[Scenario, dict[str, Any], list[Growth]]:
    """The scenario of a design, its record, and the proven minimum under each extension where that was asked for.

    Raises:
        OutputError: The folder holds no finished design, or a file in it cannot be read.
    """
    record = read_record(folder / "design.json", DesignRecord, REMEDY)
    compared = folder / "growth.json"
    rows = read_record(compared, list[GrowthRow], REMEDY) if os.path.lexists(compared) else []
    growth = [Growth(row["change"], row["n_observers"], row["note"]) for row in rows]
    return read_scenario(folder / "scenario.yaml"), record, growth
