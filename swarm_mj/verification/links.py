"""Radio links: range, beams and occultation against the geometry of a sphere."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import Antennas, links_closed
from swarm_mj.typing import Array
from swarm_mj.verification.experiment import Bench, experiment
from swarm_mj.verification.flights import ball

RADIUS_M, SAMPLES, EARTH_M = 8e3, 4000, 1.5e11
DISH, HEMISPHERE, RANGE_M = np.radians(25.0), np.radians(80.0), 35e3
#: The mesh lies inside the sphere by less than this; grazing links are not compared.
GRAZING_M = 20.0
BORESIGHT_B = np.array([0.6, 0.0, 0.8])


@experiment("links-geometry", "closed form of range, beams and occultation", 0.0)
def wrong_links(bench: Bench) -> float:
    """Wrong states among 8000 links past a sphere, to spacecraft and Earth, grazing ones left out."""
    rng = np.random.default_rng(7)
    r = rng.standard_normal((SAMPLES, 2, 3))
    r *= rng.uniform(10e3, 30e3, (SAMPLES, 2, 1)) / np.linalg.norm(r, axis=2, keepdims=True)
    earth = rng.standard_normal((SAMPLES, 3))
    earth *= EARTH_M / np.linalg.norm(earth, axis=1, keepdims=True)
    # The first looks roughly at the second, the second roughly at Earth.
    aim = np.stack([r[:, 1] - r[:, 0], earth - r[:, 1]], axis=1)
    C_BN = roughly_at(aim, rng)
    closed = links_closed(
        antennas=Antennas(
            dish_half_angle=DISH,
            hemispherical_boresight_B=BORESIGHT_B,
            hemispherical_half_angle=HEMISPHERE,
            max_range=RANGE_M,
        ),
        shape=ball(RADIUS_M, 24),
        mode=np.tile(np.array([TargetKind.SPACECRAFT, TargetKind.EARTH], np.int8), (SAMPLES, 1)),
        tracked=np.tile(np.array([1, -1], np.int16), (SAMPLES, 1)),
        r_BN_N=r,
        C_BN=C_BN,
        C_AN=Rotation.random(SAMPLES, rng=rng).as_matrix(),
        earth_N=earth,
    )
    in_beams = angle(aim, C_BN[:, :, 2]) <= DISH
    heard = angle(-aim[:, 0], BORESIGHT_B @ C_BN[:, 1]) <= HEMISPHERE
    in_beams[:, 0] &= heard & (np.linalg.norm(aim[:, 0], axis=1) <= RANGE_M)
    height = np.stack([clearance(r[:, 0], r[:, 1]), clearance(r[:, 1], earth)], axis=1) - RADIUS_M
    certain = np.abs(height + 0.5 * GRAZING_M) > GRAZING_M
    return float(np.sum((closed != (in_beams & (height > 0.0)))[certain]))


def roughly_at(directions: Array, rng: np.random.Generator) -> Array:
    """Attitudes C_BN whose +z stands up to 50 deg off the directions, shape (..., 3, 3)."""
    flat = directions.reshape(-1, 3)
    z = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    z = z + 0.5 * rng.uniform(-1.0, 1.0, z.shape)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x = np.cross(rng.standard_normal(z.shape), z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=1).reshape(*directions.shape[:-1], 3, 3)


def angle(a: Array, b: Array) -> Array:
    """Angle between vectors along the last axis by the law of cosines [rad]."""
    cosine = np.sum(a * b, axis=-1) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1))
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def clearance(a: Array, b: Array) -> Array:
    """Least distance of the segments from a to b to the origin, shape (n,) [m]."""
    along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    foot = -np.sum(a * along, axis=1)
    perpendicular = np.linalg.norm(np.cross(a, along), axis=1)
    between = (foot > 0.0) & (foot < np.linalg.norm(b - a, axis=1))
    return np.where(between, perpendicular, np.minimum(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)))
