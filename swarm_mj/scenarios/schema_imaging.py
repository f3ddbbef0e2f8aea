"""Sections of a scenario about pictures: the camera, and what counts in them."""

from __future__ import annotations

from collections.abc import Mapping
from math import atan, degrees, hypot
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from swarm_mj.scenarios.constants import CUBESAT_APERTURE_M, GREEN_LIGHT_M
from swarm_mj.scenarios.schema_detector import INSTRUMENTS, Detector
from swarm_mj.scenarios.schema_quality import PACKAGED, Classes
from swarm_mj.scenarios.schema_sequence import MAX_PICTURES, Pictures
from swarm_mj.scenarios.section import Section, Vector3

#: Least `observation.min_fraction` by which whole cells are meant: counts of pixels do not tell 99 % of a cell from all of it.
WHOLE_FROM = 0.99


#: Pixels along one side of a detector.
Pixels = Annotated[int, Field(ge=16, le=100_000)]
#: A small turn about an axis of the camera.
SmallAngle = Annotated[float, Field(ge=-10, le=10)]


class Gimbal(Section):
    """A scan mirror, or a camera on a hinge: it turns the line of sight about an axis towards the body's centre."""

    axis_B: Vector3 = Field(description="of the hinge, across camera.boresight_B, of any length [-]")
    from_deg: float = Field(ge=-360, le=360, description="least angle from boresight_B about the axis [deg]")
    to_deg: float = Field(ge=-360, le=360, description="largest angle [deg]")
    rate_deg_s: float = Field(gt=0, le=1e3, description="largest speed at which it turns [deg/s]")

    @model_validator(mode="after")
    def _turns(self) -> Self:
        if not any(self.axis_B):
            raise ValueError("axis_B = [0, 0, 0]: must be a direction")
        if not self.from_deg < self.to_deg <= self.from_deg + 360.0:
            raise ValueError(
                f"to_deg = {self.to_deg:g}: must be above from_deg = {self.from_deg:g}, by at most 360 deg"
            )
        return self


