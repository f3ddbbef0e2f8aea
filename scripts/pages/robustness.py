"""Write docs/results/robustness.md, what is left of the observed area when things go wrong: python -m scripts.pages.robustness.

Flies three packaged campaigns, `eros-losses`, `eros-sensitivity` and `eros-each-fault`, on all cores and compares the first
with the exact answer that undisturbed flights give. An interrupted call goes on where it was. `--runs N` flies fewer.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass
from itertools import combinations
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.console import Console

from scripts.pages import IMAGES, RESULTS
from swarm_mj.campaigns import statistics
from swarm_mj.campaigns.figures import COLOURS, NOT_TOLD, compose_coverage, compose_pointing, compose_sobol
from swarm_mj.campaigns.loading import Resolved, load_campaign
from swarm_mj.campaigns.pools import usable_cores
from swarm_mj.campaigns.runner import run_campaign
from swarm_mj.campaigns.statistics import Estimate
from swarm_mj.campaigns.store import read_results
from swarm_mj.campaigns.summary import by_scenario
from swarm_mj.figures.palette import GREY
from swarm_mj.figures.style import TICK_PT, label, new_figure, save, tidy
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.io.atomic import write_text
from swarm_mj.io.progress import progress_bars
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario

Array = NDArray[np.float64]

PAGE = RESULTS / "robustness.md"
LOSSES, SENSITIVITY, EACH = "eros-losses", "eros-sensitivity", "eros-each-fault"
#: Chance of loss of each spacecraft in `eros-losses`.
CHANCE = 0.1
#: Numbers of lost observers that get a line or a point of their own.
MOST = 5


@dataclass(frozen=True)
class Exact:
    """What losses cost a flight that is otherwise as planned, over all subsets of lost observers.

    Attributes:
        coverage: Mean observed area by number of lost observers, shape (n + 1,) [%].
        covered: Share of the subsets that leave the whole target seen, by the same.
    """

    coverage: Array
    covered: Array

    def expected(self, by_number: Array) -> float:
        """Mean over the binomial number of losses."""
        n = len(by_number) - 1
        weights = [comb(n, k) * CHANCE**k * (1.0 - CHANCE) ** (n - k) for k in range(n + 1)]
        return float(np.dot(weights, by_number))


def exact_losses(scenario: Scenario) -> Exact:
    """Fly once as planned, then leave out every subset of the observers."""
    plan = make_plan(load_scenario(scenario, {"faults": [], "dispersions": {}, "spacecraft.sensors": "ideal"}))
    coverage = observe_flight(plan, simulate(plan)).coverage
    seen, area = coverage.seen_by[: plan.n_observers], coverage.area
    n, tolerance = plan.n_observers, scenario.designer.tolerance_percent
    found = [[], []]  # type: list[list[float]]
    for lost in range(n + 1):
        shares = np.array(
            [100.0 * area[seen[list(left)].any(axis=0)].sum() / area.sum() for left in combinations(range(n), n - lost)]
        )
        found[0].append(float(shares.mean()))
        found[1].append(float((100.0 - shares <= tolerance).mean()))
    return Exact(np.array(found[0]), np.array(found[1]))


def lost_observers(rows: list[dict[str, Any]], n_observers: int) -> NDArray[np.int64]:
    """Observers lost in each flight; a lost communications spacecraft sees nothing anyway."""
    observers = {f"sc{j + 1}" for j in range(n_observers)}
    return np.array(
        [
            len({e["spacecraft"] for e in json.loads(row["events"]) if e["kind"] == "spacecraft_lost"} & observers)
            for row in rows
        ]
    )


@dataclass(frozen=True)
class Degradation:
    """Flights of one scenario by number of lost observers.

    Attributes:
        name: Of the scenario.
        lost: Observers lost in each flight, shape (m,).
        coverage: Observed area of each flight, shape (m,) [%].
        covered: Whether the whole target was seen, shape (m,).
        exact: See `Exact`.
    """

    name: str
    lost: NDArray[np.int64]
    coverage: Array
    covered: NDArray[np.bool_]
    exact: Exact

    def mean_coverage(self, k: int) -> Estimate:
        """Mean observed area with k losses [%]."""
        return statistics.mean(self.coverage[self.lost == k], np.random.default_rng(k))

    def probability(self, k: int | None = None) -> Estimate:
        """Probability that the whole target is seen, with k losses or however many."""
        chosen = self.covered if k is None else self.covered[self.lost == k]
        return statistics.probability(int(chosen.sum()), len(chosen))


def degradations(resolved: Resolved, results: pa.Table) -> list[Degradation]:
    """Flights by losses, one entry per scenario."""
    found = []
    for name, table in by_scenario(resolved, results):
        base = resolved.bases[name]
        rows = [row for row in table.to_pylist() if row["status"] == "ok"]
        found.append(
            Degradation(
                name,
                lost_observers(rows, len(base.design.visiting_points)),
                np.array([row["coverage_percent"] for row in rows]),
                np.array([row["covered"] for row in rows]),
                exact_losses(base),
            )
        )
    return found


def compose_losses(found: list[Degradation]) -> Figure:
    """Observed area and chance of seeing all of it, by number of lost observers."""
    figure = new_figure(
        4.8, "Losses: flown (dots, 95 % intervals) and exact without dispersions (lines)", width_in=11.0
    )
    left, right = figure.subplots(1, 2)
    drawn: list[bytes] = []
    for k, entry in enumerate(found):
        numbers = np.arange(min(MOST, len(entry.exact.coverage) - 1) + 1)
        exact = (entry.exact.coverage, 100.0 * entry.exact.covered)
        if exact[0].tobytes() not in drawn:  # both configurations fly the same designs
            style, drawn = ("-", "--", ":")[len(drawn) % 3], [*drawn, exact[0].tobytes()]
            name = f"exact, {len(entry.exact.coverage) - 1} observers"
            for ax, line in zip((left, right), exact, strict=True):
                ax.plot(numbers, line[numbers], color=GREY, linestyle=style, linewidth=1.4, label=name)
        for ax, estimate, scale in ((left, entry.mean_coverage, 1.0), (right, entry.probability, 100.0)):
            there = [int(n) for n in numbers if (entry.lost == n).sum() >= 5]
            known = [estimate(n) for n in there]
            y = scale * np.array([e.value for e in known])
            ends = scale * np.array([[e.low for e in known], [e.high for e in known]])
            around = np.maximum([y - ends[0], ends[1] - y], 0.0)
            x = np.array(there) + 0.12 * (k - 0.5 * (len(found) - 1))
            ax.errorbar(x, y, yerr=around, fmt="o", color=COLOURS[k], markersize=4, capsize=3, label=entry.name)
    for ax in (left, right):
        ax.set_xticks(range(MOST + 1))
        tidy(ax)
    left.set_ylim(None, 101.0)
    right.set_ylim(-3.0, 103.0)
    label(left, "observers lost before the arrival [-]", "mean observed share of the target [%]")
    label(right, "observers lost before the arrival [-]", "flights that see the whole target [%]")
    handles, names = left.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=6, fontsize=TICK_PT, frameon=False)
    return figure


def losses_table(found: list[Degradation]) -> list[str]:
    """Flown against exact, by number of lost observers."""
    lines = [
        "| swarm | observers lost | flights | observed area, mean [%] | exact [%] | P(whole target seen) [%] | exact [%] |",
        "|---|---|---|---|---|---|---|",
    ]
    for entry in found:
        for k in range(min(MOST, int(entry.lost.max())) + 1):
            flights = int((entry.lost == k).sum())
            if flights == 0:
                continue
            area, seen = entry.mean_coverage(k), entry.probability(k)
            lines.append(
                f"| {entry.name} | {k} | {flights} | {words(area, digits=2)} | {entry.exact.coverage[k]:.2f} | "
                f"{words(seen, 100.0)} | {100 * entry.exact.covered[k]:.1f} |"
            )
    return lines


def overall_table(found: list[Degradation], summary: dict[str, Any]) -> list[str]:
    """One line per swarm."""
    lines = [
        "| swarm | spacecraft | flights (failed) | P(whole target seen) [%] | exact, without dispersions [%] | "
        "observed area, mean [%] | exact [%] | 5th percentile [%] | delivered to Earth, mean [%] | "
        "pointing error at the arrival, 95th percentile [deg] |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for entry in found:
        part = summary["scenarios"][entry.name]
        outcomes = part["outcomes"]
        mean, fifth = outcomes["coverage_percent"]["mean"], outcomes["coverage_percent"]["quantiles"]["0.05"]
        pointing = outcomes["pointing_error_deg_arrival_max"]["quantiles"]["0.95"]
        delivered = outcomes["delivered_percent"]["mean"]
        lines.append(
            f"| {entry.name} | {part['spacecraft']} | {part['finished']} ({part['failed']}) | "
            f"{words(entry.probability(), 100.0)} | "
            f"{100 * entry.exact.expected(entry.exact.covered):.1f} | {spelled(mean, 2)} | "
            f"{entry.exact.expected(entry.exact.coverage):.2f} | {spelled(fifth, 2)} | {spelled(delivered, 2)} | "
            f"{spelled(pointing, 3)} |"
        )
    return lines


def each_table(summary: dict[str, Any]) -> list[str]:
    """One line per kind of fault."""
    lines = [
        "| fault | flights (failed) | observed area, mean [%] | least [%] | delivered to Earth, mean [%] | "
        "pointing error at the arrival, worst [deg] | at the end, worst [deg] | links closed at the end, mean |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, part in summary["scenarios"].items():
        outcomes = part["outcomes"]
        area = outcomes["coverage_percent"]
        arrival, final = (outcomes.get(f"pointing_error_deg_{when}_max") for when in ("arrival", "final"))
        lines.append(
            f"| {name} | {part['finished']} ({part['failed']}) | {area['mean']['value']:.2f} | {area['min']:.2f} | "
            f"{outcomes['delivered_percent']['mean']['value']:.2f} | {short(arrival)} | {short(final)} | "
            f"{outcomes['links_closed_final']['mean']['value']:.2f} |"
        )
    return lines


def sobol_table(summary: dict[str, Any]) -> list[str]:
    """Sobol' indices of the observed area."""
    lines = ["| factor | alone | with interactions |", "|---|---|---|"]
    (part,) = summary["scenarios"].values()
    for factor, indices in part["sobol"].get("coverage_percent", {}).items():
        lines.append(f"| {factor} | {index(indices['first'])} | {index(indices['total'])} |")
    return lines


