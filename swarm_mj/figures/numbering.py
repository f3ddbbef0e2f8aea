"""Numbers beside the spacecraft of a picture, clear of markers, of lines and of each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from swarm_mj.figures.style import HALO, INSIDE, TICK_PT, annotate
from swarm_mj.typing import Array

#: Distances between a place and its number that are tried [pt], and directions.
REACHES_PT, DIRECTIONS = (11.0, 14.0, 18.0, 23.0), 16
#: The offsets that are tried, nearest first, shape (t, 2), and how long each is, shape (t,) [pt].
TRIAL_REACHES_PT = np.repeat(REACHES_PT, DIRECTIONS)
_ANGLES = np.tile(2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS, len(REACHES_PT))
TRIALS_PT = TRIAL_REACHES_PT[:, None] * np.column_stack((np.cos(_ANGLES), np.sin(_ANGLES)))
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
    """Write a number beside each place (n, 2) in the axes' units; the axes' limits must be set.

    `numbers` are counted from 0, written from 1, by default in order; they should not cross `lines`, each (m, 2) in the axes'
    units. `marked`: whether there are markers at the places.
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
    """Write a short text beside a place, bold and in front of what is drawn; `leader`: how a line that joins them looks."""
    style: dict[str, Any] = {"fontsize": TICK_PT + 1, "fontweight": "bold", "color": colour, "path_effects": HALO}
    annotate(ax, text, place, offset_pt, zorder=7, arrowprops=leader, **style, **INSIDE)


def _leader(colour: str) -> dict[str, Any]:
    """A thin line from a number to its marker."""
    return {"arrowstyle": "-", "color": colour, "linewidth": 0.7, "shrinkA": 1.0, "shrinkB": 3.0}


def _offsets(ax: Axes, places: Array, lines: Sequence[Array], marked: bool) -> Array:
    """Where each number stands relative to its place [pt], shape (n, 2); before the layout is known, so about."""
    spots = on_page(ax, places)
    path = np.vstack([np.empty((0, 2)), *(_dense(on_page(ax, line)) for line in lines)])
    outward = spots - spots.mean(axis=0)
    solid = spots if marked else np.empty((0, 2))
    offsets: list[Array] = []
    for spot, away in zip(spots, outward, strict=True):
        middles = spot + TRIALS_PT
        cost = COVERED * (_distances(middles, solid) < CLEAR_PT).sum(axis=1)
        cost += CROSSED * (_distances(middles, path) < LINE_PT).any(axis=1)
        own = np.linalg.norm(middles - spot, axis=1, keepdims=True)
        cost += MISTAKEN * ((_distances(middles, spots) < NEARER * own).sum(axis=1) > 1)
        size = float(np.linalg.norm(away))
        along = TRIALS_PT @ (away / size if size > 1e-9 else np.array([0.0, 1.0])) / TRIAL_REACHES_PT
        cost += FARTHER * TRIAL_REACHES_PT + 0.5 * TURNED * (1.0 - along)
        offsets.append(TRIALS_PT[np.argmin(cost)])
        solid = np.vstack((solid, spot + offsets[-1]))
    return np.array(offsets).reshape(-1, 2)


def on_page(ax: Axes, places: Array) -> Array:
    """Places (n, 2) in the axes' units on the page [pt]; before the layout is known, so about."""
    ax.apply_aspect()
    figure = ax.get_figure(root=True)
    assert figure is not None
    return np.asarray(POINTS_PER_INCH / figure.dpi * ax.transData.transform(places))


def _distances(places: Array, others: Array) -> Array:
    """From each of n places to each of m others, shape (n, m)."""
    return np.asarray(np.linalg.norm(places[:, None] - others, axis=2))


def _dense(line: Array) -> Array:
    """Points on a line [pt], a few points apart; what is not finite breaks it."""
    whole = np.asarray(np.isfinite(line).all(axis=1))
    joined = whole[:-1] & whole[1:]
    parts = [line[whole]]
    starts, steps = line[:-1][joined], np.diff(line, axis=0)[joined]
    counts = (np.linalg.norm(steps, axis=1) / LINE_PT).astype(int)
    for k in np.flatnonzero(counts):
        parts.append(starts[k] + np.linspace(0.0, 1.0, counts[k] + 2)[1:-1, None] * steps[k])
    return np.vstack(parts)
