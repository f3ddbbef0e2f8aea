"""How release, navigation and burns spread to the arrival: `navigate`, by linear covariance and Monte Carlo."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from swarm_mj import __version__
from swarm_mj.api.scenario import Scenario, load
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import make_plan
from swarm_mj.flight.trajectory_corrections import CorrectionAnalysis, analyse_corrections
from swarm_mj.io.atomic import atomic_file
from swarm_mj.io.progress import Shown, Stages, using_bars
from swarm_mj.mission.covariance import DispersedFlights, arrival_axes, fly_dispersed, sample_chance
from swarm_mj.records.navigation import (
    known_3_sigma,
    navigation_findings,
    navigation_rows,
    total_delta_v,
)
from swarm_mj.scenarios.loading import NO_OVERRIDES, ScenarioSource
from swarm_mj.typing import Array

#: Fewest flights from which a covariance of three components can be judged, and most that are flown.
RUNS = (30, 100_000)
#: A comparison with less chance than this, shared among all of them, is a disagreement.
DISAGREES = 0.001


class Navigation:
    """What errors of release, navigation and burns make of the arrival.

    Attributes:
        found: Plan, legs, errors and linear covariance, as arrays.
        flights: Dispersed flights under all forces; None: none were flown.
    """

    def __init__(self, found: CorrectionAnalysis, flights: DispersedFlights | None = None) -> None:
        self.found, self.flights = found, flights

    @property
    def scenario(self) -> Scenario:
        """What is to be flown."""
        return Scenario.of(self.found.plan.scenario)

    @property
    def covariance_N(self) -> Array:
        """Of the position at the arrival in N, with the first 0, 1, ..., m corrections flown, shape (m + 1, n, 3, 3) [m^2]."""
        return self.found.spread.at_arrival[..., :3, :3]

    @property
    def covariance_RTS(self) -> Array:
        """The same in the arrival's axes: R outward, T across and S along the flight; see `mission.covariance.arrival_axes`."""
        axes = arrival_axes(self.found.legs.r_N[:, -1], self.found.legs.v_N[:, -1])
        return np.asarray(axes @ self.covariance_N @ axes.swapaxes(1, 2))

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row a spacecraft and number of corrections flown: spread at the arrival [m], the last burn [m/s], the camera."""
        return pd.DataFrame(navigation_rows(self.found)).set_index(["spacecraft", "corrections"])

    @cached_property
    def delta_v(self) -> pd.DataFrame:
        """One row a spacecraft: mean and 99th percentile of all its corrections together [m/s]."""
        columns = ["mean_m_s", "percentile_99_m_s"]
        return pd.DataFrame.from_dict(total_delta_v(self.found), orient="index", columns=columns).rename_axis(
            "spacecraft"
        )

    @cached_property
    def agreement(self) -> pd.DataFrame | None:
        """One row a spacecraft: 3 sigma [m] by covariance and by flights, the chance of differing more; None: none flown.

        Both along the longest axis of the covariance. The longest axis of the flights' own spread is longer by chance: with
        three like axes, 1,000 flights and the worst of several spacecraft by some 5 %.
        """
        if self.flights is None:
            return None
        expected, flown = self.covariance_N[-1], self.flights.deviation[..., :3]
        rows = {
            name: {
                "linear_3_sigma_m": _widest(expected[j]),
                "flown_3_sigma_m": 3.0
                * float(np.sqrt(np.mean((flown[:, j] @ np.linalg.eigh(expected[j])[1][:, -1]) ** 2))),
                "chance": sample_chance(flown[:, j], expected[j])
                if expected[j].any()
                else float(not flown[:, j].any()),
            }
            for j, name in enumerate(self.found.plan.names)
        }
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("spacecraft")

    @property
    def findings(self) -> list[str]:
        """What to know, one sentence each."""
        found = navigation_findings(self.found)
        if self.flights is not None and self.agreement is not None:
            worst, n = float(self.agreement["chance"].min()), len(self.agreement)
            runs = len(self.flights.deviation)
            found.append(
                f"{runs} flights under all forces agree with linear covariance within sampling error"
                if worst >= DISAGREES / n
                else f"{runs} flights under all forces do not agree with linear covariance (chance {worst:.1g} for the worst "
                f"of {n} spacecraft): the errors are too large for linear corrections; believe the flights"
            )
        return found

    @property
    def summary(self) -> dict[str, Any]:
        """Everything as plain numbers, ready for JSON."""
        agreement = self.agreement
        return {
            "swarm_mj": __version__,
            "scenario": self.found.plan.scenario.name,
            "spacecraft": navigation_rows(self.found),
            "covariance_N_m2": self.covariance_N.tolist(),
            "covariance_RTS_m2": self.covariance_RTS.tolist(),
            "delta_v_m_s": self.delta_v.to_dict(orient="index"),
            "agreement": None if agreement is None else agreement.to_dict(orient="index"),
            "flights": None if self.flights is None else len(self.flights.deviation),
            "known_3_sigma_m": known_3_sigma(self.found),
            "findings": self.findings,
        }

    def save(self, path: str | Path) -> Path:
        """Write the summary as JSON.

        Raises:
            OutputError: The file cannot be written.
        """
        path = Path(path)
        with atomic_file(path) as partial:
            partial.write_text(json.dumps(self.summary, indent=2) + "\n", encoding="utf-8")
        return path

    def __repr__(self) -> str:
        """One line: what is corrected and what is left."""
        widest = max(_widest(one) for one in self.covariance_N[-1])
        name, corrections = self.found.plan.scenario.name, self.found.legs.n_corrections
        return f"Navigation({name!r}, {corrections} corrections, 3 sigma {widest:.3g} m)"


def navigate(
    scenario: ScenarioSource,
    overrides: Mapping[str, Any] = NO_OVERRIDES,
    *,
    runs: int = 0,
    optical: bool = False,
    progress: Shown = None,
) -> Navigation:
    """Carry the covariance of release, navigation and burns through the corrections to the arrival; nothing is flown in MuJoCo.

    Args:
        scenario: What is to be flown, as `load` takes it.
        overrides: Values by dotted key that change it, e.g. `{"dispersions.deployment_velocity_m_s": 0.1}`.
        runs: Flights under all forces to check it with, drawn from the scenario's seed; 0: none.
        optical: Whether what is known at corrections comes by pictures of the body, see `flight.optical_covariance`; a campaign
            with navigation.mode: optical checks that instead of `runs`.
        progress: Whether to show progress bars, or the bars to use; None: on a terminal and in notebooks, after 2 s.

    Raises:
        SwarmError: The scenario cannot be planned, or a correction has no solution.
    """
    if runs and not RUNS[0] <= runs <= RUNS[1]:
        raise ScenarioError(f"runs = {runs}: must be 0 or {RUNS[0]} to {RUNS[1]}")
    if runs and optical:
        raise ScenarioError(
            f"runs = {runs}: must be 0 with pictures, which whole flights take; fly a campaign with navigation.mode: optical"
        )
    scenario = load(scenario, {**overrides, "navigation.mode": "optical"} if optical else overrides)
    with using_bars(progress) as bars:
        stages = Stages(scenario.name, bars)
        with stages.stage("design", "trajectories"):
            plan = make_plan(scenario)
        if optical:
            from swarm_mj.flight.optical_covariance import analyse_optical

            with stages.stage("covariance", "pictures along the way", 1.0) as done:
                return Navigation(analyse_optical(plan, done))
        with stages.stage("covariance", "covariance"):
            found = analyse_corrections(plan)
        if not runs:
            return Navigation(found)
        with stages.stage("flights", f"{runs} flights", 1.0) as done:
            rng, forces = np.random.default_rng(scenario.seed), plan.environment.acceleration_N
            flights = fly_dispersed(forces, found.legs, found.errors, runs=runs, rng=rng, progress=done)
    return Navigation(found, flights)


def _widest(covariance: Array) -> float:
    return 3.0 * float(np.sqrt(np.linalg.eigvalsh(covariance)[-1].clip(0.0)))
