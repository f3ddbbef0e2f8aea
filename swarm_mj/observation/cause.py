"""Why ground is not observed."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from swarm_mj.typing import Array


class Cause(IntEnum):
    """Why a cell does not count in a picture: the first condition that it does not fulfil, in this order, or none."""

    NO_PICTURE = 0
    OUT_OF_VIEW = 1
    FACES_AWAY = 2
    OBLIQUE = 3
    COARSE = 4
    BLURRED = 5
    HIDDEN = 6
    DARK = 7
    CAMERA_OFF = 8
    NONE = 9


#: In words of a table.
WORDS = {
    Cause.NO_PICTURE: "no picture taken",
    Cause.OUT_OF_VIEW: "out of view",
    Cause.FACES_AWAY: "faces away",
    Cause.OBLIQUE: "too oblique",
    Cause.COARSE: "too coarse",
    Cause.BLURRED: "blurred",
    Cause.HIDDEN: "hidden",
    Cause.DARK: "dark",
    Cause.CAMERA_OFF: "camera off",
}


def shares(area: Array, why: NDArray[np.int8]) -> dict[Cause, float]:
    """Shares of the target that are not observed [%] by cause, the largest first.

    Args:
        area: Of each cell [m^2], shape (n,).
        why: `Cause` of each, shape (n,).
    """
    share = 100.0 / area.sum() * np.bincount(why, area, len(Cause))
    found = sorted((cause for cause in WORDS if share[cause] > 0.0), key=lambda cause: -share[cause])
    return {cause: float(share[cause]) for cause in found}
