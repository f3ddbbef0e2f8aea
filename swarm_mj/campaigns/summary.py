"""The summary of a campaign, `summary.json`, and its table on the screen.

What a campaign swept, the designs on its grid, makes a group of runs each. Runs of different designs are no sample of anything,
so that a probability over all of them says nothing. What is random within a design (dispersions, faults, attitudes) makes no
groups.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from rich.markup import escape
from rich.table import Table

from swarm_mj.campaigns import statistics
from swarm_mj.campaigns.config import Campaign
from swarm_mj.campaigns.distributions import Choice
from swarm_mj.campaigns.flying import recorded
from swarm_mj.campaigns.loading import Resolved
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.campaigns.statistics import Estimate
from swarm_mj.campaigns.store import WALL
from swarm_mj.io.atomic import write_text
from swarm_mj.io.records import writing
from swarm_mj.records.summary import library_versions
from swarm_mj.typing import Array

SUMMARY = "summary.json"
QUANTILES = (0.05, 0.5, 0.95, 0.99)
#: Name of the seed among the factors of Sobol' indices.
SEED = "seed"
#: First number in the names of the children of the campaign's seed: for resampling.
RESAMPLING = 2
#: Longest value of a swept key in a label.
LONGEST = 24


def write_summary(folder: Path, resolved: Resolved, results: pa.Table) -> dict[str, Any]:
    """Sum up and write `summary.json`."""
    summary = summarise_campaign(resolved, results)
    text = json.dumps(summary, indent=2, allow_nan=False) + "\n"
    with writing(folder / SUMMARY, "go on with --resume"):
        write_text(folder / SUMMARY, text)
    return summary


def summarise_campaign(resolved: Resolved, results: pa.Table) -> dict[str, Any]:
    """The summary of all finished runs: plain values, ready for JSON; what cannot be told is null."""
    campaign = resolved.campaign
    status = column(results, "status")
    wall = [seconds for seconds in results[WALL].to_pylist() if seconds is not None]
    return {
        "campaign": campaign.name,
        "description": campaign.description,
        "method": campaign.method,
        "seed": campaign.seed,
        "runs": Sample(campaign).rows,
        "finished": len(results),
        "failed": int((status == "failed").sum()),
        "confidence_level": statistics.LEVEL,
        "scenarios": {
            name: {"observer": resolved.bases[name].observation.observer, **_scenario(resolved, part)}
            for name, part in by_scenario(resolved, results)
        },
        "flight_s": round(float(np.sum(wall)), 3),
        "versions": library_versions(),
    }


def by_scenario(resolved: Resolved, results: pa.Table) -> Iterator[tuple[str, pa.Table]]:
    """The rows of each scenario, in the order of the campaign."""
    of = column(results, "scenario")
    for name in resolved.bases:
        yield name, results.filter(pa.array(of == name))


def column(results: pa.Table, name: str) -> NDArray[Any]:
    """A column as an array; numbers are floats, NaN where null."""
    kind = results.schema.field(name).type
    values = results[name].to_pylist()
    if kind == pa.string():
        return np.array(values, dtype=object)
    return np.array([np.nan if value is None else value for value in values], np.float64)


def swept(campaign: Campaign) -> list[str]:
    """Keys that take several values on the campaign's grid; none where it has no grid."""
    if campaign.method != "grid":
        return []
    return [key for key, law in campaign.parameters.items() if law.count > 1]


def groups(campaign: Campaign, rows: pa.Table) -> Iterator[tuple[dict[str, Any], pa.Table]]:
    """The rows of one scenario by point of the grid, in its order: the swept values, and the rows that were flown with them."""
    keys, sample = swept(campaign), Sample(campaign)
    if not keys:
        return
    place = np.array(rows["run"].to_pylist(), np.int64) // campaign.runs
    for number in np.unique(place).tolist():
        values = sample.grid_point(number)
        yield {key: values[key] for key in keys}, rows.filter(pa.array(place == number))


def label_of(values: dict[str, Any]) -> str:
    """Swept values in a few words: `half_angle_deg=5, rows=2`."""
    return ", ".join(f"{key.rpartition('.')[2]}={value_label(value)}" for key, value in values.items())


def value_label(value: Any) -> str:
    """A swept value in a few words."""
    if isinstance(value, float):
        return f"{value:.4g}"
    words = value if isinstance(value, str) else json.dumps(value)
    return words if len(words) <= LONGEST else words[: LONGEST - 3] + "..."


