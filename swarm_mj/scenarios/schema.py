"""The scenario: every number of a mission, checked on reading.

A scenario is a tree of frozen pydantic models. Unknown keys, NaN, wrong units and infeasible numbers are refused with an
error that names the key, the value and what is allowed. Assumptions that AAS 19-144 leaves open are fields with a default
and a reason in their description; `swarm-mj json-schema` prints them all.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, field_validator, model_validator

from swarm_mj.io.times import tdb_date
from swarm_mj.scenarios.bodies import expanded_body, packaged_bodies
from swarm_mj.scenarios.schema_body import Body, Companion, Ephemerides, Perturbations
from swarm_mj.scenarios.schema_faults import Dispersions, Fault
from swarm_mj.scenarios.schema_imaging import Camera, Observation
from swarm_mj.scenarios.schema_itinerary import Aim, Design, Visit
from swarm_mj.scenarios.schema_link import Data, Link
from swarm_mj.scenarios.schema_mothership import KnownState, Mothership
from swarm_mj.scenarios.schema_navigation import Navigation
from swarm_mj.scenarios.schema_propulsion import (
    Thrusters,
    Trajectory,
    corrections_can_be_flown,
    thrusters_can_pulse,
    thrusters_fit_inside,
)
from swarm_mj.scenarios.schema_quality import PACKAGED, QualityClass
from swarm_mj.scenarios.schema_sensors import Sensors, expanded_sensors
from swarm_mj.scenarios.schema_swarm import Swarm
from swarm_mj.scenarios.section import YOUR_OWN, Parameters, Section, Vector3

Longitude = Annotated[float, Field(ge=-360, le=360, description="east longitude [deg]")]
Latitude = Annotated[float, Field(ge=-90, le=90, description="planetocentric latitude [deg]")]
#: A closed line: its last corner is its first.
Ring = Annotated[tuple[tuple[Longitude, Latitude], ...], Field(min_length=4, max_length=10_000)]
#: Weight of a target's area.
Weight = Annotated[float, Field(ge=1e-6, le=1e6)]


class Target(Section):
    """What of the surface is to be seen: a pyramid from the body's centre, a polygon, the lit part, or all of it."""

    region: Literal["pyramid", "polygon", "lit", "body"] = Field(
        "pyramid",
        description="pyramid: inside one from the body's centre, as in the paper; polygon: inside lines in longitude and "
        "latitude; lit: all that is lit as observation.max_incidence_deg has it, with cast shadows, see lit_at; body: all; see "
        "docs/how-to/targets.md",
    )
    polygon: tuple[Ring, ...] | None = Field(
        None,
        max_length=1000,
        description="rings of corners [east longitude, latitude] [deg], the outer one first, then its holes, each closed; "
        "edges are straight in longitude and latitude, as RFC 7946 has them",
    )
    polygon_file: str | None = Field(
        None,
        description="path of a GeoJSON file of Polygons and MultiPolygons in place of polygon, relative to the scenario's file",
    )
    lit_at: Literal["passage", "arrival"] = Field(
        "passage",
        description="when the lit part is lit: at some picture time of the flight, from the epoch on every "
        "observation.interval_s or as observation.sequence says, or at the common arrival, design.release_s + time_of_flight_s",
    )
    weight: Weight = Field(
        1.0,
        description="of its area in P_TO and in designs, beside other targets [-]; where targets overlap the largest counts",
    )
    latitude_deg: float = Field(0.0, ge=-90, le=90, description="planetocentric latitude of the axis [deg]")
    longitude_deg: float = Field(90.0, ge=-360, le=360, description="east longitude [deg]")
    half_angle_deg: float = Field(20.0, gt=0, lt=90, description="of the pyramid about its axis [deg]; see edges")
    edges: Literal["corner", "side"] = Field(
        "corner",
        description="whether the half-angle is measured to the pyramid's corner edges or to its side planes; not said by the "
        "paper, whose 49 vertices fit corner edges (51 here) and not sides (93)",
    )
    cell_size_m: float | Literal["auto"] | None = Field(
        "auto",
        description="edge length to which target faces are subdivided [m]; null: not at all; auto: only where the camera's "
        "footprint is too narrow for whole faces to measure the area",
    )

    @model_validator(mode="after")
    def _polygon_is_given_once(self) -> Self:
        given = [key for key in ("polygon", "polygon_file") if getattr(self, key) is not None]
        if self.region == "polygon" and len(given) != 1:
            raise ValueError(
                f"region = polygon: give one of polygon and polygon_file, not {' and '.join(given) or 'none'}"
            )
        if self.region != "polygon" and given:
            raise ValueError(
                f"{given[0]}: says nothing with region = {self.region}; must be left out, or region: polygon"
            )
        return self


