"""Random tables of looks: cells seen by candidates from random directions in random light."""

import numpy as np

from swarm_mj.observation.quality import PictureLooks, gather
from swarm_mj.scenarios.schema_quality import Demand, QualityClass


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def random_looks(rng, n_points, n_cells, pictures=2, share=0.6, suns=3):
    """Each candidate takes some pictures, each of a share of the cells."""
    normal = unit(rng.normal(size=(n_cells, 3)))
    sun = unit(np.array([0.0, 0.0, 1.0]) + 0.7 * rng.normal(size=(suns, 3)))
    taken = []
    for taker in range(n_points):
        for _ in range(pictures):
            cells = np.flatnonzero(rng.random(n_cells) < share)
            camera = unit(normal[cells] + 0.5 * rng.normal(size=(len(cells), 3)))
            taken.append(PictureLooks(taker, cells, camera, sun[rng.integers(suns)], rng.uniform(0.5, 2.0, len(cells))))
    return gather(taken, normal)


def class_of(**demand):
    return QualityClass(name="own", demands=(Demand(**demand),))
