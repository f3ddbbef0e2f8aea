"""SPICE kernels of a flight: text kernels, and paths (SPK), attitudes (CK) and the shape (DSK), written by SPICE itself.

Text: leap seconds, clock, constants of the body, frames, cameras, and the meta-kernel, by SPICE's required reading (KERNEL,
TIME, SCLK, PCK, FRAMES) and the documents of GETFOV. SPK and CK are in ECLIPJ2000, which is N: no number is turned on its
way. Lengths are in km.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan, atan2, degrees, hypot, pi
from pathlib import Path
from typing import Any

import numpy as np

from swarm_mj.interop.states import CLOCK, FIRST_SPACECRAFT, FlightStates
from swarm_mj.io.spice import furnished, spice_errors, spiceypy
from swarm_mj.io.times import EB, M0, M1, TT_TAI, K, leap_seconds
from swarm_mj.scenarios.constants import DAY
from swarm_mj.smallbody.companion import Companion
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.rotation import spin_dcm
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.spacecraft.mounting import true_mount
from swarm_mj.tracks.frames import C_EN
from swarm_mj.typing import Array

#: Ticks of the spacecraft clock in a second; its most significant field counts seconds of TDB past the scenario's epoch.
TICKS_PER_SECOND = 1_000_000
#: Frames numbered from here on are left to users.
USER_FRAMES, USER_FRAMES_COUNT = 1_400_000, 600_000
#: Hermite's polynomials through states of so many samples.
SPK_WINDOW = 4
#: The Sun's and the Earth's straight lines go on for so long before and after the flight, for light time [s].
MARGIN_S = 86_400.0
#: Between the states of a companion [s].
COMPANION_STEP_S = 10.0
BARYCENTRE, SUN, EARTH = 0, 10, 399
#: Time for which the shape is said to hold, before and after the epoch [s]: 50 years.
SHAPE_SPAN_S = 50 * 365.25 * 86_400.0
#: Of the voxels that SPICE sorts plates into: fine ones as many times larger than a plate, coarse ones than fine ones.
FINE_VOXELS, COARSE_VOXELS = 5.0, 4
_WRITING = "SPICE could not write it; export again into another folder"


def spacecraft_code(j: int) -> int:
    """NAIF's number of spacecraft j."""
    return FIRST_SPACECRAFT - j


def body_frame_code(j: int) -> int:
    """Number of the frame B of spacecraft j, and of its structure in the C-kernel."""
    return 1000 * spacecraft_code(j)


def spacecraft_name(states: FlightStates, j: int) -> str:
    """SPICE's name of spacecraft j."""
    return f"SWARM_{states.plan.names[j].upper()}"


def _kernel(kind: str, comments: Sequence[str], values: Mapping[str, object]) -> str:
    """A text kernel of some kind with comments and variables."""
    lines = [f"KPL/{kind}", "", *comments, "", "\\begindata", ""]
    for name, value in values.items():
        items = value if isinstance(value, list | tuple | np.ndarray) else [value]
        shown = [_shown(item) for item in items]
        operator = "+=" if name.startswith(("NAIF_BODY_", "KERNELS_TO_LOAD")) else "="
        if len(shown) == 1:
            lines.append(f"   {name} {operator} ( {shown[0]} )")
        else:
            lines += [f"   {name} {operator} (", *(f"      {item}" for item in shown), "   )"]
    return "\n".join([*lines, "", "\\begintext", ""])


def _shown(item: object) -> str:
    if isinstance(item, str):
        return item if item.startswith("@") else f"'{item}'"
    return str(int(item)) if isinstance(item, int | np.integer) else repr(float(item))  # type: ignore[arg-type]


def leapseconds(states: FlightStates) -> str:
    """LSK: leap seconds as ERFA has them."""
    deltas: list[object] = []
    for day, count in leap_seconds().items():
        deltas += [count, f"@{day.strftime('%Y-%b-%d').upper()}"]
    values = {
        "DELTET/DELTA_T_A": TT_TAI,
        "DELTET/K": K,
        "DELTET/EB": EB,
        "DELTET/M": [M0, M1],
        "DELTET/DELTA_AT": deltas,
    }
    return _kernel("LSK", ["Leap seconds by IERS Bulletin C; any kernel of NAIF says the same."], values)