class Wheel(Section):
    """A reaction wheel; default: the class of the Blue Canyon RWP015 (15 mN m s, 4 mN m, 0.13 kg, 42 x 42 x 19 mm)."""

    mass_kg: float = Field(0.13, gt=0, description="of one wheel [kg]; counted inside the spacecraft's")
    spin_inertia_kg_m2: float = Field(
        2.387e-5, gt=0, description="about the spin axis; 15 mN m s at 6,000 rpm gives 2.387e-5 kg m^2"
    )
    transverse_inertia_kg_m2: float = Field(
        1.545e-5, gt=0, description="of a disc of that mass and spin inertia (38 mm across), 18 mm high"
    )
    max_torque_n_m: float = Field(0.004, gt=0, description="limit of the motor [N m]")
    max_speed_rpm: float = Field(6000.0, gt=0, description="limit of the speed relative to the hub [rpm]")


class Spacecraft(Section):
    """The CubeSat: a uniform box with three orthogonal wheels counted inside its mass and inertia; or one from a file."""

    mjcf: str | None = Field(
        None,
        description="path of an MJCF file with a spacecraft of your own, relative to the scenario's file: panels on hinges, "
        "sloshing masses, sensors; masses, wheels and torque limit are then the file's; null: the box "
        "below; see docs/how-to/spacecraft.md",
    )
    mass_kg: float = Field(8.0, gt=0, description="of the whole spacecraft, wheels included [kg]")
    size_m: Vector3 = Field((0.1, 0.1, 0.34), description="a 3U CubeSat; the camera looks along the long axis +z")
    wheel: Wheel = Field(default_factory=Wheel)
    wheel_layout: Literal["orthogonal", "orthogonal_and_skew", "pyramid"] = Field(
        "orthogonal",
        description="wheels along x, y, z; the same and a fourth along (1, 1, 1); four along (+-1, +-1, 1): with four, the "
        "loss of any one leaves control about all axes",
    )
    initial_mrp_range: float = Field(
        1.0, ge=0, description="each component of the initial attitude (MRP) is uniform in [-range, range] [-]"
    )
    initial_rate_range_rpm: float = Field(
        0.2, ge=0, description="each component of the initial body rate is uniform in [-range, range] [rpm]"
    )
    sensors: Annotated[Sensors, BeforeValidator(expanded_sensors, json_schema_input_type=Sensors | str)] = Field(
        default_factory=Sensors,
        description="of attitude: a class, ideal or cubesat, or the keys that differ from cubesat",
    )
    thrusters: Thrusters | None = Field(None, description="cold-gas thrusters with a tank; null: none")

    @model_validator(mode="after")
    def _wheels_fit_inside(self) -> Self:
        if min(self.size_m) <= 0:
            raise ValueError(f"size_m = {list(self.size_m)}: every edge must be > 0")
        count, word = (3, "three") if self.wheel_layout == "orthogonal" else (4, "four")
        if (wheels_kg := count * self.wheel.mass_kg) >= self.mass_kg:
            raise ValueError(f"mass_kg = {self.mass_kg}: must exceed the {word} wheels, {wheels_kg:g} kg")
        if self.thrusters is not None:
            thrusters_fit_inside(self.thrusters, None if self.mjcf else self.mass_kg - wheels_kg, self.mjcf)
        return self


