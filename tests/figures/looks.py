"""What is to be seen on a drawn page: the looks of its artists, where their data lie, how large a body is."""

import numpy as np
from matplotlib.axes._secondary_axes import SecondaryAxis
from matplotlib.collections import Collection, LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.contour import ContourSet
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox

from swarm_mj.figures.palette import GREY
from swarm_mj.figures.view import ZORDER_BODY


def all_axes(figure):
    """Axes and those inside them."""
    own = [inner for ax in figure.axes if ax.get_visible() for inner in (ax, *ax.child_axes)]
    return [ax for ax in own if not isinstance(ax, SecondaryAxis)]  # a scale without content


def tint(colour):
    """A colour without its brightness: light and relief change that alone."""
    rgb = np.asarray(to_rgb(colour[:3] if not isinstance(colour, str) else colour))
    return rgb / max(rgb.max(), 1e-9)


def same(colour, colours):
    return any(np.abs(tint(colour) - tint(other)).max() < 0.03 for other in colours)


def is_seen(handle, figure):
    """Whether something of a legend entry's look lies inside axes."""
    return any(_seen_in(ax, handle) for ax in all_axes(figure))


def _seen_in(ax, handle):
    frame = ax.get_window_extent()
    if isinstance(handle, Patch):
        fills = [c for s in ax.collections if not isinstance(s, LineCollection) for c in s.get_facecolor()]
        fills += [p.get_facecolor() for p in ax.patches if p.get_window_extent().overlaps(frame)]
        pixels = [np.unique(np.round(i.get_array()[..., :3].reshape(-1, 3), 2), axis=0) for i in ax.images]
        return same(handle.get_facecolor(), [*fills, *np.vstack([np.empty((0, 3)), *pixels])])
    return any(_matches(handle, line) and inside(line, frame).any() for line in ax.lines) or any(
        _dashes(handle) == outline and same(handle.get_color(), [colour])
        for s in ax.collections
        if isinstance(s, ContourSet)
        for colour in s.get_edgecolor()
        for outline in _outlines(s)
    )


def _matches(handle, line):
    generic = to_rgb(handle.get_color()) == to_rgb(GREY)  # stands for lines of any colour
    if not generic and not same(handle.get_color(), [line.get_color()]):
        return False
    marker = handle.get_marker()
    if marker not in ("None", None, ""):
        return line.get_marker() == marker
    return line.get_linestyle() != "None" and _dashes(line) == _dashes(handle)


def _dashes(line):
    """Lengths of strokes over the line's width; () of a whole line."""
    return _pattern(line._unscaled_dash_pattern[1])


def _outlines(contours):
    return [_pattern(dashes, width) for (_, dashes), width in zip(contours.get_linestyle(), contours.get_linewidth())]  # noqa: B905


def _pattern(dashes, width=1.0):
    return tuple(np.round(np.asarray(dashes) / width, 3)) if dashes else ()


def inside(line, frame):
    """Which points of a line lie in a frame of the page [px]."""
    places = np.ma.filled(line.get_transform().transform(np.ma.column_stack(line.get_data())), np.nan)
    (x0, y0), (x1, y1) = frame.min - 1.0, frame.max + 1.0
    return (places >= (x0, y0)).all(axis=1) & (places <= (x1, y1)).all(axis=1)


def share_filled(ax):
    """Width and height of what is drawn, over those of the axes; the walls of a box around a scene do not count."""
    frame = ax.get_window_extent()
    boxes = []
    for artist in (*ax.lines, *ax.patches, *ax.images, *ax.collections):
        if ax.axison or artist.get_zorder() >= ZORDER_BODY:
            points = _page_points(artist)
            points = points[np.isfinite(points).all(axis=1)]
            box = Bbox.intersection(Bbox([points.min(axis=0), points.max(axis=0)]), frame) if len(points) else None
            boxes += [] if box is None else [box]
    if not boxes:
        return 0.0, 0.0
    whole = Bbox.union(boxes)
    return whole.width / frame.width, whole.height / frame.height


def _page_points(artist):
    """Corners of an artist on the page [px], shape (n, 2)."""
    if isinstance(artist, Line2D):
        return np.asarray(artist.get_transform().transform(np.column_stack(artist.get_data())))
    if isinstance(artist, Collection):
        return np.vstack(
            [np.empty((0, 2)), *(artist.get_transform().transform(p.vertices) for p in artist.get_paths())]
        )
    return artist.get_window_extent().get_points()


def body_pixels(figure):
    """Width of the largest picture of the body on the page [px]."""
    widths = [0.0]
    for ax in all_axes(figure):
        for body in ax.collections:
            if isinstance(body, PolyCollection) and body.get_zorder() == ZORDER_BODY:
                corners = ax.transData.transform(np.vstack([path.vertices for path in body.get_paths()]))
                box = Bbox.intersection(Bbox([corners.min(axis=0), corners.max(axis=0)]), ax.get_window_extent())
                widths.append(box.width if box is not None else 0.0)
    return max(widths)
