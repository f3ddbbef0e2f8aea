"""Radio links of the swarm: which are closed at each sample of a flight.

A spacecraft that tracks the communications spacecraft talks to it with the dish along its +z; the other hears it through
its hemispherical antenna. A spacecraft that tracks Earth talks to Earth with its dish. A link is closed when it is in range,
both antennas have the other end inside their beams, and the asteroid is not in between. Spacecraft that observe do not talk.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, sqrt

import numpy as np
from numpy.typing import NDArray

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.smallbody.occultation import way_blocked
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array, Ints, Ints32, Mask, kernel

_SPACECRAFT, _EARTH = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH)


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

    @property
    def numbers(self) -> Array:
        """Half the beams of dish and hemispherical antenna [rad], range [m], axis of the latter in B, for compiled loops."""
        beams = [self.dish_half_angle, self.hemispherical_half_angle, self.max_range]
        return np.concatenate([beams, unit(np.asarray(self.hemispherical_boresight_B, np.float64))])


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
) -> Mask:
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
    closed = np.zeros(mode.shape, np.bool_)
    box = np.array([shape.vertices.min(axis=0), shape.vertices.max(axis=0)])
    for k in range(len(mode)):
        write_closed(
            antennas.numbers,
            shape.vertices,
            shape.faces,
            box,
            shape.max_radius,
            mode[k].astype(np.int64),
            tracked[k].astype(np.int64),
            np.ascontiguousarray(r_BN_N[k], np.float64),
            np.ascontiguousarray(C_BN[k], np.float64),
            np.ascontiguousarray(C_AN[k], np.float64),
            np.ascontiguousarray(earth_N[k], np.float64),
            closed[k],
        )
    return closed


@kernel
def write_closed(
    antennas: Array,
    vertices: Array,
    faces: Ints32,
    box: Array,
    radius: float,
    mode: Ints,
    tracked: Ints,
    r_N: Array,
    C_BN: Array,
    C_AN: Array,
    earth_N: Array,
    closed: Mask,
) -> None:
    """Which spacecraft have their link closed at one instant, compiled.

    Args:
        antennas: See `Antennas.numbers`.
        vertices: The asteroid's mesh, shape (V, 3) [m].
        faces: Shape (F, 3).
        box: Least and largest coordinates of the mesh, shape (2, 3) [m].
        radius: Largest vertex radius [m].
        mode: `TargetKind` values, shape (n,).
        tracked: Spacecraft tracked, from 0, shape (n,).
        r_N: Positions, shape (n, 3) [m].
        C_BN: Attitudes, shape (n, 3, 3).
        C_AN: Attitude of the asteroid.
        earth_N: Position of Earth, shape (3,) [m].
        closed: Receives the answer, shape (n,).
    """
    for j in range(mode.shape[0]):
        closed[j] = False
        if mode[j] == _SPACECRAFT:
            c = tracked[j]
            way = r_N[c] - r_N[j]
            heard = _within(way, C_BN[j, 2], antennas[0])
            boresight = antennas[3] * C_BN[c, 0] + antennas[4] * C_BN[c, 1] + antennas[5] * C_BN[c, 2]
            heard = heard and _within(-way, boresight, antennas[1]) and _length(way) <= antennas[2]
            end = r_N[c]
        elif mode[j] == _EARTH:
            way = earth_N - r_N[j]
            heard = _within(way, C_BN[j, 2], antennas[0])
            # Beyond a few radii the body can hide nothing more; the full way to Earth would cost the test its precision.
            end = r_N[j] + way * ((4.0 * radius + 2.0 * _length(r_N[j])) / _length(way))
        else:
            continue
        if heard:
            closed[j] = not way_blocked(_turned(C_AN, r_N[j]), _turned(C_AN, end), vertices, faces, box)


@kernel
def _within(direction: Array, axis: Array, half_angle: float) -> bool:
    x = direction[1] * axis[2] - direction[2] * axis[1]
    y = direction[2] * axis[0] - direction[0] * axis[2]
    z = direction[0] * axis[1] - direction[1] * axis[0]
    along = direction[0] * axis[0] + direction[1] * axis[1] + direction[2] * axis[2]
    return atan2(sqrt(x * x + y * y + z * z), along) <= half_angle


@kernel
def _length(v: Array) -> float:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@kernel
def _turned(C: Array, v: Array) -> Array:
    out = np.empty(3)
    for k in range(3):
        out[k] = C[k, 0] * v[0] + C[k, 1] * v[1] + C[k, 2] * v[2]
    return out


def within(direction: Array, axis: Array, half_angle: float) -> Mask:
    """Whether directions (m, 3) lie within `half_angle` [rad] of axes (m, 3); a zero direction counts as inside."""
    cross = np.linalg.norm(np.cross(direction, axis), axis=-1)
    return np.arctan2(cross, np.einsum("...i,...i", direction, axis)) <= half_angle


def unit(vectors: Array) -> Array:
    """Vectors scaled to unit length along the last axis."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
