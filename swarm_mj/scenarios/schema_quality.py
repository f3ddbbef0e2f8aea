"""Quality classes: what the pictures of a face must be for a map that can be used, beyond having been seen.

A class is a list of demands, and a face fulfils it when its looks fulfil each of them. A look is a picture in which the face
counts by the scenario's criterion: in the field of view, not hidden, not dark. No demand forbids a look, so that one more
never takes a face off the map.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from swarm_mj.scenarios.section import Section


def _rising(angles: tuple[float, float]) -> tuple[float, float]:
    if angles[0] > angles[1]:
        raise ValueError(f"= {list(angles)}: the least angle must not exceed the largest")
    return angles


_Angle = Annotated[float, Field(ge=0, le=180)]
#: Least and largest angle [deg].
Angles = Annotated[tuple[_Angle, _Angle], AfterValidator(_rising)]


class Demand(Section):
    """What some looks of a face must be. Limits hold for each look at the face's centre; conditions for some of those looks."""

    looks: int = Field(1, ge=1, le=1000, description="least number of looks within the limits")
    max_gsd_m: float | None = Field(
        None, gt=0, description="limit: largest ground sampling distance, obliquity included [m]; null: any"
    )
    emission_deg: Angles | None = Field(
        None, description="limit: least and largest angle between face normal and camera [deg]; null: any"
    )
    incidence_deg: Angles | None = Field(
        None, description="limit: least and largest angle between face normal and Sun [deg]; null: any"
    )
    phase_deg: Angles | None = Field(
        None, description="limit: least and largest angle between Sun and camera at the face [deg]; null: any"
    )
    max_motion_blur_px: float | None = Field(
        None, gt=0, description="limit: largest motion over the detector during camera.exposure_s [px]; null: any"
    )
    min_snr: float | None = Field(
        None, gt=0, description="limit: least signal to noise of a pixel, which needs camera.exposure_s [-]; null: any"
    )
    convergence_deg: Angles | None = Field(
        None,
        description="condition: two looks whose lines of sight make an angle between these at the face [deg]; null: none",
    )
    alike_light_deg: float = Field(
        180.0, ge=0, le=180, description="largest angle between the Sun's directions of those two looks [deg]; 180: any"
    )
    sectors: int = Field(
        0,
        ge=0,
        le=4,
        description="condition: least number of the quadrants about north, east, south and west of the face's horizon from "
        "which there is a look; north is along the body's +z; 0: none",
    )
    light_varied_deg: Angles | None = Field(
        None,
        description="condition: two looks between whose Sun directions, in the body's frame, lies such an angle [deg]; "
        "null: none",
    )


#: The packaged classes. Where no ground sampling distance is asked for, that of the scenario's criterion stands.
PACKAGED: Mapping[str, tuple[Demand, ...]] = {
    # The scenario's criterion alone.
    "seen": (Demand(),),
    # Assumed: a pixel covers at most twice as much ground along the slant as across, and a stone of a pixel's height casts a
    # shadow of less than three.
    "resolved": (Demand(emission_deg=(0.0, 60.0), incidence_deg=(0.0, 70.0)),),
    # Convergence: the guidelines of the Ames Stereo Pipeline for choosing pairs. Alike light: Becker et al. 2015, Lunar and
    # Planetary Science Conference 46, 2703, ask for it; the 20 deg are assumed.
    "stereo": (
        Demand(
            emission_deg=(0.0, 60.0),
            incidence_deg=(0.0, 70.0),
            convergence_deg=(10.0, 60.0),
            alike_light_deg=20.0,
        ),
    ),
    # Limits for stereophotoclinometry: Palmer et al. 2022, Planetary Science Journal 3, 102; at least three images.
    "shape": (
        Demand(looks=3),
        Demand(emission_deg=(35.0, 48.0), incidence_deg=(0.0, 20.0), convergence_deg=(70.0, 110.0)),
        Demand(emission_deg=(0.0, 20.0), incidence_deg=(30.0, 50.0), light_varied_deg=(40.0, 90.0)),
    ),
}


class QualityClass(Section):
    """A class by name: a packaged one, or one of your own with its demands."""

    name: str = Field(
        pattern="^[a-z][a-z0-9_]{0,30}$", description=f"packaged: {', '.join(PACKAGED)}; or your own, with demands"
    )
    max_gsd_m: float | None = Field(
        None,
        gt=0,
        description="largest ground sampling distance of every look of the class, obliquity included [m]; null: what its "
        "demands and the criterion say",
    )
    demands: tuple[Demand, ...] = Field(
        (), max_length=16, description="all must be fulfilled; none: those of the packaged class"
    )

    @model_validator(mode="after")
    def _known(self) -> Self:
        if not self.demands and self.name not in PACKAGED:
            raise ValueError(f"name = {self.name}: must be one of {', '.join(PACKAGED)}, or give the class its demands")
        if self.demands and self.name in PACKAGED:
            raise ValueError(f"name = {self.name}: is a packaged class; give a class with demands a name of its own")
        return self

    @property
    def all_demands(self) -> tuple[Demand, ...]:
        """Its demands, each with the class's own limit of the ground sampling distance where that is the smaller one."""
        demands = self.demands or PACKAGED[self.name]
        if (limit := self.max_gsd_m) is None:
            return demands
        return tuple(
            demand.model_copy(update={"max_gsd_m": min(demand.max_gsd_m or limit, limit)}) for demand in demands
        )

    @property
    def needs(self) -> tuple[str, ...]:
        """Limits among those of its demands that need more than geometry: of motion blur, of signal to noise."""
        asked = ("max_motion_blur_px", "min_snr")
        return tuple(key for key in asked if any(getattr(demand, key) is not None for demand in self.all_demands))


def _by_name(given: Any) -> Any:
    several = isinstance(given, list | tuple)
    return [{"name": one} if isinstance(one, str) else one for one in given] if several else given


def _unlike(classes: tuple[QualityClass, ...]) -> tuple[QualityClass, ...]:
    names = [one.name for one in classes]
    if twice := [name for name in names if names.count(name) > 1]:
        raise ValueError(f"{twice[0]} is there twice: give each class a name of its own")
    return classes


#: Classes as a scenario gives them: packaged ones by name, or mappings.
Classes = Annotated[
    tuple[QualityClass, ...],
    BeforeValidator(_by_name, json_schema_input_type=tuple[QualityClass | str, ...]),
    AfterValidator(_unlike),
]
