"""Data on their way to Earth: over the links that are closed at the end of a step, taken to be so for the whole step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.dataflow.contacts import Radios, radios_from
from swarm_mj.dataflow.ground import listening_station
from swarm_mj.dataflow.link_budget import RateTable, rate_at
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import Plan, antennas_from
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import Beams, Bearing, link_closed
from swarm_mj.scenarios.constants import DAY, SPEED_OF_LIGHT
from swarm_mj.smallbody.ephemeris import julian_date
from swarm_mj.smallbody.occultation import Occluder
from swarm_mj.typing import Array, Mask, jittable, lean

from .kinematics import Kinematics, Tracking
from .totals import EpisodeTotals, room

_SPACECRAFT, _EARTH = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH)


class RadioConstants(NamedTuple):
    """What all radio links share.

    Attributes:
        beams: Of the antennas.
        earth_r_N: Position of Earth at the epoch, shape (3,) [m].
        earth_v_N: Its velocity, taken as constant, shape (3,) [m/s].
        step_s: Length of a step [s].
        swarm: Rates from a spacecraft to another by distance.
        earth_bit: Most that Earth can hear in the step that ends at the k-th one's end, of all spacecraft together, shape (k,)
            [bit].
        storage_bit: Most that a spacecraft holds [bit].
    """

    beams: Beams
    earth_r_N: Array
    earth_v_N: Array
    step_s: float
    swarm: RateTable
    earth_bit: Array
    storage_bit: float


def swarm_rates(plan: Plan, rate_bit_s: float | None) -> RateTable:
    """Rates between two spacecraft by distance: the one given at all distances, or None for the scenario's link budget."""
    if rate_bit_s is not None:
        return RateTable(np.array([np.inf]), np.array([float(rate_bit_s)]))
    return _radios(plan).swarm


def earth_rates(plan: Plan, rate_bit_s: float | None, times: Array) -> Array:
    """Rates to Earth, shape (t,) [bit/s]: the one given, or None for what the best station that sees the body hears.

    The way from the body stands for that from each spacecraft, which differs by less than a millionth for most missions.

    Args:
        plan: The mission.
        rate_bit_s: See above.
        times: Past the epoch, shape (t,) [s].

    Raises:
        ScenarioError: No station ever hears anything.
    """
    if rate_bit_s is not None:
        return np.full(len(times), float(rate_bit_s))
    earth_N = np.array([plan.environment.earth.at(t) for t in times])
    distance = np.linalg.norm(earth_N, axis=1)
    heard_jd = julian_date(plan.scenario.epoch) + (times + distance / SPEED_OF_LIGHT) / DAY
    station, tables = listening_station(plan.scenario.link.ground, heard_jd, -earth_N), _radios(plan).earth
    rates = np.array([rate_at(tables[s], d) if s >= 0 else 0.0 for s, d in zip(station, distance, strict=True)])
    if not rates.any():
        raise ScenarioError(
            "earth_rate_bit_s = None: no station of link.ground hears link.earth at any time of the flight; allowed: None "
            "where one does, or a rate > 0 [bit/s]; lower link.ground.min_elevation_deg, or give a rate"
        )
    return rates


def _radios(plan: Plan) -> Radios:
    return radios_from(plan.scenario.link, antennas_from(plan.scenario).beams)


@lean
def transmit(
    constants: RadioConstants,
    body: Occluder,
    now: Kinematics,
    tracking: Tracking,
    totals: EpisodeTotals,
    live: Mask,
    received: Array,
) -> None:
    """Send data to whom the spacecraft track, and to Earth.

    Args:
        constants: See `RadioConstants`.
        body: The asteroid, which may stand in between.
        now: At the end of the step.
        tracking: Who tracks whom.
        totals: Data aboard and delivered, and closed links, are written to.
        live: Which flights, shape (E,).
        received: Receives what Earth received in the step, shape (E,) [bit].
    """
    for e in range(live.shape[0]):
        received[e] = 0.0
        if live[e]:
            r, v, t = constants.earth_r_N, constants.earth_v_N, now.t[e]
            earth_N = (r[0] + t * v[0], r[1] + t * v[1], r[2] + t * v[2])
            place = Bearing(now.r[e], now.C_BN[e], now.C_AN[e], earth_N)
            for j in range(totals.closed.shape[1]):
                kind, whom = tracking.kind[e, j], tracking.spacecraft[e, j]
                totals.closed[e, j] = link_closed(constants.beams, body, place, kind, whom, j)
            _send_to_spacecraft(constants, now, tracking, totals, e)
            received[e] = _send_to_earth(constants, now, tracking, totals, e)
            totals.delivered[e] += received[e]


@lean
def _send_to_spacecraft(
    constants: RadioConstants, now: Kinematics, tracking: Tracking, totals: EpisodeTotals, e: int
) -> None:
    closed, stored, lost, kind = totals.closed[e], totals.stored[e], totals.lost[e], tracking.kind[e]
    for j in range(kind.shape[0]):
        to = tracking.spacecraft[e, j]
        if lost[j] or (kind[j] == _SPACECRAFT and lost[to]):
            closed[j] = False
        if closed[j] and kind[j] == _SPACECRAFT:
            rate = rate_at(constants.swarm, _distance(now, e, j, to))
            closed[j] = rate > 0.0
            sent = min(stored[j], rate * constants.step_s, room(totals, e, to, constants.storage_bit))
            stored[j] -= sent
            stored[to] += sent


@lean
def _send_to_earth(
    constants: RadioConstants, now: Kinematics, tracking: Tracking, totals: EpisodeTotals, e: int
) -> float:
    """Earth hears one spacecraft at a time, in gene order; returns what it received [bit]."""
    closed, stored, kind = totals.closed[e], totals.stored[e], tracking.kind[e]
    step = min(int(round(now.t[e] / constants.step_s)), constants.earth_bit.shape[0] - 1)
    earth_bit, received = constants.earth_bit[step], 0.0
    for j in range(kind.shape[0]):
        if closed[j] and kind[j] == _EARTH:
            closed[j] = earth_bit > 0.0
            sent = min(stored[j], earth_bit - received)
            stored[j] -= sent
            received += sent
    return received


@jittable
def _distance(now: Kinematics, e: int, j: int, to: int) -> float:
    x, y, z = now.r[e, to, 0] - now.r[e, j, 0], now.r[e, to, 1] - now.r[e, j, 1], now.r[e, to, 2] - now.r[e, j, 2]
    return float(np.sqrt(x * x + y * y + z * z))
