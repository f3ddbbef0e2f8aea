"""The swarm after its flight, while data are still being sent: where it is, how it points, and who speaks to Earth.

The paths go on in the same force field, without wheels and pictures. Attitude is taken as settled: the relays point their +z at
Earth, the others at the nearest relay, turned from their last attitude the shortest way. Whoever had no control of its attitude
when the flight ended has none afterwards: it points no antenna, and is elected only where all are like it. Who speaks to Earth
is elected at the end of the flight, and again where the scenario asks for it (section `data`); in the flight itself the
behaviour elects.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from swarm_mj.dataflow.contacts import Contacts, Instants
from swarm_mj.dataflow.relays import OfRelays, elect_by_delivery, k_medoids, medoid_cost, next_relays
from swarm_mj.errors import MissionError
from swarm_mj.flight.coordination import unelected_relays
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import Obstacle
from swarm_mj.mission.safety import find_impacts
from swarm_mj.mission.trajectories import propagate
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.telemetry import working
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.typing import Array, Ints, Mask

#: Relative tolerance of the paths after the flight: 1 m in 10,000 km, which no link notices.
RTOL = 1e-7
#: Who in the last so many seconds of its flight pointed to within this angle [rad] for less than this share of the time has no
#: control of its attitude: a turn takes some 30 s, and a beam that sweeps around meets its target for 3 % of the time.
LAST_S, POINTED, LEAST_SHARE = 300.0, np.radians(5.0), 0.1


class Course(NamedTuple):
    """Where the swarm is after its flight."""

    t: Array  #: rising, past the end of the flight [s], shape (m,)
    r_BN_N: Array  #: positions, shape (m, n, 3) [m], of those lost at their last place
    works: Mask  #: who works, shape (m, n)


def controlled(telemetry: xr.Dataset) -> Mask:
    """Who still had control of its attitude at the end of a flight, shape (n,); whoever flew for less than `LAST_S` has."""
    time = telemetry["time"].values
    last = time > time[-1] - LAST_S
    judged = working(telemetry)[last].all(axis=0) & (time[0] <= time[-1] - LAST_S)
    pointed = (telemetry["pointing_error"].values[last] <= POINTED).mean(axis=0)
    return np.asarray(~judged | (pointed >= LEAST_SHARE))


def less_pointing(contacts: Contacts, telemetry: xr.Dataset, *, directed: bool) -> Contacts:
    """Contacts without those after the flight that need the attitude of a spacecraft that has no control of it.

    Args:
        contacts: As if all pointed.
        telemetry: Of the flight.
        directed: Whether crosslinks are by antennas that have to be pointed.
    """
    wild, n = ~controlled(telemetry), telemetry.sizes["spacecraft"]
    after = contacts.edges_s[1:] > float(telemetry["time"].values[-1])
    cut = after[:, None, None] & np.column_stack((directed & (wild[:, None] | wild), wild))
    why = np.concatenate((contacts.why_swarm, contacts.why_earth[:, :, None]), axis=2)
    why[cut & (why != Obstacle.LOST) & (why != Obstacle.ROLE)] = Obstacle.POINTING
    return replace(
        contacts,
        swarm_bit=np.where(cut[:, :, :n], 0, contacts.swarm_bit),
        earth_bit=np.where(cut[:, :, n], 0, contacts.earth_bit),
        peak_bit=np.where(cut, 0, contacts.peak_bit),
        why_swarm=why[:, :, :n],
        why_earth=why[:, :, n],
    )


def flown_instants(plan: Plan, telemetry: xr.Dataset, times: Array) -> Instants:
    """The swarm at the samples of a flight nearest to some times [s], shape (m,)."""
    sampled = telemetry["time"].values
    k = np.clip(np.rint(np.interp(times, sampled, np.arange(len(sampled)))), 0, len(sampled) - 1).astype(np.int64)
    return Instants(
        t=sampled[k],
        r_BN_N=telemetry["r_BN_N"].values[k],
        C_BN=dcm(telemetry["sigma_BN"].values[k]),
        C_AN=dcm(telemetry["sigma_AN"].values[k]),
        earth_N=np.array([plan.environment.earth.at(t) for t in sampled[k]]).reshape(-1, 3),
        mode=telemetry["mode"].values[k].astype(np.int64),
        tracked=telemetry["tracked_spacecraft"].values[k].astype(np.int64),
        works=working(telemetry)[k],
    )


def post_flight_paths(plan: Plan, telemetry: xr.Dataset, times: Array) -> Course:
    """Positions at rising times past the end of the flight [s], shape (m,), and who has not hit the body by then."""
    if not len(times):
        return Course(times, np.empty((0, plan.n, 3)), np.empty((0, plan.n), np.bool_))
    end = float(telemetry["time"].values[-1])
    r, v = (telemetry[name].values[-1] for name in ("r_BN_N", "v_BN_N"))
    works = working(telemetry)[-1]
    grid = np.concatenate(([end], times))
    path, alive = np.repeat(r[None], len(grid), axis=0), np.repeat(works[None], len(grid), axis=0)
    C_AN = np.array([plan.environment.C_AN(t) for t in grid])
    left = np.flatnonzero(works)
    for spacecraft, reached in _paths(plan, r, v, grid, left):
        path[: len(reached), spacecraft] = reached
        path[len(reached) :, spacecraft] = reached[-1]
        alive[len(reached) :, spacecraft] = False
    for impact in find_impacts(plan.shape, grid, np.einsum("kab,knb->kna", C_AN, path[:, left])):
        alive[grid > impact.time, left[impact.spacecraft]] = False
    return Course(times, path[1:], alive[1:])


def _paths(plan: Plan, r: Array, v: Array, grid: Array, left: Ints) -> list[tuple[Ints, Array]]:
    """Spacecraft and their positions: of all together, or where one of them ends inside the body of each by itself."""
    if not len(left):
        return []
    together = _path(plan, r[left], v[left], grid)
    if len(together) == len(grid) or len(left) == 1:
        return [(left, together)]
    return [(left[k : k + 1], _path(plan, r[left[k : k + 1]], v[left[k : k + 1]], grid)) for k in range(len(left))]


def _path(plan: Plan, r: Array, v: Array, grid: Array) -> Array:
    """Positions along `grid` [s] as far as the paths can be integrated, shape (at most len(grid), n, 3) [m]."""
    try:
        return propagate(plan.environment.acceleration_N, r, v, grid, rtol=RTOL)[0]
    except MissionError:
        return r[None] if len(grid) <= 2 else _path(plan, r, v, grid[: len(grid) // 2 + 1])


def post_flight_instants(plan: Plan, C_BN: Array, course: Course, relays: Ints) -> Instants:
    """The swarm after its flight, turned from attitudes, shape (n, 3, 3); numbers of who speaks to Earth, (m, k)."""
    times, r_N, works = course
    earth_N = np.array([plan.environment.earth.at(t) for t in times]).reshape(-1, 3)
    mode, tracked = roles(r_N, works, relays)
    towards = np.take_along_axis(r_N, np.maximum(tracked, 0)[..., None], axis=1) - r_N
    towards = np.where((mode == TargetKind.EARTH)[..., None], earth_N[:, None] - r_N, towards)
    return Instants(
        t=times,
        r_BN_N=r_N,
        C_BN=turned(C_BN, towards),
        C_AN=np.array([plan.environment.C_AN(t) for t in times]).reshape(-1, 3, 3),
        earth_N=earth_N,
        mode=mode,
        tracked=tracked,
        works=works,
    )


def roles(r_N: Array, works: Mask, relays: Ints) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Modes and whom each tracks, each of shape (m, n): relays Earth, the others the nearest relay that works.

    Who finds no relay keeps tracking the body.
    """
    m, n = works.shape
    is_relay = np.zeros((m, n), np.bool_)
    np.put_along_axis(is_relay, relays, True, axis=1)
    is_relay &= works
    mode, tracked = np.full((m, n), TargetKind.ASTEROID, np.int64), np.full((m, n), -1, np.int64)
    for k in np.flatnonzero(is_relay.any(axis=1)):
        found = np.flatnonzero(is_relay[k])
        distance = np.linalg.norm(r_N[k][:, None] - r_N[k][None, found], axis=-1)
        tracked[k] = found[np.argmin(distance, axis=1)]
        mode[k] = TargetKind.SPACECRAFT
    mode[is_relay], tracked[is_relay] = TargetKind.EARTH, -1
    return mode, tracked


