"""From a scenario to its targets: the region to cover, the points to visit, and when each spacecraft flies there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight.environment import companion_from, epoch_state
from swarm_mj.flight.light import lit_sometime
from swarm_mj.mission.behaviors import Behavior, MissionBehavior, PointAims, elect_medoid
from swarm_mj.mission.deployment import groups
from swarm_mj.mission.polygon import Polygon, polygon_from
from swarm_mj.mission.target import (
    WIDE,
    Feature,
    Pyramid,
    TargetRegion,
    WholeBody,
    automatic_cell_size,
    build_targets,
    check_visiting_points,
    local_axes,
    place_of,
)
from swarm_mj.observation.companion import Screen
from swarm_mj.observation.raycast import tracer_of
from swarm_mj.scenarios.itinerary import Stop, all_targets, itinerary
from swarm_mj.scenarios.schema import Scenario, Target
from swarm_mj.simulator.faults.dispersions import shifted_target, target_shift
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array, Mask

#: How far out the communications spacecraft of several targets passes, in distances of the observers it goes with.
ABOVE = 1.1


def legs(
    scenario: Scenario, stops: Sequence[Stop], points_A: Array, behavior: Behavior, region: TargetRegion
) -> dict[str, Array]:
    """Where each spacecraft goes, when it leaves and how long it flies, as `deploy` takes them.

    Whether a communications spacecraft is added is a property of the behaviour, which counts it: it goes to the mean of the
    observers' points at the common times, or where no observer flies at these at those of most observers. Between the points
    of several targets, or of one that reaches around the body, the body itself may lie: there it goes above those of the target
    with most observers, or above the one nearest to all others, at the times of the first of them.
    """
    release_s = [stop.release_s for stop in stops]
    flight_s = [stop.time_of_flight_s for stop in stops]
    if behavior.dedicated_communications:
        sent_to = [stop.target for stop in stops]
        busiest = max(sorted(set(sent_to)), key=sent_to.count)
        if len(set(sent_to)) == 1 and not region.is_wide:
            times = list(zip(release_s, flight_s, strict=True))
            common = scenario.design.release_s, scenario.design.time_of_flight_s
            place_A = points_A.mean(axis=0)
            release, flight = common if common in times else max(sorted(set(times)), key=times.count)
        else:
            there = [k for k, target in enumerate(sent_to) if target == busiest]
            if region.is_wide:
                there = [elect_medoid(points_A)]
            place_A, release, flight = ABOVE * points_A[there].mean(axis=0), release_s[there[0]], flight_s[there[0]]
        points_A = np.vstack((points_A, place_A))
        release_s.append(release)
        flight_s.append(flight)
    return {"points_A": points_A, "release_s": np.array(release_s), "time_of_flight": np.array(flight_s)}


def with_aims(scenario: Scenario, behavior: Behavior, region: TargetRegion) -> Behavior:
    """The behaviour with the observers' aims, see `design.aim`.

    Raises:
        ScenarioError: It decides by itself where observers look.
    """
    stops = itinerary(scenario)
    if all(stop.aim == "centre" for stop in stops):
        return behavior
    if isinstance(behavior, MissionBehavior):
        raise ScenarioError(
            f"design.aim = point: behavior.name = {scenario.behavior.name} decides by itself where observers look; must be "
            "centre"
        )
    points_A = np.full((len(stops), 3), np.nan)
    for k, stop in enumerate(stops):
        if stop.aim == "point":
            points_A[k] = region.vertices[region.targets[stop.target].visiting_vertex[stop.point - 1]]
    return PointAims(behavior, points_A)


def target_from(scenario: Scenario, shape: ShapeModel) -> TargetRegion:
    """The scenario's targets in one region, subdivided where its camera asks for it."""
    return _region(scenario, shape, [feature_of(target) for target in all_targets(scenario)])


def feature_of(target: Target) -> Feature:
    """What of a body a target is; the lit part is found on all of it."""
    if target.region == "polygon":
        return polygon_from(target)
    if target.region != "pyramid":
        return WholeBody(target.weight)
    return Pyramid(target.latitude_deg, target.longitude_deg, target.half_angle_deg, target.edges, target.weight)


