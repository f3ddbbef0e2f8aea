"""Which view stands where in a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarm_mj.rendering.cameras import CHASE, OVERVIEW, SPLIT, spacecraft_number
from swarm_mj.rendering.canvas import Box

#: Sizes that can be drawn and encoded [pixel].
LEAST_SIDE, MOST_SIDE = 64, 8192
#: Share of a split picture that the overview takes.
OVERVIEW_SHARE = 0.62
#: What is left beside the square picture of one camera holds the overview from this share of the square's side on.
LEAST_BESIDE = 0.3
#: More cameras than these are too small to see anything in.
MAX_TILES = 12
#: Free pixels between the pictures of the cameras.
GAP = 4


@dataclass(frozen=True)
class Layout:
    """Parts of a picture.

    Attributes:
        main: Where the view of the swarm stands; None if there is none.
        chase: Whether that view moves with the swarm.
        cameras: Spacecraft, from 0, whose cameras are shown, and where.
    """

    main: Box | None
    chase: bool
    cameras: dict[int, Box]


def layout_of(camera: str, n: int, n_observers: int, width: int, height: int) -> Layout:
    """The parts of a picture for a camera's name.

    Args:
        camera: `overview`, `chase`, `split`, or `sc1`, `sc2`, ..., each with the overview beside it if there is room.
        n: Number of spacecraft.
        n_observers: Number of those that have a camera's picture to show in `split`.
        width: Of the picture [pixel].
        height: Of the picture [pixel].

    Raises:
        OutputError: There is no camera of that name.
    """
    number = spacecraft_number(camera, n)
    if camera in (OVERVIEW, CHASE):
        return Layout(Box(0, 0, width, height), camera == CHASE, {})
    if number is not None:
        side = min(width, height)
        beside = Box(0, 0, width - side, height) if width > height else Box(0, 0, width, height - side)
        main = beside if min(beside.width, beside.height) >= LEAST_BESIDE * side else None
        return Layout(main, False, {number: Box(width - side, height - side, side, side)})
    assert camera == SPLIT
    left = round(OVERVIEW_SHARE * width)
    boxes = _tiles(min(n_observers, MAX_TILES), left, width - left, height)
    return Layout(Box(0, 0, left, height), False, dict(enumerate(boxes)))


def _tiles(count: int, left: int, width: int, height: int) -> list[Box]:
    """Squares in rows, as large as they fit beside the overview."""
    columns = max(range(1, count + 1), key=lambda c: min(width // c, height // -(-count // c)))
    rows = -(-count // columns)
    side = min(width // columns, height // rows)
    margin_x, margin_y = width - columns * side, (height - rows * side) // 2
    places = [np.divmod(k, columns) for k in range(count)]
    return [
        Box(
            left + margin_x // 2 + int(c) * side + GAP // 2, margin_y + int(r) * side + GAP // 2, side - GAP, side - GAP
        )
        for r, c in places
    ]
