"""OEM and AEM of anybody as tracks about a body: checked line by line, turned into N, and into TDB.

Lengths are in km. Files that name no interpolation are taken at Hermite's of degree 7 (OEM, which has velocities) or at a
constant rate of turning (AEM), and a note says so.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Final

import numpy as np

from swarm_mj.io.times import SYSTEMS, instant
from swarm_mj.smallbody.naif import BodyName
from swarm_mj.spacecraft.attitude.mrp import dcm, mrp_from_quaternion, quaternions, steady
from swarm_mj.tracks.frames import FROM_N, from_N
from swarm_mj.tracks.interpolation import MAX_DEGREE
from swarm_mj.tracks.kvn import Message, Segment, read_message
from swarm_mj.tracks.track import Stretch, Track
from swarm_mj.typing import Array, Ints

OEM_VERSIONS, AEM_VERSIONS = ("1.0", "2.0", "3.0"), ("1.0", "2.0")
#: Methods that are read, and the degree where a file names none.
OEM_METHODS: Final = {"HERMITE": 7, "LAGRANGE": 7, "LINEAR": 1}
AEM_METHODS: Final = {"LINEAR": 1, "LAGRANGE": 3}
#: No position [km], speed [km/s] or component of a quaternion is larger.
FARTHEST_KM, FASTEST_KM_S, LARGEST = 1e12, 3e5, 1.001
#: Kinds of attitude whose first four numbers are a quaternion.
QUATERNIONS: Final = ("QUATERNION", "QUATERNION/DERIVATIVE", "QUATERNION/RATE", "QUATERNION/ANGVEL")
EXPORT_AGAIN: Final = "the file is cut short or was changed: export it again"


def read_oem(path: Path, body: BodyName) -> Track:
    """The path of a spacecraft about a body.

    Args:
        path: An OEM in KVN, version 1.0, 2.0 or 3.0.
        body: That CENTER_NAME must name.

    Raises:
        InteropError: It is none, or of another body, or in a frame or time system that is unknown; one line says which.
    """
    message = read_message(path, "OEM", OEM_VERSIONS)
    return _track(message, lambda segment: _oem_values(message, segment, body), ("INTERPOLATION", OEM_METHODS))


def read_aem(path: Path) -> Track:
    """The attitude of a spacecraft; args and errors as for `read_oem`, versions 1.0 and 2.0."""
    message = read_message(path, "AEM", AEM_VERSIONS)
    return _track(message, lambda segment: _aem_values(message, segment), ("INTERPOLATION_METHOD", AEM_METHODS))


def _track(message: Message, values_of: Callable[[Segment], Array], methods: tuple[str, dict[str, int]]) -> Track:
    stretches, notes = [], []
    for segment in message.segments:
        ns = _instants(message, segment)
        method, degree, note = _rule(message, segment, *methods)
        first, last = _usable(message, segment, ns)
        values = values_of(segment)
        stretches.append(Stretch(ns=ns, first=first, last=last, values=values, method=method, degree=degree))
        notes += [note] if note else []
    name = message.wanted(message.segments[0], "OBJECT_NAME")
    for segment in message.segments[1:]:
        if (other := message.wanted(segment, "OBJECT_NAME")) != name:
            what = f"OBJECT_NAME = {other}, before it {name}"
            raise message.wrong(segment.line, what, "one file, one spacecraft: split it")
    return Track(str(message.path), name, stretches, tuple(dict.fromkeys(notes)))


def _instants(message: Message, segment: Segment) -> Ints:
    """Instants of the lines of data, rising."""
    system = _system(message, segment)
    if not segment.rows:
        raise message.wrong(segment.line, "no lines of data", EXPORT_AGAIN)
    found = []
    for line, words in segment.rows:
        try:
            found.append(instant(words[0], system))
        except (ValueError, OverflowError) as error:
            raise message.wrong(line, str(error), "correct the date") from None
        if len(found) > 1 and found[-1] <= found[-2]:
            raise message.wrong(line, f"{words[0]} is not after the line before", "sort the lines by time, each once")
    return np.array(found, dtype=np.int64)


def _system(message: Message, segment: Segment) -> str:
    system = message.wanted(segment, "TIME_SYSTEM").upper()
    if system not in SYSTEMS:
        remedy = f"allowed are {', '.join(SYSTEMS)}: write the file in one of them"
        raise message.wrong(segment.line, f"TIME_SYSTEM = {system}", remedy)
    return system


def _usable(message: Message, segment: Segment, ns: Ints) -> tuple[int, int]:
    """From when to when the stretch may be used."""
    system, found = _system(message, segment), {}
    for key in ("START_TIME", "STOP_TIME", "USEABLE_START_TIME", "USEABLE_STOP_TIME"):
        if key in segment.meta:
            try:
                found[key] = instant(segment.meta[key], system)
            except (ValueError, OverflowError) as error:
                raise message.wrong(segment.line, f"{key}: {error}", "correct the date") from None
    for key, end, words in (("START_TIME", ns[0], "begins"), ("STOP_TIME", ns[-1], "ends")):
        if key in found and abs(found[key] - int(end)) > 1_000_000_000 and (found[key] < end) == (key == "START_TIME"):
            line = segment.rows[0 if key == "START_TIME" else -1][0]
            raise message.wrong(line, f"{key} = {segment.meta[key]}, but the data {words} elsewhere", EXPORT_AGAIN)
    first = max(int(ns[0]), found.get("USEABLE_START_TIME", found.get("START_TIME", int(ns[0]))))
    last = min(int(ns[-1]), found.get("USEABLE_STOP_TIME", found.get("STOP_TIME", int(ns[-1]))))
    return first, last


def _rule(message: Message, segment: Segment, key: str, methods: dict[str, int]) -> tuple[str, int, str]:
    """Method and degree of interpolation, and a note where the file says neither."""
    given = segment.meta.get(key, "").upper()
    if not given:
        method, degree = next(iter(methods.items()))
        return method, degree, f"{message.path.name} names no {key}: taken as {method}, degree {degree}"
    if given not in methods:
        remedy = f"allowed are {', '.join(methods)}: resample the file, or name one of them"
        raise message.wrong(segment.line, f"{key} = {given}", remedy)
    text = segment.meta.get("INTERPOLATION_DEGREE", str(methods[given]))
    if not (text.isdecimal() and len(text) < 4 and 1 <= int(text) <= MAX_DEGREE):
        remedy = f"must be a whole number, 1 to {MAX_DEGREE}"
        raise message.wrong(segment.line, f"INTERPOLATION_DEGREE = {text}", remedy)
    return given, 1 if given == "LINEAR" else int(text), ""


def _numbers(message: Message, segment: Segment, counts: tuple[int, ...], limits: tuple[float, ...]) -> Array:
    """The first numbers of each line of data, shape (k, len(limits)), each finite and within its limit."""
    out = np.empty((len(segment.rows), len(limits)))
    for k, (line, words) in enumerate(segment.rows):
        if len(words) - 1 not in counts:
            shown = " or ".join(map(str, counts))
            raise message.wrong(line, f"{len(words) - 1} numbers after the date, not {shown}", EXPORT_AGAIN)
        for i, limit in enumerate(limits):
            try:
                out[k, i] = value = float(words[i + 1])
            except ValueError:
                raise message.wrong(line, f"{words[i + 1][:40]!r} is no number", "correct it") from None
            if not isfinite(value) or abs(value) > limit:
                what = f"{value:g} cannot be: at most {limit:g}"
                raise message.wrong(line, what, "give km, km/s and unit quaternions")
    return out


def _oem_values(message: Message, segment: Segment, body: BodyName) -> Array:
    center = message.wanted(segment, "CENTER_NAME")
    if not body.is_meant_by(center):
        what = f"CENTER_NAME = {center}, but the body is {body.name}, NAIF {body.code}"
        remedy = "give the path relative to the body's centre, or its body (body of the scenario; observe: --body)"
        raise message.wrong(segment.line, what, remedy)
    C = from_N(message.wanted(segment, "REF_FRAME"), f"{message.path}, line {segment.line}: REF_FRAME")
    limits = (FARTHEST_KM,) * 3 + (FASTEST_KM_S,) * 3
    values = 1e3 * _numbers(message, segment, (6, 9), limits)
    turned: Array = (values.reshape(-1, 2, 3) @ C).reshape(-1, 6)
    return turned


def _aem_values(message: Message, segment: Segment) -> Array:
    kind = message.wanted(segment, "ATTITUDE_TYPE").upper()
    if kind not in QUATERNIONS:
        remedy = f"allowed are {', '.join(QUATERNIONS)}: convert it"
        raise message.wrong(segment.line, f"ATTITUDE_TYPE = {kind}", remedy)
    numbers = (4,) if kind == "QUATERNION" else (7, 8)
    q = _numbers(message, segment, numbers, (LARGEST,) * 4)
    length = np.linalg.norm(q, axis=1)
    if (wrong := np.flatnonzero(np.abs(length - 1.0) > 1e-3)).size:
        k = wrong[0]
        raise message.wrong(segment.rows[k][0], f"a quaternion of length {length[k]:.6g}", "its length must be 1")
    if segment.meta.get("QUATERNION_TYPE", "LAST").upper() == "LAST":
        q = q[:, [3, 0, 1, 2]]
    return _turned(message, segment, dcm(mrp_from_quaternion(q / length[:, None])))


def _turned(message: Message, segment: Segment, C_BA: Array) -> Array:
    """Euler parameters of B relative to N, by the file's matrices from its frame A to its frame B."""
    a, b = (message.wanted(segment, f"REF_FRAME_{which}").upper() for which in "AB")
    if segment.meta.get("ATTITUDE_DIR", "A2B").upper() == "B2A":
        C_BA = np.swapaxes(C_BA, 1, 2)
    if b in FROM_N and a not in FROM_N:
        a, b, C_BA = b, a, np.swapaxes(C_BA, 1, 2)
    if not b.startswith("SC_BODY"):
        remedy = "one must be SC_BODY_1, the frame whose +z the camera looks along"
        raise message.wrong(segment.line, f"REF_FRAME_A = {a}, REF_FRAME_B = {b}", remedy)
    C_AN = from_N(a, f"{message.path}, line {segment.line}: REF_FRAME_A")
    return steady(quaternions(C_BA @ C_AN))
