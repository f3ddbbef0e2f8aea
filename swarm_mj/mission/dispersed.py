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
        deviation: Of the state from the planned one at the visit, shape (runs, n, 6) [m, m/s].
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


def draw_burns(legs: Legs, errors: FlightErrors, *, draws: int, rng: np.random.Generator) -> Array:
    """Sizes of the corrections of linear flights, which may be drawn in thousands, shape (draws, n, m) [m/s].

    The sizes of one spacecraft's corrections hang together; their sum has no distribution in closed form.
    """
    n, m, gain = len(legs.times), legs.n_corrections, legs.gain
    x, size = _drawn(errors.release, rng, draws), np.zeros((draws, n, m))
    for k in range(m):
        x = np.einsum("jab,ijb->ija", legs.phi[:, k], x)
        known = x + _knowledge_errors(errors, rng, (draws, n))
        wished = np.einsum("jab,ijb->ija", gain[:, k], known)
        x[..., 3:] += burnt(wished, errors, rng)
        size[..., k] = np.linalg.norm(wished, axis=-1)
    return size


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


def _knowledge_errors(errors: FlightErrors, rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    return np.repeat((errors.position, errors.velocity), 3) * rng.standard_normal((*shape, 6))


def _deviation(x: Array, legs: Legs, knot: int) -> Array:
    return x - np.concatenate((legs.r_N[:, knot], legs.v_N[:, knot]), axis=1)


def _coasted(acceleration: AccelerationN, x: Array, times: Array) -> Array:
    flat = x.reshape(-1, 6)
    r_N, v_N = propagate(acceleration, flat[:, :3], flat[:, 3:], times)
    return np.concatenate((r_N[-1], v_N[-1]), axis=1).reshape(x.shape)
