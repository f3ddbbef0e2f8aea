"""SPICE's binary kernels of a flight, written by SPICE itself: paths (SPK), attitudes (CK) and the shape (DSK).

SPK and CK are in ECLIPJ2000, which is N: no number is turned on its way. Lengths are in km.
"""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from swarm_mj.interop.kernels_text import TICKS_PER_SECOND, body_frame_code, spacecraft_code, spacecraft_name
from swarm_mj.interop.states import FlightStates
from swarm_mj.io.spice import spice_errors, spiceypy
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.typing import Array

#: Hermite's polynomials through states of so many samples.
SPK_WINDOW = 4
#: The Sun's and the Earth's straight lines go on for so long before and after the flight, for light time [s].
MARGIN_S = 86_400.0
BARYCENTRE, SUN, EARTH = 0, 10, 399
#: Time for which the shape is said to hold, before and after the epoch [s]: 50 years.
SHAPE_SPAN_S = 50 * 365.25 * 86_400.0
#: Of the voxels that SPICE sorts plates into: fine ones as many times larger than a plate, coarse ones than fine ones.
FINE_VOXELS, COARSE_VOXELS = 5.0, 4
_WRITING = "SPICE could not write it; export again into another folder"


def write_spk(path: Path, states: FlightStates) -> None:
    """Paths of all spacecraft relative to the body, type 13 (Hermite, unequal steps)."""
    spice = spiceypy()
    with spice_errors(f"{path.name}", _WRITING):
        handle = spice.spkopn(str(path), "swarm_mj", 0)
        for j in range(states.n):
            who = (spacecraft_code(j), states.body.code, spacecraft_name(states, j))
            flown = states.flown(j)
            _add_states(spice, handle, who, states.et[flown], states.states_N[flown, j] / 1e3)
        spice.spkcls(handle)


def write_sun_and_earth(path: Path, states: FlightStates) -> None:
    """Sun, Earth and body as the flight had them, on straight lines: what an ephemeris of the planets says otherwise.

    SPICE's geometry goes through the barycentre of the solar system, so that the Sun is put there, at rest.
    """
    spice, environment = spiceypy(), states.plan.environment
    sun, earth = environment.sun, environment.earth
    t = np.array([-MARGIN_S, states.times[-1] + MARGIN_S])
    et = states.epoch / 1e9 + t
    from_sun = np.array([np.concatenate([-sun.at(s), -sun.velocity]) for s in t])
    earth_from_sun = from_sun + np.array([np.concatenate([earth.at(s), earth.velocity]) for s in t])
    with spice_errors(f"{path.name}", _WRITING):
        handle = spice.spkopn(str(path), "swarm_mj", 0)
        _add_states(spice, handle, (SUN, BARYCENTRE, "SUN"), et, np.zeros((2, 6)))
        _add_states(spice, handle, (states.body.code, SUN, states.body.name), et, from_sun / 1e3)
        _add_states(spice, handle, (EARTH, SUN, "EARTH"), et, earth_from_sun / 1e3)
        spice.spkcls(handle)


def _add_states(spice: Any, handle: int, who: tuple[int, int, str], et: Array, states_km: Array) -> None:
    target, center, name = who
    degree = 2 * min(SPK_WINDOW, len(et)) - 1
    spice.spkw13(
        handle, target, center, "ECLIPJ2000", et[0], et[-1], name, degree, len(et), np.ascontiguousarray(states_km), et
    )


def write_ck(path: Path, states: FlightStates) -> None:
    """Attitudes of all spacecraft with rates, type 3 (turned at a constant rate between samples)."""
    spice = spiceypy()
    ticks = states.times * TICKS_PER_SECOND
    C_BN, omega_B = dcm(states.telemetry["sigma_BN"].values), states.telemetry["omega_BN_B"].values
    omega_N = np.einsum("tnij,tni->tnj", C_BN, omega_B)
    # SPICE's quaternion turns vectors, where Euler parameters turn frames: the vector part has the other sign.
    q = states.q_BN * np.array([1.0, -1.0, -1.0, -1.0])
    with spice_errors(f"{path.name}", _WRITING):
        handle = spice.ckopn(str(path), "swarm_mj", 0)
        for j in range(states.n):
            code, name, flown = body_frame_code(j), spacecraft_name(states, j), states.flown(j)
            at = ticks[flown]
            spice.ckw03(
                handle, at[0], at[-1], code, "ECLIPJ2000", True, name, len(at), at,
                np.ascontiguousarray(q[flown, j]), np.ascontiguousarray(omega_N[flown, j]), 1, [at[0]],
            )  # fmt: skip
        spice.ckcls(handle)


def write_dsk(path: Path, states: FlightStates, frames: Path) -> None:
    """The shape, type 2 (plates), in the body-fixed frame.

    Args:
        path: The file to make.
        states: For the shape and its names.
        frames: The FK, which tells SPICE what the body-fixed frame is.
    """
    from swarm_mj.io.spice import furnished

    shape, code = states.plan.shape, states.body.code
    vertices, plates = shape.vertices / 1e3, np.asarray(shape.faces, np.int32) + 1
    with furnished([frames], "frames"), spice_errors(f"{path.name}", _WRITING):
        spice = spiceypy()
        workspace = 100_000 + 32 * len(plates)
        index = spice.dskmi2(
            vertices, plates, FINE_VOXELS, COARSE_VOXELS, workspace, workspace, workspace, True, 8 * workspace
        )
        low, high = spice.dskrb2(vertices, plates, 1, np.zeros(10))
        handle = spice.dskopn(str(path), "swarm_mj", 0)
        et = states.epoch / 1e9
        spice.dskw02(
            handle, code, 1, 2, states.body.frame, 1, np.zeros(10), -pi, pi, -pi / 2, pi / 2, low, high,
            et - SHAPE_SPAN_S, et + SHAPE_SPAN_S, vertices, plates, *index,
        )  # fmt: skip
        spice.dskcls(handle, True)
