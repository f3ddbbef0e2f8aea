"""What is known of each choice of each spacecraft, one row a choice: networks that judge choices one by one read it.

Places and directions are left out: what they mean for a choice is in its worth, and nothing of the forty missions of training
can be learnt by heart.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.typing import Array32

from .tables import GENERAL, PAIRS, SPACECRAFT

#: Columns of the tables that a row holds; those of the spacecraft stand twice, of whom chooses and of whom it would relay to.
OF_SPACECRAFT = (
    *("alive", "camera", "downlink", "imaging", "relaying", "talking", "holding", "link", "stored", "earth_in_sight"),
    *("attitude_error", "rate", "in_reach", "in_reach_next"),
)
OF_GENERAL = ("time_left", "seen", "delivered", "alive", "half_width", "picture", "turn", "heard")
#: What sort of choice it is, one of them 1.
KINDS = ("patch", "earth", "relay")
OF_PATCH = 2
#: Numbers of a row.
SIZE = 2 * len(OF_SPACECRAFT) + len(OF_GENERAL) + len(KINDS) + len(PAIRS) + OF_PATCH

#: Where they stand in the tables.
SPACECRAFT_COLUMNS = [SPACECRAFT.index(name) for name in OF_SPACECRAFT]
GENERAL_COLUMNS = [GENERAL.index(name) for name in OF_GENERAL]


def choice_rows(observed: Mapping[str, NDArray[Any]]) -> Array32:
    """What is known of every choice, shape (E, n, C, `SIZE`); zero what does not belong to a choice of its kind.

    Args:
        observed: Tables of E episodes by name, as the observation `entities` has them.
    """
    spacecraft, pairs = observed["spacecraft"][:, :, SPACECRAFT_COLUMNS], observed["pairs"]
    E, n, K, width = pairs.shape
    out = np.zeros((E, n, K + 1 + n, SIZE), np.float32)
    each = spacecraft.shape[2]
    own, general, kind, to, pair = np.cumsum([0, each, len(OF_GENERAL), len(KINDS), each])
    out[..., own:general] = spacecraft[:, :, None]
    out[..., general:kind] = observed["general"][:, None, None, GENERAL_COLUMNS]
    out[:, :, :K, kind] = out[:, :, K, kind + 1] = out[:, :, K + 1 :, kind + 2] = 1.0
    # To relay to oneself is to hold: nobody else is concerned.
    others = ~np.eye(n, dtype=np.bool_)[None, :, :, None]
    out[:, :, K + 1 :, to:pair] = np.where(others, spacecraft[:, None], 0.0)
    out[:, :, :K, pair : pair + width] = pairs
    out[:, :, :K, pair + width :] = observed["patches"][:, None, :, :OF_PATCH]
    return out
