"""The small body of a scenario: shape, gravity, rotation, heliocentric orbit, and what perturbs flights past it."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, field_validator, model_validator

from swarm_mj.scenarios import constants
from swarm_mj.scenarios.bodies import PACKAGED_SHAPES, expanded_body, packaged_bodies
from swarm_mj.scenarios.schema_photometry import SETS, Photometry
from swarm_mj.scenarios.section import AXES, YOUR_OWN, Axes, Parameters, Section

SemiAxis = Annotated[float, Field(gt=0, le=2e6)]


class GravityModel(Section):
    """Which gravity field acts, by plug-in name."""

    model: str = Field(
        "spherical_harmonics",
        description=f"plug-in: spherical_harmonics, point_mass, polyhedron or {YOUR_OWN}",
    )
    parameters: Parameters = Field(
        default_factory=dict,
        description="arguments of the plug-in, e.g. gm [m^3/s^2]; empty: the measured NEAR15A field of Eros",
    )


class RotationState(Section):
    """Pole and spin of the body (defaults: 433 Eros, label of PDS NEAR-A-5-COLLECTED-MODELS-V1.0)."""

    pole_ra_deg: float = Field(
        constants.EROS_POLE_RA_DEG,
        ge=-360,
        le=360,
        description="right ascension of the pole, J2000 equatorial [deg]",
    )
    pole_dec_deg: float = Field(constants.EROS_POLE_DEC_DEG, ge=-90, le=90, description="declination of the pole [deg]")
    w0_deg: float = Field(constants.EROS_W0_DEG, ge=-360, le=360, description="prime meridian angle at J2000 [deg]")
    w_rate_deg_per_day: float = Field(
        constants.EROS_W_RATE_DEG_PER_DAY, ge=-1e6, le=1e6, description="rotation rate [deg/day]"
    )


class HeliocentricOrbit(Section):
    """Keplerian elements in the ecliptic J2000 frame (default: 433 Eros, JPL Horizons, epoch 2019-05-02)."""

    semi_major_axis_au: float = Field(1.458114857699829, ge=0.01, le=1e4, description="semi-major axis [au]")
    eccentricity: float = Field(0.2227354414120954, ge=0, lt=1, description="eccentricity [-]; closed orbits only")
    inclination_deg: float = Field(10.82855904976882, ge=0, le=180, description="inclination to the ecliptic [deg]")
    node_deg: float = Field(304.3061397028930, ge=-360, le=360, description="longitude of the ascending node [deg]")
    argument_of_perihelion_deg: float = Field(
        178.8220606936718, ge=-360, le=360, description="argument of perihelion [deg]"
    )
    perihelion_jd: float = Field(
        2458516.111275572, ge=1e6, le=4e6, description="Julian date of perihelion passage (TDB)"
    )


class Body(Section):
    """The small body: shape, gravity, rotation and heliocentric orbit."""

    name: str = Field("433 Eros", description="of the body, for figures and reports")
    shape: str = Field(
        "eros",
        description=f"{', '.join(PACKAGED_SHAPES)} (the last with semi_axes_m), or the path of an OBJ, PLY, STL, PDS .tab or "
        "SPICE .bds file",
    )
    semi_axes_m: tuple[SemiAxis, SemiAxis, SemiAxis] | None = Field(
        None, description="of the shape 'ellipsoid', along x, y and z of A [m]; null for all other shapes"
    )
    shape_unit: Literal["m", "km"] | None = Field(
        None,
        description="unit of the vertices in the file; null: metres, but kilometres for .tab and .bds; refused where gm of "
        "body.gravity.parameters speaks for the other one, or, without gm, where both make a body of believable size",
    )
    radius_range_m: tuple[float, float] = Field(
        (50.0, 2.0e6),
        description="between which the largest vertex radius is believed [m]; guards against kilometres taken for metres",
    )
    albedo: float | None = Field(
        None,
        gt=0,
        le=1,
        description="brightness of the surface under the Sun in its zenith, over that of a white Lambert surface [-], for "
        "signal to noise and pictures where photometry says nothing; a geometric albedo makes a sphere a third too dark at "
        "phase 0 and, as small bodies dim faster than Lambert's law, too bright beyond some 15 deg; null: not known",
    )
    photometry: Photometry | None = Field(
        None,
        description=f"how the surface reflects light: a published set ({', '.join(SETS)}) or a law and its numbers; null: the "
        "set of the packaged shape, else Lambert's law with albedo",
    )
    face_albedo: str | None = Field(
        None,
        description="path of a text file with a number for each face of the mesh, by which its reflectance is multiplied [-]; "
        "null: all faces alike",
    )
    gravity: GravityModel = Field(default_factory=GravityModel)
    rotation: RotationState = Field(default_factory=RotationState)
    orbit: HeliocentricOrbit = Field(default_factory=HeliocentricOrbit)

    @property
    def reflectance(self) -> Photometry | None:
        """How the surface reflects light; None: nobody says."""
        if self.photometry is not None:
            return self.photometry
        if self.albedo is not None:
            return Photometry(law="lambert", albedo=self.albedo)
        return Photometry(**SETS[self.shape]) if self.shape in SETS else None

    @model_validator(mode="after")
    def _axes_are_those_of_an_ellipsoid(self) -> Self:
        if (self.shape == "ellipsoid") != (self.semi_axes_m is not None):
            raise ValueError(
                f"shape = {self.shape}, semi_axes_m = {self.semi_axes_m}: the shape 'ellipsoid' needs semi_axes_m, "
                "three lengths in metres, and no other shape takes them"
            )
        return self

    @field_validator("radius_range_m")
    @classmethod
    def _range_is_one(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not 0 < value[0] < value[1]:
            raise ValueError(f"= {list(value)}: must be two positive numbers, the smaller one first")
        return value


class MutualOrbit(Section):
    """Keplerian elements of the companion's path relative to the body's centre, at the epoch."""

    semi_major_axis_m: float = Field(gt=0, le=1e9, description="of the ellipse [m]")
    eccentricity: float = Field(0.0, ge=0, lt=1, description="of the ellipse [-]")
    inclination_deg: float = Field(0.0, ge=0, le=180, description="to the plane x, y of the axes [deg]")
    node_deg: float = Field(0.0, ge=-360, le=360, description="longitude of the ascending node [deg]")
    argument_of_periapsis_deg: float = Field(0.0, ge=-360, le=360, description="from the node [deg]")
    mean_anomaly_deg: float = Field(0.0, ge=-1e6, le=1e6, description="at the epoch [deg]")
    axes: Axes = Field("ecliptic", description=f"of the angles; {AXES}")
    period_s: float | None = Field(
        None, gt=0, le=1e10, description="of a revolution [s]; null: by the sum of both gravitational parameters"
    )


class MutualPath(Section):
    """The companion's path by a SPICE kernel of the user's, sampled over the flight."""

    spk: str = Field(
        description="path of an SPK that holds both bodies (extra `spice`), relative to the scenario's file"
    )
    target: str = Field(max_length=36, description="SPICE's name or number of the companion in it")
    body: str | None = Field(None, max_length=36, description="of the body; null: by body.name")


class Companion(Section):
    """One more body, as of a binary asteroid, that pulls, is hit, hides and shades; docs/how-to/binaries.md."""

    body: Annotated[Body, BeforeValidator(expanded_body, json_schema_input_type=Body | str)] = Field(
        description=f"its keys, or the name of a packaged body: {', '.join(packaged_bodies())}; its orbit plays no part"
    )
    orbit: MutualOrbit | None = Field(None, description="its path relative to the body's centre; null: by ephemeris")
    ephemeris: MutualPath | None = Field(None, description="its path by a file; null: by orbit")
    rotation: Literal["own", "locked"] = Field(
        "own", description="own: by its body.rotation; locked: its +x towards the body, z along the orbit's normal"
    )
    body_rotation: Literal["own", "locked"] = Field(
        "own",
        description="of the scenario's body; own: by body.rotation; locked: its +x towards the companion, z along the "
        "normal of an orbit that must be circular",
    )

    @model_validator(mode="after")
    def _has_one_path(self) -> Self:
        if (self.orbit is None) == (self.ephemeris is None):
            raise ValueError("orbit, ephemeris: give exactly one of them")
        if self.body_rotation == "locked" and (self.orbit is None or self.orbit.eccentricity > 0.0):
            raise ValueError(
                "body_rotation = locked: needs companion.orbit with eccentricity = 0, for the body turns uniformly; give "
                "body.rotation and body_rotation: own"
            )
        return self


class Ephemerides(Section):
    """SPICE kernels of the user's instead of body.orbit and body.rotation; they need the extra `spice`."""

    kernels: tuple[str, ...] = Field(
        (),
        max_length=100,
        description="SPK, PCK, FK, ... or a meta-kernel, loaded in this order, relative to the scenario's file; empty: none, "
        "the built-in orbits and body.rotation",
    )
    body: str | None = Field(
        None, max_length=36, description="SPICE's name or number of the body; null: by body.name, 433 Eros is 2000433"
    )
    frame: str | None = Field(
        None,
        max_length=32,
        description="SPICE's name of the body-fixed frame A; null: the body's own, such as IAU_EROS",
    )
    positions: bool = Field(True, description="whether Sun and Earth stand where the kernels say")
    rotation: bool = Field(True, description="whether the body turns as the kernels say")


class Perturbations(Section):
    """Optional perturbations; all off, as in the paper."""

    solar_tide: bool = Field(False, description="third-body tide of the Sun")
    solar_radiation_pressure: bool = Field(False, description="cannonball model, without eclipses")
    gravity_gradient_torque: bool = Field(False, description="torque of the body's central field")
    srp_area_m2: float = Field(0.034, gt=0, description="sunlit area [m^2]; default: the 0.1 m x 0.34 m side")
    srp_reflectivity: float = Field(1.3, ge=1, le=2, description="coefficient C_R [-]: 1 absorbs, 2 mirrors")
