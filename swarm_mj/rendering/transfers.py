"""Data under way in a picture: who sends to whom at an instant, packets along the lines, and how much is on Earth by then."""

from __future__ import annotations

from math import isnan

import mujoco
import numpy as np

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.figures.delivery_view import on_earth
from swarm_mj.figures.units import data_unit
from swarm_mj.rendering.decorations import NextGeom, line, sights
from swarm_mj.rendering.frame import Instant, Traffic
from swarm_mj.rendering.palette import PACKET, PACKET_LINE, rgba
from swarm_mj.typing import Array

#: Packets on a line, and how many times a line is passed in a whole flight: about once a second of a film of usual length.
PACKETS, BEATS = 3, 30.0
#: Width of a line [pixel], and its opacity.
WIDTH, ALPHA = 2.5, 0.75
#: Radius of a packet over the drawn length of a spacecraft.
RADIUS = 0.16


#: A line along which data move: its start and its end in N, each of shape (3,) [m].
Way = tuple[Array, Array]


class Transfers:
    """What of a flight's data is sent when, in a flight of some duration [s]."""

    def __init__(self, delivery: Delivery, duration_s: float) -> None:
        self._edges_s, self._duration_s = delivery.edges_s, duration_s
        self._sent, self._earth = delivery.sent_bit > 0, delivery.earth_bit > 0
        self._sent_by_s = np.append(0.0, np.cumsum(delivery.earth_bit.sum(axis=1)))
        self._heard = on_earth(delivery, delivery.earth_bit.astype(np.float64))

    def at(self, t: float) -> Traffic:
        """What there is to draw at time `t` [s]."""
        slot = int(np.searchsorted(self._edges_s, t, side="right")) - 1
        links: list[tuple[int, int]] = []
        if 0 <= slot < len(self._sent):
            links += [(int(i), int(j)) for i, j in np.argwhere(self._sent[slot])]
            links += [(int(i), -1) for i in np.flatnonzero(self._earth[slot])]
        heard = float(np.interp(t, *self._heard))
        sent = float(np.interp(t, self._edges_s, self._sent_by_s))
        beat = t * BEATS / self._duration_s % 1.0
        return Traffic(tuple(links), beat, heard, max(sent - heard, 0.0))


def transfers_of(delivery: Delivery | None, duration_s: float) -> Transfers | None:
    """The transfers of a flight; None where nothing is delivered."""
    return Transfers(delivery, duration_s) if delivery is not None and delivery.delivered_bit > 0 else None


def ways(instant: Instant, radius: float) -> list[Way]:
    """The lines along which data move; those to Earth end at nothing, as lines of sight do. `radius` is the body's [m]."""
    if instant.traffic is None:
        return []
    _, tips = sights(instant, radius)
    r_N = instant.r_BN_N
    return [(r_N[i], tips[i] if j < 0 else r_N[j]) for i, j in instant.traffic.links]


def draw_transfers(
    next_geom: NextGeom, instant: Instant, radius: float, packet_m: float, width_scale: float = 1.0
) -> None:
    """Add the transfers of an instant to a scene; `packet_m`: radius of a packet [m]; `width_scale` is of lines."""
    for way in ways(instant, radius):
        line(next_geom(), *way, width_scale * WIDTH, rgba(PACKET_LINE, ALPHA))
        for place in packets(instant, way):
            _ball(next_geom(), place, packet_m)


def packets(instant: Instant, way: Way) -> Array:
    """Where the packets on a line are, shape (`PACKETS`, 3) [m]; they move from its start to its end."""
    assert instant.traffic is not None
    shares = (np.arange(PACKETS) + instant.traffic.beat) / PACKETS
    start, end = way
    return np.asarray(start + shares[:, None] * (end - start))


def words(traffic: Traffic) -> list[str]:
    """How much is on Earth and how much on the way, for a panel; nothing where that is not known."""
    if isnan(traffic.on_earth_bit):
        return []
    amounts = ((traffic.on_earth_bit, "on Earth"), (traffic.on_way_bit, "on the way to Earth"))
    return [f"{_amount(bits)} {where}" for bits, where in amounts]


def _amount(bits: float) -> str:
    unit = data_unit(bits)
    return f"{bits / unit.bits:.1f} {unit.unit}" if unit.bits > 1.0 else f"{bits:.0f} bit"


def _ball(geom: mujoco.MjvGeom | None, place: Array, radius: float) -> None:
    if geom is not None:
        ball, colour = mujoco.mjtGeom.mjGEOM_SPHERE, np.array(rgba(PACKET), np.float32)
        mujoco.mjv_initGeom(geom, ball, np.full(3, radius), place, np.eye(3).ravel(), colour)
        geom.emission = 1.0
