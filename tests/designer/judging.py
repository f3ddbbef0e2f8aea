"""What candidates see of a region, as a design judges them."""

from contextlib import closing

import numpy as np

from swarm_mj.designer.candidates.pictures import Judge, Watcher
from swarm_mj.designer.candidates.visibility import imaging_model_from


def seen_cells(scenario, flights, region, imaging_model=None):
    """What all candidates see, shape (n, cells)."""
    model = imaging_model or imaging_model_from(scenario)
    with closing(Judge(region, model, scenario.observation, None)) as judge:
        found = dict(judge.seen([Watcher(flights, j) for j in range(flights.n)]))
    return np.array([found[j] for j in range(flights.n)])