def clock(states: FlightStates) -> str:
    """SCLK: one clock for all spacecraft, seconds of TDB past the epoch and millionths of them."""
    suffix = -CLOCK
    values = {
        "SCLK_KERNEL_ID": f"@{states.plan.scenario.epoch[:10]}",
        f"SCLK_DATA_TYPE_{suffix}": 1,
        f"SCLK01_TIME_SYSTEM_{suffix}": 1,
        f"SCLK01_N_FIELDS_{suffix}": 2,
        f"SCLK01_MODULI_{suffix}": [10_000_000_000, TICKS_PER_SECOND],
        f"SCLK01_OFFSETS_{suffix}": [0, 0],
        f"SCLK01_OUTPUT_DELIM_{suffix}": 1,
        f"SCLK_PARTITION_START_{suffix}": 0.0,
        f"SCLK_PARTITION_END_{suffix}": 9.0e15,
        f"SCLK01_COEFFICIENTS_{suffix}": [0.0, states.epoch / 1e9, 1.0],
    }
    return _kernel("SCLK", [*states.comments, "Clock 0 is the scenario's epoch; it runs with TDB."], values)


def body_constants(states: FlightStates) -> str:
    """PCK: pole, rotation, size and gravity of the body, as they were flown."""
    code, environment = states.body.code, states.plan.environment
    values = _constants(code, environment, _radii_km(states.plan.scenario.body.semi_axes_m, states.plan.shape), states)
    asked, companion = states.plan.scenario.companion, environment.companion
    if asked is not None and companion is not None and states.companion is not None:
        radii = _radii_km(asked.body.semi_axes_m, companion.shape)
        values |= _constants(states.companion.code, companion, radii, states)
    note = (
        "Pole and prime meridian reproduce the flight's rotation in SPICE's frames: they differ from the scenario's by the",
        "rounding of the obliquity, 0.04 arcsec. Radii are half the extents of the shape along the axes of A.",
    )
    return _kernel("PCK", [*states.comments, *note], values)


def _constants(
    code: int, body: Environment | Companion, radii_km: np.ndarray, states: FlightStates
) -> dict[str, object]:
    """Of one body; one that is locked is turned by a frame of its own."""
    values: dict[str, object] = {f"BODY{code}_RADII": radii_km.tolist()}
    if not (isinstance(body, Companion) and body.locked):
        ra, dec, w0 = rotation_constants(states, body)
        values |= {
            f"BODY{code}_POLE_RA": [ra, 0.0, 0.0],
            f"BODY{code}_POLE_DEC": [dec, 0.0, 0.0],
            f"BODY{code}_PM": [w0, degrees(body.spin_rate) * DAY, 0.0],
        }
    gm = getattr(body.gravity, "gm", None)
    if gm is not None:
        values[f"BODY{code}_GM"] = float(gm) / 1e9
    return values


def rotation_constants(states: FlightStates, body: Environment | Companion | None = None) -> tuple[float, float, float]:
    """Right ascension and declination of the pole and W at J2000 [deg] that give the flight's rotation C_AN in SPICE.

    Of the body; or of its companion.
    """
    environment = body or states.plan.environment
    C_AE = spin_dcm(np.ascontiguousarray(environment.C_PN), float(environment.phase0)) @ C_EN.T
    x, y, z = C_AE[2]
    ra, dec = degrees(atan2(y, x)) % 360.0, degrees(atan2(z, hypot(x, y)))
    # C_AE = R3(W) R1(90 - dec) R3(90 + ra): its last column is sin(90 - dec) (sin W, cos W, .).
    w = (
        degrees(atan2(C_AE[0, 2], C_AE[1, 2]))
        if hypot(x, y) > 1e-12
        else degrees(atan2(C_AE[0, 1], C_AE[0, 0])) - 90 - ra
    )
    days = states.epoch / 1e9 / DAY
    return ra, dec, (w - degrees(environment.spin_rate) * DAY * days) % 360.0


