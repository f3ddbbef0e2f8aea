"""Who hears whom, slot by slot: how much each link could carry, and what is in the way of those that carry nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import kernel
from swarm_mj.dataflow.ground import EarthSchedule, stations_from
from swarm_mj.dataflow.link_budget import RateTable, rate_at, rate_table
from swarm_mj.dataflow.radios import radio_from
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import Antennas, Obstacle, obstacle_between, obstacle_to_earth
from swarm_mj.scenarios.schema_link import Link
from swarm_mj.smallbody.occultation import Occluder
from swarm_mj.typing import Array, Ints, Mask

_SPACECRAFT, _EARTH = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH)
_NONE, _LOST, _ROLE, _RANGE = (int(o) for o in (Obstacle.NONE, Obstacle.LOST, Obstacle.ROLE, Obstacle.RANGE))
_STATION = int(Obstacle.STATION)


class Radios(NamedTuple):
    """The radios of every spacecraft as compiled code takes them."""

    beams: Antennas  #: their antennas
    swarm: RateTable  #: rates between two spacecraft by range
    earth: RateTable  #: rates by range to each of s stations, arrays of shape (s, k)


def radios_from(link: Link, beams: Antennas) -> Radios:
    """The radios of a scenario with its antennas.

    Raises:
        ScenarioError: A radio or network does not exist.
    """
    crosslink, to_earth = radio_from(link.crosslink, "link.crosslink"), radio_from(link.earth, "link.earth")
    heard = [rate_table(to_earth, station.g_over_t_db_k) for station in stations_from(link.ground)]
    earth = RateTable(np.array([table.range_m for table in heard]), np.array([table.rate_bit_s for table in heard]))
    return Radios(beams, rate_table(crosslink, crosslink.g_over_t_db_k), earth)


@dataclass(frozen=True, eq=False, kw_only=True)
class Instants:
    """The swarm at some instants, as its radios see it."""

    t: Array  #: past the epoch [s], shape (m,)
    r_BN_N: Array  #: positions [m], shape (m, n, 3)
    C_BN: Array  #: rotations from N to B, shape (m, n, 3, 3)
    C_AN: Array  #: rotations from N to A, shape (m, 3, 3)
    earth_N: Array  #: position of Earth [m], shape (m, 3)
    mode: Ints  #: `TargetKind` of what each tracks, shape (m, n)
    tracked: Ints  #: spacecraft that is tracked, from 0, where mode is SPACECRAFT, shape (m, n)
    works: Mask  #: who works, shape (m, n)

    def at(self, k: int) -> Instant:
        """One of them."""
        r_N, C_BN, C_AN, earth_N = (
            np.ascontiguousarray(array[k]) for array in (self.r_BN_N, self.C_BN, self.C_AN, self.earth_N)
        )
        return Instant(r_N, C_BN, C_AN, earth_N, self.mode[k], self.tracked[k], self.works[k])


class Instant(NamedTuple):
    """One of `Instants`, as compiled code takes it."""

    r_N: Array
    C_BN: Array
    C_AN: Array
    earth_N: Array
    mode: Ints
    tracked: Ints
    works: Mask


@dataclass(frozen=True, eq=False, kw_only=True)
class Contacts:
    """What geometry and radios allow."""

    edges_s: Array  #: edges of the slots past the epoch [s], shape (T + 1,)
    swarm_bit: NDArray[np.int64]  #: most that spacecraft i could send to j in a slot [bit], shape (T, n, n)
    earth_bit: NDArray[np.int64]  #: most that Earth could hear of i in a slot [bit], shape (T, n)
    #: what the best instant of the slot would carry if it lasted the whole slot, to each spacecraft and, in the last column, to
    #: Earth [bit], shape (T, n, n + 1)
    peak_bit: NDArray[np.int64]
    station: NDArray[np.int64]  #: number of the station that hears i, -1 where none does, shape (T, n)
    light_time_s: Array  #: of the way to Earth, shape (T,)
    why_swarm: NDArray[np.int8]  #: `Obstacle` of each link at the middle of the slot, shape (T, n, n)
    why_earth: NDArray[np.int8]  #: the same of the way to Earth, shape (T, n)
    distance_m: Array  #: between spacecraft, at the middle of the slot, shape (T, n, n)

    @property
    def n_slots(self) -> int:
        """T."""
        return len(self.edges_s) - 1


def samples_of(edges_s: Array, per_slot: int) -> Array:
    """Instants at the middles of `per_slot` equal parts of each slot [s], shape (T, per_slot)."""
    shares = (np.arange(per_slot) + 0.5) / per_slot
    return edges_s[:-1, None] + np.diff(edges_s)[:, None] * shares


def find_contacts(
    edges_s: Array,
    instants: Instants,
    *,
    radios: Radios,
    body: Occluder,
    heard: EarthSchedule,
    beside: tuple[Occluder, Instants] | None = None,
) -> Contacts:
    """Capacities of all links.

    Args:
        edges_s: Edges of the slots [s], shape (T + 1,).
        instants: The swarm at the `samples_of` the slots, in their order, shape (T * k,).
        radios: See `Radios`.
        body: The asteroid, which may stand in between.
        heard: By whom on Earth, at each instant.
        beside: A companion, which may stand in between too, and the same instants as seen from its centre; None: none.
    """
    slots, n = len(edges_s) - 1, instants.works.shape[1]
    per_slot = len(instants.t) // slots
    bit, peak, obstacle = *np.zeros((2, slots, n, n + 1)), np.zeros((slots, n, n + 1), np.int8)
    heard_by, middle = np.full((slots, n), -1, np.int64), np.arange(slots) * per_slot + per_slot // 2
    rate, why = np.zeros((n, n + 1)), np.zeros((n, n + 1), np.int8)
    for k in range(slots * per_slot):
        slot = k // per_slot
        link_rates(radios, body, instants.at(k), int(heard.station[k]), rate, why)
        if beside is not None:
            _take_away(radios, beside[0], beside[1].at(k), int(heard.station[k]), rate, why)
        duration = edges_s[slot + 1] - edges_s[slot]
        bit[slot] += duration / per_slot * rate
        peak[slot] = np.maximum(peak[slot], duration * rate)
        if k == middle[slot]:
            obstacle[slot] = why
        heard_by[slot] = np.where(rate[:, n] > 0.0, heard.station[k], heard_by[slot])
    whole = np.floor(bit).astype(np.int64)
    r_N = instants.r_BN_N[middle]
    return Contacts(
        edges_s=edges_s,
        swarm_bit=whole[:, :, :n].copy(),
        earth_bit=whole[:, :, n].copy(),
        peak_bit=np.ceil(peak).astype(np.int64),
        station=heard_by,
        light_time_s=heard.light_time_s[middle],
        why_swarm=obstacle[:, :, :n].copy(),
        why_earth=obstacle[:, :, n].copy(),
        distance_m=np.linalg.norm(r_N[:, :, None] - r_N[:, None], axis=-1),
    )


def _take_away(radios: Radios, body: Occluder, now: Instant, station: int, rate: Array, why: NDArray[np.int8]) -> None:
    """Take the links away that one more body stands between; arguments as of `link_rates`."""
    other_rate, other_why = np.zeros_like(rate), np.zeros_like(why)
    link_rates(radios, body, now, station, other_rate, other_why)
    blocked = (why == _NONE) & (other_why == int(Obstacle.BODY))
    rate[blocked], why[blocked] = 0.0, int(Obstacle.BODY)


@kernel
def link_rates(radios: Radios, body: Occluder, now: Instant, station: int, rate: Array, why: NDArray[np.int8]) -> None:
    """Rates of all links of n spacecraft at one instant: to each other, and in the last column to Earth.

    Args:
        radios: See `Radios`.
        body: The asteroid.
        now: The instant.
        station: Which station hears the swarm best, -1 for none.
        rate: Receives the rate from i to j [bit/s], shape (n, n + 1).
        why: Receives the `Obstacle`, shape (n, n + 1).
    """
    n = now.mode.shape[0]
    for i in range(n):
        for j in range(n):
            rate[i, j], why[i, j] = crosslink_rate(radios, body, now, i, j)
        rate[i, n], why[i, n] = earth_rate(radios, body, now, station, i)


@kernel
def crosslink_rate(radios: Radios, body: Occluder, now: Instant, i: int, j: int) -> tuple[float, int]:
    """Rate from spacecraft i to spacecraft j [bit/s], and the `Obstacle`.

    With omnidirectional antennas everybody may speak to everybody; with directed ones, a spacecraft to whom it tracks.
    """
    if i == j or not (now.works[i] and now.works[j]):
        return 0.0, _LOST
    if not radios.beams.omnidirectional and (now.mode[i] != _SPACECRAFT or now.tracked[i] != j):
        return 0.0, _ROLE
    r_N = now.r_N
    x, y, z = r_N[j, 0] - r_N[i, 0], r_N[j, 1] - r_N[i, 1], r_N[j, 2] - r_N[i, 2]
    fastest = rate_at(radios.swarm, np.sqrt(x * x + y * y + z * z))
    why = obstacle_between(radios.beams, body, r_N, now.C_BN, now.C_AN, i, j) if fastest > 0.0 else _RANGE
    return (fastest if why == _NONE else 0.0), why


@kernel
def earth_rate(radios: Radios, body: Occluder, now: Instant, station: int, i: int) -> tuple[float, int]:
    """Rate from spacecraft i, which has to track Earth, to a station, -1 for none [bit/s], and the `Obstacle`."""
    if not now.works[i] or now.mode[i] != _EARTH:
        return 0.0, (_ROLE if now.works[i] else _LOST)
    earth_N, r_N, tables = (now.earth_N[0], now.earth_N[1], now.earth_N[2]), now.r_N, radios.earth
    why = obstacle_to_earth(radios.beams, body, r_N, now.C_BN, now.C_AN, earth_N, i)
    if why != _NONE:
        return 0.0, why
    x, y, z = earth_N[0] - r_N[i, 0], earth_N[1] - r_N[i, 1], earth_N[2] - r_N[i, 2]
    distance, in_range = np.sqrt(x * x + y * y + z * z), False
    for k in range(tables.range_m.shape[0]):
        rate = rate_at(RateTable(tables.range_m[k], tables.rate_bit_s[k]), distance)
        in_range |= rate > 0.0
        if k == station and rate > 0.0:
            return rate, _NONE
    return 0.0, (_STATION if in_range else _RANGE)
