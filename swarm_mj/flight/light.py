"""Which cells of a target the Sun lights at any of some instants, as pictures are judged: incidence and cast shadows."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.capture import lit
from swarm_mj.observation.companion import Screen
from swarm_mj.observation.raycast import RayTracer
from swarm_mj.smallbody.environment import LinearMotion
from swarm_mj.typing import Array, Mask


class Turning(Protocol):
    """How the body turns beneath the Sun; an `EpochState` or an `Environment`."""

    @property
    def sun(self) -> LinearMotion:
        """Of the Sun relative to the body."""

    def C_AN(self, t: float) -> Array:
        """Rotation from N to A at a time past the epoch [s], shape (3, 3)."""


def lit_sometime(
    region: TargetRegion,
    around: Turning,
    times_s: Array,
    max_incidence_deg: float,
    *,
    tracer: RayTracer | None,
    among: Mask | None = None,
    screen: Screen | None = None,
) -> Mask:
    """Cells that are lit at one of some instants at least, see `lit`, shape (n,).

    Args:
        region: The target.
        around: How the body turns beneath the Sun.
        times_s: Past the epoch [s].
        max_incidence_deg: Of `lit`.
        tracer: Of `lit`.
        among: Cells that are asked about, shape (n,); the others count as never lit. None: all.
        screen: The companion, where shadows are traced; None: there is none.
    """
    left = np.ones(region.n_cells, np.bool_) if among is None else among.copy()
    found = np.zeros(region.n_cells, np.bool_)
    for t in times_s:
        now = lit(
            region,
            around.C_AN(t) @ around.sun.at(t),
            max_incidence_deg=max_incidence_deg,
            tracer=tracer,
            among=left,
            shade=None if screen is None else screen.at(t),
        )
        found |= now
        left &= ~now
        if not left.any():
            break
    return found
