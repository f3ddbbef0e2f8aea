"""A flight as CCSDS messages: an Orbit and an Attitude Ephemeris Message for each spacecraft.

Frame EME2000, time system TDB, centre the body. Versions 2.0 of OEM and 1.0 of AEM are what most programs read; 3.0 and 2.0 are
CCSDS 502.0-B-3 and 504.0-B-2. The quaternion is that of the rotation from EME2000 to B, scalar last: M(q) is the matrix that
takes components in EME2000 to components in B (504.0-B-2, annex B).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, Literal

from swarm_mj.interop.states import FIRST_SPACECRAFT, FlightStates
from swarm_mj.io.times import text_of
from swarm_mj.tracks.kvn import write_message
from swarm_mj.typing import Array

Generation = Literal[2, 3]

#: Versions of OEM and AEM that belong together; there is no AEM 3.0.
VERSIONS: Final = {2: ("2.0", "1.0"), 3: ("3.0", "2.0")}
#: Degree of Hermite's polynomial through positions and velocities of four samples.
HERMITE_DEGREE: Final = 7


def write_oem(states: FlightStates, j: int, generation: Generation = 2) -> str:
    """Text of the OEM of spacecraft j: position [km] and velocity [km/s]."""
    meta = {
        **_object(states, j),
        "CENTER_NAME": states.body.name,
        "REF_FRAME": "EME2000",
        **_span(states, j),
        "INTERPOLATION": "HERMITE",
        "INTERPOLATION_DEGREE": min(HERMITE_DEGREE, 2 * len(states.times[states.flown(j)]) - 1),
    }
    rows = list(_rows(states, j, states.states_E[:, j] / 1e3))
    return write_message("OEM", VERSIONS[generation][0], _comments(states), [(meta, rows)])


def write_aem(states: FlightStates, j: int, generation: Generation = 2) -> str:
    """Text of the AEM of spacecraft j: the quaternion from EME2000 to B."""
    old = generation == 2
    meta = {
        **_object(states, j),
        "CENTER_NAME": states.body.name,
        "REF_FRAME_A": "EME2000",
        "REF_FRAME_B": "SC_BODY_1",
        **({"ATTITUDE_DIR": "A2B"} if old else {}),
        **_span(states, j),
        "ATTITUDE_TYPE": "QUATERNION",
        **({"QUATERNION_TYPE": "LAST"} if old else {}),
        "INTERPOLATION_METHOD": "LINEAR",
        "INTERPOLATION_DEGREE": 1,
    }
    rows = list(_rows(states, j, states.q_BE[:, j][:, [1, 2, 3, 0]]))
    return write_message("AEM", VERSIONS[generation][1], _comments(states), [(meta, rows)])


def _object(states: FlightStates, j: int) -> dict[str, object]:
    return {"OBJECT_NAME": states.plan.names[j].upper(), "OBJECT_ID": FIRST_SPACECRAFT - j}


def _span(states: FlightStates, j: int) -> dict[str, object]:
    flown = states.instants[states.flown(j)]
    first, last = text_of(flown[0]), text_of(flown[-1])
    return {"TIME_SYSTEM": "TDB", "START_TIME": first, "STOP_TIME": last}


def _comments(states: FlightStates) -> list[str]:
    return [*states.comments, f"CENTER_NAME is NAIF {states.body.code}"]


def _rows(states: FlightStates, j: int, values: Array) -> Iterator[str]:
    """Lines of data from the release on: the instant, and numbers of 16 digits, the most that CCSDS allows."""
    flown = states.flown(j)
    for ns, row in zip(states.instants[flown], values[flown].tolist(), strict=True):
        yield f"{text_of(ns)} {' '.join(f'{x: .15e}' for x in row)}"
