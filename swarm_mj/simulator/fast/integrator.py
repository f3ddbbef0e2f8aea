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
from numba import types

from swarm_mj.errors import ScenarioError, SimulationError
from swarm_mj.scenarios.schema import is_multiple
from swarm_mj.simulator.fast.mj_memory import (
    MJ_STEP,
    STAGED,
    STAGED_CONSTANT_INERTIA,
    Column,
    MjBatch,
    MjView,
    mj_view,
    places_of,
)
from swarm_mj.simulator.fast.native import load_mujoco
from swarm_mj.spacecraft.gyrostat import NV_FREE, with_wheels
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.spacecraft.model_guard import acting_elements, listed, swarm_options
from swarm_mj.typing import Array, kernel

_POINTER = types.intp
_STAGE = types.void(_POINTER, _POINTER)
_mj_step = types.ExternalFunction("mj_step", _STAGE)
_kinematics = types.ExternalFunction("mj_kinematics", _STAGE)
_centres = types.ExternalFunction("mj_comPos", _STAGE)
_inertia = types.ExternalFunction("mj_makeM", _STAGE)
_factor = types.ExternalFunction("mj_factorM", _STAGE)
_transmission = types.ExternalFunction("mj_transmission", _STAGE)
_actuation = types.ExternalFunction("mj_fwdActuation", _STAGE)
_velocities = types.ExternalFunction("mj_comVel", _STAGE)
_accelerate = types.ExternalFunction("mj_fwdAcceleration", _STAGE)
_bias = types.ExternalFunction("mj_rne", types.void(_POINTER, _POINTER, types.intc, _POINTER))
_integrate_position = types.ExternalFunction("mj_integratePos", types.void(_POINTER, _POINTER, _POINTER, types.float64))

#: Relative difference between inertia matrices of different states that is put down to rounding.
_ROUNDING = 1e-12


class Integrator:
    """Steps E MjData of a swarm; callbacks that are set later than it is made are not called.

    Args:
        swarm: The compiled swarm.
        datas: Their states.

    Attributes:
        swarms: For compiled code that steps them; valid as long as this object lives.
        stepper: How they are stepped: fast, or mj_step.
        why: Why by `mj_step`; empty where they are not.

    Raises:
        SimulationError: The fast stepper is asked for, or wheels are momentum states, and something acts in the model that it
            does not fly; the message names it.
    """

    def __init__(self, swarm: SwarmModel, *datas: mujoco.MjData) -> None:
        load_mujoco()
        model, self._datas = swarm.mjmodel, datas
        method, self.why = _choose_method(swarm)
        self.stepper = "mj_step" if method == MJ_STEP else "fast"
        self.swarms = MjBatch(
            places=np.array([places_of(swarm, data, method) for data in datas], np.int64),
            numbers=np.array([model.opt.timestep, swarm.properties.wheel_spin_inertia]),
            limits=np.ascontiguousarray(model.actuator_ctrlrange),
            axes=np.ascontiguousarray(swarm.properties.wheel_axes_B),
            rates=np.zeros((4, model.nv)),
            momenta=np.zeros((2, model.na)),
            start=np.zeros(model.nq),
        )

    def __reduce__(self) -> str:
        """Refuse to be copied or pickled, and so every simulation: states stand in MuJoCo's memory and are known by address."""
        raise TypeError(
            "a simulation cannot be copied or pickled; make another one, reset it and set the state of its MjData (see "
            "SwarmModel.set_state)"
        )

    def step(self, nstep: int) -> None:
        """Integrate `nstep` timesteps with controls and applied forces held."""
        for e, data in enumerate(self._datas):
            step(self.swarms, e, nstep)
            if self.swarms.places[e, Column.METHOD] != MJ_STEP:
                data.time += nstep * self.swarms.numbers[0]


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
def step(swarms: MjBatch, e: int, nstep: int) -> None:
    """Integrate `nstep` timesteps of one swarm with controls and applied forces held; the data's time is left alone."""
    integrate(mj_view(swarms, e), nstep)


