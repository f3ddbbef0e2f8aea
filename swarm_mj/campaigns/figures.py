"""The figures of a campaign, one PNG each; a figure without numbers to show is not drawn."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from textwrap import wrap
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from swarm_mj.campaigns.loading import Resolved
from swarm_mj.campaigns.summary import SEED, by_scenario, column, groups, label_of, swept, value_label
from swarm_mj.figures.palette import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY_BLUE, VERMILLION
from swarm_mj.figures.style import SMALL_PT, TICK_PT, label, new_figure, plain, save, tidy
from swarm_mj.io.records import writing
from swarm_mj.typing import Array

T = TypeVar("T")
Compose = Callable[[Resolved, pa.Table, dict[str, Any]], Figure | None]

COLOURS = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY_BLUE, BLACK, GREY)
DASHES = ("-", "--", "-.", ":")
#: Diagrams get too many lines or bars to read beyond these.
MAX_SCENARIOS, MAX_BARS = 8, 12
#: Longer names than these are written aslant under more than three bars.
LONG_NAME = 30
#: Pointing errors [deg] below this are rounding; zero has no place on a logarithmic axis.
FLOOR_DEG = 1e-8
#: In place of the bar of an index that a sample cannot tell.
NOT_TOLD = "the sample does not allow it"
#: Height of the 95th percentile, and between the intervals of two scenarios there, which lie around it, of the whole axis.
PERCENTILE, SPREAD = 0.95, 0.025
#: An axis is logarithmic where the largest value is this many times the smallest.
LOG_RATIO = 20.0
#: Scenarios that get a panel each; values of one factor for which there is room, and cells whose numbers can be read.
MAX_PANELS, MAX_LEVELS, MAX_NUMBERS = 4, 40, 12


def compose_coverage(resolved: Resolved, results: pa.Table, summary: dict[str, Any]) -> Figure | None:
    """How often the whole target is seen, and how the observed area is distributed."""
    parts, covered = _by_design(resolved, results, summary)
    if not parts:
        return None
    parts, title = _shown(parts, f"Observed area: {plain(resolved.campaign.name)}")
    figure = new_figure(4.6, title, width_in=11.0)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
    _bars(left, {name: covered[name] for name in parts})
    for k, (name, values) in enumerate(parts.items()):
        _cumulative(right, values, name, k)
    right.set_ylim(0.0, 1.02)
    tidy(right)
    label(right, "observed share of the target [%]", "share of flights with at most that [-]")
    right.legend(fontsize=TICK_PT, frameon=False, loc="upper left")
    return figure


def compose_trade(resolved: Resolved, results: pa.Table, summary: dict[str, Any]) -> Figure | None:
    """How probable it is that the whole target is seen, by one swept factor or two; more are left to the table."""
    keys = swept(resolved.campaign)
    scenarios = {
        name: entry["groups"]
        for name, entry in summary["scenarios"].items()
        if any(map(_told, entry.get("groups", [])))
    }
    levels = {key: _levels(scenarios, key) for key in keys}
    if not scenarios or len(keys) not in (1, 2) or max(map(len, levels.values())) > MAX_LEVELS:
        return None
    shown = list(scenarios)[:MAX_PANELS]
    more = "" if len(shown) == len(scenarios) else f", {len(shown)} of {len(scenarios)}"
    title = f"Flights that see the whole target: {plain(resolved.campaign.name)}{more}"
    figure = new_figure(4.6, title, width_in=max(6.0, 5.0 * len(shown)))
    panels = figure.subplots(1, len(shown), squeeze=False)[0]
    for ax, name in zip(panels, shown, strict=True):
        (_line if len(keys) == 1 else _heat_map)(ax, levels, list(filter(_told, scenarios[name])))
        if len(shown) > 1:
            ax.set_title(plain(name), fontsize=TICK_PT)
    if len(keys) == 2:
        bar = figure.colorbar(panels[-1].images[0], ax=list(panels))
        label(bar.ax, y="probability [%]")
    return figure


def compose_pointing(resolved: Resolved, results: pa.Table, summary: dict[str, Any]) -> Figure | None:
    """Distribution of the largest pointing error at the arrival, with 95th percentiles and their intervals."""
    name = "pointing_error_deg_arrival_max"
    parts = _flown(resolved, results, name)
    if not parts:
        return None
    parts, title = _shown(parts, f"Pointing error at the arrival: {plain(resolved.campaign.name)}")
    figure = new_figure(5.0 + 0.25 * -(-len(parts) // 3), title)
    ax = figure.add_subplot()
    for k, (scenario, values) in enumerate(parts.items()):
        _cumulative(ax, np.maximum(values, FLOOR_DEG), scenario, k)
        estimate = summary["scenarios"][scenario]["outcomes"][name]["quantiles"][f"{PERCENTILE:g}"]
        _percentile(ax, estimate, PERCENTILE + SPREAD * (0.5 * (len(parts) - 1) - k), k)
    every = np.concatenate(list(parts.values()))
    if every.max() > LOG_RATIO * max(every.min(), FLOOR_DEG):
        ax.set_xscale("log")
    ax.set_ylim(0.0, max(1.02, PERCENTILE + 0.5 * SPREAD * len(parts)))
    tidy(ax)
    label(ax, "largest pointing error of an observer [deg]", "share of flights with at most that [-]")
    title = "dot: 95th percentile, bar: its 95 % interval (heights differ only to tell them apart)"
    look: dict[str, Any] = {
        "fontsize": TICK_PT,
        "title_fontsize": SMALL_PT,
        "frameon": False,
        "ncols": min(len(parts), 3),
    }
    figure.legend(loc="outside lower center", title=title, **look)
    return figure


def compose_sensitivity(resolved: Resolved, results: pa.Table, summary: dict[str, Any]) -> Figure | None:
    """Spearman's rank correlation of the observed area with every drawn number, and its correlation ratio with choices."""
    # A choice among numbers has a rank correlation too, which tells the direction.
    found = {
        name: s.get("choices", {}).get("coverage_percent", {}) | s["spearman"].get("coverage_percent", {})
        for name, s in summary["scenarios"].items()
    }
    keys = _strongest(found, lambda entry: abs(entry["value"]))
    return _tornado(
        f"What moves the observed area: {plain(resolved.campaign.name)}",
        "rank correlation with the observed area (choices: correlation ratio) [-]",
        keys,
        {name: entries for name, entries in found.items() if entries},
        (-1.05, 1.05),
    )


