"""Monte Carlo of translational flight: many dispersed flights under the full forces, with impulsive corrections.

What linear covariance is checked against: the forces are not linearised, only the law that asks for corrections is. States
are in N, metres and seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarm_mj.mission.corrections import Legs
from swarm_mj.mission.covariance import FlightErrors, burnt
from swarm_mj.mission.deployment import groups
from swarm_mj.mission.trajectories import AccelerationN, Progress, propagate
from swarm_mj.typing import Array


@dataclass(frozen=True, kw_only=True)
class DispersedFlights:
    """Many flights of n spacecraft with m corrections.

    Attributes:
        deviation: Of the state from the planned one at the arrival, shape (runs, n, 6) [m, m/s].
        delta_v: That the law asked for, shape (runs, n, m, 3) [m/s].
    """

    deviation: Array
    delta_v: Array


def fly_dispersed(
    acceleration: AccelerationN,
    legs: Legs,
    errors: FlightErrors,
    *,
    runs: int,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> DispersedFlights:
    """Fly from release to visit many times.

    Args:
        acceleration: Function (t, r (n, 3)) -> (n, 3) [m/s^2] in N.
        legs: The planned flights.
        errors: What is not as planned.
        runs: Number of flights.
        rng: Of all draws.
        progress: Called with the share that is done, 0 to 1.

    Raises:
        MissionError: A flight cannot be integrated, or a correction has no solution.
    """
    n, m, gain = len(legs.times), legs.n_corrections, legs.gain
    x = _released(legs, errors, rng, runs)
    delta_v = np.zeros((runs, n, m, 3))
    for k in range(m + 1):
        for _, group in groups(*legs.times[:, k : k + 2].T):
            x[:, group] = _coasted(acceleration, x[:, group], legs.times[group[0], k : k + 2])
        if k < m:
            known = _deviation(x, legs, k + 1) + _knowledge_errors(errors, rng, (runs, n))
            delta_v[:, :, k] = np.einsum("jab,ijb->ija", gain[:, k], known)
            x[..., 3:] += burnt(delta_v[:, :, k], errors, rng)
        if progress is not None:
            progress((k + 1) / (m + 1))
    return DispersedFlights(deviation=_deviation(x, legs, -1), delta_v=delta_v)


def draw_linear(
    legs: Legs, errors: FlightErrors, j: int, *, draws: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Linear flights of spacecraft j, which may be drawn in thousands.

    What a burn that errs leaves is a product of normal variables: it and the burns that follow have the second moments of
    `spread`, longer tails than a normal variable, and no quantiles in closed form.

    Returns:
        Position at the arrival relative to the planned one with the first 0, 1, ..., m corrections flown, shape
        (m + 1, draws, 3) [m]; and each correction's change of velocity as the law asks for it, shape (m, draws, 3) [m/s].
    """
    m, gain, to_arrival = legs.n_corrections, legs.gain[j], legs.to_arrival[j, :, :3]
    x = _drawn(errors.release[j : j + 1], rng, draws)[:, 0]
    position, delta_v = np.zeros((m + 1, draws, 3)), np.zeros((m, draws, 3))
    position[0] = x @ to_arrival[0].T
    for k in range(m):
        x = x @ legs.phi[j, k].T
        delta_v[k] = (x + _knowledge_errors(errors, rng, (draws,))) @ gain[k].T
        x[:, 3:] += burnt(delta_v[k], errors, rng)
        position[k + 1] = x @ to_arrival[k + 1].T
    return position, delta_v


def _released(legs: Legs, errors: FlightErrors, rng: np.random.Generator, runs: int) -> Array:
    """States just after the release, shape (runs, n, 6)."""
    return np.concatenate((legs.r_N[:, 0], legs.v_N[:, 0]), axis=1) + _drawn(errors.release, rng, runs)


def _drawn(covariance: Array, rng: np.random.Generator, draws: int) -> Array:
    """Normal vectors of given covariances (n, 6, 6), which may be singular, shape (draws, n, 6)."""
    size = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / scale[:, :, None] / scale[:, None, :])
    root = vectors * np.sqrt(values.clip(0.0))[:, None, :]
    return scale * np.einsum("jab,ijb->ija", root, rng.standard_normal((draws, *size.shape)))


def _knowledge_errors(errors: FlightErrors, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    return np.repeat((errors.position, errors.velocity), 3) * rng.standard_normal((*shape, 6))


def _deviation(x: Array, legs: Legs, knot: int) -> Array:
    return x - np.concatenate((legs.r_N[:, knot], legs.v_N[:, knot]), axis=1)


def _coasted(acceleration: AccelerationN, x: Array, times: Array) -> Array:
    flat = x.reshape(-1, 6)
    r_N, v_N = propagate(acceleration, flat[:, :3], flat[:, 3:], times)
    return np.concatenate((r_N[-1], v_N[-1]), axis=1).reshape(x.shape)
