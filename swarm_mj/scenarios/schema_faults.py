"""Faults in flight and dispersions of a scenario: what may go wrong, when, and by how much. All of it is off by default.

Each fault is one entry of the list `faults`, told apart by its `kind`. The model behind each number: docs/how-to/faults.md.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self, get_args

from pydantic import Field, model_validator

from swarm_mj.scenarios.section import Section, Vector3

Duration = Annotated[float | None, Field(gt=0, description="after which it is over [s]; null: it lasts")]
Spacecraft = Annotated[
    str,
    Field(
        pattern=r"^(sc[1-9][0-9]{0,5}|all|any)$",
        description="sc1, sc2, ...; all: each by itself, with a chance and a time of its own; any: one drawn at random",
    ),
]
Wheel = Annotated[
    Annotated[int, Field(ge=1, le=4)] | Literal["all", "any"],
    Field(description="number of the wheel, from 1; all of them; any: one drawn at random"),
]
Detection = Annotated[
    float, Field(ge=0, description="after which the flight software or the swarm knows and reacts [s]")
]
Speed = Annotated[float, Field(ge=-1e4, le=1e4)]


class Timed(Section):
    """What all faults share: whether they happen."""

    probability: float = Field(1.0, ge=0, le=1, description="with which it happens [-], for each spacecraft by itself")


class InFlight(Timed):
    """When a fault happens: at a given time, or at a random one."""

    at_s: float | None = Field(None, ge=0, description="time past the epoch [s]; null: random")
    between_s: tuple[float, float] | None = Field(
        None, description="a random time is uniform between these [s]; null: over the whole flight"
    )

    @model_validator(mode="after")
    def _one_time(self) -> Self:
        if self.between_s is not None:
            if self.at_s is not None:
                raise ValueError(f"at_s = {self.at_s:g}: give at_s or between_s, not both")
            if not 0 <= self.between_s[0] <= self.between_s[1]:
                raise ValueError(
                    f"between_s = {list(self.between_s)}: must be two times, not negative, the earlier first"
                )
        return self


class SpacecraftFault(InFlight):
    """A fault of a spacecraft."""

    spacecraft: Spacecraft


class TemporaryFault(SpacecraftFault):
    """A fault of a spacecraft that may be over after a while."""

    duration_s: Duration = None


class SpacecraftLost(SpacecraftFault):
    """A spacecraft falls silent: no torque, no picture, no radio; it drifts on."""

    kind: Literal["spacecraft_lost"]
    detection_s: Detection = 0.0


class CommunicationsLost(InFlight):
    """The spacecraft that relays to Earth at that time is lost; if there is none yet, the first one that does."""

    kind: Literal["communications_lost"]
    detection_s: Detection = 0.0


class CameraOff(TemporaryFault):
    """A camera takes no pictures."""

    kind: Literal["camera_off"]


class WheelLost(SpacecraftFault):
    """A wheel's motor gives no torque any more; the wheel coasts."""

    kind: Literal["wheel_lost"]
    wheel: Wheel
    detection_s: Detection = 0.0


class WheelStuck(SpacecraftFault):
    """A wheel stays at one speed relative to the hub, whatever it is told."""

    kind: Literal["wheel_stuck"]
    wheel: Wheel
    speed_rpm: float | None = Field(
        None, ge=-1e6, le=1e6, description="speed at which it sticks [rpm]; null: the present one"
    )
    detection_s: Detection = 0.0


class WheelWeakened(TemporaryFault):
    """A wheel gives only a part of the torque that it is told to give."""

    kind: Literal["wheel_weakened"]
    wheel: Wheel
    factor: float = Field(0.5, ge=0, le=1, description="part of the torque that is left [-]")


class WheelFriction(TemporaryFault):
    """The bearing of a wheel rubs."""

    kind: Literal["wheel_friction"]
    wheel: Wheel
    coulomb_n_m: float = Field(
        2e-4, ge=0, le=1, description="Coulomb friction [N m]; default: 5 % of the torque of the default wheel"
    )
    viscous_n_m_s: float = Field(
        1e-6,
        ge=0,
        le=1,
        description="viscous friction [N m s/rad]; default: 16 % of the torque of the default wheel at its top speed",
    )


class GyroNoise(TemporaryFault):
    """A gyro becomes noisy; the attitude filter is not told."""

    kind: Literal["gyro_noise"]
    angular_random_walk_deg_sqrt_h: float = Field(
        1.5, ge=0, le=1e3, description="noise of the rate [deg/sqrt(h)]; ten times that of a good MEMS gyro"
    )


class GyroBias(TemporaryFault):
    """A gyro's bias jumps."""

    kind: Literal["gyro_bias"]
    bias_deg_h: Vector3 = Field((30.0, 30.0, 30.0), description="added about x, y, z of B [deg/h]")


