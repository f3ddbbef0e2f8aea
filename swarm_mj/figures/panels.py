"""Small multiples: one panel per spacecraft over time, axes shared, modes marked, one legend below."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from swarm_mj.figures.modes import BAND, draw_modes, mark_handles, mode_handles
from swarm_mj.figures.palette import SPACECRAFT, spacecraft_styles
from swarm_mj.figures.style import INSIDE, LABEL_PT, SMALL_PT, caption, new_figure, role, tidy
from swarm_mj.figures.timescale import time_scale
from swarm_mj.figures.units import note_of_omission, shown_spacecraft
from swarm_mj.flight.plan import Plan
from swarm_mj.typing import Array, Indices


def compose_panels(
    plan: Plan,
    telemetry: xr.Dataset,
    *,
    title: str,
    y_label: str,
    draw: Callable[[Axes, int], None],
    limits: tuple[float, float],
    handles: Sequence[Line2D],
    log: bool = False,
) -> Figure:
    """Build a figure of small multiples.

    `draw` draws the curves of one spacecraft: (axes, its number from 0), `handles` are their legend entries. Above the limits
    of the vertical axis, which is logarithmic with `log`, there is room for the band that names the modes.
    """
    shown = shown_spacecraft(plan.n)
    n = len(shown)
    columns = n if n <= 3 else 2 if n == 4 else 3 if n <= 9 else 4
    rows = ceil(n / columns)
    height_in = 1.5 + (2.6 if rows == 1 else 1.75 * rows)
    figure = new_figure(height_in, f"{title}: {plan.scenario.name}{note_of_omission(plan.n, shown)}")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.set(w_pad=0.09)  # type: ignore[call-arg]
    scale = time_scale(plan, telemetry)
    for ax, j in zip(grid.flat, shown, strict=False):
        draw(ax, int(j))
        draw_modes(ax, telemetry, int(j), scale)
        scale.draw_borders(ax)
        tidy(ax)
        caption(ax, f"{plan.names[j]}: {role(plan, int(j))}", pad=3.0)
    first = grid[0, 0]
    scale.show(first, brief=columns > 2)
    _scale(first, *limits, log)
    for ax in list(grid.flat)[len(shown) :]:
        ax.set_visible(False)
    for column in range(columns):  # an incomplete last row leaves the panel above it as the lowest
        lowest = grid[(len(shown) - 1 - column) // columns, column]
        lowest.tick_params(labelbottom=True)
        scale.name(lowest, brief=columns > 3)
    _leave_out_bare_axes(figure.axes)
    figure.supylabel(y_label, fontsize=LABEL_PT)
    marks = [*mark_handles(telemetry, shown), *scale.border_handles(), *mode_handles(telemetry, shown)]
    legend_below(figure, [*handles, *marks])
    return figure


def _scale(ax: Axes, low: float, high: float, log: bool) -> None:
    """Set the vertical axis so that the curves keep clear of the band on top, which carries no ticks."""
    if log:
        ax.set_yscale("log")
        ax.set_ylim(low, low * (high / low) ** (1.0 / (1.0 - BAND)))
        ax.yaxis.set_minor_locator(NullLocator())
    else:
        ax.set_ylim(low, low + (high - low) / (1.0 - BAND))
    ax.set_yticks([tick for tick in ax.get_yticks() if low <= tick <= high])


def _leave_out_bare_axes(panels: Sequence[Axes]) -> None:
    """Keep axes without numbers and names out of the search for room, which measures every one of them several times."""
    for ax in panels:
        for axis, side in ((ax.xaxis, "labelbottom"), (ax.yaxis, "labelleft")):
            if not axis.get_tick_params()[side]:
                axis.set_in_layout(False)
                axis.set_label_coords(0.0, 0.0)


def legend_below(figure: Figure, handles: Sequence[Artist]) -> None:
    """One legend for the whole figure, under everything else."""
    # As many columns as fit side by side; all get the width of the longest label at 0.075 in a letter.
    longest = max(len(str(handle.get_label())) for handle in handles)
    columns = max(1, min(len(handles), int(figure.get_figwidth() / (0.6 + 0.075 * longest))))
    look: dict[str, Any] = {"fontsize": SMALL_PT + 1, "frameon": False, "handlelength": 2.2, "columnspacing": 1.8}
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, **look)


def spacecraft_handles(
    plan: Plan, shown: Indices, linewidth: float, *, together: str, before: str = ""
) -> list[Line2D]:
    """Legend entries of a line for each spacecraft shown, or of one for all where they cannot be told apart.

    Each is named after the words `before`, all `together` by those.
    """
    styles = spacecraft_styles(len(shown))
    if len(shown) > len(SPACECRAFT):
        return [Line2D([], [], linewidth=linewidth, label=together, **styles[0])]
    return [
        Line2D([], [], linewidth=linewidth, label=f"{before}{plan.names[j]}", **style)
        for j, style in zip(shown, styles, strict=True)
    ]


def marker_handle(name: str, colour: str, marker: str) -> Line2D:
    """Legend entry of a marker."""
    return Line2D([], [], color=colour, marker=marker, markersize=7, linestyle="none", label=name)


def draw_bars(
    ax: Axes, values: Array, names: Sequence[str], words: Sequence[str], colours: Sequence[str], *, gap: float
) -> None:
    """A row for each spacecraft: its name, a bar as long as its value, and words to the right of it after a gap."""
    rows = np.arange(len(values))
    ax.barh(rows, values, color=colours, height=0.7)
    for row, value, text in zip(rows, values, words, strict=True):
        ax.text(value + gap, float(row), text, va="center", fontsize=SMALL_PT, **INSIDE)
    ax.set_yticks(rows, names)
    ax.set_ylim(len(values) - 0.4, -0.6)
    tidy(ax)
    ax.grid(False, axis="y")