def _radii_km(axes: tuple[float, ...] | None, shape: ShapeModel) -> np.ndarray:
    return np.array(axes if axes is not None else np.ptp(shape.vertices, axis=0) / 2.0) / 1e3


def frames(states: FlightStates) -> str:
    """FK: names and numbers of body, spacecraft and cameras, and their frames."""
    body = states.body
    fixed = USER_FRAMES + body.code % USER_FRAMES_COUNT
    names, codes = [body.name], [body.code]
    if states.companion is not None:
        names, codes = [*names, states.companion.name], [*codes, states.companion.code]
    for j in range(states.plan.n):
        names += [spacecraft_name(states, j), f"{spacecraft_name(states, j)}_CAMERA"]
        codes += [spacecraft_code(j), body_frame_code(j) - 1]
    values: dict[str, object] = {"NAIF_BODY_NAME": names, "NAIF_BODY_CODE": codes}
    values |= _frame(body.frame, fixed, kind=2, code=body.code, center=body.code)
    values[f"OBJECT_{body.code}_FRAME"] = body.frame
    values |= _companion_frame(states)
    for j in range(states.plan.n):
        code = body_frame_code(j)
        name = f"{spacecraft_name(states, j)}_BODY"
        values |= _frame(name, code, kind=3, code=code, center=spacecraft_code(j))
        values |= {f"CK_{code}_SCLK": CLOCK, f"CK_{code}_SPK": spacecraft_code(j)}
    note = "The body-fixed frame is A of swarm_mj; frames ..._BODY are B, whose +z the camera looks along."
    return _kernel("FK", [*states.comments, note], values)


def _companion_frame(states: FlightStates) -> dict[str, object]:
    """Its body-fixed frame A2: by its constants, or by the line to the body and the velocity where it is locked."""
    name, companion = states.companion, states.plan.environment.companion
    if name is None or companion is None:
        return {}
    number = USER_FRAMES + name.code % USER_FRAMES_COUNT
    if number == USER_FRAMES + states.body.code % USER_FRAMES_COUNT:
        number += 1
    values: dict[str, object] = {f"OBJECT_{name.code}_FRAME": name.frame}
    if not companion.locked:
        return values | _frame(name.frame, number, kind=2, code=name.code, center=name.code)
    seen = {"OBSERVER": name.name, "TARGET": states.body.name, "ABCORR": "NONE"}
    values |= _frame(name.frame, number, kind=5, code=number, center=name.code)
    values |= {
        f"FRAME_{number}_RELATIVE": "J2000",
        f"FRAME_{number}_DEF_STYLE": "PARAMETERIZED",
        f"FRAME_{number}_FAMILY": "TWO-VECTOR",
        f"FRAME_{number}_PRI_AXIS": "X",
        f"FRAME_{number}_PRI_VECTOR_DEF": "OBSERVER_TARGET_POSITION",
        f"FRAME_{number}_SEC_AXIS": "Y",
        f"FRAME_{number}_SEC_VECTOR_DEF": "OBSERVER_TARGET_VELOCITY",
        f"FRAME_{number}_SEC_FRAME": "J2000",
    }
    return values | {f"FRAME_{number}_{axis}_{key}": value for axis in ("PRI", "SEC") for key, value in seen.items()}


def _frame(name: str, number: int, *, kind: int, code: int, center: int) -> dict[str, object]:
    return {
        f"FRAME_{name}": number,
        f"FRAME_{number}_NAME": name,
        f"FRAME_{number}_CLASS": kind,
        f"FRAME_{number}_CLASS_ID": code,
        f"FRAME_{number}_CENTER": center,
    }


