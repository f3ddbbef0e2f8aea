"""Words on a picture: time, observed share, who does what, names at the spacecraft, legend and scale.

Labels stand beside what they name and clear of each other; farther off on a leader where it is crowded. All in pixels, right
and down from the left upper corner of the picture.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from swarm_mj.mission.behaviors import TargetKind, looks_at_body
from swarm_mj.rendering.canvas import Box, Projection
from swarm_mj.rendering.frame import Instant
from swarm_mj.rendering.palette import FAINT, MODES, PACKET, SEEN, TEXT, UNSEEN_BORDER, Rgb
from swarm_mj.typing import Array, Pixels

#: Distances from a crowded point to a label on a leader, over the height of letters, and directions that are tried.
REACHES = (2.0, 3.5, 5.0, 7.0, 9.0, 12.0, 16.0, 20.0)
DIRECTIONS = 16
#: Beyond this distance a label takes any place, over the height of letters.
CALM_REACH = 7.0
#: Free space around a label on a leader, and around the leader, over the height of letters.
ROOM = 0.5
#: Points of a leader that are checked.
ALONG_A_LEADER = 25


class Rect(NamedTuple):
    """A rectangle along the picture's edges."""

    left: float
    top: float
    right: float
    bottom: float

    def within(self, other: Rect) -> bool:
        """Whether it lies inside another."""
        across = other.left < self.left and self.right < other.right
        return across and other.top < self.top and self.bottom < other.bottom

    def overlaps(self, other: Rect) -> bool:
        """Whether the two share a point."""
        across = self.left <= other.right and other.left <= self.right
        return across and self.top <= other.bottom and other.top <= self.bottom

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """Its point that is nearest to another."""
        return min(max(x, self.left), self.right), min(max(y, self.top), self.bottom)

    def distances(self, points: Array) -> Array:
        """Distances from points, shape (k, 2), to it, shape (k,); zero inside."""
        low, high = (self.left, self.top), (self.right, self.bottom)
        return np.asarray(np.linalg.norm(points - np.clip(points, low, high), axis=-1))


def _rect(box: Box, inwards: float = 0.0) -> Rect:
    """The edges of a part of the picture, or of what lies so far inside them."""
    right, bottom = box.left + box.width, box.top + box.height
    return Rect(box.left + inwards, box.top + inwards, right - inwards, bottom - inwards)


class Place(NamedTuple):
    """Where a label stands, and whether a leader joins it to its point."""

    rect: Rect
    leader: bool


def groups(points: Array, reach: float) -> list[list[int]]:
    """Points, shape (k, 2), that coincide to within a reach, each with some other of its group; in order of the first."""
    found: list[list[int]] = []
    left = list(range(len(points)))
    while left:
        group = [left.pop(0)]
        for j in group:  # grows while it is walked through
            near = [k for k in left if np.hypot(*(points[k] - points[j])) <= reach]
            group += near
            left = [k for k in left if k not in near]
        found.append(sorted(group))
    return found


def place_label(
    point: Array,
    width: float,
    height: float,
    letter: float,
    view: Rect,
    taken: Sequence[Rect],
    others: Array,
    calm: Callable[[Rect], bool],
) -> Place | None:
    """Where a label of some width and height can stand that names a point (2,); None: nowhere in the view.

    It and its leader keep clear of what is `taken`, and must not be taken to name `others`, shape (k, 2). `calm` tells whether
    words read well on what was drawn in a place; one where they do goes before a nearer one. `letter`: height of letters.
    """
    first: Place | None = None
    for reach, place in _candidates(point, width, height, letter):
        if first is not None and reach > CALM_REACH:
            break
        rect = place.rect
        if not rect.within(view) or any(rect.overlaps(other) for other in taken):
            continue
        if place.leader:
            clear = _leader_is_clear(point, rect, letter, taken, others)
        else:  # nearer to its point than to any other
            clear = bool((rect.distances(others) > rect.distances(point)).all())
        if clear and calm(rect):
            return place
        if clear and first is None:
            first = place
    return first


