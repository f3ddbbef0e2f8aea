"""Words on a picture: time, observed share, who does what, names at the spacecraft, legend and scale."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from swarm_mj.drawing.canvas import Box, Projection
from swarm_mj.drawing.instant import LOOKS_AT_BODY, Instant
from swarm_mj.drawing.palette import FAINT, MODES, SEEN, TEXT, UNSEEN_BORDER, Rgb
from swarm_mj.mission.behaviors import TargetKind

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
Line = tuple[str, Rgb]

#: Height of letters over the height of the picture, and least [pixel].
LETTER, LEAST_LETTER = 0.026, 12
#: More spacecraft than these are counted, not named.
MAX_NAMED = 12
#: The words that change most from picture to picture, at their widest.
WIDEST = "100.0 % observed"
#: Opacity of the ground behind words, of 255.
GROUND_ALPHA = 150
#: What a spacecraft does, by what its +z tracks.
DEEDS: dict[TargetKind, str] = {
    TargetKind.ASTEROID: "observes",
    TargetKind.SURFACE: "observes a point",
    TargetKind.SPACECRAFT: "points at another",
    TargetKind.EARTH: "points at Earth",
    TargetKind.DIRECTION: "holds its attitude",
}


class Corner(NamedTuple):
    """A corner of a view; the upper left one unless said otherwise."""

    right: bool = False
    below: bool = False


class Lettering:
    """Writes on one picture.

    Args:
        pixels: The picture, shape (height, width, 3).
    """

    def __init__(self, pixels: Pixels) -> None:
        self._image = Image.fromarray(pixels)
        self._draw = ImageDraw.Draw(self._image, "RGBA")
        self.size = max(LEAST_LETTER, round(LETTER * pixels.shape[0]))
        self._font = _font(self.size)

    @property
    def pixels(self) -> Pixels:
        """The picture with what was written on it."""
        return np.array(self._image)

    def panel_size(self, lines: Sequence[Line]) -> tuple[int, int]:
        """Width and height of a panel with these lines [pixel]."""
        widest = max(self._font.getlength(text) for text in (WIDEST, *(text for text, _ in lines)))
        return round(widest) + self.size, self._step * len(lines) + self._step // 2 + self.size // 2

    def panel_box(self, lines: Sequence[Line], box: Box, corner: Corner) -> Box:
        """Where a panel stands in a corner of a view, above the legend."""
        width, height = self.panel_size(lines)
        left = box.left + (box.width - width if corner.right else 0)
        top = box.top + (box.height - height - 3 * self.size if corner.below else 0)
        return Box(left, top, width, height)

    @property
    def _step(self) -> int:
        return round(1.32 * self.size)

    def panel(self, lines: Sequence[Line], box: Box, corner: Corner, share: float) -> None:
        """Lines of text on a dark ground in a corner of a view; under the second a bar filled to a share from 0 to 1."""
        left, top, width, height = self.panel_box(lines, box, corner)
        step = self._step
        self._draw.rectangle((left, top, left + width, top + height), (0, 0, 0, GROUND_ALPHA))
        x, y = left + self.size // 2, top + self.size // 4
        for k, (text, colour) in enumerate(lines):
            self._draw.text((x, y), text, font=self._font, fill=colour)
            y += step
            if k == 1:
                self._bar(x, y, width - self.size, step // 4, share)
                y += step // 2

    def _bar(self, left: int, top: int, width: int, height: int, share: float) -> None:
        self._draw.rectangle((left, top, left + width, top + height), (70, 70, 70, 255))
        if share > 0.0:
            self._draw.rectangle((left, top, left + round(share * width), top + height), (*SEEN, 255))

    def names(self, points_N: Array, labels: Sequence[Line], projection: Projection, *, dots: bool = False) -> None:
        """Write beside points what they are; leave out what would overlap.

        Args:
            points_N: Shape (k, 3) [m].
            labels: Their names and colours.
            projection: The view they stand in.
            dots: Whether to mark the points too.
        """
        places, inside = projection.place(points_N)
        taken: list[tuple[float, float, float, float]] = []
        for k in np.flatnonzero(inside).tolist():
            text, colour = labels[k]
            if dots:
                x, y = places[k]
                self._draw.ellipse((x - 2, y - 2, x + 2, y + 2), fill=colour)
            self._label(text, places[k], colour, projection.box, taken)

    def _label(
        self, text: str, place: Array, colour: Rgb, box: Box, taken: list[tuple[float, float, float, float]]
    ) -> None:
        width, height, away = self._font.getlength(text), 1.2 * self.size, 1.1 * self.size
        for dx, dy in ((away, -height), (-away - width, -height), (away, 0.1), (-away - width, 0.1)):
            left, top = float(place[0] + dx), float(place[1] + dy)
            right, bottom = left + width, top + height
            free = all(right < a or c < left or bottom < b or d < top for a, b, c, d in taken)
            within = (
                left > box.left and right < box.left + box.width and top > box.top and bottom < box.top + box.height
            )
            if free and within:
                taken.append((left, top, right, bottom))
                self._words(left, top, text, colour)
                return

    def caption(self, text: str, box: Box, colour: Rgb) -> None:
        """A text in the lower left corner of a camera's picture, its first word where there is no room, and a frame."""
        self._draw.rectangle(
            (box.left, box.top, box.left + box.width - 1, box.top + box.height - 1), outline=colour, width=1
        )
        y = box.top + box.height - round(1.5 * self.size)
        if self._font.getlength(text) > box.width - self.size // 2:
            text = text.split(" ")[0]
        self._words(box.left + self.size // 3, y, text, colour)

    def legend(self, note: str, box: Box) -> None:
        """What the colours on the body mean, and a note, along the lower edge of a view."""
        y = box.top + box.height - round(1.6 * self.size)
        x = box.left + self.size // 2
        for colour, text, filled in ((SEEN, "observed", True), (UNSEEN_BORDER, "not yet observed", False)):
            side = self.size
            self._draw.rectangle(
                (x, y + 1, x + side, y + 1 + side), fill=colour if filled else None, outline=colour, width=2
            )
            self._words(x + 1.4 * side, y, text, TEXT)
            x += round(2.4 * side + self._font.getlength(text))
        width = self._font.getlength(note)
        right = box.left + box.width - self.size // 2
        if right - width > x:
            self._words(right - width, y, note, FAINT)
        else:
            self._words(box.left + self.size // 2, y - 1.4 * self.size, note, FAINT)

    def _words(self, x: float, y: float, text: str, colour: Rgb) -> None:
        """Text that reads on any ground."""
        self._draw.text((x, y), text, font=self._font, fill=colour, stroke_width=2, stroke_fill=(0, 0, 0, 255))


def roles(instant: Instant, names: Sequence[str]) -> list[Line]:
    """Who does what, one line each, or how many do what in a large swarm."""
    if instant.n > MAX_NAMED:
        working = instant.kind[instant.works]
        counts = Counter(TargetKind(int(kind)) for kind in working)
        lines = [(f"{count} x {DEEDS[kind]}", MODES[kind]) for kind, count in sorted(counts.items())]
        lost = instant.n - len(working)
        return [*lines, (f"{lost} x lost", FAINT)] if lost else lines
    return [(f"{name} {deed(instant, names, j)}", instant.colours[j]) for j, name in enumerate(names)]


def deed(instant: Instant, names: Sequence[str], j: int) -> str:
    """What spacecraft j does."""
    kind = TargetKind(int(instant.kind[j]))
    if not instant.works[j]:
        return "is lost"
    if kind in LOOKS_AT_BODY and not instant.looks_at_body[j]:
        return "has its camera off"
    if kind not in (TargetKind.SPACECRAFT, TargetKind.EARTH):
        return DEEDS[kind]
    other = "Earth" if kind is TargetKind.EARTH else names[int(instant.tracked[j])]
    if instant.link is None:
        return f"points at {other}"
    return f"linked to {other}" if instant.link[j] else f"turns to {other}"


def clock(t: float) -> str:
    """A time [s] as minutes and seconds, with hours where there are any."""
    minutes, seconds = divmod(int(t + 1e-9), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes:02d}:{seconds:02d}"


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    # Matplotlib brings this font along; systems differ in theirs.
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)
