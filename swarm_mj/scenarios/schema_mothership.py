"""The mothership: where it comes from, and what its deployer can do; or spacecraft that are on their way without one."""

from __future__ import annotations

from math import acos, cos, degrees, hypot, radians, sin, sqrt
from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from swarm_mj.io.times import SECOND, epoch_of, tdb_date
from swarm_mj.scenarios.section import AXES, Axes, Section, Vector3

#: Keys that say where it comes from instead of position and velocity.
WAYS = ("approach", "elements", "ephemeris")
#: Keys of files that hold a path.
FILES = ("oem", "spk", "horizons")
_GM = "of the two-body orbit that gives the state at the epoch [m^3/s^2]; null: the gravity field's own"


class PhaseGeometry(Section):
    """A flyby by its phase angles (Sun, body, spacecraft), as encounters are published: a straight line past the body.

    With unit vectors s to the Sun, v along the asymptote, b to the closest approach and n = v x b,
    s = cos e (-cos B v + sin B b) + sin e n: the phase is acos(cos e cos B) on the approach, acos(cos e sin B) at the closest
    approach, and its least value in the passage is |e| where B is above 0.
    """

    approach_deg: float = Field(ge=0, le=180, description="on the incoming asymptote [deg]")
    least_deg: float | None = Field(
        None,
        ge=-90,
        le=90,
        description="e, least phase of a passage that leads before the Sun's side of the body, by its sign on which side of "
        "the flyby's plane the Sun stands [deg]; null: by closest_deg",
    )
    closest_deg: float | None = Field(
        None, ge=0, le=180, description="at the closest approach [deg]; null: by least_deg"
    )
    clock_deg: float = Field(
        0.0,
        ge=-360,
        le=360,
        description="of the direction from which the spacecraft comes, about that to the Sun, from ecliptic north towards the "
        "cross product of the Sun's direction and north [deg]: phases leave it open",
    )

    @model_validator(mode="after")
    def _phases_are_those_of_a_line(self) -> Self:
        if (self.least_deg is None) == (self.closest_deg is None):
            raise ValueError("least_deg, closest_deg: give exactly one of them")
        along = cos(radians(self.approach_deg))
        if self.least_deg is not None and abs(along) > cos(radians(self.least_deg)):
            most = min(self.approach_deg, 180.0 - self.approach_deg)
            raise ValueError(
                f"least_deg = {self.least_deg:g}: must be from {-most:g} to {most:g} with approach_deg = {self.approach_deg:g}"
            )
        if self.closest_deg is not None and hypot(along, cos(radians(self.closest_deg))) > 1.0:
            least = degrees(acos(sqrt(1.0 - along**2)))
            raise ValueError(
                f"closest_deg = {self.closest_deg:g}: must be from {least:g} to {180.0 - least:g} with approach_deg = "
                f"{self.approach_deg:g}"
            )
        return self

    @property
    def sun(self) -> tuple[float, float, float]:
        """Components of the direction to the Sun along -v, b and n."""
        against = cos(radians(self.approach_deg))
        if self.closest_deg is not None:
            closest = cos(radians(self.closest_deg))
            return against, closest, sqrt(max(0.0, 1.0 - against**2 - closest**2))
        assert self.least_deg is not None  # one of both is given
        beside = sin(radians(self.least_deg))
        return against, sqrt(max(0.0, 1.0 - against**2 - beside**2)), beside


class Approach(Section):
    """A hyperbola past the body: velocity at infinity, B-plane and time of closest approach; or its phase angles."""

    v_infinity_m_s: float = Field(gt=0, le=1e5, description="speed on the incoming asymptote [m/s]")
    longitude_deg: float | None = Field(
        None,
        ge=-360,
        le=360,
        description="of the direction in which it comes in [deg]; null, as the next four: by phase",
    )
    latitude_deg: float | None = Field(None, ge=-90, le=90, description="of that direction [deg]")
    axes: Axes = Field("ecliptic", description=f"of the two angles, and whose z is the pole of the B-plane; {AXES}")
    b_t_m: float | None = Field(
        None,
        ge=-1e12,
        le=1e12,
        description="B.T: of the vector from the body's centre to the asymptote, along T = S x pole, where S is the direction "
        "of the asymptote [m]",
    )
    b_r_m: float | None = Field(None, ge=-1e12, le=1e12, description="B.R: the same along R = S x T [m]")
    distance_m: float | None = Field(
        None, gt=0, le=1e12, description="closest distance from the body's centre, with phase [m]"
    )
    phase: PhaseGeometry | None = Field(
        None, description="phase angles, in place of longitude_deg, latitude_deg, b_t_m and b_r_m; null: by these"
    )
    closest_approach_s: float | None = Field(
        None,
        ge=-3e7,
        le=3e7,
        description="time past the epoch of the two-body orbit's closest approach [s]; null: by closest_approach",
    )
    closest_approach: str | None = Field(
        None, description="date and time of it, as epoch is given; null: by closest_approach_s"
    )
    gm_m3_s2: float | None = Field(None, ge=0, le=1e22, description=f"{_GM}; 0: a straight line")

    @field_validator("closest_approach", mode="before")
    @classmethod
    def _closest_approach_is_a_date(cls, value: Any) -> str | None:
        return None if value is None else tdb_date(value)

    @model_validator(mode="after")
    def _said_in_one_way(self) -> Self:
        if (self.closest_approach_s is None) == (self.closest_approach is None):
            raise ValueError("closest_approach_s, closest_approach: give exactly one of them")
        plane, by_phase = ("longitude_deg", "latitude_deg", "b_t_m", "b_r_m"), ("distance_m", "phase")
        given = {key for key in (*plane, *by_phase) if getattr(self, key) is not None}
        if given not in (set(plane), set(by_phase)):
            raise ValueError(
                f"{', '.join(sorted(given)) or 'nothing'}: must be {', '.join(plane)}, or {' and '.join(by_phase)}"
            )
        return self

    def closest_after(self, epoch: str) -> float:
        """When the closest approach is past an epoch in TDB [s]."""
        if self.closest_approach is None:
            assert self.closest_approach_s is not None  # one of both is given
            return self.closest_approach_s
        return (epoch_of(self.closest_approach) - epoch_of(epoch)) / SECOND

    @property
    def miss_m(self) -> float:
        """Distance at which it passes, on a straight line [m]."""
        return self.distance_m or hypot(self.b_t_m or 0.0, self.b_r_m or 0.0)


