"""Many flights of one swarm at once: what `CompiledBatch` and `PythonBatch` have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from swarm_mj.mission.behaviors import Targets
from swarm_mj.simulator.fast.flights import allocate_flights
from swarm_mj.simulator.loop_state import InitialState, LoopState
from swarm_mj.simulator.slots import Slot
from swarm_mj.typing import Array, Mask

#: Where lost spacecraft stand, times their number [m].
PARKED = 1e7


class Batch(ABC):
    """E flights of one swarm of n spacecraft with w wheels, decided and advanced together.

    A flight whose state is no longer finite is marked in `finite` and stands still until it is reset; the others fly on.

    Args:
        like: One such flight; model, environment and control period are taken from it.
        count: Number of flights E.

    Attributes:
        model: The compiled swarm.
        environment: Gravity, rotation, Sun and Earth.
        period: Control period [s].
        n: Number of spacecraft.
        count: Number of flights E.
        tick: Control periods flown, shape (E,).
        kind: `TargetKind` values, shape (E, n).
        index: Spacecraft to follow, shape (E, n).
        vector: Surface point in A [m] or direction in N, shape (E, n, 3).
        torque_B: Torques on the bodies, given where they are held, shape (E, n, 3) [N m].
        sigma_BR: Attitude errors at the last decision, shape (E, n, 3).
        effort: Sum of the squares of all motor torques since the caller last set it to zero, shape (E,) [N^2 m^2].
        lost: Spacecraft lost to faults, shape (E, n).
        blind: Spacecraft whose camera is off or that are lost, shape (E, n).
        finite: False where the flight has diverged, shape (E,).
        causes: Why, by flight.
        senses: Whether sensors may be imperfect, so that `know` may give something else than the truth.
    """

    senses = True

    def __init__(self, like: LoopState, count: int) -> None:
        self.model, self.environment, self.period = like.model, like.environment, like.period
        self.n, self.count = self.model.n, count
        self._flights = f = allocate_flights(count, self.n, self.model.properties.n_wheels)
        self.kind, self.index, self.vector, self.torque_B = f.kind, f.spacecraft, f.vector, f.torque_B
        self.tick, self.finite, self.effort = f.tick, f.finite, f.effort
        self.sigma_BR: Array = f.work[:, Slot.SIGMA_BR]
        self.lost, self.blind = np.zeros((count, self.n), np.bool_), np.zeros((count, self.n), np.bool_)
        self.causes = [""] * count

    @abstractmethod
    def rows(self, e: int) -> tuple[Array, Array]:
        """The state of one flight by spacecraft, shape (n, 7 + w) and (n, 6 + w); see `SwarmModel.state`."""

    @abstractmethod
    def place(self, e: int, qpos: Array, qvel: Array) -> None:
        """Put one flight into a state, as `rows` gives it; its behaviour is asked again."""

    @property
    @abstractmethod
    def ctrl(self) -> Array:
        """Motor torques of the coming hold, a copy, shape (E, n w) [N m]."""

    def park(self, e: int, *which: int) -> None:
        """Put spacecraft that are no more where they disturb nothing: far out, at rest."""
        qpos, qvel = (part.copy() for part in self.rows(e))
        for j in which:
            qpos[j, :3], qvel[j] = (PARKED * (1.0 + j), 0.0, 0.0), 0.0
        self.place(e, qpos, qvel)

    def reset(self, e: int, initial: InitialState) -> None:
        """Put one flight at its start and forget everything about it."""
        self._start(e, initial)
        self._forget(e)

    def rewind(self, e: int, initial: InitialState) -> None:
        """Put one flight that has decided, but not flown, back to the start that it was reset to."""
        self.reset(e, initial)

    def _forget(self, e: int) -> None:
        f = self._flights
        f.tick[e], f.finite[e], f.effort[e], f.peaks[e], self.causes[e] = 0, True, 0.0, 0.0, ""
        f.last_kind[e], f.last_spacecraft[e] = -1, -1

    @abstractmethod
    def _start(self, e: int, initial: InitialState) -> None:
        """Put one flight at its start."""

    def get_state(self, e: int) -> dict[str, Any]:
        """All that one flight is between two control periods, copied; for `set_state` of any batch of the same swarm.

        Raises:
            SimulationError: Something flies whose state cannot be taken; the message names it.
        """
        rows = [array[e].copy() for array in (*self._flights, self.lost, self.blind)]
        return {"rows": rows, "cause": self.causes[e], "own": self._own_state(e)}

    def set_state(self, e: int, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave: bit for bit as the flight that went on from there."""
        self._take_own_state(e, state["own"])
        for array, row in zip((*self._flights, self.lost, self.blind), state["rows"], strict=True):
            array[e] = row
        self.causes[e] = state["cause"]

    @abstractmethod
    def _own_state(self, e: int) -> Any:
        """What a kind of batch has of one flight besides the arrays here."""

    @abstractmethod
    def _take_own_state(self, e: int, state: Any) -> None:
        """Go on from what `_own_state` gave."""

    @abstractmethod
    def read(self, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
        """Copy positions and velocities in N [m, m/s], attitudes, body rates and wheel speeds [rad/s], shape (E, n, ...)."""

    @abstractmethod
    def know(self, live: Mask, q: Array, omega: Array) -> Mask:
        """Put what the flight software has of attitudes and rates in the place of the truth, where sensors are not perfect.

        Args:
            live: Which flights, shape (E,); their states must be finite.
            q: Attitudes q_BN, shape (E, n, 4).
            omega: Body rates, shape (E, n, 3) [rad/s].

        Returns:
            Flights whose sensors are not perfect, shape (E,).
        """

    @abstractmethod
    def hold(self, targets: Targets | None, torque_B: Array | None) -> None:
        """Let targets, shape (E, n, ...), and torques [N m], shape (E, n, 3), hold where no behaviour and no law decides.

        Behaviours, where there are any, are asked again, because they have been told something new.
        """

    @abstractmethod
    def decide(self, live: Mask) -> bool:
        """Set forces and motor torques of the coming hold.

        Args:
            live: Which flights, shape (E,).

        Returns:
            Whether all of them are finite.

        Raises:
            PluginError: A behaviour or control law fails, or a behaviour aims at what is not there.
        """

    @abstractmethod
    def advance(self, live: Mask | None) -> None:
        """Let MuJoCo integrate one control period of the live flights, None for all, with everything held."""

    @abstractmethod
    def fly(self, periods: int, live: Mask) -> bool:
        """Decide and advance so many control periods of the live flights; one that is not finite stops.

        Returns:
            Whether all of them are finite.
        """
