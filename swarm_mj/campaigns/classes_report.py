"""The table and the figures of a comparison of swarm classes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from swarm_mj.campaigns.classes import MOST_LOST, PLACED, VARIANTS, ClassResult
from swarm_mj.campaigns.figures import COLOURS, DASHES
from swarm_mj.campaigns.statistics import Estimate
from swarm_mj.figures.style import TICK_PT, label, new_figure, save, tidy
from swarm_mj.io.atomic import write_text

#: Parts of the range of the chance of loss that are one point of a curve.
PARTS = 5
#: Names of the files that `write_report` makes.
TABLE, FIGURE, BY_LOST = "classes.md", "classes_chance.png", "classes_lost.png"


def table_of_classes(found: Sequence[ClassResult]) -> str:
    """The table in Markdown: one row a class."""
    lines = [
        "| class | what | seen [%] | delivered [%] | whole target seen | deployment Delta-v [m/s] | propellant Delta-v [m/s] | "
        "messages [Mbit] | map on Earth [h] |",
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
    """Mean seen and delivered area over the chance with which each spacecraft is lost."""
    figure = new_figure(4.9, "What losses leave, by class", width_in=11.0)
    edges = np.linspace(0.0, MOST_LOST, PARTS + 1)
    rows = [row for row in results.to_pylist() if row["status"] == "ok"]
    left, right = figure.subplots(1, 2, sharey=True)
    for ax, key, what in ((left, "coverage_percent", "seen"), (right, "delivered_percent", "delivered")):
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
    """Write the tables, and the figures if wanted, into a folder.

    Raises:
        OutputError: A file cannot be written.
    """
    write_text(folder / TABLE, f"{table_of_classes(found)}\n{table_by_lost(found)}")
    if figures:
        save(compose_chance(results), folder / FIGURE)
        save(compose_by_lost(found), folder / BY_LOST)
