"""A flight that was flown elsewhere, by its files: brought to the instants of pictures, which are judged as ours are.

A picture is taken at the scenario's instants by every spacecraft that is inside the imaging radius and of which the files know
where it is and how it is turned. Without attitudes the camera points at the body's centre (`nadir`) or at the target's
(`target`), with the picture's right perpendicular to the body's spin axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import xarray as xr

from swarm_mj.errors import InteropError
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.flight.observe import arrival_samples
from swarm_mj.flight.targets import target_from, true_target
from swarm_mj.io.times import SECOND, epoch_of, text_of
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.observation.camera import look_at
from swarm_mj.scenarios.bodies import packaged_body
from swarm_mj.scenarios.itinerary import itinerary
from swarm_mj.scenarios.loading import body_of_file
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.smallbody.naif import BodyName
from swarm_mj.smallbody.shape_io import READERS
from swarm_mj.smallbody.solid_angle import points_inside
from swarm_mj.spacecraft.attitude.mrp import mrp_from_quaternion, quaternions
from swarm_mj.tracks.ccsds_in import read_aem, read_oem
from swarm_mj.tracks.track import Track
from swarm_mj.typing import Array, Ints, Mask

Pointing = Literal["nadir", "target"]
POINTINGS: Final = ("nadir", "target")
#: Time between pictures of a flight that has no scenario [s], where it is long enough; the imaging region then has no end.
INTERVAL_S, ANYWHERE_M = 10.0, 1e15
#: Longest flight that is judged without a scenario [s].
LONGEST_S = 30 * 86_400.0


def read_tracks(oem: Sequence[Path], aem: Sequence[Path], body: str) -> tuple[list[Track], list[Track]]:
    """Paths and attitudes from files, one OEM a spacecraft and as many AEM in the same order or none, about a body by name.

    Raises:
        InteropError: A file is refused, or the files do not belong together.
    """
    if not oem:
        raise InteropError("oem = []: give at least one OEM (--oem FILE)")
    if aem and len(aem) != len(oem):
        raise InteropError(f"{len(oem)} OEM and {len(aem)} AEM: give one AEM for each OEM, in the same order, or none")
    paths = [read_oem(path, BodyName.of(body)) for path in oem]
    attitudes = [read_aem(path) for path in aem]
    for path, attitude in zip(paths, attitudes, strict=False):
        if path.name != attitude.name:
            raise InteropError(
                f"{attitude.source}: OBJECT_NAME = {attitude.name}, but {path.source} is of {path.name}; give the AEM in the "
                "order of the OEM"
            )
    return paths, attitudes


def body_section(name: str) -> dict[str, Any]:
    """The section `body` of a packaged body, of a YAML file with its keys, or of a shape file alone.

    Raises:
        InteropError: There is none of that name.
        ScenarioError: The file cannot be read.
    """
    path = Path(name)
    if path.suffix.lower() in (".yaml", ".yml"):
        return body_of_file(path)
    if path.suffix.lower() in READERS:
        # Nothing flies here, so that no gravity is asked for; the schema wants some.
        return {"name": path.stem, "shape": name, "gravity": {"model": "point_mass", "parameters": {"gm": 1.0}}}
    try:
        return packaged_body(name)
    except ValueError as error:
        raise InteropError(
            f"body {error}; for one of your own give its shape or YAML file, or a scenario (--scenario FILE)"
        ) from None


def scenario_of(paths: Sequence[Track], body: dict[str, Any]) -> dict[str, Any]:
    """A scenario that covers what the files have in common: from the last beginning to the first end.

    Raises:
        InteropError: They have nothing in common, or too much.
    """
    first, last = max(path.first for path in paths), min(path.last for path in paths)
    begin = -(-first // 1000) * 1000  # a scenario's epoch has microseconds
    length = (last - begin) / SECOND
    if not 1.0 <= length <= LONGEST_S:
        raise InteropError(
            f"{', '.join(path.source for path in paths)}: have {max(length, 0.0):g} s in common, from {text_of(first)} to "
            f"{text_of(last)} TDB; between 1 and {LONGEST_S:g} s can be judged: give files of the same time, or a scenario"
        )
    interval = INTERVAL_S if length >= INTERVAL_S else 1.0
    duration = length // interval * interval
    return {
        "name": "observed",
        "description": "flown elsewhere",
        "epoch": text_of(begin),
        "duration_s": duration,
        "body": body,
        # The arrival is the closest approach of the first spacecraft.
        "design": {
            "visiting_points": [1] * len(paths),
            "time_of_flight_s": _closest(paths[0], begin, duration, interval),
        },
        "behavior": {"imaging_radius_m": ANYWHERE_M},
        "telemetry": {"interval_s": interval},
        "observation": {"criterion": "passage", "interval_s": interval},
    }


def _closest(path: Track, begin: int, duration: float, interval: float) -> float:
    times = np.arange(1, round(duration / interval) + 1) * interval
    r, known = path.at(begin + np.round(times * SECOND).astype(np.int64))
    return float(times[np.argmin(np.where(known, np.linalg.norm(r, axis=1), np.inf))])


class ForeignFlight:
    """What is judged: files of paths and attitudes at the instants of a scenario's telemetry.

    Args:
        scenario: Body, target, camera, criterion, epoch and duration.
        paths: Of the spacecraft.
        attitudes: As many, or none: then `pointing`.
        pointing: Where the cameras look without attitudes.

    Attributes:
        scenario: As given.
        shape: The body's mesh in A [m].
        environment: Rotation and Sun.
        region: The target.
        names: Of the spacecraft, as their files have them.
        n: Number of spacecraft, all of which are observers.
        times: Of the samples past the epoch [s], shape (t,).
        ns: The same in nanoseconds of TDB past J2000.
        C_AN: Rotations from N to A then, shape (t, 3, 3).
        telemetry: `time`, `r_BN_N`, `sigma_BN`, and in `mode` and `camera_on` who may take a picture.
        notes: What was assumed, one sentence each.

    Raises:
        InteropError: The files do not cover the time of the scenario, or fly through its body.
    """

    def __init__(
        self, scenario: Scenario, paths: Sequence[Track], attitudes: Sequence[Track], pointing: Pointing = "nadir"
    ) -> None:
        _check_asked(scenario, pointing)
        self.scenario, self.shape = scenario, load_body_shape(scenario.body)
        self.environment = environment_from(scenario, self.shape)
        self.region = true_target(scenario, self.shape, target_from(scenario, self.shape))
        self.names = _different([path.name for path in paths])
        _check_number(scenario, self.names)
        self.n = self.n_observers = len(self.names)
        interval = scenario.telemetry.interval_s
        self.times: Array = interval * np.arange(round(scenario.duration_s / interval) + 1, dtype=np.float64)
        self.ns: Ints = epoch_of(scenario.epoch) + np.round(self.times * SECOND).astype(np.int64)
        self.C_AN = np.array([self.environment.C_AN(t) for t in self.times.tolist()])
        poses = [_poses(self, path, pointing, *attitudes[j : j + 1]) for j, path in enumerate(paths)]
        self.telemetry = self._telemetry(poses)
        if scenario.observation.criterion == "arrival":
            _check_arrival(self, paths)
        assumed = [note for track in (*paths, *attitudes) for note in track.notes]
        if not attitudes:
            words = "the body's centre (nadir)" if pointing == "nadir" else "the target's centre"
            assumed.append(
                f"no attitudes were given: the cameras point at {words}, the picture's right across the body's spin axis"
            )
        unknown = (note for path, one in zip(paths, poses, strict=True) for note in _notes(self, path, one))
        self.notes = (*assumed, *unknown)

    def _telemetry(self, poses: Sequence[Poses]) -> xr.Dataset:
        place = ("time", "spacecraft")
        known = np.stack([one.known for one in poses], axis=1)
        r_BN_N, q_BN = (np.stack([getattr(one, name) for one in poses], axis=1) for name in ("r_BN_N", "q_BN"))
        who = known & (np.linalg.norm(r_BN_N, axis=2) <= self.scenario.behavior.imaging_radius_m)
        mode = np.where(who, int(TargetKind.ASTEROID), int(TargetKind.EARTH)).astype(np.int8)
        return xr.Dataset(
            {
                "r_BN_N": ((*place, "xyz"), r_BN_N, {"units": "m", "frame": "N"}),
                "sigma_BN": ((*place, "xyz"), mrp_from_quaternion(q_BN), {"units": "1", "frame": "B relative to N"}),
                "mode": (place, mode, {"units": "1", "frame": "none"}),
                "camera_on": (place, who.astype(np.int8), {"units": "1", "frame": "none"}),
            },
            {"time": ("time", self.times, {"units": "s"})},
        )


class Poses(NamedTuple):
    """Where a spacecraft is and how it is turned at the instants of a flight; rest and no turn where that is not known.

    Attributes:
        r_BN_N: Positions [m], shape (t, 3).
        q_BN: Euler parameters (w, x, y, z), shape (t, 4).
        known: Where both are known, shape (t,).
    """

    r_BN_N: Array
    q_BN: Array
    known: Mask


def _check_asked(scenario: Scenario, pointing: Pointing) -> None:
    if pointing not in POINTINGS:
        raise InteropError(f"pointing = {pointing!r}: must be {' or '.join(POINTINGS)}")
    observation = scenario.observation
    asked = [f"max_motion_blur_px = {limit:g}" for limit in (observation.max_motion_blur_px,) if limit is not None]
    asked += [f"classes: {each.name}" for each in observation.classes if "max_motion_blur_px" in each.needs]
    if asked:
        raise InteropError(
            f"observation.{asked[0]}: motion blur needs velocities and body rates, and of a flight from files only places and "
            "attitudes are read; ask for no max_motion_blur_px"
        )


def _check_number(scenario: Scenario, names: Sequence[str]) -> None:
    if len(names) > (n := len(itinerary(scenario))):
        raise InteropError(
            f"{len(names)} spacecraft are given ({', '.join(names)}), and the scenario has {n} observers, whose arrivals it "
            "knows: name as many (--spacecraft), or leave out the files of the others, as of a dedicated relay"
        )


def _poses(flight: ForeignFlight, path: Track, pointing: Pointing, attitude: Track | None = None) -> Poses:
    r, known = path.at(flight.ns)
    _check_window(flight, path, known)
    r = np.where(known[:, None], r, 0.0)
    r_A = np.einsum("tij,tj->ti", flight.C_AN, r)
    _check_outside(flight, path, r_A, known)
    if attitude is None:
        aim_A = flight.region.centroid_A.mean(axis=0) if pointing == "target" else np.zeros(3)
        return Poses(r, _pointed(r_A, flight.C_AN, aim_A, known), known)
    q, turned = attitude.at(flight.ns)
    _check_window(flight, attitude, turned)
    return Poses(r, np.where(turned[:, None], q, [1.0, 0.0, 0.0, 0.0]), known & turned)


def _check_window(flight: ForeignFlight, track: Track, known: Mask) -> None:
    if not known.any():
        first, last = (text_of(int(flight.ns[k])) for k in (0, -1))
        raise InteropError(
            f"{track.source}: covers {text_of(track.first)} to {text_of(track.last)} TDB and nothing of the flight, "
            f"{first} to {last}; set epoch and duration_s of the scenario, or leave the scenario out"
        )


def _check_outside(flight: ForeignFlight, path: Track, r_A: Array, known: Mask) -> None:
    """Nobody takes pictures from inside the body: then the file means another centre, frame, unit or time."""
    shape = flight.shape
    near = np.flatnonzero(known & (np.linalg.norm(r_A, axis=1) <= shape.max_radius))
    if near.size and (inside := points_inside(r_A[near], shape.vertices, shape.faces)).any():
        instant = text_of(int(flight.ns[near[np.argmax(inside)]]))
        raise InteropError(
            f"{path.source}: lies inside {shape.name} at {instant} TDB; check CENTER_NAME, REF_FRAME, TIME_SYSTEM and that "
            "lengths are km"
        )


def _check_arrival(flight: ForeignFlight, paths: Sequence[Track]) -> None:
    """Somebody takes the one picture that counts: each its own, at its own arrival."""
    k = arrival_samples(flight.scenario)[: flight.n]
    if not flight.telemetry["camera_on"].values[k, np.arange(flight.n)].any():
        instants = ", ".join(text_of(int(ns)) for ns in np.unique(flight.ns[k]))
        raise InteropError(
            f"observation.criterion = arrival: at the arrival, {instants} TDB, none of "
            f"{', '.join(path.source for path in paths)} is known or in the imaging region; set design.time_of_flight_s, or "
            "observation.criterion=passage"
        )


def _notes(flight: ForeignFlight, path: Track, poses: Poses) -> list[str]:
    if poses.known.all():
        return []
    missing = timedelta(seconds=float((~poses.known).sum() * flight.scenario.telemetry.interval_s))
    return [f"{path.name}: nothing is known of {missing} of the flight, in which it takes no pictures"]


def _pointed(r_A: Array, C_AN: Array, aim_A: Array, known: Mask) -> Array:
    """Euler parameters of cameras that look at a point of the body, shape (t, 4)."""
    C_BN = np.tile(np.eye(3), (len(r_A), 1, 1))
    for k in np.flatnonzero(known):
        C_BN[k] = look_at(r_A[k], aim_A).C_CA @ C_AN[k]
    return quaternions(C_BN)


def _different(names: Sequence[str]) -> tuple[str, ...]:
    """Names of spacecraft, numbered where several have the same."""
    if len(set(names)) == len(names):
        return tuple(names)
    return tuple(f"{name}_{j + 1}" for j, name in enumerate(names))
