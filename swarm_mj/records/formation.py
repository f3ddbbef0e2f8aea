"""What a reader is told of a formation: numbers for the summary, and why it could not be held."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr

from swarm_mj.flight.coordination import FORMATION_AIRTIME
from swarm_mj.flight.formation import BITS, ERROR, RECORD
from swarm_mj.records.rounding import by_name
from swarm_mj.typing import Mask

#: Farther from its place than so many dead bands, and at least so many metres, at the end: not held.
BANDS, AT_LEAST_M = 2.0, 10.0


def formation_summary(telemetry: xr.Dataset) -> dict[str, Any]:
    """Keys of the summary; empty for flights without a formation."""
    if ERROR not in telemetry:
        return {}
    told, times = json.loads(telemetry.attrs[RECORD]), telemetry["time"].values
    names = [str(name) for name in telemetry["spacecraft"].values]
    held = np.flatnonzero((times >= told["start_s"]) & (times <= told["end_s"]))
    error, left = telemetry[ERROR].values[held], telemetry["propellant_kg"].values[held]

    dry: Mask = left <= 0.0
    found = {
        "held_s": [told["start_s"], told["end_s"]],
        "dead_band_m": told["dead_band_m"],
        "error_m_start": by_name(names, error[0], 4),
        "error_m_rms": by_name(names, np.sqrt((error**2).mean(axis=0)), 4),
        "error_m_final": by_name(names, error[-1], 4),
        **{key: by_name(names, told[key], 6) for key in ("join_m_s", "hold_m_s")},
        "most_needed_m_s2": by_name(names, told["most_needed_m_s2"], 9),
        "thrust_m_s2": told["thrust_m_s2"],
        "tank_m_s": round(told["tank_m_s"], 6),
        "empty_s": {name: float(times[held][dry[:, j]][0]) for j, name in enumerate(names) if dry[:, j].any()},
        "braked_s": by_name(names, told.get("braked_s", [0.0] * len(names)), 3),
        "leaders": [[t, names[i], names[k]] for t, i, k in told.get("leaders", ())],
    }
    if BITS in telemetry:
        found["messages_bit"] = int(telemetry[BITS].values[-1].sum())
        found["messages_airtime_s"] = float(telemetry[FORMATION_AIRTIME].values[-1].sum())
    return {"formation": found}


def formation_findings(summary: dict[str, Any]) -> list[str]:
    """One sentence for each reason for which a formation was not held."""
    told = summary.get("formation")
    if told is None:
        return []
    lost, found = summary.get("lost", ()), []
    needed, thrust = told["most_needed_m_s2"], told["thrust_m_s2"]
    weak = {name: value for name, value in needed.items() if value > thrust}
    if weak:
        worst = max(weak.values())
        found.append(
            f"thrusters cannot hold the formation: {', '.join(weak)} needs up to {worst:.3g} m/s^2 against differential "
            f"gravity and has {thrust:.3g}; raise spacecraft.thrusters.thrust_n {worst / thrust:.2g} times, bring "
            "swarm.formation.offsets_m closer, or let it fly freely (swarm.formation.shape: natural)"
        )
    for name, t in told["empty_s"].items():
        found.append(
            f"t = {t:g} s, {name}: the tank is empty and the formation no longer held; joining and holding it take at least "
            f"{told['join_m_s'][name] + told['hold_m_s'][name]:.3g} m/s along the nozzles, the tank gives "
            f"{told['tank_m_s']:.3g}; raise spacecraft.thrusters.propellant_kg or begin later (swarm.formation.start_s)"
        )
    limit = max(BANDS * told["dead_band_m"], AT_LEAST_M)
    span = told["held_s"][1] - told["held_s"][0]
    for name, error in told["error_m_final"].items():
        if error > limit and name not in lost and name not in told["empty_s"] and name not in weak:
            found.append(
                f"{name} is {error:.3g} m from its place in the formation at the end: {told['join_m_s'][name]:.3g} m/s to join "
                f"it take {told['join_m_s'][name] / thrust:.3g} s of the {span:g} s, and disturbances more; raise "
                "spacecraft.thrusters.thrust_n, swarm.formation.bandwidth_rad_s, or hold it longer"
            )
    return found
