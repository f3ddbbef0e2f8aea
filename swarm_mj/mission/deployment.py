"""How the swarm leaves the mothership: transfers of every spacecraft's own release and arrival, and the paths that follow."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from swarm_mj.errors import MissionError, PathError
from swarm_mj.mission.finite_burns import fly_burning, timed_burns
from swarm_mj.mission.multiple_shooting import shoot_in_parts
from swarm_mj.mission.trajectories import AccelerationN, Deployment, Progress, propagate, solve_transfers
from swarm_mj.smallbody.environment import Environment
from swarm_mj.typing import Array, Indices

#: What looks at flights that are to be solved: start, shape (3,), destinations, shape (n, 3), span [s], and whose they are.
Foresee = Callable[[Array, Array, tuple[float, float], Indices], None]
#: Attraction at its end bends a flight by at least this share of the way where shooting is sensitive to its start; flights that
#: are bent less and yet not found lead through the body, and no parts are tried.
LEAST_BEND = 0.1
#: With more than these of one group missing their points, the mission is at fault and not the shooting, and no parts are tried.
MOST_IN_PARTS = 16


def deploy(
    environment: Environment,
    *,
    mothership_N: Array,
    mothership_velocity: str | Array,
    points_A: Array,
    release_s: Array,
    time_of_flight: Array,
    progress: Progress | None = None,
    foresee: Foresee | None = None,
) -> Deployment:
    """Find the deployment of a swarm.

    Args:
        environment: Force model; its epoch is the flight's.
        mothership_N: Position of the mothership in N at the epoch, shape (3,) [m]; it coasts from there.
        mothership_velocity: In N, shape (3,) [m/s]; 'rest' in N; or 'mean' of the velocities that would carry all from the
            mothership's place at the epoch to their points at their arrivals: of the deployed, where all leave then.
        points_A: Where each spacecraft is at its arrival, in A, shape (n, 3) [m].
        release_s: When each leaves the mothership, past the epoch, shape (n,) [s].
        time_of_flight: From release to arrival, shape (n,) [s].
        progress: See `solve_transfers`.
        foresee: Called with each group of flights before it is solved; what it raises ends the search.

    Raises:
        MissionError: A transfer does not exist; the message names the spacecraft.
    """
    arrival_s = release_s + time_of_flight
    destination_N = np.empty_like(points_A)
    for time, who in groups(arrival_s):
        destination_N[who] = points_A[who] @ environment.C_AN(time)
    forces, at_epoch = environment.acceleration_N, np.repeat(mothership_N[None], len(points_A), axis=0)
    solved = None
    if isinstance(mothership_velocity, str):
        velocity = np.zeros(3)
        if mothership_velocity == "mean":
            flown = None if release_s.any() else foresee
            solved = _transfers(forces, at_epoch, destination_N, 0.0 * release_s, arrival_s, progress, flown)
            velocity = solved[0].mean(axis=0)
    else:
        velocity = np.asarray(mothership_velocity, float)
    release_r_N, release_v_N = _coast(forces, mothership_N, velocity, release_s)
    if solved is None or release_s.any():
        solved = _transfers(forces, release_r_N, destination_N, release_s, arrival_s, progress, foresee)
    v0_N, miss = solved
    return Deployment(
        r0_N=mothership_N,
        v0_N=v0_N,
        mothership_velocity_N=velocity,
        destination_N=destination_N,
        miss_m=miss,
        release_s=release_s,
        arrival_s=arrival_s,
        release_r_N=release_r_N,
        release_mothership_v_N=release_v_N,
    )


def coasting(environment: Environment, r_N: Array, v_N: Array, arrival_s: Array) -> Deployment:
    """The deployment of a swarm that is on its way at the epoch, each with a state of its own and without a mothership.

    Args:
        environment: Force model; its epoch is the flight's.
        r_N: Positions in N at the epoch, shape (n, 3) [m].
        v_N: Velocities, shape (n, 3) [m/s].
        arrival_s: When each arrives, where it then is, past the epoch, shape (n,) [s].
    """
    instants, which = np.unique(np.append(0.0, arrival_s), return_inverse=True)
    r, _ = propagate(environment.acceleration_N, r_N, v_N, instants)
    n = len(r_N)
    return Deployment(
        r0_N=r_N.mean(axis=0),
        v0_N=v_N,
        mothership_velocity_N=v_N.mean(axis=0),
        destination_N=r[which.ravel()[1:], np.arange(n)],
        miss_m=np.zeros(n),
        release_s=np.zeros(n),
        arrival_s=arrival_s,
        release_r_N=r_N,
        release_mothership_v_N=v_N,
    )


def groups(*keys: Array) -> Iterator[tuple[float, Indices]]:
    """Spacecraft that share all keys, each of shape (n,): the value of the first key, and who, in order of the keys."""
    values, which = np.unique(np.column_stack(keys), axis=0, return_inverse=True)
    for k, value in enumerate(values):
        yield float(value[0]), np.flatnonzero(which.ravel() == k)


def _coast(forces: AccelerationN, r_N: Array, v_N: Array, times: Array) -> tuple[Array, Array]:
    """The mothership at some times, each of shape (n, 3); where it is at the epoch it is exactly."""
    instants, which = np.unique(np.append(0.0, times), return_inverse=True)
    r, v = r_N[None], v_N[None]
    if len(instants) > 1:
        r, v = (states[:, 0] for states in propagate(forces, r_N[None], v_N[None], instants))
    return r[which.ravel()[1:]], v[which.ravel()[1:]]


def _transfers(
    forces: AccelerationN,
    r0: Array,
    destinations: Array,
    start: Array,
    end: Array,
    progress: Progress | None,
    foresee: Foresee | None,
) -> tuple[Array, Array]:
    """Start velocities (n, 3) [m/s] and misses (n,) [m] of all, who leave and arrive together solved together."""
    v0, misses = np.empty_like(r0), np.empty(len(r0))
    together = list(groups(start, end))
    for count, (time, who) in enumerate(together):
        if foresee is not None:
            foresee(r0[who[0]], destinations[who], (time, float(end[who[0]])), who)
        tell = None if progress is None else partial(tell_part, progress, count, len(together))
        v0[who], misses[who] = _one_group(forces, r0[who], destinations[who], (time, float(end[who[0]])), who, tell)
    return v0, misses


def _one_group(
    forces: AccelerationN,
    r0: Array,
    destinations: Array,
    span: tuple[float, float],
    who: Indices,
    progress: Progress | None,
) -> tuple[Array, Array]:
    """Transfers of spacecraft that leave one place together; in parts where shooting in one does not find them."""
    start, end = span

    def since(t: float, r: Array) -> Array:
        return forces(start + t, r)

    law = since if start else forces
    try:
        return solve_transfers(law, r0[0], destinations, end - start, progress)
    except MissionError as error:
        reason = error
    # Those that shooting finds keep its answer; only the others are flown in parts.
    v0, misses = np.full_like(destinations, np.nan), np.full(len(who), np.inf)
    failing = reason.spacecraft if isinstance(reason, PathError) else range(len(who))
    fine = np.setdiff1d(np.arange(len(who)), np.array(failing, np.int64))
    if len(fine):
        v0[fine], misses[fine] = solve_transfers(law, r0[0], destinations[fine], end - start)
    lost = []
    for j in failing:
        found = None
        if len(failing) <= MOST_IN_PARTS and _bent(law, r0[0], destinations[j], end - start):
            found = shoot_in_parts(law, r0[0], destinations[j], end - start)
        if found is None:
            lost.append(int(j))
        else:
            v0[j], misses[j] = found
    if not lost:
        return v0, misses
    if isinstance(reason, PathError):
        words = str(reason).partition(":")[2]
        raise PathError(f"sc{who[lost[0]] + 1}:{words}", reason.reason, [int(who[j]) for j in lost]) from None
    raise reason


def _bent(law: AccelerationN, r0: Array, destination: Array, time_of_flight: float) -> bool:
    """Whether the forces bend a flight so much that shooting in one may miss what is there."""
    pull = float(np.linalg.norm(law(time_of_flight, destination[None])))
    return 0.5 * pull * time_of_flight**2 > LEAST_BEND * float(np.linalg.norm(destination - r0))


def tell_part(progress: Progress, count: int, of: int, share: float) -> None:
    """Tell the share of all parts that is done, with `count` of them and a share of the next one."""
    progress((count + share) / of)


def planned_paths(
    forces: AccelerationN, deployment: Deployment, times: Array, *, rtol: float = 1e-12
) -> tuple[Array, Array]:
    """Where all spacecraft are by plan, burns and all; before its release each is where the mothership is.

    Args:
        forces: Function (t, r (n, 3)) -> (n, 3) [m/s^2] in N.
        deployment: How they leave.
        times: Increasing, past the epoch, from 0 on [s], shape (t,).
        rtol: Relative tolerance of the integration.

    Returns:
        Positions and velocities in N, each of shape (t, n, 3).
    """
    n = len(deployment.v0_N)
    if deployment.burns and deployment.push is not None:
        return _burning_paths(forces, deployment, times, rtol)
    if not deployment.release_s.any():
        return propagate(forces, deployment.release_r_N, deployment.v0_N, times, rtol=rtol)
    r, v = np.empty((len(times), n, 3)), np.empty((len(times), n, 3))
    aboard = times < deployment.release_s.max()
    carried = _coast(forces, deployment.r0_N, deployment.mothership_velocity_N, times[aboard])
    for released, who in groups(deployment.release_s):
        before = int((times < released).sum())
        r[:before, who], v[:before, who] = (states[:before, None] for states in carried)
        if before == len(times):
            continue
        instants, which = np.unique(np.append(released, times[before:]), return_inverse=True)
        r0, v0 = deployment.release_r_N[who], deployment.v0_N[who]
        flown = r0[None], v0[None]
        if len(instants) > 1:
            flown = propagate(forces, r0, v0, instants, rtol=rtol)
        r[before:, who], v[before:, who] = (states[which.ravel()[1:]] for states in flown)
    return r, v


def _burning_paths(forces: AccelerationN, deployment: Deployment, times: Array, rtol: float) -> tuple[Array, Array]:
    """See `planned_paths`; those that burn are flown one by one, from release to end."""
    push = deployment.push
    assert push is not None
    r, v = planned_paths(forces, replace(deployment, burns=()), times, rtol=rtol)
    burns = timed_burns(deployment.burns, push, np.full(len(deployment.v0_N), push.mass))
    for j, own in enumerate(burns):
        released = float(deployment.release_s[j])
        later = np.flatnonzero(times > released)
        if not own or not len(later):
            continue
        start = deployment.release_r_N[j], deployment.v0_N[j]
        flown = fly_burning(forces, *start, np.append(released, times[later]), own, push, rtol=rtol)
        r[later, j], v[later, j] = (states[1:] for states in flown)
    return r, v
