"""Reaction wheels that fail: which ones still carry a command, what their motors give, and what their bearings take.

A motor torque u and a bearing's torque act on the wheel along +a and on the hub along -a. With J = 1 / (1/J_s + 1/J_hub), the
inertia that the speed W relative to the hub meets,

    J dW/dt = u - c sign(W) - b W,

c the Coulomb and b the viscous friction. Both are constant over one hold of the motor torque, so that the speed at its end
is known in closed form; the mean torque that leads there is held (equal to the force it replaces in momentum, to rounding).
"""

from __future__ import annotations

from math import exp, log
from typing import Any, NamedTuple

import numpy as np

from swarm_mj.spacecraft.attitude.algebra import vectors
from swarm_mj.spacecraft.attitude.lanes import cell, chosen, column, every, put_columns, select, some, width
from swarm_mj.typing import Array, Mask, lean, woven

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


@lean
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
    for j in range(0, speed.shape[0], width()):
        off = chosen(dead, j, 1)
        fastest, strongest, holds = vectors(peaks, j)  # in the order of `Peak`
        cut = holds
        for w in range(speed.shape[1]):
            turning, J = column(speed, j, 1, w), column(wheels.inertia, j, 1, w)
            asked = _asked(torque_B, wheels.allocation, j, w)
            u = min(max_torque, max(-max_torque, asked))
            u = min(max(0.0, (max_speed - turning) * J / period), max(min(0.0, (-max_speed - turning) * J / period), u))
            cut = select(off, cut, select(u != asked, holds + 1.0, cut))
            u = u * select(off, 0.0, column(wheels.effectiveness, j, 1, w))
            stuck = chosen(wheels.stuck[:, w], j, 1)
            if some(stuck):
                brake = (column(wheels.stuck_speed, j, 1, w) - turning) * J / period
                u = select(stuck, min(max_torque, max(-max_torque, brake)), u)
            friction = _friction(
                turning, u, column(wheels.coulomb, j, 1, w), column(wheels.viscous, j, 1, w), J, period
            )
            put_columns(wheels.motor[:, w:], j, 1, (u,))
            put_columns(wheels.bearing[:, w:], j, 1, (select(stuck, 0.0, friction),))
            fastest, strongest = max(fastest, abs(turning)), max(strongest, abs(u))
        put_columns(peaks, j, 1, (fastest, strongest, cut))


@woven
def _asked(torque_B: Array, allocation: Array, j: int, w: int) -> Any:
    """Motor torques of wheels w [N m]."""
    x, y, z = vectors(torque_B, j)
    return cell(allocation, j, 1, w, 0) * x + cell(allocation, j, 1, w, 1) * y + cell(allocation, j, 1, w, 2) * z


@woven
def _friction(speed: Any, motor: Any, coulomb: Any, viscous: Any, inertia: Any, period: float) -> Any:
    """Mean torque of bearings over a hold [N m], see `speed_after`."""
    rubs = (coulomb != 0.0) | (viscous != 0.0)
    torque = coulomb
    if some(rubs):
        after = speed_after(speed, motor, coulomb, viscous, inertia, period)
        torque = select(rubs, inertia * (after - speed) / period - motor, 0.0)
    return torque


@woven
def speed_after(speed: Any, motor: Any, coulomb: Any, viscous: Any, inertia: Any, time: Any) -> Any:
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
    moving, force = speed != 0.0, motor - select(speed < 0.0, -coulomb, coulomb)
    rest = _time_to_rest(speed, force, viscous, inertia)
    after, still_moving = _coast(speed, force, viscous, inertia, time), moving & (rest >= time)
    if not every(still_moving):
        left = select(moving, time - rest, time)
        force = motor - select(motor < 0.0, -coulomb, coulomb)
        anew = select(abs(motor) <= coulomb, 0.0, _coast(0.0, force, viscous, inertia, left))
        after = select(still_moving, after, anew)
    return after


@woven
def _coast(speed: Any, force: Any, viscous: Any, inertia: Any, time: Any) -> Any:
    decay, after = viscous * time / inertia, speed + (force - viscous * speed) * time / inertia
    decays = decay >= _NO_DECAY
    if some(decays):
        final = force / viscous
        after = select(decays, final + (speed - final) * exp(-decay), after)
    return after


@woven
def _time_to_rest(speed: Any, force: Any, viscous: Any, inertia: Any) -> Any:
    """When a wheel under a constant force and viscous friction first stands still [s]; infinite: never."""
    slows, damped = force * speed < 0.0, viscous * abs(speed) >= _NO_DECAY * abs(force)
    rest = inertia
    if some(slows):
        rest = -speed * inertia / force
    if some(slows & damped):
        rest = select(damped, inertia / viscous * log(1.0 - viscous * speed / force), rest)
    return select(slows, rest, np.inf)
