"""The files of a design: design.json, sightings.npz and pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from swarm_mj.design.genetic import GeneticResult
from swarm_mj.designer import Growth, Study, describe
from swarm_mj.output.folder import write_text
from swarm_mj.output.summary import library_versions


def design_record(study: Study) -> dict[str, Any]:
    """A design as plain numbers, ready for JSON; `visiting_points` is what a scenario's `design.reference` reads."""
    scenario, seen, exact = study.scenario, study.sightings, study.exact
    chosen = [seen.candidates[p - 1] for p in study.selected]
    return {
        "scenario": scenario.name,
        "n_observers": len(chosen),
        "visiting_points": [candidate.point for candidate in chosen],
        "gene_map": [len(chosen), *(int(p) for p in study.selected)],
        "flyable": study.flyable,
        "candidates": [describe(candidate, seen) for candidate in chosen],
        "visiting_points_A_m": [[round(float(x), 3) for x in seen.point_A[p - 1]] for p in study.selected],
        "delta_v_m_s": [round(float(seen.delta_v[p - 1]), 6) for p in study.selected],
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
        "tolerance_percent": scenario.designer.tolerance_percent,
        "fold": scenario.designer.fold,
        "any_roll": scenario.designer.any_roll,
        "criterion": scenario.observation.model_dump(mode="json"),
        "camera": scenario.camera.model_dump(mode="json"),
        "candidates_count": len(seen.candidates),
        "target_faces": seen.n_target_faces,
        "target_cells": len(seen.area),
        "seed": scenario.seed,
        "wall_s": {name: round(seconds, 3) for name, seconds in study.wall_s.items()},
        "versions": library_versions(),
    }


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
    seen = study.sightings
    history = {f"history_{name}": np.column_stack(result.history) for name, result in study.genetic.items()}
    np.savez_compressed(
        folder / "sightings.npz",
        sees=seen.sees,
        area=seen.area,
        delta_v=seen.delta_v,
        candidates=np.array(seen.candidates),
        **history,  # type: ignore[arg-type]
    )
    write_text(folder / "scenario.yaml", yaml.safe_dump(study.scenario.model_dump(mode="json"), sort_keys=False))
    if study.front is not None:
        write_text(folder / "pareto.json", json.dumps(_front_record(study), indent=2) + "\n")
    record = design_record(study)
    # Both names: a result folder is known by its summary.
    write_text(folder / "design.json", json.dumps(record, indent=2) + "\n")
    write_text(folder / "summary.json", json.dumps(record, indent=2) + "\n")
    return record


def _front_record(study: Study) -> list[dict[str, Any]]:
    front = study.front
    assert front is not None
    return [
        {
            "n_observers": int(n),
            "delta_v_m_s": round(float(delta_v), 6),
            "covered_percent": round(100.0 - float(missing), 6),
            "visiting_points": [int(p) for p in points],
        }
        for n, delta_v, missing, points in zip(
            front.n_observers, front.delta_v, front.uncovered_percent, front.points, strict=True
        )
    ]


def write_growth(folder: Path, rows: Sequence[Growth]) -> None:
    """Write the proven minimum under each extension as JSON."""
    write_text(folder / "growth.json", json.dumps([row._asdict() for row in rows], indent=2) + "\n")