class GyroDropout(TemporaryFault):
    """A gyro says nothing; rates come from differences of star tracker attitudes."""

    kind: Literal["gyro_dropout"]
    duration_s: Duration = 60.0


class StarTrackerNoise(TemporaryFault):
    """A star tracker becomes noisy; the attitude filter is not told."""

    kind: Literal["star_tracker_noise"]
    sigma_arcsec: float = Field(100.0, ge=0, le=36_000, description="1 sigma about each axis [arcsec]")


class StarTrackerBias(TemporaryFault):
    """A star tracker's mounting shifts."""

    kind: Literal["star_tracker_bias"]
    bias_arcsec: Vector3 = Field((60.0, 60.0, 60.0), description="rotation added about x, y, z of B [arcsec]")


class StarTrackerDropout(TemporaryFault):
    """A star tracker says nothing (blinded by Sun or body); the gyro carries the attitude on."""

    kind: Literal["star_tracker_dropout"]
    duration_s: Duration = 60.0


class SensorDelay(TemporaryFault):
    """Attitude and rate reach the controller late."""

    kind: Literal["sensor_delay"]
    delay_s: float = Field(0.5, gt=0, le=60, description="how late [s], rounded to whole control periods")


class MissedDeployment(Timed):
    """A spacecraft stays in its deployer and flies on with the mothership."""

    kind: Literal["missed_deployment"]
    spacecraft: Spacecraft


class DeploymentVelocity(Timed):
    """A deployer gives the wrong velocity."""

    kind: Literal["deployment_velocity"]
    spacecraft: Spacecraft
    factor: float = Field(
        1.0, ge=0, le=10, description="of the velocity relative to the mothership [-]; below 1: a weak spring"
    )
    error_m_s: tuple[Speed, Speed, Speed] = Field((0.0, 0.0, 0.0), description="velocity added, in N [m/s]")


Fault = Annotated[
    SpacecraftLost
    | CommunicationsLost
    | CameraOff
    | WheelLost
    | WheelStuck
    | WheelWeakened
    | WheelFriction
    | GyroNoise
    | GyroBias
    | GyroDropout
    | StarTrackerNoise
    | StarTrackerBias
    | StarTrackerDropout
    | SensorDelay
    | MissedDeployment
    | DeploymentVelocity,
    Field(discriminator="kind"),
]


#: Every kind of fault and its parameters.
FAULT_KINDS: dict[str, type[Section]] = {
    get_args(fault.model_fields["kind"].annotation)[0]: fault for fault in get_args(get_args(Fault)[0])
}


class Dispersions(Section):
    """How far truth lies from what the mission was planned with; zero switches each off. Drawn from the scenario's seed."""

    attitude_deg: float = Field(
        0.0, ge=0, le=180, description="1 sigma of an extra initial rotation about each axis of B [deg]"
    )
    rate_deg_s: float = Field(0.0, ge=0, le=60, description="1 sigma of each initial body rate, added [deg/s]")
    deployment_velocity_m_s: float = Field(0.0, ge=0, le=100, description="1 sigma of each component in N [m/s]")
    mothership_position_m: float = Field(
        0.0, ge=0, le=1e9, description="1 sigma of each component in N at the epoch [m]; all spacecraft share the error"
    )
    mothership_velocity_m_s: float = Field(
        0.0,
        ge=0,
        le=1e4,
        description="1 sigma of each component in N at the epoch [m/s]; all spacecraft share the error",
    )
    burn_magnitude_percent: float = Field(
        0.0, ge=0, le=30, description="1 sigma of a correction's size, as a share of it; drawn for each burn"
    )
    burn_pointing_deg: float = Field(
        0.0,
        ge=0,
        le=30,
        description="1 sigma of a correction's direction about each axis across it [deg]; for each burn",
    )
    mass_percent: float = Field(
        0.0, ge=0, le=10, description="1 sigma of the mass, cut at 3 sigma; inertia grows with it"
    )
    inertia_percent: float = Field(
        0.0, ge=0, le=10, description="1 sigma of each second moment of the mass (int x^2 dm, ...), cut at 3 sigma"
    )
    wheel_coulomb_n_m: float = Field(
        0.0, ge=0, le=1, description="each wheel's Coulomb friction is uniform from 0 to this [N m]"
    )
    wheel_viscous_n_m_s: float = Field(
        0.0, ge=0, le=1, description="each wheel's viscous friction is uniform from 0 to this [N m s/rad]"
    )
    gravity_percent: float = Field(0.0, ge=0, le=30, description="1 sigma of the field as a whole (GM), cut at 3 sigma")
    harmonics_percent: float = Field(
        0.0, ge=0, le=100, description="1 sigma of each coefficient C_nm, S_nm of n >= 1 of a field in harmonics"
    )
    target_m: float = Field(
        0.0, ge=0, le=1e6, description="1 sigma of the target's true place east and north of the planned one [m]"
    )
