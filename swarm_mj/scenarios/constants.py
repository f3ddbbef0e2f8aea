"""Physical and astronomical constants, SI units unless the name says otherwise, each with its source."""

from typing import Final

#: Gravitational parameter of the Sun [m^3/s^2] (IAU 2015 resolution B3, nominal).
GM_SUN: Final = 1.3271244e20
#: Astronomical unit [m] (IAU 2012 resolution B2).
AU: Final = 149_597_870_700.0
#: Speed of light [m/s] (SI definition).
SPEED_OF_LIGHT: Final = 299_792_458.0
#: Nominal total solar irradiance at 1 au [W/m^2] (IAU 2015 resolution B3).
SOLAR_IRRADIANCE: Final = 1361.0
#: Effective temperature [K] and radius [m] of the Sun (IAU 2015 resolution B3, nominal).
SUN_TEMPERATURE: Final = 5772.0
SUN_RADIUS: Final = 6.957e8
#: Planck constant [J s] (SI definition).
PLANCK: Final = 6.62607015e-34
#: Gravitational constant [m^3/(kg s^2)] (CODATA 2018).
GRAVITATIONAL_CONSTANT: Final = 6.67430e-11
#: Mean obliquity of the ecliptic at J2000 [deg] (IAU 1976: 84381.448 arcsec).
OBLIQUITY_J2000_DEG: Final = 23.43928
#: Standard gravity, by which specific impulses are defined [m/s^2] (CGPM 1901).
STANDARD_GRAVITY: Final = 9.80665
#: Boltzmann constant [J/K] (SI definition).
BOLTZMANN: Final = 1.380649e-23
#: Julian date of J2000.0 (2000-01-01 12:00 TDB).
JD_J2000: Final = 2_451_545.0
#: Seconds per day.
DAY: Final = 86_400.0

# ---- Sizes of packaged bodies, and the lens of a CubeSat ------------------------------------------------------------
#: Longest extent of the packaged shapes [m]: Eros (JPL Small-Body Database, 34.4 x 11.2 x 11.2 km), Bennu (Barnouin et al.
#: 2019, Nature Geoscience 12, 247), Itokawa (Fujiwara et al. 2006, Science 312, 1330: 535 x 294 x 209 m).
LONGEST_EXTENT_M: Final = {"eros": 34_400.0, "bennu": 565.0, "itokawa": 535.0, "dumbbell": 2000.0}
#: Green light, the middle of the visible band [m].
GREEN_LIGHT_M: Final = 550e-9
#: Aperture that fits the 0.1 m face of a 3U CubeSat [m]; assumed, AAS 19-144 gives none.
CUBESAT_APERTURE_M: Final = 0.094

# ---- 433 Eros ------------------------------------------------------------------------------------------------------
#: Gravitational parameter of Eros [m^3/s^2] (NEAR15A / JGE15A01, PDS NEAR-A-5-COLLECTED-MODELS-V1.0).
EROS_GM: Final = 4.46275472004e5
#: Reference radius of the NEAR15A field [m] (same source).
EROS_REFERENCE_RADIUS: Final = 16_000.0
#: NEAR15A, fully normalised coefficients of degree 2 as {(n, m): (C, S)} (same source).
EROS_DEGREE_2: Final = {
    (2, 0): (-5.24618393097e-2, 0.0),
    (2, 1): (-1.63791296116e-6, -1.40003806164e-7),
    (2, 2): (8.23993879858e-2, -2.81095559016e-2),
}
#: Pole of Eros in the equatorial frame J2000 [deg] (label of the PDS data set above).
EROS_POLE_RA_DEG: Final = 11.363
EROS_POLE_DEC_DEG: Final = 17.232
#: Prime meridian angle at J2000 [deg] and rotation rate [deg/day] (same source).
EROS_W0_DEG: Final = 326.08
EROS_W_RATE_DEG_PER_DAY: Final = 1639.389232
