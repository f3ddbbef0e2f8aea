"""A box with scales in kilometres behind a scene in parallel projection: the three far walls and three labelled edges."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.path import Path
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from swarm_mj.figures.palette import GREY, LIGHT_GREY
from swarm_mj.figures.style import LABEL_PT, SMALL_PT, annotate
from swarm_mj.figures.view import KM, ZORDER_BODY, ZORDER_LINES, View
from swarm_mj.typing import Array

#: The shortest side of a box over the longest: a narrower one leaves most of the page blank.
LEAST_SIDE = 0.4
#: Ticks along the longest edge, about.
TICKS = 6
#: An edge seen shorter than this share of the picture has no room for its scale.
MIN_EDGE = 0.09
#: Of text along an edge.
ANCHORED: dict[str, Any] = {"rotation_mode": "anchor", "annotation_clip": False}
NAMES = ("$x_A$ [km]", "$y_A$ [km]", "$z_A$ [km]")


def box_around(points: Array, margin: float = 0.06) -> Array:
    """Lower and upper corner of a box around points (n, 3) [m], shape (2, 3) [m]; no side is much shorter than the longest."""
    low, high = points.min(axis=0), points.max(axis=0)
    longest = (high - low).max()
    room = np.maximum(margin * longest, 0.5 * (LEAST_SIDE * longest - (high - low)))
    return np.array([low - room, high + room])


def draw_box(ax: Axes, view: View, box: Array) -> None:
    """Draw the far walls of a box (2, 3) [m] with grid and scales, and fit the axes to it."""
    ax.set_axis_off()
    ax.set_aspect("equal")
    step = _step(box)
    ticks = [_ticks(box[0, i], box[1, i], step) for i in range(3)]
    far = (view.toward <= 0.0).astype(int)  # row of `box` that holds the wall turned away, for each axis
    for i in range(3):
        _draw_wall(ax, view, box, ticks, i, far)
    flat = view.project(_corners(box))
    low, high = flat.min(axis=0), flat.max(axis=0)
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    for i in range(3):
        _draw_scale(ax, view, box, ticks[i], i, far, float((high - low).max()))


def keep_inside(ax: Axes, view: View, box: Array) -> None:
    """Cut off what bodies and lines have outside a box (2, 3) [m]; the last thing to do with a picture."""
    flat = view.project(_corners(box))
    outline = Path(flat[ConvexHull(flat).vertices], closed=False)
    for artist in (*ax.collections, *ax.lines):
        if artist.get_zorder() in (ZORDER_BODY, ZORDER_LINES):
            artist.set_clip_path(outline, ax.transData)


def _corners(box: Array) -> Array:
    return np.array([[box[a, 0], box[b, 1], box[c, 2]] for a, b, c in product((0, 1), repeat=3)])


def _step(box: Array) -> float:
    raw = float((box[1] - box[0]).max()) / TICKS
    power = 10.0 ** np.floor(np.log10(raw))
    return power * float(next(m for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw))


def _ticks(low: float, high: float, step: float) -> Array:
    """Multiples of the step, or of its half where there would be fewer than two."""
    if np.floor(high / step) <= np.ceil(low / step):
        step /= 2.0
    return step * np.arange(np.ceil(low / step), np.floor(high / step) + 1) + 0.0


def _draw_wall(ax: Axes, view: View, box: Array, ticks: list[Array], i: int, far: NDArray[np.int_]) -> None:
    """The far wall across axis i: paper, border and grid."""
    j, k = (i + 1) % 3, (i + 2) % 3

    def place(a: float, b: float) -> Array:
        point = np.empty(3)
        point[i], point[j], point[k] = box[far[i], i], a, b
        return view.project(point)

    (j0, j1), (k0, k1) = box[:, j], box[:, k]
    border = np.array([place(j0, k0), place(j1, k0), place(j1, k1), place(j0, k1)])
    ax.add_collection(
        PolyCollection([border], facecolors="#F7F7F7", edgecolors=GREY, linewidths=0.7, zorder=0, clip_on=False),
        autolim=False,
    )
    lines = [[place(t, k0), place(t, k1)] for t in ticks[j]] + [[place(j0, t), place(j1, t)] for t in ticks[k]]
    ax.add_collection(LineCollection(lines, colors=LIGHT_GREY, linewidths=0.6, zorder=0.5), autolim=False)


def _draw_scale(
    ax: Axes, view: View, box: Array, ticks: Array, i: int, far: NDArray[np.int_], picture_km: float
) -> None:
    """Numbers and name along one edge parallel to axis i, on the outline of the box."""
    edge = _outline_edge(view, box, i, far)
    ends = view.project(edge)
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    if length < MIN_EDGE * picture_km:
        return
    centre = view.project(box.mean(axis=0))
    outward = np.array([along[1], -along[0]]) / length
    outward *= np.sign(outward @ (ends.mean(axis=0) - centre))
    every = 2 if len(ticks) * 0.055 * picture_km > length else 1
    for tick in ticks[::every]:
        share = (tick - box[0, i]) / (box[1, i] - box[0, i])
        text = f"{tick / KM:g}".replace("-", "\N{MINUS SIGN}")
        annotate(ax, text, ends[0] + share * along, outward * 11.0, fontsize=SMALL_PT, **ANCHORED)
    turned = 90.0 - (90.0 - float(np.degrees(np.arctan2(along[1], along[0])))) % 180.0
    annotate(ax, NAMES[i], ends.mean(axis=0), outward * 30.0, fontsize=LABEL_PT, rotation=turned, **ANCHORED)


def _outline_edge(view: View, box: Array, i: int, far: NDArray[np.int_]) -> Array:
    """Ends of the edge along axis i on the outline: the lower one for x and y, the left one for z, shape (2, 3) [m]."""
    j, k = (i + 1) % 3, (i + 2) % 3
    candidates = []
    for row_j, row_k in ((far[j], 1 - far[k]), (1 - far[j], far[k])):
        edge = np.empty((2, 3))
        edge[:, i], edge[:, j], edge[:, k] = box[:, i], box[row_j, j], box[row_k, k]
        candidates.append(edge)
    return min(candidates, key=lambda edge: float(view.project(edge).mean(axis=0)[0 if i == 2 else 1]))
