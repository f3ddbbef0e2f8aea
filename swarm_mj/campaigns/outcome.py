"""What is kept of a run: numbers from its summary by name, and a few of its telemetry that the summary lacks.

A name is a key of the summary (see `swarm_mj.records.summary`); where the key holds one number per spacecraft, `.max`, `.min`,
`.mean` or `.sum` reduces them, and a spacecraft's name takes its own. A list counts. Besides the summary there are

- `pointing_error_deg_arrival`: by observer, at the instant of the arrival;
- `pointing_error_deg_p95`: 95th percentile over the flight and all spacecraft, slews included;
- `formation_bits` and `formation_airtime_s`: what holding a formation took of messages; 0 without.

Of flights without thrusters what these used and gave is empty.

Pointing errors are those of spacecraft that work: while they do, and at the end. Always kept is `covered`: whether
|100 - P_TO| is within `designer.tolerance_percent`, the paper's equation 4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from swarm_mj.campaigns.config import FIXED_COLUMNS, Campaign
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.downlink import deliver
from swarm_mj.flight.observe import ObservationResult, arrival_samples
from swarm_mj.flight.plan import Plan
from swarm_mj.io.values import shown
from swarm_mj.records.propulsion import KEYS as PROPULSION
from swarm_mj.records.summary import summarise, working
from swarm_mj.simulator.telemetry import working as at_work

REDUCTIONS: dict[str, Callable[[list[float]], Any]] = {
    "max": np.max,
    "min": np.min,
    "mean": np.mean,
    "sum": np.sum,
}
#: Numbers by spacecraft that mean nothing of one that was lost before the end; at the arrival it may have worked.
LOST_WITH_THEIR_SPACECRAFT = ("pointing_error_deg_final", "pointing_error_deg_before_switch")


#: Keys of the summary for which data are sent to Earth.
DELIVERED = {
    "delivered_percent",
    "seen_bits",
    "delivered_bits",
    "aboard_bits",
    "lost_bits",
    "time_to_all_data_s",
    "link_time_s",
    "not_delivered",
}


#: Keys of the summary of a swarm that coordinates nothing by messages.
SILENT = {"coordination_bits": 0, "coordination_airtime_s": 0.0}
#: Of a formation's messages: here, and in the summary's part on the formation.
FORMATION = {"formation_bits": "messages_bit", "formation_airtime_s": "messages_airtime_s"}


def recorded(campaign: Campaign) -> dict[str, str]:
    """What is recorded of every run, by column: each once, and nothing that has a column already.

    Dots stand only in the columns of parameters.
    """
    taken = {*FIXED_COLUMNS, *campaign.parameters}
    columns = {name.replace(".", "_"): name for name in campaign.record}
    return {column: name for column, name in columns.items() if column not in taken}


def outcome(plan: Plan, telemetry: xr.Dataset, result: ObservationResult, record: Mapping[str, str]) -> dict[str, Any]:
    """The recorded numbers of a run, by column, with `covered`, `spacecraft` and `events`.

    Args:
        plan: What was flown.
        telemetry: Of the flight.
        result: What was seen.
        record: Names by column, from `recorded`.

    Raises:
        ScenarioError: A recorded name is not there; the message lists what is.
    """
    if result.delivery is None and DELIVERED & {name.partition(".")[0] for name in record.values()}:
        # Without the proof: a campaign asks how much arrives, and its bound would cost as much as the flight.
        result = replace(result, delivery=deliver(plan, telemetry, result.kept, prove=False))
    summary = summarise(plan, telemetry, result, {})
    of_the_living = {key: working(summary, key) for key in LOST_WITH_THEIR_SPACECRAFT}
    of_none: dict[str, Any] = {**dict.fromkeys(DELIVERED), **SILENT, **{key: {} for key in PROPULSION}}
    formation = summary.get("formation") or {}
    told = {key: formation.get(name, 0) for key, name in FORMATION.items()}
    values = {**of_none, **told, **summary, **of_the_living, **_pointed(plan, telemetry)}
    return {
        "covered": bool(100.0 - result.coverage.percent <= plan.scenario.designer.tolerance_percent),
        "spacecraft": plan.n,
        **{column: pick(values, name, plan.names) for column, name in record.items()},
        "events": summary["events"],
    }


def pick(values: Mapping[str, Any], name: str, spacecraft: Sequence[str]) -> float | None:
    """One number by name; None where a run has none.

    Args:
        values: Numbers, lists, or either by spacecraft.
        name: Which one.
        spacecraft: All of the run, whether or not each has a number.

    Raises:
        ScenarioError: The name is not there, or is no number's.
    """
    key, _, part = name.partition(".")
    if key not in values:
        raise ScenarioError(f"record: {name}: is not recorded; there are {', '.join(_names(values))}")
    value = values[key]
    if not isinstance(value, Mapping):
        if part:
            raise ScenarioError(f"record: {name}: {key} needs no part after it")
        return _number(name, value)
    if part in REDUCTIONS:
        numbers = [_number(name, inner) for inner in value.values()]
        there = [number for number in numbers if number is not None]
        return _number(name, REDUCTIONS[part](there)) if there else None
    if part not in value and part not in spacecraft:
        raise ScenarioError(f"record: {name}: {key} needs one of {', '.join(REDUCTIONS)} or a spacecraft after it")
    return _number(name, value.get(part))


def _number(name: str, value: Any) -> float | None:
    """A number, or how long a list is; None for what is unknown."""
    if isinstance(value, list):
        return float(len(value))
    if value is not None and not isinstance(value, (int, float)):
        raise ScenarioError(f"record: {name}: is {shown(value)}, no number")
    return float(value) if value is not None and np.isfinite(value) else None


def _names(values: Mapping[str, Any]) -> list[str]:
    numbers = [key for key, value in values.items() if isinstance(value, (int, float, list))]
    by_craft = [
        f"{key}.max" for key, v in values.items()
        if isinstance(v, Mapping) and all(isinstance(x, (int, float, list)) for x in v.values())
    ]  # fmt: skip
    return [*numbers, *by_craft]


def _pointed(plan: Plan, telemetry: xr.Dataset) -> dict[str, Any]:
    error_deg = np.degrees(telemetry["pointing_error"].values)
    error_deg = np.where(at_work(telemetry), error_deg, np.nan)
    arrival = error_deg[arrival_samples(plan.scenario), np.arange(plan.n_observers)]
    finite = error_deg[np.isfinite(error_deg)]
    return {
        "pointing_error_deg_arrival": {
            name: float(e) if np.isfinite(e) else None
            for name, e in zip(plan.names[: plan.n_observers], arrival, strict=True)
        },
        "pointing_error_deg_p95": float(np.percentile(finite, 95.0)) if len(finite) else None,
    }
