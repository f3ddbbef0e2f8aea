"""Steps swarms: MuJoCo's Runge-Kutta method of fourth order around MuJoCo's own accelerations, in compiled code.

`mj_step` runs every stage of `mj_forward` four times, whatever is in the model. A swarm of free bodies needs few of them, and
they are called here one by one: kinematics, centres of mass, velocities, bias forces, accelerations under `xfrc_applied`. What
a hold does not change is found once for the hold: the motors' torques and, where wheels are balanced and the centre of mass is
where the free joint is, the factored inertia matrix, which then does not depend on the state. The result is that of `mj_step`
to rounding, in about three fifths of the time. A model in which anything else acts (springs, dampers, tendons, contacts,
callbacks, other integrators; `model_guard` names it) is stepped by `mj_step` itself.

Wheels as momentum states need more than speed: their gyroscopic torque -omega x h depends on the state, so that it must be
evaluated at every stage to keep the method's order. An actuator cannot give it, for what actuators add is symmetric in the
velocities; callbacks would act on every model in the process.

Attitudes are integrated as rotation vectors from the step's start (Munthe-Kaas, BIT Numerical Mathematics 38, 1998), as
MuJoCo 4 does.
"""

from __future__ import annotations

import mujoco
import numpy as np

from swarm_mj.errors import ScenarioError, SimulationError
from swarm_mj.scenarios.schema import is_multiple
from swarm_mj.simulator.fast.c_functions import (
    load_mujoco,
    mj_comPos,
    mj_comVel,
    mj_factorM,
    mj_fwdAcceleration,
    mj_fwdActuation,
    mj_integratePos,
    mj_kinematics,
    mj_makeM,
    mj_rne,
    mj_step,
    mj_transmission,
)
from swarm_mj.simulator.fast.gyrostat_step import step_gyrostats
from swarm_mj.simulator.fast.mj_memory import (
    KERNEL,
    MJ_STEP,
    STAGED,
    STAGED_CONSTANT_INERTIA,
    MjBatch,
    MjView,
    allocate_scratch,
    mj_records,
    mj_view,
)
from swarm_mj.simulator.fast.plain_data import Data
from swarm_mj.spacecraft.gyrostat import NV_FREE, with_wheels
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.spacecraft.model_guard import acting_elements, listed, swarm_options
from swarm_mj.typing import Array, inlined, jittable, kernel, lean

#: Relative difference between inertia matrices of different states that is put down to rounding.
_ROUNDING = 1e-12


class Integrator:
    """Steps E MjData of a swarm; callbacks that are set later than it is made are not called.

    Args:
        swarm: The compiled swarm.
        datas: Their states.

    Attributes:
        batch: The MjData for compiled code that steps them, see `MjBatch`; valid as long as this object lives.
        stepper: How they are stepped: fast, kernel or mj_step.
        why: Why by `mj_step`; empty where they are not.

    Raises:
        SimulationError: The fast stepper is asked for, or wheels are momentum states, and something acts in the model that it
            does not fly; the message names it.
    """

    def __init__(self, swarm: SwarmModel, *datas: Data) -> None:
        load_mujoco()
        self._datas = datas
        method, self.why = _choose_method(swarm)
        self.stepper = {MJ_STEP: "mj_step", KERNEL: "kernel"}.get(method, "fast")
        self._wheel_axes_B = np.ascontiguousarray(swarm.properties.wheel_axes_B)
        self._swarm, self._scratch = swarm, allocate_scratch(swarm.mjmodel)
        self.batch = mj_records(swarm, datas, method, self._wheel_axes_B, self._scratch)

    def __reduce__(self) -> str:
        """Refuse to be copied or pickled, and so every simulation: states stand in MuJoCo's memory and are known by address."""
        raise TypeError(
            "a simulation cannot be copied or pickled; make another one and hand it what get_state gives (see "
            "Simulation.set_state)"
        )

    def step(self, nstep: int) -> None:
        """Integrate `nstep` timesteps with controls and applied forces held."""
        for e, data in enumerate(self._datas):
            step(self.batch, e, nstep)
            if self.batch[e]["method"] != MJ_STEP:
                data.time += nstep * self.batch[e]["timestep"]


def timesteps_in(control_period: float, swarm: SwarmModel) -> int:
    """Timesteps of a swarm's model in a control period [s].

    Raises:
        ScenarioError: It is no whole multiple of the timestep.
    """
    timestep = float(swarm.mjmodel.opt.timestep)
    if not (control_period > 0.0 and is_multiple(control_period, timestep)):
        raise ScenarioError(
            f"control.period_s = {control_period:g}: must be a whole multiple of the model's timestep, {timestep:g} s"
        )
    return round(control_period / timestep)