class SecondAxis(Section):
    """An axis of the spacecraft that fixes its rotation about the line of sight."""

    axis_B: Vector3 = Field((0.0, 1.0, 0.0), description="in B, not along the line of sight, of any length [-]")
    towards: Literal["sun", "earth", "velocity", "orbit_normal"] | Vector3 = Field(
        description="what it is turned to as far as the line of sight lets it: the Sun, Earth, the velocity in N, r x v in N, "
        "or a direction in N, of any length; within 5.7 deg of the line of sight it says nothing, and the rotation is "
        "carried along",
    )

    @model_validator(mode="after")
    def _axes_are_directions(self) -> Self:
        for key, value in (("axis_B", self.axis_B), ("towards", self.towards)):
            if not isinstance(value, str) and not any(value):
                raise ValueError(f"{key} = [0, 0, 0]: must be a direction")
        return self


class Control(Section):
    """The attitude control law, by plug-in name."""

    controller: str = Field(
        "mrp_sliding_mode",
        description=f"plug-in: mrp_sliding_mode, mrp_feedback or {YOUR_OWN}",
    )
    parameters: Parameters = Field(
        default_factory=dict, description="gains of the plug-in; see docs/theory/attitude_control.md"
    )
    slew: Literal["law", "time_optimal"] = Field(
        "law",
        description="how the spacecraft turns to a new target: as the gains of the law have it, or by the minimum-time turn "
        "about one axis within 80 % of the wheels' torque and momentum, which the law follows",
    )
    second_axis: SecondAxis | None = Field(
        None, description="what fixes the rotation about the line of sight; null: the shortest turn, carried along"
    )
    period_s: float = Field(0.5, ge=1e-3, le=60, description="how long wheel torques and forces are held [s]")


class Physics(Section):
    """Time integration by a Runge-Kutta method of fourth order."""

    timestep_s: float = Field(
        0.1, ge=1e-3, le=1.0, description="its step [s]; control.period_s is a whole multiple of it"
    )
    stepper: Literal["mujoco", "kernel"] = Field(
        "mujoco",
        description="mujoco: mj_step on the MJCF model, with wheels as bodies; kernel: the equations of free gyrostats in "
        "compiled code, wheels as momentum states, for large numbers of flights; it flies the packaged CubeSat",
    )


class Behavior(Section):
    """Who points at what, by plug-in name."""

    name: str = Field(
        "dedicated_communications",
        description="plug-in: dedicated_communications, adaptable_roles, body_tracking, target_sweep, planned_sweep, "
        f"scripted_policy, trained_policy or {YOUR_OWN}",
    )
    parameters: Parameters = Field(default_factory=dict, description="arguments of the plug-in")
    imaging_radius_m: float = Field(
        35_000.0,
        gt=0,
        description="R_im, inside which the body is imaged [m]; not given by the paper: with 35 km all "
        "spacecraft are inside at 0 and 10 min and outside at 20 min",
    )


class ExtraTarget(Section):
    """One more surface feature that the designer has to cover."""

    latitude_deg: float = Field(ge=-90, le=90, description="planetocentric latitude of the axis [deg]")
    longitude_deg: float = Field(ge=-360, le=360, description="east longitude of the axis [deg]")
    half_angle_deg: float = Field(20.0, gt=0, lt=90, description="of the pyramid about its axis [deg]")
    weight: Weight = Field(1.0, description="of its area, as target.weight [-]")