@kernel
def integrate(motion: MjView, nstep: int) -> None:
    """The same for a `MjView`."""
    m = motion
    if m.method == MJ_STEP:
        for _ in range(nstep):
            _mj_step(m.model, m.data)
        return
    motor = m.momenta[0]
    if motor.shape[0] == 0:
        _transmission(m.model, m.data)
        _actuation(m.model, m.data)
    for w in range(motor.shape[0]):
        motor[w] = min(m.limits[w, 1], max(m.limits[w, 0], m.ctrl[w]))
    for step in range(nstep):
        _step(m, step == 0)


@kernel
def _step(m: MjView, first: bool) -> None:
    dt, motor, q0, h0 = m.timestep, m.momenta[0], m.start, m.momenta[1]
    # Velocity at the step's start, rate of displacement of the stage and in the mean, mean acceleration.
    v0, rate, mean_rate, mean_acceleration = m.rates[0], m.rates[1], m.rates[2], m.rates[3]
    _copy(m.qpos, q0)
    _copy(m.qvel, v0)
    _copy(m.act, h0)
    for i in range(rate.shape[0]):
        rate[i], mean_rate[i], mean_acceleration[i] = 0.0, 0.0, 0.0
    c = 0.0
    for stage in range(4):
        weight = 1.0 / 6.0 if stage == 0 or stage == 3 else 1.0 / 3.0
        if motor.shape[0] > 0:
            gyrostat_torque(m.qvel, m.act, motor, m.axes, m.applied)
        accelerate(m, m.method != STAGED_CONSTANT_INERTIA or (first and stage == 0))
        _rate_of_displacement(c, m.width, m.qvel, rate)
        _add(mean_rate, weight, rate, mean_rate)
        _add(mean_acceleration, weight, m.qacc, mean_acceleration)
        if stage < 3:
            c = dt if stage == 2 else 0.5 * dt
            _copy(q0, m.qpos)
            _integrate_position(m.model, m.qpos.ctypes.data, rate.ctypes.data, c)
            _add(v0, c, m.qacc, m.qvel)
            _add(h0, c, motor, m.act)
    _copy(q0, m.qpos)
    _integrate_position(m.model, m.qpos.ctypes.data, mean_rate.ctypes.data, dt)
    _add(v0, dt, mean_acceleration, m.qvel)
    _add(h0, dt, motor, m.act)


@kernel
def accelerate(motion: MjView, weigh: bool) -> None:
    """Evaluate `qacc_smooth` of free bodies at the present state, with the forces and torques applied.

    Args:
        motion: See `MjView`.
        weigh: Whether the inertia matrix is found anew.
    """
    model, data = motion.model, motion.data
    _kinematics(model, data)
    _centres(model, data)
    if weigh:
        _inertia(model, data)
        _factor(model, data)
    _velocities(model, data)
    _bias(model, data, 0, motion.bias.ctypes.data)
    _accelerate(model, data)


@kernel
def lay_out(motion: MjView, qpos: Array, qvel: Array) -> None:
    """Copy the state with three wheels per spacecraft, shape (10 n,) and (9 n,), whichever way wheels are modelled."""
    if motion.act.shape[0] > 0:
        with_wheels(motion.qpos, motion.qvel, motion.act, motion.spin_inertia, motion.axes, qpos, qvel)
    else:
        _copy(motion.qpos, qpos)
        _copy(motion.qvel, qvel)


@kernel
def _copy(source: Array, target: Array) -> None:
    # A loop compiles in a tenth of the time of a slice, whose shapes numba checks with a message of its own.
    for i in range(source.shape[0]):
        target[i] = source[i]


@kernel
def _add(start: Array, factor: float, slope: Array, total: Array) -> None:
    for i in range(start.shape[0]):
        total[i] = start[i] + factor * slope[i]


@kernel
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


@kernel
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
