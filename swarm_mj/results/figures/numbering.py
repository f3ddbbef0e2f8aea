"""Numbers beside the spacecraft of a picture, clear of markers, of lines and of each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from swarm_mj.results.figures.style import HALO, TICK_PT
from swarm_mj.typing import Array

#: Distances between a place and its number that are tried [pt], and directions.
REACHES_PT, DIRECTIONS = (11.0, 14.0, 18.0, 23.0), 16
#: Least distances of a number's middle from markers and other numbers, and from lines [pt].
CLEAR_PT, LINE_PT = 10.5, 6.0
#: A number could be taken for that of another place, if that is nearer than this over the distance of its own.
NEARER = 1.4
#: What a covered marker costs, another place nearby, a line that is crossed, a point of distance, and a turn by 180 deg.
COVERED, MISTAKEN, CROSSED, FARTHER, TURNED = 1000.0, 14.0, 10.0, 1.0, 6.0
#: A number farther from its marker is joined to it by a line [pt].
LEADER_PT = 15.0
POINTS_PER_INCH = 72.0


def number_beside(
    ax: Axes,
    places: Array,
    colours: Sequence[str],
    *,
    numbers: Sequence[int] | None = None,
    lines: Sequence[Array] = (),
    marked: bool = True,
) -> None:
    """Write a number beside each place; the axes' limits must be set.

    Args:
        ax: Where to draw.
        places: In the axes' units, shape (n, 2).
        colours: Of the numbers.
        numbers: Counted from 0, written from 1; by default in order.
        lines: What numbers should not cross, each a line of points in the axes' units, shape (m, 2).
        marked: Whether there are markers at the places.
    """
    order = range(len(places)) if numbers is None else numbers
    for j, place, offset, colour in zip(order, places, _offsets(ax, places, lines, marked), colours, strict=True):
        led = marked and np.linalg.norm(offset) > LEADER_PT
        name_beside(ax, place, str(j + 1), offset, colour, _leader(colour) if led else None)


def name_beside(
    ax: Axes,
    place: Array,
    text: str,
    offset_pt: Sequence[float] | Array,
    colour: str,
    leader: dict[str, Any] | None = None,
) -> None:
    """Write a short text beside a place, bold and in front of what is drawn.

    Args:
        ax: Where to draw.
        place: In the axes' units, shape (2,).
        text: What to write.
        offset_pt: Of the text's middle from the place, right and up [pt].
        colour: Of the text.
        leader: Properties of the line that joins the text to its place; None: no line.
    """
    ax.annotate(
        text,
        (float(place[0]), float(place[1])),
        xytext=(float(offset_pt[0]), float(offset_pt[1])),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=TICK_PT + 1,
        fontweight="bold",
        color=colour,
        path_effects=HALO,
        zorder=7,
        arrowprops=leader,
    )


def _leader(colour: str) -> dict[str, Any]:
    """A thin line from a number to its marker."""
    return {"arrowstyle": "-", "color": colour, "linewidth": 0.7, "shrinkA": 1.0, "shrinkB": 3.0}


def _offsets(ax: Axes, places: Array, lines: Sequence[Array], marked: bool) -> Array:
    """Where each number stands relative to its place [pt], shape (n, 2); before the layout is known, so about."""
    ax.apply_aspect()
    figure = ax.get_figure(root=True)
    assert figure is not None
    scale = POINTS_PER_INCH / figure.dpi
    spots = scale * ax.transData.transform(places)
    path = np.vstack([np.empty((0, 2)), *(_dense(scale * ax.transData.transform(line)) for line in lines)])
    outward = spots - spots.mean(axis=0)
    angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    unit = np.column_stack((np.cos(angles), np.sin(angles)))
    offsets: list[Array] = []
    taken: list[Array] = []
    for spot, away in zip(spots, outward, strict=True):
        size = float(np.linalg.norm(away))
        turn = unit @ (away / size if size > 1e-9 else np.array([0.0, 1.0]))
        best, least = unit[0], np.inf
        for reach in REACHES_PT:
            for direction, along in zip(unit, turn, strict=True):
                middle = spot + reach * direction
                solid = np.vstack((spots if marked else np.empty((0, 2)), *taken))
                cost = COVERED * float((np.linalg.norm(solid - middle, axis=1) < CLEAR_PT).sum())
                cost += CROSSED * float((np.linalg.norm(path - middle, axis=1) < LINE_PT).any())
                own = float(np.linalg.norm(middle - spot))
                cost += MISTAKEN * float((np.linalg.norm(spots - middle, axis=1) < NEARER * own).sum() > 1)
                cost += FARTHER * reach + 0.5 * TURNED * (1.0 - float(along))
                if cost < least:
                    best, least = reach * direction, cost
        offsets.append(best)
        taken.append((spot + best)[None])
    return np.array(offsets).reshape(-1, 2)


def _dense(line: Array) -> Array:
    """Points on a line [pt], a few points apart; what is not finite breaks it."""
    whole = np.asarray(np.isfinite(line).all(axis=1))
    joined = whole[:-1] & whole[1:]
    parts = [line[whole]]
    for start, end in zip(line[:-1][joined], line[1:][joined], strict=True):
        count = int(np.linalg.norm(end - start) / LINE_PT)
        if count:
            parts.append(start + np.linspace(0.0, 1.0, count + 2)[1:-1, None] * (end - start))
    return np.vstack(parts)