def cameras(states: FlightStates) -> str:
    """IK: field of view of every camera."""
    camera, values, C_CB = states.camera, dict[str, object](), true_mount(states.plan.scenario.camera)
    across, down = (
        camera.half_angle_deg if side == 1.0 else degrees(atan(camera.tan_half_angle * side)) for side in camera.sides
    )
    samples, lines = states.plan.scenario.camera.detector_px or (camera.resolution_px, camera.resolution_px)
    for j in range(states.plan.n):
        prefix = f"INS{body_frame_code(j) - 1}"
        values |= {
            f"{prefix}_FOV_FRAME": f"{spacecraft_name(states, j)}_BODY",
            f"{prefix}_FOV_SHAPE": "RECTANGLE" if camera.shape == "square" else "CIRCLE",
            f"{prefix}_FOV_CLASS_SPEC": "ANGLES",
            f"{prefix}_BORESIGHT": C_CB[2].tolist(),
            f"{prefix}_FOV_REF_VECTOR": C_CB[0].tolist(),
            f"{prefix}_FOV_REF_ANGLE": across,
            f"{prefix}_FOV_ANGLE_UNITS": "DEGREES",
            f"{prefix}_PIXEL_SAMPLES": samples,
            f"{prefix}_PIXEL_LINES": lines,
        }
        if camera.shape == "square":
            values[f"{prefix}_FOV_CROSS_ANGLE"] = down
    notes = ["Half-angles from the line of sight to the middle of a picture's edge; x to the right, y down."]
    if states.plan.scenario.camera.gimbal is not None:
        notes.append("The gimbal stands at its angle 0 here; no kernel turns it.")
    return _kernel("IK", [*states.comments, *notes], values)


def meta_kernel(states: FlightStates, names: Sequence[str]) -> str:
    """Meta-kernel: loads the others, from their own folder."""
    note = "Load it from the folder that it lies in, or put that folder's path into PATH_VALUES."
    values = {
        "PATH_VALUES": ["."],
        "PATH_SYMBOLS": ["HERE"],
        "KERNELS_TO_LOAD": [f"$HERE/{name}" for name in names],
    }
    return _kernel("MK", [*states.comments, note], values)


def write_spk(path: Path, states: FlightStates) -> None:
    """Paths of all spacecraft relative to the body, type 13 (Hermite, unequal steps)."""
    spice = spiceypy()
    with spice_errors(f"{path.name}", _WRITING):
        handle = spice.spkopn(str(path), "swarm_mj", 0)
        for j in range(states.plan.n):
            who = (spacecraft_code(j), states.body.code, spacecraft_name(states, j))
            flown = states.flown(j)
            _add_states(spice, handle, who, states.et[flown], states.states_N[flown, j] / 1e3)
        _add_companion(spice, handle, states)
        spice.spkcls(handle)


def _add_companion(spice: Any, handle: int, states: FlightStates) -> None:
    """The path of the companion relative to the body."""
    name, companion = states.companion, states.plan.environment.companion
    if name is None or companion is None:
        return
    times = np.linspace(0.0, states.times[-1], 2 + int(states.times[-1] / COMPANION_STEP_S))
    found = np.array([np.concatenate(companion.path.state(t)) for t in times.tolist()])
    _add_states(spice, handle, (name.code, states.body.code, name.name), states.epoch / 1e9 + times, found / 1e3)


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
        for j in range(states.plan.n):
            code, name, flown = body_frame_code(j), spacecraft_name(states, j), states.flown(j)
            at = ticks[flown]
            spice.ckw03(
                handle, at[0], at[-1], code, "ECLIPJ2000", True, name, len(at), at,
                np.ascontiguousarray(q[flown, j]), np.ascontiguousarray(omega_N[flown, j]), 1, [at[0]],
            )  # fmt: skip
        spice.ckcls(handle)


def write_dsk(path: Path, states: FlightStates, shape: ShapeModel | None = None) -> None:
    """A shape, type 2 (plates), in the body-fixed frame, of which SPICE is told by the FK `swarm.tf` beside the file.

    None: the body's as it was given, not cut at the target.
    """
    shape, code = shape or states.plan.shape, states.body.code
    vertices, plates = shape.vertices / 1e3, np.asarray(shape.faces, np.int32) + 1
    with furnished([path.with_name("swarm.tf")], "frames"), spice_errors(f"{path.name}", _WRITING):
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