def compose_sobol(resolved: Resolved, results: pa.Table, summary: dict[str, Any]) -> Figure | None:
    """Sobol' indices of the observed area: a factor alone, and with its interactions; in words where the sample tells none."""
    found = {}
    for name, scenario in summary["scenarios"].items():
        entries = scenario.get("sobol", {}).get("coverage_percent", {})
        for part in ("first", "total"):
            if entries:
                found[f"{name}, {'alone' if part == 'first' else 'with interactions'}"] = {
                    ("seed (attitudes, faults)" if key == SEED else key): value[part] for key, value in entries.items()
                }
    keys = _strongest(found, lambda entry: entry["value"] if entry["told"] else 0.0)
    title = f"Shares of the variance of the observed area: {plain(resolved.campaign.name)}"
    told = [entry for entries in found.values() for entry in entries.values() if entry["told"]]
    ends = [entry[end] for entry in told for end in ("low", "high")]
    limits = (min([-0.05, *ends]) - 0.03, max([1.0, *ends]) + 0.03)
    return _tornado(title, "Sobol' index [-]", keys, found, limits)


COMPOSERS: dict[str, Compose] = {
    "coverage": compose_coverage,
    "trade": compose_trade,
    "pointing": compose_pointing,
    "sensitivity": compose_sensitivity,
    "sobol": compose_sobol,
}


def draw_all(folder: Path, resolved: Resolved, results: pa.Table, summary: dict[str, Any]) -> None:
    """Write every figure that there are numbers for."""
    for name, compose in COMPOSERS.items():
        figure = compose(resolved, results, summary)
        if figure is None:
            continue
        with writing(folder / f"{name}.png", "go on with --resume"):
            save(figure, folder / f"{name}.png")


def _flown(resolved: Resolved, results: pa.Table, name: str) -> dict[str, Array]:
    """Finite values of an outcome by scenario."""
    if name not in results.schema.names:
        return {}
    parts: dict[str, Array] = {}
    for scenario, rows in by_scenario(resolved, results):
        values = column(rows, name)
        if np.isfinite(values).any():
            parts[scenario] = values[np.isfinite(values)]
    return parts


