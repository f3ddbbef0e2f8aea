"""The swarm classes compared: the same dispersed encounters, with the same losses, flown by each class; tables and figures.

It is a campaign whose scenarios differ by their class alone and are `paired`: run k of every class has the same seed and the
same chance of loss, so that the same spacecraft are lost at the same times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from swarm_mj.campaigns.figures import COLOURS, DASHES
from swarm_mj.campaigns.loading import Resolved, resolve
from swarm_mj.campaigns.statistics import Estimate, mean, probability
from swarm_mj.errors import ScenarioError
from swarm_mj.figures.style import TICK_PT, label, new_figure, save, tidy
from swarm_mj.io.atomic import write_text
from swarm_mj.scenarios.itinerary import itinerary, last_arrival_s
from swarm_mj.scenarios.loading import NO_OVERRIDES
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array

#: What is flown, and what it is called.
VARIANTS = {
    "0": "alone: own target, own downlink",
    "1": "as 0, formation held by thrusters",
    "2": "roles of the behaviour",
    "3": "pictures and relay planned together",
    "4": "replanned in flight over the links",
}
#: The same with the visiting points that were planned together with the pictures.
PLACED = {
    "0 placed": "as 0, at the places planned for 3 and 4",
    "3 placed": "as 3, places planned too",
    "4 placed": "as 4, places planned too",
}
#: Largest chance with which each spacecraft is lost.
MOST_LOST = 0.4
#: Share of the time of flight after which an encounter is over, as far as pictures go.
OVER = 1.4
#: Those of an ordinary mission, see `eros-losses`; and those that a spacecraft from a file cannot have.
DISPERSIONS = {"deployment_velocity_m_s": 0.05, "mass_percent": 1, "inertia_percent": 3, "attitude_deg": 5}
OF_MASSES = ("mass_percent", "inertia_percent")
#: The same motion in less time, where the spacecraft is the packaged one with three wheels.
QUICK = {"physics.stepper": "kernel"}
#: From when on class 1 holds its formation at the latest, past the epoch [s]; earlier where the flight to the arrival is short.
FORMED_S, FORMED_SHARE = 60.0, 0.1
#: What is kept of every flight.
RECORD = (
    "coverage_percent",
    "delivered_percent",
    "time_to_all_data_s",
    "coordination_bits",
    "deployment_delta_v_m_s.sum",
    "thrust_delta_v_m_s.sum",
    "formation_bits",
    "lost",
    "images",
)

#: Parts of the range of the chance of loss that are one point of a curve.
PARTS = 5
#: Names of the files that `write_report` makes.
TABLE, FIGURE, BY_LOST = "classes.md", "classes_chance.png", "classes_lost.png"


def classes_campaign(
    base: Scenario,
    *,
    runs: int = 200,
    places: Sequence[int] = (),
    overrides: Mapping[str, Any] = NO_OVERRIDES,
) -> Resolved:
    """The campaign that flies all classes of a scenario through `runs` encounters each.

    Those with roles fly once more with `places`, visiting points planned together with the pictures, see `robust_points`.

    Raises:
        ScenarioError: The scenario cannot be read, or not be flown so.
    """
    whole = base.model_dump(mode="json")
    data = {
        "name": f"{base.name}-classes",
        "description": f"Swarm classes on {base.name}: the same encounters, the same losses",
        "runs": runs,
        "method": "latin_hypercube",
        "paired": True,
        "scenarios": [
            {"name": f"class {name}", "scenario": whole, "set": _changes(base, name, places)}
            for name in (*VARIANTS, *(PLACED if places else ()))
        ],
        "set": {**_common(base), "duration_s": _duration_s(base), "faults": [_losses(base)], **overrides},
        "parameters": {"faults.0.probability": {"distribution": "uniform", "low": 0.0, "high": MOST_LOST}},
        "record": list(RECORD),
    }
    return resolve(data, f"classes of {base.name}")


def _changes(base: Scenario, name: str, places: Sequence[int]) -> dict[str, Any]:
    changes: dict[str, Any] = {"swarm": {"class": int(name[0])}}
    if name[0] in "01":
        changes |= {"data.election": "flight", "data.relays": 1, "data.election_interval_s": None}
    if name == "1":
        changes["swarm"]["formation"] = {"reference": "mean", "start_s": _formed_s(base)}
        thrusters = base.spacecraft.thrusters
        if thrusters is None or thrusters.layout == "four_z":
            changes["spacecraft.thrusters"] = {}
    if name in PLACED:
        changes["design.visiting_points"] = list(places)
    return changes


def _common(base: Scenario) -> dict[str, Any]:
    """What all classes have in common; horizon maps judge pictures in no time."""
    own = base.spacecraft.mjcf is not None
    dispersions = {key: value for key, value in DISPERSIONS.items() if not (own and key in OF_MASSES)}
    quick = QUICK if not own and base.spacecraft.wheel_layout == "orthogonal" else {}
    return {"observation.observer": "horizon", "dispersions": dispersions, **quick}


def _formed_s(base: Scenario) -> float:
    """When the formation begins: soon, but not before all have left the mothership."""
    releases = [base.design.release_s, *(stop.release_s for stop in itinerary(base))]
    return max(min(FORMED_S, FORMED_SHARE * base.design.time_of_flight_s), *releases)


def _duration_s(base: Scenario) -> float:
    """Until pictures are over; the way of the data goes on after the flight."""
    step = base.observation.interval_s
    return min(base.duration_s, float(np.ceil(OVER * last_arrival_s(base) / step)) * step)


def _losses(base: Scenario) -> dict[str, Any]:
    between = [0.0, last_arrival_s(base)]
    return {"kind": "spacecraft_lost", "spacecraft": "all", "probability": 0.0, "between_s": between}


class ClassResult(NamedTuple):
    """What a class came to.

    Attributes:
        name: Of the class.
        seen: Observed area of all encounters [%].
        delivered: Delivered area [%].
        whole: Chance that the whole target is observed.
        delta_v_m_s: Of the deployment of the whole swarm, mean.
        thrust_m_s: Of the whole swarm's thrusters in flight, mean; NaN without any.
        message_bit: Of coordination and formation, mean.
        map_h: Time until all that was observed is on Earth, mean of those flights where it is [h]; NaN where it never is.
        by_lost: Delivered area by number of lost spacecraft [%].
    """

    name: str
    seen: Estimate
    delivered: Estimate
    whole: Estimate
    delta_v_m_s: float
    thrust_m_s: float
    message_bit: float
    map_h: float
    by_lost: dict[int, Estimate]


def class_results(results: pa.Table) -> list[ClassResult]:
    """What each class came to, in the order of the campaign.

    Raises:
        ScenarioError: No flight of a class succeeded.
    """
    found, rows = [], results.to_pylist()
    for name in dict.fromkeys(row["scenario"] for row in rows):
        own = [row for row in rows if row["scenario"] == name and row["status"] == "ok"]
        if not own:
            first = next(row["error"] for row in rows if row["scenario"] == name)
            raise ScenarioError(f"{name}: no flight succeeded; the first ended with: {first}")
        found.append(_result(name.removeprefix("class "), own))
    return found


def _result(name: str, rows: list[dict[str, Any]]) -> ClassResult:
    def values(key: str) -> Array:
        return np.array([row[key] if row[key] is not None else np.nan for row in rows], np.float64)

    rng, lost = np.random.default_rng(0), values("lost")
    delivered, map_s = values("delivered_percent"), values("time_to_all_data_s")
    return ClassResult(
        name=name,
        seen=mean(values("coverage_percent"), rng),
        delivered=mean(delivered, rng),
        whole=probability(sum(row["covered"] for row in rows), len(rows)),
        delta_v_m_s=float(np.nanmean(values("deployment_delta_v_m_s_sum"))),
        thrust_m_s=_mean(values("thrust_delta_v_m_s_sum")),
        message_bit=float(np.nan_to_num(values("coordination_bits")).mean() + values("formation_bits").mean()),
        map_h=_mean(map_s) / 3600.0,
        by_lost={int(k): mean(delivered[lost == k], rng) for k in np.unique(lost)},
    )


def _mean(values: Array) -> float:
    """Of what is known; NaN where nothing is."""
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


class Recovery(NamedTuple):
    """What one class keeps, with one loss, of what another loses.

    Attributes:
        flights: Pairs of flights with exactly one loss.
        lost: Area that the planned class lacks against its own flight without losses, mean [%].
        kept: Area by which the other class has more, in the same encounters, mean [%].
        other_lost: Area that the other class lacks against its own flights without losses, mean [%].
    """

    flights: int
    lost: Estimate
    kept: Estimate
    other_lost: Estimate

    @property
    def share(self) -> float:
        """Of what was lost; NaN where nothing was."""
        return self.kept.value / self.lost.value if self.lost.value > 0.0 else float("nan")


def recovery(results: pa.Table, planned: str, replanned: str, key: str = "delivered_percent") -> Recovery:
    """How much of `key` that the class whose plan is not repaired loses with one loss the other one still brings home."""
    rows = [row for row in results.to_pylist() if row["status"] == "ok"]
    one, other = ({row["run"]: row for row in rows if row["scenario"] == name} for name in (planned, replanned))
    whole, others_whole = ([row[key] for row in rows_of.values() if row["lost"] == 0] for rows_of in (one, other))
    runs = [run for run, row in one.items() if row["lost"] == 1 and run in other]
    if not whole or not others_whole or not runs:
        nothing = Estimate(np.nan, np.nan, np.nan)
        return Recovery(0, nothing, nothing, nothing)
    mine, theirs = (np.array([rows_of[run][key] for run in runs]) for rows_of in (one, other))
    rng = np.random.default_rng(0)
    others_lost = mean(float(np.mean(others_whole)) - theirs, rng)
    return Recovery(len(runs), mean(float(np.mean(whole)) - mine, rng), mean(theirs - mine, rng), others_lost)


def table_of_classes(found: Sequence[ClassResult]) -> str:
    """The table in Markdown: one row a class."""
    lines = [
        "| class | what | observed [%] | delivered [%] | whole target observed | deployment Delta-v [m/s] | "
        "propellant Delta-v [m/s] | messages [Mbit] | map on Earth [h] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for one in found:
        what = {**VARIANTS, **PLACED}.get(one.name, "")
        whole = f"{100.0 * one.whole.value:.0f} % ({100.0 * one.whole.low:.0f} to {100.0 * one.whole.high:.0f})"
        map_h, thrust = (f"{value:.2f}" if np.isfinite(value) else "-" for value in (one.map_h, one.thrust_m_s))
        lines.append(
            f"| {one.name} | {what} | {_interval(one.seen)} | {_interval(one.delivered)} | {whole} | {one.delta_v_m_s:.1f} | "
            f"{thrust} | {one.message_bit / 1e6:.1f} | {map_h} |"
        )
    return "\n".join(lines) + "\n"


def table_by_lost(found: Sequence[ClassResult]) -> str:
    """Delivered area by number of lost spacecraft, in Markdown."""
    numbers = sorted({number for one in found for number in one.by_lost})
    lines = [
        f"| class | {' | '.join(f'{number} lost' for number in numbers)} |",
        f"|---|{'---|' * len(numbers)}",
    ]
    for one in found:
        cells = [f"{one.by_lost[number].value:.1f}" if number in one.by_lost else "-" for number in numbers]
        lines.append(f"| {one.name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _interval(estimate: Estimate) -> str:
    return f"{estimate.value:.1f} ({estimate.low:.1f} to {estimate.high:.1f})"


def compose_chance(results: pa.Table) -> Figure:
    """Mean observed and delivered area over the chance with which each spacecraft is lost."""
    figure = new_figure(4.9, "What losses leave, by class", width_in=11.0)
    edges = np.linspace(0.0, MOST_LOST, PARTS + 1)
    rows = [row for row in results.to_pylist() if row["status"] == "ok"]
    left, right = figure.subplots(1, 2, sharey=True)
    for ax, key, what in ((left, "coverage_percent", "observed"), (right, "delivered_percent", "delivered")):
        for k, name in enumerate(dict.fromkeys(row["scenario"] for row in rows)):
            own = [row for row in rows if row["scenario"] == name]
            chance = np.array([row["faults.0.probability"] for row in own])
            value = np.array([row[key] for row in own], np.float64)
            part = np.clip(np.digitize(chance, edges) - 1, 0, PARTS - 1)
            x = [100.0 * chance[part == p].mean() for p in range(PARTS) if (part == p).any()]
            y = [value[part == p].mean() for p in range(PARTS) if (part == p).any()]
            ax.plot(x, y, linewidth=1.6, label=name, **_style(k))
        ax.set_ylim(0.0, 101.0)
        tidy(ax)
        label(ax, "chance of loss of each spacecraft [%]", f"{what} share of the target, mean [%]")
    _add_legend(figure, left)
    return figure


def compose_by_lost(found: Sequence[ClassResult]) -> Figure:
    """Delivered area by number of lost spacecraft, with intervals."""
    figure = new_figure(4.8, "Delivered area by number of lost spacecraft")
    ax = figure.add_subplot()
    for k, one in enumerate(found):
        x = np.array(sorted(one.by_lost))
        y, low, high = np.array([(e.value, e.low, e.high) for e in (one.by_lost[int(n)] for n in x)]).T
        around = np.nan_to_num(np.maximum([y - low, high - y], 0.0))  # no interval where too few were flown
        apart = 0.03 * (k - len(found) / 2)
        ax.errorbar(x + apart, y, yerr=around, capsize=2, label=one.name, **_style(k))
    ax.set_ylim(0.0, 101.0)
    tidy(ax)
    label(ax, "lost spacecraft [-]", "delivered share of the target, mean [%]")
    _add_legend(figure, ax, title="class")
    return figure


def _style(k: int) -> dict[str, Any]:
    """How the curve of the k-th class is drawn."""
    return {"marker": "o", "markersize": 4, "color": COLOURS[k % len(COLOURS)], "linestyle": DASHES[k % len(DASHES)]}


def _add_legend(figure: Figure, ax: Axes, title: str | None = None) -> None:
    handles, names = ax.get_legend_handles_labels()
    style = {"ncols": 4, "fontsize": TICK_PT, "frameon": False, "title": title}
    figure.legend(handles, names, loc="outside lower center", **style)


def write_report(folder: Path, found: Sequence[ClassResult], results: pa.Table, *, figures: bool = True) -> None:
    """Write the tables, and the figures if wanted, into a folder."""
    write_text(folder / TABLE, f"{table_of_classes(found)}\n{table_by_lost(found)}")
    if figures:
        save(compose_chance(results), folder / FIGURE)
        save(compose_by_lost(found), folder / BY_LOST)
