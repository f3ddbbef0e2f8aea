"""What reached Earth, in the numbers of summary.json and in words, and what would let data arrive that stay aboard."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from swarm_mj.dataflow.delivery import REASONS, STORAGE, TIME, Delivery, Undelivered
from swarm_mj.dataflow.ground import elevations_deg, stations_from
from swarm_mj.dataflow.link_budget import longest_range_m
from swarm_mj.dataflow.radios import Radio, radio_from
from swarm_mj.errors import at_least, at_most
from swarm_mj.flight.downlink import MOST_SPACECRAFT, PROOF_S
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.links import Obstacle
from swarm_mj.observation.coverage import rounded_up_digits
from swarm_mj.records.rounding import by_name, rounded, spread
from swarm_mj.scenarios.constants import DAY, SPEED_OF_LIGHT
from swarm_mj.smallbody.ephemeris import julian_date
from swarm_mj.typing import Array

_RANGE, _STATION = REASONS[Obstacle.RANGE], REASONS[Obstacle.STATION]
#: What would let data arrive, by the reason why they do not, where nothing but a choice follows.
_CHOICES = {
    REASONS[
        Obstacle.BEAM
    ]: "set link.crosslink.antenna: omnidirectional, widen link.hemispherical_half_angle_deg, or elect "
    "another relay (data.election: delivery)",
    REASONS[Obstacle.BODY]: "elect another relay (data.election: delivery), or more of them (data.relays)",
    REASONS[Obstacle.ROLE]: "elect a relay (data.election: medoid)",
    REASONS[Obstacle.POINTING]: "set link.crosslink.antenna: omnidirectional, or spacecraft.wheel_layout: pyramid",
    REASONS[Obstacle.LOST]: "let others see the same area too (designer.fold: 2)",
    TIME: "lengthen data.horizon_s, or choose a faster radio (link.crosslink.radio, link.earth.radio)",
}


def delivered_summary(plan: Plan, result: ObservationResult) -> dict[str, Any]:
    """The keys of summary.json about the way to Earth; empty where it was not computed."""
    delivery, kept = result.delivery, result.kept
    if delivery is None:
        return {}
    names, link = plan.names, plan.scenario.link
    percent = 100.0 / plan.region.total_weighted_area
    return {
        "delivered_percent": rounded(percent * delivery.delivered_area, 6),
        "delivered_percent_bound": _known(percent * float(delivery.best_bound_area), 6),
        "gsd_delivered_m": spread(delivery.delivered_of(kept.gsd_m)),
        "incidence_delivered_deg": spread(delivery.delivered_of(kept.incidence_deg)),
        "seen_bits": delivery.seen_bit,
        "delivered_bits": delivery.delivered_bit,
        "aboard_bits": int(delivery.aboard_bit[-1].sum()),
        "lost_bits": int(delivery.lost_bit[-1].sum()),
        "time_to_full_map_s": _known(delivery.full_s, 3) if result.coverage.seen.all() else None,
        "time_to_all_data_s": _known(delivery.full_s, 3),
        "time_to_all_data_s_bound": _known(float(delivery.best_full_s), 3) if delivery.complete else None,
        "delivery_window_s": [rounded(delivery.edges_s[0], 3), rounded(delivery.edges_s[-1], 3)],
        "link_time_s": by_name(names, link_time_s(delivery), 3),
        "lost_after_s": {names[j]: rounded(t, 3) for j, t in _lost_after(plan, delivery)},
        "relays_after": [names[j] for j in delivery.relay],
        "elected_by": plan.scenario.data.election,
        "elections": [
            {"time_s": rounded(time_s, 3), "relays": [names[j] for j in np.flatnonzero(who)]}
            for time_s, who in zip(delivery.election_s, delivery.elected, strict=True)
        ],
        "radios": {
            "crosslink": link.crosslink.radio,
            "antenna": link.crosslink.antenna,
            "earth": link.earth.radio,
            "network": "own stations" if link.ground.stations else link.ground.network,
        },
        "not_delivered": [
            {
                "reason": part.reason,
                "percent": rounded(percent * part.area, 6),
                "spacecraft": [names[j] for j in part.holders],
                "remedy": remedy(plan, delivery, part),
            }
            for part in delivery.undelivered()
        ],
    }


def link_time_s(delivery: Delivery) -> Array:
    """How long each spacecraft could send to Earth, or to one that could at the time, shape (n,) [s]."""
    speaks = delivery.earth_contact_bit > 0
    reaches = speaks | ((delivery.contact_bit > 0) & speaks[:, None, :]).any(axis=2)
    return np.asarray(np.diff(delivery.edges_s) @ reaches)


def _lost_after(plan: Plan, delivery: Delivery) -> Iterator[tuple[int, float]]:
    """Who hits the body after the flight, and the start of the slot from which it is lost [s]."""
    after = delivery.edges_s[:-1] >= plan.scenario.duration_s
    for j in range(delivery.n):
        lost = delivery.why_earth[:, j] == Obstacle.LOST
        if lost[-1] and (k := int(np.argmax(lost))) and after[k]:
            yield j, float(delivery.edges_s[k])


def undelivered_findings(summary: dict[str, Any]) -> list[str]:
    """One sentence for each part of the map that was seen and does not arrive."""
    lost = [
        f"{rounded_up_digits(part['percent'])} % of the target is seen and not delivered ({_listed(part['spacecraft'])}): "
        f"{part['reason']}; {part['remedy']}"
        for part in summary.get("not_delivered", ())
    ]
    return _unknown_findings(summary) + _fallen_findings(summary.get("lost_after_s", {})) + lost


def _unknown_findings(summary: dict[str, Any]) -> list[str]:
    """What of the way to Earth was not computed."""
    if summary.get("delivered_percent") is None:
        n = summary["spacecraft"]
        many = f"the way to Earth is not computed for {n} spacecraft, at most for {MOST_SPACECRAFT}"
        return [many] if n > MOST_SPACECRAFT else []
    late = f"the best schedule of transfers is not proven: that takes more than {PROOF_S:g} s"
    return [late] if summary.get("delivered_percent_bound") is None else []


def _fallen_findings(fallen: dict[str, float]) -> list[str]:
    if not fallen:
        return []
    hit, first = "hits" if len(fallen) == 1 else "hit", min(fallen.values())
    return [f"{_listed(list(fallen))} {hit} the body after the flight, from t = {first:.0f} s on, with what is aboard"]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:10]) + (f" and {len(names) - 10} more" if len(names) > 10 else "")


def _known(value: float, digits: int) -> float | None:
    return None if np.isnan(value) else rounded(value, digits)


def remedy(plan: Plan, delivery: Delivery, part: Undelivered) -> str:
    """What would let a part of the map arrive that stays aboard."""
    if part.reason == STORAGE:
        given = plan.scenario.data.storage_bit
        return f"data.storage_bit = {given}: at least {most_seen_bit(delivery)} holds all pictures of one"
    if part.reason == _STATION:
        return _lower_horizon(plan, delivery)
    if part.reason == _RANGE:
        earth = not (delivery.earth_contact_bit > 0).any()
        return _stronger_to_earth(plan, delivery) if earth else _longer_crosslink(plan, delivery, part)
    if (swarm := plan.scenario.swarm) is not None and swarm.message_loss == 1.0:
        return "swarm.message_loss = 1: must be below 1 for anything to be relayed"
    return _CHOICES[part.reason]


def most_seen_bit(delivery: Delivery) -> int:
    """Most data that one spacecraft has taken [bit]."""
    return int(delivery.tile_bit.sum(axis=1).max(initial=0))


def _lower_horizon(plan: Plan, delivery: Delivery) -> str:
    ground, environment = plan.scenario.link.ground, plan.environment
    times = 0.5 * (delivery.edges_s[:-1] + delivery.edges_s[1:])
    heard_jd = julian_date(plan.scenario.epoch) + (times + delivery.light_time_s) / DAY
    from_earth_N = -np.array([environment.earth.at(t) for t in times])
    highest = float(elevations_deg(stations_from(ground), heard_jd, from_earth_N).max())
    others = "lengthen data.horizon_s, or choose another link.ground.network"
    if highest < 0.05:
        return f"no station of link.ground sees the swarm in the whole window: {others}"
    given = f"link.ground.min_elevation_deg = {ground.min_elevation_deg:g}"
    return f"{given}: at most {at_most(highest, 3)} lets one hear; or {others}"


def _stronger_to_earth(plan: Plan, delivery: Delivery) -> str:
    link = plan.scenario.link
    radio, best = radio_from(link.earth, "link.earth"), max(s.g_over_t_db_k for s in stations_from(link.ground))
    least_w = _least_power_w(radio, best, float(delivery.light_time_s.min()) * SPEED_OF_LIGHT)
    return f"link.earth.power_w = {radio.power_w:g}: at least {at_least(least_w)} closes the link; or another link.earth.radio"


def _longer_crosslink(plan: Plan, delivery: Delivery, part: Undelivered) -> str:
    link = plan.scenario.link
    nearest_m = float(np.nanmin(delivery.relay_distance_m[:, list(part.holders)]))
    if link.max_range_m is not None and link.max_range_m < nearest_m:
        return f"link.max_range_m = {link.max_range_m:g}: at least {at_least(nearest_m)}, or null for what the budget closes"
    radio = radio_from(link.crosslink, "link.crosslink")
    least_w = _least_power_w(radio, radio.g_over_t_db_k, nearest_m)
    return f"link.crosslink.power_w = {radio.power_w:g}: at least {at_least(least_w)} closes a link; or choose another radio"


def _least_power_w(radio: Radio, g_over_t_db_k: float, range_m: float) -> float:
    """At which the slowest rate closes over a distance [W]: the square of what the range lacks."""
    return radio.power_w * (range_m / longest_range_m(radio, g_over_t_db_k)) ** 2