def index(entry: dict[str, Any]) -> str:
    """A Sobol' index, or that there is none."""
    return spelled(entry, 2) if entry["told"] else f"{NOT_TOLD} ({entry['low']:.2f} to {entry['high']:.2f})"


def short(outcome: dict[str, Any] | None) -> str:
    """The largest value of an outcome."""
    return "-" if outcome is None else f"{outcome['max']:.3g}"


def words(estimate: Estimate, scale: float = 1.0, digits: int = 1) -> str:
    """An estimate and its interval."""
    return spelled({"value": estimate.value, "low": estimate.low, "high": estimate.high}, digits, scale)


def spelled(estimate: dict[str, float | None], digits: int, scale: float = 1.0) -> str:
    """The same from a summary; an end that the sample cannot tell is left open."""
    value, low, high = (estimate[end] for end in ("value", "low", "high"))
    ends = ["..." if end is None or not np.isfinite(end) else f"{scale * end:.{digits}f}" for end in (low, high)]
    return f"{scale * (value or 0.0):.{digits}f} ({ends[0]} to {ends[1]})"


def fly(name: str, folder: Path, runs: int | None) -> tuple[Resolved, pa.Table, dict[str, Any]]:
    """Fly a packaged campaign, or go on with it."""
    resolved = load_campaign(name, runs=runs)
    with progress_bars(Console()) as bars:
        begun = (folder / name / "campaign.json").exists()
        summary = run_campaign(resolved, folder / name, resume=begun, bars=bars, figures=False).summary
    return resolved, read_results(folder / name), summary


