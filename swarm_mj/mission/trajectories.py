"""Trajectories from the mothership to the visiting points: the two-point boundary value problem and its continuation.

The paper (AAS 19-144, "Trajectory generation") asks for flights from one start to given points in a given time. Here each
is found by shooting under the full force model of the flight: Newton's method on the start velocity with a
finite-difference Jacobian, all spacecraft and all perturbed copies integrated together by DOP853 (Hairer, Norsett, Wanner).
Frame N, metres, seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from swarm_mj.errors import MissionError, PathError
from swarm_mj.typing import Array

AccelerationN = Callable[[float, Array], Array]
Progress = Callable[[float], None]

#: Why a spacecraft cannot be sent to its point, in a few words.
NO_TRAJECTORY = "without a trajectory in the time of flight"

#: A miss below this ends the shooting [m], or below this share of the distances between which is flown: the integrator's
#: relative tolerance leaves no more digits, which is 1 mm for a start 1e9 m away.
SHOOTING_TOLERANCE_M, SHOOTING_TOLERANCE = 1e-5, 1e-12
MAX_ITERATIONS = 20
#: After so many only those fly on that have not arrived: a path through the body takes small steps, and all that fly with it.
ALL_TOGETHER = 6
#: Step of the start velocity for the Jacobian [m/s]: large against the integrator's noise, small against the curvature.
VELOCITY_STEP = 1e-2
#: Evaluations of the force after which an integration is given up, far beyond any flyby.
MAX_EVALUATIONS = 200_000

#: Relative tolerance and rounds of `rough_transfers`.
ROUGH, ROUGH_ROUNDS = 1e-6, 3

#: A miss below this share of the distance is no missing solution but noise in the forces.
NEARLY = 1e-9

_NOISE = (
    "the path is found but for noise in the forces: choose another body.gravity.model, or begin nearer "
    "(mothership.position_A_m, design.time_of_flight_s)"
)
_REMEDY = (
    "a path through the body has no solution in a field that diverges there: change mothership.position_A_m, "
    "design.visiting_points or design.time_of_flight_s"
)


class PlannedBurn(NamedTuple):
    """A change of velocity that is planned.

    Attributes:
        spacecraft: Who, from 0.
        t: Middle of the burn, past the epoch [s].
        delta_v_N: Shape (3,) [m/s].
    """

    spacecraft: int
    t: float
    delta_v_N: Array


class Push(NamedTuple):
    """What thrusters give in every direction, as a plan counts on it.

    Attributes:
        force: Of all nozzles together [N].
        exhaust_speed: [m/s].
        mass: Of a spacecraft with a full tank [kg].
        propellant: In the tank [kg].
    """

    force: float
    exhaust_speed: float
    mass: float
    propellant: float

    @property
    def available(self) -> float:
        """Change of velocity that the tank gives, by the rocket equation [m/s]."""
        return float(self.exhaust_speed * np.log(self.mass / (self.mass - self.propellant)))


@dataclass(frozen=True, kw_only=True)
class Deployment:
    """How the swarm leaves the mothership, which coasts from the epoch on; without one, each leaves where it is at the epoch.

    Attributes:
        r0_N: The mothership at the epoch, or the middle of the swarm without one, shape (3,) [m].
        v0_N: Velocity of each spacecraft at its release, just after the deployer's push, shape (n, 3) [m/s].
        mothership_velocity_N: At the epoch, shape (3,) [m/s].
        destination_N: Where each is at its arrival, shape (n, 3) [m].
        miss_m: Remaining distance to the destination, shape (n,) [m].
        release_s: When each leaves the mothership, past the epoch, shape (n,) [s]; before, it rides along.
        arrival_s: When each is at its destination, shape (n,) [s].
        release_r_N: The mothership at each release, shape (n, 3) [m].
        release_mothership_v_N: Its velocity then, shape (n, 3) [m/s].
        burns: Planned burns, in order of time.
        push: What the thrusters give that fly them; None: nothing is known of them, and paths are those without burns.
    """

    r0_N: Array
    v0_N: Array
    mothership_velocity_N: Array
    destination_N: Array
    miss_m: Array
    release_s: Array
    arrival_s: Array
    release_r_N: Array
    release_mothership_v_N: Array
    burns: tuple[PlannedBurn, ...] = ()
    push: Push | None = None

    @property
    def delta_v(self) -> Array:
        """Deployment speed relative to the mothership, shape (n,) [m/s]."""
        return np.linalg.norm(self.v0_N - self.release_mothership_v_N, axis=1)


def propagate(
    acceleration: AccelerationN,
    r0: Array,
    v0: Array,
    times: Array,
    *,
    rtol: float = 1e-12,
    progress: Progress | None = None,
) -> tuple[Array, Array]:
    """Integrate n independent bodies with DOP853.

    Args:
        acceleration: Function (t, r (n, 3)) -> (n, 3) [m/s^2] in N.
        r0: Start positions, shape (n, 3) [m].
        v0: Start velocities, shape (n, 3) [m/s].
        times: Increasing output times [s]; the first is the start.
        rtol: Relative tolerance; the absolute one is 1e-9 m and 1e-12 m/s.
        progress: Called with the share of the time that is integrated, 0 to 1.

    Returns:
        Positions and velocities, each of shape (len(times), n, 3).

    Raises:
        MissionError: The integrator failed, for instance at an impact with a point mass.
    """
    n = len(r0)

    def rhs(t: float, y: Array) -> Array:
        if progress is not None:
            progress((t - times[0]) / (times[-1] - times[0]))
        r, v = y.reshape(2, n, 3)
        return np.concatenate((v.ravel(), acceleration(t, r).ravel()))

    atol = np.repeat((1e-9, 1e-12), 3 * n)
    start = np.concatenate((np.ravel(r0), np.ravel(v0)))
    states = integrate(rhs, start, times, rtol=rtol, atol=atol).reshape(len(times), 2, n, 3)
    return states[:, 0], states[:, 1]


def integrate(rhs: AccelerationN, start: Array, times: Array, *, rtol: float, atol: Array) -> Array:
    """States at increasing times, shape (len(times), size), from the first on, by DOP853; errors as for `propagate`."""
    evaluations = count(1)

    def counted(t: float, y: Array) -> Array:
        if next(evaluations) > MAX_EVALUATIONS:
            raise MissionError(
                f"the trajectory cannot be integrated: after {MAX_EVALUATIONS} evaluations (MAX_EVALUATIONS) it has only "
                f"come to t = {t:.6g} s; check body.gravity and the times of flight"
            )
        return rhs(t, y)

    solution = solve_ivp(counted, (times[0], times[-1]), start, method="DOP853", t_eval=times, rtol=rtol, atol=atol)
    if not solution.success or not np.isfinite(solution.y).all():
        raise MissionError(f"the trajectory cannot be integrated: {solution.message}")
    return np.asarray(solution.y.T)


def solve_transfers(
    acceleration: AccelerationN,
    r0: Array,
    destinations: Array,
    time_of_flight: float,
    progress: Progress | None = None,
) -> tuple[Array, Array]:
    """Start velocities that carry bodies from one point to their destinations.

    Args:
        acceleration: Function (t, r (n, 3)) -> (n, 3) [m/s^2] in N; t = 0 is the start.
        r0: Common start, shape (3,) [m].
        destinations: Shape (n, 3) [m], in N at the time of flight.
        time_of_flight: [s].
        progress: Called with the share that is done, 0 to 1, as far as that can be known of an iteration.

    Returns:
        Start velocities (n, 3) [m/s] and the remaining misses (n,) [m].

    Raises:
        MissionError: No convergence; the message names the spacecraft, and a `PathError` all of them.
    """
    n = len(destinations)
    times = np.array([0.0, time_of_flight])
    v0 = (destinations - r0) / time_of_flight
    farthest = max(float(np.linalg.norm(r0)), float(np.linalg.norm(destinations, axis=1).max()))
    tolerance = max(SHOOTING_TOLERANCE_M, SHOOTING_TOLERANCE * farthest)
    offsets = VELOCITY_STEP * np.vstack((np.zeros(3), np.eye(3)))
    under_way, misses = np.arange(n), np.full(n, np.inf)
    for iteration in range(MAX_ITERATIONS):
        tell = None if progress is None else partial(_tell_iteration, progress, iteration)
        if iteration >= ALL_TOGETHER:
            under_way = under_way[~(misses[under_way] < tolerance)]
        starts = (v0[under_way, None] + offsets).reshape(-1, 3)
        try:
            r, _ = propagate(acceleration, np.broadcast_to(r0, starts.shape), starts, times, progress=tell)
        except MissionError as error:
            raise MissionError(
                f"no trajectory to the visiting points in {time_of_flight:g} s: {error}; {_REMEDY}"
            ) from None
        arrivals = r[-1].reshape(-1, 4, 3)
        miss = arrivals[:, 0] - destinations[under_way]
        misses[under_way] = np.linalg.norm(miss, axis=1)
        if misses.max() < tolerance:
            return v0, misses
        jacobian = (arrivals[:, 1:] - arrivals[:, :1]).transpose(0, 2, 1) / VELOCITY_STEP
        try:
            v0[under_way] -= np.linalg.solve(jacobian, miss[..., None])[..., 0]
        except np.linalg.LinAlgError:
            break
    worst = int(np.argmax(misses))
    left = float(misses[worst])
    raise PathError(
        f"sc{worst + 1}: no trajectory to its visiting point in {time_of_flight:g} s (miss {left:.3g} m after {MAX_ITERATIONS} "
        f"iterations; {tolerance:.3g} m is asked for); {_REMEDY if left > NEARLY * farthest else _NOISE}",
        NO_TRAJECTORY,
        np.flatnonzero(~(misses < tolerance)).tolist(),
    )


def rough_transfers(
    acceleration: AccelerationN, r0: Array, destinations: Array, time_of_flight: float
) -> tuple[Array, Array]:
    """Start velocities as of `solve_transfers`, roughly and in a fraction of its time, for paths that forces hardly bend.

    Each round takes away the miss as if nothing pulled; what is left shrinks by the share that gradients of the forces bend.

    Returns:
        Start velocities (n, 3) [m/s] and what they are expected to miss by, since misses shrink in proportion (n,) [m].

    Raises:
        MissionError: A path cannot be integrated.
    """
    v0, misses = (destinations - r0) / time_of_flight, []
    for _ in range(ROUGH_ROUNDS):
        r, _ = propagate(acceleration, np.tile(r0, (len(v0), 1)), v0, np.array([0.0, time_of_flight]), rtol=ROUGH)
        miss = r[-1] - destinations
        v0 = v0 - miss / time_of_flight
        misses.append(np.linalg.norm(miss, axis=1))
    return v0, misses[-1] ** 2 / np.maximum(misses[-2], 1e-9)


def _tell_iteration(progress: Progress, iteration: int, share: float) -> None:
    """Each iteration counts a quarter of what is left: three or four are usual, and the paths that they find follow."""
    progress(1.0 - 0.75**iteration * (1.0 - 0.25 * share))
