"""A flight as tables: one CSV file for each spacecraft with units in its header, and a description of every column.

The description is a data package of the Frictionless standard (`datapackage.json`), which says of each column what it is, its
type, unit and frame.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pandas as pd

from swarm_mj.interop.states import FlightStates
from swarm_mj.io.times import text_of
from swarm_mj.spacecraft.attitude.mrp import dcm


def spacecraft_table(states: FlightStates, j: int) -> tuple[pd.DataFrame, list[dict[str, str]]]:
    """Everything recorded of spacecraft j, a row a sample, and the description of each column."""
    columns: dict[str, Any] = {}
    fields: list[dict[str, str]] = []

    def add(name: str, unit: str, values: Any, frame: str, words: str, kind: str = "number") -> None:
        header = f"{name} [{unit}]"
        columns[header] = values
        fields.append({"name": header, "type": kind, "unit": unit, "frame": frame, "description": words})

    add("time", "s", states.times, "none", "time past the epoch")
    add("tdb", "ISO 8601", [text_of(ns) for ns in states.instants], "none", "date and time, TDB", "string")
    for name, variable in states.telemetry.data_vars.items():
        if variable.dims[:2] != ("time", "spacecraft") or variable.ndim > 3:
            continue
        unit, frame, words = (str(variable.attrs.get(key, "")) for key in ("units", "frame", "long_name"))
        kind = "integer" if np.issubdtype(variable.dtype, np.integer) else "number"
        if variable.ndim == 2:
            add(str(name), unit, variable.values[:, j], frame, words, kind)
            continue
        for k, label in enumerate(states.telemetry[variable.dims[2]].values):
            add(f"{name}_{label}", unit, variable.values[:, j, k], frame, words, kind)
    r_A = np.einsum("tij,tj->ti", dcm(states.telemetry["sigma_AN"].values), states.states_N[:, j, :3])
    for k, axis in enumerate("xyz"):
        add(f"r_BN_A_{axis}", "m", r_A[:, k], "A", "position relative to the asteroid's centre")
    return pd.DataFrame(columns), fields


def data_package(states: FlightStates, described: dict[str, list[dict[str, str]]]) -> str:
    """The description of the tables, by the names of their files."""
    package = {
        "name": states.plan.scenario.name.lower(),
        "profile": "tabular-data-package",
        "description": "; ".join(states.comments),
        "frames": states.telemetry.attrs.get("frames", ""),
        "epoch_tdb": states.plan.scenario.epoch,
        "resources": [
            {
                "name": name.removesuffix(".csv"),
                "path": name,
                "profile": "tabular-data-resource",
                "schema": {"fields": fields, "primaryKey": fields[0]["name"]},
            }
            for name, fields in described.items()
        ],
    }
    return json.dumps(package, indent=2) + "\n"
