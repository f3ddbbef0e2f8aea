"""Attitude sensors: what a spacecraft's gyro and star tracker err by, number by number or by the name of a class.

The class `cubesat` is a MEMS gyro as the Sensonor STIM300 (data sheet TS1524: 0.15 deg/sqrt(h), bias instability 0.3 to
0.5 deg/h) and a nano star tracker as the Blue Canyon NST (6 arcsec across its axis, 40 about it). With them attitudes are known
to 12 arcsec about each axis, besides the mounting error; the CubeSat MinXSS-1, which flew such sensors, pointed to 5 to
14 arcsec (1 sigma; Mason et al. 2017, J. Small Satellites 6(3), 651).
"""

from __future__ import annotations

from typing import Any

from pydantic import Field

from swarm_mj.scenarios.section import Section, named


class Sensors(Section):
    """Gyro and star tracker; whatever is not given is that of the class `cubesat`."""

    gyro_angular_random_walk_deg_sqrt_h: float = Field(
        0.15, ge=0, le=1e3, description="white noise of the gyro [deg/sqrt(h)]; Sensonor STIM300, data sheet TS1524"
    )
    gyro_bias_deg_h: float = Field(
        10.0,
        ge=0,
        le=1e5,
        description="1 sigma of the initial bias about each axis [deg/h]; class value: a STIM300 repeats within 4 deg/h when "
        "switched on and errs by 5 to 10 deg/h over temperature",
    )
    gyro_rate_random_walk_deg_h_sqrt_h: float = Field(
        1.0,
        ge=0,
        le=1e5,
        description="random walk K of the bias [deg/h/sqrt(h)]; class value: with white noise N the least Allan deviation is "
        "(2 N K / sqrt(3))^0.5 = 0.4 deg/h, which data sheets call bias instability",
    )
    star_tracker_noise_arcsec: float = Field(
        25.0,
        ge=0,
        le=36_000,
        description="1 sigma about each axis, at every control period [arcsec]; NASA, State of the Art of Small Spacecraft "
        "Technology, table 5-1; root mean square of 6, 6 and 40 (Blue Canyon NST): 24",
    )
    star_tracker_bias_arcsec: float = Field(
        30.0,
        ge=0,
        le=36_000,
        description="1 sigma of the mounting error about each axis [arcsec]; class value of what calibration in flight leaves",
    )
    delay_s: float = Field(
        0.0,
        ge=0,
        le=60,
        description="each spacecraft's sensors are late by a whole number of control periods up to this [s]",
    )

    @property
    def errs(self) -> bool:
        """Whether a reading is anything else than the truth, late or not."""
        return any(value for name, value in self if name != "delay_s")

    @property
    def name(self) -> str:
        """Of the class, or `own values`."""
        return next((name for name, given in CLASSES.items() if self == Sensors(**given)), "own values")


#: Classes by name, by what they change.
CLASSES: dict[str, dict[str, float]] = {"ideal": dict.fromkeys(Sensors.model_fields, 0.0), "cubesat": {}}
IDEAL = Sensors(**CLASSES["ideal"])


def sensor_class(name: str) -> dict[str, float]:
    """The section `spacecraft.sensors` that a name stands for.

    Raises:
        ValueError: There is no such class; the message lists them.
    """
    return named(name, CLASSES, Sensors)


def expanded_sensors(given: Any) -> Any:
    """Sensors by the name of a class as their values; anything else as it is."""
    return sensor_class(given) if isinstance(given, str) else given
