"""Reaction wheels: how torques are shared among them, their limits, and what their bearings take.

A motor torque u and a bearing's torque act on the wheel along +a and on the hub along -a. With J = 1 / (1/J_s + 1/J_hub), the
inertia that the speed W relative to the hub meets,

    J dW/dt = u - c sign(W) - b W,

c the Coulomb and b the viscous friction. Both are constant over one hold of the motor torque, so that the speed at its end
is known in closed form; the mean torque that leads there is held (equal to the force it replaces in momentum, to rounding).
"""

from __future__ import annotations

from math import exp, inf, log

import numpy as np

from swarm_mj.compilation import jittable
from swarm_mj.typing import Array, Mask

#: A decay of less than this over one hold is treated as none: the closed form would lose its digits.
_NO_DECAY = 1e-9


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


@jittable
def limited(u: float, speed: float, speed_gain: float, max_torque: float, max_speed: float) -> float:
    """A motor torque within the limits [N m]; one that would carry the wheel past its top speed in the hold just reaches it.

    Args:
        u: Asked for [N m].
        speed: Of the wheel [rad/s].
        speed_gain: Change of its speed in the hold per motor torque [rad/s per N m].
        max_torque: [N m].
        max_speed: [rad/s].
    """
    u = min(max_torque, max(-max_torque, u))
    return min(max(0.0, (max_speed - speed) / speed_gain), max(min(0.0, (-max_speed - speed) / speed_gain), u))


@jittable
def friction_torque(speed: float, motor: float, coulomb: float, viscous: float, inertia: float, period: float) -> float:
    """Mean torque of a bearing over a hold [N m], see `speed_after`."""
    if coulomb == 0.0 and viscous == 0.0:
        return 0.0
    after = speed_after(speed, motor, coulomb, viscous, inertia, period)
    return inertia * (after - speed) / period - motor


@jittable
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
    left = time
    if speed != 0.0:
        force = motor - (-coulomb if speed < 0.0 else coulomb)
        rest = _time_to_rest(speed, force, viscous, inertia)
        if rest >= time:
            return _coast(speed, force, viscous, inertia, time)
        left = time - rest
    if abs(motor) <= coulomb:
        return 0.0
    return _coast(0.0, motor - (-coulomb if motor < 0.0 else coulomb), viscous, inertia, left)


@jittable
def _coast(speed: float, force: float, viscous: float, inertia: float, time: float) -> float:
    """Wheel speed [rad/s] after `time` [s] under a constant force [N m] and viscous friction."""
    decay = viscous * time / inertia
    if decay < _NO_DECAY:
        return speed + (force - viscous * speed) * time / inertia
    final = force / viscous
    return final + (speed - final) * exp(-decay)


@jittable
def _time_to_rest(speed: float, force: float, viscous: float, inertia: float) -> float:
    """When a wheel under a constant force and viscous friction first stands still [s]; infinite: never."""
    if force * speed >= 0.0:
        return inf
    if viscous * abs(speed) >= _NO_DECAY * abs(force):
        return inertia / viscous * log(1.0 - viscous * speed / force)
    return -speed * inertia / force
