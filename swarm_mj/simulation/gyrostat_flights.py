"""Many flights of a swarm of gyrostats: bit for bit what `Simulation` flies, whole stretches of each in compiled code.

`mujoco.batch.Batch` steps by `mj_step`, which gyrostats cannot use (see `simulation.gyrostat`): so each flight has an MjData of
its own, and is flown as far as it goes before the next one is: its data stays in the processor's cache.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarm_mj.attitude.controllers.base import Controller
from swarm_mj.mission.behaviors import Behavior
from swarm_mj.simulation import batch_kernels
from swarm_mj.simulation.batch import BatchFlights
from swarm_mj.simulation.batch_kernels import Free
from swarm_mj.simulation.native import load_mujoco
from swarm_mj.simulation.simulation import InitialState, Simulation
from swarm_mj.spacecraft.model import NQ, NV

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class GyrostatFlights(BatchFlights):
    """E flights of one swarm whose wheels are momentum states; see `BatchFlights`.

    `qpos` and `qvel` are laid out as if the wheels were joints, as `SwarmModel.state` gives them.
    """

    def __init__(
        self,
        simulation: Simulation,
        count: int,
        controller: Controller | None,
        behaviors: Sequence[Behavior] | None = None,
    ) -> None:
        load_mujoco()
        model = simulation.model.mjmodel
        self._datas = [mujoco.MjData(model) for _ in range(count)]
        super().__init__(simulation, count, controller, behaviors)
        self._timestep = float(model.opt.timestep)
        self._one = np.eye(count, dtype=np.bool_)
        limits = np.ascontiguousarray(model.actuator_ctrlrange)
        mocap = simulation.model.asteroid_mocap
        self._parts: list[tuple[Any, ...]] = []
        for e, data in enumerate(self._datas):
            fields = self.qpos[e], self.qvel[e], self.ctrl[e], data.xfrc_applied, data.mocap_quat[mocap]
            free = Free(
                data.qpos,
                data.qvel,
                data.act,
                data.qacc_smooth,
                data.qfrc_bias,
                data.qfrc_applied,
                limits,
                np.zeros((4, model.nv)),
                np.zeros(model.nq),
            )
            self._parts.append((fields, free, model._address, data._address))

    def _bind(self) -> tuple[Array, dict[str, Array]]:
        first, n, count = self._datas[0], self.n, self.count
        bound = {"qpos": np.zeros((count, NQ * n)), "qvel": np.zeros((count, NV * n)), "ctrl": np.zeros((count, 3 * n))}
        # The kernels are given the fields themselves; these two only keep their places.
        bound |= {name: getattr(first, name).reshape(1, -1) for name in ("xfrc_applied", "mocap_quat")}
        return np.zeros((1, 1)), bound

    def _clear(self, e: int) -> None:
        mujoco.mj_resetData(self.model.mjmodel, self._datas[e])
        self.ctrl[e] = 0.0

    def reset(self, e: int, initial: InitialState) -> None:
        """See `BatchFlights.reset`."""
        super().reset(e, initial)
        self._write(e)

    def park(self, e: int, j: int) -> None:
        """See `BatchFlights.park`."""
        super().park(e, j)
        self._write(e)

    def _write(self, e: int) -> None:
        """Take over the state from the layout with wheels, and lay it out again, as rounding leaves it."""
        self.model.set_state(self._datas[e], self._q[e], self._v[e])
        self._q[e], self._v[e] = self.model.state(self._datas[e])

    def _call(self, live: Mask) -> int:
        return max((self._fly_one(e, 0) for e in np.flatnonzero(live).tolist()), default=batch_kernels.FINE)

    def _fly_one(self, e: int, periods: int) -> int:
        arguments = (self._world, self._flights, e, *self._parts[e], self._held, self._hold, self._timestep, periods)
        return int(batch_kernels.fly_gyrostats(*arguments))

    def fly(self, periods: int, live: Mask) -> bool:
        """See `BatchFlights.fly`."""
        fine = True
        for e in np.flatnonzero(live).tolist():
            left = periods
            while left and self.finite[e]:
                stretch = left
                if self._behaviors is not None:
                    self._ask_behaviors(self._one[e])
                    stretch = min(left, int(self._ask_at[e] - self.tick[e]))
                fine &= self._judge(self._fly_one(e, stretch), self._one[e])
                left -= stretch
        return fine

    def advance(self, live: Mask | None) -> None:
        """See `BatchFlights.advance`."""
        for e in range(self.count) if live is None else np.flatnonzero(live).tolist():
            batch_kernels.hold_gyrostats(self._world, *self._parts[e], self._hold, self._timestep)
            self.tick[e] += 1
