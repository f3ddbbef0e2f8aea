"""Write docs/results/reflown.md, encounters that were flown against what was published: python -m scripts.pages.reflown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import brentq

import swarm_mj as sm
from scripts.pages import IMAGES, RESULTS
from swarm_mj.figures.palette import GROUND
from swarm_mj.figures.style import new_figure, save
from swarm_mj.figures.view import shade, triangles
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import camera_from, flown_cameras, observe_flight
from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.io.atomic import write_text
from swarm_mj.io.times import SECOND, epoch_of, instant
from swarm_mj.observation.coverage import CoverageMap
from swarm_mj.records.encounters import Path, path_of
from swarm_mj.scenarios.constants import AU, DAY
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array

PAGE = RESULTS / "reflown.md"
#: Of numbers that are repeated in reports of a mission, whose text was not at hand.
REPORTED = "reported"
#: Ground counts however oblique view and light are, as where a share "that was seen" is published.
ANY_ANGLE: Mapping[str, Any] = {"observation.max_emission_deg": 90, "observation.max_incidence_deg": 90}
#: Rotations of a flyby about the Sun's direction that are tried [deg].
CLOCKS = range(0, 360, 60)
#: Points of spacecraft beyond those that a design asks for.
BY_HAND = [900, 200, 1700]
#: Light that shaded faces of a picture get without the Sun.
NIGHT = 0.05
#: Time around the closest approach in which the rate of the camera is looked at [s].
AROUND_S = 5.0


class Row(NamedTuple):
    """One published number beside ours."""

    what: str
    source: str
    published: float
    ours: float
    tolerance: float
    argument: str
    unit: str = ""
    digits: int = 1
    otherwise: str = ""  # why it does not fit

    @property
    def fits(self) -> bool:
        """Whether the difference is within the tolerance."""
        return abs(self.ours - self.published) <= self.tolerance

    def line(self) -> str:
        """Of the table.

        Raises:
            SystemExit: It does not fit, and nobody has said why.
        """
        if not (self.fits or self.otherwise):
            raise SystemExit(f"{self.what}: {self.ours} does not fit {self.published}; say why in its row")
        published, ours, difference, tolerance = (
            f"{value:{sign}.{self.digits}f}"
            for value, sign in (
                (self.published, ""),
                (self.ours, ""),
                (self.ours - self.published, "+"),
                (self.tolerance, ""),
            )
        )
        verdict = "fits" if self.fits else f"**does not fit**: {self.otherwise}"
        unit = f" [{self.unit}]" if self.unit else ""
        return (
            f"| {self.what}{unit} | {published} | {self.source} | {ours} | {difference} | {tolerance}: {self.argument} | "
            f"{verdict} |"
        )


class Flown(NamedTuple):
    """A flight and how its spacecraft passed."""

    plan: Plan
    telemetry: xr.Dataset
    path: Path
    seen: CoverageMap
    gsd_m: Array  # of the cells that are seen, in the picture that is kept of each

    @property
    def closest(self) -> float:
        """Time of the closest approach [s]."""
        return self.path.least(self.path.distance)

    def at(self, utc: str) -> float:
        """Time past the epoch of an instant [s]."""
        return (instant(utc, "UTC") - epoch_of(self.plan.scenario.epoch)) / SECOND

    def phase(self, t: float) -> float:
        """Phase angle [deg]."""
        return float(np.degrees(self.path.phase(t)))

    def when(self, distance_m: float, *, after: bool) -> float:
        """When it is so far, before or after the closest approach [s]."""
        begin, end = (self.closest, self.path.last) if after else (self.path.first, self.closest)
        return float(brentq(lambda t: self.path.distance(t) - distance_m, begin, end))

    def departure(self) -> float:
        """Phase far out on the way away, by the last velocity [deg]."""
        v, sun = self.path.velocity(self.path.last), self.path.sun(self.closest)
        return float(np.degrees(np.arccos(v @ sun / np.linalg.norm(v) / np.linalg.norm(sun))))

    def turning(self) -> float:
        """Peak rate of the camera in N near the closest approach [deg/s]."""
        _, omega = flown_cameras(self.plan.scenario, self.telemetry)
        assert omega is not None
        near = np.abs(self.telemetry["time"].values - self.closest) <= AROUND_S
        return float(np.degrees(np.linalg.norm(omega[near, 0], axis=1).max()))


@dataclass(frozen=True)
class Encounter:
    """What is told of one encounter."""

    scenario: str
    title: str
    posed: str
    rows: Callable[[Flown], list[Row]]
    panels: Sequence[tuple[str, str]]  # instants in UTC, and what was published of them


def flown(name: str, changes: Mapping[str, Any] | None = None) -> Flown:
    """Fly a scenario and judge its pictures."""
    plan = make_plan(sm.load(name, changes or {}))
    telemetry = simulate(plan)
    path = path_of(plan, telemetry, 0)
    assert path is not None
    result = observe_flight(plan, telemetry)
    return Flown(plan, telemetry, path, result.coverage, result.kept.gsd_m[np.isfinite(result.kept.gsd_m)])


def seen_percent(name: str, changes: Mapping[str, Any] | None = None) -> float:
    """Share of the body's surface that is seen lit, at any angle [%]."""
    return flown(name, {**ANY_ANGLE, **(changes or {})}).seen.percent


