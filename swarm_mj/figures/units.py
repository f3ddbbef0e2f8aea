"""Units in which times and amounts of data read best; nothing here draws."""

from __future__ import annotations

from typing import NamedTuple


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
