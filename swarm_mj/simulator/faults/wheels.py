"""Reaction wheels that fail: which ones still carry a command, what their motors give, and what their bearings take.

A motor torque u and a bearing's torque act on the wheel along +a and on the hub along -a. With J = 1 / (1/J_s + 1/J_hub), the
inertia that the speed W relative to the hub meets,

    J dW/dt = u - c sign(W) - b W,

c the Coulomb and b the viscous friction. Both are constant over one hold of the motor torque, so that the speed at its end
is known in closed form; the mean torque that leads there is held (equal to the force it replaces in momentum, to rounding).
"""

from __future__ import annotations

from math import copysign, exp, log
from typing import NamedTuple

import numpy as np

from swarm_mj.simulator.slots import Peak
from swarm_mj.typing import Array, Mask, kernel

#: A decay of less than this over one hold is treated as none: the closed form would lose its digits.
_NO_DECAY = 1e-9


class WheelState(NamedTuple):
    """How the wheels of n spacecraft with w wheels each are.

    Attributes:
        effectiveness: Part of the commanded torque that the motor gives; 0: lost, shape (n, w).
        stuck: Whether the speed is held, shape (n, w).
        stuck_speed: At which, shape (n, w) [rad/s].
        coulomb: Shape (n, w) [N m].
        viscous: Shape (n, w) [N m s/rad].
        allocation: Maps a body torque to motor torques, shape (n, w, 3).
        inertia: That the speed relative to the hub meets, shape (n, w) [kg m^2].
        motor: Motor torques of the present hold, shape (n, w) [N m].
        bearing: Mean friction torques over the hold, shape (n, w) [N m].
    """

    effectiveness: Array
    stuck: Mask
    stuck_speed: Array
    coulomb: Array
    viscous: Array
    allocation: Array
    inertia: Array
    motor: Array
    bearing: Array


def allocate(axes_B: Array, healthy: Mask) -> Array:
    """The map from a body torque to motor torques of the least sum of squares, over healthy wheels alone.

    Args:
        axes_B: Spin axes as rows, shape (w, 3).
        healthy: Shape (w,).

    Returns:
        Minus the pseudo-inverse, shape (w, 3); rows of other wheels are zero. With fewer than three independent healthy axes
        the torque about what they do not span is lost, and the rest is as asked.
    """
    allocation = np.zeros((len(axes_B), 3))
    if healthy.any():
        allocation[healthy] = -np.linalg.pinv(axes_B[healthy].T)
    return allocation


@kernel
def drive(
    torque_B: Array,
    wheels: WheelState,
    speed: Array,
    period: float,
    max_torque: float,
    max_speed: float,
    dead: Mask,
    peaks: Array,
) -> None:
    """Turn body torques into motor torques within the limits, and find what the bearings take meanwhile.

    Args:
        torque_B: Torque that the wheels shall exert on the body, shape (n, 3) [N m].
        wheels: Their state; receives the torques of motors and bearings.
        speed: Relative to the hub, shape (n, w) [rad/s].
        period: Time for which torques are held [s].
        max_torque: Of a motor [N m].
        max_speed: Of a wheel [rad/s].
        dead: Spacecraft without power, shape (n,).
        peaks: Brought up to date, see `Peak`, shape (n, 3).
    """
    motor, bearing = wheels.motor, wheels.bearing
    for j in range(speed.shape[0]):
        cut = False
        for w in range(speed.shape[1]):
            u = 0.0
            for k in range(3):
                u += wheels.allocation[j, w, k] * torque_B[j, k]
            asked = u
            turning, J = speed[j, w], wheels.inertia[j, w]
            u = min(max_torque, max(-max_torque, u))
            u = min(max(0.0, (max_speed - turning) * J / period), max(min(0.0, (-max_speed - turning) * J / period), u))
            cut = cut or (u != asked and not dead[j])
            u *= 0.0 if dead[j] else wheels.effectiveness[j, w]
            if wheels.stuck[j, w]:
                u = (wheels.stuck_speed[j, w] - turning) * J / period
                u = min(max_torque, max(-max_torque, u))
                bearing[j, w] = 0.0
            elif wheels.coulomb[j, w] == 0.0 and wheels.viscous[j, w] == 0.0:
                bearing[j, w] = 0.0
            else:
                after = speed_after(turning, u, wheels.coulomb[j, w], wheels.viscous[j, w], J, period)
                bearing[j, w] = J * (after - turning) / period - u
            motor[j, w] = u
            peaks[j, Peak.WHEEL_SPEED] = max(peaks[j, Peak.WHEEL_SPEED], abs(turning))
            peaks[j, Peak.MOTOR_TORQUE] = max(peaks[j, Peak.MOTOR_TORQUE], abs(u))
        if cut:
            peaks[j, Peak.CUT_HOLDS] += 1.0


@kernel
def speed_after(speed: float, motor: float, coulomb: float, viscous: float, inertia: float, time: float) -> float:
    """Wheel speed [rad/s] after `time` [s] under a constant motor torque and friction.

    A wheel that comes to rest stays there unless the motor overcomes the Coulomb friction.

    Args:
        speed: Now [rad/s].
        motor: Motor torque [N m].
        coulomb: [N m].
        viscous: [N m s/rad].
        inertia: [kg m^2].
        time: [s].
    """
    if coulomb == 0.0 and viscous == 0.0:
        return speed + motor * time / inertia
    if speed != 0.0:
        force = motor - copysign(coulomb, speed)
        rest = _time_to_rest(speed, force, viscous, inertia)
        if rest >= time:
            return _coast(speed, force, viscous, inertia, time)
        time -= rest
    if abs(motor) <= coulomb:
        return 0.0
    return _coast(0.0, motor - copysign(coulomb, motor), viscous, inertia, time)


@kernel
def _coast(speed: float, force: float, viscous: float, inertia: float, time: float) -> float:
    decay = viscous * time / inertia
    if decay < _NO_DECAY:
        return speed + (force - viscous * speed) * time / inertia
    final = force / viscous
    return final + (speed - final) * exp(-decay)


@kernel
def _time_to_rest(speed: float, force: float, viscous: float, inertia: float) -> float:
    """When a wheel under a constant force and viscous friction first stands still [s]; infinite: never."""
    if force * speed >= 0.0:
        return np.inf
    if viscous * abs(speed) < _NO_DECAY * abs(force):
        return -speed * inertia / force
    return inertia / viscous * log(1.0 - viscous * speed / force)