def _scenario(resolved: Resolved, rows: pa.Table) -> dict[str, Any]:
    ok = rows.filter(pa.array(column(rows, "status") == "ok"))
    columns = {name: column(ok, name) for name in ("covered", *recorded(resolved.campaign))}
    rng = np.random.default_rng(np.random.SeedSequence(resolved.campaign.seed, spawn_key=(RESAMPLING,)))
    outcomes = {}
    for name, values in columns.items():
        finite = values[np.isfinite(values)]
        if name != "covered" and len(finite):
            outcomes[name] = _outcome(finite, rng)
    summary = {
        "finished": len(rows),
        "failed": len(rows) - len(ok),
        "covered": _covered(columns["covered"]),
        "outcomes": outcomes,
        "spearman": _correlations(resolved, ok, columns),
        "choices": _choices(resolved, ok, columns),
    }
    if keys := swept(resolved.campaign):
        # What stands above is of all designs together; the probability of each is here.
        summary |= {"swept": keys, "groups": [_group(resolved, *group) for group in groups(resolved.campaign, rows)]}
    if resolved.campaign.method == "saltelli":
        summary["sobol"] = _sobol(resolved, rows, columns, rng)
    return summary


def _group(resolved: Resolved, values: dict[str, Any], rows: pa.Table) -> dict[str, Any]:
    """The runs of one point of a grid."""
    ok = rows.filter(pa.array(column(rows, "status") == "ok"))
    means = {}
    for name in recorded(resolved.campaign):
        found = column(ok, name)
        if np.isfinite(found).any():
            means[name] = float(found[np.isfinite(found)].mean())
    return {
        "values": values,
        "finished": len(rows),
        "failed": len(rows) - len(ok),
        "covered": _covered(column(ok, "covered")),
        "means": means,
    }


def _choices(resolved: Resolved, ok: pa.Table, columns: dict[str, Array]) -> dict[str, dict[str, Any]]:
    """How strongly every outcome depends on what was chosen among values of any kind."""
    rng = np.random.default_rng(np.random.SeedSequence(resolved.campaign.seed, spawn_key=(RESAMPLING, 1)))
    laws = resolved.campaign.parameters
    chosen = {key: np.array(list(map(str, ok[key].to_pylist()))) for key in laws if isinstance(laws[key], Choice)}
    return _depending(columns, chosen, lambda groups, y: statistics.correlation_ratio(groups, y, rng))


def _covered(covered: Array) -> dict[str, Any]:
    """How probable it is that the whole target is seen, among flights that did not fail."""
    n, successes = len(covered), int(covered.sum())
    wilson, exact = (statistics.probability(successes, n, method) for method in ("wilson", "exact"))
    return {
        "flights": n,
        "covered": successes,
        "probability": _number(wilson.value),
        "wilson": [wilson.low, wilson.high],
        "clopper_pearson": [exact.low, exact.high],
    }


def _outcome(values: Array, rng: np.random.Generator) -> dict[str, Any]:
    return {
        "flights": len(values),
        "mean": _estimate(statistics.mean(values, rng)),
        "std": _number(values.std(ddof=1)) if len(values) > 1 else None,
        "min": float(values.min()),
        "max": float(values.max()),
        "quantiles": {f"{p:g}": _estimate(statistics.quantile(values, p)) for p in QUANTILES},
    }


def _correlations(resolved: Resolved, ok: pa.Table, columns: dict[str, Array]) -> dict[str, Any]:
    """Spearman's rank correlation of every outcome with every drawn number."""
    numbers = [key for key in resolved.campaign.parameters if ok.schema.field(key).type != pa.string()]
    return _depending(columns, {key: column(ok, key) for key in numbers}, statistics.spearman)


def _depending(
    columns: dict[str, Array], drawn: dict[str, NDArray[Any]], measure: Callable[..., tuple[Estimate, float] | None]
) -> dict[str, dict[str, Any]]:
    """How every outcome depends on everything drawn, where a measure can tell."""
    found: dict[str, dict[str, Any]] = {}
    for key, x in drawn.items():
        for name, values in columns.items():
            there = np.isfinite(values)
            answer = measure(x[there], values[there])
            if answer is not None:
                found.setdefault(name, {})[key] = {**_estimate(answer[0]), "p_value": answer[1]}
    return found


def _sobol(resolved: Resolved, rows: pa.Table, columns: dict[str, Array], rng: np.random.Generator) -> dict[str, Any]:
    """Sobol' indices of every outcome; a failed run leaves a hole in the sample, and then there are none."""
    width = Sample(resolved.campaign).group
    factors = [*resolved.campaign.parameters, SEED]
    found = {}
    for name, values in columns.items():
        if len(values) != len(rows) or len(values) % width or not np.isfinite(values).all():
            continue
        indices = statistics.sobol(values.reshape(-1, width), rng)
        if indices is not None:
            found[name] = {
                factor: {"first": _index(first), "total": _index(total)}
                for factor, first, total in zip(factors, *indices, strict=True)
            }
    return found


def _index(index: Estimate) -> dict[str, Any]:
    return {**_estimate(index), "told": statistics.index_told(index)}