def _by_design(
    resolved: Resolved, results: pa.Table, summary: dict[str, Any]
) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
    """Observed areas, and how often all is seen, by scenario, or by design where designs were swept."""
    parts = _flown(resolved, results, "coverage_percent")
    if not swept(resolved.campaign):
        return parts, {name: summary["scenarios"][name]["covered"] for name in parts}
    areas: dict[str, Array] = {}
    covered: dict[str, dict[str, Any]] = {}
    for name, rows in by_scenario(resolved, results):
        found = zip(groups(resolved.campaign, rows), summary["scenarios"][name]["groups"], strict=True)
        for (values, of_group), entry in found:
            area = column(of_group, "coverage_percent") if name in parts else np.empty(0)
            if np.isfinite(area).any() and entry["covered"]["probability"] is not None:
                words = label_of(values) if len(parts) == 1 else f"{name}, {label_of(values)}"
                words += f" ({len(areas)})" if words in areas else ""  # long values may look alike
                areas[words], covered[words] = area[np.isfinite(area)], entry["covered"]
    return areas, covered


def _shown(parts: dict[str, T], title: str) -> tuple[dict[str, T], str]:
    """As many scenarios as a diagram can show, and a title that says so where there are more."""
    if len(parts) <= MAX_SCENARIOS:
        return parts, title
    return dict(list(parts.items())[:MAX_SCENARIOS]), f"{title}, {MAX_SCENARIOS} of {len(parts)}"


def _cumulative(ax: Axes, values: Array, name: str, k: int) -> None:
    ordered = np.sort(values)
    share = np.arange(1, len(ordered) + 1) / len(ordered)
    colour, dashes = COLOURS[k % len(COLOURS)], DASHES[k % len(DASHES)]
    x, y = np.r_[ordered[0], ordered], np.r_[0.0, share]
    ax.step(x, y, where="post", linewidth=1.8, label=plain(name), color=colour, linestyle=dashes)


def _percentile(ax: Axes, estimate: dict[str, Any], y: float, k: int) -> None:
    """The estimate of a percentile [deg] as a dot and its interval as a bar, at a height."""
    ends = [estimate[end] if estimate[end] is not None else estimate["value"] for end in ("low", "high")]
    x = max(estimate["value"], FLOOR_DEG)
    around = [[max(x - max(ends[0], FLOOR_DEG), 0.0)], [max(ends[1] - x, 0.0)]]
    ax.errorbar([x], [y], xerr=around, fmt="o", color=COLOURS[k % len(COLOURS)], capsize=3, markersize=4)


def _bars(ax: Axes, covered: dict[str, dict[str, Any]]) -> None:
    for k, entry in enumerate(covered.values()):
        p, (low, high) = 100.0 * entry["probability"], (100.0 * end for end in entry["wilson"])
        ax.bar(k, p, color=COLOURS[k % len(COLOURS)], width=0.65)
        ax.errorbar(k, p, yerr=[[max(p - low, 0.0)], [max(high - p, 0.0)]], color=BLACK, capsize=5, linewidth=1.2)
        ax.annotate(
            f"{p:.1f} %",
            (k, high),
            xytext=(0, 5),
            textcoords="offset points",
            ha="center",
            fontsize=TICK_PT,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},  # a grid line may run there
        )
    if len(covered) > 3 and max(map(len, covered)) > LONG_NAME:
        ax.set_xticks(range(len(covered)), [plain(name) for name in covered], rotation=30, ha="right")
    else:
        lines = ["\n".join(wrap(name, 11, break_on_hyphens=False)) for name in covered]
        ax.set_xticks(range(len(covered)), list(map(plain, lines)))
    ax.set_xlim(-0.7, max(len(covered), 3) - 0.3)
    ax.set_ylim(0.0, 112.0)
    ax.set_yticks(range(0, 101, 20))
    tidy(ax)
    ax.grid(False, axis="x")
    label(ax, y="flights that see the whole target [%]\n(bars: 95 % Wilson interval)")


def _strongest(found: dict[str, dict[str, Any]], size: Callable[[Any], float]) -> list[str]:
    """Keys by falling size, as many as there is room for."""
    largest: dict[str, float] = {}
    for entries in found.values():
        for key, entry in entries.items():
            largest[key] = max(largest.get(key, 0.0), size(entry))
    return sorted(largest, key=lambda key: -largest[key])[:MAX_BARS]


