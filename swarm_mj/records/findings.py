"""What a reader should know before believing a run's numbers."""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

import numpy as np

from swarm_mj.flight.environment import EROS_SHAPE
from swarm_mj.flight.observe import picture_samples
from swarm_mj.flight.plan import as_planned
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.records.delivered import undelivered_findings
from swarm_mj.records.design_files import design_differences
from swarm_mj.records.formation import formation_findings
from swarm_mj.records.observed import observed_findings
from swarm_mj.records.propulsion import propulsion_findings
from swarm_mj.records.run_record import RunRecord
from swarm_mj.records.summary import working
from swarm_mj.scenarios.itinerary import arrival_times
from swarm_mj.scenarios.schema import Body, Scenario
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.typing import Array

#: Pointing errors above this at the end or before a switch are worth a remark [deg].
SETTLED_DEG = 0.1
#: A turn takes about as long; who changes targets sooner cannot have settled, and need not mean to [s].
SETTLING_S = 120.0
#: Events that are listed one by one.
MOST_EVENTS = 30
#: Spacecraft, and pairs of them, that are named one by one.
MOST_NAMES = 10


class Late(NamedTuple):
    """A pointing error [deg] that is worth a remark: whose, and how long the target had been held [s]."""

    name: str
    error_deg: float
    held_s: float


def summary_findings(summary: dict[str, Any]) -> list[str]:
    """Remarks on what went wrong, pointing that had not settled and wheels at their limits, one sentence each."""
    found = [
        *_pointing_findings(_at_the_arrival(summary), "at the arrival", "the arrival came"),
        *_pointing_findings(_at_the_end(summary), "at the end", "the flight ended"),
        *_pointing_findings(_before_switches(summary), "before a switch", "targets were switched again"),
    ]
    cut = ", ".join(f"{name} for {s:g} s" for name, s in summary["wheel_saturation_s"].items() if s > 0)
    found += [f"wheel limits cut the controller's torque: {cut}"] if cut else []
    found += summary.get("navigation", {}).get("findings", ())
    found += summary.get("optical", {}).get("findings", ())
    return [
        *event_findings(summary),
        *summary.get("encounter_findings", ()),
        *summary.get("deployment_findings", ()),
        *formation_findings(summary),
        *observed_findings(summary),
        *undelivered_findings(summary),
        *found,
        *(f"{summary['spacecraft_file']}: {note}" for note in summary.get("spacecraft_notes", ())),
    ]


def _at_the_arrival(summary: dict[str, Any]) -> list[Late]:
    found = summary.get("pointing_error_deg_arrival", {}).items()
    return [Late(name, error, inf) for name, error in found if error > SETTLED_DEG]


def _at_the_end(summary: dict[str, Any]) -> list[Late]:
    held = summary.get("target_held_s_final", {})
    return [
        Late(name, error, held.get(name, inf))
        for name, error in working(summary, "pointing_error_deg_final").items()
        if error > SETTLED_DEG
    ]


def _before_switches(summary: dict[str, Any]) -> list[Late]:
    return [
        Late(name, switch["error_before_deg"], switch.get("target_held_s", inf))
        for name, switches in working(summary, "mode_switches").items()
        for switch in switches
        if switch["error_before_deg"] > SETTLED_DEG
    ]


def _pointing_findings(late: list[Late], when: str, short: str) -> list[str]:
    """One sentence on pointing that should have settled, one on targets that were held too briefly for that."""
    slow, brief = ([one for one in late if (one.held_s >= SETTLING_S) is so] for so in (True, False))
    words = f"{short} less than {SETTLING_S:g} s after a target was chosen, while still turning"
    told = ((slow, f"pointing had not settled {when}"), (brief, words))
    return [f"{said}: {_who(some)}" for some, said in told if some]


def _who(late: list[Late]) -> str:
    names = ", ".join(dict.fromkeys(one.name for one in late))
    return f"{names}, up to {max(one.error_deg for one in late):.3g} deg"


def event_findings(summary: dict[str, Any]) -> list[str]:
    """One sentence for each fault and what followed from it, the first `MOST_EVENTS`."""
    events = summary.get("events", ())
    found = [
        f"t = {event['time_s']:g} s, {event['spacecraft']}: {event['kind'].replace('_', ' ')}"
        + (f" ({event['detail']})" if event["detail"] else "")
        for event in events[:MOST_EVENTS]
    ]
    more = len(events) - len(found)
    return found + ([f"and {more} more events, see summary.json"] if more else [])


