"""How each spacecraft passed the body: closest approach, phase angles, and how fast the line of sight turned."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import minimize_scalar

from swarm_mj.flight.plan import Plan
from swarm_mj.io.times import SECOND, epoch_of, utc_text
from swarm_mj.records.rounding import rounded
from swarm_mj.simulator.telemetry import working
from swarm_mj.typing import Array


class Path(NamedTuple):
    """The path of a spacecraft relative to the body: a cubic between samples, by their positions and velocities in N.

    What is asked at a time [s] is a number; at n times it has the shape (n,).
    """

    first: float
    last: float
    position: CubicHermiteSpline
    sun: Callable[[ArrayLike], Array]

    def velocity(self, t: ArrayLike) -> Array:
        """In N [m/s], shape (3,) or (n, 3)."""
        return np.asarray(self.position(t, 1))

    def distance(self, t: ArrayLike) -> Any:
        """To the body's centre [m]."""
        return np.linalg.norm(self.position(t), axis=-1)

    def phase(self, t: ArrayLike) -> Any:
        """Angle at the body's centre between the Sun and the spacecraft [rad]."""
        sun, r = self.sun(t), np.asarray(self.position(t))
        return np.arctan2(np.linalg.norm(np.cross(sun, r), axis=-1), (sun * r).sum(axis=-1))

    def turning(self, t: ArrayLike) -> Any:
        """How fast the direction of the body's centre turns in N [rad/s]."""
        r = np.asarray(self.position(t))
        return np.linalg.norm(np.cross(r, self.velocity(t)), axis=-1) / (r * r).sum(axis=-1)

    def least(self, of: Callable[[ArrayLike], Any]) -> float:
        """When a quantity is least [s]."""
        times = self.position.x
        k = int(np.argmin(of(times)))
        found = minimize_scalar(
            of,
            bounds=(times[max(k - 1, 0)], times[min(k + 1, len(times) - 1)]),
            method="bounded",
            options={"xatol": 1e-6},
        )
        return float(min((times[k], float(found.x)), key=of))


def path_of(plan: Plan, telemetry: xr.Dataset, j: int) -> Path | None:
    """The path of spacecraft j from its release until the end, or until it was lost; None where that is no interval."""
    there = np.flatnonzero(working(telemetry)[:, j])
    if len(there) < 2:
        return None
    times = telemetry["time"].values[there]
    r, v = (telemetry[name].values[there, j] for name in ("r_BN_N", "v_BN_N"))
    return Path(float(times[0]), float(times[-1]), CubicHermiteSpline(times, r, v), plan.environment.sun.at)


def encounters_summary(plan: Plan, telemetry: xr.Dataset) -> dict[str, Any]:
    """Key of the summary: of each spacecraft the closest approach, interpolated between samples, and angles of its passage."""
    found = {name: path_of(plan, telemetry, j) for j, name in enumerate(plan.names)}
    return {
        "encounters": {name: _passage(path, plan.scenario.epoch) for name, path in found.items() if path is not None}
    }


def _passage(path: Path, epoch: str) -> dict[str, Any]:
    closest, least = path.least(path.distance), path.least(path.phase)
    fastest = path.least(lambda t: -path.turning(t))
    angles = {"start": path.first, "closest": closest, "least": least, "end": path.last}
    return {
        "closest_approach_utc": utc_text(epoch_of(epoch) + round(closest * SECOND)),
        "closest_approach_s": rounded(closest, 3),
        "distance_m": rounded(path.distance(closest), 3),
        "speed_m_s": rounded(np.linalg.norm(path.velocity(closest)), 6),
        **{f"phase_{when}_deg": rounded(np.degrees(path.phase(t)), 6) for when, t in angles.items()},
        "phase_least_s": rounded(least, 3),
        "peak_turn_rate_deg_s": rounded(np.degrees(path.turning(fastest)), 9),
    }
