"""Tables of vectors of JPL Horizons as tracks about a body, as their text is saved: in blocks of lines, or comma-separated.

Manual: https://ssd.jpl.nasa.gov/horizons/manual.html, ephemeris type VECTORS. Between its lines paths are Hermite's, degree 7.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from swarm_mj.errors import InteropError
from swarm_mj.io.records import bytes_of, reading
from swarm_mj.io.times import instant
from swarm_mj.scenarios.constants import AU, DAY
from swarm_mj.smallbody.naif import BodyName
from swarm_mj.tracks.frames import C_EN
from swarm_mj.tracks.track import Stretch, Track
from swarm_mj.typing import Array, Ints

#: No table of a mission is larger.
MAX_BYTES: Final = 100_000_000
#: Units by name: metres and metres a second.
UNITS: Final = {"KM-S": (1e3, 1e3), "KM-D": (1e3, 1e3 / DAY), "AU-D": (AU, AU / DAY)}
_MONTHS = "JanFebMarAprMayJunJulAugSepOctNovDec"
_DATE = re.compile(r"A\.D\. (\d{4})-([A-Z][a-z]{2})-(\d{2}) (\d{2}:\d{2}:\d{2}(?:\.\d+)?)", re.ASCII)
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[Ee][-+]?\d+)?", re.ASCII)
_AGAIN = "ask Horizons for it again, or give another file"


def read_horizons(path: Path, body: BodyName) -> Track:
    """The path of a spacecraft about a body.

    Args:
        path: A table of vectors in TDB, in the units KM-S, KM-D or AU-D and the frame ecliptic of J2000 or ICRF.
        body: That the table's centre must be, by name or number.

    Raises:
        InteropError: It is none, or of another centre, unit, frame or time; one line says which.
    """
    with reading(path, "give a table of vectors as JPL Horizons writes it", InteropError):
        text = bytes_of(path, MAX_BYTES).decode("utf-8")
    head, begun, rest = text.partition("$$SOE")
    table, ended, _ = rest.partition("$$EOE")
    if not (begun and ended):
        raise InteropError(f"{path}: has no lines between $$SOE and $$EOE; {_AGAIN}")
    centre = _told(path, head, "Center body name")
    if not any(body.is_meant_by(word) for word in (centre, *re.split(r"[()]", centre))):
        raise InteropError(f"{path}: Center body name = {centre}: must be {body.name} ({body.code})")
    units, frame = _told(path, head, "Output units").split(",")[0], _told(path, head, "Reference frame")
    if units not in UNITS:
        raise InteropError(f"{path}: Output units = {units}: must be one of {', '.join(UNITS)}")
    if not frame.startswith(("Ecliptic of J2000", "ICRF")):
        raise InteropError(f"{path}: Reference frame = {frame}: must be Ecliptic of J2000.0 or ICRF")
    ns, states = _rows(path, table)
    metre, metre_s = UNITS[units]
    values = states * np.repeat((metre, metre_s), 3)
    if frame.startswith("ICRF"):  # components in EME2000
        values = np.hstack([values[:, :3] @ C_EN, values[:, 3:] @ C_EN])
    degree, span = min(7, 2 * len(ns) - 1), (int(ns[0]), int(ns[-1]))
    whole = Stretch(ns=ns, first=span[0], last=span[1], values=values, method="HERMITE", degree=degree)
    return Track(str(path), _told(path, head, "Target body name"), (whole,))


def _told(path: Path, head: str, key: str) -> str:
    found = re.search(rf"^{key}\s*: *(.*?)(?:\s{{2,}}.*|\s*\{{.*)?$", head, re.MULTILINE)
    if found is None:
        raise InteropError(f"{path}: does not say its {key}; {_AGAIN}")
    return found[1].strip()


def _rows(path: Path, table: str) -> tuple[Ints, Array]:
    """Instants [ns of TDB past J2000], shape (k,), and states in the table's units, shape (k, 6)."""
    dates = list(_DATE.finditer(table))
    ends = [*(each.start() for each in dates), len(table)]
    ns, states = [], []
    for date, (_, end) in zip(dates, pairwise(ends), strict=True):
        month = _MONTHS.find(date[2]) // 3 + 1
        words = re.sub(
            r"LT ?=.*", "", re.sub(r"V?[XYZ] ?=", " ", table[date.end() : end].replace("TDB", "")), flags=re.S
        )
        numbers = _NUMBER.findall(words)[:6]
        try:
            ns.append(instant(f"{date[1]}-{month:02d}-{date[3]}T{date[4]}", "TDB"))
        except ValueError as error:
            raise InteropError(f"{path}: {error}") from None
        if len(numbers) < 6:
            raise InteropError(f"{path}: {date[0]} has no position and velocity; {_AGAIN}, with output type 2 or 3")
        states.append([float(number) for number in numbers])
    found = np.array(ns, np.int64)
    if len(found) < 2 or not (np.diff(found) > 0).all() or not np.isfinite(states).all():
        raise InteropError(f"{path}: needs two lines or more in order of time, of finite numbers; {_AGAIN}")
    return found, np.array(states)
