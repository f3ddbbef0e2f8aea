"""What one spacecraft of a swarm observes and decides: its share of the observation and of the action of all."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.typing import Array, Array32

from .observations import ObservationLayout

#: Scale of the positions of the others relative to one's own [m], and their bound after scaling.
NEIGHBOUR_SCALE_M, NEIGHBOUR_BOUND = 10_000.0, 10.0


def local_observation(own: Array32, r_A: Array, others_A: Array, facts: Array, tail: NDArray[Any]) -> Array32:
    """What a spacecraft observes, of any number of flights.

    Args:
        own: Its block of the observation of all, shape (..., features).
        r_A: Its position in A, shape (..., 3) [m].
        others_A: Those of the m others, shape (..., m, 3) [m].
        facts: What it knows of them, shape (..., m, f).
        tail: What all share, shape (..., t).

    Returns:
        Shape (..., features + m (3 + f) + t).
    """
    away = np.clip((others_A - r_A[..., None, :]) / NEIGHBOUR_SCALE_M, -NEIGHBOUR_BOUND, NEIGHBOUR_BOUND)
    neighbours = np.concatenate([away, facts], axis=-1)
    told = neighbours.reshape(*neighbours.shape[:-2], -1)
    return np.concatenate([own, told, tail], axis=-1).astype(np.float32)


def action_part(whole: spaces.Space[Any], j: int, n: int) -> spaces.Space[Any]:
    """One spacecraft's share of an action space."""
    if isinstance(whole, spaces.MultiDiscrete):
        return spaces.Discrete(int(whole.nvec[j]))
    assert isinstance(whole, spaces.Box)
    return spaces.Box(-1.0, 1.0, (whole.shape[0] // n,), np.float32)


def local_space(layout: ObservationLayout, n: int) -> spaces.Box:
    """Of what one of n spacecraft observes."""
    whole, features = layout.space, layout.features
    bound = np.array([NEIGHBOUR_BOUND] * 3 + [10.0, 1.0, 1.0], np.float32)
    low = np.array([-NEIGHBOUR_BOUND] * 3 + [0.0, 0.0, 0.0], np.float32)
    parts = [slice(0, features), slice(features * n, None)]
    return spaces.Box(
        np.concatenate([whole.low[parts[0]], np.tile(low, n - 1), whole.low[parts[1]]]),
        np.concatenate([whole.high[parts[0]], np.tile(bound, n - 1), whole.high[parts[1]]]),
        dtype=np.float32,
    )
