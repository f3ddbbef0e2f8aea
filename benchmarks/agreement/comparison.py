"""Differences of the answers from the flight, one row for each program and quantity: the largest over flight and spacecraft."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.agreement.flights import Flown, attitudes_E
from swarm_mj.spacecraft.attitude.mrp import dcm, mrp_from_quaternion
from swarm_mj.tracks.frames import C_EN

Array = NDArray[np.float64]
Answers = dict[str, dict[str, Array]]
Row = dict[str, Any]
MICRO: Final = 1e6


def angle(C: Array, other: Array) -> float:
    """The largest angle between rotations, shapes (..., 3, 3) [rad]; accurate where it is small."""
    chord = np.linalg.norm(np.asarray(C) - np.asarray(other), axis=(-2, -1)) / np.sqrt(8.0)
    return float(2.0 * np.arcsin(np.minimum(1.0, chord)).max())


def distance(r: Array, other: Array) -> float:
    """The largest distance, shapes (..., 3) [m]."""
    return float(np.linalg.norm(np.asarray(r) - np.asarray(other), axis=-1).max())


def direction(r: Array, other: Array) -> float:
    """The largest angle between vectors, shapes (k, 3) [rad]."""
    cross = np.linalg.norm(np.cross(r, other), axis=-1)
    return float(np.arctan2(cross, np.sum(r * other, axis=-1)).max())


def rotations(q: Array) -> Array:
    """Matrices of quaternions (w, x, y, z), shape (..., 4) to (..., 3, 3)."""
    return np.asarray(dcm(mrp_from_quaternion(q)))


def compare(flown: Flown, answers: Answers) -> list[Row]:
    """All rows of a flight, `{program, quantity, unit, difference}` and `from_scipy` for paths."""
    rows = []
    for program, answer in answers.items():
        for part in (_path, _turning, _frames, _attitude, _messages, _kernels, _surroundings, _clock):
            for quantity, unit, value in part(flown, answer):
                rows.append({"program": program, "quantity": quantity, "unit": unit, "difference": float(value)})
                if quantity == "path" and program != "scipy" and "scipy" in answers:
                    rows[-1]["from_scipy"] = distance(answer["path"][..., :3], answers["scipy"]["path"][..., :3])
    return rows


Found = Iterator[tuple[str, str, float]]


def _path(flown: Flown, answer: dict[str, Array]) -> Found:
    if "path" in answer:
        ours = flown.states.states_E[:: flown.stride]
        yield "path", "m", distance(answer["path"][..., :3], ours[..., :3])
        yield "velocity", "um/s", MICRO * distance(answer["path"][..., 3:], ours[..., 3:])


def _turning(flown: Flown, answer: dict[str, Array]) -> Found:
    environment = flown.states.plan.environment
    ours = np.array([environment.C_AN(t) @ C_EN.T for t in flown.turn_times])
    for which in ("exported", "published"):
        if f"C_AE_{which}" in answer:
            yield f"rotation {which}", "urad", MICRO * angle(answer[f"C_AE_{which}"], ours)


def _frames(flown: Flown, answer: dict[str, Array]) -> Found:
    for key, value in answer.items():
        if key.startswith("C_EN"):
            yield "ecliptic" + key[4:].replace("_", " ", 1).replace("_", " "), "urad", MICRO * angle(value, C_EN)
    if "C_EI" in answer:
        yield "ICRF for EME2000", "urad", MICRO * angle(answer["C_EI"], np.eye(3))


def _attitude(flown: Flown, answer: dict[str, Array]) -> Found:
    if "q_BN" in answer:
        telemetry = flown.states.telemetry
        ours = dcm(telemetry["sigma_BN"].values[:, 0])
        yield "attitude", "urad", MICRO * angle(rotations(answer["q_BN"]), ours)
        yield "wheel speed", "rad/s", np.abs(answer["wheel_speed"] - telemetry["wheel_speed"].values[:, 0]).max()


def _messages(flown: Flown, answer: dict[str, Array]) -> Found:
    states = flown.states
    for key, name in (("oem", "OEM 2.0"), ("oem3", "OEM 3.0")):
        if key in answer:
            yield f"file {name}", "m", distance(answer[key][..., :3], states.states_E[..., :3])
        if f"{key}_times" in answer:
            yield f"times of the {name}", "us", MICRO * np.abs(answer[f"{key}_times"] - states.times).max()
    for key, name in (("aem_q_BE", "file AEM 1.0"), ("aem3_q_BE", "file AEM 2.0")):
        if key in answer:
            yield name, "urad", MICRO * angle(rotations(answer[key]), attitudes_E(states))


def _kernels(flown: Flown, answer: dict[str, Array]) -> Found:
    states = flown.states
    if "spk" in answer:
        yield "file SPK", "m", distance(answer["spk"][..., :3], states.states_E[..., :3])
        yield "file CK", "urad", MICRO * angle(answer["ck_C_BE"], attitudes_E(states))
        shape = states.plan.shape
        yield "file DSK, vertices", "m", distance(answer["vertices"], shape.vertices)
        yield (
            "file DSK, plates that differ",
            "",
            np.sum(np.any(answer["plates"] != np.asarray(shape.faces) + 1, axis=1)),
        )


def _surroundings(flown: Flown, answer: dict[str, Array]) -> Found:
    environment, times = flown.states.plan.environment, flown.turn_times
    sun = np.array([environment.sun.at(t) for t in times]) @ C_EN.T
    earth = np.array([environment.earth.at(t) for t in times]) @ C_EN.T
    if "sun_from_body" in answer:
        theirs = answer["sun_from_body"]
        yield "Sun from the body", "m", distance(theirs, sun)
        yield "Sun from the body, direction", "urad", MICRO * direction(theirs, sun)
        yield "Earth from the Sun", "m", distance(answer["earth_from_sun"], earth - sun)
        yield "Earth from the body, direction", "urad", MICRO * direction(theirs + answer["earth_from_sun"], earth)
    if "sun_from_body_kepler" in answer:
        yield "Sun from the body, Kepler, at the epoch", "m", distance(answer["sun_from_body_kepler"][0], sun[0])
        yield "Sun from the body, Kepler", "m", distance(answer["sun_from_body_kepler"], sun)


def _clock(flown: Flown, answer: dict[str, Array]) -> Found:
    if "utc_s" in answer:
        yield "UTC of the epoch", "us", MICRO * abs(float(answer["utc_s"]))


def rounding(flown: Flown) -> Array:
    """What rounding alone does to positions, in E, shape (t, n, 3) [m], at the samples at which paths are compared.

    The flight's own velocities are summed step by step in double precision, as the flight does, and in extended precision.
    """
    states, step = flown.states, flown.states.plan.scenario.physics.timestep_s
    n = round(states.times[-1] / step)
    middle, at = (np.arange(n) + 0.5) * step, np.round(states.times[:: flown.stride] / step).astype(np.int64)
    out = []
    for state in np.swapaxes(states.states_N, 0, 1):
        velocity = np.stack([np.interp(middle, states.times, state[:, 3 + k]) for k in range(3)], axis=1)
        terms = np.vstack([state[0, :3], step * velocity])
        # cumsum adds one after the other.
        off = np.cumsum(terms, axis=0) - np.cumsum(terms.astype(np.longdouble), axis=0)
        out.append(off[at].astype(np.float64) @ C_EN.T)
    return np.stack(out, axis=1)


def rounded(flown: Flown, answers: Answers) -> dict[str, float]:
    """The most that rounding alone does to the path, and the distance from SciPy without it [m]."""
    error = rounding(flown)
    out = {"rounding_m": distance(error, 0.0)}
    if "scipy" in answers:
        ours = flown.states.states_E[:: flown.stride][..., :3]
        out["without_rounding_m"] = distance(ours - error, answers["scipy"]["path"][..., :3])
    return out
