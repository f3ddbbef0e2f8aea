"""The chain: requirement, spacecraft, swarm, flight, verification; and what forbids it where it does not close.

Every kind of spacecraft (size, altitude, detector) has a lower bound of the swarm's mass: its own mass times the observers
without which its pixels cannot sample the target. Kinds are tried in the order of that bound: the swarm designer proves how
many are needed, and the swarm is flown and held against the requirement. A link that is too slow in flight, and corrections
that take more than was allowed for, go back to the designer of the spacecraft; a kind whose swarm misses anything else is left.
The search ends where no bound is below the best swarm that flew: it is the lightest among all kinds, but for other designs of
kinds that were left or not proven.
"""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, sqrt
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.designer.study import Study as DesignStudy
from swarm_mj.designer.study import Tell, Verified, study_design
from swarm_mj.errors import MissionError, ScenarioError, TooFewObserversError
from swarm_mj.flight.coordination import acts_alone
from swarm_mj.flight.downlink import MOST_SPACECRAFT, deliver
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import ObservationResult, observe_flight
from swarm_mj.flight.optical_covariance import analyse_optical
from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.flight.refusals import refuse_known_states
from swarm_mj.flight.trajectory_corrections import analyse_corrections
from swarm_mj.ideas import sizing
from swarm_mj.ideas.alternatives import Alternative, alternatives
from swarm_mj.ideas.components import SIZES
from swarm_mj.ideas.requirement import Requirement
from swarm_mj.ideas.sensitivity import Driver, Index, drivers, sobol_indices
from swarm_mj.ideas.spacecraft import (
    Encounter,
    Refusal,
    Spacecraft,
    kind_of,
    least_observers,
    least_swarm_kg,
    size_spacecraft,
    spacecraft_options,
)
from swarm_mj.io import interruption
from swarm_mj.observation.photometry import body_surface
from swarm_mj.records.navigation import OBLIQUE, total_delta_v
from swarm_mj.records.summary import summarise
from swarm_mj.scenarios.constants import AU
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario

#: Share to which a value is relaxed.
FINE = 0.01
#: Values that are relaxed, by what factor at most, and in how many steps that is looked for.
EASED = {
    "resolution_m": 1e4,
    "deliver_within_h": 1e3,
    "contact_h": 1.0 / 16.0,
    "listen_share": 1.0 / 64.0,
    "min_snr": 1e-2,
    "delta_v_m_s": 1e-3,
}
STEPS = 13
#: How often a kind is sized anew for what its flight needs, and what flown delivery and corrections are called.
ANEW, ON_EARTH, CORRECTIONS = 3, "all pictures on Earth after", "velocity for corrections, 99 %"
#: Share of the time to send as sized that is left to a kind where not all that its flight saw arrives in time.
NEVER_SHARE = 0.5
#: What a requirement that a flight misses is called in the file.
RELAXED = {
    "share seen at the resolution": "share_percent",
    ON_EARTH: "deliver_within_h",
    "velocity by thrusters": "delta_v_m_s",
    CORRECTIONS: "delta_v_m_s",
    "velocity by the deployer": "limits.deployer_m_s",
    "probability of that share": "probability",
}
Said = Callable[[str], None]


class Tried(NamedTuple):
    """A kind of spacecraft and what became of it.

    Attributes:
        kind: Size, altitude, detector in words.
        mass_kg: Of one; None: it cannot be built.
        least_kg: Lower bound of the swarm's mass; None: there is none.
        observers: Of the swarm that flew; None: none did.
        words: What was found or what forbids it.
        short: By what factor it falls short of what forbids it; 0: that is no number.
        proven: Observers that are needed at the least, as the designer has proven; None likewise.
    """

    kind: str
    mass_kg: float | None
    least_kg: float | None
    observers: int | None
    words: str
    short: float = 0.0
    proven: int | None = None


#: Flies a scenario with other seeds, and tells how many flights saw enough, and the folder where they are.
Campaign = Callable[[Scenario, Requirement], tuple[Verified, str]]


class Check(NamedTuple):
    """A requirement against what was reached; `shown` is the folder beside the report that shows it, empty for none."""

    requirement: str
    asked: float
    reached: float
    met: bool
    unit: str
    evidence: str
    shown: str = ""


