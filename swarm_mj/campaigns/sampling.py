"""From a campaign to its runs: which scenario, which seed, which drawn values.

Row r flies scenario r mod S for the (r div S)-th time, so that a campaign that was cut short has flown all S scenarios alike.
Seeds and random numbers come from children of the campaign's seed as `numpy.random.SeedSequence.spawn` makes them, each named
by its number alone: a row means the same whoever flies it, and in whichever order.

Where the method is saltelli, the runs of a scenario come in groups of d + 3: a point of sample A, one of B, then A with one
parameter at a time taken from B, and last A with the seed of B. The seed counts as one more factor, so that what the random
initial attitudes and faults do is not blamed on the parameters (A. Saltelli et al., Computer Physics Communications 181, 2010).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
from scipy.stats import qmc

from swarm_mj.campaigns.config import Campaign
from swarm_mj.campaigns.distributions import draw_all
from swarm_mj.typing import Array

#: First number in the names of the children of the campaign's seed: for parameters, for the runs' seeds.
PARAMETERS, SEEDS = 0, 1


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run of a campaign: its row, from 0, how often its scenario was flown before, and the drawn values by dotted key."""

    row: int
    run: int
    scenario: str
    seed: int
    values: dict[str, Any]


class Sample:
    """All runs of a campaign."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        self.dimensions = len(campaign.parameters)
        self.names = [base.label for base in campaign.scenarios]

    @property
    def runs(self) -> int:
        """Runs of each scenario."""
        campaign = self.campaign
        if campaign.method == "grid":
            return campaign.runs * prod(self._counts)
        return campaign.runs * (self.group if campaign.method == "saltelli" else 1)

    @property
    def group(self) -> int:
        """Runs that belong together where the method is saltelli."""
        return self.dimensions + 3

    @property
    def rows(self) -> int:
        """Number of all runs."""
        return self.runs * len(self.names)

    def trial(self, row: int) -> Trial:
        """One run; an IndexError where there is no such row."""
        if not 0 <= row < self.rows:
            raise IndexError(f"row {row}: must be 0 to {self.rows - 1}")
        run, scenario = divmod(row, len(self.names))
        seed, values = self._draw(row, run, scenario)
        return Trial(row=row, run=run, scenario=self.names[scenario], seed=seed, values=values)

    def grid_point(self, number: int) -> dict[str, Any]:
        """The values of a point of the grid, by dotted key; each is flown `runs` times."""
        place = np.unravel_index(number, self._counts)
        levels = (values[int(k)] for values, k in zip(self._levels, place, strict=True))
        return dict(zip(self.campaign.parameters, levels, strict=True))

    def _draw(self, row: int, run: int, scenario: int) -> tuple[int, dict[str, Any]]:
        parameters = self.campaign.parameters
        if self.campaign.paired:  # as the first scenario is flown
            row, scenario = run * len(self.names), 0
        match self.campaign.method:
            case "monte_carlo":
                u = np.random.default_rng(self._child(PARAMETERS, row)).random(self.dimensions)
                return self._seed(row), draw_all(parameters, u)
            case "grid":
                return self._seed(row), self.grid_point(run // self.campaign.runs)
            case "saltelli":
                k, member = divmod(run, self.group)
                u, of_b = self._saltelli_point(scenario, k, member)
                return self._seed(2 * (k * len(self.names) + scenario) + of_b), draw_all(parameters, u)
            case _:
                return self._seed(row), draw_all(parameters, self._points[scenario][run])

    def _saltelli_point(self, scenario: int, k: int, member: int) -> tuple[Array, int]:
        """A point of the unit cube, and whether it takes the seed of sample B."""
        a, b = self._points[scenario][k].reshape(2, self.dimensions)
        if member == 1:
            return b, 1
        point = a.copy()
        if 2 <= member < self.dimensions + 2:
            point[member - 2] = b[member - 2]
        return point, int(member == self.dimensions + 2)

    @cached_property
    def _points(self) -> list[Array]:
        """Points of the unit cube, one array per scenario."""
        return [self._engine(k) for k in range(len(self.names))]

    def _engine(self, scenario: int) -> Array:
        campaign, d = self.campaign, self.dimensions
        if d == 0:
            return np.empty((campaign.runs, 0))
        rng = np.random.default_rng(self._child(PARAMETERS, scenario))
        if campaign.method == "latin_hypercube":
            return np.asarray(qmc.LatinHypercube(d, rng=rng).random(campaign.runs))
        width = 2 * d if campaign.method == "saltelli" else d
        return np.asarray(qmc.Sobol(width, rng=rng).random(campaign.runs))

    @property
    def _counts(self) -> list[int]:
        """Number of levels of each parameter on a grid; the last one varies fastest."""
        return [law.count for law in self.campaign.parameters.values()]

    @cached_property
    def _levels(self) -> list[list[Any]]:
        return [law.levels() for law in self.campaign.parameters.values()]

    def _child(self, *name: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self.campaign.seed, spawn_key=name)

    def _seed(self, number: int) -> int:
        return int(self._child(SEEDS, number).generate_state(1, np.uint64)[0] >> np.uint64(1))
