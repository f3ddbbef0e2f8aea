"""Colours, light and units of time that figures and reports share; nothing here draws.

Colours are those of Okabe and Ito (2008), which readers with any common colour blindness tell apart.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

#: Dashes of a line as Matplotlib takes them: none, or an offset, and lengths of strokes and gaps.
Dashes = Literal["-"] | tuple[float, tuple[float, ...]]

BLACK = "#000000"
ORANGE = "#E69F00"
SKY_BLUE = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#8A8A8A"
DARK_GREY = "#6B6B6B"
LIGHT_GREY = "#DDDDDD"

#: The three components of a vector, in order.
COMPONENTS = (BLUE, ORANGE, GREEN)

#: Colours of single spacecraft, as long as they can be told apart.
SPACECRAFT = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY_BLUE)

#: Dashes of lines that stand for one thing each, beside their colours, for who does not see these: in the order of
#: `COMPONENTS` and `SPACECRAFT`.
DASHES: tuple[Dashes, ...] = (
    "-",
    (0.0, (5.0, 1.5)),
    (0.0, (1.5, 1.2)),
    (0.0, (6.0, 1.5, 1.2, 1.5)),
    (0.0, (9.0, 2.0)),
    (0.0, (4.0, 1.2, 1.2, 1.2, 1.2, 1.2)),
)

#: Colour of bare ground.
GROUND = "#C9C4BC"
#: Light that reaches faces turned away from the lamp.
AMBIENT = 0.42


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


def spacecraft_colours(n: int) -> list[str]:
    """A colour for each of n spacecraft: their own while they can be told apart, else one for all."""
    return list(SPACECRAFT[:n]) if n <= len(SPACECRAFT) else [BLUE] * n


def spacecraft_dashes(n: int) -> list[Dashes]:
    """Dashes for the line of each of n spacecraft, as `spacecraft_colours` has colours."""
    return list(DASHES[:n]) if n <= len(SPACECRAFT) else [DASHES[0]] * n