class Camera(Section):
    """The camera, along +z where boresight_B says nothing else."""

    half_angle_deg: float = Field(
        21.5, gt=0, lt=90, description="to the sides of a square field of view, or of the cone [deg]"
    )
    shape: Literal["square", "cone"] = Field("square", description="of the field of view")
    resolution_px: int = Field(512, ge=16, le=8192, description="pixels along one side")
    detector_ifov_rad: float | None = Field(
        None,
        gt=0,
        le=0.1,
        description="angle of one pixel of the real detector, for the ground sampling distance [rad]; null: the picture's",
    )
    detector_px: tuple[Pixels, Pixels] | None = Field(
        None,
        description="pixels of the real detector along x and y of its pictures: with detector_ifov_rad they give the field of "
        "view, a rectangle, and half_angle_deg is left out, which is then that of the longer side; null: a square",
    )
    boresight_B: Vector3 = Field(
        (0.0, 0.0, 1.0),
        description="direction in B in which the camera looks, of any length [-]: the spacecraft turns it, not +z, to the "
        "body; x of the picture is B's x made perpendicular to it, or y where it looks along x",
    )
    misalignment_deg: tuple[SmallAngle, SmallAngle, SmallAngle] = Field(
        (0.0, 0.0, 0.0),
        description="rotation vector in the camera's frame by which it is mounted otherwise than the spacecraft knows [deg]",
    )
    gimbal: Gimbal | None = Field(
        None,
        description="what turns the line of sight against the spacecraft; it then takes pictures while the spacecraft holds a "
        "direction, too; null: nothing does",
    )
    exposure_s: float | None = Field(
        None,
        ge=0,
        le=60,
        description="time for which a picture is exposed [s]: the motion of its cells over the detector is then told as motion "
        "blur, and observation.max_motion_blur_px can limit it; null or 0: an instant, no motion blur",
    )
    ground_resolution_m: float | None = Field(
        None,
        ge=1e-6,
        le=1e4,
        description="D, the ground resolution that is required [m]; design.imaging_altitude_m and half_angle_deg, where not "
        "given, then follow by diffraction and by the region's size, and an altitude from which the lens does not resolve D is "
        "refused; null: nothing follows; summary.json tells the ground sampling distance that was reached",
    )
    aperture_m: float = Field(
        CUBESAT_APERTURE_M,
        ge=1e-4,
        le=100,
        description="diameter of the lens [m], for ground_resolution_m and signal to noise; assumed: it fits a 3U "
        "CubeSat's face",
    )
    wavelength_m: float = Field(
        GREEN_LIGHT_M,
        ge=1e-9,
        le=1e-2,
        description="of the light [m], for ground_resolution_m and signal to noise; default: green",
    )
    bandwidth_m: float = Field(
        300e-9,
        gt=0,
        le=1e-5,
        description="width of the band about wavelength_m [m], for signal to noise; assumed: 0.4 to 0.7 um",
    )
    quantum_efficiency: float = Field(
        0.4,
        gt=0,
        le=1,
        description="electrons for each photon that enters the lens, losses in the optics included [-], for signal to noise; "
        "assumed",
    )
    read_noise: float = Field(
        10.0,
        ge=0,
        le=1e6,
        description="of a pixel, electrons rms [-], for signal to noise; assumed: of a CMOS detector",
    )
    detector: Detector = Field(
        default_factory=Detector,
        description=f"what lens and detector add to pictures: {', '.join(INSTRUMENTS)}, or its keys; docs/theory/light.md",
    )

    @model_validator(mode="before")
    @classmethod
    def _detector_gives_the_field_of_view(cls, data: Any) -> Any:
        """Fill half_angle_deg where a detector gives it."""
        try:
            longer = max(data["detector_px"]) * float(data["detector_ifov_rad"])
        except (TypeError, ValueError, KeyError):  # there is none; what is wrong with it the fields tell better
            return data
        return {"half_angle_deg": degrees(atan(0.5 * longer)), **data} if isinstance(data, Mapping) else data

    @model_validator(mode="after")
    def _detector_fits(self) -> Self:
        if self.detector_px is not None:
            if self.detector_ifov_rad is None:
                raise ValueError("detector_px: gives the field of view with detector_ifov_rad; give it")
            half_angle = degrees(atan(0.5 * max(self.detector_px) * self.detector_ifov_rad))
            if abs(half_angle - self.half_angle_deg) > 1e-9 * half_angle:
                raise ValueError(
                    f"half_angle_deg = {self.half_angle_deg:g}: must be left out with detector_px and detector_ifov_rad, which "
                    f"give {half_angle:.9g}"
                )
            if self.shape == "cone":
                raise ValueError("shape = cone: must be square with detector_px, whose field of view is a rectangle")
        if not any(self.boresight_B):
            raise ValueError("boresight_B = [0, 0, 0]: must be a direction")
        if self.gimbal is not None:
            along = sum(a * b for a, b in zip(self.gimbal.axis_B, self.boresight_B, strict=True))
            if abs(along) > 1e-6 * hypot(*self.gimbal.axis_B) * hypot(*self.boresight_B):
                raise ValueError(
                    f"gimbal.axis_B = {list(self.gimbal.axis_B)}: must be perpendicular to boresight_B = "
                    f"{list(self.boresight_B)}"
                )
        return self

    @property
    def sides(self) -> tuple[float, float]:
        """Width and height of the field of view over the longer of the two."""
        if self.detector_px is None:
            return 1.0, 1.0
        return self.detector_px[0] / max(self.detector_px), self.detector_px[1] / max(self.detector_px)

    @property
    def as_the_body(self) -> bool:
        """Whether pictures are taken in the frame B of the spacecraft itself."""
        return (
            self.boresight_B[:2] == (0.0, 0.0)
            and self.boresight_B[2] > 0.0
            and not (self.gimbal or any(self.misalignment_deg))
        )


