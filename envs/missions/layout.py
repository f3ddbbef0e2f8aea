"""Which numbers of the flat observation of SwarmObserve-v1 are which."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarm_mj.typing import Array32

from .tables import GENERAL, PAIRS, SPACECRAFT, Tables

#: Of the table of patches the first columns stand in the flat observation: what changes, `unseen`, and `lit`.
FLAT_PATCHES = 2


class FlatLayout:
    """The flat observation of up to n spacecraft over K patches: spacecraft, pairs, patches, general, row by row.

    Args:
        n: Most spacecraft.
        patches: Number of patches K.

    Attributes:
        shapes: Of the parts by name, in their order.
        size: Numbers in all.
    """

    def __init__(self, n: int, patches: int) -> None:
        self.shapes = {
            "spacecraft": (n, len(SPACECRAFT)),
            "pairs": (n, patches, len(PAIRS)),
            "patches": (patches, FLAT_PATCHES),
            "general": (len(GENERAL),),
        }
        self.size = sum(int(np.prod(shape)) for shape in self.shapes.values())

    def joined(self, tables: Tables) -> Array32:
        """Tables of E episodes as rows, shape (E, F)."""
        parts = [tables.spacecraft, tables.pairs, tables.patches[:, :, :FLAT_PATCHES], tables.general]
        return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)

    def split(self, flat: NDArray[np.floating]) -> dict[str, NDArray[np.floating]]:
        """The parts of E flat observations by name, shape (E, F); of one, shape (F,), with E = 1."""
        rows = np.atleast_2d(flat)
        parts, start = {}, 0
        for name, shape in self.shapes.items():
            size = int(np.prod(shape))
            parts[name] = rows[:, start : start + size].reshape(len(rows), *shape)
            start += size
        return parts