def time_needed(wall_s: float, went_on: bool) -> str:
    """What the command needs, in words: its own wall time where it flew everything, here and now."""
    if went_on:
        return "It went on with flights of an earlier call, so that its time says nothing of a whole one."
    minutes, cores = max(wall_s / 60.0, 0.1), usable_cores()
    return (
        f"It needed {minutes:.{0 if minutes >= 2.0 else 1}f} min on {cores} core{'s' if cores > 1 else ''} "
        "(wall time of that very call, other work included)."
    )


def main() -> None:
    """Fly, compute and write the page."""
    parser = argparse.ArgumentParser(prog="python -m scripts.pages.robustness", description=__doc__)
    parser.add_argument("--runs", type=int, metavar="N", help="flights of each swarm (default: 1,000)")
    parser.add_argument(
        "--out", type=Path, default=Path("results/robustness"), metavar="DIR", help="where the rows stand"
    )
    arguments = parser.parse_args()
    start, went_on = time.monotonic(), any((arguments.out / name).exists() for name in (LOSSES, SENSITIVITY, EACH))
    losses, rows, summary = fly(LOSSES, arguments.out, arguments.runs)
    sensitivity, sensitive_rows, sensitive = fly(SENSITIVITY, arguments.out, None)
    each_campaign, _, each = fly(EACH, arguments.out, None)
    found = degradations(losses, rows)
    for name, part in summary["scenarios"].items():
        part["spacecraft"] = next(row["spacecraft"] for row in rows.to_pylist() if row["scenario"] == name)
    save(compose_losses(found), IMAGES / "robustness-losses.png")
    for name, figure in (
        ("coverage", compose_coverage(losses, rows, summary)),
        ("pointing", compose_pointing(losses, rows, summary)),
        ("sobol", compose_sobol(sensitivity, sensitive_rows, sensitive)),
    ):
        if figure is not None:
            save(figure, IMAGES / f"robustness-{name}.png")
    flights = sum(part["finished"] for part in (summary, sensitive, each))
    write_text(PAGE, TEXT.format(
        runs=losses.campaign.runs,
        overall="\n".join(overall_table(found, summary)),
        losses="\n".join(losses_table(found)),
        sobol="\n".join(sobol_table(sensitive)),
        each="\n".join(each_table(each)),
        flights=flights,
        each_runs=each_campaign.campaign.runs,
        sensitivity_runs=sensitivity.campaign.runs,
        widest=statistics.WIDEST_INDEX,
        tolerance=load_scenario("eros-config1").designer.tolerance_percent,
        time=time_needed(time.monotonic() - start, went_on),
    ))  # fmt: skip
    print(f"wrote {PAGE}")


