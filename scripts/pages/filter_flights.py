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

#: Gravitational parameter [m^3/s^2] and spin in N [rad/s] of a body like Eros.
GM, SPIN = 4.46e5, np.array([0.0, 0.0, 3.3e-4])
#: States of two spacecraft on their way past it, believed at the start, in N [m, m/s], and their errors, 1 sigma [m, m/s].
R0 = np.array([[-30e3, 8e3, 0.0], [-30e3, -9e3, 2e3]])
V0 = np.array([[40.0, 3.0, 0.0], [42.0, -2.0, 1.0]])
SIGMA = np.repeat((300.0, 0.3), 3)


class Case(NamedTuple):
    """What is flown.

    Attributes:
        noise: What errs.
        ranges: Whether the two range to each other.
        r: Where both are believed to begin, in N [m], shape (2, 3).
        v: Their velocities [m/s], likewise.
        sigma: Errors of that, 1 sigma of each component [m, m/s], shape (6,).
    """

    noise: FilterNoise
    ranges: bool = True
    r: Array = R0
    v: Array = V0
    sigma: Array = SIGMA


CASES = {
    "each by itself": Case(FilterNoise(acceleration=1e-4), ranges=False),
    "ranging; attitude, mounting and GM err": Case(
        FilterNoise(acceleration=1e-4, attitude=1e-4, mount=1.5e-4, gm=0.05)
    ),
    "ranging; the body is turned": Case(FilterNoise(acceleration=1e-4, rotation=1e-3)),
    "ranging, 300 m apart and known to 30 m": Case(
        FilterNoise(acceleration=1e-4),
        r=R0[0] + np.array([[0.0, 0.0, 0.0], [0.0, 300.0, 50.0]]),
        v=V0[0] + np.array([[0.0, 0.0, 0.0], [0.3, 0.2, 0.1]]),
        sigma=np.repeat((30.0, 0.1), 3),
    ),
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


def begun(case: Case, n: int = 2) -> SwarmFilter:
    """The filter of n spacecraft."""
    P = np.tile(np.diag(case.sigma**2), (n, 1, 1))
    return SwarmFilter(pull, GM, SPIN, case.noise, 0.0, case.r[:n], case.v[:n], P)


class Errors(NamedTuple):
    """Squared errors of estimates at the end and of innovations over what is said of them, and how many innovations."""

    nees: float
    nis: float
    innovations: int


def flight(rng: np.random.Generator, case: Case, steps: int = 8, dt: float = 120.0) -> Errors:
    """Fly two spacecraft for some steps of some time [s], each of which takes a picture after each."""
    each, noise = begun(case), case.noise
    start = case.sigma * rng.normal(size=(2, 6))
    r, v = case.r + start[:, :3], case.v + start[:, 3:]
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
        if case.ranges:
            update = each.use_range(0, 1, float(np.linalg.norm(r[1] - r[0]) + rng.normal()), 1.0)
            nis, dof = nis + update.nis, dof + 1
    # Both together: what they share, as the body's turn, makes their errors alike.
    error = np.concatenate((r - each.r_N, v - each.v_N), axis=1).ravel()
    both = [OWN * j + k for j in range(2) for k in range(6)]
    return Errors(float(error @ np.linalg.solve(each.P[np.ix_(both, both)], error)), nis, dof)


def row_of(case: str, count: int) -> str:
    """A row of the table: so many flights of a case, and how many err more than right ones do in one of a hundred."""
    rng = np.random.default_rng(7)
    nees, nis, innovations = (
        np.array(column) for column in zip(*(flight(rng, CASES[case]) for _ in range(count)), strict=True)
    )
    beyond = 100.0 * float((nees > chi2.ppf(0.99, 12)).mean())

    def shown(total: float, dof: int) -> str:
        low, high = chi2.ppf([0.025, 0.975], dof) / dof
        return f"{total / dof:.3f} ({low:.3f} to {high:.3f})"

    told = shown(nees.sum(), 12 * count), shown(nis.sum(), int(innovations.sum()))
    return f"| {case} | {count:,} | {told[0]} | {beyond:.1f} % | {told[1]} |"
