"""What each spacecraft tracks over time, as coloured bands with the paper's abbreviations (AAS 19-144, Figures 9, 10)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from swarm_mj.output.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    HALO,
    ORANGE,
    SMALL_PT,
    VERMILLION,
    VISIT_DASHES,
    TimeAxis,
)


class ModeLook(NamedTuple):
    """How a mode is shown."""

    abbreviation: str
    meaning: str
    colour: str
    line_colour: str


#: In the order of the flag values of `mode`. Areas are pale, so that curves read on top.
MODE_LOOKS = (
    ModeLook("TO", "target observing", "#F6D9C4", VERMILLION),
    ModeLook("CT", "communication tracking", "#CFE6F5", BLUE),
    ModeLook("ET", "Earth tracking", "#CBE8DC", GREEN),
    ModeLook("SO", "surface point observing", "#F3E6B8", ORANGE),
    ModeLook("DH", "direction hold", "#E3E3E3", GREY),
)

#: Share of a panel's height that the band with the abbreviations takes.
BAND = 0.13
#: A band narrower than this share of the axis has no room for its abbreviation.
MIN_LABELLED = 0.05


class Run(NamedTuple):
    """A stretch of samples with one target: first and last time [s], mode."""

    start: float
    end: float
    mode: int


def runs(telemetry: xr.Dataset, j: int) -> list[Run]:
    """Stretches in which spacecraft j tracks one target, in order of time; each ends where the next begins."""
    mode = telemetry["mode"].values[:, j]
    tracked = telemetry["tracked_spacecraft"].values[:, j]
    times = telemetry["time"].values
    first = np.flatnonzero(np.append(True, (np.diff(mode) != 0) | (np.diff(tracked) != 0)))
    ends = np.append(times[first[1:]], times[-1])
    return [Run(float(times[k]), float(end), int(mode[k])) for k, end in zip(first, ends, strict=True)]


def intervals(flag: NDArray[np.bool_], times: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Start and length [s] of the stretches in which a flag holds; each sample stands until the next."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flag, [False])).astype(np.int8)))
    until = np.append(times, times[-1])
    return [(float(until[a]), float(until[b] - until[a])) for a, b in edges.reshape(-1, 2)]


def draw_modes(ax: Axes, telemetry: xr.Dataset, j: int, axis: TimeAxis, visit_s: float) -> None:
    """Shade a panel by mode, name the modes in a band on top, and mark every switch and the visit."""
    stretches = runs(telemetry, j)
    whole = stretches[-1].end - stretches[0].start
    for k, run in enumerate(stretches):
        look = MODE_LOOKS[run.mode]
        start, end = run.start / axis.seconds, run.end / axis.seconds
        ax.axvspan(start, end, ymax=1.0 - BAND, color=look.colour, alpha=0.45, linewidth=0, zorder=0)
        ax.axvspan(start, end, ymin=1.0 - BAND, color=look.colour, linewidth=0, zorder=0)
        if k:
            ax.axvline(start, color=BLACK, linewidth=0.9, zorder=1.5)
        if run.end - run.start >= MIN_LABELLED * whole:
            name_mode(ax, run, axis, 1.0 - BAND / 2, transform=ax.get_xaxis_transform())
    ax.axvline(visit_s / axis.seconds, ymax=1.0 - BAND, color=GREY, linewidth=1.0, linestyle=VISIT_DASHES, zorder=1.5)


def name_mode(ax: Axes, run: Run, axis: TimeAxis, y: float, **place: Any) -> None:
    """Write the abbreviation of a mode in the middle of its stretch, at height y."""
    ax.text(
        (run.start + run.end) / 2 / axis.seconds,
        y,
        MODE_LOOKS[run.mode].abbreviation,
        ha="center",
        va="center",
        fontsize=SMALL_PT,
        fontweight="bold",
        path_effects=HALO,
        **place,
    )


def mode_handles(telemetry: xr.Dataset) -> list[Patch]:
    """Legend entries of the modes that occur."""
    return [
        Patch(
            facecolor=MODE_LOOKS[mode].colour,
            edgecolor=GREY,
            linewidth=0.5,
            label=f"{MODE_LOOKS[mode].abbreviation}: {MODE_LOOKS[mode].meaning}",
        )
        for mode in np.unique(telemetry["mode"].values)
    ]


def mark_handles(telemetry: xr.Dataset, n: int) -> list[Line2D]:
    """Legend entries of the visit, and of the switch if there is one."""
    handles = [Line2D([], [], color=GREY, linewidth=1.0, linestyle=VISIT_DASHES, label="visit")]
    if any(len(runs(telemetry, j)) > 1 for j in range(n)):
        handles.append(Line2D([], [], color=BLACK, linewidth=0.9, label="switch"))
    return handles
