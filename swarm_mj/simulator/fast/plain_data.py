"""The states of many flights: MjData, or, where nothing of MuJoCo steps them, plain arrays of a twentieth of the size.

An MjData takes half a megabyte with its Python binding, whatever the model. `physics.stepper: kernel` reads and writes a dozen
of its arrays and calls no function of MuJoCo, so that these arrays are enough; of an MjModel it reads the masses.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Any, TypeAlias

import mujoco
import numpy as np

from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.typing import Array

#: All that MuJoCo needs to go on bit for bit.
_WHOLE = mujoco.mjtState.mjSTATE_INTEGRATION


class PlainData:
    """The arrays of an MjData that the gyrostats' own stepper uses, under MuJoCo's names, in one block of numbers.

    Args:
        model: Whose state it is.
        numbers: Receives all of it, shape (`size(model)`,).

    Attributes:
        numbers: As given; the others are views of it.
    """

    def __init__(self, model: mujoco.MjModel, numbers: Array) -> None:
        self._model, self.numbers = model, numbers
        parts, start = {}, 0
        for name, shape in _shapes(model).items():
            length = int(np.prod(shape))
            parts[name] = numbers[start : start + length].reshape(shape)
            start += length
        self.qpos, self.qvel, self.act = parts["qpos"], parts["qvel"], parts["act"]
        self.qacc_smooth, self.qfrc_bias = parts["qacc_smooth"], parts["qfrc_bias"]
        self.qfrc_applied, self.ctrl = parts["qfrc_applied"], parts["ctrl"]
        self.xfrc_applied, self.mocap_quat = parts["xfrc_applied"], parts["mocap_quat"]
        self.time = 0.0
        self.reset()

    @property
    def _address(self) -> int:
        """There is no MjData."""
        return 0

    def reset(self) -> None:
        """As `mj_resetData`."""
        self.numbers[:] = 0.0
        self.qpos[:] = self._model.qpos0
        self.mocap_quat[:] = self._model.body_quat[self._model.body_mocapid >= 0]


class PlainModel:
    """An MjModel whose bodies have masses of their own; everything else is the given one's. Nothing of MuJoCo may step it.

    A copy of an MjModel takes as much as its meshes do.

    Args:
        model: As planned.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self.body_mass, self.body_inertia = model.body_mass.copy(), model.body_inertia.copy()
        self.body_iquat = model.body_iquat.copy()

    def __getattr__(self, name: str) -> Any:
        """What is not its own."""
        return getattr(self._model, name)


#: Either kind.
Data: TypeAlias = mujoco.MjData | PlainData


def _shapes(model: mujoco.MjModel) -> dict[str, tuple[int, ...]]:
    nv = (model.nv,)
    return {
        "qpos": (model.nq,),
        "qvel": nv,
        "act": (model.na,),
        "qacc_smooth": nv,
        "qfrc_bias": nv,
        "qfrc_applied": nv,
        "ctrl": (model.nu,),
        "xfrc_applied": (model.nbody, 6),
        "mocap_quat": (model.nmocap, 4),
    }


def size(model: mujoco.MjModel) -> int:
    """Numbers that a `PlainData` holds."""
    return sum(int(np.prod(shape)) for shape in _shapes(model).values())


def make_datas(swarms: Sequence[SwarmModel], stepper: str) -> list[Data]:
    """A state of each swarm at its reference, for an `Integrator` of that stepper; all are of one size."""
    models = [swarm.mjmodel for swarm in swarms]
    if stepper != "kernel":
        return [mujoco.MjData(model) for model in models]
    numbers = np.zeros((len(models), size(models[0])))
    return [PlainData(model, row) for model, row in zip(models, numbers, strict=True)]


def own_model(swarm: SwarmModel, stepper: str) -> SwarmModel:
    """The same swarm for a flight that writes masses of its own, for an `Integrator` of that stepper."""
    model: Any = swarm.mjmodel
    return replace(swarm, mjmodel=PlainModel(model) if stepper == "kernel" else copy(model))


def reset_data(data: Data) -> None:
    """Put a state back to the model's reference."""
    if isinstance(data, PlainData):
        data.reset()
    else:
        mujoco.mj_resetData(data.model, data)


def saved_data(data: Data) -> Array:
    """All numbers that a flight needs to go on, a copy."""
    if isinstance(data, PlainData):
        return data.numbers.copy()
    state = np.empty(mujoco.mj_stateSize(data.model, _WHOLE))
    mujoco.mj_getState(data.model, data, state, _WHOLE)
    return state


def restore_data(data: Data, saved: Array) -> None:
    """Write what `saved_data` gave."""
    if isinstance(data, PlainData):
        data.numbers[:] = saved
    else:
        mujoco.mj_setState(data.model, data, saved, _WHOLE)
