"""The chain: requirement, spacecraft, swarm, flight, verification; and what forbids it where it does not close.

Every kind of spacecraft (size, altitude, detector) has a lower bound of the swarm's mass: its own mass times the observers
without which its pixels cannot sample the target. Kinds are tried in the order of that bound: the swarm designer proves how
many are needed, and what it refuses goes back as a bound. The search ends where no bound is below the best swarm found: that is
the lightest swarm among all kinds by the designer's own proof, or the proof that there is none among them. Then it is flown.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from swarm_mj.designer.study import study_design
from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.ideas.alternatives import Alternative, Driver, alternatives, changed, drivers, value_of
from swarm_mj.ideas.components import SIZES
from swarm_mj.ideas.requirement import Requirement
from swarm_mj.ideas.spacecraft import (
    Encounter,
    Refusal,
    Spacecraft,
    kind_of,
    least_observers,
    spacecraft_options,
)
from swarm_mj.io import interruption
from swarm_mj.observation.photometry import body_surface
from swarm_mj.scenarios.constants import AU
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario

#: Share to which a value is relaxed.
FINE = 0.01
#: Values that are relaxed, by what factor at most, and in how many steps that is looked for.
EASED, STEPS = {"resolution_m": 1e4, "deliver_within_h": 1e3, "contact_h": 1.0 / 16.0, "min_snr": 1e-2}, 13
Said = Callable[[str], None]


class Tried(NamedTuple):
    """A kind of spacecraft and what became of it.

    Attributes:
        kind: Size, altitude, detector in words.
        mass_kg: Of one; None: it cannot be built.
        least_kg: Lower bound of the swarm's mass; None: there is none.
        observers: That are needed, proven; None: the designer was not asked, or refused.
        words: What was found or what forbids it.
        short: By what factor it falls short of what forbids it; 0: that is no number.
    """

    kind: str
    mass_kg: float | None
    least_kg: float | None
    observers: int | None
    words: str
    short: float = 0.0


class Check(NamedTuple):
    """A requirement against what a flight reached."""

    requirement: str
    asked: float
    reached: float
    met: bool
    unit: str
    evidence: str


@dataclass(frozen=True, eq=False)
class Study:
    """What a requirement came to.

    Attributes:
        requirement: What was asked.
        encounter: What its scenario says of the passage.
        tried: Kinds of spacecraft in the order in which they were judged.
        spacecraft: The one chosen; None: the requirement cannot be met by any of them.
        scenario: That flies the swarm; None likewise.
        observers: Of the swarm, proven to be the fewest for its kind; 0 likewise.
        checks: Requirement by requirement, as flown.
        forbids: Why it cannot be met, and by how much it must be relaxed; empty: it is met.
        relaxed: Ways to change it with which a spacecraft can be built, values by key each; empty likewise.
        drivers: What each value of the requirement does.
        alternatives: Spacecraft that no other one beats.
        wall_s: Time that it took [s].
    """

    requirement: Requirement
    encounter: Encounter
    tried: tuple[Tried, ...]
    spacecraft: Spacecraft | None
    scenario: Scenario | None
    observers: int
    checks: tuple[Check, ...]
    forbids: str
    relaxed: tuple[dict[str, float], ...]
    drivers: tuple[Driver, ...]
    alternatives: tuple[Alternative, ...]
    wall_s: float

    @property
    def closed(self) -> bool:
        """Whether a swarm was found and flew what was asked."""
        return self.spacecraft is not None and all(check.met for check in self.checks)


def encounter_of(asked: Requirement) -> tuple[Scenario, Encounter]:
    """The scenario of a requirement and what it says of the passage.

    Raises:
        ScenarioError: It cannot be flown, or it is not known how the body reflects light.
    """
    scenario = load_scenario(asked.scenario, asked.changes)
    plan = make_plan(scenario, check_separation=False)
    surface = body_surface(scenario.body)
    if surface is None:
        raise ScenarioError(
            f"{asked.scenario}: body.photometry = null: the signal cannot be told; give a law, or body.albedo, among changes"
        )
    deployment, environment = plan.deployment, plan.environment
    t = float(deployment.arrival_s.max())
    flown = deployment.destination_N - deployment.release_r_N
    way = flown / (deployment.arrival_s - deployment.release_s)[:, None]
    # Over the ground: the body turns under the swarm.
    middle = plan.region.centroid_A.mean(axis=0)
    ground = np.cross(environment.spin_N, middle @ environment.C_AN(t))
    speed = float(np.linalg.norm(way - ground, axis=1).mean())
    return scenario, Encounter(
        area_m2=float(plan.region.total_area),
        extent_m=2.0 * float(np.linalg.norm(plan.region.centroid_A - middle, axis=1).max()),
        speed=speed,
        altitude_m=scenario.design.imaging_altitude_m,
        sun_m=float(np.linalg.norm(environment.sun.at(t))),
        earth_m=float(np.linalg.norm(environment.earth.at(t))),
        surface=surface,
        interval_s=0.0 if scenario.observation.criterion == "arrival" else scenario.observation.interval_s,
    )


def run_study(asked: Requirement, *, first: str = "", say: Said | None = None) -> Study:
    """Carry a requirement through the chain.

    Args:
        asked: The requirement.
        first: Kind of spacecraft that is tried first, as of a study that is like this one; it changes the order alone.
        say: Told what is done, a sentence at a time.

    Raises:
        ScenarioError: The scenario cannot be flown.
    """
    begun, tell = time.perf_counter(), say or (lambda words: None)
    scenario, seen = encounter_of(asked)
    tell(f"{seen.area_m2 / 1e6:.4g} km^2 are passed at {seen.speed:,.3g} m/s, {seen.earth_m / AU:.2f} au away")
    options = list(spacecraft_options(asked, scenario, seen))
    tried = [
        Tried(
            kind_of(size, altitude, detector),
            None,
            None,
            None,
            f"{found.cause}: {found.words}",
            found.short,
        )
        for size, altitude, detector, found in options
        if isinstance(found, Refusal)
    ]
    built = [found for *_, found in options if isinstance(found, Spacecraft)]
    built.sort(key=lambda one: (least_observers(asked, seen, one.payload) * one.mass_kg, one.mass_kg))
    # Whatever is tried first, of swarms that weigh the same the one counts that stands first.
    ranked = sorted(enumerate(built), key=lambda pair: pair[1].name != first)
    best: tuple[float, int, Spacecraft, Any] | None = None
    for rank, one in ranked:
        interruption.check()
        least = least_observers(asked, seen, one.payload)
        bound, allowed = least * one.mass_kg, asked.limits.swarm_kg or np.inf
        if bound > allowed or (best is not None and (bound, rank) >= best[:2]):
            most = min(allowed, best[0] if best else np.inf)
            words = f"{least} or more would weigh {bound:.3g} kg, no less than {most:.3g} kg"
            tried.append(Tried(one.name, one.mass_kg, bound, None, words))
            continue
        tell(f"{one.name}, {one.mass_kg:.3g} kg each: how many are needed?")
        study, words = _design(asked, one)
        if study is None:
            tried.append(Tried(one.name, one.mass_kg, bound, None, f"swarm: {words}"))
            continue
        count = int(study.exact.n_observers)
        weight = count * one.mass_kg
        tried.append(
            Tried(
                one.name,
                one.mass_kg,
                bound,
                count,
                f"{count} {'observer' if count == 1 else 'observers'}, {weight:.3g} kg, {words}",
            )
        )
        if count <= asked.limits.spacecraft and weight <= allowed and (best is None or (weight, rank) < best[:2]):
            best = weight, rank, one, study
    tell("which requirement drives?")
    also: dict[str, Any] = {
        "drivers": tuple(drivers(asked, scenario, seen)),
        "alternatives": tuple(alternatives(asked, scenario, seen)),
    }
    if best is None:
        forbids, relaxed = _forbidden(asked, scenario, seen, tried, built)
        found: dict[str, Any] = {"spacecraft": None, "scenario": None, "observers": 0, "checks": ()}
        found |= {"forbids": forbids, "relaxed": relaxed, **also, "wall_s": time.perf_counter() - begun}
        return Study(requirement=asked, encounter=seen, tried=tuple(tried), **found)
    _, _, chosen, study = best
    flown = load_scenario(
        asked.scenario,
        {
            **asked.changes,
            **chosen.changes(asked),
            "design.visiting_points": [int(study.visibility.candidates[p - 1].point) for p in study.selected],
            **({"design.observers": study.observers} if study.observers else {}),
        },
    )
    tell(f"{len(study.selected)} of {chosen.name} fly")
    checks = verify(asked, flown, chosen)
    found = {"spacecraft": chosen, "scenario": flown, "observers": len(study.selected), "checks": checks}
    found |= {"forbids": "", "relaxed": (), **also, "wall_s": time.perf_counter() - begun}
    return Study(requirement=asked, encounter=seen, tried=tuple(tried), **found)


def _design(asked: Requirement, one: Spacecraft) -> tuple[Any, str]:
    """The swarm designer's answer for a kind of spacecraft, None where it refuses; and its words."""
    try:
        study = study_design(load_scenario(asked.scenario, {**asked.changes, **one.changes(asked)}))
    except MissionError as error:
        return None, str(error)
    if study.interrupted:  # what was found so far proves nothing; candidates' flights are kept for the next time
        raise KeyboardInterrupt
    proven = "proven the fewest" if study.exact.status == "optimal" else f"at least {study.exact.bound:g} are needed"
    return study, proven


