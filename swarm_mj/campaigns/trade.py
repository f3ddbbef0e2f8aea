"""The figure of a campaign over a grid: how probable it is that the whole target is seen, by what was swept."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from swarm_mj.campaigns.groups import swept, value_label
from swarm_mj.campaigns.loading import Resolved
from swarm_mj.results.figures.style import SMALL_PT, TICK_PT, label, new_figure, plain, tidy
from swarm_mj.results.look import BLACK, BLUE

#: Scenarios that get a panel each; values of one factor for which there is room, and cells whose numbers can be read.
MAX_PANELS, MAX_LEVELS, MAX_NUMBERS = 4, 40, 12


def compose_trade(resolved: Resolved, results: pa.Table, summary: dict[str, Any]) -> Figure | None:
    """A line with intervals for one swept factor, a heat map for two; more are left to the table."""
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
