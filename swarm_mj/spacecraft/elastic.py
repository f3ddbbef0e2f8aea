"""Small motions of a spacecraft's joints under springs and dampers, and the timestep that they ask for.

Linearised about the start at rest, M q'' + D q' + K q = 0 with MuJoCo's inertia matrix M; stiffness K and damping D are those
of all that acts by itself (springs, dampers, tendons, servos, a medium), found by differences. Its eigenvalues are what the
classical Runge-Kutta method of fourth order is held against: a step h multiplies a mode of eigenvalue s by R(hs),
R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24, instead of by exp(hs) (Hairer, Norsett and Wanner, Solving Ordinary Differential
Equations II, section IV.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarm_mj.spacecraft.elements import qvel_indices
from swarm_mj.typing import Array

Complex = NDArray[np.complex128]

#: Eigenvalues this much smaller than the largest are the whole spacecraft's motion, and wheels that turn freely.
_RIGID = 1e-4
#: By which positions [rad, m] and velocities [rad/s, m/s] are moved to find stiffness and damping.
_STEP = 1e-6


class Mode(NamedTuple):
    """One small motion."""

    eigenvalue: complex  #: real part: growth [1/s]; imaginary part: angular frequency [rad/s]
    joint: str  #: name of the joint that moves most

    @property
    def frequency_hz(self) -> float:
        """Cycles per second."""
        return abs(self.eigenvalue.imag) / (2.0 * np.pi)


def modes_of(model: mujoco.MjModel, qpos: Array, joints: Sequence[str]) -> list[Mode]:
    """Small motions of a spacecraft, the fastest first; without those that no spring and no damper makes.

    Args:
        model: The spacecraft alone.
        qpos: About which the motion is small, shape (nq,).
        joints: Names of the joints that may bend.
    """
    mass, stiffness, damping = _matrices(model, qpos)
    n = model.nv
    inverse = np.linalg.inv(mass)
    system = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    values, vectors = np.linalg.eig(system)
    of_dof = {k: joint for joint in joints for k in qvel_indices(model, model.joint(joint).id)}
    kept = [k for k in np.flatnonzero(values.imag >= 0.0) if abs(values[k]) > _RIGID * np.abs(values).max()]
    kept.sort(key=lambda k: -abs(values[k]))
    return [Mode(complex(values[k]), _mover(vectors[:n, k], of_dof)) for k in kept]


def _mover(shape: Complex, of_dof: dict[int, str]) -> str:
    return of_dof[max(of_dof, key=lambda dof: abs(shape[dof]))] if of_dof else ""


def _matrices(model: mujoco.MjModel, qpos: Array) -> tuple[Array, Array, Array]:
    """Inertia, stiffness and damping of all degrees of freedom, each of shape (nv, nv)."""
    data, n = mujoco.MjData(model), model.nv
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    mass, stiffness, damping = np.zeros((n, n)), np.empty((n, n)), np.empty((n, n))
    mujoco.mj_fullM(model, data, mass)
    for k, turn in enumerate(_STEP * np.eye(n)):
        stiffness[:, k] = (_force(model, data, qpos, -turn, None) - _force(model, data, qpos, turn, None)) / (2 * _STEP)
        damping[:, k] = (_force(model, data, qpos, None, -turn) - _force(model, data, qpos, None, turn)) / (2 * _STEP)
    return mass, stiffness, damping


def _force(model: mujoco.MjModel, data: mujoco.MjData, qpos: Array, turn: Array | None, qvel: Array | None) -> Array:
    """What springs, dampers, tendons, servos and a medium exert near the start, shape (nv,)."""
    data.qpos[:] = qpos
    data.qvel[:] = 0.0 if qvel is None else qvel
    if turn is not None:
        mujoco.mj_integratePos(model, data.qpos, turn, 1.0)
    mujoco.mj_forward(model, data)
    return np.asarray(data.qfrc_passive + data.qfrc_actuator)


def growth_by_step(z: Complex) -> Array:
    """By how much a step of the Runge-Kutta method makes modes of h times their eigenvalue larger or smaller."""
    return np.abs(1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0)


def largest_timestep(modes: Sequence[Mode]) -> float:
    """Timestep from which on the method lets a mode that does not grow by itself grow [s]; infinite without modes."""
    falling = np.array([mode.eigenvalue for mode in modes if mode.eigenvalue.real <= 1e-9 * abs(mode.eigenvalue)])
    if not len(falling):
        return float("inf")
    # Stable up to |z| of 2.5 at least, whatever its phase; from there on, looked for.
    steps = np.linspace(0.5, 3.0, 501) / np.abs(falling).max()
    unstable = (growth_by_step(steps[:, None] * falling) > 1.0 + 1e-9).any(axis=1)
    return float(steps[np.argmax(unstable)]) if unstable.any() else float(steps[-1])


def lost_to_the_step(mode: Mode, timestep: float, duration: float) -> float:
    """Share of a mode's amplitude that the method itself takes away in a flight, or adds if negative."""
    z = np.array(mode.eigenvalue * timestep)
    by_step = np.log(growth_by_step(z)) - z.real
    return float(-np.expm1(by_step * duration / timestep))