def steins(flight: Flown) -> list[Row]:
    """Rosetta past Steins."""
    first = "[ESA 2008](http://sci.esa.int/science-e/www/object/printfriendly.cfm?fobjectid=43361)"
    least = flight.path.least(flight.path.phase)
    rows = [
        Row(
            "least phase before the closest approach",
            REPORTED,
            117.0,
            flight.closest - least,
            1.5,
            "time given to 1 s, speed to 0.05 km/s, approach to 0.05 deg",
            "s",
        ),
        Row("phase far out on departure", REPORTED, 140.0, flight.departure(), 5.0, "given as about 140", "deg"),
    ]
    pictures = (
        (1340, 2, False),
        (1140, 6, False),
        (960, 17, False),
        (810, 43, False),
        (800, 55, True),
        (950, 84, True),
    )
    for km, phase, after in pictures:
        off = 10.0 if km <= 810 else 50.0
        nearest = flight.path.distance(flight.closest) / 1e3
        if km < nearest:  # nearer than it ever was: at the closest approach
            times = [flight.closest, flight.when(1e3 * (km + off), after=after)]
        else:
            times = [flight.when(1e3 * max(km + d, nearest + 1e-6), after=after) for d in (0.0, -off, off)]
        phases = [flight.phase(t) for t in times]
        rows.append(
            Row(
                f"phase at {km} km, {'after' if after else 'before'}",
                first,
                phase,
                phases[0],
                2.0 + max(abs(p - phases[0]) for p in phases),
                f"{off:.0f} km and 2 deg, as ESA says of these estimates",
                "deg",
            )
        )
    scale = camera_from(flight.plan.scenario).pixel_angle * flight.path.distance(flight.closest)
    rows.append(Row("scale at the closest approach", REPORTED, 80.0, scale, 5.0, "given as about 80", "m/px"))
    wide = {
        "epoch": "2008-09-05T17:38:20Z",
        "duration_s": 7200,
        "observation.interval_s": 60,
        "telemetry.interval_s": 2,
    }
    longer = seen_percent("refly-steins", wide)
    rows.append(
        Row(
            "share that was seen",
            REPORTED,
            60.0,
            seen_percent("refly-steins"),
            5.0,
            "given as about 60",
            "%",
            otherwise=f"these are pictures of 30 minutes; those of two hours see {longer:.1f} %, since Steins turns by 30 deg "
            "in 30 minutes. Which pictures counted is not known here, nor is the clock angle, see below",
        )
    )
    return rows


