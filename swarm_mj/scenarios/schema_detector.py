"""What the camera's lens and detector add to a picture, number by number or by the name of a published instrument."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from swarm_mj.scenarios.section import Section, named

Coefficient = Annotated[float, Field(ge=-10, le=10)]


class Detector(Section):
    """Lens and detector; aperture, band, quantum efficiency and read noise are keys of the camera."""

    distortion: tuple[Coefficient, Coefficient, Coefficient, Coefficient, Coefficient] = Field(
        (0.0, 0.0, 0.0, 0.0, 0.0),
        description="Brown's k1, k2, p1, p2, k3 for image points at unit distance [-]; zero: straight lines stay straight",
    )
    psf_sigma_px: float = Field(
        0.5,
        ge=0,
        le=10,
        description="standard deviation of the point spread, a Gaussian, without the pixel's own width [px]; default: most of "
        "the light of a star falls on two by two pixels, as lenses are matched to detectors",
    )
    dark_e_s: float = Field(
        10.0, ge=0, le=1e6, description="dark current of a pixel [electrons/s]; assumed: CMOS near 0 deg C"
    )
    full_well_e: float = Field(
        20_000.0, ge=10, le=1e7, description="electrons that a pixel holds [-]; assumed: CMOS with pixels of 5 um"
    )
    bits: int = Field(12, ge=1, le=16, description="of the converter, whose last step is the full well")
    bias_dn: int = Field(
        64, ge=0, le=60_000, description="count of a pixel without light [DN], so that noise below zero is not cut off"
    )
    hot_share: float = Field(1e-4, ge=0, le=0.1, description="share of pixels that are hot [-]; assumed")
    hot_e_s: float = Field(
        2_000.0, ge=0, le=1e7, description="mean dark current of those, exponential [electrons/s]; assumed"
    )
    exposure_share: float = Field(
        0.6,
        gt=0,
        le=1,
        description="automatic exposure, where camera.exposure_s is null: the brightest pixels fill this share of the full "
        "well [-]",
    )
    exposure_range_s: tuple[float, float] = Field(
        (1e-9, 10.0),
        description="shortest and longest automatic exposure [s]; assumed: a stop or a filter before a wide lens counts as a "
        "shorter exposure",
    )

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, given: Any) -> Any:
        return named(given, INSTRUMENTS, cls) if isinstance(given, str) else given

    @model_validator(mode="after")
    def _fits(self) -> Detector:
        if not 0.0 < self.exposure_range_s[0] <= self.exposure_range_s[1] <= 60.0:
            raise ValueError(
                f"exposure_range_s = {list(self.exposure_range_s)}: must be two times, above 0 and at most 60 s, shorter first"
            )
        if self.bias_dn >= 2**self.bits - 1:
            raise ValueError(f"bias_dn = {self.bias_dn}: must be below the largest count, {2**self.bits - 1}")
        return self


#: Detectors of instruments that flew, as far as their papers give numbers; what they do not give is the default.
INSTRUMENTS: dict[str, dict[str, Any]] = {
    "ideal": {"psf_sigma_px": 0.0, "dark_e_s": 0.0, "hot_share": 0.0, "bits": 16, "bias_dn": 0, "full_well_e": 1e6},
    "cubesat": {},
    # Ishiguro et al. 2010, Icarus 207, 714: AMICA of Hayabusa; 12 bit, 17 electrons a count.
    "amica": {"bits": 12, "full_well_e": 70_000.0},
    # Schroeder et al. 2013, Icarus 226, 1304: framing cameras of Dawn; 14 bit, 17.7 electrons a count.
    "dawn-fc": {"bits": 14, "full_well_e": 290_000.0},
}
