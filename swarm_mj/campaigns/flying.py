"""Flying one run of a campaign, in whatever process: the only code path for local, distributed and replayed runs."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import xarray as xr

from swarm_mj.campaigns.loading import Resolved, restore, scenario_of
from swarm_mj.campaigns.outcome import outcome, recorded
from swarm_mj.campaigns.sampling import Sample, Trial
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import ObservationResult, observe_flight
from swarm_mj.flight.plan import Plan, check_faults_of, make_plan
from swarm_mj.io.atomic import atomic_file
from swarm_mj.records.run_files import write_telemetry
from swarm_mj.scenarios.schema import Scenario

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


class Flyer:
    """Flies the runs of one campaign; keeps each scenario's last plan.

    Args:
        resolved: The campaign.
        telemetry: Folder for the runs' telemetry; None keeps none.
    """

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
