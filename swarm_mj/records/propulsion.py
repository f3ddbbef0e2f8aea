"""What thrusters used and gave, in the summary and in findings."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from swarm_mj.flight.burns import total_delta_v
from swarm_mj.flight.plan import Plan
from swarm_mj.records.rounding import by_name
from swarm_mj.records.run_record import RunRecord
from swarm_mj.scenarios.constants import STANDARD_GRAVITY

#: Keys of the summary that only flights with thrusters have; all hold a number for each spacecraft.
KEYS = ("propellant_used_kg", "propellant_left_kg", "thrust_delta_v_m_s", "planned_burns_m_s")
#: Propellant beyond that of the rocket equation which is worth a remark, relative; canted nozzles lose 3.5 % by design.
REMARKABLE = 0.05


def propulsion_summary(plan: Plan, telemetry: xr.Dataset) -> dict[str, Any]:
    """What the thrusters used and gave, by spacecraft; empty where there are none."""
    if "propellant_kg" not in telemetry:
        return {}
    left = telemetry["propellant_kg"].values
    values = left[0] - left[-1], left[-1], telemetry["delta_v_m_s"].values[-1]
    planned = total_delta_v(plan.deployment.burns, plan.n)
    return {
        key: by_name(plan.names, row, digits)
        for key, row, digits in zip(KEYS, (*values, planned), (9, 9, 6, 6), strict=True)
    }


def propulsion_findings(run: RunRecord) -> list[str]:
    """Remarks on tanks: who ran empty, and whose planned burns took more than the plan's check of the tank counts.

    Corrections are not in that check; `records/navigation.py` counts what nozzles take for them.
    """
    if "propellant_kg" not in run.telemetry or run.scenario.spacecraft.thrusters is None:
        return []
    left, mass = run.telemetry["propellant_kg"].values, run.telemetry["mass_kg"].values
    speed = STANDARD_GRAVITY * run.scenario.spacecraft.thrusters.specific_impulse_s
    gained, used = run.telemetry["delta_v_m_s"].values[-1], left[0] - left[-1]
    least = -mass[0] * np.expm1(-gained / speed)
    found = []
    emptied_s = run.times[np.argmax(left <= 0.0, axis=0)]
    if empty := [f"{run.names[j]} at t = {emptied_s[j]:g} s" for j in np.flatnonzero(left[-1] <= 0)]:
        found.append(
            f"tanks ran empty: {', '.join(empty)}; burns after that were not flown: raise spacecraft.thrusters.propellant_kg"
        )
    planned = np.array([run.summary.get("planned_burns_m_s", {}).get(name, 0.0) for name in run.names])
    if len(more := np.flatnonzero((planned > 0.0) & (used > (1.0 + REMARKABLE) * least))):
        worst = int(more[np.argmax(used[more] / np.maximum(least[more], 1e-12))])
        who = ", ".join(run.names[j] for j in more)
        found.append(
            f"{who}: nozzles that do not point along the force took more propellant than tanks are checked for, up to "
            f"{1e3 * used[worst]:.3g} g where the rocket equation has {1e3 * least[worst]:.3g} g for "
            f"{gained[worst]:.3g} m/s ({run.names[worst]}); keep that much more in spacecraft.thrusters.propellant_kg"
        )
    return found
