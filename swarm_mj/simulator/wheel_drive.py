"""Reaction wheels in flight: how each of them is, what faults make of it, and how they are driven."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import allocation_free
from swarm_mj.scenarios.schema_faults import WheelFriction, WheelLost, WheelStuck, WheelWeakened
from swarm_mj.simulator.faults.schedule import ScheduledFault
from swarm_mj.spacecraft.attitude.algebra import dot, put_vector, vector
from swarm_mj.spacecraft.properties import RPM, SpacecraftProperties
from swarm_mj.spacecraft.wheels import allocate, friction_torque, limited
from swarm_mj.typing import Array, Mask


class WheelState(NamedTuple):
    """How the wheels of n spacecraft with w wheels each are, every array of shape (n, w) where nothing else is said."""

    effectiveness: Array  #: part of the commanded torque that the motor gives; 0: lost
    stuck: Mask  #: whether the speed is held
    stuck_speed: Array  #: at which [rad/s]
    coulomb: Array  #: friction [N m]
    viscous: Array  #: friction [N m s/rad]
    allocation: Array  #: maps a body torque to motor torques, shape (n, w, 3)
    inertia: Array  #: that the speed relative to the hub meets [kg m^2]
    motor: Array  #: motor torques of the present hold [N m]
    bearing: Array  #: mean friction torques over the hold [N m]
    healthy: Mask  #: whether the flight software uses it


def healthy_wheels(properties: SpacecraftProperties, inertia_B: Array, coulomb: Array, viscous: Array) -> WheelState:
    """Wheels that all work.

    Args:
        properties: Axes and spin inertia.
        inertia_B: True inertia of every spacecraft with its wheels, shape (n, 3, 3) [kg m^2].
        coulomb: Friction, shape (n, w) [N m].
        viscous: Shape (n, w) [N m s/rad].
    """
    axes, spin, shape = properties.wheel_axes_B, properties.wheel_spin_inertia, coulomb.shape
    inverse = np.linalg.inv(inertia_B - spin * axes.T @ axes)
    return WheelState(
        effectiveness=np.ones(shape),
        stuck=np.zeros(shape, np.bool_),
        stuck_speed=np.zeros(shape),
        coulomb=coulomb,
        viscous=viscous,
        allocation=np.repeat(_allocation_to_all(axes.tobytes())[None], len(coulomb), axis=0),
        # The speed of a wheel relative to its hub meets 1 / (1/J_s + a.J_eff^-1.a).
        inertia=1.0 / (1.0 / spin + np.einsum("wi,nij,wj->nw", axes, inverse, axes)),
        motor=np.zeros(shape),
        bearing=np.zeros(shape),
        healthy=np.ones(shape, np.bool_),
    )


def set_fault(wheels: WheelState, entry: ScheduledFault, active: bool, speed: Array) -> str:
    """Let a fault of wheels begin or end; returns it in words.

    Args:
        wheels: Changed.
        entry: What happens.
        active: Whether it begins; lost and stuck wheels never recover.
        speed: Of the spacecraft's wheels now, shape (w,) [rad/s].
    """
    j, fault, sign, words = entry.spacecraft, entry.fault, 1.0 if active else -1.0, []
    for w in entry.wheels:
        if isinstance(fault, WheelLost):
            wheels.effectiveness[j, w] = 0.0
            words.append(f"wheel {w + 1} gives no torque")
        elif isinstance(fault, WheelStuck):
            held = speed[w] if fault.speed_rpm is None else fault.speed_rpm * RPM
            wheels.stuck[j, w], wheels.stuck_speed[j, w] = True, held
            words.append(f"wheel {w + 1} at {held / RPM:.0f} rpm")
        elif isinstance(fault, WheelWeakened):
            if active:
                wheels.effectiveness[j, w] *= fault.factor
            else:
                wheels.effectiveness[j, w] = wheels.effectiveness[j, w] / fault.factor if fault.factor > 0.0 else 1.0
            words.append(f"wheel {w + 1} gives {100 * fault.factor:g} %")
        elif isinstance(fault, WheelFriction):
            wheels.coulomb[j, w] += sign * fault.coulomb_n_m
            wheels.viscous[j, w] += sign * fault.viscous_n_m_s
            words.append(f"wheel {w + 1}: {fault.coulomb_n_m:g} N m, {fault.viscous_n_m_s:g} N m s/rad more")
    return "; ".join(words)


def reallocate(wheels: WheelState, entry: ScheduledFault, axes_B: Array) -> str:
    """Leave the failed wheels out from now on; returns what is left in words."""
    healthy = wheels.healthy[entry.spacecraft]
    healthy[list(entry.wheels)] = False
    wheels.allocation[entry.spacecraft] = allocate(axes_B, healthy)
    rank = int(np.linalg.matrix_rank(axes_B[healthy])) if healthy.any() else 0
    return f"torque shared by {healthy.sum()} wheels, control about {rank} axes"


@lru_cache(maxsize=8)
def _allocation_to_all(axes_B: bytes) -> Array:
    """See `allocate`, with all wheels healthy; the axes as the bytes of their array."""
    axes = np.frombuffer(axes_B).reshape(-1, 3)
    return allocate(axes, np.ones(len(axes), np.bool_))


@allocation_free
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
    for j in range(speed.shape[0]):
        L, (fastest, strongest, holds) = vector(torque_B, j), vector(peaks, j)  # in the order of `Peak`
        cut = False
        for w in range(speed.shape[1]):
            turning, J = speed[j, w], wheels.inertia[j, w]
            asked = dot((wheels.allocation[j, w, 0], wheels.allocation[j, w, 1], wheels.allocation[j, w, 2]), L)
            u = limited(asked, turning, period / J, max_torque, max_speed)
            cut |= u != asked
            u = u * (0.0 if dead[j] else wheels.effectiveness[j, w])
            friction = 0.0
            if wheels.stuck[j, w]:
                brake = (wheels.stuck_speed[j, w] - turning) * J / period
                u = min(max_torque, max(-max_torque, brake))
            else:
                friction = friction_torque(turning, u, wheels.coulomb[j, w], wheels.viscous[j, w], J, period)
            wheels.motor[j, w], wheels.bearing[j, w] = u, friction
            fastest, strongest = max(fastest, abs(turning)), max(strongest, abs(u))
        put_vector(peaks, j, (fastest, strongest, holds + 1.0 if cut and not dead[j] else holds))