def lutetia(flight: Flown) -> list[Row]:
    """Rosetta past Lutetia."""
    schulz = "Schulz et al. 2012, P&SS 66, 2"
    least = flight.path.least(flight.path.phase)
    along, edges = np.radians(11.0), np.radians((10.5, 11.5))
    minutes = (flight.closest - least) / 60.0
    scale = camera_from(flight.plan.scenario).pixel_angle * flight.path.distance(flight.closest)
    north = flight.plan.region.centroid_A[:, 2] > 0.0
    area = flight.plan.region.area
    seen = flight.seen.seen
    return [
        Row(
            "least phase before the closest approach",
            schulz,
            18.0,
            minutes,
            float(np.ptp(3170e3 / np.tan(edges)) / 15e3 / 120.0 + 0.5),
            "half a minute, and approach given to 0.5 deg",
            "min",
        ),
        Row(
            "distance at the least phase",
            schulz,
            16_400.0,
            flight.path.distance(least) / 1e3,
            float(3170.0 / np.sin(along) - 3170.0 / np.sin(edges[1])),
            "approach given to 0.5 deg",
            "km",
            0,
        ),
        Row(
            "phase far out on departure",
            REPORTED,
            168.0,
            flight.departure(),
            1.0,
            "approach and departure given to 0.5 deg",
            "deg",
            3,
            otherwise="by a hair: 11 and 168 deg do not add up to 180, as on a line they should",
        ),
        Row("scale at the closest approach", REPORTED, 60.0, scale, 5.0, "given as 60", "m/px"),
        Row("peak rate of the line of sight", REPORTED, 0.27, flight.turning(), 0.005, "last digit", "deg/s", 3),
        Row(
            "distance of the Sun",
            schulz,
            2.72,
            float(np.linalg.norm(flight.plan.environment.sun.at(flight.closest))) / AU,
            0.005,
            "last digit",
            "au",
            3,
        ),
        Row(
            "share of the northern half that was seen",
            REPORTED,
            78.0,
            100.0 * float(area[north & seen].sum() / area[north].sum()),
            0.5,
            "last digit; of a terrain model",
            "%",
            otherwise="the share of the north depends on the clock angle, which is not published and was left at 0, and on the "
            "hour of rotation, whose meridian is not that of the maps",
        ),
    ]


def wild2(flight: Flown) -> list[Row]:
    """Stardust past Wild 2."""
    label = "PDS, label of n2082we02r"
    t = flight.at("2004-01-02T19:22:58.479Z")
    C_CN, _ = flown_cameras(flight.plan.scenario, flight.telemetry)
    k = int(np.argmin(np.abs(flight.telemetry["time"].values - t)))
    v = flight.path.velocity(t)
    turned = [np.degrees(np.arccos(C_CN[i, 0, 2] @ v / np.linalg.norm(v))) for i in (k - 1, k, k + 1)]
    mirror = float(np.interp(t, flight.telemetry["time"].values[k - 1 : k + 2], turned))
    r = flight.path.position(t)
    lateral = 236.4e3 / float(r @ r) * 6100.0
    scale = camera_from(flight.plan.scenario).pixel_angle * flight.path.distance(flight.closest)
    return [
        Row(
            "angle of the scan mirror in a picture 86.5 s after",
            label,
            155.757,
            mirror,
            float(np.degrees(0.5 * lateral) + np.degrees(0.05e3 * 86.48 * 236.4e3 / float(r @ r))),
            "closest approach given to 1 s, speed to 0.1 km/s",
            "deg",
            3,
        ),
        Row(
            "phase of that picture",
            label,
            82.2,
            flight.phase(t),
            1.75,
            "the nucleus lies somewhere in the field",
            "deg",
            otherwise="an approach at 73.7 deg would give it; 70 is published, to ten degrees as it seems, and was flown",
        ),
        Row(
            "distance of the Sun",
            REPORTED,
            1.86,
            float(np.linalg.norm(flight.plan.environment.sun.at(flight.closest))) / AU,
            0.005,
            "last digit",
            "au",
            3,
            otherwise="the elements of its orbit are rounded, and of several epochs",
        ),
        Row("scale at the closest approach", REPORTED, 13.5, scale, 0.05, "last digit", "m/px", 2),
        Row(
            "phase far out on departure",
            REPORTED,
            110.0,
            flight.departure(),
            0.5,
            "last digit",
            "deg",
        ),
        Row("share that was seen", REPORTED, 50.0, seen_percent("refly-wild2"), 5.0, "given as about 50", "%"),
    ]


