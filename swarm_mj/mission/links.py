"""Radio links of the swarm: which are closed at each sample of a flight, and what stands in the way of the others.

A spacecraft that tracks the communications spacecraft talks to it: with omnidirectional antennas whichever way they are turned,
or with the dish along its +z, which the other hears through its hemispherical antenna. A spacecraft that tracks Earth talks to
Earth with its dish. A link is closed when it is in range, both antennas have the other end inside their beams, and the asteroid
is not in between.
"""

from __future__ import annotations

from enum import IntEnum
from math import atan2, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import jittable, kernel
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.smallbody.occultation import Occluder, occluder_of, way_blocked
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.attitude.algebra import Vector, combine, cross, dot, scaled, times, vector
from swarm_mj.typing import Array, Ints, Mask

_SPACECRAFT, _EARTH = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH)


class Obstacle(IntEnum):
    """What keeps a link from closing; the first that holds, in this order."""

    NONE = 0  #: the link is closed
    LOST = 1  #: an end no longer works
    ROLE = 2  #: the sender does not turn to the other end
    POINTING = 3  #: an end has no control of its attitude any more
    RANGE = 4
    BEAM = 5  #: the other end is outside an antenna's beam
    BODY = 6  #: the asteroid is in between
    STATION = 7  #: no station on Earth sees the spacecraft


_NONE, _RANGE, _BEAM, _BODY = (int(o) for o in (Obstacle.NONE, Obstacle.RANGE, Obstacle.BEAM, Obstacle.BODY))


class Antennas(NamedTuple):
    """The antennas of every spacecraft, as compiled code takes them.

    Attributes:
        dish_half_angle: Half the beam of the antenna along +z [rad].
        hemispherical_boresight_B: Axis of the inter-satellite antenna in B, unit vector, shape (3,).
        hemispherical_half_angle: Half its beam [rad].
        max_range: Of an inter-satellite link [m].
        omnidirectional: Whether both ends of an inter-satellite link send and hear in all directions instead.
    """

    dish_half_angle: float
    hemispherical_boresight_B: Array
    hemispherical_half_angle: float
    max_range: float
    omnidirectional: bool = False


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
        antennas: Of every spacecraft.
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
    closed, body = np.zeros(mode.shape, np.bool_), occluder_of(shape)
    for k in range(len(mode)):
        closed[k] = closed_links(
            antennas,
            body,
            mode[k].astype(np.int64),
            tracked[k].astype(np.int64),
            np.ascontiguousarray(r_BN_N[k], np.float64),
            np.ascontiguousarray(C_BN[k], np.float64),
            np.ascontiguousarray(C_AN[k], np.float64),
            np.ascontiguousarray(earth_N[k], np.float64),
        )
    return closed


@kernel
def closed_links(
    beams: Antennas, body: Occluder, mode: Ints, tracked: Ints, r_N: Array, C_BN: Array, C_AN: Array, earth_N: Array
) -> Mask:
    """Which spacecraft have their link closed at one instant, compiled.

    Args:
        beams: Of the antennas.
        body: The asteroid, which may stand in between.
        mode: `TargetKind` values, shape (n,).
        tracked: Spacecraft tracked, from 0, shape (n,).
        r_N: Positions, shape (n, 3) [m].
        C_BN: Attitudes, shape (n, 3, 3).
        C_AN: Attitude of the asteroid, shape (3, 3).
        earth_N: Position of Earth, shape (3,) [m].

    Returns:
        Shape (n,).
    """
    closed = np.zeros(mode.shape[0], np.bool_)
    place = Bearing(r_N, C_BN, C_AN, (earth_N[0], earth_N[1], earth_N[2]))
    for j in range(mode.shape[0]):
        closed[j] = link_closed(beams, body, place, mode[j], tracked[j], j)
    return closed


class Bearing(NamedTuple):
    """Where n spacecraft and Earth are at one instant, and how all is turned.

    Attributes:
        r_N: Positions, shape (n, 3) [m].
        C_BN: Attitudes, shape (n, 3, 3).
        C_AN: Attitude of the asteroid, shape (3, 3).
        earth_N: Position of Earth [m].
    """

    r_N: Array
    C_BN: Array
    C_AN: Array
    earth_N: Vector


@kernel
def link_closed(beams: Antennas, body: Occluder, place: Bearing, mode: int, tracked: int, j: int) -> bool:
    """Whether spacecraft j, which tracks what `mode` says, has its link closed; arguments as of `closed_links`."""
    if mode == _SPACECRAFT:
        return bool(obstacle_between(beams, body, place.r_N, place.C_BN, place.C_AN, j, tracked) == _NONE)
    if mode == _EARTH:
        return bool(obstacle_to_earth(beams, body, place.r_N, place.C_BN, place.C_AN, place.earth_N, j) == _NONE)
    return False


@kernel
def obstacle_between(
    beams: Antennas, body: Occluder, r_N: Array, C_BN: Array, C_AN: Array, sender: int, receiver: int
) -> int:
    """`Obstacle` on the way from one spacecraft, which tracks the other, to that other; arguments as of `closed_links`."""
    start, end = vector(r_N, sender), vector(r_N, receiver)
    way = combine(1.0, end, -1.0, start)
    if not _length(way) <= beams.max_range:
        return _RANGE
    if not beams.omnidirectional:
        dish, axis_B = (C_BN[sender, 2, 0], C_BN[sender, 2, 1], C_BN[sender, 2, 2]), beams.hemispherical_boresight_B
        boresight = times(C_BN[receiver].T, (axis_B[0], axis_B[1], axis_B[2]))
        heard = _within(way, dish, beams.dish_half_angle)
        if not (heard and _within(scaled(-1.0, way), boresight, beams.hemispherical_half_angle)):
            return _BEAM
    return _BODY if way_blocked(times(C_AN, start), times(C_AN, end), body) else _NONE


@kernel
def obstacle_to_earth(
    beams: Antennas, body: Occluder, r_N: Array, C_BN: Array, C_AN: Array, earth_N: Vector, sender: int
) -> int:
    """`Obstacle` on the way from a spacecraft, which tracks Earth, to Earth; arguments as of `closed_links`."""
    start, dish = vector(r_N, sender), (C_BN[sender, 2, 0], C_BN[sender, 2, 1], C_BN[sender, 2, 2])
    way = (earth_N[0] - start[0], earth_N[1] - start[1], earth_N[2] - start[2])
    if not _within(way, dish, beams.dish_half_angle):
        return _BEAM
    # Beyond a few radii the body can hide nothing more; the full way to Earth would cost the test its precision.
    end = combine(1.0, start, (4.0 * body.max_radius + 2.0 * _length(start)) / _length(way), way)
    return _BODY if way_blocked(times(C_AN, start), times(C_AN, end), body) else _NONE


@jittable
def _within(direction: Vector, axis: Vector, half_angle: float) -> bool:
    return atan2(_length(cross(direction, axis)), dot(direction, axis)) <= half_angle


@jittable
def _length(v: Vector) -> float:
    return sqrt(dot(v, v))