def pyramid_about(target: Target) -> Pyramid:
    """The pyramid about a target that bounds it, for behaviours that aim at a target.

    Raises:
        MissionError: No pyramid holds it, or only one that reaches too far around the body.
    """
    feature = feature_of(target)
    if isinstance(feature, Pyramid):
        return feature
    if feature.half_angle > WIDE:
        raise MissionError(
            f"target.region = {target.region}: reaches too far around the body to be swept from one place; must be a pyramid "
            "or a polygon within 75 deg of its middle, or choose another behavior.name"
        )
    return Pyramid(*_place_of(feature), float(np.degrees(feature.half_angle)), "side")


def _place_of(feature: Feature) -> tuple[float, float]:
    """Latitude and longitude of its middle [deg]."""
    latitude, longitude = place_of(feature.axes[2])
    return float(latitude), float(longitude)


def _region(scenario: Scenario, shape: ShapeModel, features: Sequence[Feature]) -> TargetRegion:
    target = scenario.target
    cell_size = target.cell_size_m
    if cell_size == "auto":
        cell_size = automatic_cell_size(scenario.design.imaging_altitude_m, scenario.camera.half_angle_deg)
    region = _built(shape, tuple(features), cell_size, target.region)
    return region.restricted(_lit(scenario, region)) if target.region == "lit" else region


@lru_cache(maxsize=4)
def _built(shape: ShapeModel, features: tuple[Feature, ...], cell_size_m: float | None, kind: str) -> TargetRegion:
    """Built once for all that ask for the same, as flights of a campaign and kinds of a study do."""
    return build_targets(shape, features, cell_size_m=cell_size_m, kind=kind)


def _lit(scenario: Scenario, region: TargetRegion) -> Mask:
    """Cells that are lit when `target.lit_at` says."""
    observation, design = scenario.observation, scenario.design
    times = np.array([picture.seconds_after(scenario.epoch) for picture in observation.sequence])
    if not len(times):
        times = np.arange(0.0, scenario.duration_s + 0.5 * observation.interval_s, observation.interval_s)
    if scenario.target.lit_at == "arrival":
        times = np.array([design.release_s + design.time_of_flight_s])
    tracer = tracer_of(region.mesh)
    around, companion = epoch_state(scenario), companion_from(scenario)
    screen = None if companion is None else Screen(companion, around)
    found = lit_sometime(region, around, times, observation.max_incidence_deg, tracer=tracer, screen=screen)
    if not found.any():
        raise MissionError(f"target.lit_at = {scenario.target.lit_at}: nothing of {region.mesh.name} is lit then")
    return found


def true_target(scenario: Scenario, shape: ShapeModel, planned: TargetRegion) -> TargetRegion:
    """The targets where they really are: the visiting points were chosen for the planned ones."""
    east, north = target_shift(scenario.dispersions, scenario.seed)
    if east == north == 0.0:
        return planned
    moved: list[Feature] = []
    for target, part in zip(all_targets(scenario), planned.targets, strict=True):
        radius, feature = float(np.linalg.norm(part.centroid_A.mean(axis=0))), feature_of(target)
        if isinstance(feature, Polygon):
            here = _place_of(feature)
            there = shifted_target(*here, east, north, radius)
            moved.append(replace(feature, turn=local_axes(*there).T @ local_axes(*here)))
        elif isinstance(feature, Pyramid):
            latitude, longitude = shifted_target(target.latitude_deg, target.longitude_deg, east, north, radius)
            moved.append(feature._replace(latitude_deg=latitude, longitude_deg=longitude))
    return _region(scenario, shape, moved)


def visiting_points(scenario: Scenario, shape: ShapeModel, region: TargetRegion) -> Array:
    """The observers' visiting points in A, shape (n_obs, 3) [m]."""
    stops = itinerary(scenario)
    chosen = np.empty((len(stops), 3))
    where = np.array([(stop.target, stop.altitude_m) for stop in stops])
    for number, who in groups(where[:, 0], where[:, 1]):
        part = region.targets[int(number)]
        points = part.visiting_points_A(stops[who[0]].altitude_m, projection=scenario.design.projection)
        for k in who:
            if not 1 <= stops[k].point <= len(points):
                whose = "the target's" if len(region.targets) == 1 else f"target {int(number)}'s"
                raise ScenarioError(
                    f"design.visiting_points: {stops[k].point} is not one of {whose} points, 1 to {len(points)}"
                )
            chosen[k] = points[stops[k].point - 1]
    check_visiting_points(shape, chosen)
    return chosen
