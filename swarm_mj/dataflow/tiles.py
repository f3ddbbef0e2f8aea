"""From pictures to data: what each spacecraft holds of the target, in tiles.

A tile is a set of cells that the same pictures show: of one cell of it a spacecraft holds either nothing or what its first
picture that counts shows of it. Tiles are what is stored, sent and delivered; they are disjoint, so that their areas add up to
the map. A copy that another spacecraft has of a tile may stay aboard.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm_mj.typing import Array, Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class Tiles:
    """What the swarm holds of the target.

    Attributes:
        of_cell: Tile of each cell, -1 for what nobody saw, shape (cells,).
        area: Of each tile [m^2], shape (q,).
        bits: Data of each tile as each spacecraft has it, 0 where it has it not, shape (n, q).
        ready_s: When its picture was taken [s], infinity for never, shape (n, q).
    """

    of_cell: Ints
    area: Array
    bits: NDArray[np.int64]
    ready_s: Array

    @property
    def count(self) -> int:
        """Number of tiles."""
        return len(self.area)

    def percent_of_target(self, share: Array, target_area: float) -> float:
        """What shares of the tiles, shape (q,), are of the whole target [%]."""
        return 100.0 * float(share @ self.area) / target_area


def make_tiles(
    area: Array, first_seen_by_s: Array, pixels: Array, *, bits_per_pixel: float, frame_bit: float | None = None
) -> Tiles:
    """Group cells by who saw them when.

    Args:
        area: Of each cell [m^2], shape (cells,).
        first_seen_by_s: When each spacecraft first took a picture in which the cell counts [s], NaN for never, (n, cells).
        pixels: What each cell takes up in that picture, shape (n, cells); read where there is one.
        bits_per_pixel: After compression.
        frame_bit: Data of a whole picture, where whole pictures are sent: shared out over the tiles of a picture by their
            pixels. None: the pixels of the new cells alone are sent.
    """
    when = np.where(np.isnan(first_seen_by_s), np.inf, first_seen_by_s)
    seen = np.flatnonzero(np.isfinite(when).any(axis=0))
    of_cell = np.full(len(area), -1, np.int64)
    if not len(seen):
        return Tiles(
            of_cell=of_cell, area=np.empty(0), bits=np.empty((len(when), 0), np.int64), ready_s=np.empty((len(when), 0))
        )
    ready_s, tile = np.unique(when[:, seen], axis=1, return_inverse=True)
    tile = tile.reshape(-1)
    of_cell[seen] = tile
    count = ready_s.shape[1]
    spent = np.array(
        [
            np.bincount(tile, np.where(np.isfinite(w), p, 0.0), count)
            for w, p in zip(when[:, seen], pixels[:, seen], strict=True)
        ]
    )
    held = np.isfinite(ready_s)
    bits = spent * bits_per_pixel if frame_bit is None else _shared_frames(ready_s, spent, frame_bit)
    whole = np.where(held, np.maximum(np.ceil(bits - 1e-9), 1.0), 0.0).astype(np.int64)
    return Tiles(
        of_cell=of_cell, area=np.bincount(tile, area[seen], count).astype(np.float64), bits=whole, ready_s=ready_s
    )


def _shared_frames(ready_s: Array, spent: Array, frame_bit: float) -> Array:
    """Data of tiles [bit], shape (n, q), where every picture that adds a cell is sent whole."""
    bits = np.zeros(spent.shape)
    for j, row in enumerate(ready_s):
        for t in np.unique(row[np.isfinite(row)]):
            of_frame = row == t
            bits[j, of_frame] = frame_bit * spent[j, of_frame] / spent[j, of_frame].sum()
    return bits