def liciacube(flight: Flown) -> list[Row]:
    """LICIACube past Dimorphos."""
    cnr = "Dotto et al. 2021, P&SS 199, 105185"
    overview = "PDS, overview of LICIACube's data"
    camera = camera_from(flight.plan.scenario)
    impact = flight.at("2022-09-26T23:14:24.183Z")
    distance = flight.path.distance(flight.closest)
    return [
        Row(
            "distance 71 s before the impact",
            REPORTED,
            1466.0,
            flight.path.distance(impact - 71.0) / 1e3,
            0.5 * 6.15 * 2 + 0.005 * 238.0,
            "both times given to 1 s, speed to 0.005 km/s",
            "km",
        ),
        Row("scale at 51 km", cnr, 4.0, camera.pixel_angle * 51e3, 0.5, "last digit", "m/px", 2),
        Row(
            "finest scale",
            overview,
            4.3,
            camera.pixel_angle * distance,
            0.05 + camera.pixel_angle * 2e3,
            "last digit, and 2 km of distance",
            "m/px",
            2,
            otherwise=f"4.3 m/px belong to {4.3 / camera.pixel_angle / 1e3:.1f} km",
        ),
        Row(
            "half-angle of the field of view",
            cnr,
            5.0,
            camera.half_angle_deg,
            0.5,
            "last digit",
            "deg",
        ),
    ]


ENCOUNTERS = (
    Encounter(
        "refly-steins",
        "2867 Steins, Rosetta, 2008-09-05",
        "closest approach at 18:38:20 UTC, 802.6 km at 8.6 km/s, phases of 38.6 deg on the approach and 0.27 deg at least; "
        "Wide Angle Camera of 12 deg, 101 urad a pixel",
        steins,
        (
            ("2008-09-05T18:36:15Z", "ESA: 1340 km, 2 deg"),
            ("2008-09-05T18:37:18Z", "ESA: 960 km, 17 deg"),
            (
                "2008-09-05T18:38:07Z",
                "ESA: 810 km, 43 deg; diamond-shaped, a crater of 2 km at the top, which an ellipsoid lacks",
            ),
            ("2008-09-05T18:39:20Z", "ESA: 950 km, 84 deg"),
        ),
    ),
    Encounter(
        "refly-lutetia",
        "21 Lutetia, Rosetta, 2010-07-10",
        "closest approach at 15:45 UTC, 3170 km at 15 km/s, phases of 11 deg on the approach and 0 at least; Narrow Angle "
        "Camera, 18.6 urad a pixel",
        lutetia,
        (
            ("2010-07-10T15:27:00Z", "Schulz et al.: phase 0 at 16,400 km"),
            ("2010-07-10T15:42:00Z", ""),
            ("2010-07-10T15:45:00Z", "reported: 60 m a pixel"),
            ("2010-07-10T15:48:00Z", ""),
        ),
    ),
    Encounter(
        "refly-wild2",
        "81P/Wild 2, Stardust, 2004-01-02",
        "closest approach at 19:21:32 UTC, 236.4 km (Tsou et al. 2004) at 6.1 km/s, phases of 70 deg on the approach and 3 deg "
        "at least; navigation camera of 57 urad a pixel behind a scan mirror. The clock angle of 84.2 deg is fitted to the "
        "line of sight in the label of n2082we02r, whose direction is no check therefore",
        wild2,
        (
            ("2004-01-02T19:20:32Z", ""),
            ("2004-01-02T19:21:25Z", "NASA: the closest short exposure at a phase of 11.4 deg"),
            ("2004-01-02T19:21:32Z", "reported: 13.5 m a pixel"),
            ("2004-01-02T19:22:58Z", "PDS: n2082we02r, mirror at 155.757 deg"),
        ),
    ),
    Encounter(
        "refly-liciacube",
        "Dimorphos, LICIACube, 2022-09-26",
        "closest approach at 23:17:11 UTC, 167 s after the impact of DART, 58 km at 6.15 km/s, phases of 43 deg at least and "
        "118 deg 320 s after the impact, which make an approach at 59.8 deg; LUKE, 2048 x 1088 pixels of 78 urad. Didymos "
        "stands on an orbit of the published period and separation, its mean anomaly assumed",
        liciacube,
        (
            ("2022-09-26T23:16:51Z", "reported: triplets of pictures that track Dimorphos, from 29 s after the impact"),
            ("2022-09-26T23:17:03Z", "reported: least phase of 43 deg"),
            ("2022-09-26T23:17:11Z", "reported: 4.3 m a pixel at the closest; plume and craters are not modelled"),
            ("2022-09-26T23:19:44Z", "reported: 118 deg 320 s after the impact"),
        ),
    ),
)

