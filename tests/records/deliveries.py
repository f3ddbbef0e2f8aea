"""Deliveries made by hand: a few spacecraft and slots, data sent first come, first served."""

from dataclasses import replace

import numpy as np

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.dataflow.tiles import make_tiles
from swarm_mj.mission.links import Obstacle

#: A picture's pixels for each cell [bit], whatever its size.
CELL_BIT = 40_000


def delivery_of(flown, *, mute=(), relay=None, slot_s=60.0, hours=30.0, rate_bit_s=4000, cell_bit=CELL_BIT, lost_bit=0):
    """What becomes of a flight's pictures where one spacecraft hears all others but some, and Earth hears it at times.

    Args:
        flown: Plan, telemetry, result.
        mute: Spacecraft that never close a link: outside a beam.
        relay: Who speaks to Earth, from half the flight on; None: the last.
        slot_s: Of the slots while pictures are taken; later ones are longer [s].
        hours: After the flight.
        rate_bit_s: To Earth; between spacecraft ten times as much.
        cell_bit: Of each cell.
        lost_bit: Of each spacecraft's data, at the end of the flight, with `mute` alone.
    """
    plan, telemetry, result = flown
    first, n, duration = result.coverage.first_seen_by_s, plan.n, plan.scenario.duration_s
    relay = n - 1 if relay is None else relay
    tiles = make_tiles(plan.region.area, first, np.full(first.shape, float(cell_bit)), np.ones(first.shape))
    start = float(np.nanmin(first)) if tiles.count else 0.5 * duration
    edges = np.concatenate((np.arange(start, duration, slot_s), np.linspace(duration, duration + 3600 * hours, 60)))
    contacts = _contacts(edges, n, relay, mute, duration, rate_bit_s)
    lost_slot = int(np.searchsorted(edges, duration))
    return Delivery(**contacts, **_sent(tiles, contacts, relay, mute, lost_bit, lost_slot))


def with_delivery(flown, **how):
    """The same flight with the delivery of `delivery_of`."""
    plan, telemetry, result = flown
    return plan, telemetry, replace(result, delivery=delivery_of(flown, **how))


def _contacts(edges, n, relay, mute, duration, rate_bit_s):
    slots, length = len(edges) - 1, np.diff(edges)
    why_swarm = np.full((slots, n, n), Obstacle.LOST, np.int8)
    why_swarm[:, :, relay] = Obstacle.NONE
    why_swarm[: slots // 8, :, relay] = Obstacle.BODY
    why_swarm[:, list(mute), relay] = Obstacle.BEAM
    why_swarm[:, relay, relay] = Obstacle.LOST
    why_earth = np.full((slots, n), Obstacle.ROLE, np.int8)
    hour = (edges[:-1] - duration) / 3600.0
    why_earth[edges[:-1] > 0.5 * duration, relay] = Obstacle.STATION
    heard = (hour > 1.0) & (hour % 10.0 < 7.0)
    why_earth[heard, relay] = Obstacle.NONE
    station = np.where(heard[:, None] & (np.arange(n) == relay), (hour // 10.0).astype(int)[:, None] % 3, -1)
    bits = np.floor(rate_bit_s * length).astype(np.int64)
    return {
        "edges_s": edges,
        "light_time_s": np.full(slots, 900.0),
        "contact_bit": np.where(why_swarm == Obstacle.NONE, 10 * bits[:, None, None], 0),
        "earth_contact_bit": np.where(why_earth == Obstacle.NONE, bits[:, None], 0),
        "station": station,
        "why_swarm": why_swarm,
        "why_earth": why_earth,
        "relay_distance_m": np.full((slots, n), 2e3),
        "election_s": np.array([duration]),
        "elected": np.arange(n)[None] == relay,
    }


def _sent(tiles, contacts, relay, mute, lost_bit, lost_slot):
    """Every tile from the lowest number that holds it and closes links, whole and in order."""
    slots, n = contacts["earth_contact_bit"].shape
    edges, count = contacts["edges_s"], len(tiles.area)
    sent, earth = np.zeros((slots, n, n), np.int64), np.zeros((slots, n), np.int64)
    arrives, ready_s = np.full(count, np.nan), np.where(np.isfinite(tiles.ready_s), tiles.ready_s, edges[-1])
    up, down = contacts["contact_bit"].max(axis=1)[:, relay].copy(), contacts["earth_contact_bit"][:, relay].copy()
    for q in np.argsort(ready_s.min(axis=0)):
        able = [j for j in np.flatnonzero(tiles.bits[:, q]) if j not in mute]
        if not able:
            continue
        j, bits = able[0], int(tiles.bits[able[0], q])
        t = int(np.searchsorted(edges[:-1], tiles.ready_s[j, q] - 1e-6))
        if j != relay:
            t = _pour(up, sent[:, j, relay], t, bits) + 1
        t = _pour(down, earth[:, relay], t, bits)
        if t < slots:
            arrives[q] = edges[t + 1] + contacts["light_time_s"][t]
    taken = np.array(
        [[tiles.bits[j][tiles.ready_s[j] <= edge + 1e-6].sum() for j in range(n)] for edge in edges]
    ).reshape(len(edges), n)
    moved = np.cumsum(sent.sum(axis=1) - sent.sum(axis=2) - earth, axis=0)
    lost = np.zeros((slots + 1, n), np.int64)
    lost[lost_slot:, list(mute)] = lost_bit
    return {
        "sent_bit": sent,
        "earth_bit": earth,
        "aboard_bit": taken + np.vstack((np.zeros((1, n), np.int64), moved)) - lost,
        "lost_bit": lost,
        "tile_of_cell": tiles.of_cell,
        "tile_area": tiles.area,
        "tile_bit": tiles.bits,
        "tile_lost_bit": np.zeros_like(tiles.bits),
        "tile_overflow_bit": np.zeros_like(tiles.bits),
        "tile_ready_s": np.where(np.isfinite(tiles.ready_s), tiles.ready_s, np.nan),
        "tile_arrives_s": arrives,
        "tile_origin": np.where(np.isnan(arrives), -1, np.argmax(tiles.bits > 0, axis=0)),
        "best_earth_bit": earth.astype(float),
        "best_share": np.where(np.isnan(arrives), 0.0, 1.0),
        "best_full_s": np.array(np.nan if np.isnan(arrives).all() else np.nanmax(arrives)),
        "best_bound_area": np.array(tiles.area[~np.isnan(arrives)].sum()),
    }


def _pour(room, into, t, bits):
    """Send bits in the slots from t on that have room; gives the slot of the last of them, the number of slots for never."""
    while bits and t < len(room):
        now = min(bits, int(room[t]))
        room[t] -= now
        into[t] += now
        bits -= now
        t += 1
    return t - 1 if not bits else len(room)
