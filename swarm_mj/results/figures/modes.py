"""What each spacecraft tracks over time, as coloured bands with the paper's abbreviations (AAS 19-144, Figures 9, 10)."""

from __future__ import annotations

import json
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.textpath import TextPath
from numpy.typing import NDArray

from swarm_mj.results.figures.style import (
    BLACK,
    BLUE,
    DARK_GREY,
    GREEN,
    GREY,
    HALO,
    ORANGE,
    PURPLE,
    SMALL_PT,
    VERMILLION,
    VISIT_DASHES,
    TimeAxis,
)
from swarm_mj.typing import Array, Mask


class ModeLook(NamedTuple):
    """How a mode is shown."""

    abbreviation: str
    meaning: str
    colour: str
    line_colour: str

    @property
    def words(self) -> str:
        """Abbreviation and meaning, as a legend has them."""
        return self.meaning if self.meaning == self.abbreviation else f"{self.abbreviation}: {self.meaning}"


#: In the order of the flag values of `mode`, then what no longer works. Areas are pale, so that curves read on top.
MODE_LOOKS = (
    ModeLook("TO", "target observing", "#F6D9C4", VERMILLION),
    ModeLook("CT", "communication tracking", "#CFE6F5", BLUE),
    ModeLook("ET", "Earth tracking", "#CBE8DC", GREEN),
    ModeLook("SO", "surface point observing", "#F3E6B8", ORANGE),
    ModeLook("DH", "direction hold", "#F0DCE8", PURPLE),
    ModeLook("lost", "lost", "#C9C9C9", DARK_GREY),
)
#: Number of the mode of spacecraft that no longer work.
LOST = len(MODE_LOOKS) - 1

#: How the instants of faults, and of what followed from them, are marked.
EVENT: dict[str, Any] = {"color": PURPLE, "linewidth": 1.4, "linestyle": (0, (1, 1.2))}
#: Share of a panel's height that the band with the abbreviations takes.
BAND = 0.13
#: Share of a column of a figure that its axes take, at least, and room around an abbreviation in its band [pt].
AXES_SHARE, ROOM_PT = 0.75, 4.0


class Run(NamedTuple):
    """A stretch of samples with one target: first and last time [s], mode."""

    start: float
    end: float
    mode: int


def modes_shown(telemetry: xr.Dataset) -> NDArray[np.int8]:
    """What each spacecraft tracks, or `LOST` from when it no longer works, shape (time, spacecraft)."""
    mode = telemetry["mode"].values.astype(np.int8)
    return (
        mode if "operational" not in telemetry else np.where(telemetry["operational"].values == 1, mode, np.int8(LOST))
    )


def events_of(telemetry: xr.Dataset, j: int) -> list[float]:
    """Times of the faults of spacecraft j and of what followed from them, in order [s]."""
    name = str(telemetry["spacecraft"].values[j])
    events = json.loads(telemetry.attrs.get("events", "[]"))
    return sorted({float(event["time_s"]) for event in events if event["spacecraft"] == name})


def runs(telemetry: xr.Dataset, j: int) -> list[Run]:
    """Stretches in which spacecraft j tracks one target, or is lost, in order of time; each ends where the next begins."""
    mode = modes_shown(telemetry)[:, j]
    tracked = np.where(mode == LOST, -1, telemetry["tracked_spacecraft"].values[:, j])
    times = telemetry["time"].values
    first = np.flatnonzero(np.append(True, (np.diff(mode) != 0) | (np.diff(tracked) != 0)))
    ends = np.append(times[first[1:]], times[-1])
    return [Run(float(times[k]), float(end), int(mode[k])) for k, end in zip(first, ends, strict=True)]


def intervals(flag: Mask, times: Array) -> list[tuple[float, float]]:
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
        if has_room(ax, run, whole):
            name_mode(ax, run, axis, 1.0 - BAND / 2, transform=ax.get_xaxis_transform())
    for t in events_of(telemetry, j):
        ax.axvline(t / axis.seconds, ymax=1.0 - BAND, zorder=1.6, **EVENT)
    ax.axvline(visit_s / axis.seconds, ymax=1.0 - BAND, color=GREY, linewidth=1.0, linestyle=VISIT_DASHES, zorder=1.5)


def has_room(ax: Axes, run: Run, whole: float) -> bool:
    """Whether the abbreviation of a mode fits into its stretch of a flight of some length [s], before the layout is known."""
    figure, spec = ax.get_figure(root=True), ax.get_subplotspec()
    assert figure is not None and spec is not None
    axes_pt = 72.0 * AXES_SHARE * figure.get_figwidth() / spec.get_gridspec().ncols
    return (run.end - run.start) / whole * axes_pt >= _width_pt(MODE_LOOKS[run.mode].abbreviation) + ROOM_PT


@cache
def _width_pt(abbreviation: str) -> float:
    font = FontProperties(weight="bold")
    return float(TextPath((0.0, 0.0), abbreviation, size=SMALL_PT, prop=font).get_extents().width)


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
            label=MODE_LOOKS[mode].words,
        )
        for mode in np.unique(modes_shown(telemetry))
    ]


def mark_handles(telemetry: xr.Dataset, n: int) -> list[Line2D]:
    """Legend entries of the visit, and of switches and faults if there are any."""
    handles = [Line2D([], [], color=GREY, linewidth=1.0, linestyle=VISIT_DASHES, label="visit")]
    if any(len(runs(telemetry, j)) > 1 for j in range(n)):
        handles.append(Line2D([], [], color=BLACK, linewidth=0.9, label="switch"))
    if any(events_of(telemetry, j) for j in range(n)):
        handles.append(Line2D([], [], label="fault or what followed from it", **EVENT))
    return handles
