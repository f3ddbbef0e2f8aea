"""What a study is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, TypeAdapter, ValidationError, field_validator, model_validator

from swarm_mj.errors import ScenarioError
from swarm_mj.ideas.components import PROPULSION, SIZES
from swarm_mj.scenarios.explaining import explained, listed
from swarm_mj.scenarios.loading import file_text, parse_yaml
from swarm_mj.scenarios.schema_quality import PACKAGED
from swarm_mj.scenarios.section import Section

#: Keys of the scenario that follow from a requirement, and from which of its own.
SET_BY = {
    "observation.max_gsd_m": "resolution_m",
    "observation.classes": "quality",
    "designer.quality_class": "quality",
    "designer.max_observers": "limits.spacecraft",
    "designer.tolerance_percent": "share_percent",
    "designer.probability": "probability",
    "data.horizon_s": "deliver_within_h",
    "design.imaging_altitude_m": "limits.altitudes_m",
}
#: Keys of the scenario that are chosen, and by which designer.
DESIGNED = {"design.visiting_points": "swarm", "design.observers": "swarm", "link.earth.radio": "spacecraft"}
#: What may differ between requirements of which one is no harder to see than the other.
NOT_OF_KINDS = ("name", "resolution_m", "share_percent", "flights", "nearest", "sobol")


class Limits(Section):
    """What a swarm may be."""

    units: tuple[int, ...] = Field(
        (3, 6, 12), min_length=1, description=f"sizes of spacecraft to choose from, of {', '.join(map(str, SIZES))} [U]"
    )
    spacecraft: int = Field(20, ge=1, le=1000, description="most observers")
    spacecraft_kg: float | None = Field(
        None,
        gt=0,
        le=100,
        description="largest mass of one, margin included, as its deployer allows [kg]; null: the standard's for its size",
    )
    swarm_kg: float | None = Field(None, gt=0, le=1e5, description="largest mass of all spacecraft [kg]; null: any")
    swarm_u: float | None = Field(None, gt=0, le=1e5, description="largest volume of all spacecraft [U]; null: any")
    propulsion: tuple[str, ...] = Field(
        tuple(one.name for one in PROPULSION),
        min_length=1,
        description=f"thrusters to choose from, of {', '.join(one.name for one in PROPULSION)}",
    )
    deployer_m_s: float | None = Field(
        None,
        gt=0,
        le=1e4,
        description="largest velocity that the deployer gives a spacecraft [m/s]; null: not asked for",
    )
    altitudes_m: tuple[float, ...] = Field(
        (),
        max_length=20,
        description="imaging altitudes to choose from [m]; empty: 1/4, 1/2, 1 and 2 times the scenario's",
    )

    @field_validator("units")
    @classmethod
    def _known(cls, value: tuple[int, ...]) -> tuple[int, ...]:
        unknown = [units for units in value if units not in SIZES]
        if unknown:
            raise ValueError(f"{unknown[0]}: must be among {', '.join(map(str, SIZES))}")
        return tuple(sorted(set(value)))

    @field_validator("propulsion")
    @classmethod
    def _known_thrusters(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        known = [one.name for one in PROPULSION]
        if unknown := [name for name in value if name not in known]:
            raise ValueError(f"{unknown[0]}: must be among {'; '.join(known)}")
        return value

    @field_validator("altitudes_m")
    @classmethod
    def _above_ground(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if any(not 0.0 < altitude < 1e12 for altitude in value):
            raise ValueError(f"{list(value)}: each must be above 0 and below 1e12 m")
        return value


class Instruments(Section):
    """What is carried besides the camera, all of it together."""

    mass_kg: float = Field(0.0, ge=0, le=20, description="without margin [kg]; default: the camera is all")
    volume_u: float = Field(0.0, ge=0, le=12, description="inside [U]; default: the camera is all")
    power_w: float = Field(0.0, ge=0, le=200, description="drawn in the passage [W]; default: the camera is all")


class Margins(Section):
    """What is kept in hand."""

    mass: float = Field(
        0.2, ge=0, le=1, description="of all masses [-]; default: system margin of early phases (ECSS, ESA)"
    )
    integration: float = Field(
        0.15,
        ge=0,
        le=1,
        description="of the parts' masses that cables, brackets, thermal control and shielding weigh [-]; assumed",
    )
    power: float = Field(0.1, ge=0, le=1, description="of all powers [-]; default: of components that exist")
    volume: float = Field(0.1, ge=0, lt=1, description="share that harness and gaps take [-]; assumed")
    relief: float = Field(
        1.4,
        ge=1,
        le=10,
        description="how much finer than asked for a pixel is straight below [-]: slant ranges and slopes coarsen it; assumed",
    )
    overlap: float = Field(
        2.0,
        ge=1,
        le=100,
        description="pictures that are sent over those that the pixels need [-]; assumed: half is overlap",
    )
    cells: float = Field(
        0.8, gt=0, le=1, description="what age, heat and pointing leave of the panels' power [-]; assumed"
    )
    battery: float = Field(0.7, gt=0, le=1, description="share of a battery that is used [-]; assumed")


class Requirement(Section):
    """What is to be seen, how well, and by what."""

    name: str = Field(min_length=1, max_length=200, description="of the study")
    scenario: str = Field(
        min_length=1,
        description="packaged scenario, or path of a file, beside the requirement or from here: body, target, mothership, "
        "epoch, criterion",
    )
    changes: dict[str, Any] = Field(default_factory=dict, description="values by dotted key that change it")
    resolution_m: float = Field(gt=0, le=1e5, description="coarsest ground sampling distance, obliquity included [m]")
    share_percent: float = Field(99.9, gt=0, le=100, description="of the target that must be seen so [%]")
    quality: Literal["seen", "resolved", "stereo", "shape"] = Field(
        "seen", description="class at which a face counts, at the resolution, see observation.classes"
    )
    probability: float | None = Field(
        None,
        gt=0,
        lt=1,
        description="with which the share is seen under the losses (faults) and dispersions of the scenario [-]; null: without "
        "any",
    )
    flights: int = Field(
        100, ge=10, le=100_000, description="of the campaign that shows whether probability is kept, where it is given"
    )
    min_snr: float = Field(20.0, ge=0, le=1e4, description="least signal to noise of a pixel [-]")
    max_blur_px: float = Field(
        1.0, gt=0, le=100, description="largest motion of the ground in an exposure, the camera not turning along [px]"
    )
    deliver_within_h: float = Field(
        240.0,
        gt=0,
        le=720.0,
        description="time until all pictures are on Earth [h]; at most what data.horizon_s allows",
    )
    contact_h: float = Field(8.0, gt=0, le=24, description="contact of whoever sends with Earth a day, for sizing [h]")
    listen_share: float = Field(
        1.0, ge=0, le=1, description="of the time between contacts in which the receiver is on [-]; default: always"
    )
    network: Literal["dsn", "dsn34", "estrack"] | None = Field(
        None, description="ground stations, see link.ground.network; null: the scenario's"
    )
    delta_v_m_s: float | None = Field(
        0.0,
        ge=0,
        le=1e4,
        description="that thrusters must give [m/s]; 0: there are none; null: what trajectory.corrections of changes take in "
        "99 of 100 flights",
    )
    turn_s: float = Field(120.0, gt=0, le=1e5, description="time in which it turns by 180 deg, from rest to rest [s]")
    instruments: Instruments = Field(
        default_factory=Instruments, description="of each spacecraft, besides its camera; their data are not counted"
    )
    nearest: bool = Field(
        False,
        description="whether to look for a swarm where none meets it: by the way to relax it, then with the resolution a "
        "quarter coarser at a time; takes as long as several studies",
    )
    sobol: int = Field(
        0,
        ge=0,
        le=65_536,
        description="points of each base sample of Sobol' indices of what drives, a power of 2; 0: none are computed",
    )
    limits: Limits = Field(default_factory=Limits, description="what may be chosen")
    margins: Margins = Field(default_factory=Margins, description="what is kept in hand")

    @field_validator("sobol")
    @classmethod
    def _power_of_two(cls, value: int) -> int:
        if value & (value - 1):
            raise ValueError(f"{value}: must be a power of 2")
        return value

    @model_validator(mode="after")
    def _changes_leave_what_follows(self) -> Self:
        given = [inner for key, value in self.changes.items() for inner in _keys_within(key, value)]
        set_by = SET_BY if self.network is None else {**SET_BY, "link.ground.network": "network"}
        for key in given:
            if key.split(".")[0] in ("camera", "spacecraft"):
                raise ValueError(f"changes: {key}: is what is sized; must be a key of another section")
            if own := next((own for name, own in set_by.items() if (key + ".").startswith(name + ".")), None):
                raise ValueError(f"changes: {key}: follows from {own} of the requirement; must be given there")
            if by := next((by for name, by in DESIGNED.items() if (key + ".").startswith(name + ".")), None):
                raise ValueError(f"changes: {key}: is chosen by the {by} designer; must not be given")
        return self

    @property
    def looks(self) -> int:
        """In how many pictures each part of the target must be seen, at the least."""
        demands = PACKAGED[self.quality]
        return max(
            max(demand.looks, demand.sectors, 2 if demand.convergence_deg or demand.light_varied_deg else 1)
            for demand in demands
        )

    @property
    def scenario_changes(self) -> dict[str, Any]:
        """Values of its scenario by dotted key that ask for what is required, whatever the spacecraft."""
        counted = self.quality != "seen"
        return {
            **self.changes,
            "observation.max_gsd_m": self.resolution_m,
            "observation.classes": [{"name": self.quality}] if counted else [],
            "designer.quality_class": self.quality if counted else None,
            "designer.max_observers": self.limits.spacecraft,
            "designer.tolerance_percent": round(100.0 - self.share_percent, 9),
            # Of quality classes no design is made for a probability: the campaign alone tells.
            "designer.probability": None if counted else self.probability,
            "data.horizon_s": 3600.0 * self.deliver_within_h,
            # Some thrusters, until they are sized: without, the scenario refuses corrections.
            **({"spacecraft.thrusters": {}} if any(key.startswith("trajectory") for key in self.changes) else {}),
            **({} if self.network is None else {"link.ground.network": self.network}),
        }

    def value(self, key: str) -> float:
        """A number by its dotted key."""
        section, _, name = key.rpartition(".")
        return float(getattr(getattr(self, section) if section else self, name))

    def allows(self, key: str, value: float) -> bool:
        """Whether a number may be asked for, by its dotted key."""
        section, _, name = key.rpartition(".")
        field = type(getattr(self, section) if section else self).model_fields[name]
        kind: Any = Annotated[field.annotation, field]
        try:
            TypeAdapter(kind).validate_python(value)
        except ValidationError:
            return False
        return True

    def with_value(self, key: str, value: float) -> Requirement:
        """The requirement with another number at a dotted key."""
        section, _, name = key.rpartition(".")
        if not section:
            return self.model_copy(update={name: value})
        return self.model_copy(update={section: getattr(self, section).model_copy(update={name: value})})

    def eased(self, way: Mapping[str, float]) -> Requirement:
        """The requirement relaxed, see `Study.relaxed`."""
        found = self
        for key, value in way.items():
            if key == "limits.units":
                found = found.model_copy(update={"limits": found.limits.model_copy(update={"units": (int(value),)})})
            else:
                found = found.with_value(key, int(value) if key == "limits.spacecraft" else value)
        return found

    def no_harder_to_see(self, other: Requirement) -> bool:
        """Whether a spacecraft that is sized for it needs no more like it than one for another requirement does for that.

        Of each kind the camera of the finer resolution has the finer pixels, and sees no more with each of them. All else that
        is asked is the same: masses and wheels decide how soon a turn is over, and with that which pictures count.
        """
        alike = self.model_copy(update={key: getattr(other, key) for key in NOT_OF_KINDS}) == other
        return alike and self.resolution_m >= other.resolution_m and self.share_percent <= other.share_percent


def _keys_within(key: str, value: Any) -> Iterator[str]:
    """Dotted keys of what a change gives, sections within sections opened."""
    if isinstance(value, Mapping) and value:
        for inner, each in value.items():
            yield from _keys_within(f"{key}.{inner}", each)
    else:
        yield key


def load_requirement(source: str | Path | dict[str, Any]) -> Requirement:
    """Read a requirement from a file, or take its values.

    Raises:
        ScenarioError: The file cannot be read, or a value is not allowed.
    """
    data: Any = source
    if not isinstance(source, dict):
        data = parse_yaml(file_text(Path(source), "requirement"), str(source))
    if not isinstance(source, dict) and isinstance(named := data.get("scenario"), str):
        beside = Path(source).parent / named
        data = {**data, "scenario": str(beside) if beside.is_file() else named}
    try:
        return Requirement.model_validate(data)
    except ValidationError as error:
        name = source if not isinstance(source, dict) else "requirement"
        raise ScenarioError(f"{name}:\n{listed(error, partial(explained, whole=Requirement))}") from None