def _choose_method(swarm: SwarmModel) -> tuple[int, str]:
    """How a swarm is stepped, and why by `mj_step` if it is.

    Raises:
        SimulationError: It must not be stepped so, and cannot otherwise.
    """
    if swarm.own is not None:
        return MJ_STEP, swarm.own.why
    if swarm.stepper == "mj_step":
        return MJ_STEP, "physics.stepper = mj_step"
    gyrostat = swarm.wheels == "gyrostat"
    found = [*swarm_options(swarm.mjmodel), *acting_elements(swarm.mjmodel, gyrostat=gyrostat)]
    if found and gyrostat:
        raise SimulationError(
            f"physics.wheels = gyrostat flies free bodies alone, and this model has {listed(found)}; use physics.wheels: bodies"
        )
    if found and swarm.stepper == "fast":
        raise SimulationError(
            f"physics.stepper = fast cannot fly this model: {listed(found)}; use physics.stepper: mj_step or auto"
        )
    if found:
        return MJ_STEP, listed(found)
    if swarm.stepper == "kernel":
        hubs = swarm.mjmodel.body_sameframe[swarm.hub_body]
        if (hubs != mujoco.mjtSameFrame.mjSAMEFRAME_BODY).any():
            raise SimulationError(
                "physics.stepper = kernel flies hubs whose principal axes are the hub's own; use physics.stepper: fast"
            )
        return KERNEL, ""
    return STAGED_CONSTANT_INERTIA if _inertia_is_steady(swarm.mjmodel) else STAGED, ""


def _inertia_is_steady(model: mujoco.MjModel) -> bool:
    """Whether the inertia matrix is the same in any state, found from a few."""
    data, rng, found = mujoco.MjData(model), np.random.default_rng(0), []
    row = np.repeat(np.arange(model.nv), model.M_rownnz)
    scale = np.sqrt(model.dof_M0[row] * model.dof_M0[model.M_colind[: len(row)]])
    for _ in range(3):
        turn = rng.uniform(-np.pi, np.pi, model.nv)
        mujoco.mj_integratePos(model, data.qpos, turn, 1.0)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        found.append(data.M.copy())
    return all((np.abs(matrix - found[0]) <= _ROUNDING * scale).all() for matrix in found)


@kernel
def step(batch: MjBatch, e: int, nstep: int) -> None:
    """Integrate `nstep` timesteps of one MjData with controls and applied forces held; its time is left alone."""
    integrate(mj_view(batch, e), nstep)


@lean
def integrate(mj: MjView, nstep: int) -> None:
    """The same for a `MjView`."""
    if mj.method == MJ_STEP:
        for _ in range(nstep):
            mj_step(mj.model, mj.data)
        return
    if mj.method == KERNEL:
        step_gyrostats(mj, nstep)
        return
    motor = mj.scratch.motor
    if motor.shape[0] == 0:
        mj_transmission(mj.model, mj.data)
        mj_fwdActuation(mj.model, mj.data)
    for w in range(motor.shape[0]):
        motor[w] = min(mj.ctrlrange[w, 1], max(mj.ctrlrange[w, 0], mj.ctrl[w]))
    for i in range(nstep):
        _step(mj, i == 0)


@inlined
def _step(mj: MjView, first_of_hold: bool) -> None:
    dt, rk, motor = mj.timestep, mj.scratch, mj.scratch.motor
    _copy(mj.qpos, rk.qpos0)
    _copy(mj.qvel, rk.qvel0)
    _copy(mj.act, rk.act0)
    for i in range(rk.rate.shape[0]):
        rk.rate[i], rk.mean_rate[i], rk.mean_acceleration[i] = 0.0, 0.0, 0.0
    c = 0.0  # time from the step's start to the stage, by the rate of the stage before
    for stage in range(4):
        weight = 1.0 / 6.0 if stage == 0 or stage == 3 else 1.0 / 3.0
        if motor.shape[0] > 0:
            gyrostat_torque(mj.qvel, mj.act, motor, mj.wheel_axes_B, mj.qfrc_applied)
        accelerate(mj, mj.method != STAGED_CONSTANT_INERTIA or (first_of_hold and stage == 0))
        _rate_of_displacement(c, mj.width, mj.qvel, rk.rate)
        _add(rk.mean_rate, weight, rk.rate, rk.mean_rate)
        _add(rk.mean_acceleration, weight, mj.qacc_smooth, rk.mean_acceleration)
        if stage < 3:
            c = dt if stage == 2 else 0.5 * dt
            _move_from_start(mj, c, rk.rate, mj.qacc_smooth)
    _move_from_start(mj, dt, rk.mean_rate, rk.mean_acceleration)


