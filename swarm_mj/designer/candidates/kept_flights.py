"""Candidates' flights as arrays, kept on disk, so that an interrupted design goes on where it stopped.

What they depend on: the scenario with the files that it names, the mesh, and the program. What is damaged, or was flown by
another version, is flown again; scenarios with plug-ins of others are always, for nobody knows what these depend on.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import swarm_mj
from swarm_mj import plugins
from swarm_mj.designer.candidates.flights import CandidateFlights, Unreachable, at_points, flights_of, fly_candidates
from swarm_mj.flight.environment import load_body_shape
from swarm_mj.flight.plan import as_planned, make_plan
from swarm_mj.io.arrays import Declared
from swarm_mj.io.cache import Arrays, cache_folder, hash_of, load_arrays, store_arrays
from swarm_mj.mission.trajectories import Deployment, PlannedBurn, Progress
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array

#: What all kept flights, and all sightings, together may take [bytes].
FOLDER_BYTES = 2 * 2**30
#: Of the deployment, of n candidates and perhaps the spacecraft that only communicates: m in all.
DEPLOYMENT = {
    **dict.fromkeys(("r0_N", "mothership_velocity_N"), Declared("f8", (3,))),
    **dict.fromkeys(("v0_N", "destination_N", "release_r_N", "release_mothership_v_N"), Declared("f8", ("m", 3))),
    **dict.fromkeys(("miss_m", "release_s", "arrival_s"), Declared("f8", ("m",))),
}
#: As in `CandidateFlights`.
FLOWN = {
    **dict.fromkeys(("observing", "settled"), Declared("b1", ("t", "n"))),
    **dict.fromkeys(("r_A", "v_A", "omega_C"), Declared("f8", ("t", "n", 3))),
    "C_CA": Declared("f8", ("t", "n", 3, 3)),
}
LEFT_OUT = {"left_out": Declared("i8", ("l",), 1), "why": Declared("U", ("l",))}
FLIGHTS = {
    **DEPLOYMENT,
    **FLOWN,
    **LEFT_OUT,
    "least_radius": Declared("f8", ("m",), 0.0),
    "points": Declared("i8", ("n",), 1),
    "burns": Declared("f8", ("b", 5)),
}
#: What is kept of one dispersed flight of all candidates: when each first sees each cell [s], NaN: never, and areas [m^2].
SIGHTINGS = {"first_seen_s": Declared("f8", ("n", "c"), gaps="nan"), "area": Declared("f8", ("c",), 0.0)}
#: What is kept where no point can be flown to.
NONE = {**LEFT_OUT, "refused": Declared("U")}


def fly(scenario: Scenario, progress: Progress | None = None) -> Arrays:
    """The flights to a target's visiting points as arrays: those of `FLIGHTS`, or of `NONE`; errors as of `fly_candidates`."""
    try:
        return _arrays_of(fly_candidates(scenario, progress))
    except Unreachable as error:
        return {**_left_out(error.left_out), "refused": np.array(str(error))}


def flights_from(scenario: Scenario, arrays: Arrays) -> CandidateFlights:
    """The flights that arrays stand for, bit for bit.

    Raises:
        Unreachable: No point can be flown to.
    """
    left_out = dict(zip(arrays["left_out"].tolist(), arrays["why"].tolist(), strict=True))
    if "refused" in arrays:
        raise Unreachable(str(arrays["refused"]), left_out)
    burns = tuple(PlannedBurn(int(row[0]), float(row[1]), row[2:]) for row in arrays["burns"])
    known: dict[str, Any] = {name: arrays[name] for name in DEPLOYMENT}
    there = at_points(as_planned(scenario), arrays["points"].tolist())
    plan = make_plan(there, check_separation=False, known=(Deployment(**known, burns=burns), arrays["least_radius"]))
    return flights_of(plan, left_out, **{name: arrays[name] for name in FLOWN})


def kept(scenario: Scenario) -> Arrays | None:
    """The arrays of `fly` if they are kept."""
    file = _file(scenario)
    if file is None:
        return None
    found = load_arrays(file, FLIGHTS, ("l", "b"))
    return load_arrays(file, NONE) if found is None else found


def keep(scenario: Scenario, arrays: Arrays) -> None:
    """Keep the arrays of `fly`."""
    file = _file(scenario)
    if file is not None:
        store_arrays(file, arrays, folder_bytes=FOLDER_BYTES)


def kept_sightings(scenario: Scenario) -> Arrays | None:
    """The arrays of `SIGHTINGS` of the flight of a scenario, if they are kept."""
    file = _file(scenario, "sightings")
    return None if file is None else load_arrays(file, SIGHTINGS)


def keep_sightings(scenario: Scenario, first_seen_s: Array, area: Array) -> None:
    """Keep the arrays of `SIGHTINGS`."""
    file = _file(scenario, "sightings")
    if file is not None:
        store_arrays(file, {"first_seen_s": first_seen_s, "area": area}, folder_bytes=FOLDER_BYTES)


def _arrays_of(flights: CandidateFlights) -> Arrays:
    deployment = flights.plan.deployment
    return {
        **{name: np.asarray(getattr(deployment, name)) for name in DEPLOYMENT},
        **{name: getattr(flights, name) for name in FLOWN},
        **_left_out(flights.left_out),
        "least_radius": flights.plan.least_radius,
        "points": np.array(flights.points, np.int64),
        "burns": np.array([(b.spacecraft, b.t, *b.delta_v_N) for b in deployment.burns]).reshape(-1, 5),
    }


def _left_out(why: dict[int, str]) -> Arrays:
    return {"left_out": np.array(list(why), np.int64), "why": np.array(list(why.values()), np.str_)}


def _file(scenario: Scenario, folder: str = "flights") -> Path | None:
    """Where the flights of a scenario are kept; None: nowhere."""
    if not _is_known(scenario):
        return None
    shape, told = load_body_shape(scenario.body), scenario.model_dump(mode="json")
    files = [f"{path} {path.stat().st_size} {path.stat().st_mtime_ns}" for path in files_in(told)]
    key = hash_of(_program(), json.dumps(told, sort_keys=True), *files, shape.vertices, shape.faces)
    return cache_folder() / folder / f"{key}.npz"


def _is_known(scenario: Scenario) -> bool:
    bodies = [scenario.body, *([scenario.companion.body] if scenario.companion else [])]
    named = [
        *((plugins.GRAVITY, body.gravity.model) for body in bodies),
        (plugins.BEHAVIORS, scenario.behavior.name),
        (plugins.CONTROLLERS, scenario.control.controller),
    ]
    return all(plugins.find(group, name).__module__.startswith("swarm_mj.") for group, name in named)


def files_in(told: Any) -> Iterator[Path]:
    """The files whose absolute paths stand somewhere in a scenario."""
    for value in told.values() if isinstance(told, dict) else told if isinstance(told, list) else ():
        if isinstance(value, str) and os.path.isfile(value):
            yield Path(value)
        else:
            yield from files_in(value)


@cache
def _program() -> str:
    """Versions of what flies, and when its sources were changed last."""
    from importlib.metadata import PackageNotFoundError, version

    libraries = [f"{name} {version(name)}" for name in ("numpy", "scipy", "numba", "mujoco", "trimesh")]
    with suppress(PackageNotFoundError):  # embreex has no wheels for some machines
        libraries.append(f"embreex {version('embreex')}")
    newest = max(path.stat().st_mtime_ns for path in Path(swarm_mj.__file__).parent.rglob("*.py"))
    return " ".join([swarm_mj.__version__, *libraries, str(newest)])