class OrbitalState(Section):
    """Keplerian elements of the mothership's orbit about the body, at the epoch."""

    semi_major_axis_m: float | None = Field(
        None, ge=-1e12, le=1e12, description="below 0 for a hyperbola [m]; null: by periapsis_radius_m"
    )
    periapsis_radius_m: float | None = Field(
        None, gt=0, le=1e12, description="least distance from the centre [m]; null: by semi_major_axis_m"
    )
    eccentricity: float = Field(ge=0, le=1e12, description="below 1 an ellipse, above 1 a hyperbola [-]")
    inclination_deg: float = Field(ge=0, le=180, description="to the plane x, y of the axes [deg]")
    node_deg: float = Field(0.0, ge=-360, le=360, description="longitude of the ascending node [deg]")
    argument_of_periapsis_deg: float = Field(0.0, ge=-360, le=360, description="from the node [deg]")
    true_anomaly_deg: float | None = Field(
        None, ge=-360, le=360, description="at the epoch [deg]; null: by mean_anomaly_deg"
    )
    mean_anomaly_deg: float | None = Field(
        None,
        ge=-1e9,
        le=1e9,
        description="at the epoch [deg], of a hyperbola e sinh H - H; null: by true_anomaly_deg",
    )
    axes: Axes = Field("ecliptic", description=f"of the angles; {AXES}")
    gm_m3_s2: float | None = Field(None, gt=0, le=1e22, description=_GM)

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        for pair in (("semi_major_axis_m", "periapsis_radius_m"), ("true_anomaly_deg", "mean_anomaly_deg")):
            given = [key for key in pair if getattr(self, key) is not None]
            if len(given) != 1:
                raise ValueError(f"{pair[0]}, {pair[1]}: give exactly one of them, not {' and '.join(given) or 'none'}")
        a, e = self.semi_major_axis_m, self.eccentricity
        if a is not None and not a * (1.0 - e) > 0.0:
            raise ValueError(
                f"semi_major_axis_m = {a:g}: must be above 0 with an eccentricity below 1, and below 0 with one above 1, not "
                f"{e:g}; a parabola is given by periapsis_radius_m"
            )
        if e == 1.0 and self.mean_anomaly_deg is not None:
            raise ValueError("mean_anomaly_deg: a parabola (eccentricity = 1) has none; give true_anomaly_deg")
        return self


class PathOfFile(Section):
    """A path by a file of another program."""

    oem: str | None = Field(
        None,
        description="path of a CCSDS OEM in KVN relative to the body's centre, relative to the scenario's file; null: by "
        "another file",
    )
    spk: str | None = Field(
        None,
        description="path of a SPICE SPK (extra `spice`), relative to the scenario's file, loaded after "
        "ephemerides.kernels; null: by another file",
    )
    horizons: str | None = Field(
        None,
        description="path of a table of vectors as JPL Horizons writes it, relative to the scenario's file: ephemeris type "
        "VECTORS, of the spacecraft, its centre the body; null: by another file",
    )
    target: str | None = Field(
        None, max_length=36, description="SPICE's name or number of the spacecraft in the SPK; null with other files"
    )

    @model_validator(mode="after")
    def _one_file(self) -> Self:
        if sum(getattr(self, key) is not None for key in FILES) != 1:
            raise ValueError(f"{', '.join(FILES)}: give exactly one of them")
        if (self.spk is None) != (self.target is None):
            raise ValueError(
                f"target = {self.target}: only an SPK holds several spacecraft; leave it out"
                if self.spk is None
                else "target: an SPK needs the name or number of the spacecraft in it"
            )
        return self