@inlined
def _move_from_start(mj: MjView, dt: float, rate: Array, acceleration: Array) -> None:
    """Set the state to which `rate` and `acceleration` lead when they are held for `dt` [s] from the step's start."""
    rk = mj.scratch
    _copy(rk.qpos0, mj.qpos)
    mj_integratePos(mj.model, mj.qpos.ctypes.data, rate.ctypes.data, dt)
    _add(rk.qvel0, dt, acceleration, mj.qvel)
    _add(rk.act0, dt, rk.motor, mj.act)


@inlined
def accelerate(mj: MjView, weigh: bool) -> None:
    """Evaluate `qacc_smooth` of free bodies at the present state, with the forces and torques applied.

    Args:
        mj: See `MjView`.
        weigh: Whether the inertia matrix is found anew.
    """
    mj_kinematics(mj.model, mj.data)
    mj_comPos(mj.model, mj.data)
    if weigh:
        mj_makeM(mj.model, mj.data)
        mj_factorM(mj.model, mj.data)
    mj_comVel(mj.model, mj.data)
    mj_rne(mj.model, mj.data, 0, mj.qfrc_bias.ctypes.data)
    mj_fwdAcceleration(mj.model, mj.data)


@inlined
def copy_state(mj: MjView, qpos: Array, qvel: Array) -> None:
    """Copy the state with three wheels per spacecraft, shape (10 n,) and (9 n,), whichever way wheels are modelled."""
    if mj.act.shape[0] > 0:
        with_wheels(mj.qpos, mj.qvel, mj.act, mj.spin_inertia, mj.wheel_axes_B, qpos, qvel)
    else:
        _copy(mj.qpos, qpos)
        _copy(mj.qvel, qvel)


@jittable
def _copy(source: Array, target: Array) -> None:
    # A loop compiles in a tenth of the time of a slice, whose shapes numba checks with a message of its own.
    for i in range(source.shape[0]):
        target[i] = source[i]


@jittable
def _add(start: Array, factor: float, slope: Array, total: Array) -> None:
    for i in range(start.shape[0]):
        total[i] = start[i] + factor * slope[i]


@jittable
def _rate_of_displacement(c: float, width: int, qvel: Array, rate: Array) -> None:
    # `rate` holds that of the previous stage, by which this stage stands displaced for the time c. The rate of a rotation
    # vector p is omega + p x omega / 2 + p x (p x omega) / 12, up to terms beyond fourth order.
    for v in range(0, qvel.shape[0], width):
        px, py, pz = c * rate[v + 3], c * rate[v + 4], c * rate[v + 5]
        x, y, z = qvel[v + 3], qvel[v + 4], qvel[v + 5]
        ax, ay, az = py * z - pz * y, pz * x - px * z, px * y - py * x
        for k in range(width):
            rate[v + k] = qvel[v + k]
        rate[v + 3] = x + 0.5 * ax + (py * az - pz * ay) / 12.0
        rate[v + 4] = y + 0.5 * ay + (pz * ax - px * az) / 12.0
        rate[v + 5] = z + 0.5 * az + (px * ay - py * ax) / 12.0


@jittable
def gyrostat_torque(qvel: Array, momentum: Array, motor: Array, axes: Array, torque: Array) -> None:
    """What the wheels exert on their bodies: the motors' reaction and -omega x h.

    Args:
        qvel: MuJoCo's velocities, shape (6 n,).
        momentum: Absolute axial momenta, shape (3 n,) [kg m^2/s].
        motor: Motor torques on the wheels, shape (3 n,) [N m].
        axes: Wheel axes as rows, in B, shape (3, 3).
        torque: Receives the torques in B in the rotational entries of MuJoCo's `qfrc_applied`, shape (6 n,) [N m].
    """
    for j in range(qvel.shape[0] // NV_FREE):
        v, w = NV_FREE * j + 3, 3 * j
        x, y, z = qvel[v], qvel[v + 1], qvel[v + 2]
        hx = axes[0, 0] * momentum[w] + axes[1, 0] * momentum[w + 1] + axes[2, 0] * momentum[w + 2]
        hy = axes[0, 1] * momentum[w] + axes[1, 1] * momentum[w + 1] + axes[2, 1] * momentum[w + 2]
        hz = axes[0, 2] * momentum[w] + axes[1, 2] * momentum[w + 1] + axes[2, 2] * momentum[w + 2]
        ux = axes[0, 0] * motor[w] + axes[1, 0] * motor[w + 1] + axes[2, 0] * motor[w + 2]
        uy = axes[0, 1] * motor[w] + axes[1, 1] * motor[w + 1] + axes[2, 1] * motor[w + 2]
        uz = axes[0, 2] * motor[w] + axes[1, 2] * motor[w + 1] + axes[2, 2] * motor[w + 2]
        torque[v] = -ux - (y * hz - z * hy)
        torque[v + 1] = -uy - (z * hx - x * hz)
        torque[v + 2] = -uz - (x * hy - y * hx)