class Flown(NamedTuple):
    """A swarm's flight: its plan, telemetry, what its cameras saw, and the summary."""

    plan: Plan
    telemetry: xr.Dataset
    result: ObservationResult
    summary: dict[str, Any]


class Known(NamedTuple):
    """What a study that is like this one found, which saves designs here.

    Attributes:
        requirement: What it was asked.
        kind: Of spacecraft that it chose.
        counts: Observers of each kind that are proven to be needed.
        design: Visiting points of its swarm, and what `design.observers` says of them.
    """

    requirement: Requirement
    kind: str
    counts: dict[str, int]
    design: dict[str, Any]


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
        spacecraft_count: With those that only communicate; 0 likewise.
        checks: Requirement by requirement, as flown.
        flown: The flight; None likewise.
        forbids: Why it cannot be met, and by how much it must be relaxed; empty: it is met.
        relaxed: Ways to change it with which a spacecraft can be built, or with what a swarm reached that misses nothing else,
            values by key each; empty likewise.
        drivers: What each value of the requirement does.
        sobol: Sobol' indices of what drives; empty: not asked for, or nothing varies, or points of the sample cannot be built.
        unbuilt: Share of the points of that sample of which no spacecraft can be built [-].
        alternatives: Spacecraft that no other one beats.
        design: The designer's study of the swarm; None: there is none, or its places are those of a known study.
        taken: What was taken from a study that is like this one, in words; empty: nothing was.
        wall_s: Time that it took [s].
    """

    requirement: Requirement
    encounter: Encounter
    tried: tuple[Tried, ...]
    spacecraft: Spacecraft | None
    scenario: Scenario | None
    observers: int
    spacecraft_count: int
    checks: tuple[Check, ...]
    flown: Flown | None
    forbids: str
    relaxed: tuple[dict[str, float], ...]
    drivers: tuple[Driver, ...]
    sobol: tuple[Index, ...]
    unbuilt: float
    alternatives: tuple[Alternative, ...]
    design: DesignStudy | None
    taken: str
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
    scenario = load_scenario(asked.scenario, asked.scenario_changes)
    refuse_known_states(scenario, "the swarm designer")  # before spacecraft are sized
    plan = make_plan(scenario, check_separation=False)
    surface = body_surface(scenario.body)
    if surface is None:
        raise ScenarioError(
            f"{asked.scenario}: body.photometry = null: the signal cannot be told; give a law, or body.albedo, among changes"
        )
    corrected = bool(scenario.trajectory.corrections)
    if corrected != (asked.delta_v_m_s != 0.0) and (corrected or asked.delta_v_m_s is None):
        raise ScenarioError(
            "delta_v_m_s = 0: must be null or above 0 for trajectory.corrections"
            if corrected
            else "delta_v_m_s = null: must be a velocity, or give trajectory.corrections among changes"
        )
    deployment, environment = plan.deployment, plan.environment
    t = float(deployment.arrival_s.max())
    flown = deployment.destination_N - deployment.release_r_N
    way = flown / (deployment.arrival_s - deployment.release_s)[:, None]
    # Over the ground: the body turns under the swarm.
    middle = plan.region.centroid_A.mean(axis=0)
    ground = np.cross(environment.spin_N, middle @ environment.C_AN(t))
    speed = float(np.linalg.norm(way - ground, axis=1).mean())
    widest = 2.0 * float(np.linalg.norm(plan.region.mesh.vertices, axis=1).max())
    return scenario, Encounter(
        area_m2=float(plan.region.total_area),
        extent_m=2.0 * float(np.linalg.norm(plan.region.centroid_A - middle, axis=1).max()),
        speed=speed,
        altitude_m=scenario.design.imaging_altitude_m,
        sun_m=float(np.linalg.norm(environment.sun.at(t))),
        earth_m=float(np.linalg.norm(environment.earth.at(t))),
        surface=surface,
        interval_s=0.0 if scenario.observation.criterion == "arrival" else scenario.observation.interval_s,
        idle=plan.n - plan.n_observers,
        senders=0 if acts_alone(scenario.swarm) else scenario.data.relays,
        min_pixels=scenario.observation.min_pixels,
        cell_m2=float(plan.region.area.min()),
        shadow_s=widest / max(float(np.linalg.norm(way, axis=1).min()), 1e-9),
        corrections_m_s=_corrections_m_s(plan) if corrected else 0.0,
    )


def _corrections_m_s(plan: Plan) -> float:
    """What corrections take of whoever takes the most in 99 of 100 flights, nozzles that stand oblique to it included [m/s]."""
    optical = plan.scenario.navigation.mode == "optical"
    found = analyse_optical(plan) if optical else analyse_corrections(plan)
    return OBLIQUE * max(sure for _, sure in total_delta_v(found).values())


def run_study(
    asked: Requirement,
    *,
    known: Known | None = None,
    campaign: Campaign | None = None,
    workers: int | None = None,
    say: Said | None = None,
) -> Study:
    """Carry a requirement through the chain.

    Args:
        asked: The requirement.
        known: What a study that is like this one found: a swarm that is tried before any is designed, and observers that are
            needed at the least; the answer is the same, of other places where several serve.
        campaign: Who flies campaigns; without, a probability stays as the designer promises it.
        workers: Processes for designs and Sobol' indices; None: one per core.
        say: Told what is done, a sentence at a time.

    Raises:
        ScenarioError: The scenario cannot be flown.
    """
    begun, tell = time.perf_counter(), say or (lambda words: None)
    scenario, seen = encounter_of(asked)
    tell(f"{seen.area_m2 / 1e6:.4g} km^2 are passed at {seen.speed:,.3g} m/s, {seen.earth_m / AU:.2f} au away")
    given = asked
    if given.delta_v_m_s is None:
        asked = given.with_value("delta_v_m_s", seen.corrections_m_s)
    options = list(spacecraft_options(asked, scenario, seen))
    refused = [
        Tried(kind_of(size, altitude, detector), None, None, None, f"{found.cause}: {found.words}", found.short)
        for size, altitude, detector, found in options
        if isinstance(found, Refusal)
    ]
    built = [found for *_, found in options if isinstance(found, Spacecraft)]
    search = _Search(asked, given, seen, known, campaign, workers, tell)
    built.sort(key=lambda one: (least_swarm_kg(asked, seen, one), one.mass_kg))
    search.find(built)
    tried, best = [*refused, *search.tried], search.best
    tell("which requirement drives?")
    indices: list[Index] = []
    unbuilt = 0.0
    if asked.sobol:
        indices, unbuilt = sobol_indices(
            asked, scenario, seen, workers=workers, tell=lambda share: tell(f"Sobol' indices, {100 * share:.0f} %")
        )
    told: dict[str, Any] = {
        "requirement": given,
        "encounter": seen,
        "tried": tuple(tried),
        "drivers": tuple(drivers(asked, scenario, seen)),
        "alternatives": tuple(alternatives(asked, scenario, seen)),
        "sobol": tuple(indices),
        "unbuilt": unbuilt,
        "taken": search.taken,
    }
    if best is None:
        forbids, relaxed = _forbidden(asked, scenario, seen, tried, search.near)
        told |= {
            "spacecraft": None,
            "scenario": None,
            "observers": 0,
            "spacecraft_count": 0,
            "checks": (),
            "flown": None,
        }
        told |= {"forbids": forbids, "relaxed": relaxed, "design": None}
    else:
        n = best.flown.plan.n_observers
        told |= {"spacecraft": best.spacecraft, "scenario": best.flown.plan.scenario, "observers": n}
        told |= {"spacecraft_count": best.flown.plan.n, "checks": best.checks, "flown": best.flown}
        told |= {"forbids": "", "relaxed": (), "design": best.design}
    return Study(**told, wall_s=time.perf_counter() - begun)


class _Best(NamedTuple):
    weight: float
    rank: int
    spacecraft: Spacecraft
    flown: Flown
    checks: tuple[Check, ...]
    design: DesignStudy | None


class _Search:
    """The lightest swarm of all kinds that meets a requirement, kind by kind in the order of their bounds."""

    def __init__(
        self,
        asked: Requirement,
        given: Requirement,
        seen: Encounter,
        known: Known | None,
        campaign: Campaign | None,
        workers: int | None,
        tell: Said,
    ) -> None:
        #: Whether thrusters may be sized for more than is asked, where corrections take it.
        self.more_gas = given.delta_v_m_s is None
        self.asked, self.seen, self.known, self.campaign, self.tell = asked, seen, known, campaign, tell
        self.workers = workers
        self.tried: list[Tried] = []
        self.best: _Best | None = None
        #: What the known study's swarm would weigh [kg], and the rank of its kind, until it flew.
        self.assumed: tuple[float, int] | None = None
        #: Observers of kinds that designs have proven to be needed.
        self.proven: dict[str, int] = {}
        self.taken = ""
        #: Of swarms that miss one requirement alone, its key, by how much, and what became of the kind.
        self.near: list[tuple[str, Check, Tried]] = []
        # Kinds need no fewer than the known study has proven for what is easier to see; where pixels are so coarse that
        # cells lack some, finer ones may show more.
        self.harder = (
            known is not None
            and known.requirement.no_harder_to_see(given)
            and seen.cell_m2 >= seen.min_pixels * known.requirement.resolution_m**2
        )

    def least(self, one: Spacecraft) -> int:
        """Observers without which a kind cannot do it."""
        least = max(least_observers(self.asked, self.seen, one.payload), self.proven.get(one.name, 0))
        return max(least, self.known.counts.get(one.name, 0)) if self.known is not None and self.harder else least

    def weight(self, one: Spacecraft, observers: int) -> float:
        """Of a swarm of so many observers, and those that only communicate [kg]."""
        return (observers + self.seen.idle) * one.mass_kg

    def lighter(self, rank: int, one: Spacecraft, observers: int, allowed: float) -> bool:
        """Whether a swarm of so many observers would be lighter than the best so far, and not heavier than is allowed [kg]."""
        weight, best = self.weight(one, observers), self.assumed if self.best is None else self.best[:2]
        return weight <= allowed and (best is None or (weight, rank) < best)

    def find(self, built: Sequence[Spacecraft]) -> None:
        """Judge all kinds; with a known study, first those that could be lighter than its swarm.

        That flies where none of them meets the requirement. Where it does not either, or is heavier in flight than it was taken
        for, all are judged without it.
        """
        known = self.known
        rank = next((k for k, one in enumerate(built) if known is not None and one.name == known.kind), None)
        swarm = len(known.design["visiting_points"]) if known is not None else 0
        if known is None or rank is None or swarm < self.least(built[rank]):
            self._judge_all(built)
            return
        one, weight = built[rank], self.weight(built[rank], swarm)
        self.assumed = weight, rank
        self._judge_all(built)
        if self.best is not None and self.best.weight <= weight:
            self.taken = f"as a bound the weight of its swarm of {one.name}, {weight:.3g} kg,"
            return
        least, words = self.least(one), "as in the known study"
        if swarm == least:
            words += ", and no fewer can do"
        met = self._try(rank, one, self.weight(one, least), known.design, None, words)
        if met:
            self.taken = f"its swarm of {one.name}"
        if self.best is None or self.best.weight > weight:
            best = "" if self.best is None else self.best.spacecraft.name
            self.assumed, self.near = None, []
            self.tried = [tried for tried in self.tried if tried.kind == best and tried.observers is not None]
            self._judge_all(built)

    def _judge_all(self, built: Sequence[Spacecraft]) -> None:
        for rank, one in enumerate(built):
            interruption.check()
            self.judge(rank, one)

    def judge(self, rank: int, one: Spacecraft) -> None:
        """Design and fly a kind's swarm, where it could be lighter than the best so far."""
        least, limits = self.least(one), self.asked.limits
        bound, allowed = self.weight(one, least), limits.swarm_kg or np.inf
        room = (least + self.seen.idle) * one.size.units
        if self.best is not None and self.best.rank == rank and self.best.flown.plan.n_observers <= least:
            return
        if self.best is None and self.assumed == (self.weight(one, least), rank):
            return  # it flies if no other kind is lighter
        if limits.swarm_u is not None and room > limits.swarm_u:
            words = f"{least} or more take up {room} U, {limits.swarm_u:g} U are allowed"
        elif not self.lighter(rank, one, least, allowed):
            words = f"{least} or more would weigh {bound:.3g} kg, {self._no_less_than(allowed)}"
        else:
            self._design(rank, one, bound, allowed)
            return
        self.tried.append(Tried(one.name, one.mass_kg, bound, None, words))

    def _no_less_than(self, allowed: float) -> str:
        best = np.inf if (known := self.best or self.assumed) is None else known[0]
        return f"no less than {best:.3g} kg" if best <= allowed else f"{allowed:.3g} kg are allowed"

    def _design(self, rank: int, one: Spacecraft, bound: float, allowed: float) -> None:
        self.tell(f"{one.name}, {one.mass_kg:.3g} kg each: how many are needed?")
        most, limits = self.least(one), self.asked.limits
        while most < limits.spacecraft and self.lighter(rank, one, most + 1, allowed):
            most += 1
        study, words, needed = _design(
            self.asked,
            one,
            most,
            self.workers,
            lambda stage, share: self.tell(f"{one.name}, {one.mass_kg:.3g} kg each: {stage}, {100 * share:.0f} %"),
        )
        self.proven[one.name] = needed
        if study is None and needed and most < limits.spacecraft:
            weight = self.weight(one, needed)
            words = (
                f"{needed} or more are needed, proven, and would weigh {weight:.3g} kg, {self._no_less_than(allowed)}"
            )
            self.tried.append(Tried(one.name, one.mass_kg, bound, None, words, proven=needed))
            return
        if study is None:
            self.tried.append(Tried(one.name, one.mass_kg, bound, None, f"swarm: {words}"))
            if needed:
                check = Check("observers", limits.spacecraft, needed, False, "", "as designed")
                self.near.append(("limits.spacecraft", check, self.tried[-1]))
            return
        proven, n = ceil(study.exact.bound - 1e-6), len(study.selected)
        weight = self.weight(one, n)
        if not self.lighter(rank, one, n, allowed):
            words = f"{n} observers, {words}, weigh {weight:.3g} kg, {self._no_less_than(allowed)}"
            self.tried.append(Tried(one.name, one.mass_kg, bound, None, words, proven=proven))
            return
        points = [int(study.visibility.candidates[p - 1].point) for p in study.selected]
        design = {"visiting_points": points, "observers": study.observers}
        self._try(rank, one, bound, design, proven, words, by=study)

    def _try(
        self,
        rank: int,
        one: Spacecraft,
        bound: float,
        design: dict[str, Any],
        proven: int | None,
        words: str,
        *,
        by: DesignStudy | None = None,
    ) -> bool:
        """Fly a swarm; what its flight needs more of is sized anew. Whether it meets the requirement."""
        asked, only_if_met = self.asked, by is None
        sized_for, first = asked, one
        for _ in range(ANEW):
            # Names of scenarios are those of folders too.
            name = re.sub("[^A-Za-z0-9._-]+", "-", asked.name).strip("-._") or "study"
            named = {"name": name, "description": f"the swarm of the study {asked.name}, from {asked.scenario}"}
            flown = load_scenario(asked.scenario, {**one.changes(asked), **_designed(design), **named})
            self.tell(f"{len(design['visiting_points'])} of {one.name} fly")
            try:
                gas = asked.model_copy(update={"delta_v_m_s": sized_for.delta_v_m_s})
                flight, checks = verify(gas, flown, one, self.campaign)
            except MissionError as error:
                if not only_if_met:
                    self.tried.append(Tried(one.name, one.mass_kg, bound, None, f"flight: {error}", proven=proven))
                return False
            # What the flight took longer goes back to the designer of the spacecraft: a link that is faster by as much.
            missed = {check.requirement: check for check in checks if not check.met}
            tighter = {}
            if ON_EARTH in missed:
                # Of what never arrives all that is known is that more must.
                share = missed[ON_EARTH].asked / missed[ON_EARTH].reached or NEVER_SHARE
                tighter["deliver_within_h"] = one.send_h * share
            if CORRECTIONS in missed and self.more_gas:
                tighter["delta_v_m_s"] = missed[CORRECTIONS].reached
            if not tighter:
                break
            sized_for = sized_for.model_copy(update=tighter)
            again = size_spacecraft(sized_for, flight.plan.scenario, self.seen, one.size, one.payload)
            if isinstance(again, Refusal):
                break
            one = again
        misses = [check for check in checks if not check.met]
        if only_if_met and misses:
            return False
        n, weight = flight.plan.n_observers, flight.plan.n * one.mass_kg
        words = f"{n} {'observer' if n == 1 else 'observers'}, {weight:.3g} kg, {words}"
        if one is not first:
            words += f"; sized anew for what its flight takes, from {first.mass_kg:.3g} kg each"
        if misses:
            words += "; flown: " + ", ".join(f"{c.requirement} {c.reached:.4g}, not {c.asked:.4g}" for c in misses)
        self.tried.append(Tried(one.name, one.mass_kg, bound, n, words, proven=proven))
        if len(misses) == 1 and np.isfinite(misses[0].reached) and (key := RELAXED.get(misses[0].requirement)):
            self.near.append((key, misses[0], self.tried[-1]))
        if not misses and (self.best is None or (weight, rank) < self.best[:2]):
            self.best = _Best(weight, rank, one, flight, checks, by)
        return not misses


