"""Data on their way to Earth: over the links that are closed at the end of a step, taken to be so for the whole step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import Beams, closed_links
from swarm_mj.smallbody.occultation import Occluder
from swarm_mj.typing import Array, Mask, kernel

from .kinematics import Kinematics, Tracking
from .totals import EpisodeTotals

_SPACECRAFT, _EARTH = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH)


class RadioConstants(NamedTuple):
    """What all radio links share.

    Attributes:
        beams: Of the antennas.
        earth_r_N: Position of Earth at the epoch, shape (3,) [m].
        earth_v_N: Its velocity, taken as constant, shape (3,) [m/s].
        swarm_bit: Most that a spacecraft can send to another in a step [bit].
        earth_bit: Most that Earth can hear in a step, of all spacecraft together [bit].
    """

    beams: Beams
    earth_r_N: Array
    earth_v_N: Array
    swarm_bit: float
    earth_bit: float


@kernel
def transmit(
    constants: RadioConstants,
    body: Occluder,
    now: Kinematics,
    tracking: Tracking,
    totals: EpisodeTotals,
    live: Mask,
) -> Array:
    """Send data to whom the spacecraft track, and to Earth.

    Args:
        constants: See `RadioConstants`.
        body: The asteroid, which may stand in between.
        now: At the end of the step.
        tracking: Who tracks whom.
        totals: Data aboard and delivered, and closed links, are written to.
        live: Which flights, shape (E,).

    Returns:
        What Earth received in the step, shape (E,) [bit].
    """
    received = np.zeros(live.shape[0])
    for e in range(live.shape[0]):
        if live[e]:
            earth_N = constants.earth_r_N + now.t[e] * constants.earth_v_N
            totals.closed[e] = closed_links(
                constants.beams,
                body,
                tracking.kind[e],
                tracking.spacecraft[e],
                now.r[e],
                now.C_BN[e],
                now.C_AN[e],
                earth_N,
            )
            _send_to_spacecraft(constants, tracking, totals, e)
            received[e] = _send_to_earth(constants, tracking, totals, e)
            totals.delivered[e] += received[e]
    return received


@kernel
def _send_to_spacecraft(constants: RadioConstants, tracking: Tracking, totals: EpisodeTotals, e: int) -> None:
    closed, stored, lost, kind = totals.closed[e], totals.stored[e], totals.lost[e], tracking.kind[e]
    for j in range(kind.shape[0]):
        to = tracking.spacecraft[e, j]
        if lost[j] or (kind[j] == _SPACECRAFT and lost[to]):
            closed[j] = False
        if closed[j] and kind[j] == _SPACECRAFT:
            sent = min(stored[j], constants.swarm_bit)
            stored[j] -= sent
            stored[to] += sent


@kernel
def _send_to_earth(constants: RadioConstants, tracking: Tracking, totals: EpisodeTotals, e: int) -> float:
    """Earth hears one spacecraft at a time, in gene order; returns what it received [bit]."""
    closed, stored, kind = totals.closed[e], totals.stored[e], tracking.kind[e]
    received = 0.0
    for j in range(kind.shape[0]):
        if closed[j] and kind[j] == _EARTH:
            sent = min(stored[j], constants.earth_bit - received)
            stored[j] -= sent
            received += sent
    return received
