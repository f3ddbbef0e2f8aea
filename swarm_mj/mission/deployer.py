"""The mothership's deployer: its limits held against a plan, and insertion burns for the velocity that it cannot give.

The deployer pushes with all it has along the wanted direction. Thrusters give what is missing some time after the release; the
change of velocity of that burn, which with the thrust decides how long it takes, is found by shooting along the path with the
burn in it, to the destination. Frame N.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from swarm_mj.errors import MissionError, PathError, ScenarioError
from swarm_mj.mission.finite_burns import TimedBurn, fly_burning, lasts
from swarm_mj.mission.trajectories import NO_TRAJECTORY, AccelerationN, Deployment, PlannedBurn, Push
from swarm_mj.scenarios.schema_mothership import Deployer
from swarm_mj.typing import Array, Mask

#: Why a spacecraft is left out, in a few words.
BEYOND_THE_TANK = "beyond the tank"
TOO_LONG = "with an insertion burn that does not end before the arrival"
#: A miss below this ends the shooting [m]; the thrusters' pulses miss by more.
TOLERANCE_M = 1e-3
MAX_ITERATIONS, STEP = 15, 1e-3
#: Excess over a limit that is rounding.
ROUNDING = 1e-9
_PATHS = "change the visiting points, times or design.observers of it, or mothership.velocity"
_REMEDY = (
    "raise spacecraft.thrusters.{key} or mothership.deployer.max_speed_m_s, or plan for less: change the visiting points, "
    "times of flight or mothership.velocity"
)


def insert(
    forces: AccelerationN,
    deployment: Deployment,
    push: Push,
    *,
    most_m_s: float,
    after_s: float,
    lenient: bool = False,
    candidates: int | None = None,
) -> Deployment:
    """The deployment in which the deployer gives at most some speed, and insertion burns the rest.

    Args:
        forces: Function (t, r (n, 3)) -> (n, 3) [m/s^2] in N.
        deployment: As if the deployer could give any speed.
        push: Of the thrusters.
        most_m_s: Largest speed of the deployer [m/s].
        after_s: From the release to the start of the burn [s].
        lenient: Whether who cannot burn so leaves as if the deployer could give any speed, and no error is raised.
        candidates: Only so many are looked at; None: all.

    Raises:
        PathError: A burn is beyond the tank or the time, or none is found; it names all such spacecraft of one kind.
    """
    slow = beyond(deployment, most_m_s)[:candidates]
    if not slow.any():
        return deployment
    v0_N, miss, burns, failed = deployment.v0_N.copy(), deployment.miss_m.copy(), [], []
    for j in map(int, np.flatnonzero(slow)):
        wanted = deployment.v0_N[j] - deployment.release_mothership_v_N[j]
        pushed = deployment.release_mothership_v_N[j] + most_m_s / float(np.linalg.norm(wanted)) * wanted
        try:
            burn, miss[j] = _shoot(forces, deployment, j, pushed, push, after_s)
        except PathError as error:
            failed.append(error)
            continue
        v0_N[j] = pushed
        burns.append(burn)
    if failed and not lenient:
        alike = [error for error in failed if error.reason == failed[0].reason]
        raise PathError(str(alike[0]), alike[0].reason, [j for error in alike for j in error.spacecraft])
    burns = sorted([*deployment.burns, *burns], key=lambda burn: burn.t)
    return replace(deployment, v0_N=v0_N, miss_m=miss, burns=tuple(burns), push=push)


def beyond(deployment: Deployment, most_m_s: float | None) -> Mask:
    """Who leaves the mothership faster than some speed [m/s], shape (n,); nobody for None."""
    return np.asarray(deployment.delta_v > (np.inf if most_m_s is None else most_m_s * (1.0 + ROUNDING)))


def _shoot(
    forces: AccelerationN, deployment: Deployment, j: int, v0: Array, push: Push, after_s: float
) -> tuple[PlannedBurn, float]:
    """The burn of one spacecraft by Newton's method, and the remaining miss [m]."""
    start, end = float(deployment.release_s[j]), float(deployment.arrival_s[j])
    goal, r0 = deployment.destination_N[j], deployment.release_r_N[j]
    left = deployment.v0_N[j] - v0
    _see_that_it_fits(j, left, push, start + after_s, end)
    burning = lasts(push, float(np.linalg.norm(left)), push.mass)
    # What a push at the release would do must be done in the time that is left from the middle of the burn on.
    delta_v = left * ((end - start) / (end - start - after_s - 0.5 * burning))
    for _ in range(MAX_ITERATIONS):
        _see_that_it_fits(j, delta_v, push, start + after_s, end)
        tried = delta_v + STEP * np.vstack((np.zeros(3), np.eye(3)))
        try:
            ends = [_end(forces, r0, v0, (start, end), _timed(j, dv, push, start + after_s), push) for dv in tried]
        except MissionError as error:
            raise PathError(f"sc{j + 1}: no insertion burn is found: {error}", NO_TRAJECTORY, [j]) from None
        miss = ends[0] - goal
        if np.linalg.norm(miss) < TOLERANCE_M:
            return _timed(j, delta_v, push, start + after_s).planned, float(np.linalg.norm(miss))
        delta_v = delta_v - np.linalg.solve((np.array(ends[1:]) - ends[0]).T / STEP, miss)
    raise PathError(
        f"sc{j + 1}: no insertion burn that leads to its point is found (miss {np.linalg.norm(miss):.3g} m after "
        f"{MAX_ITERATIONS} iterations); {_REMEDY.format(key='thrust_n')}",
        NO_TRAJECTORY,
        [j],
    )