def _designed(design: dict[str, Any]) -> dict[str, Any]:
    """A design as values of a scenario."""
    return {f"design.{key}": value for key, value in design.items() if key == "visiting_points" or value}


def _design(
    asked: Requirement, one: Spacecraft, most: int, workers: int | None, tell: Tell
) -> tuple[DesignStudy | None, str, int]:
    """The swarm designer's answer for a kind of spacecraft, of use if it has no more observers than `most`.

    Returns:
        None where it refuses; its words; how many observers are needed at the least, 0: that is not what it refuses for.
    """
    scenario = load_scenario(asked.scenario, one.changes(asked))
    try:
        study = study_design(scenario, workers=workers, tell=tell, at_most=most)
    except TooFewObserversError as error:
        return None, str(error).replace("max_observers", "limits.spacecraft"), error.needed
    except MissionError as error:
        return None, _as_asked(str(error)), 0
    if study.interrupted:  # what was found so far proves nothing; candidates' flights are kept for the next time
        raise KeyboardInterrupt
    proven = "proven the fewest" if study.exact.status == "optimal" else f"at least {study.exact.bound:g} are needed"
    return study, proven, 0


def _as_asked(words: str) -> str:
    """What the swarm designer says, with the remedy in keys of a requirement."""
    found = re.search(r"; allow a tolerance of at least ([0-9.]+) %.*", words)
    return (
        words if found is None else f"{words[: found.start()]}; share_percent of at most {100.0 - float(found[1]):.4g}"
    )


