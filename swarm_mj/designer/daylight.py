"""When a target is in daylight, for designs that are refused because it is dark."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np

from swarm_mj.flight.environment import epoch_state
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.capture import lit
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.smallbody.rotation import spin_dcm

#: Epochs of a rotation that are tried.
STEPS = 144
#: Epochs count as good where the lit area is this share of the largest.
GOOD = 0.95


def daylight_text(scenario: Scenario, region: TargetRegion) -> str:
    """Epochs within a rotation from the scenario's on, or releases, with which most of the target is lit at the arrival.

    Cast shadows are left out.

    Args:
        scenario: With release, time of flight and the largest incidence.
        region: The target.
    """
    around = epoch_state(scenario)
    later_s = 2.0 * np.pi / abs(around.spin_rate) / STEPS * np.arange(2 * STEPS)
    arrivals_s = scenario.design.release_s + scenario.design.time_of_flight_s + later_s[:STEPS]
    sun_A = [spin_dcm(around.C_PN, around.phase0 + around.spin_rate * t) @ around.sun.at(t) for t in arrivals_s]
    limit = scenario.observation.max_incidence_deg
    share = (
        np.array([region.area[lit(region, sun, max_incidence_deg=limit)].sum() for sun in sun_A]) / region.total_area
    )
    if not share.any():
        return f"no part of it comes within {limit:g} deg of the Sun during a rotation of the body"
    good = share >= GOOD * share.max()
    first = int(np.argmax(good & ~np.roll(good, 1))) if not good.all() else 0
    length = STEPS if good.all() else int(np.argmin(np.roll(good, -first)))
    start, end = (float(later_s[first + k]) for k in (0, length - 1))
    interval, design = scenario.telemetry.interval_s, scenario.design
    soonest, latest = (interval * round((design.release_s + t) / interval) for t in (start, end))
    return (
        f"{100.0 * share.max():.0f} % of it or nearly as much is lit at the arrival with an epoch from "
        f"{_epoch(scenario, start)} to {_epoch(scenario, end)} or with a release from {soonest:g} to {latest:g} s past this "
        f"one (designer.releases_s, with duration_s from {soonest + design.time_of_flight_s:g} on)"
    )


def _epoch(scenario: Scenario, later_s: float) -> str:
    return (datetime.fromisoformat(scenario.epoch) + timedelta(seconds=later_s)).isoformat(timespec="seconds")
