"""How long a turn takes until pictures count: a control law asked for turns from rest to rest, about one axis.

The hub and its wheels turn about the axis of largest inertia, torque and wheel speed are limited, and the law is the flight's
own. What the real turn adds (other axes, a target that moves on) is small for the angles between parts of one target.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array

#: Turns that are tried [deg].
ANGLES_DEG = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
#: A turn that takes longer does not settle [s].
LONGEST_S = 600.0


def settling_times(
    controller: Controller, properties: SpacecraftProperties, period: float, tolerance: float
) -> tuple[Array, Array]:
    """Times after which the pointing error stays below a tolerance.

    Args:
        controller: The law.
        properties: Of the spacecraft.
        period: Control period [s].
        tolerance: Largest pointing error [rad].

    Returns:
        Angles of the turns [rad], ascending from 0, and the time each takes [s], never falling, `LONGEST_S` at most.
    """
    turn = np.radians(ANGLES_DEG)
    axis = int(np.argmax(np.diag(properties.inertia_effective_B)))
    J = np.tile(properties.inertia_B, (len(turn), 1, 1))
    J_eff = np.tile(properties.inertia_effective_B, (len(turn), 1, 1))
    limit, most = properties.max_wheel_torque, properties.wheel_spin_inertia * properties.max_wheel_speed
    error, rate, wheels = turn.copy(), np.zeros(len(turn)), np.zeros(len(turn))
    late, memory = np.zeros(len(turn)), None
    zero = np.zeros((len(turn), 3))
    for k in range(1, round(LONGEST_S / period) + 1):
        sigma, omega, momentum = (np.zeros((len(turn), 3)) for _ in range(3))
        sigma[:, axis], omega[:, axis], momentum[:, axis] = np.tan(0.25 * error), rate, wheels
        inputs = ControlInput(sigma, omega, omega.copy(), zero, zero, momentum, J, J_eff, period)
        torque_B, memory = controller.torque(inputs, memory)
        torque = np.clip(torque_B[:, axis], -limit, limit)
        torque = np.clip(torque, (wheels - most) / period, (wheels + most) / period)
        acceleration = torque / J_eff[:, axis, axis]
        error = error + rate * period + 0.5 * acceleration * period**2
        rate, wheels = rate + acceleration * period, wheels - torque * period
        late = np.where(np.abs(error) > tolerance, k * period, late)
        if (np.abs(error) < 0.1 * tolerance).all() and (np.abs(rate) * period < 0.1 * tolerance).all():
            break
    else:
        late = np.where(np.abs(error) > tolerance, LONGEST_S, late)
    late = np.where(turn > tolerance, late, 0.0)
    return np.concatenate([[0.0], turn]), np.maximum.accumulate(np.concatenate([[0.0], late]))


def slots_between(angle: Array, table: tuple[Array, Array], interval_s: float, delay_s: float = 0.0) -> Array:
    """Least number of pictures later at which another aim can be pictured, at least 1.

    Args:
        angle: Between the aims [rad], any shape.
        table: From `settling_times`; beyond its last angle that one's time.
        interval_s: Between pictures [s].
        delay_s: After a picture until the turn begins [s].
    """
    takes = np.interp(angle, *table)
    return np.maximum(np.ceil((takes + delay_s) / interval_s - 1e-9), 1.0)