def verify(
    asked: Requirement, scenario: Scenario, one: Spacecraft, campaign: Campaign | None = None
) -> tuple[Flown, tuple[Check, ...]]:
    """Fly a swarm and hold it against the requirement."""
    plan = make_plan(scenario)
    telemetry = simulate(plan)
    result = observe_flight(plan, telemetry)
    result = replace(result, delivery=deliver(plan, telemetry, result.kept, prove=False))
    flown = Flown(plan, telemetry, result, summarise(plan, telemetry, result, {}))
    limits, n, margin = asked.limits, plan.n, "with margin"
    share, seen_by = flown.summary["coverage_percent"], "by the scenario's criterion"
    if asked.quality != "seen":
        share, seen_by = flown.summary["classes"][asked.quality]["percent"], f"at the class {asked.quality}"

    def at_most(what: str, most: float | None, reached: float, unit: str, evidence: str, shown: str = "") -> Check:
        most = np.inf if most is None else most
        return Check(what, most, reached, reached <= most + 1e-9, unit, evidence, shown)

    def at_least(what: str, least: float, reached: float, unit: str, evidence: str, shown: str = "") -> Check:
        return Check(what, least, reached, reached >= least - 1e-6, unit, evidence, shown)

    checks = [
        at_least("share seen at the resolution", asked.share_percent, share, "%", f"flown, {seen_by}", "flight"),
        at_most("observers", limits.spacecraft, plan.n_observers, "", "swarm designer", "design"),
        at_most("mass of one", limits.spacecraft_kg or one.size.limit_kg, one.mass_kg, "kg", f"mass budget, {margin}"),
        at_most("mass of the swarm", limits.swarm_kg, n * one.mass_kg, "kg", f"mass budget, {margin}"),
        at_most("volume of the swarm", limits.swarm_u, n * one.size.units, "U", "sizes of the standard"),
        at_least("signal to noise", asked.min_snr, one.payload.snr, "", "at incidence 45, emission 30, phase 60 deg"),
    ]
    if result.delivery is None:
        hours = one.send_h
        words = f"as sized: the way to Earth of more than {MOST_SPACECRAFT} spacecraft is not computed"
    else:
        hours, words = _delivered_h(asked, result.delivery, scenario.duration_s)
    checks.append(at_most(ON_EARTH, asked.deliver_within_h, hours, "h", words, "flight"))
    if one.propulsion is not None:
        given = sizing.velocity(one.mass_kg, one.propellant_kg, one.propulsion.specific_impulse_s)
        checks.append(
            at_least("velocity that the tank gives", asked.delta_v_m_s or 0.0, given, "m/s", "rocket equation")
        )
    if one.propulsion is not None and flown.summary.get("thrust_delta_v_m_s"):
        used = max(flown.summary["thrust_delta_v_m_s"].values())
        checks.append(at_most("velocity by thrusters", asked.delta_v_m_s, used, "m/s", "used in flight", "flight"))
    if scenario.trajectory.corrections:
        took, how = _corrections_m_s(plan), "linear covariance of the swarm that flew, oblique nozzles included"
        checks.append(at_most(CORRECTIONS, asked.delta_v_m_s, took, "m/s", how))
    released, how = float(plan.deployment.delta_v.max()), "as planned"
    if scenario.mothership.velocity == "mean":
        how += ", from a mothership that flies with the mean of the swarm (mothership.velocity)"
    checks.append(at_most("velocity by the deployer", limits.deployer_m_s, released, "m/s", how, "flight"))
    if asked.probability is not None and campaign is not None and all(check.met for check in checks):
        found, shown = campaign(scenario, asked)
        words = f"{found.flights} flights: between {found.low:.3f} and {found.high:.3f} (Wilson, 95 %)"
        reached = found.covered / found.flights
        met = reached >= asked.probability
        checks.append(Check("probability of that share", asked.probability, reached, met, "", words, shown))
    return flown, tuple(check for check in checks if np.isfinite(check.asked))


