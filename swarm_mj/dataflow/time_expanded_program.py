"""The best delivery as a linear program: a flow through the network, expanded in time.

With y_iq the share of tile q that is taken from spacecraft i's copy, u_tij the share of slot t that link ij is used and s the
bits that stay aboard from one edge at which something happens to the next,

    maximise   sum_iq value_q y_iq
    subject to sum_i y_iq <= 1,   what comes aboard = what is sent + what stays   (each spacecraft, each edge),
               aboard <= storage,   the shares obey the access rules,   nothing stays after the last edge,

so that every bit that is taken reaches Earth within the window. Columns are left out that cannot carry anything, which alters
no optimum: links that do not close; links before data can be aboard the sender, or too late for them to reach Earth; copies
too late to reach Earth; edges at which nothing happens; limits of storage that all data together do not reach.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array

from swarm_mj.dataflow.network import EARTH, Access, Network
from swarm_mj.typing import Array, Indices, Ints, Mask


class Links(NamedTuple):
    """Links that can carry data to Earth."""

    slot: Ints  #: when, shape (links,)
    sender: Ints  #: who sends, shape (links,)
    receiver: Ints  #: who receives, -1 for Earth, shape (links,)
    bits: Ints  #: what the slot holds [bit], shape (links,)


@dataclass(frozen=True, eq=False, kw_only=True)
class Program:
    """minimise c x subject to A_eq x = 0, A_ub x <= b_ub, 0 <= x <= upper; x holds copies, links, stays in this order."""

    c: Array  #: what a column costs: minus the value of its tile in units of `value_unit`, shape (columns,)
    a_eq: csr_array  #: one row for each spacecraft and edge at which something happens there
    a_ub: csr_array  #: inequalities for tiles, storage and access
    b_ub: Array  #: their limits
    upper: Array  #: of the columns, all finite, shape (columns,)
    copies: Ints  #: spacecraft and tile of the copies, shape (copies, 2)
    links: Links  #: the links
    value_unit: float  #: unit of the values [m^2]


def build_program(network: Network, neighbours: int | None = None) -> Program:
    """The linear program of a network.

    Args:
        network: What to deliver.
        neighbours: See `optimum`.
    """
    links, latest = useful_links(network, neighbours)
    spacecraft, tiles = np.nonzero(_in_time(network, latest))
    copies = np.stack([spacecraft, tiles], axis=1).astype(np.int64)
    nodes, stays = _nodes(network, links, copies)
    total = int(network.bits.max(axis=0, initial=0)[np.unique(tiles)].sum())
    room = np.minimum(network.storage_bit, total)
    bit_unit = float(np.median(links.bits)) if links.bits.size else 1.0
    value_unit = float(network.value[tiles].max(initial=0.0)) or 1.0

    n_copies, n_links = len(copies), len(links.slot)
    n_columns = n_copies + n_links + len(stays)
    upper = np.ones(n_columns)
    upper[n_copies + n_links :] = room[stays[:, 0]] / bit_unit
    if network.access is Access.TDMA:
        upper[n_copies : n_copies + n_links][links.receiver != EARTH] = 1.0 / network.n_spacecraft
    c = np.zeros(n_columns)
    c[:n_copies] = -network.value[tiles] / value_unit

    balance, aboard = _balance(network, nodes, copies, links, stays, bit_unit)
    rows = [_at_most_one(tiles, 0), *_access_rows(network, links, n_copies)]
    if network.delay:
        rows.append(_storage_rows(aboard, network.storage_bit, nodes, total, bit_unit))
    a_ub, b_ub = _stacked(rows, n_columns)
    return Program(
        c=c,
        a_eq=_matrix(*balance, (int(nodes.max(initial=-1)) + 1, n_columns)),
        a_ub=a_ub,
        b_ub=b_ub,
        upper=upper,
        copies=copies,
        links=links,
        value_unit=value_unit,
    )


def reachable_value(network: Network) -> float:
    """Area of the tiles of which some copy finds a way to Earth in time, however little fits through it [m^2]."""
    _, latest = useful_links(network)
    return float(network.value[_in_time(network, latest).any(axis=0)].sum())


def _in_time(network: Network, latest: Ints) -> Mask:
    in_time: Mask = network.kept & (network.ready <= latest[:, None]) & (network.value > 0)
    return in_time


def useful_links(network: Network, neighbours: int | None = None) -> tuple[Links, Ints]:
    """Links over which data can go on to Earth, and the last slot in which sending from each spacecraft is of use.

    Returns:
        The links by slot, and the slots, -1 where none is, shape (n,).
    """
    swarm, earth = network.open_links()
    if neighbours is not None:
        swarm = np.where(_near(swarm, earth, neighbours), swarm, 0)
    n_slots, n = network.n_slots, network.n_spacecraft
    earliest = np.where(network.kept, network.ready, n_slots).min(axis=1, initial=n_slots)
    has = np.zeros((n_slots, n), np.bool_)
    for t in range(n_slots):
        more = True
        while more:  # over several links in one slot, without a delay
            has[t] = earliest <= t
            reached = (swarm[t][has[t]] > 0).any(axis=0) & (earliest > t + network.delay)
            earliest[reached] = t + network.delay
            more = bool(reached.any())
    latest = np.full(n, -1, np.int64)
    of_use = np.zeros((n_slots, n), np.bool_)
    for t in reversed(range(n_slots)):
        more = True
        while more:
            of_use[t] = latest >= t + network.delay
            goes_on = ((earth[t] > 0) | (swarm[t][:, of_use[t]] > 0).any(axis=1)) & (latest < t)
            latest[goes_on] = t
            more = bool(goes_on.any())
    slot, sender, receiver = np.nonzero(has[:, :, None] & of_use[:, None, :] & (swarm > 0))
    slot_e, sender_e = np.nonzero(has & (earth > 0))
    links = Links(
        np.concatenate([slot, slot_e]),
        np.concatenate([sender, sender_e]),
        np.concatenate([receiver, np.full(len(slot_e), EARTH)]),
        np.concatenate([swarm[slot, sender, receiver], earth[slot_e, sender_e]]),
    )
    return links, latest


def _near(swarm: Ints, earth: Ints, neighbours: int) -> Mask:
    """Links to who ever hears Earth, and to the `neighbours` others to whom most can be sent in the slot."""
    relays: Mask = np.any(earth > 0, axis=0)
    others = np.where(relays, 0, swarm)
    place = np.argsort(np.argsort(-others, axis=2, kind="stable"), axis=2, kind="stable")
    return relays | (place < neighbours)


def _nodes(network: Network, links: Links, copies: Ints) -> tuple[Ints, Ints]:
    """Number of each spacecraft and edge at which something happens, -1 elsewhere, shape (T + 1, n), and the stays between."""
    happens = np.zeros((network.n_slots + 1, network.n_spacecraft), np.bool_)
    happens[links.slot, links.sender] = True
    inside = links.receiver != EARTH
    happens[links.slot[inside] + network.delay, links.receiver[inside]] = True
    happens[network.ready[copies[:, 0], copies[:, 1]], copies[:, 0]] = True
    numbers = np.full(happens.shape, -1, np.int64)
    numbers[happens] = np.arange(np.count_nonzero(happens))
    spacecraft, edge = np.nonzero(happens.T)
    follows = spacecraft[1:] == spacecraft[:-1]
    return numbers, np.stack([spacecraft[:-1], edge[:-1], edge[1:]], axis=1)[follows].astype(np.int64)


Entries = tuple[Ints, Ints, Array]


def _balance(
    network: Network, nodes: Ints, copies: Ints, links: Links, stays: Ints, bit_unit: float
) -> tuple[Entries, Entries]:
    """Entries (row, column, units) of what comes aboard less what leaves, and of what comes aboard alone."""
    n_copies, n_links = len(copies), len(links.slot)
    inside = np.flatnonzero(links.receiver != EARTH)
    column, sizes = n_copies + np.arange(n_links), links.bits / bit_unit
    stay = n_copies + n_links + np.arange(len(stays))
    ones = np.ones(len(stays))
    copy = (copies[:, 0], copies[:, 1])
    comes = [
        (nodes[network.ready[copy], copies[:, 0]], np.arange(n_copies), network.bits[copy] / bit_unit),
        (nodes[links.slot[inside] + network.delay, links.receiver[inside]], column[inside], sizes[inside]),
    ]
    leaves = (nodes[links.slot, links.sender], column, -sizes)
    into, out = (nodes[stays[:, 2], stays[:, 0]], stay, ones), (nodes[stays[:, 1], stays[:, 0]], stay, -ones)
    return _joined([*comes, leaves, into, out]), _joined([*comes, into])


def _joined(entries: list[Entries]) -> Entries:
    row, column, units = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    return row, column, units


class Inequalities(NamedTuple):
    """Inequalities: entries (row, column, factor) and the limit of each row."""

    row: Ints
    column: Ints
    factor: Array
    limit: Array


def _at_most_one(key: Ints, first: int, columns: Ints | None = None) -> Inequalities:
    """Columns of the same key add up to at most 1; a key with one column needs no row."""
    columns = first + np.arange(len(key)) if columns is None else columns
    _, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
    several = count > 1
    number = np.cumsum(several) - 1
    used = several[inverse]
    return Inequalities(
        number[inverse][used], columns[used], np.ones(np.count_nonzero(used)), np.ones(np.count_nonzero(several))
    )


def _access_rows(network: Network, links: Links, first: int) -> list[Inequalities]:
    """How shares of the same slot add up, on the crosslink and to Earth."""
    n = network.n_spacecraft
    column = first + np.arange(len(links.slot))
    inside = links.receiver != EARTH
    slot, sends = links.slot[inside], links.slot[inside] * n + links.sender[inside]
    if network.access is Access.ONE_AT_A_TIME:
        rows = [_at_most_one(slot, first, column[inside])]
    elif network.access is Access.TDMA:
        # Where each sends in its own part of the frame, nobody sends and receives at once.
        rows = [_limited(_at_most_one(sends, first, column[inside]), 1.0 / n)]
    elif network.half_duplex:
        receives = slot * n + links.receiver[inside]
        rows = [_at_most_one(np.concatenate([sends, receives]), first, np.tile(column[inside], 2))]
    else:
        rows = [_at_most_one(sends, first, column[inside])]
    earth = _limited(_at_most_one(links.slot[~inside], first, column[~inside]), float(network.earth_channels))
    return [*rows, earth]


def _limited(rows: Inequalities, limit: float) -> Inequalities:
    return rows._replace(limit=np.full(len(rows.limit), limit))


def _storage_rows(aboard: Entries, storage: Ints, nodes: Ints, total: int, bit_unit: float) -> Inequalities:
    """What comes aboard an edge fits; where only what stayed is aboard, its own limit says so."""
    spacecraft = np.empty(int(nodes.max(initial=-1)) + 1, np.int64)
    _, who = np.nonzero(nodes >= 0)
    spacecraft[nodes[nodes >= 0]] = who
    row, column, units = aboard
    count = np.bincount(row, minlength=len(spacecraft))
    tight = (storage[spacecraft] < total) & (count > 0)
    number = np.cumsum(tight) - 1
    used = tight[row]
    return Inequalities(number[row][used], column[used], units[used], storage[spacecraft[tight]] / bit_unit)


def _stacked(rows: list[Inequalities], n_columns: int) -> tuple[csr_array, Array]:
    starts = np.concatenate([[0], np.cumsum([len(part.limit) for part in rows])])
    row = np.concatenate([part.row + start for part, start in zip(rows, starts[:-1], strict=True)])
    column = np.concatenate([part.column for part in rows])
    factor = np.concatenate([part.factor for part in rows])
    return _matrix(row, column, factor, (int(starts[-1]), n_columns)), np.concatenate([part.limit for part in rows])


def _matrix(row: Ints, column: Ints | Indices, value: Array, shape: tuple[int, int]) -> csr_array:
    return csr_array(coo_array((value, (row, column)), shape=shape))
