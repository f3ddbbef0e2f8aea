"""The force law that flies planned burns: full thrust about the planned instant, until the velocity has been gained."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarm_mj.mission.finite_burns import Push, windows_of
from swarm_mj.mission.trajectories import PlannedBurn
from swarm_mj.spacecraft.control.force import ForceView
from swarm_mj.spacecraft.thrusters import Allocation, Thrusters
from swarm_mj.typing import Array

#: How long before a burn spacecraft turn whose nozzles do not push in every direction [s]: wheels of 15 mN m s turn a 3U
#: CubeSat over in some 40 s, and the control law settles in as many.
TURN_S = 120.0
#: A burn is over when so much of it is left [m/s], or when it has taken so many times as long as planned.
DONE_M_S, TOO_LONG = 1e-9, 2.0


class PlannedBurns:
    """Flies planned burns, each centred at its instant.

    The thrust is the greatest that the nozzles give in every direction (or along their axis, if they must be turned). A burn
    goes on until the accelerometers say that its velocity has been gained, so that mass, pulses and errors of direction do not
    matter. Burns of one spacecraft follow each other.

    Args:
        burns: What is planned.
        thrusters: By which it is flown.
        allocation: Of their nozzles.
        mass: At the start, shape (n,) [kg].
    """

    def __init__(self, burns: Sequence[PlannedBurn], thrusters: Thrusters, allocation: Allocation, mass: Array) -> None:
        self.force = thrusters.thrust * allocation.strength
        self._n = len(mass)
        push = Push(self.force, thrusters.exhaust_speed, float(np.max(mass)), thrusters.propellant)
        self.windows = windows_of(burns, push, mass)

    def forces(self, view: ForceView, memory: tuple[Array, Array] | None) -> tuple[Array, tuple[Array, Array]]:
        """Full thrust for those whose burn it is, see `ForceLaw`; remembers burns done and velocities at their start."""
        done, before = (np.zeros(self._n, int), np.zeros((self._n, 3))) if memory is None else memory
        done, before = done.copy(), before.copy()
        wish = np.zeros((self._n, 3))
        for j in range(self._n):
            while done[j] < len(self.windows[j]) and view.t + view.period > self.windows[j][done[j]].start:
                window = self.windows[j][done[j]]
                left_N = window.burn.delta_v_N - (view.delta_v_N[j] - before[j])
                left = float(np.linalg.norm(left_N))
                late = view.t > window.start + TOO_LONG * window.duration + view.period
                if left > DONE_M_S and not late:
                    share = min(1.0, (view.t + view.period - window.start) / view.period)
                    wish[j] = left_N / left * min(share * self.force, left * view.mass[j] / view.period)
                    break
                done[j] += 1
                before[j] = view.delta_v_N[j]
        return wish, (done, before)

    def directions(self, t: float) -> Array:
        """Directions of the burns under way or due within `TURN_S`, shape (n, 3)."""
        found = np.zeros((self._n, 3))
        for j, windows in enumerate(self.windows):
            for burn, start, duration, _ in windows:
                if start - TURN_S <= t <= start + duration:
                    found[j] = burn.delta_v_N / np.linalg.norm(burn.delta_v_N)
                    break
        return found
