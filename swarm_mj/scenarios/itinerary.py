"""The itinerary of a scenario: what each spacecraft visits, when it is released and when it arrives."""

from __future__ import annotations

from pathlib import PurePath
from string import ascii_uppercase
from typing import NamedTuple

import numpy as np

from swarm_mj.scenarios.schema import Scenario, Target
from swarm_mj.scenarios.schema_itinerary import Aim, Visit
from swarm_mj.typing import Array


class Stop(NamedTuple):
    """What one observer does, with all values filled in.

    Attributes:
        target: Number of its target: 0 is the scenario's, k entry k - 1 of `designer.extra_targets`.
        point: Visiting point of that target, numbered from 1.
        altitude_m: Imaging altitude [m].
        time_of_flight_s: From release to arrival [s].
        release_s: Past the epoch [s].
        aim: Where it looks, see `design.aim`.
    """

    target: int
    point: int
    altitude_m: float
    time_of_flight_s: float
    release_s: float
    aim: Aim = "centre"

    @property
    def arrival_s(self) -> float:
        """Time of the arrival past the epoch [s]."""
        return self.release_s + self.time_of_flight_s


def itinerary(scenario: Scenario) -> tuple[Stop, ...]:
    """What each observer does, in the order of the spacecraft."""
    design = scenario.design
    arrivals = design.observers or (Visit(),) * len(design.visiting_points)
    return tuple(
        Stop(
            arrival.target,
            point,
            _given(arrival.imaging_altitude_m, design.imaging_altitude_m),
            _given(arrival.time_of_flight_s, design.time_of_flight_s),
            _given(arrival.release_s, design.release_s),
            arrival.aim or design.aim,
        )
        for arrival, point in zip(arrivals, design.visiting_points, strict=True)
    )


def _given(value: float | None, common: float) -> float:
    return common if value is None else value


def arrival_times(scenario: Scenario) -> Array:
    """When each observer is at its visiting point, shape (n_obs,) [s past the epoch]."""
    return np.array([stop.arrival_s for stop in itinerary(scenario)])


def target_name(number: int) -> str:
    """What a target is called where there are several: A is the scenario's own."""
    return ascii_uppercase[number]


def all_targets(scenario: Scenario) -> tuple[Target, ...]:
    """The scenario's target and those that the designer has to cover besides."""
    alone = scenario.target.model_copy(update={"region": "pyramid", "polygon": None, "polygon_file": None})
    extra = (alone.model_copy(update=extra.model_dump()) for extra in scenario.designer.extra_targets)
    return (scenario.target, *extra)


def target_text(target: Target) -> str:
    """What a target is, in a few words."""
    if target.region == "polygon":
        return "polygon" if target.polygon_file is None else f"polygon of {PurePath(target.polygon_file).name}"
    if target.region == "lit":
        return "lit part, " + ("in the passage" if target.lit_at == "passage" else "at the arrival")
    if target.region == "body":
        return "whole body"
    hemisphere, place = "N" if target.latitude_deg >= 0 else "S", abs(target.latitude_deg)
    return (
        f"{place:g}\N{DEGREE SIGN} {hemisphere}, {target.longitude_deg % 360.0:g}\N{DEGREE SIGN} E, half-angle "
        f"{target.half_angle_deg:g}\N{DEGREE SIGN}"
    )


def last_arrival_s(scenario: Scenario) -> float:
    """When the last observer is at its point [s past the epoch]: the arrival, for what shows the swarm as a whole."""
    return float(arrival_times(scenario).max())
