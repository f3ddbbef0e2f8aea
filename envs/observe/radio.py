"""What happens between two instants of a flight: data move over closed links, and who meets the body is lost.

The instants are those of the pictures and of the decisions, whatever the length of a decision is. A link carries the mean of
what it would at both ends, under the targets that are held meanwhile: one that closes on the way carries half, as it does in
the mean over when it closes. Rates and what moves are those of `swarm_mj.dataflow`; here data are one product, and the first in
gene order sends first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import allocation_free, kernel
from swarm_mj.dataflow.contacts import Instant, Radios, crosslink_rate, earth_rate, radios_from
from swarm_mj.dataflow.ground import earth_schedule
from swarm_mj.dataflow.link_budget import RateTable, rate_at
from swarm_mj.dataflow.network import EARTH, Access
from swarm_mj.dataflow.transfer import NOBODY, LinkRules, carry, link_rules
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import Plan, antennas_from
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.smallbody.occultation import Occluder, occluder_of, way_blocked
from swarm_mj.typing import Array, Ints, Mask

from .kinematics import Kinematics, PerMission, Tracking
from .totals import EpisodeTotals

_SPACECRAFT, _EARTH = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH)
#: Crosslinks are in use in parallel, and Earth hears one spacecraft at a time.
RULES = link_rules(Access.PARALLEL, half_duplex=False, channels=1)
#: Most that a link carries at once, so that any rate that is given stays a whole number [bit].
_MOST_BIT = 2.0**61


class RadioConstants(NamedTuple):
    """What all radio links share.

    Attributes:
        body: The asteroid, which may stand in between and is hit.
        radios: Antennas and rates.
        rules: How links share time.
        earth_r_N: Position of Earth at the epoch, shape (3,) [m].
        earth_v_N: Its velocity, taken as constant, shape (3,) [m/s].
        spacing_s: Between the times of `station` [s].
        station: Which station hears at the k-th time, the first at the epoch, -1 for none, shape (k,).
        storage_bit: Most that a spacecraft holds [bit].
    """

    body: Occluder
    radios: Radios
    rules: LinkRules
    earth_r_N: Array
    earth_v_N: Array
    spacing_s: float
    station: Ints
    storage_bit: int


def radio_constants(
    plan: Plan, times: Array, *, swarm_rate_bit_s: float | None, earth_rate_bit_s: float | None
) -> RadioConstants:
    """The radio links of a mission.

    Args:
        plan: The mission.
        times: Past the epoch, evenly spaced, the first at 0, shape (k,) [s].
        swarm_rate_bit_s: Between two spacecraft at all distances; None: what the scenario's link budget closes.
        earth_rate_bit_s: To Earth; None: what the best station that sees the body hears.

    Raises:
        ScenarioError: No station ever hears anything.
    """
    scenario, earth = plan.scenario, plan.environment.earth
    radios = radios_from(scenario.link, antennas_from(scenario))
    if swarm_rate_bit_s is not None:
        radios = radios._replace(swarm=RateTable(np.array([np.inf]), np.array([float(swarm_rate_bit_s)])))
    if earth_rate_bit_s is None:
        station = _station_in_view(plan, radios, times)
    else:
        radios = radios._replace(earth=RateTable(np.array([[np.inf]]), np.array([[float(earth_rate_bit_s)]])))
        station = np.zeros(len(times), np.int64)
    return RadioConstants(
        body=occluder_of(plan.shape),
        radios=radios,
        rules=RULES,
        earth_r_N=np.array(earth.position, np.float64),
        earth_v_N=np.array(earth.velocity, np.float64),
        spacing_s=float(times[1] - times[0]),
        station=station,
        storage_bit=int(scenario.data.storage_bit),
    )


def _station_in_view(plan: Plan, radios: Radios, times: Array) -> Ints:
    """Which station sees the body, which stands for all spacecraft, at each time, shape (k,)."""
    earth_N = np.array([plan.environment.earth.at(t) for t in times])
    station = earth_schedule(plan.scenario.link.ground, plan.scenario.epoch, times, np.zeros(3), earth_N).station
    tables = [RateTable(*rows) for rows in zip(*radios.earth, strict=True)]
    distance = np.linalg.norm(earth_N, axis=1)
    if not any(s >= 0 and rate_at(tables[s], d) > 0.0 for s, d in zip(station, distance, strict=True)):
        raise ScenarioError(
            "earth_rate_bit_s = None: no station of link.ground hears link.earth at any time of the flight; allowed: None "
            "where one does, or a rate > 0 [bit/s]; lower link.ground.min_elevation_deg, or give a rate"
        )
    return station


@kernel
def pass_interval(
    constants: PerMission[RadioConstants],
    mission: Ints,
    before: Kinematics,
    now: Kinematics,
    tracking: Tracking,
    downlink: Mask,
    totals: EpisodeTotals,
    live: Mask,
    hit: Mask,
) -> None:
    """Let the live flights come from one instant to the next: send data, see `transmit`, and lose who hits the body on the way.

    `constants` are by mission, `mission` that of each flight, shape (E,). `hit` receives who hits the body, the way there being
    taken as straight, shape (E, n).
    """
    mine = np.empty(live.shape[0], np.bool_)
    for m in range(len(constants)):
        some = False
        for e in range(live.shape[0]):
            mine[e] = live[e] and mission[e] == m
            some = some or mine[e]
        if some:
            of = constants[m]
            transmit(of, before, now, tracking, downlink, totals, mine)
            for e in range(live.shape[0]):
                if mine[e]:
                    _hits(of.body, before.r_A[e], now.r_A[e], totals.lost[e], hit[e])


@allocation_free
def _hits(body: Occluder, before_A: Array, now_A: Array, lost: Mask, hit: Mask) -> None:
    for j in range(lost.shape[0]):
        hit[j] = not lost[j] and way_blocked(before_A[j], now_A[j], body)
        lost[j] = lost[j] or hit[j]


@kernel
def transmit(
    constants: RadioConstants,
    before: Kinematics,
    now: Kinematics,
    tracking: Tracking,
    downlink: Mask,
    totals: EpisodeTotals,
    live: Mask,
) -> None:
    """Send the data of E flights to whom their spacecraft track, and to Earth, from one instant to the next.

    It reads (t, r, C_BN, C_AN) of both instants, `tracking` (kind, spacecraft) and `totals.lost`, and writes `totals.closed`,
    `totals.stored` and `totals.delivered`, whole numbers of bits. What a spacecraft receives it can send on from the second
    instant on.

    Args:
        constants: See `radio_constants`.
        before: At the beginning.
        now: At the end, where links count as closed or not.
        tracking: Who tracks whom meanwhile.
        downlink: Whose link to Earth works, shape (E, n).
        totals: Data aboard and delivered, and closed links, are written to.
        live: Which flights, shape (E,).
    """
    n = totals.closed.shape[1]
    capacity, storage, rate = np.zeros((n, n + 1), np.int64), np.full(n, constants.storage_bit), np.zeros((2, n))
    to, queue, hold, moved = (
        np.zeros(n, np.int64),
        np.zeros((n, 2), np.int64),
        np.zeros((n, 1), np.int64),
        np.zeros(n, np.int64),
    )
    everybody, works = np.ones(n), np.empty(n, np.bool_)
    for j in range(n):
        queue[j, 0] = j
    for e in range(live.shape[0]):
        if live[e]:
            for j in range(n):
                works[j] = not totals.lost[e, j]
            _rates(constants, before, tracking, works, e, rate[0])
            _rates(constants, now, tracking, works, e, rate[1])
            kind, whom = tracking.kind[e], tracking.spacecraft[e]
            for j in range(n):
                rate[:, j] *= downlink[e, j] or kind[j] != _EARTH
                to[j] = whom[j] if kind[j] == _SPACECRAFT else (EARTH if kind[j] == _EARTH else NOBODY)
                totals.closed[e, j] = rate[1, j] > 0.0
                if to[j] != NOBODY:
                    bits = 0.5 * (rate[0, j] + rate[1, j]) * (now.t[e] - before.t[e])
                    capacity[j, to[j]] = np.int64(min(bits, _MOST_BIT))
                hold[j, 0] = np.int64(totals.stored[e, j])
            carry(constants.rules, capacity, everybody, to, queue, storage, hold, moved)
            for j in range(n):
                totals.stored[e, j] = hold[j, 0]
                totals.delivered[e, j] += moved[j] if to[j] == EARTH else 0


@kernel
def _rates(constants: RadioConstants, at: Kinematics, tracking: Tracking, works: Mask, e: int, rate: Array) -> None:
    """Write at which rate each spacecraft of flight e would send to whom it tracks at an instant, shape (n,) [bit/s]."""
    earth_N = constants.earth_r_N + at.t[e] * constants.earth_v_N
    kind, whom = tracking.kind[e], tracking.spacecraft[e]
    place = Instant(at.r[e], at.C_BN[e], at.C_AN[e], earth_N, kind, whom, works)
    station = constants.station[min(int(round(at.t[e] / constants.spacing_s)), constants.station.shape[0] - 1)]
    for j in range(rate.shape[0]):
        rate[j] = 0.0
        if kind[j] == _SPACECRAFT:
            rate[j], _ = crosslink_rate(constants.radios, constants.body, place, j, whom[j])
        elif kind[j] == _EARTH:
            rate[j], _ = earth_rate(constants.radios, constants.body, place, station, j)
