"""Data files that bsk_rl reads and no package brings: SPICE kernels and Earth's gravity field, from published values.

bsk_rl downloads 120 MB of them (de430.bsp, naif0012.tls, pck00010.tpc, de-403-masses.tpc, GGM03S.txt). What a step costs does
not depend on the numbers in them, but on what is evaluated: so the kernels written here hold segments of the same type, with
the same number of Chebyshev coefficients per record as de430, and the field has every term up to degree and order 10 that
bsk_rl asks for. Sun and Earth stand where two-body motion has them, so that eclipses come and go.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DAY_S, AU_KM, CENTURY_DAYS = 86_400.0, 149_597_870.7, 36_525.0
#: The epochs that bsk_rl draws, 2000 to 2022, and a margin; days from J2000.
FIRST_DAY, LAST_DAY = -400.0, 9_000.0
SUN, EARTH, EARTH_MOON, SOLAR_SYSTEM = 10, 399, 3, 0
#: Days per record and coefficients per component of de430 (Folkner and others 2014, IPN Progress Report 42-196, Table 1).
SEGMENTS = {
    (SUN, SOLAR_SYSTEM): (16.0, 11),
    (EARTH_MOON, SOLAR_SYSTEM): (16.0, 13),
    (EARTH, EARTH_MOON): (4.0, 13),
}
#: TAI - UTC from each date on [s], IERS Bulletin C.
LEAP_SECONDS = (
    *((10, "1972-JAN-1"), (11, "1972-JUL-1"), (12, "1973-JAN-1"), (13, "1974-JAN-1"), (14, "1975-JAN-1")),
    *((15, "1976-JAN-1"), (16, "1977-JAN-1"), (17, "1978-JAN-1"), (18, "1979-JAN-1"), (19, "1980-JAN-1")),
    *((20, "1981-JUL-1"), (21, "1982-JUL-1"), (22, "1983-JUL-1"), (23, "1985-JUL-1"), (24, "1988-JAN-1")),
    *((25, "1990-JAN-1"), (26, "1991-JAN-1"), (27, "1992-JUL-1"), (28, "1993-JUL-1"), (29, "1994-JUL-1")),
    *((30, "1996-JAN-1"), (31, "1997-JUL-1"), (32, "1999-JAN-1"), (33, "2006-JAN-1"), (34, "2009-JAN-1")),
    *((35, "2012-JUL-1"), (36, "2015-JUL-1"), (37, "2017-JAN-1")),
)
#: Earth's field, fully normalised: the largest terms of EGM96; those that are not listed are zero and cost the same.
EARTH_FIELD = {
    (2, 0): (-4.84165371736e-4, 0.0),
    (2, 2): (2.43914352398e-6, -1.40016683654e-6),
    (3, 0): (9.57254173792e-7, 0.0),
    (3, 1): (2.02998882184e-6, 2.48513158716e-7),
    (4, 0): (5.39873863789e-7, 0.0),
}
EARTH_RADIUS_M, EARTH_GM, DEGREE = 6_378_136.3, 3.986004415e14, 10


def install(folder: Path) -> None:
    """Write all files below `folder` and make Basilisk take them from there, as it does in a checkout of its own."""
    # Here and below: all but writing can be checked without the peer.
    from Basilisk.utilities.supportDataTools import dataFetcher

    kernels, fields = folder / "EphemerisData", folder / "LocalGravData"
    kernels.mkdir(parents=True)
    fields.mkdir()
    (kernels / "naif0012.tls").write_text(leap_seconds(), encoding="ascii")
    (kernels / "pck00010.tpc").write_text(planets(), encoding="ascii")
    (kernels / "de-403-masses.tpc").write_text(masses(), encoding="ascii")
    write_ephemeris(kernels / "de430.bsp")
    (fields / "GGM03S.txt").write_text(gravity_field(), encoding="ascii")
    dataFetcher.LOCAL_SUPPORT = folder


def leap_seconds() -> str:
    """A leap seconds kernel: TDB - TT as SPICE models it, and TAI - UTC."""
    steps = "\n".join(f"  {seconds}, @{date}" for seconds, date in LEAP_SECONDS)
    return (
        "KPL/LSK\n\\begindata\n"
        "DELTET/DELTA_T_A = 32.184\nDELTET/K = 1.657D-3\nDELTET/EB = 1.671D-2\n"
        "DELTET/M = ( 6.239996D0 1.99096871D-7 )\n"
        f"DELTET/DELTA_AT = (\n{steps}\n)\n\\begintext\n"
    )


def planets() -> str:
    """Poles, prime meridians and radii of Sun and Earth (IAU Working Group 2009: Archinal and others 2011)."""
    return (
        "KPL/PCK\n\\begindata\n"
        "BODY10_POLE_RA = ( 286.13 0. 0. )\nBODY10_POLE_DEC = ( 63.87 0. 0. )\nBODY10_PM = ( 84.176 14.18440 0. )\n"
        "BODY10_RADII = ( 696000. 696000. 696000. )\n"
        "BODY399_POLE_RA = ( 0. -0.641 0. )\nBODY399_POLE_DEC = ( 90. -0.557 0. )\n"
        "BODY399_PM = ( 190.147 360.9856235 0. )\nBODY399_RADII = ( 6378.1366 6378.1366 6356.7519 )\n\\begintext\n"
    )


def masses() -> str:
    """Gravitational parameters [km^3/s^2] (DE430)."""
    return (
        "KPL/PCK\n\\begindata\nBODY10_GM = ( 132712440041.93938 )\n"
        "BODY3_GM = ( 403503.235502 )\nBODY399_GM = ( 398600.435436 )\n\\begintext\n"
    )


def gravity_field() -> str:
    """Earth's field as a table of degree, order and coefficients."""
    head = f"{EARTH_RADIUS_M}, {EARTH_GM}, 0, {DEGREE}, {DEGREE}, 1, 0, 0"
    rows = [
        f"{n}, {m}, {c!r}, {s!r}"
        for n in range(DEGREE + 1)
        for m in range(n + 1)
        for c, s in [(1.0, 0.0) if n == 0 else EARTH_FIELD.get((n, m), (0.0, 0.0))]
    ]
    return "\n".join([head, *rows]) + "\n"


