"""From pictures to data: what each spacecraft holds of the target, in tiles.

A tile is a set of cells that the same pictures show: of one cell of it a spacecraft holds either nothing or what one picture
shows of it. Tiles are what is stored, sent and delivered; they are disjoint, so that their areas add up to
the map. A copy that another spacecraft has of a tile may stay aboard.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarm_mj.typing import Array, Ints

#: Ground sampling distances within this factor are of one grade: as good as each other.
GRADE = 1.1


@dataclass(frozen=True, eq=False, kw_only=True)
class Tiles:
    """What the swarm holds of the target."""

    of_cell: Ints  #: tile of each cell, -1 for what nobody saw, shape (cells,)
    area: Array  #: of each tile [m^2], shape (q,)
    bits: NDArray[np.int64]  #: data of each tile as each spacecraft has it, 0 where it has it not, shape (n, q)
    ready_s: Array  #: when its picture was taken [s], infinity for never, shape (n, q)
    #: ground sampling distance of each copy, the mean over its area [m], infinity where there is none, shape (n, q)
    gsd_m: Array

    @property
    def count(self) -> int:
        """Number of tiles."""
        return len(self.area)


def grade(gsd_m: ArrayLike) -> Array:
    """Grade of ground sampling distances [m], a whole number that is less for what is finer by a factor of `GRADE`."""
    return np.asarray(np.floor(np.log(gsd_m) / math.log(GRADE)))


def make_tiles(area: Array, ready_s: Array, bits: Array, gsd_m: Array) -> Tiles:
    """Group cells by who has them since when.

    Args:
        area: Of each cell [m^2], shape (cells,).
        ready_s: Since when each spacecraft has what it sends of each cell [s], NaN where it has nothing, shape (n, cells).
        bits: What that is, shape (n, cells) [bit].
        gsd_m: Its ground sampling distance [m], shape (n, cells).
    """
    when = np.where(np.isnan(ready_s), np.inf, ready_s)
    seen = np.flatnonzero(np.isfinite(when).any(axis=0))
    of_cell = np.full(len(area), -1, np.int64)
    if not len(seen):
        none = np.empty((len(when), 0))
        return Tiles(of_cell=of_cell, area=np.empty(0), bits=none.astype(np.int64), ready_s=none, gsd_m=none)
    ready, tile = np.unique(when[:, seen], axis=1, return_inverse=True)
    tile, held = tile.reshape(-1), np.isfinite(ready)
    of_cell[seen] = tile

    own = np.isfinite(when[:, seen])

    def summed(rows: Array) -> Array:
        """Rows of cells added up over each tile, shape (k, q)."""
        return np.array([np.bincount(tile, row, ready.shape[1]) for row in rows], np.float64)

    tile_area = summed(area[None, seen])[0]
    size = summed(np.where(own, bits[:, seen], 0.0))
    spread = summed(np.where(own, gsd_m[:, seen] * area[seen], 0.0))
    return Tiles(
        of_cell=of_cell,
        area=tile_area,
        bits=np.where(held, np.maximum(np.ceil(size - 1e-9), 1.0), 0.0).astype(np.int64),
        ready_s=ready,
        gsd_m=np.where(held, spread / tile_area, np.inf),
    )
