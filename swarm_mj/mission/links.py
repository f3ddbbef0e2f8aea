"""Radio links of the swarm: which are closed at each sample of a flight.

A spacecraft that tracks the communications spacecraft talks to it with the dish along its +z; the other hears it through
its hemispherical antenna. A spacecraft that tracks Earth talks to Earth with its dish. A link is closed when it is in range,
both antennas have the other end inside their beams, and the asteroid is not in between. Spacecraft that observe do not talk.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.smallbody.occultation import segments_blocked
from swarm_mj.smallbody.shape import ShapeModel

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Antennas:
    """The antennas of every spacecraft.

    Attributes:
        dish_half_angle: Half the beam of the antenna along +z [rad].
        hemispherical_boresight_B: Axis of the inter-satellite antenna in B, shape (3,).
        hemispherical_half_angle: Half its beam [rad].
        max_range: Of an inter-satellite link [m].
    """

    dish_half_angle: float
    hemispherical_boresight_B: Array
    hemispherical_half_angle: float
    max_range: float


def links_closed(
    *,
    antennas: Antennas,
    shape: ShapeModel,
    mode: NDArray[np.int8],
    tracked: NDArray[np.int16],
    r_BN_N: Array,
    C_BN: Array,
    C_AN: Array,
    earth_N: Array,
) -> NDArray[np.bool_]:
    """Which spacecraft have their link closed.

    Args:
        antennas: See `Antennas`.
        shape: The asteroid, which may stand in between.
        mode: `TargetKind` values, shape (t, n).
        tracked: Number of the spacecraft tracked, counted from 0, shape (t, n); read where mode is SPACECRAFT.
        r_BN_N: Positions, shape (t, n, 3) [m].
        C_BN: Attitudes, shape (t, n, 3, 3).
        C_AN: Attitude of the asteroid, shape (t, 3, 3).
        earth_N: Position of Earth, shape (t, 3) [m].

    Returns:
        Shape (t, n).
    """
    closed = np.zeros(mode.shape, bool)
    k, j = np.nonzero(mode == TargetKind.SPACECRAFT)
    c = tracked[k, j]
    to_relay = r_BN_N[k, c] - r_BN_N[k, j]
    boresight = np.einsum("i,kij->kj", unit(antennas.hemispherical_boresight_B), C_BN[k, c])
    heard = within(to_relay, C_BN[k, j, 2], antennas.dish_half_angle)
    heard &= within(-to_relay, boresight, antennas.hemispherical_half_angle)
    heard &= np.linalg.norm(to_relay, axis=1) <= antennas.max_range
    closed[k, j] = heard & ~_blocked(shape, C_AN[k], r_BN_N[k, j], r_BN_N[k, c])

    k, j = np.nonzero(mode == TargetKind.EARTH)
    to_earth = earth_N[k] - r_BN_N[k, j]
    # Beyond a few radii the body can hide nothing more; the full way to Earth would cost the test its precision.
    horizon = (
        r_BN_N[k, j] + unit(to_earth) * (4.0 * shape.max_radius + 2.0 * np.linalg.norm(r_BN_N[k, j], axis=1))[:, None]
    )
    heard = within(to_earth, C_BN[k, j, 2], antennas.dish_half_angle)
    closed[k, j] = heard & ~_blocked(shape, C_AN[k], r_BN_N[k, j], horizon)
    return closed


def within(direction: Array, axis: Array, half_angle: float) -> NDArray[np.bool_]:
    """Whether directions (m, 3) lie within `half_angle` [rad] of axes (m, 3); a zero direction counts as inside."""
    cross = np.linalg.norm(np.cross(direction, axis), axis=-1)
    return np.arctan2(cross, np.einsum("...i,...i", direction, axis)) <= half_angle


def unit(vectors: Array) -> Array:
    """Vectors scaled to unit length along the last axis."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _blocked(shape: ShapeModel, C_AN: Array, start_N: Array, end_N: Array) -> NDArray[np.bool_]:
    start, end = np.einsum("kij,kj->ki", C_AN, start_N), np.einsum("kij,kj->ki", C_AN, end_N)
    return segments_blocked(start, end, shape.vertices, shape.faces, shape.max_radius)