def turned(C_BN: Array, towards_N: Array) -> Array:
    """Attitudes turned the shortest way so that +z points along directions.

    Args:
        C_BN: Rotations from N to B, shape (n, 3, 3).
        towards_N: Directions of any length, shape (m, n, 3); where zero, the attitude stays.

    Returns:
        Shape (m, n, 3, 3).
    """
    old = np.broadcast_to(C_BN[:, 2], towards_N.shape)
    length = np.linalg.norm(towards_N, axis=-1, keepdims=True)
    new = np.where(length > 0.0, towards_N / np.where(length > 0.0, length, 1.0), old)
    # Turned by half a turn about x first where it would be a half turn itself, whose axis is open.
    opposite = np.einsum("mni,mni->mn", old, new) < -0.5
    half = np.where(opposite[..., None, None], np.diag((1.0, -1.0, -1.0)), np.eye(3))
    start = half @ C_BN
    old = start[..., 2, :]
    # Rodrigues: R = I + [w] + [w]^2 / (1 + c), w = old x new; components of B's axes turn with it.
    w, c = np.cross(old, new), np.einsum("mni,mni->mn", old, new)
    zero = np.zeros(c.shape)
    W = np.stack((zero, -w[..., 2], w[..., 1], w[..., 2], zero, -w[..., 0], -w[..., 1], w[..., 0], zero), -1)
    W = W.reshape(*c.shape, 3, 3)
    R = np.eye(3) + W + W @ W / (1.0 + c)[..., None, None]
    return start @ R.swapaxes(-1, -2)


