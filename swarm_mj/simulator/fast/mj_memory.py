"""The arrays of MjModel and MjData in compiled code.

They stand in MuJoCo's memory. Handing an array from Python to compiled code costs a tenth of a microsecond each time, so every
MjData is described once by a record of sizes and addresses. Compiled code is handed the records, a single array, and makes
arrays of the addresses where it needs them (`mj_view`), which costs nothing there.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import mujoco
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array
from numpy.typing import NDArray

from swarm_mj.simulator.fast.plain_data import Data
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.typing import Array, inlined

#: How a model is stepped: by `mj_step`; stage by stage; stage by stage with one inertia matrix for the whole hold; without
#: MuJoCo, see `gyrostat_step`.
MJ_STEP, STAGED, STAGED_CONSTANT_INERTIA, KERNEL = 0, 1, 2, 3

_SIZES = ("method", "width", "nq", "nv", "na", "nu", "nbody", "first_hub")
_OF_MUJOCO = ("qpos", "qvel", "act", "qacc_smooth", "qfrc_bias", "qfrc_applied", "ctrl", "xfrc_applied")
_OF_MODEL = ("body_mass", "body_inertia")
#: One MjData for compiled code. Sizes: how it is stepped, velocities of one spacecraft, MuJoCo's own; then numbers; addresses
#: of MjModel, MjData and their arrays; and those of `Scratch`.
MJ_RECORD = np.dtype(
    [(name, np.int64) for name in _SIZES]
    + [("timestep", np.float64), ("spin_inertia", np.float64)]
    + [
        (name, np.int64)
        for name in ("model", "data", *_OF_MUJOCO, *_OF_MODEL, "asteroid_quat", "ctrlrange", "wheel_axes_B")
    ]
    + [(name, np.int64) for name in ("qpos0", "qvel0", "act0", "rate", "mean_rate", "mean_acceleration", "motor")]
)
#: E MjData of one MjModel, with dtype `MJ_RECORD`, shape (E,).
MjBatch: TypeAlias = NDArray[np.void]


class Scratch(NamedTuple):
    """What a Runge-Kutta step remembers of its stages; shared by MjData that are stepped one after the other.

    Attributes:
        qpos0: Positions at the step's start, shape (nq,).
        qvel0: Velocities at the step's start, shape (nv,).
        act0: Momenta of the wheels at the step's start, shape (na,).
        rate: Rate of displacement of a stage, shape (nv,).
        mean_rate: Its mean over the stages, shape (nv,).
        mean_acceleration: Mean acceleration, shape (nv,).
        motor: Motor torques on wheels that are momentum states, shape (na,) [N m].
    """

    qpos0: Array
    qvel0: Array
    act0: Array
    rate: Array
    mean_rate: Array
    mean_acceleration: Array
    motor: Array


class MjView(NamedTuple):
    """One MjData as arrays, which are MuJoCo's own.

    Attributes:
        model: Address of the MjModel.
        data: Address of the MjData.
        method: MJ_STEP, STAGED, STAGED_CONSTANT_INERTIA or KERNEL.
        width: Velocities of one spacecraft.
        first_hub: Body id of the first spacecraft's hub.
        timestep: [s].
        spin_inertia: Of a wheel [kg m^2].
        qpos: Positions, shape (n (7 + hinges),).
        qvel: Velocities, shape (n (6 + hinges),).
        act: Axial momenta of wheels that are no bodies, shape (3 n,) [kg m^2/s]; else empty.
        qacc_smooth: Accelerations, shape (nv,).
        qfrc_bias: Bias forces, shape (nv,).
        qfrc_applied: Generalised forces applied, shape (nv,).
        ctrl: Motor torques, shape (n w,) [N m].
        xfrc_applied: Force and torque on every body in N, shape (nbody, 6) [N, N m].
        body_mass: Masses, shape (nbody,) [kg].
        body_inertia: Principal moments, shape (nbody, 3) [kg m^2].
        asteroid_quat: Attitude of the asteroid's mocap body, shape (4,).
        ctrlrange: Lower and upper limits of the motor torques, shape (n w, 2) [N m].
        wheel_axes_B: Rows; of three wheels where they are momentum states, else not used, shape (3, 3).
        scratch: See `Scratch`.
    """

    model: int
    data: int
    method: int
    width: int
    first_hub: int
    timestep: float
    spin_inertia: float
    qpos: Array
    qvel: Array
    act: Array
    qacc_smooth: Array
    qfrc_bias: Array
    qfrc_applied: Array
    ctrl: Array
    xfrc_applied: Array
    body_mass: Array
    body_inertia: Array
    asteroid_quat: Array
    ctrlrange: Array
    wheel_axes_B: Array
    scratch: Scratch


def allocate_scratch(model: mujoco.MjModel) -> Scratch:
    """Scratch for a model."""
    nq, nv, na = model.nq, model.nv, model.na
    return Scratch(*(np.zeros(size) for size in (nq, nv, na, nv, nv, nv, na)))


def mj_records(
    swarm: SwarmModel, datas: tuple[Data, ...], method: int, wheel_axes_B: Array, scratch: Scratch
) -> MjBatch:
    """Records of MjData; valid as long as all that is given here lives.

    Args:
        swarm: Their model.
        datas: The MjData.
        method: MJ_STEP, STAGED, STAGED_CONSTANT_INERTIA or KERNEL.
        wheel_axes_B: Rows, shape (w, 3).
        scratch: For all of them.
    """
    mjmodel, records = swarm.mjmodel, np.zeros(len(datas), MJ_RECORD)
    sizes = {name: getattr(mjmodel, name) for name in ("nq", "nv", "na", "nu", "nbody")}
    sizes["first_hub"] = int(swarm.hub_body[0])
    shared = {name: getattr(mjmodel, name) for name in _OF_MODEL}
    shared |= {"ctrlrange": mjmodel.actuator_ctrlrange, "wheel_axes_B": wheel_axes_B, **scratch._asdict()}
    for record, data in zip(records, datas, strict=True):
        record["method"], record["width"] = method, mjmodel.nv // swarm.n
        record["timestep"], record["spin_inertia"] = mjmodel.opt.timestep, swarm.properties.wheel_spin_inertia
        record["model"], record["data"] = mjmodel._address, data._address
        own = {name: getattr(data, name) for name in _OF_MUJOCO}
        own["asteroid_quat"] = data.mocap_quat[swarm.asteroid_mocap]
        for name, size in sizes.items():
            record[name] = size
        for name, array in (own | shared).items():
            assert array.flags.c_contiguous and array.dtype == np.float64, name
            record[name] = array.ctypes.data
    return records


def array_of(kind: Any) -> Any:
    """What makes an array of elements of that type from an address and a shape: Numba's own `carray` without an owner.

    Kernels that count no references may call it.
    """

    @intrinsic
    def array_at(typing_context: Any, address: Any, shape: Any) -> tuple[Any, Any]:
        sizes = [shape] if isinstance(shape, types.Integer) else list(shape)
        made = types.Array(kind, len(sizes), "C")

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            array, given = make_array(made)(context, builder), arguments[1]
            values = [given] if isinstance(shape, types.Integer) else cgutils.unpack_tuple(builder, given)
            counts = [context.cast(builder, *each, types.intp) for each in zip(values, sizes, strict=True)]
            strides = [context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(kind)))]
            for count in reversed(counts[1:]):
                strides.insert(0, builder.mul(strides[0], count))
            data = builder.inttoptr(arguments[0], array.data.type)
            populate_array(array, data, counts, strides, strides[-1], None)
            return array._getvalue()

        return made(types.int64, shape), generate

    return array_at


numbers_at = array_of(types.float64)


@inlined
def mj_view(records: MjBatch, e: int) -> MjView:
    """One MjData as arrays."""
    at = records[e]
    return MjView(
        at.model,
        at.data,
        at.method,
        at.width,
        at.first_hub,
        at.timestep,
        at.spin_inertia,
        numbers_at(at.qpos, at.nq),
        numbers_at(at.qvel, at.nv),
        numbers_at(at.act, at.na),
        numbers_at(at.qacc_smooth, at.nv),
        numbers_at(at.qfrc_bias, at.nv),
        numbers_at(at.qfrc_applied, at.nv),
        numbers_at(at.ctrl, at.nu),
        numbers_at(at.xfrc_applied, (at.nbody, 6)),
        numbers_at(at.body_mass, at.nbody),
        numbers_at(at.body_inertia, (at.nbody, 3)),
        numbers_at(at.asteroid_quat, 4),
        numbers_at(at.ctrlrange, (at.nu, 2)),
        numbers_at(at.wheel_axes_B, (3, 3)),
        Scratch(
            numbers_at(at.qpos0, at.nq),
            numbers_at(at.qvel0, at.nv),
            numbers_at(at.act0, at.na),
            numbers_at(at.rate, at.nv),
            numbers_at(at.mean_rate, at.nv),
            numbers_at(at.mean_acceleration, at.nv),
            numbers_at(at.motor, at.na),
        ),
    )
