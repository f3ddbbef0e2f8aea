"""Instants in nanoseconds of TDB past J2000, from and to the texts of files, whatever time system those are in.

TDB - TT is SPICE's formula, good to 30 us. Leap seconds are ERFA's; an instant before 1972 has no UTC here.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from datetime import UTC, date, datetime, timedelta
from functools import cache
from math import sin
from typing import Any, Final

SECOND: Final = 10**9
DAY: Final = 86_400 * SECOND
#: TT - TAI and TAI - GPS [s].
TT_TAI, TAI_GPS = 32.184, 19.0
#: TDB - TT = K sin(M + EB sin M), M = M0 + M1 t, t in seconds of TT past J2000 (SPICE, leapseconds kernel).
K, EB, M0, M1 = 1.657e-3, 1.671e-2, 6.239996, 1.99096871e-7
SYSTEMS: Final = ("TDB", "TT", "TAI", "UTC", "GPS")

_J2000_DAY: Final = date(2000, 1, 1).toordinal()
_TEXT = re.compile(
    r"(\d{4})-(?:(\d{2})-(\d{2})|(\d{3}))T(\d{2}):(\d{2}):(\d{2})(?:\.(\d{1,18}))?Z?", re.ASCII
)  # CCSDS 502.0-B, 7.5.10: date by month and day or by day of the year


def instant(text: str, system: str) -> int:
    """The instant that a text names.

    Args:
        text: Date and time as CCSDS writes them, `2018-01-01T03:15:00.5` or `2018-001T03:15:00.5`.
        system: One of `SYSTEMS`.

    Returns:
        Nanoseconds of TDB past J2000.

    Raises:
        ValueError: It is none, or before UTC had whole leap seconds.
    """
    found = _TEXT.fullmatch(text)
    if found is None:
        raise ValueError(f"{text[:40]!r} is no date and time like 2018-01-01T03:15:00.000")
    year, month, day, of_year, hour, minute, second = (int(part) if part else 0 for part in found.groups()[:7])
    if of_year:
        that_day = date(year, 1, 1) + timedelta(days=of_year - 1)
        valid = that_day.year == year
    else:
        that_day, valid = date(year, month, day), True
    longest = (
        60 if system == "UTC" and (hour, minute) == (23, 59) and that_day + timedelta(days=1) in leap_seconds() else 59
    )
    if not valid or hour > 23 or minute > 59 or second > longest:
        raise ValueError(f"{text[:40]!r} names a day, hour, minute or second that does not exist in {system}")
    fraction = int((found[8] or "").ljust(9, "0")[:9])
    noon = (that_day.toordinal() - _J2000_DAY) * DAY - DAY // 2
    return to_tdb(noon + ((hour * 60 + minute) * 60 + second) * SECOND + fraction, system, that_day)


def to_tdb(ns: int, system: str, day: date) -> int:
    """TDB of an instant that a clock of another system shows as `ns` past its own 2000-01-01T12:00:00, on that day.

    Raises:
        ValueError: The system is unknown, or the day has no UTC here.
    """
    if system == "TDB":
        return ns
    if system == "UTC":
        ns += tai_minus_utc(day) * SECOND
    elif system == "GPS":
        ns += round(TAI_GPS * SECOND)
    elif system not in SYSTEMS:
        raise ValueError(f"{system} is no time system of {', '.join(SYSTEMS)}")
    if system != "TT":
        ns += round(TT_TAI * SECOND)
    return ns + round(tdb_minus_tt(ns / SECOND) * SECOND)


@cache
def leap_seconds() -> dict[date, int]:
    """TAI - UTC [s] by the date from which on it holds, in order; from 1972 on, when they became whole."""
    import erfa

    return {date(y, m, 1): round(tai_utc) for y, m, tai_utc in erfa.leap_seconds.get().tolist() if y >= 1972}


def tdb_minus_tt(t: float) -> float:
    """TDB - TT [s] at `t` seconds past J2000."""
    M = M0 + M1 * t
    return K * sin(M + EB * sin(M))


def tai_minus_utc(day: date) -> int:
    """Leap seconds on a day [s].

    Raises:
        ValueError: Before 1972 there were none.
    """
    days = list(leap_seconds())
    count = bisect_right(days, day)
    if not count:
        raise ValueError(f"UTC of {day} has no whole leap seconds, which began in 1972; give it in TDB")
    return leap_seconds()[days[count - 1]]


def text_of(ns: int) -> str:
    """Date and time of an instant in TDB, with as many decimals as it needs: three, six or nine."""
    day, rest = divmod(ns + DAY // 2, DAY)
    second, fraction = divmod(rest, SECOND)
    digits = f"{fraction:09d}"
    shown = next(n for n in (3, 6, 9) if not int(digits[n:] or 0))
    that_day = date.fromordinal(_J2000_DAY + day)
    return f"{that_day.isoformat()}T{second // 3600:02d}:{second // 60 % 60:02d}:{second % 60:02d}.{digits[:shown]}"


def utc_text(ns: int) -> str | None:
    """Date and time in UTC of an instant in TDB, to the millisecond; None before 1972."""
    tai = ns - round((tdb_minus_tt(ns / SECOND) + TT_TAI) * SECOND)
    for day, leaps in reversed(leap_seconds().items()):
        utc = tai - leaps * SECOND
        if utc >= (day.toordinal() - _J2000_DAY) * DAY - DAY // 2:
            return f"{text_of(round(utc, -6))}Z"
    return None


def epoch_of(text: str) -> int:
    """A scenario's date and time in TDB, in nanoseconds past J2000."""
    return instant(text, "TDB")


def tdb_date(value: Any) -> str:
    """Date and time in TDB, ISO 8601 to the microsecond, of one that a scenario gives.

    Args:
        value: A text such as 2018-01-15T00:00:00, or what YAML makes of it, in TDB; or in UTC, which a trailing Z, another
            offset from UTC, or the word UTC says.

    Raises:
        ValueError: It is none, or in UTC before 1972.
    """
    moment = value
    if isinstance(value, str):
        words = value.strip()
        try:
            moment = datetime.fromisoformat(words.removesuffix("UTC").rstrip() + "Z" * words.endswith("UTC"))
        except ValueError:
            moment = None
    if not isinstance(moment, datetime):
        raise ValueError(
            f"= {value!r}: must be a date and time in TDB, like 2018-01-15T00:00:00, or in UTC, like 2018-01-15T00:00:00Z"
        )
    if moment.tzinfo is None:
        return moment.isoformat()
    utc = moment.astimezone(UTC).replace(tzinfo=None)
    try:
        found = instant(f"{utc.isoformat()}Z", "UTC")
    except ValueError as error:
        raise ValueError(f"= {value!r}: {error}") from None
    return (datetime(2000, 1, 1, 12) + timedelta(microseconds=round(found / 1000))).isoformat()


def seconds(ns: int) -> float:
    """SPICE's ephemeris time: seconds of TDB past J2000, which double precision resolves to 0.1 us."""
    return ns / SECOND
