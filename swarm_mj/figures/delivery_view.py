"""What pictures of the way to Earth show: links over time, data so far, how reasons are painted. Nothing here draws."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.dataflow.delivery import REASONS, STORAGE, TIME, Delivery
from swarm_mj.figures.palette import BLUE, SKY_BLUE
from swarm_mj.mission.links import Obstacle
from swarm_mj.observation.coverage import ROUND_OFF
from swarm_mj.typing import Array, Ints, Mask

#: Beside the values of `Obstacle`: contact with others, none of whom speaks to Earth.
OTHERS = 7
#: Spacecraft whose way to Earth is shown, at most.
MOST_TO_EARTH = 6
#: How much longer than until the last arrival pictures show, as a share of the time from the first picture to it.
MARGIN = 0.06
#: Errors of a sum of areas are no missing ground [%].
LEAST_PERCENT = 0.01 * ROUND_OFF


class AreaStyle(NamedTuple):
    """How a state of a link, or a reason, is painted: words, colour of the area, hatch as Matplotlib writes it."""

    words: str
    colour: str
    hatch: str


#: Of `Obstacle` and `OTHERS`.
LINK_STYLES = {
    int(Obstacle.NONE): AreaStyle("contact", BLUE, ""),
    OTHERS: AreaStyle("contact, but not with a relay", SKY_BLUE, ""),
    int(Obstacle.LOST): AreaStyle("lost", "#B9B9B9", ""),
    int(Obstacle.ROLE): AreaStyle("does not turn there", "#EFEFEF", ""),
    int(Obstacle.POINTING): AreaStyle("no attitude control", "#D9C7E8", "++"),
    int(Obstacle.RANGE): AreaStyle("too far", "#F3C9A8", "////"),
    int(Obstacle.BEAM): AreaStyle("outside a beam", "#EBC3DA", "\\\\\\\\"),
    int(Obstacle.BODY): AreaStyle("the body in between", "#D8CDBE", "xxxx"),
    int(Obstacle.STATION): AreaStyle("no station in view", "#CBE8DC", "...."),
}
#: Of the reasons why data do not arrive.
REASON_STYLES = {
    **{words: LINK_STYLES[int(obstacle)] for obstacle, words in REASONS.items()},
    STORAGE: AreaStyle("storage", "#F3E6B8", "oo"),
    TIME: AreaStyle("time", "#BFDDF0", "----"),
}


class LinkHistory(NamedTuple):
    """A link over the slots.

    Attributes:
        spacecraft: Who sends, from 0.
        to_earth: Whether to Earth; else to the spacecraft that speak to Earth.
        state: `Obstacle` or `OTHERS`, shape (T,).
        station: That hears, -1 for none, shape (T,).
        used: Share of what the slot could carry, shape (T,).
        sent_bit: Altogether.
    """

    spacecraft: int
    to_earth: bool
    state: Ints
    station: Ints
    used: Array
    sent_bit: int


def speakers(delivery: Delivery) -> Ints:
    """Who can speak to Earth at some time, or would, numbers from 0."""
    heard = np.flatnonzero(delivery.earth_contact_bit.any(axis=0))
    return heard if len(heard) else np.asarray(delivery.relay, np.int64)


def links_to_earth(delivery: Delivery) -> list[LinkHistory]:
    """The ways to Earth of those who turn there, at most `MOST_TO_EARTH`: those who sent most."""
    turned = (delivery.why_earth > Obstacle.ROLE).any(axis=0) | delivery.earth_contact_bit.any(axis=0)
    who = np.union1d(np.flatnonzero(turned), delivery.relay).astype(np.int64)
    sent = delivery.earth_bit.sum(axis=0)
    who = np.sort(who[np.argsort(-sent[who], kind="stable")[:MOST_TO_EARTH]])
    return [_to_earth(delivery, int(j)) for j in who]


def _to_earth(delivery: Delivery, j: int) -> LinkHistory:
    capacity, sent = delivery.earth_contact_bit[:, j], delivery.earth_bit[:, j]
    state = np.where(capacity > 0, int(Obstacle.NONE), delivery.why_earth[:, j])
    # In the middle of a slot a link may be closed that is too short for a bit, or one that closes later may not.
    state = np.where((capacity == 0) & (state == Obstacle.NONE), int(Obstacle.STATION), state)
    return LinkHistory(j, True, state, delivery.station[:, j], _share(sent, capacity), int(sent.sum()))


def link_in_swarm(delivery: Delivery, j: int) -> LinkHistory | None:
    """The link of a spacecraft to those that speak to Earth; None for one of these that hands nothing on itself."""
    who, sent = speakers(delivery), delivery.sent_bit[:, j]
    if j in who and not sent.any():
        return None
    others = who[who != j]
    capacity = delivery.contact_bit[:, j]
    state = np.full(delivery.n_slots, int(Obstacle.ROLE))
    if len(others):
        state = delivery.why_swarm[:, j, others].max(axis=1).astype(np.int64)
        state = np.where(state == Obstacle.NONE, int(Obstacle.ROLE), state)
    state = np.where((capacity > 0).any(axis=1), OTHERS, state)
    state = np.where((capacity[:, others] > 0).any(axis=1), int(Obstacle.NONE), state)
    used = np.minimum(_share(sent, capacity).sum(axis=1), 1.0)
    return LinkHistory(j, False, state, np.full(delivery.n_slots, -1), used, int(sent.sum()))


def _share(sent: NDArray[np.int64], capacity: NDArray[np.int64]) -> Array:
    return np.asarray(sent / np.maximum(capacity, 1), np.float64)


def stretches(edges_s: Array, values: Ints) -> list[tuple[float, float, int]]:
    """Begin and end [s] of the stretches of slots with one value, and that value."""
    first = np.flatnonzero(np.append(True, np.diff(values) != 0))
    ends = np.append(first[1:], len(values))
    return [(float(edges_s[a]), float(edges_s[b]), int(values[a])) for a, b in zip(first, ends, strict=True)]


def busy_until_s(delivery: Delivery) -> float:
    """Until when data move, or arrive as soon as they could [s], and a little longer."""
    arrivals = np.append(delivery.tile_arrives_s, delivery.best_full_s if delivery.complete else np.nan)
    moving = delivery.sent_bit.any(axis=(1, 2)) | delivery.earth_bit.any(axis=1)
    last = np.append(arrivals[~np.isnan(arrivals)], delivery.edges_s[1:][moving])
    first = float(delivery.edges_s[0])
    return first + (1.0 + MARGIN) * (float(last.max()) - first) if len(last) else 0.0


def last_shown_s(delivery: Delivery) -> float:
    """Until when pictures show [s]: until data no longer move, or to the end of the plan where not all arrive."""
    end, busy = float(delivery.edges_s[-1]), busy_until_s(delivery)
    return busy if delivery.complete and busy > 0.0 else max(end, busy)


def on_earth(delivery: Delivery, sent_bit: Array) -> tuple[Array, Array]:
    """Times [s] and what Earth has received by then of bits sent by all in each slot, shape (T, n); straight lines between."""
    light = delivery.light_time_s
    times = np.append(delivery.edges_s[0] + light[0], delivery.edges_s[1:] + light)
    return np.maximum.accumulate(times), np.append(0.0, np.cumsum(sent_bit.sum(axis=1)))


def is_proven(delivery: Delivery) -> bool:
    """Whether the best schedule was asked for."""
    return not bool(np.isnan(delivery.best_bound_area))


def percent_over_time(delivery: Delivery, area: float, times_s: Array) -> Array:
    """Share of a target of some area [m^2] that is on Earth by given times [%]."""
    return 100.0 / area * delivery.delivered_area_over_time(times_s)


def cells_by_reason(delivery: Delivery) -> dict[str, Mask]:
    """Cells that were seen and do not arrive, by reason, each of shape (cells,)."""
    reasons, tile = delivery.reasons(), delivery.tile_of_cell
    found: dict[str, Mask] = {}
    for reason in dict.fromkeys(reasons.values()):
        tiles = [q for q, why in reasons.items() if why == reason]
        found[reason] = np.isin(tile, tiles)
    return found
