"""How a spacecraft returns to its place: proportional and derivative feedback that brakes in time, dead band, pulses.

With position error e, rate error e', bandwidth w and damping z the wished acceleration is

    a = a_path - g(x) - 2 z w (e' + u(e)),    u(e) = e min(w / (2 z), sqrt(a_max / |e|)),

which near the path is e'' + 2 z w e' + w^2 e = 0. Far from it the speed of return u is one from which half of a_max stops in
time (v^2 = a_max d), so that limited thrust leads to no overshoot. What thrust cannot give is cut, its direction kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarm_mj.errors import ScenarioError, at_most
from swarm_mj.typing import Array, Mask

#: Held for a period T, feedback of this bandwidth is still as damped as it says: w T at most.
MOST_BANDWIDTH_PERIODS = 0.5
#: Share of the dead band at which thrusters shut again.
INNER = 1.0 / 3.0


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """The feedback's numbers."""

    bandwidth: float  #: natural frequency of small errors [rad/s]
    damping: float  #: damping ratio [-]
    dead_band: float  #: error up to which nothing is done [m]; 0: none

    def check_period(self, period: float) -> None:
        """See that a control period is short against the bandwidth, and against the rate gain.

        Raises:
            ScenarioError: It is not.
        """
        most = MOST_BANDWIDTH_PERIODS / period / max(1.0, 2.0 * self.damping)
        if self.bandwidth > most:
            raise ScenarioError(
                f"swarm.formation.bandwidth_rad_s = {self.bandwidth:g}: must be at most {at_most(most, 4)} with "
                f"control.period_s = {period:g} and damping = {self.damping:g}, or the loop oscillates"
            )

    def feedback(self, error: Array, rate: Array, most: Array) -> Array:
        """Acceleration against errors of position and velocity, without the path's own, shape (n, 3) [m/s^2].

        Args:
            error: Place less where it should be, shape (n, 3) [m].
            rate: The same of the velocity, shape (n, 3) [m/s].
            most: Acceleration that thrusters give, shape (n,) [m/s^2].
        """
        size = np.linalg.norm(error, axis=1)
        slope = np.full(len(error), self.bandwidth / (2.0 * self.damping))
        far = most < slope**2 * size
        slope[far] = np.sqrt(most[far] / size[far])
        return -2.0 * self.damping * self.bandwidth * (rate + slope[:, None] * error)

    def at_work(self, error: Array, rate: Array, before: Mask) -> Mask:
        """Who is outside its dead band, or was and is not yet well inside, shape (n,)."""
        if self.dead_band == 0.0:
            return np.ones(len(error), np.bool_)
        size, speed = np.linalg.norm(error, axis=1), np.linalg.norm(rate, axis=1)
        inner = INNER * self.dead_band
        slow = self.bandwidth / (2.0 * self.damping) * INNER * inner
        settled = (size < inner) & (speed < slow)
        return np.asarray((size > self.dead_band) | (before & ~settled))


def cut(wish: Array, most: Array) -> Array:
    """Vectors no longer than allowed, directions kept, shape (n, 3)."""
    size = np.linalg.norm(wish, axis=1)
    share = np.divide(most, size, out=np.ones_like(size), where=size > most)
    return np.asarray(wish * share[:, None])


def in_pulses(change: Array, owed: Array, least: Array) -> tuple[Array, Array]:
    """Keep changes of velocity back that are too small for a pulse, until they are a pulse together.

    Args:
        change: Wished for a period, shape (n, 3) [m/s].
        owed: Wished before and not gained, by the accelerometers; more than two pulses of it are forgotten, shape (n, 3) [m/s].
        least: Of a pulse, shape (n,) [m/s].

    Returns:
        What is asked for, and what that and whatever follows is to come to.
    """
    total = change + cut(owed, 2.0 * least)
    ready = np.linalg.norm(total, axis=1) >= least
    return np.where(ready[:, None], total, 0.0), total
