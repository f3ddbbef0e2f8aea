"""Sections of a scenario about pictures: the camera, and what counts in them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from swarm_mj.scenarios.constants import CUBESAT_APERTURE_M, GREEN_LIGHT_M
from swarm_mj.scenarios.schema_quality import PACKAGED, Classes
from swarm_mj.scenarios.section import Section

#: Least `observation.min_fraction` by which whole cells are meant: counts of pixels do not tell 99 % of a cell from all of it.
WHOLE_FROM = 0.99


class Camera(Section):
    """The camera along +z."""

    half_angle_deg: float = Field(
        21.5, gt=0, lt=90, description="to the sides of a square field of view, or of the cone [deg]"
    )
    shape: Literal["square", "cone"] = Field("square", description="of the field of view")
    resolution_px: int = Field(512, ge=16, le=8192, description="pixels along one side")
    detector_ifov_rad: float | None = Field(
        None,
        gt=0,
        description="angle of one pixel of the real detector, for the ground sampling distance [rad]; null: the picture's",
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
