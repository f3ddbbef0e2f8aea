"""Data on their way to Earth: over the links that are closed at the end of a step, taken to be so for the whole step.

Rates and what moves are those of `swarm_mj.dataflow`; here data are one product, and the first in gene order sends first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.dataflow.contacts import Instant, Radios, crosslink_rate, earth_rate, radios_from
from swarm_mj.dataflow.ground import earth_schedule
from swarm_mj.dataflow.link_budget import RateTable, rate_at
from swarm_mj.dataflow.network import EARTH, Access
from swarm_mj.dataflow.transfer import NOBODY, LinkRules, carry, link_rules
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import Plan, antennas_from
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.smallbody.occultation import Occluder
from swarm_mj.typing import Array, Ints, Mask

from .kinematics import Kinematics, Tracking
from .totals import EpisodeTotals

_SPACECRAFT, _EARTH = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH)
#: Crosslinks are in use in parallel, and Earth hears one spacecraft at a time.
RULES = link_rules(Access.PARALLEL, half_duplex=False, channels=1)
#: Most that a link carries in a step, so that any rate that is given stays a whole number [bit].
_MOST_BIT = 2.0**61


class RadioConstants(NamedTuple):
    """What all radio links share.

    Attributes:
        radios: Antennas and rates.
        rules: How links share time.
        earth_r_N: Position of Earth at the epoch, shape (3,) [m].
        earth_v_N: Its velocity, taken as constant, shape (3,) [m/s].
        step_s: Length of a step [s].
        station: Which station hears in the step that ends at the k-th one's end, -1 for none, shape (k,).
        storage_bit: Most that a spacecraft holds [bit].
    """

    radios: Radios
    rules: LinkRules
    earth_r_N: Array
    earth_v_N: Array
    step_s: float
    station: Ints
    storage_bit: int


def radio_constants(
    plan: Plan, times: Array, step_s: float, *, swarm_rate_bit_s: float | None, earth_rate_bit_s: float | None
) -> RadioConstants:
    """The radio links of a mission.

    Args:
        plan: The mission.
        times: Past the epoch, at the ends of the steps, the first at 0, shape (k,) [s].
        step_s: Length of a step [s].
        swarm_rate_bit_s: Between two spacecraft at all distances; None: what the scenario's link budget closes.
        earth_rate_bit_s: To Earth; None: what the best station that sees the body hears.

    Raises:
        ScenarioError: No station ever hears anything.
    """
    scenario, earth = plan.scenario, plan.environment.earth
    radios = radios_from(scenario.link, antennas_from(scenario).beams)
    if swarm_rate_bit_s is not None:
        radios = radios._replace(swarm=RateTable(np.array([np.inf]), np.array([float(swarm_rate_bit_s)])))
    if earth_rate_bit_s is None:
        station = _station_in_view(plan, radios, times)
    else:
        radios = radios._replace(earth=RateTable(np.array([[np.inf]]), np.array([[float(earth_rate_bit_s)]])))
        station = np.zeros(len(times), np.int64)
    return RadioConstants(
        radios=radios,
        rules=RULES,
        earth_r_N=np.array(earth.position, np.float64),
        earth_v_N=np.array(earth.velocity, np.float64),
        step_s=float(step_s),
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
def transmit(
    constants: RadioConstants,
    body: Occluder,
    now: Kinematics,
    tracking: Tracking,
    totals: EpisodeTotals,
    live: Mask,
    received: Array,
) -> None:
    """Send the data of E flights to whom their spacecraft track, and to Earth; called once a step.

    It reads `now` (t, r, C_BN, C_AN) at the end of the step, `tracking` (kind, spacecraft) and `totals.lost`, and writes
    `totals.closed`, `totals.stored` and `totals.delivered`, whole numbers of bits. What a spacecraft receives it can send on
    from the next step on.

    Args:
        constants: See `radio_constants`.
        body: The asteroid, which may stand in between.
        now: At the end of the step.
        tracking: Who tracks whom.
        totals: Data aboard and delivered, and closed links, are written to.
        live: Which flights, shape (E,).
        received: Receives what Earth received in the step, shape (E,) [bit].
    """
    n = totals.closed.shape[1]
    capacity, storage, earth_N = np.zeros((n, n + 1), np.int64), np.full(n, constants.storage_bit), np.zeros(3)
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
        received[e] = 0.0
        if live[e]:
            for k in range(3):
                earth_N[k] = constants.earth_r_N[k] + now.t[e] * constants.earth_v_N[k]
            for j in range(n):
                works[j] = not totals.lost[e, j]
            kind, whom = tracking.kind[e], tracking.spacecraft[e]
            place = Instant(now.r[e], now.C_BN[e], now.C_AN[e], earth_N, kind, whom, works)
            step = min(int(round(now.t[e] / constants.step_s)), constants.station.shape[0] - 1)
            for j in range(n):
                rate = 0.0
                to[j] = NOBODY
                if kind[j] == _SPACECRAFT:
                    to[j] = whom[j]
                    rate, _ = crosslink_rate(constants.radios, body, place, j, whom[j])
                elif kind[j] == _EARTH:
                    to[j] = EARTH
                    rate, _ = earth_rate(constants.radios, body, place, constants.station[step], j)
                totals.closed[e, j] = rate > 0.0
                if to[j] != NOBODY:
                    capacity[j, to[j]] = np.int64(min(rate * constants.step_s, _MOST_BIT))
                hold[j, 0] = np.int64(totals.stored[e, j])
            carry(constants.rules, capacity, everybody, to, queue, storage, hold, moved)
            for j in range(n):
                totals.stored[e, j] = hold[j, 0]
                received[e] += moved[j] if to[j] == EARTH else 0
            totals.delivered[e] += received[e]
