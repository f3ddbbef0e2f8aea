"""Random numbers for faults and dispersions: every quantity has a stream of its own, spawned from the scenario's seed.

Streams are independent: switching one dispersion on, or adding a fault to the end of the list, changes no other draw.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

#: Sets these streams apart from others that may be spawned from the same seed.
_FAMILY = 7


class Stream(IntEnum):
    """What a stream is for; part of its spawn key, so that a number must never be given to something else."""

    FAULT = 0
    ATTITUDE = 1
    RATE = 2
    DEPLOYMENT = 3
    MASS = 4
    INERTIA = 5
    COULOMB = 6
    VISCOUS = 7
    GRAVITY = 8
    HARMONICS = 9
    TARGET = 10
    GYRO_BIAS = 11
    STAR_TRACKER_BIAS = 12
    DELAY = 13
    SENSOR_NOISE = 14
    NAVIGATION = 15
    BURN = 16
    MOTHERSHIP = 17


def stream(seed: int, what: Stream, *numbers: int) -> np.random.Generator:
    """The generator of one quantity.

    Args:
        seed: Of the scenario.
        what: Which quantity.
        numbers: Further keys, for instance the number of the fault and of the spacecraft.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_FAMILY, int(what), *numbers)))
