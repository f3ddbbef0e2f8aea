"""What readers rely on in the JSON of a result: the summary of a run and its events. `RunSummary` says it of summary.json.

A key with a default may be missing, as in the files of an earlier version.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import FailFast, Field, NonNegativeFloat, NonNegativeInt, PositiveInt, model_validator

from swarm_mj.io.records import Record

#: Shares are rounded when they are written.
Percent = Annotated[float, Field(ge=0.0, le=100.001)]
#: A number for each spacecraft, by its name.
ByName = dict[str, float]
#: An object without keys.
Nothing = Annotated[dict[str, float], Field(max_length=0)]


class Event(Record):
    """A fault, or what followed from one."""

    time_s: float
    spacecraft: str
    kind: str
    detail: str


class Switch(Record):
    """A change of target."""

    time_s: float
    error_before_deg: float
    target_held_s: float = 0.0


class NearCollision(Record):
    """Two spacecraft that came too close."""

    spacecraft: Annotated[list[str], Field(min_length=2, max_length=2)]
    time_s: float
    distance_m: float


class MothershipOrbit(Record):
    """How the mothership comes; numbers of an orbit only where the field has a GM."""

    way: str
    distance_m: NonNegativeFloat
    speed_m_s: NonNegativeFloat
    axes: str = "ecliptic"
    orbit: Literal["hyperbola", "ellipse", "parabola", "radial"] | None = None
    v_infinity_m_s: NonNegativeFloat | None = None
    v_infinity_longitude_deg: float | None = None
    v_infinity_latitude_deg: float | None = None
    b_t_m: float | None = None
    b_r_m: float | None = None
    closest_approach_s: float | None = None
    periapsis_radius_m: NonNegativeFloat | None = None
    apoapsis_radius_m: NonNegativeFloat | None = None
    periapsis_speed_m_s: NonNegativeFloat | None = None
    eccentricity: NonNegativeFloat | None = None
    turn_angle_deg: float | None = None


class Encounter(Record):
    """How a spacecraft passed the body."""

    closest_approach_utc: str | None
    closest_approach_s: float
    distance_m: NonNegativeFloat
    speed_m_s: NonNegativeFloat
    phase_start_deg: NonNegativeFloat
    phase_closest_deg: NonNegativeFloat
    phase_least_deg: NonNegativeFloat
    phase_end_deg: NonNegativeFloat
    phase_least_s: float
    peak_turn_rate_deg_s: NonNegativeFloat


class NotDelivered(Record):
    """A part of the map that was seen and does not arrive."""

    reason: str
    percent: Percent
    spacecraft: list[str]
    remedy: str


class NotObserved(Record):
    """A part of the target that was not seen."""

    cause: str
    percent: Percent
    remedy: str


class Mapped(Record):
    """What a quality class maps of the target."""

    percent: Percent
    area_km2: NonNegativeFloat


class Spread(Record):
    """Least, median and greatest of what was seen or delivered."""

    min: float
    median: float
    max: float


class FormationHeld(Record):
    """How a formation was held, see `swarm_mj.records.formation`."""

    held_s: Annotated[list[float], Field(min_length=2, max_length=2)]
    dead_band_m: NonNegativeFloat
    error_m_final: ByName
    join_m_s: ByName
    hold_m_s: ByName
    most_needed_m_s2: ByName
    thrust_m_s2: float
    tank_m_s: float
    empty_s: ByName


class PicturePlanSummary(Record):
    """A plan of pictures beside its bound, see `swarm_mj.flight.coordination.picture_plan_summary`."""

    objective: Literal["mapped", "delivered"]
    planned_percent: Percent
    bound_percent: Percent
    gap_percent: Percent
    proven: bool
    pictures: NonNegativeInt
    aim_spacing: NonNegativeFloat
    taken: NonNegativeInt | None = None
    as_planned: NonNegativeInt | None = None
    plans_repaired: NonNegativeInt | None = None


class NavigationSummary(Record):
    """What linear covariance says of a flight's corrections, as far as it is read again."""

    findings: list[str] = []


class NotUsed(Record):
    """Why pictures for navigation were not used, and how many."""

    why: str = ""
    count: NonNegativeInt = 0


class OpticalSummary(Record):
    """What navigation by pictures came to, as far as it is read again."""

    findings: list[str] = []
    used: dict[str, int] = {}
    not_used: list[NotUsed] = []
    position_error_m_arrival: ByName = {}
    position_3_sigma_m_arrival: ByName = {}
    nees_per_component_arrival: ByName = {}
    aim_error_deg_arrival: ByName = {}


