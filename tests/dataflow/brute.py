"""Small random networks, and what they can deliver at most, found in two ways that share nothing with the library's program.

`Paths` lists every way of a bit to Earth, hop by hop; `Flows` is for networks whose limits are plain capacities, where the
largest flow of whole numbers answers.
"""

from itertools import product

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_flow

from swarm_mj.dataflow.network import Access, Network


def random_network(rng, access=None, **given):
    """Up to 4 spacecraft, 6 slots, 4 tiles of few bits; links open now and then; storage tight in every second network."""
    n, q = int(rng.integers(2, 5)), int(rng.integers(1, 5))
    t = int(rng.integers(3, 7 if n < 4 else 6))
    swarm = rng.integers(1, 7, (t, n, n)) * (rng.random((t, n, n)) < 0.45)
    swarm[:, np.arange(n), np.arange(n)] = 0
    bits = rng.integers(1, 7, (n, q)) * (rng.random((n, q)) < 0.6)
    roomy = rng.random() < 0.5
    fields = {
        "edges_s": 60.0 * np.arange(t + 1),
        "swarm_bit": swarm,
        "earth_bit": rng.integers(1, 5, (t, n)) * (rng.random((t, n)) < 0.25),
        "storage_bit": np.full(n, 1000) if roomy else rng.integers(3, 9, n),
        "access": list(Access)[int(rng.integers(3))] if access is None else access,
        "half_duplex": bool(rng.random() < 0.5),
        "earth_channels": int(rng.integers(1, 3)),
        "value": rng.integers(1, 20, q).astype(float),
        "bits": bits,
        "ready": np.where(bits > 0, rng.integers(0, 3, (n, q)), t),
    }
    if rng.random() < 0.3:
        fields["lost_slot"] = np.where(np.arange(n) == rng.integers(n), rng.integers(1, t + 1), t)
    return Network(**(fields | given))


def plain_network(rng):
    """One in which shares are capacities: each sends to one other at most, receives as it sends, and Earth hears all."""
    network = random_network(rng, Access.PARALLEL)
    swarm, n = network.swarm_bit.copy(), network.n_spacecraft
    chosen = rng.integers(0, n, (network.n_slots, n, 1))
    swarm[np.arange(n) != chosen] = 0
    bits = np.where(network.bits > 0, rng.integers(1, 7, network.n_tiles), 0)
    return Network(
        edges_s=network.edges_s,
        swarm_bit=swarm,
        earth_bit=network.earth_bit,
        storage_bit=network.storage_bit,
        access=Access.PARALLEL,
        half_duplex=False,
        earth_channels=n,
        value=network.value,
        bits=bits,
        ready=network.ready,
        lost_slot=network.lost_slot,
    )


def alive(network, spacecraft, edge):
    lost = network.lost_slot[spacecraft]
    return lost == network.n_slots or edge < lost


def copies_of(network):
    """(spacecraft, tile, first edge, bits) of everything that is aboard once."""
    for i, q in product(range(network.n_spacecraft), range(network.n_tiles)):
        if network.bits[i, q] and network.ready[i, q] < network.n_slots and alive(network, i, network.ready[i, q]):
            yield i, q, int(network.ready[i, q]), int(network.bits[i, q])


def paths_from(network, i, edge):
    """Every way to Earth: hops (slot, from, to) and stays (spacecraft, edge)."""
    waited = []
    for t in range(edge, network.n_slots):
        if not alive(network, i, t):
            return
        waited.append((i, t))
        if network.earth_bit[t, i]:
            yield [(t, i, -1)], list(waited)
        for j in np.flatnonzero(network.swarm_bit[t, i]).tolist():
            if t + 1 < network.n_slots and alive(network, j, t + 1):
                for hops, stays in paths_from(network, j, t + 1):
                    yield [(t, i, j), *hops], [*waited, *stays]


def shared(network, hop):
    """Limits in which a hop takes part, with the limit's right side."""
    t, i, j = hop
    if j == -1:
        return [(("earth", t), network.earth_channels), (("earth", t, i), 1)]
    if network.access is Access.ONE_AT_A_TIME:
        return [(("channel", t), 1)]
    if network.access is Access.TDMA:
        return [(("frame", t, i), 1 / network.n_spacecraft)]
    if network.half_duplex:
        return [(("radio", t, i), 1), (("radio", t, j), 1)]
    return [(("sends", t, i), 1)]


