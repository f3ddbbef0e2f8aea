"""Runge-Kutta integration of gyrostats: MuJoCo's method of fourth order around MuJoCo's own accelerations.

The gyroscopic torque -omega x h of wheels that are no bodies depends on the state, so it must be evaluated at every stage to
keep the method's order. An actuator cannot give it, for what actuators add is symmetric in the velocities; callbacks would act
on every model in the process. So the stages are run here, in compiled code that calls MuJoCo's C functions: of those behind
`mj_forward` only what free bodies need, which gives the same bits in half the time. Attitudes are integrated as rotation
vectors from the step's start (Munthe-Kaas, BIT Numerical Mathematics 38, 1998), as MuJoCo 4 does.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numba import njit, types
from numpy.typing import NDArray

from swarm_mj.simulation.native import load_mujoco
from swarm_mj.spacecraft.gyrostat import NV_FREE

Array = NDArray[np.float64]

_POINTER = types.intp
_STAGE = types.void(_POINTER, _POINTER)
_kinematics = types.ExternalFunction("mj_kinematics", _STAGE)
_centres = types.ExternalFunction("mj_comPos", _STAGE)
_inertia = types.ExternalFunction("mj_makeM", _STAGE)
_factor = types.ExternalFunction("mj_factorM", _STAGE)
_velocities = types.ExternalFunction("mj_comVel", _STAGE)
_accelerate = types.ExternalFunction("mj_fwdAcceleration", _STAGE)
_bias = types.ExternalFunction("mj_rne", types.void(_POINTER, _POINTER, types.intc, _POINTER))
_integrate_position = types.ExternalFunction("mj_integratePos", types.void(_POINTER, _POINTER, _POINTER, types.float64))


class GyrostatIntegrator:
    """Steps the gyrostats of one model.

    Args:
        model: The compiled model: free joints alone, three integrator actuators per spacecraft.
        axes: Wheel axes as rows, in B, shape (3, 3).
    """

    def __init__(self, model: mujoco.MjModel, axes: Array) -> None:
        load_mujoco()
        self._model, self._axes = model, np.ascontiguousarray(axes)
        self._limits = np.ascontiguousarray(model.actuator_ctrlrange)
        self._rates, self._start = np.zeros((4, model.nv)), np.zeros(model.nq)

    def step(self, data: mujoco.MjData, nstep: int) -> None:
        """Integrate `nstep` timesteps with controls and applied forces held."""
        timestep = float(self._model.opt.timestep)
        integrate(
            self._model._address,
            data._address,
            nstep,
            timestep,
            data.qpos,
            data.qvel,
            data.act,
            data.qacc_smooth,
            data.qfrc_bias,
            data.ctrl,
            self._limits,
            self._axes,
            data.qfrc_applied,
            self._rates,
            self._start,
        )
        data.time += nstep * timestep


@njit(cache=True, nogil=True, error_model="numpy")
def integrate(
    model: int,
    data: int,
    nstep: int,
    dt: float,
    qpos: Array,
    qvel: Array,
    act: Array,
    qacc: Array,
    bias: Array,
    ctrl: Array,
    limits: Array,
    axes: Array,
    torque: Array,
    rates: Array,
    q0: Array,
) -> None:
    """Integrate `nstep` timesteps with controls and applied forces held.

    Args:
        model: Address of the model.
        data: Address of the data.
        nstep: Number of timesteps.
        dt: Timestep [s].
        qpos: The data's positions, shape (7 n,).
        qvel: The data's velocities, shape (6 n,).
        act: Axial momenta, shape (3 n,) [kg m^2/s].
        qacc: The data's `qacc_smooth`, shape (6 n,).
        bias: The data's `qfrc_bias`, shape (6 n,).
        ctrl: Motor torques, shape (3 n,) [N m].
        limits: Their lower and upper limits, shape (3 n, 2) [N m].
        axes: Wheel axes as rows, in B, shape (3, 3).
        torque: The data's `qfrc_applied`, shape (6 n,).
        rates: Scratch, shape (4, 6 n).
        q0: Scratch, shape (7 n,).
    """
    # rates: velocity at the step's start, rate of displacement of the stage and in the mean, mean acceleration.
    v0, rate, mean_rate, mean_acceleration = rates[0], rates[1], rates[2], rates[3]
    motor, h0 = np.empty_like(act), np.empty_like(act)
    for w in range(act.shape[0]):
        motor[w] = min(limits[w, 1], max(limits[w, 0], ctrl[w]))
    for _ in range(nstep):
        q0[:], v0[:], h0[:] = qpos, qvel, act
        rates[1:] = 0.0
        c = 0.0
        for stage in range(4):
            weight = 1.0 / 6.0 if stage == 0 or stage == 3 else 1.0 / 3.0
            gyrostat_torque(qvel, act, motor, axes, torque)
            accelerate(model, data, bias)
            _rate_of_displacement(c, qvel, rate)
            _add(mean_rate, weight, rate, mean_rate)
            _add(mean_acceleration, weight, qacc, mean_acceleration)
            if stage < 3:
                c = dt if stage == 2 else 0.5 * dt
                qpos[:] = q0
                _integrate_position(model, qpos.ctypes.data, rate.ctypes.data, c)
                _add(v0, c, qacc, qvel)
                _add(h0, c, motor, act)
        qpos[:] = q0
        _integrate_position(model, qpos.ctypes.data, mean_rate.ctypes.data, dt)
        _add(v0, dt, mean_acceleration, qvel)
        _add(h0, dt, motor, act)


@njit(cache=True, nogil=True, error_model="numpy")
def accelerate(model: int, data: int, bias: Array) -> None:
    """Evaluate `qacc_smooth` of free bodies at the present state, with the forces and torques applied.

    Args:
        model: Address of the model.
        data: Address of the data.
        bias: The data's `qfrc_bias`.
    """
    _kinematics(model, data)
    _centres(model, data)
    _inertia(model, data)
    _factor(model, data)
    _velocities(model, data)
    _bias(model, data, 0, bias.ctypes.data)
    _accelerate(model, data)


@njit(cache=True, nogil=True, error_model="numpy")
def _add(start: Array, factor: float, slope: Array, total: Array) -> None:
    for i in range(start.shape[0]):
        total[i] = start[i] + factor * slope[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _rate_of_displacement(c: float, qvel: Array, rate: Array) -> None:
    # `rate` holds that of the previous stage, by which this stage stands displaced for the time c. The rate of a rotation
    # vector p is omega + p x omega / 2 + p x (p x omega) / 12, up to terms beyond fourth order.
    for v in range(0, qvel.shape[0], NV_FREE):
        px, py, pz = c * rate[v + 3], c * rate[v + 4], c * rate[v + 5]
        x, y, z = qvel[v + 3], qvel[v + 4], qvel[v + 5]
        ax, ay, az = py * z - pz * y, pz * x - px * z, px * y - py * x
        for k in range(3):
            rate[v + k] = qvel[v + k]
        rate[v + 3] = x + 0.5 * ax + (py * az - pz * ay) / 12.0
        rate[v + 4] = y + 0.5 * ay + (pz * ax - px * az) / 12.0
        rate[v + 5] = z + 0.5 * az + (px * ay - py * ax) / 12.0


@njit(cache=True, nogil=True, error_model="numpy")
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
