"""Colours, dashes and light that figures, the report and films share; nothing here draws.

Colours are those of Okabe and Ito (2008), which readers with any common colour blindness tell apart.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

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


class ModeStyle(NamedTuple):
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
MODE_STYLES = (
    ModeStyle("TO", "target observing", "#F6D9C4", VERMILLION, DASHES[0]),
    ModeStyle("CT", "communication tracking", "#CFE6F5", BLUE, DASHES[1]),
    ModeStyle("ET", "Earth tracking", "#CBE8DC", GREEN, DASHES[3]),
    ModeStyle("SO", "surface point observing", "#F3E6B8", ORANGE, DASHES[4]),
    ModeStyle("DH", "direction hold", "#F0DCE8", PURPLE, DASHES[5]),
    ModeStyle("lost", "lost", "#C9C9C9", DARK_GREY, DASHES[2]),
    ModeStyle("aboard", "aboard", "#FFFFFF", "#8C8C8C", DASHES[1]),
)


def spacecraft_colours(n: int) -> list[str]:
    """A colour for each of n spacecraft: their own while they can be told apart, else one for all."""
    return list(SPACECRAFT[:n]) if n <= len(SPACECRAFT) else [BLUE] * n


def spacecraft_styles(n: int) -> list[dict[str, Any]]:
    """Colour and dashes of the line of each of n spacecraft, as Matplotlib takes them."""
    dashes = DASHES[:n] if n <= len(SPACECRAFT) else DASHES[:1] * n
    return [{"color": c, "linestyle": d} for c, d in zip(spacecraft_colours(n), dashes, strict=True)]