class Designer(Section):
    """How `swarm-mj design` looks for the fewest spacecraft (AAS 19-144, equations 3 to 6)."""

    max_observers: int = Field(20, ge=1, le=1000, description="N_max, the most observers a design may have")
    tolerance_percent: float = Field(0.1, ge=0, lt=100, description="epsilon, the largest |100 - P_TO| of a design [%]")
    fold: int = Field(
        1, ge=1, description="every face must be seen by this many: the loss of fold - 1 then loses nothing"
    )
    any_roll: bool = Field(
        True,
        description="count only what every rotation about the line of sight sees (the cone inscribed in a square field of "
        "view), because that rotation comes from the random initial attitude; false: the rotation of an inertial start",
    )
    population: int = Field(100, ge=2, description="designs in a generation of the genetic algorithm")
    max_generations: int = Field(200, ge=1, description="after which evolution stops in any case")
    patience: int = Field(50, ge=1, description="generations without a better design after which evolution stops")
    extra_targets: tuple[ExtraTarget, ...] = Field((), max_length=25, description="more features to cover")
    altitudes_m: tuple[float, ...] = Field(
        (), max_length=20, description="imaging altitudes to choose from [m]; empty: the design's"
    )
    times_of_flight_s: tuple[float, ...] = Field(
        (), max_length=20, description="times of flight to choose from [s]; empty: the design's"
    )
    releases_s: tuple[float, ...] = Field(
        (),
        max_length=20,
        description="times past the epoch to choose from at which a spacecraft is released [s], so that rotation and light are "
        "used; empty: the design's",
    )
    aims: tuple[Aim, ...] = Field(
        (), max_length=2, description="where a spacecraft may look, see design.aim, to choose from; empty: the design's"
    )
    max_points: int | None = Field(
        None,
        ge=1,
        le=100_000,
        description="visiting points of a target that are tried: so many of its mesh vertices, each in turn the farthest from "
        "those before; null: all, which of a whole body are thousands",
    )
    deliver_within_h: float | None = Field(
        None,
        gt=0,
        le=1000,
        description="hours past the epoch within which the whole map of a design must be on Earth by the best schedule of its "
        "flight [h]; null: no such demand",
    )
    probability: float | None = Field(
        None,
        gt=0,
        lt=1,
        description="with which a design must see all but tolerance_percent of the target, under the losses among the faults "
        "and the dispersions [-]; null: it is designed as if nothing happened",
    )
    realisations: int = Field(
        20,
        ge=0,
        le=10_000,
        description="dispersed flights of all candidates on which a design for a probability is sought; 0: none, then only "
        "losses are reckoned with, and candidates see what any rotation about the line of sight sees (any_roll)",
    )
    check_flights: int = Field(
        100,
        ge=2,
        le=10_000,
        description="dispersed flights of all candidates with other seeds, by which designs sought on the realisations are "
        "judged; they give the probability that is promised",
    )
    thin_from: int = Field(
        300,
        ge=1,
        description="with so many candidates or more, those are left out before their pictures are judged that others provably "
        "surpass: the proven minimum stays, and the genetic algorithm chooses among the rest",
    )
    time_limit_s: float = Field(300.0, gt=0, description="after which the exact solver stops without proof [s]")
    quality_class: str | None = Field(
        None,
        description="a face counts where the pictures of all spacecraft together map it at this class: one of "
        f"observation.classes, or {', '.join(PACKAGED)}; null: where one sees it",
    )

    @model_validator(mode="after")
    def _delivered_by_one_flight(self) -> Self:
        if self.deliver_within_h is not None:
            for key in ("extra_targets", "altitudes_m", "times_of_flight_s", "releases_s", "aims"):
                if getattr(self, key):
                    raise ValueError(
                        f"{key}: must be empty with deliver_within_h = {self.deliver_within_h:g}, which is judged by one "
                        "flight; design for each of them alone"
                    )
        return self

    @model_validator(mode="after")
    def _one_kind_of_safety(self) -> Self:
        if self.probability is not None and (self.fold > 1 or self.deliver_within_h is not None):
            key = "fold" if self.fold > 1 else "deliver_within_h"
            raise ValueError(f"{key}: must be left out with probability = {self.probability:g}: give one of the two")
        return self


