"""E episodes of `SwarmPointing-v0` at once, each a spacecraft by itself: what all its environments stand on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import SimulationError
from swarm_mj.observation.thumbnails import Thumbnails
from swarm_mj.simulator.slots import Slot
from swarm_mj.spacecraft.attitude.guidance import pointing_error
from swarm_mj.typing import Array, Ints, Mask

from ..observe.actions import body_torques
from ..pixels import IMAGE_SPACE, Poses
from .config import WEIGHTS
from .task import PointingTask
from .view import assess, no_state, write_views


class PointingBatch:
    """E episodes flown in one thread.

    Args:
        task: What they share.
        count: Number of episodes E.

    Attributes:
        task: What they share.
        count: Number of episodes E.
        flights: The simulation, a swarm of one in each flight.
        state: What the episodes remember.
        spacecraft: Which of the swarm flies, shape (E,).
        kind: `TargetKind` of the references, shape (E, H).
        vector: Their surface points in A [m] or directions in N, shape (E, H, 3).
        observation: The numbers of every episode, shape (E, F).
        image: What the cameras see where that is observed, shape (E, 3, S, S); else of none.
    """

    def __init__(self, task: PointingTask, count: int) -> None:
        self.task, self.count = task, count
        self.flights = task.flights(count)
        holds = task.config.holds
        self.state = no_state(count, holds)
        self.spacecraft = np.zeros(count, np.int64)
        self.observation = np.zeros((count, *task.layout.space.shape), np.float32)
        self.image = np.zeros((count if task.layout.camera else 0, *IMAGE_SPACE.shape), np.uint8)
        self._start = np.zeros(count, np.int64)
        self.kind: Ints = np.zeros((count, holds), np.int64)
        self.vector: Array = np.zeros((count, holds, 3))
        self._constants, self._axes = task.constants, task.plan.properties.wheel_axes_B
        self._torque_B = np.zeros((count, 1, 3))

    @property
    def time_s(self) -> Array:
        """Seconds past the epoch, shape (E,)."""
        return np.asarray(self.flights.tick * self.flights.period, np.float64)

    @property
    def success(self) -> Mask:
        """Whether every reference so far has been held for long enough, shape (E,)."""
        return np.asarray(self.state.held.all(axis=1))

    def reset(self, e: int, seed: int, spacecraft: int | None = None) -> None:
        """Start episode e anew, see `PointingTask.draw`."""
        draw, live = self.task.draw(seed, spacecraft), np.arange(self.count) == e
        self.flights.reset(e, draw.initial)
        self.flights.tick[e] = self._start[e] = draw.tick
        self.spacecraft[e] = draw.spacecraft
        self.kind[e], self.vector[e], self._torque_B[e] = draw.kind, draw.vector, 0.0
        for array in self.state:
            array[e] = 0
        self._aim(live)
        self._look(live)
        self.state.error[e] = self._errors()[e]

    def step(self, actions: NDArray[Any], live: Mask | None = None) -> None:
        """Fly on for one step with the motors' torques held; `state` has what came of it.

        Args:
            actions: Motor torques over their limit, shape (E, 3).
            live: Episodes to go on with, shape (E,); None for all.
        """
        live = np.ones(self.count, np.bool_) if live is None else live
        limit = self.task.plan.properties.max_wheel_torque
        torque_B = body_torques(limit * np.asarray(actions, np.float64)[:, None], self._axes)
        self._torque_B[live] = torque_B[live]
        self.flights.effort[:] = 0.0
        self.flights.hold(None, self._torque_B)
        self.flights.fly(self.task.ticks, live)
        effort = self.flights.effort.copy()
        self._decide(live)
        assess(self._constants, self._errors(), self.flights.work, effort, live, self.state)
        hold = self._constants.hold_steps
        switching = live & (self.state.step % hold == 0) & (self.state.step < self._constants.steps)
        if switching.any():
            self.state.steady[switching] = 0
            self._aim(switching)
        self._look(live)

    def pictures(self, chosen: Mask) -> Thumbnails:
        """What the cameras of some episodes see now, shape (E,)."""
        at, flights = np.flatnonzero(chosen), self.flights
        r_N, q_BN, C_AN = flights.work[at, Slot.R, 0], flights.q_BN[at, 0], flights.C_AN[at]
        return self.task.pictures.draw(Poses(r_N, q_BN, C_AN, self.time_s[at]))

    def observed(self) -> Any:
        """The observations of all episodes, copied: the numbers, with pixels a dict of both."""
        if not self.task.layout.camera:
            return self.observation.copy()
        return {"image": self.image.copy(), "state": self.observation.copy()}

    def over(self) -> Mask:
        """Which episodes have come to their end, shape (E,)."""
        return np.asarray(self.state.step >= self._constants.steps)

    def info(self, e: int) -> dict[str, Any]:
        """What every step tells of episode e."""
        state = self.state
        steps = int(state.step[e])
        return {
            "time_s": float(self.time_s[e]),
            "spacecraft": int(self.spacecraft[e]) + 1,
            "error_deg": float(np.degrees(state.error[e])),
            "on_target": float(state.on_target[e]) / steps if steps else 0.0,
            "held": int(state.held[e].sum()),
            "success": bool(state.held[e].all()),
        }

    def terms(self, e: int) -> dict[str, float]:
        """Weighted reward terms of the last step by name."""
        return dict(zip(WEIGHTS, self.state.terms[e].tolist(), strict=True))

    def get_state(self, e: int) -> dict[str, Any]:
        """All that episode e is between two steps, copied, for `set_state` of any batch of the same task."""
        return {"rows": [array[e].copy() for array in self._remembered], "flight": self.flights.get_state(e)}

    def set_state(self, e: int, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave; bit for bit the episode that went on from there."""
        for array, row in zip(self._remembered, state["rows"], strict=True):
            array[e] = row
        self.flights.set_state(e, state["flight"])

    @property
    def _remembered(self) -> list[NDArray[Any]]:
        own: list[NDArray[Any]] = [
            self.spacecraft,
            self.observation,
            self._start,
            self.kind,
            self.vector,
            self._torque_B,
        ]
        return [*list(self.state), *own, *([self.image] if self.task.layout.camera else [])]

    def _aim(self, live: Mask) -> None:
        """Turn guidance to the present references of some episodes."""
        flights, last = self.flights, self.kind.shape[1] - 1
        at = np.minimum(self.state.step // self._constants.hold_steps, last)
        for e in np.flatnonzero(live):
            flights.kind[e], flights.index[e] = self.kind[e, at[e]], 0
            flights.vector[e] = self.vector[e, at[e]]
        self._decide(live)

    def _decide(self, live: Mask) -> None:
        if not self.flights.decide(live):
            raise SimulationError("; ".join(cause for cause in self.flights.causes if cause))

    def _look(self, live: Mask) -> None:
        camera = self.task.layout.camera
        write_views(self._constants, self.flights.work, live, self.state, camera, self.observation)
        if camera and live.any():
            self.image[live] = self.task.pictures.images(self.pictures(live))

    def _errors(self) -> Array:
        """Angle between +z and the target at the last decision [rad], shape (E,)."""
        return np.asarray(pointing_error(self.flights.q_BN[:, 0], self.flights.line_of_sight_N[:, 0]))
