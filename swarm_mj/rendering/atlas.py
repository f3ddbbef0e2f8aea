"""The picture painted on the body: one square tile for each cell of the target, so that a cell fills in one colour.

Cells that were not observed show bare ground inside the border of their face of F_T; observed ones are filled. The border
has the same width in metres everywhere. All other ground shares one bare tile.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from swarm_mj.mission.target import TargetRegion
from swarm_mj.rendering.palette import GROUND, SEEN, SEEN_BORDER, UNSEEN_BORDER
from swarm_mj.typing import Array, Indices, Ints32, Mask

#: Width of a border, on each side of an edge, over the side of a square as large as a mean face.
BORDER = 0.035
#: Width of a tile [texel] and of the whole picture at most; every OpenGL 3 driver takes the latter.
TILE, MAX_WIDTH = 64, 4096
#: Free texels along a tile's sides, which keep neighbours out of a filtered sample.
MARGIN = 2.0


class Atlas:
    """Texture of a body and where each of its faces lies in it.

    Args:
        region: The target and the body cut along it.
    """

    def __init__(self, region: TargetRegion) -> None:
        self._columns = int(np.ceil(np.sqrt(region.n_cells + 1)))
        self._tile = int(np.clip(MAX_WIDTH // self._columns, 4, TILE))
        self.width = self._columns * self._tile
        self._border = _borders(region, self._tile)
        self._seen = np.zeros(region.n_cells, np.bool_)
        self.image = np.empty((self.width, self.width, 3), np.uint8)
        self.image[:] = GROUND
        self._paint(np.arange(region.n_cells))

    def show(self, seen: Mask) -> bool:
        """Paint the cells observed so far, shape (n_cells,); tells whether the picture changed."""
        changed = np.flatnonzero(seen != self._seen)
        self._seen[changed] = seen[changed]
        self._paint(changed)
        return changed.size > 0

    def coordinates(self, region: TargetRegion) -> tuple[Array, Ints32]:
        """Texture coordinates, shape (k, 2), and which of them each corner of the body's faces takes, shape (F, 3)."""
        n, tile = region.n_cells, self._tile
        corner = np.array([(MARGIN, MARGIN), (tile - MARGIN, MARGIN), (MARGIN, tile - MARGIN)])
        row, column = np.divmod(np.arange(n + 1), self._columns)
        place = tile * np.stack((column, row), axis=1)
        cells = (place[:n, None] + corner).reshape(-1, 2)
        bare = place[n] + 0.5 * tile
        index = np.full(region.faces.shape, 3 * n, np.int32)
        index[region.target] = np.arange(3 * n).reshape(n, 3)
        return np.vstack((cells, bare)) / self.width, index

    def _paint(self, cells: Indices) -> None:
        for cell in cells:
            row, column = divmod(int(cell), self._columns)
            fill, line = (SEEN, SEEN_BORDER) if self._seen[cell] else (GROUND, UNSEEN_BORDER)
            tile = np.where(self._border[cell][..., None], np.array(line, np.uint8), np.array(fill, np.uint8))
            top, left = row * self._tile, column * self._tile
            self.image[top : top + self._tile, left : left + self._tile] = tile


def _borders(region: TargetRegion, tile: int) -> Mask:
    """Texels of each cell's tile that are near to a border of its face, shape (n, tile, tile)."""
    texel = (np.arange(tile) + 0.5 - MARGIN) / (tile - 2.0 * MARGIN)
    second, third = np.meshgrid(texel, texel)  # shares of the second corner to the right, of the third downwards
    shares = np.stack((1.0 - second - third, second, third))
    width = BORDER * np.sqrt(region.total_area / region.n_faces)
    near = np.empty((region.n_cells, tile, tile), np.bool_)
    for cell, heights in enumerate(_heights(region)):
        # Distances to a line are linear on a cell: where no corner is near to it, nothing is.
        close = heights[(heights < width).any(axis=1)]
        near[cell] = (np.tensordot(close, shares, axes=1) < width).any(axis=0)
    return near


def _heights(region: TargetRegion) -> Iterator[Array]:
    """Of each cell, how far its corners are from the lines that bound its face, shape (k, 3) [m].

    A cell may touch such a line with one corner alone, and still a part of the border's width lies in it.
    """
    cell, side = np.nonzero(_on_border(region))
    corners, group = region.corners_A, region.group[cell]
    start, end = corners[cell, side - 2], corners[cell, side - 1]
    along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    for own, points in zip(region.group, corners, strict=True):
        lines = group == own
        yield np.linalg.norm(np.cross(points - start[lines, None], along[lines, None]), axis=2)


def _on_border(region: TargetRegion) -> Mask:
    """Whether the side of each cell that faces each corner bounds a face of F_T, shape (n, 3)."""
    faces = region.faces[region.target]
    sides = np.sort(np.stack((np.roll(faces, -1, axis=1), np.roll(faces, -2, axis=1)), axis=2), axis=2).reshape(-1, 2)
    _, side, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    group = np.repeat(region.group, 3)
    lowest, highest = np.full(len(count), group.max()), np.zeros(len(count), group.dtype)
    np.minimum.at(lowest, side, group)
    np.maximum.at(highest, side, group)
    return ((count == 1) | (lowest != highest))[side].reshape(-1, 3)