def verify(asked: Requirement, scenario: Scenario, one: Spacecraft) -> tuple[Check, ...]:
    """Fly a swarm and hold it against the requirement."""
    plan = make_plan(scenario, check_separation=False)
    telemetry = simulate(plan)
    result = observe_flight(plan, telemetry)
    share, n, limits = float(result.coverage.percent), plan.n_observers, asked.limits
    limit = min(one.size.limit_kg, limits.spacecraft_kg or np.inf)

    def at_most(what: str, asked_for: float, reached: float, unit: str, evidence: str) -> Check:
        return Check(what, asked_for, reached, reached <= asked_for + 1e-9, unit, evidence)

    def at_least(what: str, asked_for: float, reached: float, unit: str, evidence: str) -> Check:
        return Check(what, asked_for, reached, reached >= asked_for - 1e-6, unit, evidence)

    seen_by = "flown, by the scenario's criterion and observation.max_gsd_m"
    link = f"link budget at the body's distance, contacts of {asked.contact_h:g} h a day"
    checks = [
        at_least("share seen at the resolution", asked.share_percent, share, "%", seen_by),
        at_most("observers", limits.spacecraft, n, "", "swarm designer"),
        at_most("mass of one", limit, one.mass_kg, "kg", "mass budget, with margin"),
        at_most("mass of all observers", limits.swarm_kg or np.inf, n * one.mass_kg, "kg", "mass budget, with margin"),
        at_least("signal to noise", asked.min_snr, one.payload.snr, "", "at incidence 45, emission 30, phase 60 deg"),
        at_most("pictures on Earth after", asked.deliver_within_h, one.send_h, "h", link),
    ]
    return tuple(check for check in checks if np.isfinite(check.asked))


