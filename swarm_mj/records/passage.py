"""Which samples of a flight lie near the body."""

from __future__ import annotations

import numpy as np

from swarm_mj.typing import Array

#: A flight has an encounter where less than this share of its samples lies near the body: within so many times the distance at
#: the arrival, or of the body's radii, and over this number of samples at least.
SMALL_PART, NEAR, NEAR_RADII, LEAST_SAMPLES = 0.1, 2.0, 10.0, 10


def passage(times: Array, r_BN_N: Array, arrival_s: float, reach: tuple[float, float], least: int) -> slice:
    """The samples from when the swarm comes near the body, before the arrival, until it leaves.

    Args:
        times: Of the samples, increasing, shape (K,) [s].
        r_BN_N: Positions, shape (K, n, 3) [m]; the swarm is where its mean is.
        arrival_s: Time of the arrival [s].
        reach: What is near: within so many times the distance at the arrival, or within this distance [m] if that is more.
        least: Samples to take at least, where there are so many.
    """
    distance = np.linalg.norm(r_BN_N.mean(axis=1), axis=1)
    arrival = int(np.argmin(np.abs(times - arrival_s)))
    far = np.flatnonzero(distance > max(reach[0] * float(distance[arrival]), reach[1]))
    first = int(far[far < arrival].max(initial=-1)) + 1
    last = int(far[far > arrival].min(initial=len(times))) - 1
    if last - first + 1 < least:
        first, last = min(first, max(arrival - least // 2, 0)), max(last, min(arrival + least // 2, len(times) - 1))
    return slice(first, last + 1)


def encounter(times: Array, r_BN_N: Array, arrival_s: float, radius_m: float) -> slice | None:
    """The samples near a body of some radius [m] where they are a small part of the flight, else None; see `passage`."""
    near = passage(times, r_BN_N, arrival_s, (NEAR, NEAR_RADII * radius_m), LEAST_SAMPLES)
    return near if near.stop - near.start <= SMALL_PART * len(times) else None
