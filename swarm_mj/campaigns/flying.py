"""Flying one run of a campaign, in whatever process, and what is kept of it: local, distributed and replayed runs alike.

Kept are numbers from its summary by name, and a few of its telemetry that the summary lacks. A name is a key of the summary
(see `swarm_mj.records.summary`); where the key holds one number per spacecraft, `.max`, `.min`, `.mean` or `.sum` reduces
them, and a spacecraft's name takes its own. A list counts. Besides the summary there are

- `pointing_error_deg_arrival`: by observer, at the instant of the arrival;
- `pointing_error_deg_p95`: 95th percentile over the flight and all spacecraft, slews included;
- `formation_bits` and `formation_airtime_s`: what holding a formation took of messages; 0 without.

Of flights without thrusters what these used and gave is empty.

Pointing errors are those of spacecraft that work: while they do, and at the end. Always kept is `covered`: whether
|100 - P_TO| is within `designer.tolerance_percent`, the paper's equation 4.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import xarray as xr

from swarm_mj.campaigns.config import FIXED_COLUMNS, Campaign
from swarm_mj.campaigns.loading import Resolved, restore, scenario_of
from swarm_mj.campaigns.sampling import Sample, Trial
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.downlink import deliver
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import ObservationResult, arrival_samples, observe_flight
from swarm_mj.flight.plan import Plan, check_faults_of, make_plan
from swarm_mj.io.atomic import atomic_file
from swarm_mj.io.values import shown
from swarm_mj.records.propulsion import KEYS as PROPULSION
from swarm_mj.records.run_files import write_telemetry
from swarm_mj.records.summary import summarise, working
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.telemetry import working as at_work

Row = dict[str, Any]

#: Sections and values of a scenario that `make_plan` does not read: where only these differ, a plan serves again.
AFTER_PLANNING = (
    "name",
    "description",
    "seed",
    "faults",
    "physics",
    "observation",
    "designer",
    "link",
    "telemetry",
    "spacecraft.initial_mrp_range",
    "spacecraft.initial_rate_range_rpm",
)

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


class Flyer:
    """Flies the runs of one campaign, with their telemetry into a folder or nowhere; keeps each scenario's last plan."""

    def __init__(self, resolved: Resolved, telemetry: Path | None = None) -> None:
        self.resolved, self.sample = resolved, Sample(resolved.campaign)
        self._telemetry, self._record = telemetry, recorded(resolved.campaign)
        self._plans: dict[str, tuple[str, Plan]] = {}
        # Plans are kept between runs, and a GL context belongs to one thread: one run at a time.
        self._lock = Lock()

    def fly(self, row: int) -> Row:
        """Fly one run; a run that fails gives a row that says why.

        Raises:
            ScenarioError: What is to be recorded does not exist.
            OutputError: Telemetry cannot be written.
        """
        with self._lock:
            start = time.perf_counter()
            trial = self.sample.trial(row)
            flown = self._fly(trial)
            return {**flown, "wall_s": time.perf_counter() - start}

    def _fly(self, trial: Trial) -> Row:
        try:
            plan, telemetry, result = self.flight(trial)
        except Exception as error:  # whatever a run does, the campaign goes on and the row tells
            return failed_row(trial, f"{type(error).__name__}: {error}")
        row = {**_identity(trial), "status": "ok", "error": None}
        row |= outcome(plan, telemetry, result, self._record)
        if self._telemetry is not None:
            with atomic_file(self._telemetry / f"{trial.row:06d}.nc") as partial:
                write_telemetry(partial, telemetry)
        return row

    def flight(self, trial: Trial) -> tuple[Plan, xr.Dataset, ObservationResult]:
        """Plan, fly and observe one run."""
        plan = self._plan(trial.scenario, self.scenario(trial))
        telemetry = simulate(plan)
        return plan, telemetry, observe_flight(plan, telemetry)

    def scenario(self, trial: Trial) -> Scenario:
        """The scenario of a run, drawn values and seed in place."""
        return scenario_of(self.resolved.bases[trial.scenario], trial.values, trial.seed)

    def _plan(self, name: str, scenario: Scenario) -> Plan:
        key = _planning_key(scenario)
        kept = self._plans.get(name)
        if kept is None or kept[0] != key:
            plan = make_plan(scenario)
        else:
            plan = kept[1]
            check_faults_of(plan, scenario)  # the only thing in `make_plan` that reads them
        self._plans[name] = (key, plan)
        return replace(plan, scenario=scenario)


#: The threads of a Dask worker share one flyer, whichever of them asks for it first.
_MAKING = Lock()


@lru_cache(maxsize=1)
def _flyer_of(text: str, telemetry: str | None) -> Flyer:
    """The flyer of a campaign, kept until another campaign is flown; `text` is what `Resolved.dumps` gave."""
    return Flyer(restore(text), None if telemetry is None else Path(telemetry))


def fly_row(text: str, telemetry: str | None, row: int) -> Row:
    """Fly one run of a campaign; what pools send to their workers."""
    with _MAKING:
        flyer = _flyer_of(text, telemetry)
    return flyer.fly(row)


def failed_row(trial: Trial, error: str) -> Row:
    """The row of a run that failed."""
    return {**_identity(trial), "status": "failed", "error": error[:2000], "wall_s": None}


def _identity(trial: Trial) -> Row:
    return {"row": trial.row, "run": trial.run, "scenario": trial.scenario, "seed": trial.seed, **trial.values}


def _planning_key(scenario: Scenario) -> str:
    data = scenario.model_dump(mode="json")
    for key in AFTER_PLANNING:
        if key == "seed" and scenario.dispersions.target_m > 0.0:
            continue  # the target's true place is drawn with the plan
        section, _, value = key.partition(".")
        holder: Mapping[str, Any] = data.get(section, {}) if value else data
        if isinstance(holder, dict):
            holder.pop(value or section, None)
    return json.dumps(data)


def recorded(campaign: Campaign) -> dict[str, str]:
    """What is recorded of every run, by column: each once, and nothing that has a column already.

    Dots stand only in the columns of parameters.
    """
    taken = {*FIXED_COLUMNS, *campaign.parameters}
    columns = {name.replace(".", "_"): name for name in campaign.record}
    return {column: name for column, name in columns.items() if column not in taken}


def outcome(plan: Plan, telemetry: xr.Dataset, result: ObservationResult, record: Mapping[str, str]) -> dict[str, Any]:
    """The numbers of a run by column, as `recorded` names them, with `covered`, `spacecraft` and `events`.

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
    summary["classes"] = {name: mapped["percent"] for name, mapped in summary["classes"].items()}
    values = {**of_none, **told, **summary, **of_the_living, **_pointed(plan, telemetry)}
    return {
        "covered": bool(100.0 - result.coverage.percent <= plan.scenario.designer.tolerance_percent),
        "spacecraft": plan.n,
        **{column: pick(values, name, plan.names) for column, name in record.items()},
        "events": summary["events"],
    }


def pick(values: Mapping[str, Any], name: str, spacecraft: Sequence[str]) -> float | None:
    """One number by name, of numbers, lists, or either by spacecraft (not all need have one); None where a run has none.

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