def _see_that_it_fits(j: int, delta_v: Array, push: Push, begin: float, end: float) -> None:
    """See that the tank and the time hold a burn."""
    speed = float(np.linalg.norm(delta_v))
    if speed > push.available:
        raise PathError(
            f"sc{j + 1}: insertion burn beyond the tank: needs {speed:.4g} m/s and its tank gives {push.available:.4g} m/s "
            f"(spacecraft.thrusters.propellant_kg = {push.propellant:g}); {_REMEDY.format(key='propellant_kg')}",
            BEYOND_THE_TANK,
            [j],
        )
    burning = lasts(push, speed, push.mass)
    if begin + burning >= end:
        raise PathError(
            f"sc{j + 1}: an insertion burn of {speed:.4g} m/s takes {burning:.4g} s at {push.force:.4g} N and does not end "
            f"before the arrival at t = {end:g} s; {_REMEDY.format(key='thrust_n')}",
            TOO_LONG,
            [j],
        )


def _timed(j: int, delta_v: Array, push: Push, begin: float) -> TimedBurn:
    burning = lasts(push, float(np.linalg.norm(delta_v)), push.mass)
    return TimedBurn(PlannedBurn(j, begin + 0.5 * burning, delta_v), begin, burning, push.mass)


def _end(forces: AccelerationN, r0: Array, v0: Array, span: Sequence[float], burn: TimedBurn, push: Push) -> Array:
    return fly_burning(forces, r0, v0, np.array(span), [burn], push)[0][-1]


def check_deployer(deployer: Deployer, deployment: Deployment, candidates: int | None) -> None:
    """See that the deployer can release the swarm as planned.

    Args:
        deployer: Its limits.
        deployment: The plan.
        candidates: Only so many are looked at, each for itself, as the candidates of a design; None: all are released.

    Raises:
        PathError: It cannot; the message names the spacecraft, the value, the limit and the remedy.
    """
    speed = deployment.delta_v[:candidates]
    if deployer.max_speed_m_s is not None and deployer.beyond_max_speed == "refused":
        _require(
            speed, deployer.max_speed_m_s, "max_speed_m_s", "is released at {:.4g} m/s", "beyond the deployer's speed"
        )
    if deployer.cone_axis_N is not None:
        angle = _angles_deg(deployer, deployment)[:candidates]
        limit = deployer.cone_half_angle_deg
        _require(
            angle, limit, "cone_half_angle_deg", "is released {:.4g} deg off cone_axis_N", "outside the deployer's cone"
        )
    if candidates is None and deployer.spacing_s is not None:
        _check_spacing(deployer.spacing_s, deployment.release_s)


def _require(values: Array, limit: float, key: str, words: str, reason: str) -> None:
    beyond = np.flatnonzero(values > limit * (1.0 + ROUNDING))
    if len(beyond):
        worst = int(beyond[np.argmax(values[beyond])])
        raise PathError(
            f"sc{worst + 1} {words.format(values[worst])}: mothership.deployer.{key} = {limit:g} is the most; {_PATHS}",
            reason,
            beyond.tolist(),
        )


def _angles_deg(deployer: Deployer, deployment: Deployment) -> Array:
    """Angles between the pushes and the cone's axis [deg], shape (n,); 0 where there is no push."""
    push = deployment.v0_N - deployment.release_mothership_v_N
    axis = deployment.release_mothership_v_N
    if deployer.cone_axis_N != "velocity":
        axis = np.broadcast_to(np.array(deployer.cone_axis_N, float), push.shape)
    elif not np.linalg.norm(axis, axis=1).all():
        raise ScenarioError(
            "mothership.deployer.cone_axis_N = 'velocity': the mothership is at rest; give three components in N"
        )
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(push, axis), axis=1), np.einsum("ni,ni->n", push, axis)))


def _check_spacing(least: float, release_s: Array) -> None:
    order = np.argsort(release_s, kind="stable")
    gaps = np.diff(release_s[order])
    close = np.flatnonzero(gaps < least * (1.0 - ROUNDING))
    if len(close):
        first, second = (int(j) + 1 for j in order[close[0] : close[0] + 2])
        raise PathError(
            f"sc{second} is released {gaps[close[0]]:g} s after sc{first}: mothership.deployer.spacing_s = {least:g} is the "
            "least; change release_s in design.observers (the communications spacecraft has design.release_s)",
            "too soon after another release",
            [int(j) for j in order[close + 1]],
        )