class Observation(Section):
    """When a target face counts as observed: the observation criterion."""

    observer: Literal["auto", "faceid", "raster", "raycast", "horizon"] = Field(
        "auto",
        description="face-ID buffers by OpenGL, the same by compiled code, ray casting, horizon maps; auto: the first that "
        "this machine can",
    )
    criterion: Literal["passage", "arrival"] = Field(
        "passage", description="count the whole passage inside the imaging region, or only the instant of the arrival"
    )
    interval_s: float = Field(10.0, gt=0, description="time between two images of a spacecraft [s]")
    sequence: Pictures = Field(
        (),
        max_length=MAX_PICTURES,
        description="pictures that are taken, and no others, each at the nearest sample of the telemetry: entries with time, "
        "exposure_s and spacecraft, times alone, or the name of a CSV file with these columns; empty: one every interval_s; "
        "docs/how-to/sequences.md",
    )
    min_fraction: float = Field(
        0.5,
        gt=0,
        le=1,
        description="part of a face (of a cell, where faces are subdivided) that must be seen: of its expected pixels, or "
        "its sample points [-]; from 0.99 on the whole face, judged by geometry with every observer: its three corners in the "
        "field of view and 16 of its points hidden by nothing; counted pixels cannot tell that",
    )
    any_pixel: bool = Field(False, description="let any pixel of a face suffice instead; overstates the area")
    max_emission_deg: float = Field(
        80.0,
        gt=0,
        le=90,
        description="largest angle between face normal and camera [deg]; default: beyond, a face is foreshortened to less than "
        "a fifth and shows nothing that a map could use; 90: any",
    )
    min_pixels: float = Field(
        4.0,
        ge=0,
        description="least pixels, foreshortened, that the target's median face (cell, where faces are subdivided; of polygons "
        "whose sides cut slivers, that above which half of the area lies) would take up where a face is seen [-]; default: two "
        "by two, as what is sampled at less is not resolved (Shannon); 0: any",
    )
    max_range_m: float | None = Field(None, gt=0, description="largest distance between face and camera [m]; null: any")
    max_gsd_m: float | None = Field(
        None, gt=0, description="largest ground sampling distance, obliquity included [m]; null: any"
    )
    max_motion_blur_px: float | None = Field(
        None,
        gt=0,
        description="largest motion of a face over the detector during camera.exposure_s, which must be given [px]; of its "
        "centre, by flyby, spin of the body and rates of the spacecraft; null: any",
    )
    light: Literal["sunlit", "ignored"] = Field(
        "sunlit",
        description="sunlit: a face counts only where the Sun shines on at least half of it, past the body itself, at most "
        "max_incidence_deg from its normal; ignored: night ground counts as well, which tables and reports then say",
    )
    max_incidence_deg: float = Field(
        85.0,
        gt=0,
        le=90,
        description="largest angle between face normal and Sun [deg], where light is not ignored; default: beyond, less than a "
        "tenth of the light is left, and shadows of what is smaller than a face cover it",
    )
    occlusion: bool = Field(True, description="whether the body hides faces behind it; the paper culls and clips only")
    classes: Classes = Field(
        (),
        max_length=16,
        description=f"what else maps a face, beside having been seen: {', '.join(PACKAGED)}, or classes of your own; "
        "docs/how-to/quality_classes.md",
    )

    @property
    def whole(self) -> bool:
        """Whether only whole cells count."""
        return self.min_fraction >= WHOLE_FROM and not self.any_pixel

    @property
    def needs_sun(self) -> bool:
        """Whether the direction to the Sun matters."""
        return self.light == "sunlit"

    @property
    def needs_motion(self) -> bool:
        """Whether it matters how the camera moves."""
        return self.max_motion_blur_px is not None