class Deployer(Section):
    """What the mothership's deployer can do.

    Springs of flown deployers give up to 2 m/s: P-POD Mk. III 1.5 to 2.0 m/s (Cal Poly, User Guide Rev. E), J-SSOD 1.1 to
    1.7 m/s (JAXA, JX-ESPC-101133), NRCSD 0.5 to 2.0 m/s (NanoRacks, NR-NRCSD-S0003), as compiled in cubesat-specs 0.2.
    """

    max_speed_m_s: float | None = Field(
        2.0,
        ge=1e-4,
        description="largest speed relative to the mothership that it gives a spacecraft [m/s], by default that of springs of "
        "flown deployers; null: any. Where spacecraft have thrusters, an insertion burn gives what is missing",
    )
    beyond_max_speed: Literal["told", "refused"] = Field(
        "told",
        description="what becomes of a release beyond that speed that no insertion burn makes up for: told: it is flown as if "
        "the deployer could, and a finding says so; a design avoids it where as few spacecraft do without. refused: the plan "
        "is an error, and a design leaves it out",
    )
    insertion_after_s: float = Field(
        120.0,
        ge=0,
        le=1e7,
        description="from the release to the start of that burn [s]; by default a spacecraft has stopped tumbling and turned, "
        "and at 1 m/s is 120 m from the mothership, out of reach of its gas",
    )
    cone_axis_N: Vector3 | Literal["velocity"] | None = Field(
        None,
        description="axis of the cone into which it can push: three components in N [-], or 'velocity', along the mothership's "
        "inertial velocity at the release; null: any direction",
    )
    cone_half_angle_deg: float = Field(180.0, gt=0, le=180, description="of that cone about its axis [deg]")
    spacing_s: float | None = Field(
        None, gt=0, description="least time between two releases [s]; null: any number may leave at once"
    )

    @model_validator(mode="after")
    def _axis_is_a_direction(self) -> Self:
        if isinstance(self.cone_axis_N, tuple) and not any(self.cone_axis_N):
            raise ValueError("cone_axis_N = [0, 0, 0]: must be a direction, or null for any")
        return self


class Mothership(Section):
    """Where the swarm is deployed from: by position and velocity, or by one of approach, elements and ephemeris."""

    position_A_m: Vector3 = Field(
        (0.0, 0.0, -30_000.0), description="position in the body-fixed frame at the epoch [m]"
    )
    velocity: Literal["mean", "rest"] | Vector3 = Field(
        "mean",
        description="inertial velocity: 'mean' of the deployed velocities (then a CubeSat needs about 10 m/s at most), 'rest', "
        "or three components in N [m/s]",
    )
    deployer: Deployer = Field(default_factory=Deployer)
    approach: Approach | None = Field(
        None,
        description="a hyperbola by v_infinity, B-plane and time of closest approach, instead of position and velocity",
    )
    elements: OrbitalState | None = Field(
        None, description="Keplerian elements about the body, instead of position and velocity"
    )
    ephemeris: PathOfFile | None = Field(None, description="an OEM or SPK file, instead of position and velocity")

    @model_validator(mode="after")
    def _comes_one_way(self) -> Self:
        given = [key for key in WAYS if getattr(self, key) is not None]
        if given:
            # What was read back from a record gives all keys: their defaults say nothing.
            given += [k for k in ("position_A_m", "velocity") if getattr(self, k) != type(self).model_fields[k].default]
        if len(given) > 1:
            raise ValueError(
                f"{', '.join(given)}: say in one way only where the mothership comes from; leave out the others, or give all "
                "keys of mothership anew"
            )
        return self

    @property
    def way(self) -> str:
        """Key by which it comes: position_A_m, approach, elements or ephemeris."""
        return next((key for key in WAYS if getattr(self, key) is not None), "position_A_m")


class Cartesian(Section):
    """Position and velocity relative to the body's centre, at the epoch."""

    position_m: Vector3 = Field(description="along the axes [m]")
    velocity_m_s: Vector3 = Field(description="along the axes [m/s]")
    axes: Axes = Field("ecliptic", description=f"of both; {AXES}")


class KnownState(Section):
    """How a spacecraft comes that is on its way already: by exactly one of approach, elements, ephemeris and state."""

    approach: Approach | None = Field(None, description="a hyperbola, as of the mothership")
    elements: OrbitalState | None = Field(None, description="Keplerian elements about the body")
    ephemeris: PathOfFile | None = Field(None, description="an OEM, an SPK or a table of JPL Horizons")
    state: Cartesian | None = Field(None, description="position and velocity at the epoch")
    arrival_s: float | None = Field(
        None,
        gt=0,
        le=30 * 86_400.0,
        description="time past the epoch that counts as its arrival, brought to the next sample of the telemetry [s]; null: "
        "the closest approach of approach; must be given without one",
    )

    @model_validator(mode="after")
    def _comes_one_way(self) -> Self:
        if len(given := [key for key in (*WAYS, "state") if getattr(self, key) is not None]) != 1:
            raise ValueError(
                f"approach, elements, ephemeris, state: give exactly one of them, not {' and '.join(given) or 'none'}"
            )
        if self.arrival_s is None and self.approach is None:
            raise ValueError(
                f"arrival_s: must be given with {given[0]}: when it is nearest to the body, past the epoch [s]"
            )
        return self