def _candidates(point: Array, width: float, height: float, letter: float) -> Iterator[tuple[float, Place]]:
    """Places around a point and how far off they are over the height of letters: beside it, then on leaders."""
    x, y = float(point[0]), float(point[1])
    away = 1.1 * letter
    for left, top in (
        (x + away, y - height),
        (x - away - width, y - height),
        (x + away, y + 0.1),
        (x - away - width, y + 0.1),
    ):
        yield 0.0, Place(Rect(left, top, left + width, top + height), False)
    angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    for reach in REACHES:
        for right, down in zip(np.cos(angles).tolist(), (-np.sin(angles)).tolist(), strict=True):
            left = x + right * (reach * letter + 0.5 * width) - 0.5 * width
            top = y + down * (reach * letter + 0.5 * height) - 0.5 * height
            yield reach, Place(Rect(left, top, left + width, top + height), True)


def _leader_is_clear(point: Array, rect: Rect, letter: float, taken: Sequence[Rect], others: Array) -> bool:
    """Whether a label and the line from it to its point keep clear of other labels and points."""
    end = np.array(rect.nearest(float(point[0]), float(point[1])))
    line = end + np.linspace(0.0, 1.0, ALONG_A_LEADER)[:, None] * (point - end)
    if any((other.distances(line) == 0.0).any() for other in taken if other.distances(point) > 0.0):
        return False
    gap = np.linalg.norm(line[:, None] - others, axis=2).min(axis=0, initial=np.inf)
    # Near its point a leader may pass as near to another one as that stands.
    room = np.minimum(ROOM * letter, 0.7 * np.linalg.norm(others - point, axis=1))
    return bool((rect.distances(others) > ROOM * letter).all() and (gap >= room).all())


Line = tuple[str, Rgb]

