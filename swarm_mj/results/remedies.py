"""What would let data arrive that stay aboard, with the least value where one follows."""

from __future__ import annotations

import numpy as np

from swarm_mj.dataflow.delivery import REASONS, STORAGE, TIME, Delivery, Undelivered
from swarm_mj.dataflow.ground import elevations_deg, stations_from
from swarm_mj.dataflow.link_budget import longest_range_m
from swarm_mj.dataflow.radios import Radio, radio_from
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.links import Obstacle
from swarm_mj.scenarios.constants import DAY, SPEED_OF_LIGHT
from swarm_mj.smallbody.ephemeris import julian_date

_RANGE, _STATION = REASONS[Obstacle.RANGE], REASONS[Obstacle.STATION]
#: Where nothing but a choice follows.
_CHOICES = {
    REASONS[
        Obstacle.BEAM
    ]: "set link.crosslink.antenna: omnidirectional, widen link.hemispherical_half_angle_deg, or elect "
    "another relay (data.election: delivery)",
    REASONS[Obstacle.BODY]: "elect another relay (data.election: delivery), or more of them (data.relays)",
    REASONS[Obstacle.ROLE]: "elect a relay (data.election: medoid)",
    REASONS[Obstacle.LOST]: "let others see the same area too (designer.fold: 2)",
    TIME: "lengthen data.horizon_s, or choose a faster radio (link.crosslink.radio, link.earth.radio)",
}


def remedy(plan: Plan, delivery: Delivery, part: Undelivered) -> str:
    """What would let a part of the map arrive.

    Args:
        plan: What was flown.
        delivery: What became of its data.
        part: The part that stays aboard.
    """
    if part.reason == STORAGE:
        given = plan.scenario.data.storage_bit
        return f"data.storage_bit = {given}: at least {most_seen_bit(delivery)} holds all pictures of one"
    if part.reason == _STATION:
        return _lower_horizon(plan, delivery)
    if part.reason == _RANGE:
        earth = not (delivery.earth_contact_bit > 0).any()
        return _stronger_to_earth(plan, delivery) if earth else _longer_crosslink(plan, delivery, part)
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
    return f"link.ground.min_elevation_deg = {ground.min_elevation_deg:g}: at most {_down(highest)} lets one hear; or {others}"


def _stronger_to_earth(plan: Plan, delivery: Delivery) -> str:
    link = plan.scenario.link
    radio, best = radio_from(link.earth, "link.earth"), max(s.g_over_t_db_k for s in stations_from(link.ground))
    least_w = _least_power_w(radio, best, float(delivery.light_time_s.min()) * SPEED_OF_LIGHT)
    return (
        f"link.earth.power_w = {radio.power_w:g}: at least {_up(least_w)} closes the link; or another link.earth.radio"
    )


def _longer_crosslink(plan: Plan, delivery: Delivery, part: Undelivered) -> str:
    link = plan.scenario.link
    nearest_m = float(np.nanmin(delivery.relay_distance_m[:, list(part.holders)]))
    if link.max_range_m is not None and link.max_range_m < nearest_m:
        return f"link.max_range_m = {link.max_range_m:g}: at least {_up(nearest_m)}, or null for what the budget closes"
    radio = radio_from(link.crosslink, "link.crosslink")
    least_w = _least_power_w(radio, radio.g_over_t_db_k, nearest_m)
    return f"link.crosslink.power_w = {radio.power_w:g}: at least {_up(least_w)} closes a link; or choose another radio"


def _least_power_w(radio: Radio, g_over_t_db_k: float, range_m: float) -> float:
    """At which the slowest rate closes over a distance [W]: the square of what the range lacks."""
    return radio.power_w * (range_m / longest_range_m(radio, g_over_t_db_k)) ** 2


def _up(value: float) -> str:
    """Three digits, not below."""
    digits = 2 - int(np.floor(np.log10(value)))
    return f"{np.ceil(value * 10.0**digits) / 10.0**digits:.10g}"


def _down(value: float) -> str:
    return f"{np.floor(value * 10.0) / 10.0:g}"