def _forbidden(
    asked: Requirement, scenario: Scenario, seen: Encounter, tried: Sequence[Tried], built: Sequence[Spacecraft]
) -> tuple[str, tuple[dict[str, float], ...]]:
    """Why nothing meets a requirement, in words, and ways to change it with which a spacecraft can be built."""
    if built:
        refused = [one for one in tried if one.mass_kg is not None]
        what = f"{len(built)} kinds of spacecraft can be built, but no swarm of any of them meets it"
        return f"{what}; {refused[0].kind}: {refused[0].words}", ()
    causes = sorted({one.words.partition(":")[0] for one in tried})
    nearest = min(tried, key=lambda one: (ORDER.index(one.words.partition(":")[0]), one.short))
    ways = _relaxations(asked, scenario, seen)
    told = " or ".join(" with ".join(f"{key} = {value:.4g}" for key, value in way.items()) for way in ways)
    remedy = (
        f"it takes {told}"
        if told
        else f"nor does it help to relax {', '.join(EASED)}, limits.spacecraft or limits.units"
    )
    return (
        f"no spacecraft among {len(tried)} kinds can be built for it ({', '.join(causes)}); the nearest, {nearest.kind}: "
        f"{nearest.words}; {remedy}",
        tuple(ways),
    )


def _relaxations(asked: Requirement, scenario: Scenario, seen: Encounter) -> list[dict[str, float]]:
    """The least changes of one value, and where none helps, of one for the next larger size that lets one."""
    for units in (None, *(units for units in SIZES if units > max(asked.limits.units))):
        limits = asked.limits if units is None else asked.limits.model_copy(update={"units": (units,)})
        given, larger = (
            asked.model_copy(update={"limits": limits}),
            {} if units is None else {"limits.units": float(units)},
        )
        if _feasible(given, scenario, seen):
            return [larger]
        ways = {key: _eased(given, key, most, scenario, seen) for key, most in EASED.items()}
        ways["limits.spacecraft"] = _more_spacecraft(given, scenario, seen)
        if any(ways.values()):
            return [{**larger, key: value} for key, value in ways.items() if value]
    return []


#: Causes of refusals, those that stop latest first.
ORDER = ("swarm", "budgets", "data", "wheels", "pixels", "length", "signal", "lens", "diffraction")


def _feasible(asked: Requirement, scenario: Scenario, seen: Encounter) -> bool:
    return any(isinstance(found, Spacecraft) for *_, found in spacecraft_options(asked, scenario, seen))


def _eased(asked: Requirement, key: str, most: float, scenario: Scenario, seen: Encounter) -> float | None:
    """The least change of a value with which a spacecraft can be built, to a hundredth; None: there is none up to a factor."""

    def helps(times: float) -> bool:
        return _feasible(changed(asked, key, value_of(asked, key) * times), scenario, seen)

    steps = np.geomspace(1.0, most, STEPS)
    k = next((k for k in range(1, STEPS) if helps(float(steps[k]))), None)
    if k is None:
        return None
    low, high = float(steps[k - 1]), float(steps[k])
    while abs(np.log(high / low)) > FINE:
        middle = sqrt(low * high)
        low, high = (low, middle) if helps(middle) else (middle, high)
    return value_of(asked, key) * high


def _more_spacecraft(asked: Requirement, scenario: Scenario, seen: Encounter) -> float | None:
    """The fewest spacecraft with which one can be built; None: their number forbids nothing."""
    free = asked.model_copy(update={"limits": asked.limits.model_copy(update={"spacecraft": 10**9})})
    counts = [
        least_observers(asked, seen, found.payload)
        for *_, found in spacecraft_options(free, scenario, seen)
        if isinstance(found, Spacecraft)
    ]
    return float(min(counts)) if counts else None