class Paths:
    """The linear program over ways to Earth, whose columns are bits along each, then shares of copies."""

    def __init__(self, network):
        self.network, self.copies = network, list(copies_of(network))
        self.starts = sorted({(i, edge) for i, _, edge, _ in self.copies})
        self.ways = [(start, *way) for start in self.starts for way in paths_from(network, *start)]
        self.limits = {}
        for column, (_, hops, stays) in enumerate(self.ways):
            for hop in hops:
                t, i, j = hop
                capacity = network.earth_bit[t, i] if j == -1 else network.swarm_bit[t, i, j]
                for name, right in shared(network, hop):
                    self.limits.setdefault((name, right), []).append((column, 1.0 / capacity))
            for i, t in stays:
                self.limits.setdefault((("aboard", i, t), float(network.storage_bit[i])), []).append((column, 1.0))

    def most(self, fixed=None):
        """Largest value; with the shares of the copies fixed, 0 if they fit and None if they do not."""
        network, n_ways = self.network, len(self.ways)
        n = n_ways + len(self.copies)
        a_ub, b_ub = np.zeros((len(self.limits) + network.n_tiles, n)), np.ones(len(self.limits) + network.n_tiles)
        for row, ((_, right), members) in enumerate(self.limits.items()):
            b_ub[row] = right
            for column, factor in members:
                a_ub[row, column] += factor
        a_eq, c = np.zeros((len(self.starts), n)), np.zeros(n)
        for column, (start, _, _) in enumerate(self.ways):
            a_eq[self.starts.index(start), column] = 1.0
        for column, (i, q, edge, bits) in enumerate(self.copies, n_ways):
            a_eq[self.starts.index((i, edge)), column] = -bits
            a_ub[len(self.limits) + q, column] = 1.0
            c[column] = -network.value[q]
        shares = [(0.0, 1.0)] * len(self.copies) if fixed is None else [(y, y) for y in fixed]
        if not self.copies:
            return 0.0
        bounds = [(0.0, None)] * n_ways + shares
        answer = linprog(c, a_ub, b_ub, a_eq, np.zeros(len(self.starts)), bounds)
        return -answer.fun if answer.status == 0 else None


def choices(network):
    """Which spacecraft's copy of each tile is delivered, -1 for none; most valuable first."""
    holders = [[-1, *(i for i, q, _, _ in copies_of(network) if q == tile)] for tile in range(network.n_tiles)]

    def value(choice):
        return sum(v for v, i in zip(network.value, choice, strict=True) if i >= 0)

    return sorted(((value(choice), choice) for choice in product(*holders)), reverse=True)


def most_whole_by_paths(network):
    paths = Paths(network)
    for value, choice in choices(network):
        if paths.most([float(choice[q] == i) for i, q, _, _ in paths.copies]) is not None:
            return value
    return None


class Flows:
    """The network as a graph: a source, tiles, each spacecraft's edges (in and out, for storage), and Earth."""

    def __init__(self, network):
        t, n = network.n_slots, network.n_spacecraft
        self.network, self.arcs = network, {}
        self.earth = 1 + network.n_tiles + 2 * t * n
        for slot, i in product(range(t), range(n)):
            if not alive(network, i, slot):
                continue
            self.arcs[self.node(i, slot), self.node(i, slot) + 1] = int(network.storage_bit[i])
            if network.earth_bit[slot, i]:
                self.arcs[self.node(i, slot) + 1, self.earth] = int(network.earth_bit[slot, i])
            if slot + 1 < t:
                self.arcs[self.node(i, slot) + 1, self.node(i, slot + 1)] = int(network.storage_bit[i])
                for j in np.flatnonzero(network.swarm_bit[slot, i]).tolist():
                    self.arcs[self.node(i, slot) + 1, self.node(j, slot + 1)] = int(network.swarm_bit[slot, i, j])

    def node(self, i, slot):
        return 1 + self.network.n_tiles + 2 * (slot * self.network.n_spacecraft + i)

    def largest(self, sources, copies):
        """Bits to Earth if the tiles may give as many as `sources` says, from their copies."""
        arcs = dict(self.arcs)
        for q, bits in sources.items():
            arcs[0, 1 + q] = bits
        for i, q, edge, bits in copies:
            arcs[1 + q, self.node(i, edge)] = bits
        ends = np.array(list(arcs))
        size = self.earth + 1
        capacities = np.array(list(arcs.values()), np.int32)
        return maximum_flow(
            csr_array((capacities, (ends[:, 0], ends[:, 1])), shape=(size, size)), 0, self.earth
        ).flow_value


def most_by_flows(network):
    """Largest value where parts of tiles count: the densest tile first, which is best in a polymatroid."""
    flows, copies, sources, value, sent = Flows(network), list(copies_of(network)), {}, 0.0, 0
    sizes = network.bits.max(axis=0)
    for q in sorted((q for q in range(network.n_tiles) if sizes[q]), key=lambda q: -network.value[q] / sizes[q]):
        sources[q] = int(sizes[q])
        now = flows.largest(sources, copies)
        value, sent = value + (now - sent) * network.value[q] / sizes[q], now
    return value


def most_whole_by_flows(network):
    """Largest value of whole tiles, each from one copy: all choices are tried."""
    flows, copies = Flows(network), list(copies_of(network))
    for value, choice in choices(network):
        used = [copy for copy in copies if choice[copy[1]] == copy[0]]
        if flows.largest({q: bits for _, q, _, bits in used}, used) == sum(bits for *_, bits in used):
            return value
    return None
