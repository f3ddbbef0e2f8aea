"""What each spacecraft of an episode knows of the others where only what has reached it counts: `observability="graph"`.

At the end of every step all who hear one another, directly or through others, tell all they know. Who is out of reach, or lost,
stays in the others' minds as it was last heard of.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.coordination.graph import graph_at
from swarm_mj.dataflow.contacts import Instant, radios_from
from swarm_mj.smallbody.occultation import Occluder
from swarm_mj.typing import Array, Ints, Mask

from .kinematics import Kinematics
from .patches import Patches
from .task import Task


class News(NamedTuple):
    """What is true at the end of a step.

    Attributes:
        r_A: Positions, shape (n, 3) [m].
        facts: Of each what others are told of it, shape (n, f).
        first_by: Who saw each cell first, -1 for nobody, shape (cells,).
        delivered: Data on Earth over the nominal volume.
        earthward: Who speaks to Earth over a closed link, shape (n,).
    """

    r_A: Array
    facts: Array
    first_by: Ints
    delivered: float
    earthward: Mask


class GraphKnowledge:
    """What n spacecraft know, row by row.

    Args:
        n: Number of spacecraft.
        facts: Numbers that each tells of itself.
        patches: Of the target.

    Attributes:
        r_A: Where i believes j to be, shape (n, n, 3) [m].
        facts: What i knows of j, shape (n, n, facts).
        cells: What i knows to be seen, shape (n, cells).
        delivered: What i knows to be on Earth, shape (n,).
    """

    def __init__(self, n: int, facts: int, patches: Patches) -> None:
        self._patches = patches
        self.r_A, self.facts = np.zeros((n, n, 3)), np.zeros((n, n, facts))
        self.cells, self.delivered = np.zeros((n, len(patches.of_cell)), np.bool_), np.zeros(n)

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """All that is known; written to, it is known instead."""
        return self.r_A, self.facts, self.cells, self.delivered

    def begin(self, news: News) -> None:
        """All are together, and know one another."""
        self.r_A[:], self.facts[:] = news.r_A, news.facts
        self.cells[:], self.delivered[:] = news.first_by >= 0, news.delivered

    def tell(self, news: News, groups: list[Ints]) -> None:
        """Those of each group tell one another all they know.

        Args:
            news: What each knows of itself now.
            groups: Who hears whom; who is in none hears only itself.
        """
        n = len(self.cells)
        own = np.arange(n)
        self.r_A[own, own], self.facts[own, own] = news.r_A, news.facts
        self.cells |= news.first_by == own[:, None]
        for group in groups:
            self.r_A[np.ix_(group, group)] = news.r_A[group]
            self.facts[np.ix_(group, group)] = news.facts[group]
            self.cells[group] = self.cells[group].any(axis=0)
            self.delivered[group] = news.delivered if news.earthward[group].any() else self.delivered[group].max()

    def tail(self, i: int) -> tuple[Array, float, float]:
        """Seen share of each patch, of the target, and what is delivered, as i knows them."""
        area = self._patches.cell_area
        share = float(area[self.cells[i]].sum() / area.sum())
        return self._patches.seen_fraction(self.cells[i]), share, float(self.delivered[i])


def groups_of(task: Task, body: Occluder, now: Kinematics, works: Mask) -> list[Ints]:
    """Spacecraft that hear one another, directly or through others, by the scenario's radios.

    Args:
        task: Whose radios.
        body: Which may stand in between.
        now: Where all are in the first flight.
        works: Who is not lost, shape (n,).
    """
    plan, n = task.plan, len(works)
    earth_N, none = plan.environment.earth.at(float(now.t[0])), np.zeros(n, np.int64)
    instant = Instant(now.r[0], now.C_BN[0], now.C_AN[0], earth_N, none, none, np.array(works, np.bool_))
    return graph_at(radios_from(plan.scenario.link, plan.antennas.beams), body, instant).components