class Safety(Section):
    """Limits whose violation is reported."""

    min_separation_m: float = Field(
        10.0, ge=0, description="closer than this [m], after the grace time, is a near-collision"
    )
    separation_grace_s: float = Field(
        60.0,
        ge=0,
        description="time past the epoch from which closeness counts [s]: all leave the mothership from one point",
    )


class Telemetry(Section):
    """What is written during the flight."""

    interval_s: float = Field(1.0, ge=1e-3, description="between two samples [s]; a whole multiple of control.period_s")


class Scenario(Section):
    """A whole mission."""

    name: str = Field(
        min_length=1,
        max_length=100,
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        description="what results and their folder are called",
    )
    description: str = Field("", description="one line on what the scenario is; shown in lists and reports")
    seed: int = Field(
        0,
        ge=0,
        lt=2**63,
        description="of every random number: initial attitudes and rates, faults, dispersions, evolution",
    )
    epoch: str = Field(
        "2018-01-01T03:15:00",
        description="time at which the swarm is deployed, ISO 8601, TDB, or UTC with a trailing Z, which is converted; from "
        "1800 to 2049, where the Earth's elements hold, "
        "or to 2199 where ephemerides.kernels says where it is; by default the paper's target is sunlit and Earth in "
        "view during the imaging (numbers beside DEFAULT_EPOCH in swarm_mj.smallbody.ephemeris)",
    )
    duration_s: float = Field(
        1200.0, gt=0, le=30 * 86_400.0, description="of the flight [s]; a whole multiple of control.period_s"
    )
    body: Annotated[Body, BeforeValidator(expanded_body, json_schema_input_type=Body | str)] = Field(
        default_factory=Body, description=f"its keys, or the name of a packaged body: {', '.join(packaged_bodies())}"
    )
    companion: Companion | None = Field(
        None, description="one more body, of a binary asteroid; null: none; docs/how-to/binaries.md"
    )
    ephemerides: Ephemerides = Field(default_factory=Ephemerides)
    perturbations: Perturbations = Field(default_factory=Perturbations)
    target: Target = Field(default_factory=Target)
    design: Design = Field(default_factory=Design)
    mothership: Mothership = Field(default_factory=Mothership)
    initial_states: tuple[KnownState, ...] = Field(
        (),
        max_length=1000,
        description="one entry per spacecraft that is on its way already at the epoch, without a mothership and without "
        "visiting points; empty: all come from the mothership; see docs/how-to/encounters.md",
    )
    trajectory: Trajectory = Field(default_factory=Trajectory)
    navigation: Navigation = Field(default_factory=Navigation)
    spacecraft: Spacecraft = Field(default_factory=Spacecraft)
    control: Control = Field(default_factory=Control)
    physics: Physics = Field(default_factory=Physics)
    behavior: Behavior = Field(default_factory=Behavior)
    camera: Camera = Field(default_factory=Camera)
    observation: Observation = Field(default_factory=Observation)
    designer: Designer = Field(default_factory=Designer)
    swarm: Swarm | None = Field(
        None, description="how the swarm coordinates; null: as the behaviour says; docs/theory/coordination.md"
    )
    link: Link = Field(default_factory=Link)
    data: Data = Field(default_factory=Data)
    safety: Safety = Field(default_factory=Safety)
    telemetry: Telemetry = Field(default_factory=Telemetry)
    faults: tuple[Fault, ...] = Field(
        (), max_length=1000, description="what goes wrong in flight; docs/how-to/faults.md"
    )
    dispersions: Dispersions = Field(default_factory=Dispersions)

    @model_validator(mode="after")
    def _known_states_stand_alone(self) -> Self:
        if not self.initial_states:
            return self
        for key, given, remedy in (
            ("mothership", self.mothership != Mothership(), "leave it out"),
            (
                "trajectory.corrections",
                bool(self.trajectory.corrections),
                "which lead to visiting points; leave them out",
            ),
            ("swarm.formation", self.swarm is not None and self.swarm.formation is not None, "leave it out"),
        ):
            if given:
                raise ValueError(f"{key}: cannot go with initial_states; {remedy}")
        expected = tuple(_visit_of(state, self.epoch, self.telemetry.interval_s) for state in self.initial_states)
        for k, visit in enumerate(expected):
            if not 0.0 < (arrival := visit.time_of_flight_s or 0.0) <= self.duration_s:
                raise ValueError(
                    f"initial_states.{k}: arrives at t = {arrival:g} s, outside the flight; must be from the first sample of "
                    f"the telemetry to duration_s = {self.duration_s:g}; change epoch, duration_s, or when it arrives"
                )
        design = self.design
        if (design.observers, design.visiting_points) != (
            expected,
            (1,) * len(expected),
        ) or design.reference is not None:
            raise ValueError(
                "design.visiting_points, observers, reference: say nothing with initial_states, of which none flies to a "
                "visiting point; leave them out"
            )
        return self

    @model_validator(mode="before")
    @classmethod
    def _known_states_arrive(cls, data: Any) -> Any:
        """Fill `design` with the arrivals of `initial_states`."""
        given = data.get("initial_states") if isinstance(data, Mapping) else None
        design = data.get("design", {}) if given else None
        if not isinstance(given, list | tuple) or not isinstance(design, Mapping):
            return data
        try:
            states = tuple(KnownState.model_validate(state) for state in given)
            epoch = tdb_date(data.get("epoch", cls.model_fields["epoch"].default))
            interval_s = Telemetry.model_validate(data.get("telemetry", {})).interval_s
        except ValueError:  # which the fields tell better
            return data
        filled: dict[str, Any] = {"visiting_points": (1,) * len(states)}
        filled["observers"] = tuple(_visit_of(state, epoch, interval_s) for state in states)
        if (last := max(visit.time_of_flight_s or 0.0 for visit in filled["observers"])) > 0.0:
            filled["time_of_flight_s"] = last
        if passing := [state.approach.miss_m for state in states if state.approach is not None]:
            filled["imaging_altitude_m"] = max(min(passing), 1.0)
        return {**data, "design": {**filled, **design}}

    @field_validator("epoch", mode="before")
    @classmethod
    def _epoch_is_a_date(cls, value: Any) -> str:
        return tdb_date(value)  # YAML reads an unquoted date and time as one

    @model_validator(mode="after")
    def _orbits_hold_at_the_epoch(self) -> Self:
        by_kernels = bool(self.ephemerides.kernels) and self.ephemerides.positions
        last = 2199 if by_kernels else 2049
        if not 1800 <= int(self.epoch[:4]) <= last:
            remedy = (
                "" if by_kernels else ", or give SPICE kernels that say where Sun and Earth stand (ephemerides.kernels)"
            )
            raise ValueError(
                f"epoch = {self.epoch}: must be from 1800 to {last}, where the elements of the Earth hold{remedy}"
            )
        return self

    @model_validator(mode="after")
    def _target_has_a_place(self) -> Self:
        if self.dispersions.target_m and self.target.region in ("lit", "body"):
            raise ValueError(
                f"dispersions.target_m = {self.dispersions.target_m:g}: must be 0 with target.region = {self.target.region}, "
                "which has no place that could be wrong"
            )
        return self

    @model_validator(mode="after")
    def _sequence_can_be_flown(self) -> Self:
        sequence, interval = self.observation.sequence, self.telemetry.interval_s
        if not sequence:
            return self
        if self.observation.criterion == "arrival":
            raise ValueError(
                "observation.criterion = arrival: counts no picture of observation.sequence; must be passage"
            )
        taken: dict[tuple[int | None, int], int] = {}
        observers = len(self.design.visiting_points)
        for k, picture in enumerate(sequence):
            key, t = f"observation.sequence.{k}", picture.seconds_after(self.epoch)
            if not 0.0 <= t <= self.duration_s:
                raise ValueError(
                    f"{key}.time = {picture.time}: is {t:g} s past the epoch; must be 0 to duration_s = {self.duration_s:g}"
                )
            if (picture.spacecraft or 1) > observers:
                raise ValueError(f"{key}.spacecraft = {picture.spacecraft}: must be an observer, from 1 to {observers}")
            tick = round(t / interval)
            for who in (picture.spacecraft, None) if picture.spacecraft else range(observers + 1):
                if (before := taken.get((who or None, tick))) is not None:
                    raise ValueError(
                        f"{key}.time = {picture.time}: falls on the sample of the telemetry of observation.sequence.{before}; "
                        f"take it out, or shorten telemetry.interval_s = {interval:g}"
                    )
            taken[picture.spacecraft, tick] = k
        return self

    @model_validator(mode="after")
    def _motion_blur_has_an_exposure(self) -> Self:
        if (limit := self.observation.max_motion_blur_px) is not None and not self.camera.exposure_s:
            raise ValueError(
                f"observation.max_motion_blur_px = {limit:g}: limits nothing without camera.exposure_s; give the exposure in "
                "seconds, or set max_motion_blur_px: null"
            )
        return self

    @property
    def designed_class(self) -> QualityClass | None:
        """The quality class that a design is made for; None: a face counts where it is seen."""
        name = self.designer.quality_class
        if name is None:
            return None
        own = {one.name: one for one in self.observation.classes}
        if name not in own and name not in PACKAGED:
            known = ", ".join(dict.fromkeys([*own, *PACKAGED]))
            raise ValueError(
                f"designer.quality_class = {name}: must be one of {known}, or be given in observation.classes"
            )
        return own.get(name) or QualityClass(name=name)

    @model_validator(mode="after")
    def _class_of_the_design_stands_alone(self) -> Self:
        if self.designer.quality_class is not None:
            for key, plain in (("fold", 1), ("deliver_within_h", None), ("probability", None)):
                if getattr(self.designer, key) != plain:
                    raise ValueError(
                        f"designer.{key} = {getattr(self.designer, key)}: must be {plain or 'null'} with "
                        "designer.quality_class, which asks for several looks itself; design for each alone"
                    )
        return self

    @model_validator(mode="after")
    def _classes_have_what_they_need(self) -> Self:
        designed = self.designed_class
        for quality_class in (*self.observation.classes, *((designed,) if designed else ())):
            for limit in quality_class.needs:
                name = f"observation.classes: {quality_class.name} asks for {limit}"
                if not self.camera.exposure_s:
                    raise ValueError(f"{name}, which needs camera.exposure_s; give the exposure in seconds")
                if limit == "min_snr" and self.body.reflectance is None:
                    raise ValueError(
                        f"{name}, which needs body.photometry, or body.albedo, 0.04 to 0.4 for most small bodies"
                    )
        return self

    @model_validator(mode="after")
    def _formation_has_thrusters(self) -> Self:
        if self.swarm is None or (formation := self.swarm.formation) is None:
            return self
        if self.spacecraft.thrusters is None:
            raise ValueError("swarm.formation: is held by thrusters; give spacecraft.thrusters: {}")
        if self.spacecraft.thrusters.layout == "four_z":
            raise ValueError(
                "spacecraft.thrusters.layout = four_z: pushes along one axis; swarm.formation needs six, or sites that push in "
                "every direction"
            )
        if formation.start_s >= self.duration_s:
            raise ValueError(
                f"swarm.formation.start_s = {formation.start_s:g}: must be before the flight's end, duration_s = "
                f"{self.duration_s:g}"
            )
        return self

    @model_validator(mode="after")
    def _own_spacecraft_can_fly(self) -> Self:
        if self.spacecraft.mjcf is None:
            return self
        if self.physics.stepper == "kernel":
            raise ValueError(
                "physics.stepper = kernel: flies the packaged CubeSat, not spacecraft.mjcf; must be 'mujoco'"
            )
        for key in ("mass_percent", "inertia_percent"):
            if value := getattr(self.dispersions, key):
                raise ValueError(
                    f"dispersions.{key} = {value:g}: the masses of spacecraft.mjcf are the file's; must be 0"
                )
        return self

    @model_validator(mode="after")
    def _times_fit_together(self) -> Self:
        whole = (
            ("control.period_s", self.control.period_s, "physics.timestep_s", self.physics.timestep_s),
            ("duration_s", self.duration_s, "control.period_s", self.control.period_s),
            ("telemetry.interval_s", self.telemetry.interval_s, "control.period_s", self.control.period_s),
            ("observation.interval_s", self.observation.interval_s, "telemetry.interval_s", self.telemetry.interval_s),
            ("duration_s", self.duration_s, "telemetry.interval_s", self.telemetry.interval_s),
        )
        for key, value, unit_key, unit in whole:
            if not is_multiple(value, unit):
                raise ValueError(f"{key} = {value:g}: must be a whole multiple of {unit_key} = {unit:g}")
        if self.spacecraft.thrusters is not None:
            thrusters_can_pulse(self.spacecraft.thrusters, self.control.period_s)
        self._check_arrivals()
        self._check_corrections()
        return self

    def _check_corrections(self) -> None:
        """Refuse corrections that nothing can fly, and times at which nobody decides."""
        corrections_can_be_flown(self.trajectory, self.spacecraft.thrusters)
        for k, correction in enumerate(self.trajectory.corrections):
            if not is_multiple(correction.after_release_s or correction.before_arrival_s or 0.0, self.control.period_s):
                raise ValueError(
                    f"trajectory.corrections.{k}.{correction.key}: must be a whole multiple of control.period_s = "
                    f"{self.control.period_s:g}"
                )

    def _check_arrivals(self) -> None:
        """Refuse releases and arrivals that the flight does not sample, and targets that are not there."""
        design, interval = self.design, self.telemetry.interval_s
        own = [("design", 0, design.release_s, design.time_of_flight_s)]
        for k, arrival in enumerate(design.observers):
            release = design.release_s if arrival.release_s is None else arrival.release_s
            flight = design.time_of_flight_s if arrival.time_of_flight_s is None else arrival.time_of_flight_s
            own.append((f"design.observers.{k}", arrival.target, release, flight))
        targets = len(self.designer.extra_targets)
        for key, target, release, flight in own:
            if target > targets:
                raise ValueError(
                    f"{key}.target = {target}: designer.extra_targets has {targets} entries; must be 0 for the scenario's "
                    "target, or one of them from 1"
                )
            for name, value in (("release_s", release), ("time_of_flight_s", flight)):
                if value and not is_multiple(value, interval):
                    raise ValueError(
                        f"{key}.{name} = {value:g}: must be a whole multiple of telemetry.interval_s = {interval:g}"
                    )
            if release + flight > self.duration_s:
                after = (
                    f"{key}.release_s + time_of_flight_s = {release:g} + " if release else f"{key}.time_of_flight_s = "
                )
                raise ValueError(f"duration_s = {self.duration_s:g}: must not end before {after}{flight:g}")


def _visit_of(state: KnownState, epoch: str, interval_s: float) -> Visit:
    """The arrival of a spacecraft that is on its way at an epoch in TDB, at the nearest sample of the telemetry."""
    arrival = state.arrival_s
    if arrival is None:
        assert state.approach is not None  # the section sees to that
        arrival = state.approach.closest_after(epoch)
    return Visit.model_construct(
        visiting_point=1, release_s=0.0, time_of_flight_s=float(f"{round(arrival / interval_s) * interval_s:.12g}")
    )


def is_multiple(value: float, unit: float) -> bool:
    """Whether `value` is a whole, positive multiple of `unit` to 1e-9 relative."""
    if not unit > 1e-12 * value:
        return False
    count = round(value / unit)
    return count >= 1 and abs(value - count * unit) <= 1e-9 * value
