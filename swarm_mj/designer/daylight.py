"""When a target is in daylight, for designs that are refused because it is dark."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np

from swarm_mj.flight.environment import epoch_state
from swarm_mj.io import interruption
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.capture import lit
from swarm_mj.observation.coverage import rounded_down
from swarm_mj.observation.raycast import tracer_of
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array

#: Epochs of a rotation that are tried.
STEPS = 144
#: Where the area that is asked for is never lit, epochs count as good with this share of the largest.
GOOD = 0.95


def daylight_text(scenario: Scenario, region: TargetRegion) -> str:
    """Epochs within a rotation from the scenario's on, or releases, with which enough of the target is lit at the arrival.

    Enough is what the design asks for, or, where that is never lit, nearly the most that is. Cast shadows count as in pictures.

    Args:
        scenario: With release, time of flight, tolerance and the largest incidence.
        region: The target.
    """
    around = epoch_state(scenario)
    later_s = 2.0 * np.pi / abs(around.spin_rate) / STEPS * np.arange(2 * STEPS)
    arrivals_s = scenario.design.release_s + scenario.design.time_of_flight_s + later_s[:STEPS]
    sun_A = [around.C_AN(t) @ around.sun.at(t) for t in arrivals_s]
    limit = scenario.observation.max_incidence_deg
    asked = 1.0 - scenario.designer.tolerance_percent / 100.0
    share = _lit_shares(region, sun_A, limit, asked)
    if not share.any():
        return f"no part of it is lit within {limit:g} deg of the Sun during a rotation of the body"
    good = share >= _enough(share.max(), asked)
    least = float(rounded_down(100.0 * share[good].min()))
    part = "all of it" if least == 100.0 else f"at least {least:g} % of it" if least > 0.0 else "a little of it"
    first = int(np.argmax(good & ~np.roll(good, 1))) if not good.all() else 0
    length = STEPS if good.all() else int(np.argmin(np.roll(good, -first)))
    start, end = (float(later_s[first + k]) for k in (0, length - 1))
    interval, design = scenario.telemetry.interval_s, scenario.design
    soonest, latest = (interval * round((design.release_s + t) / interval) for t in (start, end))
    lasting = soonest - design.release_s + scenario.duration_s
    return (
        f"{part} is lit at the arrival with an epoch from {_epoch(scenario, start)} to {_epoch(scenario, end)} or, if the "
        f"mothership's path allows it, with a release from {soonest:g} to {latest:g} s past this one (designer.releases_s, "
        f"with duration_s from {lasting:g} on)"
    )


def _lit_shares(region: TargetRegion, sun_A: list[Array], limit_deg: float, asked: float) -> Array:
    """Share of the area that is lit for each direction to the Sun [-]; 0 where it is too little to matter, see `_enough`.

    Shadows only take away, and are traced only where what the incidence leaves would be enough.
    """
    tracer, share = tracer_of(region.mesh), np.zeros(len(sun_A))
    cells = [lit(region, sun, max_incidence_deg=limit_deg) for sun in sun_A]
    at_most = np.array([region.weighted_area[chosen].sum() for chosen in cells]) / region.total_weighted_area
    for k in np.argsort(-at_most, kind="stable"):
        interruption.check()
        if at_most[k] < _enough(share.max(), asked):
            break
        chosen = lit(region, sun_A[k], max_incidence_deg=limit_deg, tracer=tracer)
        share[k] = region.weighted_area[chosen].sum() / region.total_weighted_area
    return share


def _enough(most: float, asked: float) -> float:
    """Least share that counts where the largest one that is known is `most`; it grows with that."""
    return asked if most >= asked else GOOD * most


def _epoch(scenario: Scenario, later_s: float) -> str:
    return (datetime.fromisoformat(scenario.epoch) + timedelta(seconds=later_s)).isoformat(timespec="seconds")