TEXT = """# What was flown

Encounters of real spacecraft, posed by what was published of their geometry, flown, and held against what was published
of their pictures. Written by `python -m scripts.pages.reflown`; `swarm-mj fly refly-steins refly-lutetia refly-wild2
refly-liciacube` flies the same, with reports and figures; `swarm-mj video results/refly-steins` makes a film of it.

What is tested is the chain from phase angles and UTC to pictures: heliocentric orbits of the bodies, states, attitude,
cameras and geometry. What is not: the shape of the bodies, which are ellipsoids of the published axes; brightness; and
the dynamics of the spacecraft that flew, in whose place a CubeSat of the package turns after the body. Numbers that
were posed are no checks, and stand in a sentence of their own. A tolerance follows from the digits of what was
published; what lies outside it does not fit, and the reason stands beside it as far as it is known. "Reported" are
numbers repeated in reports of a mission whose text was not at hand here: they are weaker witnesses. On a straight line
the departure follows from the approach, so that rows of the departure check that what was published agrees with itself.

{sections}

## A second witness

The same encounters as straight lines at constant speed past a fixed Sun, in closed form, with nothing of the package:
the phase is acos(cos e cos(b - w)), where w is the angle from the direction of arrival, tan w = d / (-v t), e the least
phase, and cos b = cos(approach) / cos e. Largest differences over the whole flight:

{witness}

Gravity bends these paths by less than that; what is left is mostly the body's motion about the Sun.

## How much hangs on the clock angle

Phases leave open how the flyby is turned about the Sun's direction. Share of the surface that is seen lit at any angle
[%], by `clock_deg`:

{clocks}

## What a swarm would have added

`liciacube-swarm` is LICIACube's flyby as a design problem: CubeSats of its kind, with its camera, released from one
path past Dimorphos to forty points 58 km above it. `swarm-mj design liciacube-swarm --class stereo` seeks the least
number that maps at least 60 % of what the Sun lights in stereo, at 10 m a pixel or finer ([quality
class](../how-to/quality_classes.md)), and proves that {least} are the least. The forty together map {most:.1f} %, those
{least} {share:.1f} %: of the rest {dark:.1f} % of the lit part are dark when they are looked at, {lack:.1f} % lack
looks. The lit part itself is {lit:.1f} % of the surface.

{swarm}

Light is the limit, not number: one spacecraft at the right place sees nine tenths of what is lit, the second adds
stereo, and the third and fifth, at points chosen by hand, add almost nothing. Delivered is what of it is on Earth
within a week by the Iris radio of the catalogue with MarCO's antenna. The plume, and errors of navigation, are not
modelled. The release 300 s before the closest approach only keeps the design fast: it asks for {delta_v:.0f} m/s at
most, to stand {aside:.0f} km aside, which a release 15 days before, as LICIACube's was, does with {slow:.2f} m/s.

## What is not posed

Gaspra, Ida and Donaldjohanson: no phase geometry was found that says how the Sun stood. Mathilde: phases of 139, 80 and
39 deg are published, and a straight line of an approach at 139 deg departs at 41; its pole was not found.
"""


def main() -> None:
    """Fly all and write the page and its pictures."""
    sections, witnesses = [], ["| encounter | phase [deg] | distance | peak rate of the camera |", "|---|---|---|---|"]
    for encounter in ENCOUNTERS:
        flight = flown(encounter.scenario)
        stem = encounter.scenario
        draw(encounter, flight, IMAGES / f"{stem}.png")
        sections.append(section(encounter, flight))
        witnesses.append(witness(encounter.title, flight))
        print(sections[-1], witnesses[-1], sep="\n", flush=True)
    text = TEXT.format(sections="\n\n".join(sections), witness="\n".join(witnesses), clocks=clocks(), **swarm())
    write_text(PAGE, text)
    print(f"wrote {PAGE}")