def sobol_findings(summary: dict[str, Any]) -> list[str]:
    """One line per scenario with indices of the observed area that its sample does not allow."""
    remarks = []
    for name, scenario in summary["scenarios"].items():
        indices = scenario.get("sobol", {}).get("coverage_percent", {})
        vague = [factor for factor, parts in indices.items() if not all(part["told"] for part in parts.values())]
        if vague:
            remarks.append(
                f"{name}: Sobol' indices of the observed area: the sample does not allow those of {', '.join(vague)} "
                f"(intervals wider than {statistics.WIDEST_INDEX:g}); raise runs"
            )
    return remarks


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return {"value": _number(estimate.value), "low": _number(estimate.low), "high": _number(estimate.high)}


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


#: Lines of the table: words, outcome and what of it.
LINES = {
    "observed area, mean [%]": ("coverage_percent", "mean"),
    "observed area, 5th percentile [%]": ("coverage_percent", "0.05"),
    "delivered to Earth, mean [%]": ("delivered_percent", "mean"),
    "delivered to Earth, 5th percentile [%]": ("delivered_percent", "0.05"),
    "pointing error at the arrival, 95th percentile [deg]": ("pointing_error_deg_arrival_max", "0.95"),
    "wheel speed, 95th percentile [% of limit]": ("max_wheel_speed_fraction", "0.95"),
}
#: Outcomes that the table gives in percent, as that of a single run does.
IN_PERCENT = {"max_wheel_speed_fraction"}
#: With more scenarios than these, each gets a line instead of a column.
MAX_COLUMNS = 4
#: Lines of the table of designs.
MAX_LINES = 40


def summary_table(summary: dict[str, Any]) -> Table:
    """A short table: one column a scenario, or one line where there are many."""
    scenarios: dict[str, dict[str, Any]] = summary["scenarios"]
    cells = {
        "flights (failed)": [f"{s['finished']} ({s['failed']})" for s in scenarios.values()],
        "P(whole target seen) [%], 95 % interval": [
            "by design, below" if "groups" in s else _in_words(s["covered"]) for s in scenarios.values()
        ],
    }
    for words, (outcome, what) in LINES.items():
        found = [s["outcomes"].get(outcome) for s in scenarios.values()]
        if any(found):
            scale = 100.0 if outcome in IN_PERCENT else 1.0
            cells[words] = [_cell(entry, what, scale) for entry in found]
    table = Table(title=f"Campaign {summary['campaign']}", title_justify="left")
    table.caption = f"{summary['flight_s']:.0f} s of computing in all"
    by_line = len(scenarios) > MAX_COLUMNS
    table.add_column("")
    for heading in cells if by_line else scenarios:
        table.add_column(escape(heading), justify="right")
    if by_line:
        for k, name in enumerate(scenarios):
            table.add_row(escape(name), *(row[k] for row in cells.values()))
    else:
        for words, row in cells.items():
            table.add_row(escape(words), *row)
    return table


def group_table(summary: dict[str, Any]) -> Table | None:
    """A line for every design that a campaign swept, at most `MAX_LINES`; None: it swept nothing."""
    lines = [(name, group) for name, scenario in summary["scenarios"].items() for group in scenario.get("groups", [])]
    if not lines:
        return None
    table = Table(title=f"Designs of {summary['campaign']}", title_justify="left")
    keys = list(lines[0][1]["values"])
    for heading in ("scenario", *keys):
        table.add_column(escape(heading))
    for heading in ("flights (failed)", "P(whole target seen) [%], 95 % interval", "observed area, mean [%]"):
        table.add_column(escape(heading), justify="right")
    for name, group in lines[:MAX_LINES]:
        area = group["means"].get("coverage_percent")
        table.add_row(
            escape(name),
            *(escape(value_label(group["values"][key])) for key in keys),
            f"{group['finished']} ({group['failed']})",
            _in_words(group["covered"]),
            "-" if area is None else _short(area),
        )
    if len(lines) > MAX_LINES:
        table.caption = f"{MAX_LINES} of {len(lines)}; all are in {SUMMARY}"
    return table


def _in_words(covered: dict[str, Any]) -> str:
    if covered["probability"] is None:
        return "-"
    low, high = covered["wilson"]
    return f"{100 * covered['probability']:.1f} ({100 * low:.1f} to {100 * high:.1f})"


def _cell(outcome: dict[str, Any] | None, what: str, scale: float) -> str:
    if outcome is None:
        return "-"
    estimate = outcome["mean"] if what == "mean" else outcome["quantiles"][what]
    low, high = estimate["low"], estimate["high"]
    words = _short(scale * estimate["value"])
    return words + ("" if low is None or high is None else f" ({_short(scale * low)} to {_short(scale * high)})")


def _short(value: float) -> str:
    return f"{value:.4g}"