def joined(earlier: Instants, later: Instants) -> Instants:
    """Instants of a flight and of the time after it."""
    return Instants(**{name: np.concatenate((value, getattr(later, name))) for name, value in vars(earlier).items()})


class Elections(NamedTuple):
    """Elections that changed who speaks to Earth, the first at the end of the flight."""

    time_s: Array  #: when, past the epoch [s], rising, shape (e,)
    elected: Mask  #: who speaks to Earth from then on, shape (e, n)

    def relays_at(self, times: Array) -> Ints:
        """Numbers of those who speak to Earth at times after the flight [s], shape (m,): shape (m, k), some more than once."""
        counts = self.elected.sum(axis=1)
        relays = np.zeros((len(counts), int(counts.max())), np.int64)
        for row, who in zip(relays, self.elected, strict=True):
            row[:] = np.resize(np.flatnonzero(who), len(row))
        found: Ints = relays[np.maximum(np.searchsorted(self.time_s, times, side="right") - 1, 0)]
        return found


def elect_relays(
    scenario: Scenario, telemetry: xr.Dataset, course: Course, edges_s: Array, value_of: OfRelays, bound_of: OfRelays
) -> Elections:
    """Hold the elections that a scenario asks for.

    Where fewer spacecraft work, with control of their attitude if anybody has it, than are to be elected, all that do speak to
    Earth. Relays that are lost later are replaced at the next election, if there is one.

    Args:
        scenario: What was flown.
        telemetry: The flight.
        course: Where the swarm is after it.
        edges_s: Edges of the slots [s]; who speaks to Earth changes at these, at the earliest after the time of election.
        value_of: What can be delivered with some relays.
        bound_of: What no schedule with them exceeds, in less time.
    """
    data, end_s = scenario.data, float(telemetry["time"].values[-1])
    if (settled := unelected_relays(scenario, telemetry)) is not None:
        return Elections(np.array([end_s]), (settled & working(telemetry)[-1])[None])
    able = controlled(telemetry)
    r_N, works = telemetry["r_BN_N"].values[-1], _of(able, working(telemetry)[-1])
    left = np.flatnonzero(works)
    if data.election == "delivery" and len(left):
        now = elect_by_delivery(value_of, left, min(data.relays, len(left)), bound_of=bound_of)
    else:
        now = candidates(scenario, r_N, works, np.flatnonzero(telemetry["mode"].values[-1] == TargetKind.EARTH))
    times_s, elected = [end_s], [now]
    for slot in election_slots(edges_s, end_s, data.election_interval_s):
        k = int(np.searchsorted(course.t, edges_s[slot]))
        r_N, works = course.r_BN_N[k], _of(able, course.works[k])
        if not works.any():
            break
        candidate = candidates(scenario, r_N, works, now)
        costs = (_cost(r_N, works, now), _cost(r_N, works, candidate))
        following = next_relays(now, candidate, *costs, data.hysteresis)
        if set(following) != set(now):
            now = following
            times_s.append(float(edges_s[slot]))
            elected.append(now)
    return Elections(np.array(times_s), np.array([np.isin(np.arange(len(works)), who) for who in elected]))


def _of(able: Mask, works: Mask) -> Mask:
    """Those that work and are able, or where none is all that work."""
    return works & able if (works & able).any() else works


def candidates(scenario: Scenario, r_N: Array, works: Mask, current: Ints) -> Ints:
    """Whom an election by positions or numbers comes to at one instant.

    Args:
        scenario: Says how many are elected, and by what rule.
        r_N: Positions, shape (n, 3) [m].
        works: Who works, shape (n,).
        current: Who speaks to Earth now, numbers from 0.

    Returns:
        Numbers, rising; none where nobody works.
    """
    left, data = np.flatnonzero(works), scenario.data
    k = min(data.relays, len(left))
    if not k:
        return left
    if data.election == "first":
        return left[:k]
    stay = np.intersect1d(current, left)
    if data.election == "flight" and len(stay):
        return stay
    return left[k_medoids(_distances(r_N[left]), k)]


def election_slots(edges_s: Array, end_s: float, interval_s: float | None) -> Ints:
    """Slots at whose start an election is held: the first that starts when an interval after the flight has passed.

    Args:
        edges_s: Edges of the slots [s], shape (T + 1,).
        end_s: End of the flight [s].
        interval_s: Between two elections [s]; None: none is held.
    """
    if interval_s is None:
        return np.empty(0, np.int64)
    passed = np.maximum(np.floor((edges_s[:-1] - end_s) / interval_s + 1e-9), 0.0)
    return np.flatnonzero(np.diff(passed, prepend=0.0) > 0.0)


def _cost(r_N: Array, works: Mask, relays: Ints) -> float:
    """Sum of distances from all that work to the nearest relay [m]; infinite where one of those does not."""
    if not len(relays) or not works[relays].all():
        return float("inf")
    return medoid_cost(_distances(r_N)[:, works], relays)


def _distances(r_N: Array) -> Array:
    return np.linalg.norm(r_N[:, None] - r_N[None], axis=2)
