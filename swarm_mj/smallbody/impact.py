"""Impact on the body, and on its companion, found at the control period in which it happens.

The path within one period is taken as straight. Most periods are not tested at all: from the clearance to the nearest vertex
and the speed follows for how long nothing can be hit.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from swarm_mj.smallbody.companion import Companion
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.occultation import segments_blocked
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.solid_angle import points_inside
from swarm_mj.typing import Array, Mask

#: Speeds and accelerations are taken this much larger than they are, for what gravity changes on the way.
_CAUTION = 2.0


class ImpactWatch:
    """Looks for impacts of one flight.

    Args:
        shape: The body.
        environment: Its rotation.
        period: Time between two looks [s].
    """

    def __init__(self, shape: ShapeModel, environment: Environment | Companion, period: float) -> None:
        self._shape, self._environment, self._period = shape, environment, period
        self.reset()

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._shape.vertices)

    def reset(self) -> None:
        """Begin a flight."""
        self._before: Array | None = None
        self.due = 0

    def look(self, tick: int, r_BN_N: Array, v_BN_N: Array, a_N: Array, flying: Mask) -> Mask:
        """Which spacecraft hit the body in the period that ends now; to be called when `tick` has reached `due`.

        Args:
            tick: Control periods flown.
            r_BN_N: Positions now, shape (n, 3) [m].
            v_BN_N: Velocities, shape (n, 3) [m/s].
            a_N: Accelerations, shape (n, 3) [m/s^2].
            flying: Which spacecraft are to be looked at, shape (n,); the answer has that shape.
        """
        shape = self._shape
        r_A = r_BN_N @ self._environment.C_AN(tick * self._period).T
        hit = np.zeros(len(r_A), np.bool_)
        if not flying.any():
            self.due = tick + 1_000_000
            return hit
        if self._before is None:
            hit[flying] = points_inside(np.ascontiguousarray(r_A[flying]), shape.vertices, shape.faces)
        else:
            start = np.ascontiguousarray(self._before[flying])
            hit[flying] = segments_blocked(start, r_A[flying], shape.vertices, shape.faces, shape.max_radius)
        safe = self._safe_periods(r_A[flying], v_BN_N[flying], a_N[flying])
        self.due = tick + max(1, safe)
        # A leg of several periods is only left out where nothing can be hit; the next one starts where this one ends.
        self._before = r_A
        return hit

    def _safe_periods(self, r_A: Array, v_N: Array, a_N: Array) -> int:
        """For how many periods no spacecraft can touch the surface."""
        outside = np.linalg.norm(r_A, axis=1) - self._shape.max_radius
        near, _ = self._tree.query(r_A)
        clearance = np.maximum(outside, near - self._shape.vertex_reach)
        carried = abs(self._environment.spin_rate) * np.linalg.norm(r_A, axis=1)
        v, a = _CAUTION * (np.linalg.norm(v_N, axis=1) + carried), _CAUTION * np.linalg.norm(a_N, axis=1)
        # c = v t + a t^2 / 2, solved without cancellation.
        c = np.maximum(clearance, 0.0)
        safe_s = np.where(c > 0.0, 2.0 * c / (v + np.sqrt(v * v + 2.0 * a * c) + 1e-12), 0.0)
        return int(min(np.fmin.reduce(safe_s, initial=np.inf) / self._period, 1e6))


class CompanionWatch(ImpactWatch):
    """The same for the companion of the body, which moves.

    Args:
        companion: What may be hit.
        period: Time between two looks [s].
    """

    def __init__(self, companion: Companion, period: float) -> None:
        super().__init__(companion.shape, companion, period)
        self._companion = companion

    def look(self, tick: int, r_BN_N: Array, v_BN_N: Array, a_N: Array, flying: Mask) -> Mask:
        """See `ImpactWatch.look`; positions and velocities are relative to the body, not the companion."""
        t, h = tick * self._period, self._period
        (r, v), (_, later) = self._companion.path.state(t), self._companion.path.state(t + h)
        return super().look(tick, r_BN_N - r, v_BN_N - v, a_N - (later - v) / h, flying)
