"""What each spacecraft tracks over time, and how that is named and coloured with the paper's abbreviations.

AAS 19-144, Figures 9, 10.
"""

from __future__ import annotations

import json
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from swarm_mj.results.look import BLUE, DARK_GREY, DASHES, GREEN, ORANGE, PURPLE, VERMILLION, Dashes
from swarm_mj.typing import Array, Mask


class ModeLook(NamedTuple):
    """How a mode is shown."""

    abbreviation: str
    meaning: str
    colour: str
    line_colour: str
    dashes: Dashes

    @property
    def words(self) -> str:
        """Abbreviation and meaning, as a legend has them."""
        return self.meaning if self.meaning == self.abbreviation else f"{self.abbreviation}: {self.meaning}"


#: In the order of the flag values of `mode`, then what no longer works and what is aboard. Areas are pale, so that curves
#: read on top.
MODE_LOOKS = (
    ModeLook("TO", "target observing", "#F6D9C4", VERMILLION, DASHES[0]),
    ModeLook("CT", "communication tracking", "#CFE6F5", BLUE, DASHES[1]),
    ModeLook("ET", "Earth tracking", "#CBE8DC", GREEN, DASHES[3]),
    ModeLook("SO", "surface point observing", "#F3E6B8", ORANGE, DASHES[4]),
    ModeLook("DH", "direction hold", "#F0DCE8", PURPLE, DASHES[5]),
    ModeLook("lost", "lost", "#C9C9C9", DARK_GREY, DASHES[2]),
    ModeLook("aboard", "aboard", "#FFFFFF", "#8C8C8C", DASHES[1]),
)
#: Numbers of the modes of spacecraft that no longer work, and that have not left; all from LOST on point nowhere.
LOST, ABOARD = len(MODE_LOOKS) - 2, len(MODE_LOOKS) - 1


class Run(NamedTuple):
    """A stretch of samples with one target: first and last time [s], mode."""

    start: float
    end: float
    mode: int


def modes_shown(telemetry: xr.Dataset) -> NDArray[np.int8]:
    """What each spacecraft tracks, `LOST` from when it no longer works, `ABOARD` until it leaves, shape (time, spacecraft)."""
    mode = telemetry["mode"].values.astype(np.int8)
    for name, instead in (("released", ABOARD), ("operational", LOST)):
        if name in telemetry:
            mode = np.where(telemetry[name].values == 1, mode, np.int8(instead))
    return mode


def events_of(telemetry: xr.Dataset, j: int) -> list[float]:
    """Times of the faults of spacecraft j and of what followed from them, in order [s]."""
    name = str(telemetry["spacecraft"].values[j])
    events = json.loads(telemetry.attrs.get("events", "[]"))
    return sorted({float(event["time_s"]) for event in events if event["spacecraft"] == name})


def runs(telemetry: xr.Dataset, j: int) -> list[Run]:
    """Stretches in which spacecraft j tracks one target, or is lost, in order of time; each ends where the next begins."""
    mode = modes_shown(telemetry)[:, j]
    tracked = np.where(mode >= LOST, -1, telemetry["tracked_spacecraft"].values[:, j])
    times = telemetry["time"].values
    first = np.flatnonzero(np.append(True, (np.diff(mode) != 0) | (np.diff(tracked) != 0)))
    ends = np.append(times[first[1:]], times[-1])
    return [Run(float(times[k]), float(end), int(mode[k])) for k, end in zip(first, ends, strict=True)]


def intervals(flag: Mask, times: Array) -> list[tuple[float, float]]:
    """Start and length [s] of the stretches in which a flag holds; each sample stands until the next."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flag, [False])).astype(np.int8)))
    until = np.append(times, times[-1])
    return [(float(until[a]), float(until[b] - until[a])) for a, b in edges.reshape(-1, 2)]