def _delivered_h(asked: Requirement, delivery: Delivery, end_s: float) -> tuple[float, str]:
    """Hours after the flight in which all that it saw is on Earth, and how that is known."""
    if not delivery.complete:
        reasons = "; ".join(sorted({part.reason for part in delivery.undelivered()}))
        return np.inf, f"flown: not all arrives: {reasons}"
    visible_h = (delivery.full_s - end_s) / 3600.0
    with np.errstate(divide="ignore", invalid="ignore"):
        used = np.nan_to_num(delivery.earth_bit / delivery.earth_contact_bit)
    busy_h = float((np.diff(delivery.edges_s) @ used).max()) / 3600.0
    with_pauses_h = visible_h + busy_h * (24.0 / asked.contact_h - 1.0)
    words = f"flown: {visible_h:.3g} h after the flight without a pause, in which one sends for {busy_h:.3g} h; in contacts of "
    return with_pauses_h, words + f"{asked.contact_h:g} h a day, evenly spread, {with_pauses_h:.3g} h"


def _counted(causes: Counter[str]) -> str:
    return ", ".join(f"{count} for {cause}" for cause, count in causes.most_common())


def _forbidden(
    asked: Requirement,
    scenario: Scenario,
    seen: Encounter,
    tried: Sequence[Tried],
    near: Sequence[tuple[str, Check, Tried]],
) -> tuple[str, tuple[dict[str, float], ...]]:
    """Why nothing meets a requirement, in words, and ways to change it with which a spacecraft can be built."""
    if built := [one for one in tried if one.mass_kg is not None]:
        kinds = "1 kind" if len(built) == 1 else f"{len(built)} kinds"
        what = f"{kinds} of spacecraft can be built, but no swarm of any of them meets it"
        if not near:
            return f"{what}; {built[0].kind}: {built[0].words}", ()
        key, missed, one = min(near, key=lambda found: abs(found[1].reached / found[1].asked - 1.0))
        how = "as designed" if key == "limits.spacecraft" else "as flown"
        words = f"{what}; {one.kind}: {one.words}; it takes {key} = {missed.reached:.4g}, {how}"
        return words, ({key: missed.reached},)
    causes = Counter(one.words.partition(":")[0] for one in tried)
    nearest = min(tried, key=lambda one: (ORDER.index(one.words.partition(":")[0]), one.short))
    ways = _relaxations(asked, scenario, seen)
    told = " or ".join(" with ".join(f"{key} = {value:.4g}" for key, value in way.items()) for way in ways)
    remedy = (
        f"it takes {told}"
        if told
        else f"more than one value must be relaxed at once: none alone of {', '.join(EASED)}, limits.spacecraft, "
        "limits.spacecraft_kg and limits.units helps all that forbids it"
    )
    return (
        f"no spacecraft among {len(tried)} kinds can be built for it ({_counted(causes)}); the one that comes nearest, "
        f"{nearest.kind}: {nearest.words}; {remedy}",
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
        ways = {key: _eased(given, key, most, scenario, seen) for key, most in EASED.items() if given.value(key)}
        ways["limits.spacecraft"] = _more_spacecraft(given, scenario, seen)
        ways["limits.spacecraft_kg"] = _heavier(given, scenario, seen)
        if any(ways.values()):
            return [{**larger, key: value} for key, value in ways.items() if value]
    return []


#: Causes of refusals, those that stop latest first.
ORDER = ("swarm", "budgets", "data", "wheels", "pixels", "length", "signal", "lens", "diffraction")


def _feasible(asked: Requirement, scenario: Scenario, seen: Encounter) -> bool:
    return any(isinstance(found, Spacecraft) for *_, found in spacecraft_options(asked, scenario, seen))


def _eased(asked: Requirement, key: str, most: float, scenario: Scenario, seen: Encounter) -> float | None:
    """The least change of a value with which a spacecraft can be built, to a hundredth; None: there is none up to a factor.

    What may not be asked for helps nobody.
    """

    def helps(times: float) -> bool:
        value = asked.value(key) * times
        return asked.allows(key, value) and _feasible(asked.with_value(key, value), scenario, seen)

    steps = np.geomspace(1.0, most, STEPS)
    k = next((k for k in range(1, STEPS) if helps(float(steps[k]))), None)
    if k is None:
        return None
    low, high = float(steps[k - 1]), float(steps[k])
    while abs(np.log(high / low)) > FINE:
        middle = sqrt(low * high)
        low, high = (low, middle) if helps(middle) else (middle, high)
    return asked.value(key) * high


def _more_spacecraft(asked: Requirement, scenario: Scenario, seen: Encounter) -> float | None:
    """The fewest spacecraft with which one can be built; None: their number forbids nothing."""
    free = asked.model_copy(update={"limits": asked.limits.model_copy(update={"spacecraft": 10**9})})
    counts = [
        least_observers(asked, seen, found.payload)
        for *_, found in spacecraft_options(free, scenario, seen)
        if isinstance(found, Spacecraft)
    ]
    return float(min(counts)) if counts else None


def _heavier(asked: Requirement, scenario: Scenario, seen: Encounter) -> float | None:
    """The mass of the lightest that can be built by the standard's limits alone [kg]; None: a limit of mass forbids nothing."""
    if asked.limits.spacecraft_kg is None:
        return None
    free = asked.model_copy(update={"limits": asked.limits.model_copy(update={"spacecraft_kg": None})})
    masses = [found.mass_kg for *_, found in spacecraft_options(free, scenario, seen) if isinstance(found, Spacecraft)]
    return ceil(100.0 * min(masses)) / 100.0 if masses else None