def write_ephemeris(path: Path) -> None:
    """Sun, Earth-Moon barycentre and Earth as Chebyshev polynomials; the Moon is left out, the Sun stands at the barycentre."""
    import spiceypy

    handle = spiceypy.spkopn(str(path), "two-body Earth", 0)
    for (body, centre), (days, terms) in SEGMENTS.items():
        records = int(np.ceil((LAST_DAY - FIRST_DAY) / days))
        coefficients = np.zeros((records, 3, terms))
        if body == EARTH_MOON:
            coefficients = chebyshev(days, terms, records)
        first, last = FIRST_DAY * DAY_S, (FIRST_DAY + records * days) * DAY_S
        name = f"{body} from {centre}"
        spiceypy.spkw02(
            handle,
            body,
            centre,
            "J2000",
            first,
            last,
            name,
            days * DAY_S,
            records,
            terms - 1,
            coefficients.ravel(),
            first,
        )
    spiceypy.spkcls(handle)


def chebyshev(days: float, terms: int, records: int) -> Array:
    """Earth's position by records of `days`, shape (records, 3, terms) [km]."""
    nodes = np.cos(np.pi * (np.arange(terms) + 0.5) / terms)
    middle = FIRST_DAY + (np.arange(records) + 0.5) * days
    positions = earth_km(middle[:, None] + 0.5 * days * nodes)
    fitted = np.polynomial.chebyshev.chebfit(nodes, np.moveaxis(positions, 1, 0).reshape(terms, -1), terms - 1)
    return np.ascontiguousarray(fitted.reshape(terms, records, 3).transpose(1, 2, 0))


def earth_km(day: Array) -> Array:
    """Heliocentric position on the equator of J2000, shape (..., 3) [km] (Standish, approximate elements, JPL)."""
    t = day / CENTURY_DAYS
    e, perihelion = 0.01671123, np.radians(102.93768193)
    anomaly = np.radians(100.46457166 + 35_999.37244981 * t) - perihelion
    eccentric = anomaly + e * np.sin(anomaly)
    for _ in range(6):
        eccentric = eccentric - (eccentric - e * np.sin(eccentric) - anomaly) / (1.0 - e * np.cos(eccentric))
    x, y = np.cos(eccentric) - e, np.sqrt(1.0 - e * e) * np.sin(eccentric)
    east = np.cos(perihelion) * x - np.sin(perihelion) * y
    north = np.sin(perihelion) * x + np.cos(perihelion) * y
    obliquity = np.radians(23.43928)
    return 1.00000261 * AU_KM * np.stack([east, north * np.cos(obliquity), north * np.sin(obliquity)], axis=-1)