def _tornado(
    title: str, x_label: str, keys: list[str], found: dict[str, dict[str, Any]], limits: tuple[float, float]
) -> Figure | None:
    if not keys:
        return None
    shown, title = _shown(found, title)
    figure = new_figure(1.6 + 0.28 * len(keys) * max(1.5, len(shown)), title)
    ax = figure.add_subplot()
    height = 0.8 / len(shown)
    for k, (name, entries) in enumerate(shown.items()):
        offset = (k + 0.5) * height - 0.4
        for i in (i for i, key in enumerate(keys) if key in entries and not entries[key].get("told", True)):
            ax.annotate(
                NOT_TOLD, (0.0, i + offset), xytext=(4, 0), textcoords="offset points", va="center", fontsize=SMALL_PT
            )
        there = [(i, entries[key]) for i, key in enumerate(keys) if key in entries and entries[key].get("told", True)]
        y = np.array([i for i, _ in there]) + offset
        x = np.array([entry["value"] for _, entry in there])
        around = np.maximum([x - [e["low"] for _, e in there], [e["high"] for _, e in there] - x], 0.0)
        ax.barh(y, x, height=0.9 * height, color=COLOURS[k % len(COLOURS)], label=plain(name))
        ax.errorbar(x, y, xerr=around, fmt="none", color=BLACK, capsize=2.5, linewidth=0.9)
    ax.axvline(0.0, color=BLACK, linewidth=0.8)
    ax.set_yticks(range(len(keys)), [plain(key) for key in keys])
    ax.set_ylim(len(keys) - 0.5, -0.5)
    ax.set_xlim(*limits)
    tidy(ax)
    ax.grid(False, axis="y")
    label(ax, f"{x_label}, bars: 95 % interval")
    figure.legend(loc="outside lower center", ncols=min(len(shown), 3), fontsize=TICK_PT, frameon=False)
    return figure


def _told(group: dict[str, Any]) -> bool:
    return group["covered"]["probability"] is not None


def _levels(scenarios: dict[str, list[dict[str, Any]]], key: str) -> list[str]:
    """Values of a factor in the order of the grid, as JSON: two long ones may look alike in a label."""
    every = [json.dumps(group["values"][key]) for found in scenarios.values() for group in found]
    return list(dict.fromkeys(every))


def _ticks(values: list[str]) -> list[str]:
    return [plain(value_label(json.loads(value))) for value in values]


def _line(ax: Axes, levels: dict[str, list[str]], found: list[dict[str, Any]]) -> None:
    ((key, names),) = levels.items()
    x = np.array([names.index(json.dumps(group["values"][key])) for group in found])
    p = 100.0 * np.array([group["covered"]["probability"] for group in found])
    low, high = 100.0 * np.array([group["covered"]["wilson"] for group in found]).T
    around = np.maximum([p - low, high - p], 0.0)
    ax.errorbar(x, p, yerr=around, fmt="o-", color=BLUE, ecolor=BLACK, capsize=4, linewidth=1.2)
    ax.set_xticks(range(len(names)), _ticks(names))
    ax.set_ylim(-4.0, 104.0)
    tidy(ax)
    label(ax, plain(key), "flights that see the whole target [%]\n(bars: 95 % Wilson interval)")


def _heat_map(ax: Axes, levels: dict[str, list[str]], found: list[dict[str, Any]]) -> None:
    (down, rows), (across, columns) = levels.items()
    p = np.full((len(rows), len(columns)), np.nan)
    numbers = max(p.shape) <= MAX_NUMBERS
    for group in found:
        i, j = rows.index(json.dumps(group["values"][down])), columns.index(json.dumps(group["values"][across]))
        p[i, j] = 100.0 * group["covered"]["probability"]
        low, high = (100.0 * end for end in group["covered"]["wilson"])
        if numbers:
            colour = "white" if p[i, j] < 50.0 else BLACK
            words = f"{p[i, j]:.0f}\n({low:.0f} to {high:.0f})"
            ax.text(j, i, words, ha="center", va="center", fontsize=SMALL_PT, color=colour)
    ax.imshow(p, vmin=0.0, vmax=100.0, cmap="viridis", aspect="auto", origin="lower")
    ax.set_xticks(range(len(columns)), _ticks(columns))
    ax.set_yticks(range(len(rows)), _ticks(rows))
    label(ax, plain(across), plain(down))
