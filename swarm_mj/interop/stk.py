"""A flight as STK's text files: ephemeris (.e) and attitude (.a).

Format: Ansys STK help, "Ephemeris File Format" and "Attitude File Format". Axes are J2000, the centre is the body, which STK
must know by that name; times are seconds past an epoch in UTC, as STK's files have it.
"""

from __future__ import annotations

from swarm_mj.interop.states import FlightStates
from swarm_mj.tracks.times import utc_of
from swarm_mj.typing import Array

VERSION = "stk.v.11.0"


def write_ephemeris(states: FlightStates, j: int) -> str:
    """Text of the .e file of spacecraft j: seconds, metres, metres a second."""
    keys = {
        "NumberOfEphemerisPoints": len(states.times[states.flown(j)]),
        "ScenarioEpoch": _epoch(states),
        "InterpolationMethod": "Hermite",
        "InterpolationSamplesM1": 3,
        "DistanceUnit": "Meters",
        "CentralBody": states.body.name.capitalize(),
        "CoordinateSystem": "J2000",
    }
    return _text(states, j, ("Ephemeris", "EphemerisTimePosVel"), keys, states.states_E[:, j])


def write_attitude(states: FlightStates, j: int) -> str:
    """Text of the .a file of spacecraft j: seconds, quaternion of the rotation from J2000 to B, scalar last."""
    keys = {
        "NumberOfAttitudePoints": len(states.times[states.flown(j)]),
        "ScenarioEpoch": _epoch(states),
        "InterpolationOrder": 1,
        "CentralBody": states.body.name.capitalize(),
        "CoordinateAxes": "J2000",
    }
    return _text(states, j, ("Attitude", "AttitudeTimeQuaternions"), keys, states.q_BE[:, j][:, [1, 2, 3, 0]])


def _epoch(states: FlightStates) -> str:
    moment = utc_of(states.epoch)
    return f"{moment.day} {moment:%b %Y %H:%M:%S.%f}"


def _text(states: FlightStates, j: int, names: tuple[str, str], keys: dict[str, object], values: Array) -> str:
    (what, table), flown = names, states.flown(j)
    lines = [VERSION, "", *(f"# {words}" for words in states.comments), "", f"BEGIN {what}", ""]
    lines += [*(f"{key} {value}" for key, value in keys.items()), "", table, ""]
    for t, row in zip(states.times[flown].tolist(), values[flown].tolist(), strict=True):
        lines.append(f"{t:.9f} {' '.join(f'{x:.16e}' for x in row)}")
    return "\n".join([*lines, "", f"END {what}", ""])
