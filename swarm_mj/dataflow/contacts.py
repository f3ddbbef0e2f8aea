"""Who hears whom, slot by slot: how much each link could carry, and what is in the way of those that carry nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.dataflow.ground import stations_from
from swarm_mj.dataflow.link_budget import RateTable, rate_at, rate_table
from swarm_mj.dataflow.radios import radio_from
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import Beams, Obstacle, obstacle_between, obstacle_to_earth
from swarm_mj.scenarios.schema_link import Link
from swarm_mj.smallbody.occultation import Occluder
from swarm_mj.typing import Array, Ints, Mask, kernel

_SPACECRAFT, _EARTH = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH)
_NONE, _LOST, _ROLE, _RANGE = (int(o) for o in (Obstacle.NONE, Obstacle.LOST, Obstacle.ROLE, Obstacle.RANGE))
_STATION = int(Obstacle.STATION)


class Radios(NamedTuple):
    """The radios of every spacecraft as compiled code takes them.

    Attributes:
        beams: Their antennas.
        swarm: Rates between two spacecraft by range.
        earth: Rates by range to each station.
    """

    beams: Beams
    swarm: RateTable
    earth: tuple[RateTable, ...]


def radios_from(link: Link, beams: Beams) -> Radios:
    """The radios of a scenario with its antennas.

    Raises:
        ScenarioError: A radio or network does not exist.
    """
    crosslink, to_earth = radio_from(link.crosslink, "link.crosslink"), radio_from(link.earth, "link.earth")
    return Radios(
        beams,
        rate_table(crosslink, crosslink.g_over_t_db_k),
        tuple(rate_table(to_earth, station.g_over_t_db_k) for station in stations_from(link.ground)),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Instants:
    """The swarm at some instants, as its radios see it.

    Attributes:
        t: Past the epoch [s], shape (m,).
        r_BN_N: Positions [m], shape (m, n, 3).
        C_BN: Rotations from N to B, shape (m, n, 3, 3).
        C_AN: Rotations from N to A, shape (m, 3, 3).
        earth_N: Position of Earth [m], shape (m, 3).
        mode: `TargetKind` of what each tracks, shape (m, n).
        tracked: Spacecraft that is tracked, from 0, where mode is SPACECRAFT, shape (m, n).
        works: Who works, shape (m, n).
    """

    t: Array
    r_BN_N: Array
    C_BN: Array
    C_AN: Array
    earth_N: Array
    mode: Ints
    tracked: Ints
    works: Mask

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
    """What geometry and radios allow.

    Attributes:
        edges_s: Edges of the slots past the epoch [s], shape (T + 1,).
        swarm_bit: Most that spacecraft i could send to j in a slot [bit], shape (T, n, n).
        earth_bit: Most that Earth could hear of i in a slot [bit], shape (T, n).
        station: Number of the station that hears i, -1 where none does, shape (T, n).
        light_time_s: Of the way to Earth, shape (T,).
        why_swarm: `Obstacle` of each link at the middle of the slot, shape (T, n, n).
        why_earth: The same of the way to Earth, shape (T, n).
        distance_m: Between spacecraft, at the middle of the slot, shape (T, n, n).
    """

    edges_s: Array
    swarm_bit: NDArray[np.int64]
    earth_bit: NDArray[np.int64]
    station: NDArray[np.int64]
    light_time_s: Array
    why_swarm: NDArray[np.int8]
    why_earth: NDArray[np.int8]
    distance_m: Array

    @property
    def n_slots(self) -> int:
        """T."""
        return len(self.edges_s) - 1


def samples_of(edges_s: Array, per_slot: int) -> Array:
    """Instants at the middles of `per_slot` equal parts of each slot [s], shape (T, per_slot)."""
    shares = (np.arange(per_slot) + 0.5) / per_slot
    return edges_s[:-1, None] + np.diff(edges_s)[:, None] * shares


def find_contacts(
    edges_s: Array, instants: Instants, *, radios: Radios, body: Occluder, station: Ints, light_time_s: Array
) -> Contacts:
    """Capacities of all links.

    Args:
        edges_s: Edges of the slots [s], shape (T + 1,).
        instants: The swarm at the `samples_of` the slots, in their order, shape (T * k,).
        radios: See `Radios`.
        body: The asteroid, which may stand in between.
        station: Which station hears the swarm best at each instant, -1 for none, shape (T * k,).
        light_time_s: Of the way to Earth at each instant, shape (T * k,).
    """
    slots, n = len(edges_s) - 1, instants.works.shape[1]
    per_slot = len(instants.t) // slots
    swarm, earth = np.zeros((slots, n, n)), np.zeros((slots, n))
    why_swarm, why_earth = np.zeros((slots, n, n), np.int8), np.zeros((slots, n), np.int8)
    heard_by, middle = np.full((slots, n), -1, np.int64), np.arange(slots) * per_slot + per_slot // 2
    for k in range(slots * per_slot):
        slot = k // per_slot
        share = (edges_s[slot + 1] - edges_s[slot]) / per_slot
        rate, why = np.zeros((n, n)), np.zeros((n, n), np.int8)
        now = instants.at(k)
        swarm_rates(radios.beams, radios.swarm, body, now, rate, why)
        to_earth, why_not = earth_rates(radios, body, now, int(station[k]))
        swarm[slot] += share * rate
        earth[slot] += share * to_earth
        if k == middle[slot]:
            why_swarm[slot], why_earth[slot] = why, why_not
        heard_by[slot] = np.where(to_earth > 0.0, station[k], heard_by[slot])
    r_N = instants.r_BN_N[middle]
    return Contacts(
        edges_s=edges_s,
        swarm_bit=np.floor(swarm).astype(np.int64),
        earth_bit=np.floor(earth).astype(np.int64),
        station=heard_by,
        light_time_s=light_time_s[middle],
        why_swarm=why_swarm,
        why_earth=why_earth,
        distance_m=np.linalg.norm(r_N[:, :, None] - r_N[:, None], axis=-1),
    )


@kernel
def swarm_rates(
    beams: Beams, table: RateTable, body: Occluder, now: Instant, rate: Array, why: NDArray[np.int8]
) -> None:
    """Rates of all links between spacecraft at one instant.

    With omnidirectional antennas everybody may speak to everybody; with directed ones, a spacecraft to whom it tracks.

    Args:
        beams: Of the antennas.
        table: Rates by range.
        body: The asteroid.
        now: The instant.
        rate: Receives the rate from i to j [bit/s], shape (n, n).
        why: Receives the `Obstacle`, shape (n, n).
    """
    r_N, works, mode, tracked = now.r_N, now.works, now.mode, now.tracked
    for i in range(mode.shape[0]):
        for j in range(mode.shape[0]):
            rate[i, j] = 0.0
            if i == j or not (works[i] and works[j]):
                why[i, j] = _LOST
            elif not beams.omnidirectional and (mode[i] != _SPACECRAFT or tracked[i] != j):
                why[i, j] = _ROLE
            else:
                x, y, z = r_N[j, 0] - r_N[i, 0], r_N[j, 1] - r_N[i, 1], r_N[j, 2] - r_N[i, 2]
                fastest = rate_at(table, np.sqrt(x * x + y * y + z * z))
                closes = fastest > 0.0
                why[i, j] = obstacle_between(beams, body, r_N, now.C_BN, now.C_AN, i, j) if closes else _RANGE
                rate[i, j] = fastest if why[i, j] == _NONE else 0.0


def earth_rates(radios: Radios, body: Occluder, now: Instant, station: int) -> tuple[Array, NDArray[np.int8]]:
    """Rates to Earth at one instant.

    Args:
        radios: See `Radios`.
        body: The asteroid.
        now: The instant.
        station: Which sees the swarm best, -1 for none.

    Returns:
        Rate of each spacecraft [bit/s], and the `Obstacle`, each of shape (n,).
    """
    rate, why = np.zeros(len(now.works)), np.where(now.works, _ROLE, _LOST).astype(np.int8)
    for j in np.flatnonzero(now.works & (now.mode == _EARTH)):
        distance = float(np.linalg.norm(now.earth_N - now.r_N[j]))
        fastest = max(rate_at(table, distance) for table in radios.earth)
        heard = rate_at(radios.earth[station], distance) if station >= 0 else 0.0
        earth_N = (now.earth_N[0], now.earth_N[1], now.earth_N[2])
        why[j] = obstacle_to_earth(radios.beams, body, now.r_N, now.C_BN, now.C_AN, earth_N, j)
        if why[j] == _NONE and not heard > 0.0:
            why[j] = _STATION if fastest > 0.0 else _RANGE
        rate[j] = heard if why[j] == _NONE else 0.0
    return rate, why