#: Height of letters over the height of the picture, and least [pixel].
LETTER, LEAST_LETTER = 0.026, 12
#: More spacecraft than these are counted, not named.
MAX_NAMED = 12
#: Points coincide that are nearer than this over the height of letters, and so, for their label, do ends of like lines.
SAME_PLACE, SAME_END = 0.6, 5.0
#: Names side by side in the label of points that coincide.
WORDS_IN_A_ROW = 6
#: Spread of the brightness in a place, of 255, at which it is too busy for words.
BUSY = 36.0
#: Places on a line at which its label may stand.
ALONG_A_LINE = 101
#: The words that change most from picture to picture, at their widest: with room for them a panel does not jump about.
WIDEST, WIDEST_DEED, WIDEST_DATA = "100.00 % observed", "linked to Earth", "888.8 Mbit on the way to Earth"
#: Opacity of the ground behind words, of 255.
GROUND_ALPHA = 150
#: Opacity of the lines from labels to what they name, of 255.
LEADER_ALPHA = 200
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
    """Writes on a picture (height, width, 3); labels keep clear of each other and of what was written before them."""

    def __init__(self, pixels: Pixels) -> None:
        self._image = Image.fromarray(pixels)
        self._draw = ImageDraw.Draw(self._image, "RGBA")
        self.size = max(LEAST_LETTER, round(LETTER * pixels.shape[0]))
        self._font = _font(self.size)
        self._taken: list[Rect] = []
        self._drawn = pixels

    @property
    def pixels(self) -> Pixels:
        """The picture with what was written on it."""
        return np.array(self._image)

    def panel_size(self, lines: Sequence[Line]) -> tuple[int, int]:
        """Width and height of a panel with these lines, from the third on of who does what and of data [pixel]."""
        texts = [text for text, _ in lines]
        likely = [WIDEST_DATA if colour == PACKET else f"{text.split()[0]} {WIDEST_DEED}" for text, colour in lines[2:]]
        widest = max(self._font.getlength(text) for text in (WIDEST, *texts, *likely))
        return round(widest) + self.size, self._step * len(lines) + self._step // 2 + self.size // 2

    def corner_box(self, size: tuple[int, int], box: Box, corner: Corner, legend: int) -> Box:
        """Where a part of some width and height stands in a corner of a view, above a legend of some height [pixel]."""
        width, height = size
        left = box.left + (box.width - width if corner.right else 0)
        top = box.top + (box.height - height - legend - self.size if corner.below else 0)
        return Box(left, top, width, height)

    @property
    def _step(self) -> int:
        return round(1.32 * self.size)

    def panel(self, lines: Sequence[Line], box: Box, corner: Corner, share: float, legend: int = 0) -> None:
        """Lines of text on a dark ground in a corner of a view; under the second a bar filled to a share from 0 to 1."""
        ground = self.corner_box(self.panel_size(lines), box, corner, legend)
        left, top, width, _ = ground
        self._taken.append(_rect(ground))
        step = self._step
        self._draw.rectangle(_rect(ground), (0, 0, 0, GROUND_ALPHA))
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

    def names(
        self, points_N: Array, labels: Sequence[Line], projection: Projection, *, dots: Sequence[int] = ()
    ) -> None:
        """Write beside points (k, 3) [m] what they are: in one label where they coincide, on a leader where it is crowded.

        `dots`: which points to mark too; where more than `MAX_NAMED` of these are in view, marks must do.
        """
        places, inside = projection.place(points_N)
        shown = np.flatnonzero(inside)
        marked = np.intersect1d(shown, dots).astype(int).tolist()
        for k in marked:
            x, y = places[k]
            self._draw.ellipse((x - 2, y - 2, x + 2, y + 2), fill=labels[k][1])
        if len(marked) > MAX_NAMED:
            return
        nobody = np.empty((0, 2))
        self._write_labels(
            places[shown], [labels[k] for k in shown.tolist()], SAME_PLACE * self.size, projection, nobody
        )

    def line_names(self, starts_N: Array, ends_N: Array, label: Line, projection: Projection, others_N: Array) -> None:
        """Write what lines are where they end, or where they leave what can be seen of the view; all points (k, 3) [m].

        The label must not be taken to name `others_N`.
        """
        view = _rect(projection.box, 1.5 * self.size)
        anchors = []
        for start, end in zip(starts_N, ends_N, strict=True):
            places, inside = projection.place(end + np.linspace(0.0, 1.0, ALONG_A_LINE)[:, None] * (start - end))
            for x, y in places[inside].tolist():
                point = Rect(x, y, x, y)
                if point.within(view) and not any(point.overlaps(rect) for rect in self._taken):
                    anchors.append((x, y))
                    break
        others, shown = projection.place(others_N)
        points = np.array(anchors).reshape(-1, 2)
        self._write_labels(points, [label] * len(points), SAME_END * self.size, projection, others[shown])

    def _write_labels(
        self, places: Array, labels: Sequence[Line], reach: float, projection: Projection, others: Array
    ) -> None:
        """Labels of points in the picture, one for those within a reach; none must be taken to name `others`."""
        height, view = 1.2 * self.size, _rect(projection.box)
        for group in groups(places, reach):
            words = list(dict.fromkeys(labels[k] for k in group))
            rows = [words[k : k + WORDS_IN_A_ROW] for k in range(0, len(words), WORDS_IN_A_ROW)]
            point = places[group[0]]
            apart = np.vstack((np.delete(places, group, axis=0), others))
            width = max(self._font.getlength(", ".join(text for text, _ in row)) for row in rows)
            place = place_label(point, width, height * len(rows), self.size, view, self._taken, apart, self._is_calm)
            if place is None:
                continue
            self._taken.append(place.rect)
            if place.leader:
                end = place.rect.nearest(*point)
                self._draw.line((*point, *end), fill=(*words[0][1], LEADER_ALPHA), width=max(1, self.size // 12))
            for k, row in enumerate(rows):
                self._row(place.rect.left, place.rect.top + k * height, row, ends=k == len(rows) - 1)

    def _is_calm(self, rect: Rect) -> bool:
        """Whether what was drawn in a place does not distract from words on it."""
        left, top, right, bottom = (round(edge) for edge in rect)
        return float(self._drawn[top:bottom, left:right].mean(axis=2).std()) < BUSY

    def _row(self, x: float, y: float, words: Sequence[Line], *, ends: bool) -> None:
        """Words in their colours with commas between them, and after them unless the row ends the label."""
        for k, (text, colour) in enumerate(words):
            more = text + ("" if ends and k == len(words) - 1 else ", ")
            self._words(x, y, more, colour)
            x += self._font.getlength(more)

    def caption(self, text: str, box: Box, colour: Rgb) -> None:
        """A text in the lower left corner of a camera's picture, its first word where there is no room, and a frame."""
        right, bottom = box.left + box.width, box.top + box.height
        self._draw.rectangle((box.left, box.top, right - 1, bottom - 1), outline=colour, width=1)
        y = bottom - round(1.5 * self.size)
        if self._font.getlength(text) > box.width - self.size // 2:
            text = text.split(" ")[0]
        self._taken.append(Rect(box.left, y, box.left + self.size + self._font.getlength(text), bottom))
        self._words(box.left + self.size // 3, y, text, colour)

    def inset(self, text: str, box: Box) -> None:
        """A caption, in as many lines as it needs, and a frame for a picture inside another, which names keep clear of."""
        right, bottom = box.left + box.width, box.top + box.height
        self._taken.append(_rect(box))
        self._draw.rectangle((box.left, box.top, right - 1, bottom - 1), outline=FAINT, width=1)
        lines = self._wrapped(text, box.width - self.size)
        for k, line in enumerate(lines):
            self._words(box.left + self.size // 3, bottom - self._step * (len(lines) - k) - self.size // 5, line, TEXT)

    def legend(self, note: str, box: Box) -> None:
        """What the colours on the body mean, and a note, along the lower edge of a view, in as many rows as they need."""
        side = self.size
        rows = self._legend_rows(note, box)
        height = round(1.4 * side)
        top = box.top + box.height - round(0.2 * side) - height * len(rows)
        self._taken.append(Rect(box.left, top, box.left + box.width, box.top + box.height))
        for row in rows:
            x = box.left + side // 2
            for text, colour in row:
                if colour is None:
                    last = row is rows[-1] and len(rows) == 1
                    at = box.left + box.width - side // 2 - self._font.getlength(text) if last else x
                    self._words(at, top, text, FAINT)
                    continue
                filled = colour if colour == SEEN else None
                self._draw.rectangle((x, top + 1, x + side, top + 1 + side), fill=filled, outline=colour, width=2)
                self._words(x + 1.4 * side, top, text, TEXT)
                x += round(2.4 * side + self._font.getlength(text))
            top += height

    def legend_height(self, note: str, box: Box) -> int:
        """How much of the lower edge of a view its legend takes [pixel]."""
        return round(1.4 * self.size) * len(self._legend_rows(note, box)) + round(0.2 * self.size)

    def _legend_rows(self, note: str, box: Box) -> list[list[tuple[str, Rgb | None]]]:
        """Rows of entries with their colours; the note has none."""
        entries: list[tuple[str, Rgb | None]] = [("observed", SEEN), ("not yet observed", UNSEEN_BORDER)]
        room = box.width - self.size
        widths = [2.4 * self.size + self._font.getlength(text) for text, _ in entries]
        if sum(widths) + self._font.getlength(note) <= room:
            return [[*entries, (note, None)]]
        notes: list[list[tuple[str, Rgb | None]]] = [[(line, None)] for line in self._wrapped(note, room)]
        return [*notes, entries] if sum(widths) - self.size <= room else [*notes, *([entry] for entry in entries)]

    def _wrapped(self, text: str, room: float) -> list[str]:
        """A text in lines that fit, if its words do."""
        lines: list[str] = []
        for word in text.split():
            if lines and self._font.getlength(f"{lines[-1]} {word}") <= room:
                lines[-1] += f" {word}"
            else:
                lines.append(word)
        return lines

    def remark(self, text: str, box: Box) -> None:
        """A faint text in the middle of a view, in as many lines as it needs."""
        lines = self._wrapped(text, box.width - self.size)
        y = box.top + 0.5 * box.height - 0.5 * self._step * len(lines)
        for line in lines:
            self._words(box.left + 0.5 * (box.width - self._font.getlength(line)), y, line, FAINT)
            y += self._step

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
    if looks_at_body(kind) and not instant.looks_at_body[j]:
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
