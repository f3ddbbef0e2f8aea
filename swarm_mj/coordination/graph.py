"""The communication graph of a swarm at an instant: who can send to whom, how fast, how late, and how surely."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse.csgraph import connected_components

from swarm_mj.dataflow.contacts import Instant, Radios, link_rates
from swarm_mj.scenarios.constants import SPEED_OF_LIGHT
from swarm_mj.smallbody.occultation import Occluder
from swarm_mj.typing import Array, Ints, Mask


@dataclass(frozen=True, eq=False, kw_only=True)
class Graph:
    """Links of n spacecraft, from row to column."""

    rate_bit_s: Array  #: fastest rate that closes, 0 where none does, shape (n, n) [bit/s]
    delay_s: Array  #: of the way, without sending, shape (n, n) [s]
    loss: Array  #: chance that a message is lost on the way, shape (n, n) [-]
    works: Mask  #: who sends and hears, shape (n,)

    @property
    def n(self) -> int:
        """Number of spacecraft."""
        return len(self.works)

    @cached_property
    def links(self) -> Mask:
        """Whether i can send to j, shape (n, n)."""
        return np.asarray((self.rate_bit_s > 0.0) & self.works & self.works[:, None] & ~np.eye(self.n, dtype=np.bool_))

    @cached_property
    def adjacency(self) -> Mask:
        """Links that are open both ways, symmetric, shape (n, n)."""
        return np.asarray(self.links & self.links.T)

    @property
    def components(self) -> list[Ints]:
        """Groups that hear each other, directly or through others, by their lowest number; the lost are in none."""
        _, label = connected_components(self.adjacency, directed=False)
        label = np.where(self.works, label, -1)
        groups = [np.flatnonzero(label == one) for one in np.unique(label[self.works])]
        return sorted(groups, key=lambda group: int(group[0]))


def graph_at(radios: Radios, body: Occluder, now: Instant, *, loss: float = 0.0, processing_s: float = 0.0) -> Graph:
    """The graph of the links that the radios close at an instant: in range of the budget, with the body not in between.

    Args:
        radios: See `Radios`.
        body: The asteroid.
        now: Where all are, how they are turned, and who works.
        loss: Chance that a message over a closed link is lost [-].
        processing_s: What a message takes aboard, on top of the light's way [s].
    """
    n = len(now.works)
    rates = np.zeros((n, n + 1))
    link_rates(radios, body, now, -1, rates, np.zeros((n, n + 1), np.int8))
    rate = rates[:, :n]
    distance = np.linalg.norm(now.r_N[:, None] - now.r_N[None], axis=-1)
    return Graph(
        rate_bit_s=rate,
        delay_s=distance / SPEED_OF_LIGHT + processing_s,
        loss=np.where(rate > 0.0, loss, 1.0),
        works=np.array(now.works, np.bool_),
    )
