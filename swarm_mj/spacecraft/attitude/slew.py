"""Minimum-time turns about one axis: bang-bang, with a coast between where a rate limit is reached first.

From rest to rest over an angle theta with acceleration a and rate limit w: 2 sqrt(theta / a) where theta <= w^2 / a, else
theta / w + w / a. What the wheels give is a torque and a momentum, so that a = torque / J and w = momentum / J.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import NamedTuple

import numpy as np

from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array

#: Directions across +z in which the wheels' envelope is looked at.
DIRECTIONS = 180


class Turning(NamedTuple):
    """What the wheels can give about an axis across +z: an acceleration [rad/s^2] and a rate [rad/s], from rest."""

    acceleration: float
    rate: float


def turning_limits(properties: SpacecraftProperties) -> tuple[Turning, Turning]:
    """What the wheels give about every axis across +z (the worst of them), and about none of them more (the best)."""
    angle = np.arange(DIRECTIONS) * pi / DIRECTIONS
    across = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(DIRECTIONS)))
    axes, J = properties.wheel_axes_B, properties.inertia_effective_B
    needed = across @ J
    # By the pseudo-inverse, as motors are commanded; and by all wheels together, each as far as it can.
    certain = (1.0 / np.abs(needed @ np.linalg.pinv(axes)).max(axis=1)).min()
    utmost = (np.abs(across @ axes.T).sum(axis=1) / np.einsum("ij,ij->i", needed, across)).max()
    momentum = properties.wheel_spin_inertia * properties.max_wheel_speed
    worst, best = (
        Turning(float(share * properties.max_wheel_torque), float(share * momentum)) for share in (certain, utmost)
    )
    return worst, best


def turning_about(axis_B: Array, properties: SpacecraftProperties) -> Turning:
    """What the wheels give about a unit axis in B, from rest, as motors are commanded."""
    needed = properties.inertia_effective_B @ axis_B
    share = 1.0 / float(np.abs(needed @ np.linalg.pinv(properties.wheel_axes_B)).max())
    momentum = properties.wheel_spin_inertia * properties.max_wheel_speed
    return Turning(share * properties.max_wheel_torque, share * momentum)


def slew_time(angle: float, limits: Turning) -> float:
    """Shortest time of a turn from rest to rest over an angle [rad] about one axis [s]."""
    if angle <= limits.rate**2 / limits.acceleration:
        return 2.0 * sqrt(angle / limits.acceleration)
    return angle / limits.rate + limits.rate / limits.acceleration


def slew_profile(angle: float, limits: Turning, t: float) -> tuple[float, float, float]:
    """The minimum-time turn at a time after its start: angle still to go [rad], its rate [rad/s] and acceleration [rad/s^2].

    Args:
        angle: Of the whole turn [rad].
        limits: Within which it is made.
        t: Since its start [s].
    """
    a, end = limits.acceleration, slew_time(angle, limits)
    if t >= end or angle <= 0.0:
        return 0.0, 0.0, 0.0
    ramp = min(sqrt(angle / a), limits.rate / a)
    if t < ramp:
        return angle - 0.5 * a * t * t, -a * t, -a
    if t < end - ramp:
        return angle - 0.5 * a * ramp * ramp - a * ramp * (t - ramp), -a * ramp, 0.0
    left = end - t
    return 0.5 * a * left * left, -a * left, a


def rotation_about(axis: Array, angle: float) -> Array:
    """Quaternion (w, x, y, z) of a turn about a unit axis by an angle [rad]."""
    return np.concatenate(([np.cos(0.5 * angle)], np.sin(0.5 * angle) * axis))
