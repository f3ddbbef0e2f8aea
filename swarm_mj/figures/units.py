"""Units in which times and amounts of data read best, and which of many spacecraft are shown; nothing here draws."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.typing import Indices

#: More panels or rows than these no longer read on one page.
MAX_PANELS = 20


class TimeAxis(NamedTuple):
    """Unit of a time axis: seconds per unit, and its name."""

    seconds: float
    unit: str


def time_axis(duration_s: float) -> TimeAxis:
    """The unit in which a flight's time reads best."""
    if duration_s < 300.0:
        return TimeAxis(1.0, "s")
    return TimeAxis(60.0, "min") if duration_s < 4 * 3600.0 else TimeAxis(3600.0, "h")


class DataUnit(NamedTuple):
    """Unit of amounts of data: bits per unit, and its name."""

    bits: float
    unit: str


def data_unit(most_bit: float) -> DataUnit:
    """The unit in which data of at most so many bits read best."""
    units = (DataUnit(1e9, "Gbit"), DataUnit(1e6, "Mbit"), DataUnit(1e3, "kbit"))
    return next((unit for unit in units if most_bit >= unit.bits), DataUnit(1.0, "bit"))


def instant(t: float, axis: TimeAxis) -> str:
    """A time [s] in words, in the unit of an axis."""
    return f"{t / axis.seconds:.4g} {axis.unit}"


def shown_spacecraft(n: int, limit: int = MAX_PANELS) -> Indices:
    """Spacecraft that a picture has room for: all, or the first ones and the last, which may be the relay."""
    return np.arange(n) if n <= limit else np.append(np.arange(limit - 1), n - 1)


def note_of_omission(n: int, shown: Indices) -> str:
    """Words for the title when not all spacecraft are shown."""
    return "" if len(shown) == n else f" ({len(shown)} of {n} spacecraft shown)"