def section(encounter: Encounter, flight: Flown) -> str:
    """Of the page."""
    rows, fine = encounter.rows(flight), flight.gsd_m
    fits = sum(row.fits for row in rows)
    head = "| published | value | source | ours | difference | tolerance | |\n|---|---|---|---|---|---|---|"
    pictures = "\n".join(f"{k}. {panel(flight, *told)}" for k, told in enumerate(encounter.panels, start=1))
    return f"""## {encounter.title}

`{encounter.scenario}`. Posed: {encounter.posed}.

{fits} of {len(rows)} numbers fit. By the package's default limits of light and view {flight.seen.percent:.1f} % of the
ellipsoid are observed. Faces count by sight, however small (`min_pixels: 0`): they are seen at {metres(np.median(fine))} m
a pixel in the middle, {metres(fine.min())} to {metres(fine.max())} in all. Pointing is by the default sensors of a CubeSat.

{head}
{chr(10).join(row.line() for row in rows)}

![Four views of {encounter.title.split(",")[0]} by the flown camera](../images/{encounter.scenario}.png)

{pictures}"""


def metres(length: float) -> str:
    """To three digits, without powers of ten."""
    return f"{length:,.0f}" if length >= 100.0 else f"{length:.3g}"


def panel(flight: Flown, utc: str, published: str) -> str:
    """What a picture shows, in words."""
    t = flight.at(utc)
    ours = f"{utc[11:19]} UTC, {flight.path.distance(t) / 1e3:,.0f} km, phase {flight.phase(t):.1f} deg"
    return f"{ours}. {published[0].upper()}{published[1:]}." if published else f"{ours}."


def straight_phase(approach_deg: float, least_deg: float, distance: float, speed: float, t: Array) -> Array:
    """Phase on a straight line at times past the closest approach [rad]; see the page."""
    e = np.radians(least_deg)
    b = np.arccos(np.cos(np.radians(approach_deg)) / np.cos(e))
    w = np.arctan2(distance, -speed * t)
    return np.asarray(np.arccos(np.clip(np.cos(e) * np.cos(b - w), -1.0, 1.0)))


def witness(title: str, flight: Flown) -> str:
    """A row: differences of a flight from the straight line of what it was posed by."""
    asked = flight.plan.scenario.initial_states[0].approach
    assert asked is not None and asked.phase is not None
    assert asked.phase.least_deg is not None and asked.distance_m is not None
    d, v = asked.distance_m, asked.v_infinity_m_s
    times = flight.telemetry["time"].values
    since = times - asked.closest_after(flight.plan.scenario.epoch)
    line = straight_phase(asked.phase.approach_deg, asked.phase.least_deg, d, v, since)
    phase = max(abs(flight.path.phase(t) - other) for t, other in zip(times.tolist(), line, strict=True))
    far = np.hypot(d, v * since)
    distance = max(abs(flight.path.distance(t) / r - 1.0) for t, r in zip(times.tolist(), far, strict=True))
    rate, turning = float(np.degrees(v / d)), flight.turning()
    return (
        f"| {title} | {np.degrees(phase):.2g} | {distance:.1e} of it | {turning:.4g} deg/s, v / d = {rate:.4g}: "
        f"{100.0 * (turning / rate - 1.0):+.2f} % |"
    )


def clocks() -> str:
    """Table of the shares seen by the clock angle."""
    rows = [f"| | {' | '.join(str(c) for c in CLOCKS)} |", "|---" * (len(CLOCKS) + 1) + "|"]
    for encounter in ENCOUNTERS:
        key = "initial_states"
        states = [state.model_dump(exclude_unset=True) for state in sm.load(encounter.scenario).initial_states]
        shares = []
        for clock in CLOCKS:
            states[0]["approach"]["phase"]["clock_deg"] = clock
            shares.append(f"{seen_percent(encounter.scenario, {key: states}):.1f}")
        rows.append(f"| {encounter.title.split(',')[0]} | {' | '.join(shares)} |")
        print(rows[-1], flush=True)
    return "\n".join(rows)


