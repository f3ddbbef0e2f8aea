"""Where labels stand: beside what they name and clear of each other; farther off on a leader where it is crowded.

All in pixels, right and down from the left upper corner of the picture.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from swarm_mj.typing import Array

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
        return (
            self.left > other.left and self.top > other.top and self.right < other.right and self.bottom < other.bottom
        )

    def overlaps(self, other: Rect) -> bool:
        """Whether the two share a point."""
        return not (
            self.right < other.left or other.right < self.left or self.bottom < other.top or other.bottom < self.top
        )

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """Its point that is nearest to another."""
        return min(max(x, self.left), self.right), min(max(y, self.top), self.bottom)

    def distances(self, points: Array) -> Array:
        """Distances from points, shape (k, 2), to it, shape (k,); zero inside."""
        low, high = (self.left, self.top), (self.right, self.bottom)
        return np.asarray(np.linalg.norm(points - np.clip(points, low, high), axis=-1))


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
    """Where a label for a point can stand; None: nowhere in the view.

    Args:
        point: What it names, shape (2,).
        width: Of the label.
        height: Of the label.
        letter: Height of letters.
        view: What it must lie in.
        taken: What it and its leader must keep clear of.
        others: Points that it must not be taken to name, shape (k, 2).
        calm: Whether words read well on what was drawn there; a place where they do goes before a nearer one.
    """
    first: Place | None = None
    for reach, place in _candidates(point, width, height, letter):
        if first is not None and reach > CALM_REACH:
            break
        rect = place.rect
        if not rect.within(view) or any(rect.overlaps(other) for other in taken):
            continue
        clear = (
            _leader_is_clear(point, rect, letter, taken, others) if place.leader else _is_nearest(point, rect, others)
        )
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


def _is_nearest(point: Array, rect: Rect, others: Array) -> bool:
    """Whether a label is nearer to its point than to any other."""
    return bool((rect.distances(others) > rect.distances(point)).all())


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
