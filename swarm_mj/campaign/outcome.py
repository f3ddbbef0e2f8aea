"""What is kept of a run: numbers from its summary by name, and a few of its telemetry that the summary lacks.

A name is a key of the summary (see `swarm_mj.output.summary`); where the key holds one number per spacecraft, `.max`, `.min`,
`.mean` or `.sum` reduces them, and a spacecraft's name takes its own. A list counts. Besides the summary there are

- `covered`: whether |100 - P_TO| is within `designer.tolerance_percent`, the paper's equation 4;
- `pointing_error_deg_visit`: by observer, at the instant of the visit;
- `pointing_error_deg_p95`: 95th percentile over the flight and all spacecraft, slews included.

Pointing errors are those of spacecraft that work: while they do, and at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.flight import ObservationResult, visit_sample
from swarm_mj.output.summary import summarise
from swarm_mj.planning import Plan

REDUCTIONS: dict[str, Callable[[NDArray[np.float64]], Any]] = {
    "max": np.max,
    "min": np.min,
    "mean": np.mean,
    "sum": np.sum,
}


def column_of(name: str) -> str:
    """Column of a recorded name; dots stand only in parameters' columns."""
    return name.replace(".", "_")


def outcome(plan: Plan, telemetry: xr.Dataset, result: ObservationResult, record: Sequence[str]) -> dict[str, Any]:
    """The recorded numbers of a run, by column, with `covered`, `spacecraft` and `events`.

    Raises:
        ScenarioError: A recorded name is not there; the message lists what is.
    """
    summary = summarise(plan, telemetry, result, {})
    values = _of_the_living({**summary, **_pointed(plan, telemetry)}, summary["lost"])
    tolerance = plan.scenario.designer.tolerance_percent
    return {
        "covered": bool(100.0 - result.coverage.percent <= tolerance),
        "spacecraft": plan.n,
        **{column_of(name): pick(values, name) for name in record},
        "events": summary.get("events", []),
    }


def pick(values: Mapping[str, Any], name: str) -> float | None:
    """One number by name; None where a run has none.

    Raises:
        ScenarioError: The name is not there.
    """
    key, _, part = name.partition(".")
    if key not in values:
        raise ScenarioError(f"record: {name}: is not recorded; there are {', '.join(_names(values))}")
    value = values[key]
    if isinstance(value, list) and not part:
        return float(len(value))
    if isinstance(value, Mapping) and (part in REDUCTIONS or part in value):
        return _finite(value[part]) if part in value else _reduced(value, part)
    if part or isinstance(value, bool) or not isinstance(value, (int, float, type(None))):
        parts = f"one of {', '.join(REDUCTIONS)} or a spacecraft" if isinstance(value, Mapping) else "no part"
        raise ScenarioError(f"record: {name}: {key} needs {parts} after it")
    return _finite(value)


def _reduced(value: Mapping[str, Any], part: str) -> float | None:
    numbers = np.array([v for v in value.values() if v is not None], np.float64)
    return _finite(REDUCTIONS[part](numbers)) if len(numbers) else None


def _finite(value: Any) -> float | None:
    return float(value) if value is not None and np.isfinite(value) else None


def _names(values: Mapping[str, Any]) -> list[str]:
    numbers = [key for key, value in values.items() if isinstance(value, (int, float, list))]
    by_craft = [
        f"{key}.max" for key, v in values.items()
        if isinstance(v, Mapping) and all(isinstance(x, (int, float)) for x in v.values())
    ]  # fmt: skip
    return [*numbers, *by_craft]


def _of_the_living(values: dict[str, Any], lost: Sequence[str]) -> dict[str, Any]:
    """The same without the pointing errors of spacecraft that were lost before the end; at the visit they may have worked."""
    for key in ("pointing_error_deg_final", "pointing_error_deg_before_switch"):
        values[key] = {name: error for name, error in values[key].items() if name not in lost}
    return values


def _pointed(plan: Plan, telemetry: xr.Dataset) -> dict[str, Any]:
    error_deg = np.degrees(telemetry["pointing_error"].values)
    if "operational" in telemetry:
        error_deg = np.where(telemetry["operational"].values == 1, error_deg, np.nan)
    visit = error_deg[visit_sample(plan.scenario), : plan.n_observers]
    finite = error_deg[np.isfinite(error_deg)]
    return {
        "pointing_error_deg_visit": {
            name: float(e) if np.isfinite(e) else None
            for name, e in zip(plan.names[: plan.n_observers], visit, strict=True)
        },
        "pointing_error_deg_p95": float(np.percentile(finite, 95.0)) if len(finite) else None,
    }
