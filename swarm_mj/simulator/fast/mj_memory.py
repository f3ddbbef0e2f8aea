"""The MjModel and MjData of swarms for compiled code: addresses outside, arrays inside.

Handing an array to compiled code costs a tenth of a microsecond; an address costs nothing. So what MuJoCo holds is handed over
as one row of addresses for each MjData, and becomes arrays where it is used.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple

import mujoco
from numba import carray, types
from numba.extending import intrinsic

from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.typing import Array, Ints, kernel

#: How a model is stepped: by `mj_step`; stage by stage; stage by stage with one inertia matrix for the whole hold.
MJ_STEP, STAGED, STAGED_CONSTANT_INERTIA = 0, 1, 2


class Column(IntEnum):
    """Columns of `MjBatch.places`: addresses, and what sizes the arrays at them."""

    MODEL = 0
    DATA = 1
    METHOD = 2
    N = 3
    NQ = 4
    NV = 5
    NA = 6
    NU = 7
    NBODY = 8
    QPOS = 9
    QVEL = 10
    ACT = 11
    QACC = 12
    BIAS = 13
    APPLIED = 14
    CTRL = 15
    FORCE = 16
    ASTEROID = 17


# Numba folds plain integers into the machine code; members of an IntEnum it looks up.
_MODEL, _DATA, _METHOD, _N, _NQ, _NV, _NA, _NU, _NBODY = (int(place) for place in list(Column)[: Column.QPOS])
_QPOS, _QVEL, _ACT, _QACC, _BIAS, _APPLIED, _CTRL, _FORCE, _ASTEROID = (
    int(place) for place in list(Column)[Column.QPOS :]
)


class MjBatch(NamedTuple):
    """E MjData of one MjModel, for compiled code; a handful of arrays, because each one costs a call a tenth of a microsecond.

    Attributes:
        places: See `Column`, shape (E, 18).
        numbers: Timestep [s] and spin inertia of a wheel [kg m^2], shape (2,).
        limits: Lower and upper limits of the motor torques, shape (n w, 2) [N m].
        axes: Wheel axes as rows, in B, shape (w, 3).
        rates: Scratch, shape (4, nv).
        momenta: Scratch, shape (2, na).
        start: Scratch, shape (nq,).
    """

    places: Ints
    numbers: Array
    limits: Array
    axes: Array
    rates: Array
    momenta: Array
    start: Array


class MjView(NamedTuple):
    """One of `MjBatch` as arrays, which are those of its MjData.

    Attributes:
        model: Address of the MjModel.
        data: Address of the MjData.
        method: MJ_STEP, STAGED or STAGED_CONSTANT_INERTIA.
        width: Velocities of one spacecraft.
        timestep: [s].
        spin_inertia: Of a wheel [kg m^2].
        qpos: Positions, shape (n (7 + hinges),).
        qvel: Velocities, shape (n (6 + hinges),).
        act: Axial momenta of wheels that are no bodies, shape (3 n,) [kg m^2/s]; else empty.
        qacc: `qacc_smooth`.
        bias: `qfrc_bias`.
        applied: `qfrc_applied`.
        ctrl: Motor torques [N m].
        force: `xfrc_applied`, shape (bodies, 6).
        asteroid: Attitude of the asteroid's mocap body, shape (4,).
        limits: See `MjBatch`, and so for the rest.
    """

    model: int
    data: int
    method: int
    width: int
    timestep: float
    spin_inertia: float
    qpos: Array
    qvel: Array
    act: Array
    qacc: Array
    bias: Array
    applied: Array
    ctrl: Array
    force: Array
    asteroid: Array
    limits: Array
    axes: Array
    rates: Array
    momenta: Array
    start: Array


def places_of(swarm: SwarmModel, data: mujoco.MjData, method: int) -> list[int]:
    """The row of `MjBatch.places` of an MjData, valid as long as that lives."""
    mjmodel = swarm.mjmodel
    arrays = [data.qpos, data.qvel, data.act, data.qacc_smooth, data.qfrc_bias, data.qfrc_applied, data.ctrl]
    arrays += [data.xfrc_applied, data.mocap_quat[swarm.asteroid_mocap]]
    sizes = [mjmodel.nq, mjmodel.nv, mjmodel.na, mjmodel.nu, mjmodel.nbody]
    return [mjmodel._address, data._address, method, swarm.n, *sizes, *(array.ctypes.data for array in arrays)]


@intrinsic
def _pointer(typing_context: Any, address: Any) -> tuple[Any, Any]:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(types.int64), generate


@kernel
def mj_view(swarms: MjBatch, e: int) -> MjView:
    """One swarm as arrays, which cost nothing in compiled code."""
    at = swarms.places[e]
    return MjView(
        at[_MODEL],
        at[_DATA],
        at[_METHOD],
        at[_NV] // at[_N],
        swarms.numbers[0],
        swarms.numbers[1],
        carray(_pointer(at[_QPOS]), at[_NQ]),
        carray(_pointer(at[_QVEL]), at[_NV]),
        carray(_pointer(at[_ACT]), at[_NA]),
        carray(_pointer(at[_QACC]), at[_NV]),
        carray(_pointer(at[_BIAS]), at[_NV]),
        carray(_pointer(at[_APPLIED]), at[_NV]),
        carray(_pointer(at[_CTRL]), at[_NU]),
        carray(_pointer(at[_FORCE]), (at[_NBODY], 6)),
        carray(_pointer(at[_ASTEROID]), 4),
        swarms.limits,
        swarms.axes,
        swarms.rates,
        swarms.momenta,
        swarms.start,
    )
