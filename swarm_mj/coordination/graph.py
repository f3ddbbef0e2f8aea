"""The communication graph of a swarm at an instant: who can send to whom, how fast, how late, and how surely."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse.csgraph import connected_components

from swarm_mj.dataflow.contacts import Instant, Radios, link_rates
from swarm_mj.dataflow.relays import closed_both_ways
from swarm_mj.errors import MissionError
from swarm_mj.scenarios.constants import SPEED_OF_LIGHT
from swarm_mj.smallbody.occultation import Occluder
from swarm_mj.typing import Array, Ints, Mask


@dataclass(frozen=True, eq=False, kw_only=True)
class Graph:
    """Links of n spacecraft, from row to column.

    Attributes:
        rate_bit_s: Fastest rate that closes, 0 where none does, shape (n, n) [bit/s].
        delay_s: Of the way, without sending, shape (n, n) [s].
        loss: Chance that a message is lost on the way, shape (n, n) [-].
        works: Who sends and hears, shape (n,).

    Raises:
        MissionError: An array does not fit or has impossible values.
    """

    rate_bit_s: Array
    delay_s: Array
    loss: Array
    works: Mask

    def __post_init__(self) -> None:
        """Check."""
        n = len(self.works)
        for name, most in (("rate_bit_s", np.inf), ("delay_s", np.inf), ("loss", 1.0)):
            array = getattr(self, name)
            if array.shape != (n, n):
                raise MissionError(f"{name}: shape {array.shape}, but must be {(n, n)} for {n} spacecraft")
            if not ((array >= 0.0) & (array <= most)).all():
                raise MissionError(f"{name}: must lie between 0 and {most:g} for every link")

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
        return closed_both_ways(self.links, self.works)

    @property
    def degree(self) -> Ints:
        """Neighbours of each, shape (n,)."""
        return self.adjacency.sum(axis=1)

    @property
    def laplacian(self) -> Array:
        """L = D - A of those links, shape (n, n)."""
        return laplacian(self.adjacency)

    @property
    def lambda2(self) -> float:
        """Second eigenvalue of the Laplacian of those that work: how fast they agree; 0 where the graph falls apart."""
        return lambda2(self.adjacency[np.ix_(self.works, self.works)])

    @property
    def components(self) -> list[Ints]:
        """Groups that hear each other, directly or through others, by their lowest number; the lost are in none."""
        _, label = connected_components(self.adjacency, directed=False)
        label = np.where(self.works, label, -1)
        groups = [np.flatnonzero(label == one) for one in np.unique(label[self.works])]
        return sorted(groups, key=lambda group: int(group[0]))


def laplacian(adjacency: Mask) -> Array:
    """L = D - A of a symmetric graph, shape (n, n)."""
    A = adjacency.astype(np.float64)
    return np.diag(A.sum(axis=1)) - A


def lambda2(adjacency: Mask) -> float:
    """Algebraic connectivity (Fiedler 1973): the second smallest eigenvalue of the Laplacian; infinite for one node alone."""
    if len(adjacency) < 2:
        return float("inf")
    value = float(np.linalg.eigvalsh(laplacian(adjacency))[1])
    return value if value > 1e-12 * len(adjacency) else 0.0


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
