"""Many short flights of the filter alone, whose measurements are drawn: do its estimates err as it says?

The truth is flown by another integrator, and errs by everything that the filter is told of.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from swarm_mj.navigation.filter import OWN, FilterNoise, SwarmFilter
from swarm_mj.navigation.picture import Fix
from swarm_mj.spacecraft.attitude.mrp import cross_matrix
from swarm_mj.typing import Array

GM = 4.46e5
SPIN = np.array([0.0, 0.0, 3.3e-4])
R0 = np.array([[-30e3, 8e3, 0.0], [-30e3, -9e3, 2e3]])
V0 = np.array([[40.0, 3.0, 0.0], [42.0, -2.0, 1.0]])
SIGMA = np.repeat((300.0, 0.3), 3)
#: What errs, and whether the two spacecraft range to each other.
CASES = {
    "each by itself": (FilterNoise(acceleration=1e-4), False),
    "ranging; attitude, mounting and GM err": (
        FilterNoise(acceleration=1e-4, attitude=1e-4, mount=1.5e-4, gm=0.05),
        True,
    ),
    "ranging; the body is turned": (FilterNoise(acceleration=1e-4, rotation=1e-3), True),
}


def pull(t: float, r: Array) -> Array:
    """Of a point mass, as environments give it."""
    return -GM * r / np.linalg.norm(r, axis=1, keepdims=True) ** 3


def flown(r: Array, v: Array, t: float, gm: float = 1.0) -> tuple[Array, Array]:
    """States after a time without noise, by another integrator."""

    def rate(_: float, y: Array) -> Array:
        return np.concatenate((y[r.size :], gm * pull(0.0, y[: r.size].reshape(r.shape)).ravel()))

    y = solve_ivp(rate, (0.0, t), np.concatenate((r.ravel(), v.ravel())), rtol=1e-10, atol=1e-6).y[:, -1]
    return y[: r.size].reshape(r.shape), y[r.size :].reshape(r.shape)


def begun(noise: FilterNoise, n: int = 2) -> SwarmFilter:
    """The filter of n spacecraft."""
    return SwarmFilter(pull, GM, SPIN, noise, 0.0, R0[:n], V0[:n], np.tile(np.diag(SIGMA**2), (n, 1, 1)))


class Errors(NamedTuple):
    """Of a flight: squared errors of its estimates at the end over what the filter says of them, and of its innovations."""

    nees: float
    nis: float
    innovations: int


def flight(rng: np.random.Generator, noise: FilterNoise, ranges: bool, steps: int = 8, dt: float = 120.0) -> Errors:
    """Fly two spacecraft for 16 minutes, each of which takes a picture every two."""
    each = begun(noise)
    start = SIGMA * rng.normal(size=(2, 6))
    r, v = R0 + start[:, :3], V0 + start[:, 3:]
    mount, gm = noise.mount * rng.normal(size=(2, 3)), 1.0 + noise.gm * rng.normal()
    turned, nis, dof = noise.rotation * rng.normal(size=3), 0.0, 0
    for k in range(steps):
        for _ in range(4):
            r, v = flown(r, v, dt / 4, gm)
            v = v + noise.acceleration * np.sqrt(dt / 4) * rng.normal(size=v.shape)
        each.advance((k + 1) * dt)
        for j in range(2):
            believed = each.r_N[j]
            R = np.diag([20.0**2, 20.0**2, 100.0**2])
            turn = cross_matrix(believed)
            error = turn @ (noise.attitude * rng.normal(size=3) + mount[j]) + np.sqrt(np.diag(R)) * rng.normal(size=3)
            seen = r[j] - np.cross(turned, r[j]) - believed + error
            update = each.use_fix(j, Fix("limb", seen, np.eye(3), R, turn, 1), np.eye(3))
            nis, dof = nis + update.nis, dof + update.dof
        if ranges:
            update = each.use_range(0, 1, float(np.linalg.norm(r[1] - r[0]) + rng.normal()), 1.0)
            nis, dof = nis + update.nis, dof + 1
    # Both together: what they share, as the body's turn, makes their errors alike.
    error = np.concatenate((r - each.r_N, v - each.v_N), axis=1).ravel()
    both = [OWN * j + k for j in range(2) for k in range(6)]
    return Errors(float(error @ np.linalg.solve(each.P[np.ix_(both, both)], error)), nis, dof)


def row_of(case: str, count: int) -> str:
    """A row of the table: so many flights of a case."""
    rng = np.random.default_rng(7)
    nees, nis, innovations = (
        sum(column) for column in zip(*(flight(rng, *CASES[case]) for _ in range(count)), strict=True)
    )

    def shown(total: float, dof: int) -> str:
        low, high = chi2.ppf([0.025, 0.975], dof) / dof
        return f"{total / dof:.3f} ({low:.3f} to {high:.3f})"

    return f"| {case} | {count:,} | {shown(nees, 12 * count)} | {shown(nis, int(innovations))} |"