class RunSummary(Record):
    """summary.json of a run, see `swarm_mj.records.summary.summarise`."""

    scenario: str
    spacecraft: PositiveInt
    observers: NonNegativeInt
    coverage_percent: Percent
    versions: dict[str, str]
    target_vertices: NonNegativeInt
    target_faces: NonNegativeInt
    target_cells: PositiveInt
    target_area_km2: NonNegativeFloat
    target: str = ""
    target_percent_of_body: Percent = 0.0
    weighted: bool = False
    visiting_points: Annotated[list[int], FailFast()]
    coverage_percent_passage: Percent
    coverage_percent_by_spacecraft: dict[str, Percent]
    criterion: Literal["arrival", "passage"]
    observer: str
    observer_note: str
    images: NonNegativeInt
    pointing_error_deg_final: ByName
    pointing_error_deg_before_switch: ByName
    mode_switches: dict[str, Annotated[list[Switch], FailFast()]]
    max_wheel_speed_fraction: NonNegativeFloat
    max_wheel_torque_fraction: NonNegativeFloat
    wheel_saturation_s: ByName
    deployment_delta_v_m_s: ByName
    deployer_max_speed_m_s: float | None = None
    least_distance_to_centre_km: ByName
    near_collisions: Annotated[list[NearCollision], FailFast()]
    link_closed_percent: dict[str, Percent]
    links_closed_final: NonNegativeInt
    wall_s: dict[str, float]
    mothership: MothershipOrbit | None = None
    encounters: dict[str, Encounter] = {}
    encounter_findings: list[str] = []
    deployment_findings: list[str] = []
    navigation: NavigationSummary = NavigationSummary()
    optical: OpticalSummary = OpticalSummary()
    formation: FormationHeld | None = None
    picture_plan: PicturePlanSummary | None = None
    pointing_error_deg_arrival: ByName = {}
    attitude_knowledge_error_deg_arrival: ByName = {}
    sensors: str = "not told"
    target_held_s_final: ByName = {}
    events: Annotated[list[Event], FailFast()] = []
    lost: list[str] = []
    propellant_used_kg: ByName = {}
    propellant_left_kg: ByName = {}
    thrust_delta_v_m_s: ByName = {}
    planned_burns_m_s: ByName = {}
    spacecraft_file: str | None = None
    spacecraft_notes: list[str] = []
    delivered_percent: Percent | None = None
    delivered_percent_bound: Percent | None = None
    seen_bits: NonNegativeInt = 0
    delivered_bits: NonNegativeInt = 0
    aboard_bits: NonNegativeInt = 0
    lost_bits: NonNegativeInt = 0
    gsd_m: Spread | Nothing = {}
    gsd_delivered_m: Spread | Nothing = {}
    incidence_deg: Spread | Nothing = {}
    not_observed: list[NotObserved] = []
    classes: dict[str, Mapped] = {}
    light: Literal["sunlit", "ignored"] = "ignored"
    time_to_full_map_s: float | None = None
    time_to_all_data_s: float | None = None
    time_to_all_data_s_bound: float | None = None
    link_time_s: ByName = {}
    lost_after_s: ByName = {}
    not_delivered: Annotated[list[NotDelivered], FailFast()] = []

    @model_validator(mode="before")
    @classmethod
    def _no_design(cls, data: Any) -> Any:
        if isinstance(data, dict) and "proof" in data:
            raise ValueError("describes a design; give a folder of `swarm-mj fly`")
        return data


class GrowthRow(Record):
    """The proven minimum under one more demand or freedom, a row of growth.json."""

    change: str
    n_observers: int | None
    note: str


#: Tables that name every spacecraft.
OF_ALL = (
    "coverage_percent_by_spacecraft", "pointing_error_deg_final", "mode_switches", "wheel_saturation_s",
    "deployment_delta_v_m_s", "least_distance_to_centre_km", "link_closed_percent",
)  # fmt: skip


def contradiction(summary: dict[str, Any], names: list[str]) -> str:
    """What of a summary cannot be said of a flight of the spacecraft of these names, in words; empty where all can."""
    if summary["spacecraft"] != len(names):
        return f"spacecraft = {summary['spacecraft']}: must be {len(names)}, as in telemetry.nc"
    if summary["observers"] > len(names):
        return f"observers = {summary['observers']}: must be at most spacecraft = {len(names)}"
    for key in OF_ALL:
        if missing := [name for name in names if name not in summary[key]]:
            return f"{key}.{missing[0]} is missing"
    return ""
