"""What no policy of SwarmDownlink-v0 can exceed, knowing everything beforehand: a mixed-integer program, solved by HiGHS.

With x_tijk the share of product k that spacecraft i sends to j (or Earth) in slot t, h_tik the share aboard, e_ti the charge,
u_tij = sum_k size_k x_tijk / B_tij the share of the slot that the link with capacity B is used, and y_k whether product k is
delivered,

    maximise   sum_k value_k y_k,   y_k <= sum_ti x_tiEk,   y_k in {0, 1},
    subject to h_t+1 <= h_t + what comes - what is sent,   sum_k size_k h_tik <= storage,
               sum_i u_tiE <= channels,   sum_j u_tij <= 1,   u of crosslinks as the access allows,
               0 <= e_t+1 <= e_t + sun - base - (P_E + sun - sun at Earth) u_tiE - P_X sum_j u_tij + unmet,   e <= capacity.

Turns, safe modes, whole slots and what is given up with a lost spacecraft only take away from this, so the bound holds.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from swarm_mj.dataflow.network import Access
from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Ints

from .batch import constants_of
from .world import DownlinkConditions, DownlinkTask


def value_bound(task: DownlinkTask, drawn: DownlinkConditions, *, time_limit_s: float = 60.0) -> float:
    """Most value that any policy delivers under these conditions, 0 to 1; for few slots and products.

    Args:
        task: The mission.
        drawn: Of one episode.
        time_limit_s: After which the bound that is proven until then is given [s].

    Raises:
        MissionError: Nothing is proven in that time.
    """
    program = _Program(task, drawn)
    c = np.zeros(program.columns)
    c[program.y] = -drawn.value[program.products]
    whole = np.zeros(program.columns)
    whole[program.y] = 1
    answer = milp(
        c,
        integrality=whole,
        bounds=Bounds(0.0, program.upper()),
        constraints=program.constraints(),
        options={"time_limit": time_limit_s, "mip_rel_gap": 1e-9},
    )
    if answer.status not in (0, 1) or answer.mip_dual_bound is None:
        raise MissionError(
            f"time_limit_s = {time_limit_s}: no bound in that time; allow more, or fewer slots and products"
        )
    return min(1.0, -float(answer.mip_dual_bound))


class _Program:
    """Columns and rows: y, x by link and product, h, e, unmet, in this order."""

    def __init__(self, task: DownlinkTask, drawn: DownlinkConditions) -> None:
        self._constants, self._drawn, self._access = constants_of(task), drawn, task.access
        self._slots, self._n = drawn.sun_J.shape
        self.products: Ints = np.flatnonzero((drawn.size > 0) & (drawn.ready < self._slots))
        count = len(self.products)
        self._links = self._open_links()
        slot, shares = self._slots, len(self._links) * count
        ends = np.cumsum([0, count, shares, (slot + 1) * self._n * count, (slot + 1) * self._n, slot * self._n])
        self.y = np.arange(ends[0], ends[1])
        self._x = np.arange(ends[1], ends[2]).reshape(len(self._links), count)
        self._h = np.arange(ends[2], ends[3]).reshape(slot + 1, self._n, count)
        self._e = np.arange(ends[3], ends[4]).reshape(slot + 1, self._n)
        self._unmet = np.arange(ends[4], ends[5]).reshape(slot, self._n)
        self.columns = int(ends[5])
        self._rows: list[tuple[Ints, Array, float]] = []

    def _open_links(self) -> Ints:
        """Slot, sender, receiver (n for Earth) and capacity of the links that carry something, shape (L, 4)."""
        t, i, j = np.nonzero(self._drawn.capacity_bit)
        return np.column_stack([t, i, j, self._drawn.capacity_bit[t, i, j]])

    def upper(self) -> Array:
        """Of the columns; nothing is sent of a product before it is asked for and after it expired."""
        drawn, upper = self._drawn, np.ones(self.columns)
        asked, expires = drawn.ready[self.products], drawn.expiry[self.products]
        slot = self._links[:, :1]
        upper[self._x] = (slot >= asked) & (slot < expires)
        upper[self._e] = self._constants.battery_J
        upper[self._unmet] = np.maximum(0.0, self._constants.base_J + self._constants.slew_J - drawn.sun_J)
        return upper

    def constraints(self) -> LinearConstraint:
        """All rows, each at most its limit."""
        for k, _ in enumerate(self.products):
            self._row([(self.y[k], 1.0), *((x, -1.0) for x in self._x[self._links[:, 2] == self._n, k])], 0.0)
        self._flows()
        self._shares()
        self._energies()
        row = np.repeat(np.arange(len(self._rows)), [len(columns) for columns, *_ in self._rows])
        column, factor = (np.concatenate([part[k] for part in self._rows]) for k in (0, 1))
        matrix = coo_array((factor, (row, column)), shape=(len(self._rows), self.columns)).tocsr()
        return LinearConstraint(matrix, -np.inf, np.array([limit for *_, limit in self._rows]))

    def _row(self, entries: Iterable[tuple[int, float]], limit: float) -> None:
        columns, factors = zip(*entries, strict=True)
        self._rows.append((np.array(columns, np.int64), np.array(factors, np.float64), limit))

    def _flows(self) -> None:
        """What is aboard at the next edge, and what is sent of what is aboard; storage."""
        drawn, size = self._drawn, self._drawn.size[self.products].astype(np.float64)
        for t in range(self._slots + 1):
            before = self._at(t - 1)
            for i in range(self._n):
                if self._constants.storage_bit < size.sum():
                    self._row(zip(self._h[t, i], size, strict=True), float(self._constants.storage_bit))
                out, into = before[before[:, 1] == i, 0], before[before[:, 2] == i, 0]
                for k, product in enumerate(self.products):
                    new = float(drawn.ready[product] == t and drawn.origin[product] == i)
                    stays = [(self._h[t, i, k], 1.0)] + ([(self._h[t - 1, i, k], -1.0)] if t else [])
                    moves = [*((self._x[a, k], 1.0) for a in out), *((self._x[a, k], -1.0) for a in into)]
                    self._row([*stays, *moves], new)
                    if len(out):
                        sent = [(self._x[a, k], 1.0) for a in out]
                        self._row([(self._h[t - 1, i, k], -1.0), *sent], 0.0)

    def _at(self, t: int) -> Ints:
        """Number, sender and receiver of the links of a slot, shape (m, 3)."""
        number = np.flatnonzero(self._links[:, 0] == t)
        return np.column_stack([number, self._links[number, 1:3]])

    def _used(self, number: Ints, factor: float = 1.0) -> list[tuple[int, float]]:
        """Entries of the share of the slot that these links are used."""
        size = self._drawn.size[self.products]
        return [
            (self._x[a, k], factor * float(size[k]) / float(self._links[a, 3]))
            for a in number
            for k in range(len(size))
        ]

    def _shares(self) -> None:
        """Who can send at the same time."""
        constants = self._constants
        for t in range(self._slots):
            number, sender, receiver = self._at(t).T
            to_earth = receiver == self._n
            groups = [(number[to_earth], constants.rules.channels)]
            groups += [(number[sender == i], 1.0) for i in range(self._n)]
            if self._access is Access.ONE_AT_A_TIME:
                groups.append((number[~to_earth], 1.0))
            elif self._access is Access.TDMA:
                groups += [(number[~to_earth & (sender == i)], 1.0 / self._n) for i in range(self._n)]
            elif constants.rules.half_duplex:
                groups += [(number[~to_earth & ((sender == i) | (receiver == i))], 1.0) for i in range(self._n)]
            for links, limit in groups:
                if len(links):
                    self._row(self._used(links), limit)

    def _energies(self) -> None:
        constants, drawn = self._constants, self._drawn
        for i in range(self._n):
            self._row([(self._e[0, i], 1.0)], float(drawn.charge_J[i]))
        for t in range(self._slots):
            number, sender, receiver = self._at(t).T
            for i in range(self._n):
                turned = float(drawn.sun_J[t, i] - drawn.earth_J[t, i])
                earth = number[(sender == i) & (receiver == self._n)]
                inside = number[(sender == i) & (receiver < self._n)]
                self._row(
                    [
                        (self._e[t + 1, i], 1.0),
                        (self._e[t, i], -1.0),
                        (self._unmet[t, i], -1.0),
                        *self._used(earth, constants.earth_J + turned),
                        *self._used(inside, constants.crosslink_J),
                    ],
                    float(drawn.sun_J[t, i]) - constants.base_J,
                )
