"""What each spacecraft tracks over time, as coloured bands with the paper's abbreviations (AAS 19-144, Figures 9, 10)."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.textpath import TextPath

from swarm_mj.figures.palette import BLACK, GREY, MODE_STYLES, PURPLE
from swarm_mj.figures.style import HALO, INSIDE, SMALL_PT
from swarm_mj.figures.timescale import TimeScale, arrival_handle
from swarm_mj.records.modes import Run, events_of, modes_shown, runs
from swarm_mj.typing import Indices

#: How the instants of faults, and of what followed from them, are marked.
EVENT: dict[str, Any] = {"color": PURPLE, "linewidth": 1.4, "linestyle": (0, (1, 1.2))}
#: Share of a panel's height that the band with the abbreviations takes.
BAND = 0.13
#: Share of a column of a figure that its axes take, at least, and room around an abbreviation in its band [pt].
AXES_SHARE, ROOM_PT = 0.75, 4.0


def draw_modes(ax: Axes, telemetry: xr.Dataset, j: int, scale: TimeScale) -> None:
    """Shade a panel by mode, name the modes in a band on top, and mark every switch and the arrival."""
    unit = scale.axis.seconds
    for k, run in enumerate(runs(telemetry, j)):
        style = MODE_STYLES[run.mode]
        start, end = run.start / unit, run.end / unit
        ax.axvspan(start, end, ymax=1.0 - BAND, color=style.colour, alpha=0.45, linewidth=0, zorder=0)
        ax.axvspan(start, end, ymin=1.0 - BAND, color=style.colour, linewidth=0, zorder=0)
        if k:
            ax.axvline(start, color=BLACK, linewidth=0.9, zorder=1.5)
        if has_room(ax, run, scale):
            name_mode(ax, run, scale, 1.0 - BAND / 2, transform=ax.get_xaxis_transform())
    for t in events_of(telemetry, j):
        ax.axvline(t / unit, ymax=1.0 - BAND, zorder=1.6, **EVENT)
    scale.draw_arrival(ax, top=1.0 - BAND)


def has_room(ax: Axes, run: Run, scale: TimeScale) -> bool:
    """Whether the abbreviation of a mode fits into its stretch of the time axis, before the layout is known."""
    return scale.share(run.start, run.end) * axes_pt(ax) >= width_pt(MODE_STYLES[run.mode].abbreviation) + ROOM_PT


def axes_pt(ax: Axes) -> float:
    """Width of axes, at least, before the layout is known [pt]."""
    figure, spec = ax.get_figure(root=True), ax.get_subplotspec()
    assert figure is not None and spec is not None
    return 72.0 * AXES_SHARE * figure.get_figwidth() / spec.get_gridspec().ncols


@cache
def width_pt(text: str) -> float:
    """Width of a short bold text of the size `SMALL_PT` [pt]."""
    font = FontProperties(weight="bold")
    return float(TextPath((0.0, 0.0), text, size=SMALL_PT, prop=font).get_extents().width)


def name_mode(ax: Axes, run: Run, scale: TimeScale, y: float, **place: Any) -> None:
    """Write the abbreviation of a mode in the middle of its stretch, at height y."""
    style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": SMALL_PT, "fontweight": "bold"}
    x = scale.middle(run.start, run.end) / scale.axis.seconds
    ax.text(x, y, MODE_STYLES[run.mode].abbreviation, path_effects=HALO, **style, **INSIDE, **place)


def mode_handles(telemetry: xr.Dataset, shown: Indices) -> list[Patch]:
    """Legend entries of the modes that occur among the spacecraft that are shown."""
    styles = [MODE_STYLES[mode] for mode in np.unique(modes_shown(telemetry)[:, shown])]
    return [Patch(facecolor=one.colour, edgecolor=GREY, linewidth=0.5, label=one.words) for one in styles]


def mark_handles(telemetry: xr.Dataset, shown: Indices) -> list[Line2D]:
    """Legend entries of the arrival, and of switches and faults if there are any among the spacecraft that are shown."""
    handles = [arrival_handle(GREY)]
    if any(len(runs(telemetry, int(j))) > 1 for j in shown):
        handles.append(Line2D([], [], color=BLACK, linewidth=0.9, label="switch"))
    if any(events_of(telemetry, int(j)) for j in shown):
        handles.append(Line2D([], [], label="fault or what followed from it", **EVENT))
    return handles