def near_collision_findings(summary: dict[str, Any]) -> list[str]:
    """One sentence for each pair that came too close, the `MOST_NAMES` nearest."""
    pairs = sorted(summary["near_collisions"], key=lambda near: near["distance_m"])
    found = [
        f"near-collision of {near['spacecraft'][0]} and {near['spacecraft'][1]}, {near['distance_m']:.1f} m at "
        f"t = {near['time_s']:.0f} s"
        for near in pairs[:MOST_NAMES]
    ]
    more = len(pairs) - len(found)
    return found + ([f"and {more} more near-collisions, see summary.json"] if more else [])


def imaging_findings(scenario: Scenario, summary: dict[str, Any]) -> list[str]:
    """One sentence on observers that never came inside the imaging radius, where pictures are taken."""
    radius_km = scenario.behavior.imaging_radius_m / 1e3
    distances = list(summary["least_distance_to_centre_km"].items())[: summary["observers"]]
    outside = {name: distance for name, distance in distances if distance > radius_km}
    if not outside or scenario.behavior.name == "body_tracking":  # which knows no radius
        return []
    nothing = "no picture was taken: " if not summary["images"] else ""
    names = ", ".join(outside) if len(outside) <= MOST_NAMES else f"{len(outside)} spacecraft"
    who = "no observer ever came" if len(outside) == len(distances) else f"{names} never came"
    return [
        f"{nothing}{who} inside behavior.imaging_radius_m = {radius_km:g} km of the body's centre; "
        f"the closest approach was {min(outside.values()):g} km"
    ]


def direction_findings(run: RunRecord) -> list[str]:
    """One sentence on observers that were told a direction in place of a target when pictures were due: they take none."""
    due = picture_samples(run.scenario, run.telemetry)
    told = run.telemetry["mode"].values[due, : run.n_observers] == TargetKind.DIRECTION
    if not told.any() or run.scenario.camera.gimbal is not None:  # which looks at the body all the same
        return []
    who = f"{int(told.any(axis=0).sum())} of {run.n_observers} observers"
    return [
        f"{who} took no picture at {int(told.sum())} of {told.size} due: "
        f"behavior.name = {run.scenario.behavior.name} answered DIRECTION, and pictures are taken while ASTEROID or SURFACE is "
        "tracked; answer SURFACE with a point in A"
    ]


def borrowed_findings(scenario: Scenario) -> list[str]:
    """One sentence on what a body of one's own takes from Eros.

    Values are compared, not keys that were given: a scenario that a run wrote gives all of them.
    """
    body = scenario.body
    if body.shape == EROS_SHAPE:
        return []
    found = []
    for section, effect in (("rotation", "pole and spin"), ("orbit", "where the Sun and the Earth stand")):
        values, eros = getattr(body, section), getattr(Body(), section)
        same = [key for key in type(values).model_fields if getattr(values, key) == getattr(eros, key)]
        if len(same) == len(type(values).model_fields):
            found.append(f"body.{section} ({effect})")
        elif same:
            found += [f"body.{section}.{key}" for key in same]
    if not found:
        return []
    if scenario.epoch == Scenario.model_fields["epoch"].default:
        found.append("epoch (daylight on Eros's target)")
    return [f"body.shape is {body.shape}, but these are the values of 433 Eros: {', '.join(found)}"]


def findings(run: RunRecord) -> list[str]:
    """Everything that a reader should know of a run, one sentence each; see the functions that find it."""
    return [*summary_findings(run.summary), *near_collision_findings(run.summary), *run_findings(run)]


def run_findings(run: RunRecord) -> list[str]:
    """Remarks that need more than the summary: pictures that could not be, values of Eros, and a proof for another case."""
    found = [*imaging_findings(run.scenario, run.summary), *direction_findings(run), *propulsion_findings(run)]
    found += borrowed_findings(run.scenario)
    if other := "; ".join(proof_differences(run)):
        found.append(f"the proof of design {run.scenario.design.reference} does not hold for this run: {other}")
    return found


def proof_differences(run: RunRecord) -> list[str]:
    """How the run differs from what its design was made for, in words; nothing where it has no design."""
    if run.design is None or "proof" not in run.design:
        return []
    parts = (("vertices", "faces"), ("body_vertices", "body_faces"))
    corners_A = np.concatenate([run.coverage[vertices][run.coverage[faces]] for vertices, faces in parts])
    return design_differences(run.design, run.scenario, corners_A, _visited_A(run))


def _visited_A(run: RunRecord) -> Array | None:
    """Where the observers were at the arrival, in A [m], shape (n_obs, 3); None where faults or dispersions moved them."""
    if as_planned(run.scenario) != run.scenario:
        return None
    k = np.abs(run.times[:, None] - arrival_times(run.scenario)).argmin(axis=0)
    C_AN = dcm(np.asarray(run.telemetry["sigma_AN"].values[k], dtype=np.float64))
    r_N = run.telemetry["r_BN_N"].values[k, np.arange(run.n_observers)]
    return np.asarray(np.einsum("jik,jk->ji", C_AN, r_N))