TEXT = """\
# Robustness

This page is generated by `python -m scripts.pages.robustness`, which flew {flights:,} flights for it, {runs:,} of each swarm.
{time}
Intervals are 95 % confidence intervals: Wilson's for probabilities, bootstrap for means, order statistics for percentiles. The
rows are Parquet files below `results/robustness`; every one can be flown again alone
(`swarm-mj campaign eros-losses --runs {runs} --out results/robustness/eros-losses --replay ROW`).

## The question

The fewest observers that see the whole target leave nothing to spare. What is left of the observed area when spacecraft are
lost on the way, and what does a design in which two spacecraft see every face gain? The packaged campaign `eros-losses`
flies `eros-config1` and `eros-config2` (a camera of 4.1 deg and the arrival alone, one reading of the paper:
[reproduction](reproduction.md)) {runs:,} times each, with the minimal design (five observers) and with the two-fold
one (eleven, the proven minimum of `swarm-mj design eros-config1 --fold 2`). Each spacecraft is lost with a chance of 10 %,
at a random time before the arrival. Masses, inertias, wheel friction, deployment velocities, gravity, gyros and star trackers
are dispersed; the file gives the numbers. Steps are 0.5 s long, the observer is the one of constant time.

## Losses

{overall}

*Exact* is the answer without dispersions: one undisturbed flight, all subsets of lost observers left out in turn, weighted
by the binomial law. The whole target counts as seen within the tolerance of the design, {tolerance:g} % of its area. The
communications spacecraft of Configuration 1 takes no pictures, so its loss costs links, not area. *Delivered* is what the
swarm brings to Earth by itself within two days, with the default radios ([from pixel to Earth](pixel_to_earth.md)). A lost
spacecraft takes along what it has gathered; where the relay is lost, another one speaks to Earth after the flight.

![Observed area by number of lost observers](../images/robustness-losses.png)

{losses}

![Distribution of the observed area](../images/robustness-coverage.png)

![Distribution of the pointing error at the arrival](../images/robustness-pointing.png)

## What the observed area depends on

Sobol' indices of the area that the minimal swarm of Configuration 2 sees without losses (campaign `eros-sensitivity`): the
share of its variance that each factor makes alone, and with all its interactions. *seed* stands for what the campaign
leaves to chance: initial attitudes and the noise of the sensors. The sample has {sensitivity_runs} groups; where it leaves an
interval wider than {widest:g}, it does not allow the index, and none is given. An area capped at 100 % needs a large sample.

![Sobol' indices](../images/robustness-sobol.png)

{sobol}

## One fault at a time

Configuration 2 with the minimal design, {each_runs} flights each (campaign `eros-each-fault`). A flight with a fault ends with
its result and its list of events, whatever happens. Pointing errors are those of spacecraft that still work. A relay that is
lost after the arrival takes along what the others had sent to it.

{each}
"""

if __name__ == "__main__":
    main()