def swarm() -> dict[str, Any]:
    """What is told of the swarm."""
    design = sm.design("liciacube-swarm", quality_class="stereo", figures=False)
    seen = sm.design("liciacube-swarm", {"designer.tolerance_percent": 5, "observation.classes": []}, figures=False)
    best, record = [int(p) for p in design.points], design.record
    lines = [
        "| spacecraft | points | seen [% of lit] | in stereo [% of lit] | delivered [% of lit] |",
        "|---|---|---|---|---|",
    ]
    for points in ([int(p) for p in seen.points], best, [*best, *BY_HAND[:1]], [*best, *BY_HAND]):
        summary = sm.fly("liciacube-swarm", {"design.visiting_points": points}, figures=False, report=False).summary
        stereo = summary["classes"]["stereo"]["percent"]
        lines.append(
            f"| {len(points)} | {', '.join(map(str, points))} | {summary['coverage_percent']:.1f} | {stereo:.1f} | "
            f"{summary['delivered_percent']:.1f} |"
        )
    dark, lack = (record["not_mappable"][key] for key in ("dark", "lack looks within the limits"))
    delta_v = max(record["delta_v_m_s"])
    aside = 300.0 * delta_v
    return {
        "swarm": "\n".join(lines),
        "least": record["proof"]["minimum"],
        "share": design.covered_percent,
        "most": record["mappable_percent"],
        "dark": dark,
        "lack": lack,
        "lit": summary["target_percent_of_body"],
        "delta_v": delta_v,
        "aside": aside / 1e3,
        "slow": aside / (15.0 * DAY),
    }


def draw(encounter: Encounter, flight: Flown, path: File) -> None:
    """What the camera has in view at some instants, cropped to the bodies."""
    figure = new_figure(2.9, f"{encounter.title}: by the flown camera")
    C_CN, _ = flown_cameras(flight.plan.scenario, flight.telemetry)
    for ax, (utc, _) in zip(figure.subplots(1, len(encounter.panels)), encounter.panels, strict=True):
        t = flight.at(utc)
        k = int(np.argmin(np.abs(flight.telemetry["time"].values - t)))
        environment = flight.plan.environment
        sun_N = environment.sun.at(t)
        r_N = flight.path.position(t)
        parts = [(flight.plan.shape, environment.C_AN(t), -r_N)]
        if (companion := environment.companion) is not None:
            parts.append((companion.shape, companion.C_AN(t), companion.position(t) - r_N))
        parts.sort(key=lambda part: -float(np.linalg.norm(part[2])))
        corners, colours = zip(*(_faces(*part, C_CN[k, 0], sun_N) for part in parts), strict=True)
        for flat, colour in zip(corners, colours, strict=True):
            ax.add_collection(triangles(flat, facecolors=colour, edgecolors=colour, linewidths=0.2, rasterized=True))
        everything = np.concatenate([flat.reshape(-1, 2) for flat in corners])
        middle, half = 0.5 * (everything.max(0) + everything.min(0)), 0.55 * float(np.ptp(everything, axis=0).max())
        pixel = camera_from(flight.plan.scenario).pixel_angle
        ax.set(xlim=middle[0] + half * np.array([-1, 1]), ylim=middle[1] + half * np.array([-1, 1]), aspect="equal")
        ax.set(xticks=[], yticks=[], facecolor="black")
        ax.set_title(f"{utc[11:19]}, {flight.phase(t):.1f} deg\n{flight.path.distance(t) / 1e3:,.0f} km", fontsize=9)
        ax.set_xlabel(f"{2.0 * half / pixel:,.0f} px across", fontsize=8)
    save(figure, path)


def _faces(shape: ShapeModel, C_AN: Array, centre_N: Array, C_CN: Array, sun_N: Array) -> tuple[Array, Array]:
    """Triangles of a body in the picture, x to the right and y up, shape (n, 3, 2) [rad], and their colours, far ones first."""
    vertices_C = (shape.vertices @ C_AN + centre_N) @ C_CN.T
    middle = vertices_C[shape.faces].mean(axis=1)
    normals_C = shape.face_normals @ C_AN @ C_CN.T
    front = np.flatnonzero(np.einsum("ij,ij->i", normals_C, middle) < 0.0)
    front = front[np.argsort(-middle[front, 2])]
    corners = vertices_C[shape.faces[front]]
    ground = np.tile([int(GROUND[k : k + 2], 16) / 255.0 for k in (1, 3, 5)], (len(front), 1))
    return corners[..., :2] / corners[..., 2:] * (1.0, -1.0), shade(ground, normals_C[front], C_CN @ sun_N, NIGHT)


if __name__ == "__main__":
    main()
