"""E episodes of `SwarmPointing-v0` at once, each a spacecraft by itself: what all its environments stand on."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.observation.thumbnails import Thumbnails
from swarm_mj.simulator.slots import Slot
from swarm_mj.typing import Array, Ints, Mask, Pixels

from ..arguments import checked_whole, flight_seeds, refuse_more_than_fit
from ..batch_env import StepOutcome
from ..pixels import IMAGE_SPACE, Poses
from .flights import PointingFlights
from .steps import assess, no_state, observe
from .task import PointingTask

#: What an episode takes in memory, measured, upper estimates: of its own, and for each cell of the target [B].
EPISODE_BYTES, CELL_BYTES = 20 * 1024, 17
#: Pixels of a rendered picture for each of the camera's.
ZOOM = 6


class PointingBatch:
    """As many episodes E of one task as `count` says, flown in one thread, see `swarm_mj.envs.batch_env`.

    Attributes:
        flights: The simulation, a swarm of one in each flight.
        state: What the episodes remember.
        spacecraft: Which of the swarm flies, shape (E,).
        kind: `TargetKind` of the references, shape (E, H).
        vector: Their surface points in A [m] or directions in N, shape (E, H, 3).
        numbers: That are observed of every episode, shape (E, F).
        image: What the cameras see where that is observed, shape (E, 3, S, S); else of none.
    """

    def __init__(self, task: PointingTask, count: int) -> None:
        refuse_more_than_fit(count, EPISODE_BYTES + task.plan.region.n_cells * CELL_BYTES)
        self.task, self.count = task, count
        self.flights = PointingFlights(task.setup, count)
        holds = task.config.holds
        self.state = no_state(count, holds)
        self.spacecraft = np.zeros(count, np.int64)
        self.numbers = np.zeros((count, *task.layout.space.shape), np.float32)
        self.image = np.zeros((count if task.layout.camera else 0, *IMAGE_SPACE.shape), np.uint8)
        self.kind: Ints = np.zeros((count, holds), np.int64)
        self.vector: Array = np.zeros((count, holds, 3))
        self._constants, self._axes = task.constants, task.plan.properties.wheel_axes_B
        self._torque_B = np.zeros((count, 1, 3))

    @property
    def time_s(self) -> Array:
        """Seconds past the epoch, shape (E,)."""
        return np.asarray(self.flights.flights.tick * self.flights.period, np.float64)

    @property
    def success(self) -> Mask:
        """Whether every reference so far has been held for long enough, shape (E,)."""
        return np.asarray(self.state.held.all(axis=1))

    def reset(self, flights: dict[int, int], spacecraft: Any = None) -> None:
        """Start episodes anew, see `PointingTask.draw`.

        Args:
            flights: Their flight seeds, by number of the episode.
            spacecraft: Which of the swarm flies, from 1, in all or a list with one for each of the E episodes; None: any.

        Raises:
            ScenarioError: There is no such spacecraft.
        """
        wanted = [checked_spacecraft(j, self.task) for j in flight_seeds(spacecraft, self.count)]
        for e, seed in flights.items():
            draw = self.task.draw(seed, wanted[e])
            self.flights.reset(e, draw.initial)
            self.flights.flights.tick[e] = draw.tick
            self.spacecraft[e], self.kind[e], self.vector[e] = draw.spacecraft, draw.kind, draw.vector
            self._torque_B[e] = 0.0
            for array in self.state:
                array[e] = 0
        began = np.isin(np.arange(self.count), list(flights))
        self._aim(began)
        self._look(began)
        self.state.error[began] = self.flights.error[began]

    def step(self, actions: NDArray[Any], live: Mask | None = None) -> StepOutcome:
        """Fly on for a step with motor torques over their limit held, shape (E, 3).

        Only live episodes, shape (E,), go on; None: all.
        """
        live = np.ones(self.count, np.bool_) if live is None else live
        state, hold = self.state, self._constants.hold_steps
        limit = self.task.plan.properties.max_wheel_torque
        torque_B = body_torques(limit * np.asarray(actions, np.float64)[:, None], self._axes)
        self._torque_B[live] = torque_B[live]
        effort = self.flights.turn(self._torque_B, self.task.ticks, live)
        rate = np.linalg.norm(self.flights.reading(Slot.OMEGA_BR), axis=1)
        assess(self._constants, self.flights.error, rate, effort, live, state)
        switching = live & (state.step % hold == 0) & (state.step < self._constants.steps)
        if switching.any():
            state.steady[switching] = 0
            self._aim(switching)
        self._look(live)
        over = live & (state.step >= self._constants.steps)
        return StepOutcome(state.terms.copy(), state.reward.copy(), np.zeros(self.count, np.int64), over)

    def pictures(self, chosen: Mask) -> Thumbnails:
        """What the cameras of some episodes see now, shape (E,)."""
        at, flown = np.flatnonzero(chosen), self.flights.flights
        r_N, q_BN, C_AN = self.flights.reading(Slot.R)[at], flown.q_BN[at, 0], flown.C_AN[at]
        return self.task.pictures.draw(Poses(r_N, q_BN, C_AN, self.time_s[at]))

    @property
    def space(self) -> spaces.Space[Any]:
        """Of the observation of one episode."""
        return self.task.observation_space

    @property
    def observation(self) -> Any:
        """The observations of all episodes, copied: the numbers, with pixels a dict of both."""
        if not self.task.layout.camera:
            return self.numbers.copy()
        return {"image": self.image.copy(), "state": self.numbers.copy()}

    def infos(self) -> dict[str, NDArray[Any]]:
        """What every step tells of all episodes, each array with their number in front."""
        state = self.state
        return {
            "time_s": self.time_s,
            "spacecraft": self.spacecraft + 1,
            "error_deg": np.degrees(state.error),
            "on_target": state.on_target / np.maximum(state.step, 1),
            "held": state.held.sum(axis=1),
            "success": self.success,
        }

    def get_state(self, e: int) -> dict[str, Any]:
        """All that episode e is between two steps, copied, for `set_state` of any batch of the same task."""
        return {"rows": [array[e].copy() for array in self._remembered], "flight": self.flights.get_state(e)}

    def set_state(self, e: int, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave; bit for bit the episode that went on from there."""
        for array, row in zip(self._remembered, state["rows"], strict=True):
            array[e] = row
        self.flights.set_state(e, state["flight"])

    def close(self) -> None:
        """Nothing is held that has to be released."""

    @property
    def _remembered(self) -> list[NDArray[Any]]:
        own: list[NDArray[Any]] = [self.spacecraft, self.numbers, self.kind, self.vector, self._torque_B]
        return [*self.state, *own, *([self.image] if self.task.layout.camera else [])]

    def _aim(self, live: Mask) -> None:
        """Turn guidance to the present references of some episodes."""
        at = np.minimum(self.state.step // self._constants.hold_steps, self.kind.shape[1] - 1)
        for e in np.flatnonzero(live):
            self.flights.aim(int(e), int(self.kind[e, at[e]]), self.vector[e, at[e]])
        self.flights.guide(live)

    def _look(self, live: Mask) -> None:
        camera = self.task.layout.camera
        self.numbers[live] = observe(self._constants, self.flights, self.state, camera=camera)[live]
        if camera and live.any():
            self.image[live] = self.task.pictures.images(self.pictures(live))


def checked_spacecraft(given: Any, task: PointingTask) -> int | None:
    """The option `spacecraft`, counted from 1, as a number from 0.

    Raises:
        ScenarioError: There is no such spacecraft.
    """
    if given is None:
        return None
    must = f"a whole number from 1 to {task.plan.n}, or None for any"
    return checked_whole("reset option spacecraft", given, 1, task.plan.n, must) - 1


def crossed(batch: PointingBatch, e: int) -> Pixels:
    """What the camera of episode e sees, enlarged, with a cross in the middle."""
    grey = batch.pictures(np.arange(batch.count) == e).grey[0]
    picture = np.repeat((255.0 * np.kron(grey, np.ones((ZOOM, ZOOM)))).astype(np.uint8)[..., None], 3, axis=2)
    middle = len(picture) // 2
    near = slice(middle - 2 * ZOOM, middle + 2 * ZOOM)
    picture[middle, near] = picture[near, middle] = (255, 160, 0)
    return picture


def body_torques(motor: Array, axes_B: Array) -> Array:
    """Torques on the bodies [N m], shape (E, n, 3), of motor torques u on the wheels [N m], shape (E, n, w): L = -A^T u."""
    # Summed wheel by wheel: a product of matrices would round differently with their number.
    torque: Array = -sum(motor[:, :, w, None] * axes_B[w] for w in range(len(axes_B)))
    return torque
