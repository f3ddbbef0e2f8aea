"""The flybys of the catalogue as scenarios, and the ways that lead past their targets.

Lengths go with the imaging altitude H, times are the same for all: a swarm is released 3 1/3 H before the target, passes over
it 200 s later with H / 60 s, and has 400 s more. So a body of 250 m and one of 60 km look alike.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from math import atan, cos, degrees, radians, sin, tan
from typing import Any

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.errors import MissionError, PathError, ScenarioError
from swarm_mj.flight.environment import epoch_state, load_body_shape
from swarm_mj.flight.plan import Plan
from swarm_mj.flight.targets import target_from
from swarm_mj.io.cache import cache_folder, hash_of, load_array, store_array
from swarm_mj.mission.target import directions
from swarm_mj.mission.trajectories import solve_transfers
from swarm_mj.scenarios.bodies import packaged_body
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.spacecraft.attitude.algebra import combine, cross, scaled, vector
from swarm_mj.typing import Array, Ints

from .catalogue import MOST_HALF_ANGLE_DEG, MissionSpec
from .patches import make_patches

#: Flight from release to arrival, and whole flight [s].
TIME_OF_FLIGHT_S, DURATION_S = 200.0, 600.0
#: Length of a decision where nothing else is asked for [s].
DECISION_S = 20.0
#: Patches that every mission's target has cells for.
PATCHES_FOR_ALL = 49
#: Time in which a spacecraft flies as far as the imaging altitude [s].
CROSSING_S = 60.0
#: Control period and step of the integration [s]; time between pictures [s].
PERIOD_S, PICTURE_INTERVAL_S = 1.0, 10.0
#: Least distance of a flight to the centre over the body's largest radius, at the lowest altitude that is tabulated.
CLEARANCE = 1.15
#: Altitudes of the table of ways, over the imaging altitude; between them ways are interpolated.
ALTITUDES = (0.75, 1.0, 1.25)
#: Visiting points of the table, at most.
MOST_POINTS = 32
#: Half-width of the target over the imaging altitude, where the body is large enough.
TARGET_OVER_ALTITUDE = 0.6
#: Ground sampling distance that counts, over that straight down from the imaging altitude.
REACH = 1.25
#: Volume of a flat target of that width from the imaging altitude, which compression is set for [bit], and rates [bit/s]: 250 s
#: to send it to Earth.
NOMINAL_BIT, EARTH_BIT_S, SWARM_BIT_S = 2e6, 8e3, 1e5
#: Where Earth stands above the target's horizon at the arrival, as nearly as the place allows [deg].
EARTH_ELEVATION_DEG = 40.0
#: Raise when the meaning of a stored table changes.
TABLE_VERSION = 1


@kernel
def release_velocities(v0_N: Array, which: Ints, altitude: Array, speed: float, r0_N: Array, spin_N: Array) -> Array:
    """Velocities at release past a body that turns, interpolated in the table of ways, shape (n, 3) [m/s].

    Args:
        v0_N: The table, shape (P, altitudes, 3) [m/s].
        which: Points of it, shape (n,).
        altitude: Of the arrivals over the imaging altitude, shape (n,).
        speed: Over that of the mission.
        r0_N: Where all are released, shape (3,) [m].
        spin_N: Of the body, shape (3,) [rad/s].
    """
    a, b, c = ALTITUDES
    found, arrival_s = np.empty((which.shape[0], 3)), TIME_OF_FLIGHT_S / speed
    start_N, spin = (r0_N[0], r0_N[1], r0_N[2]), (spin_N[0], spin_N[1], spin_N[2])
    for j in range(which.shape[0]):
        x, rows = altitude[j], v0_N[which[j]]
        # Lagrange's polynomial through the three altitudes.
        first = (x - b) * (x - c) / ((a - b) * (a - c))
        second = (x - a) * (x - c) / ((b - a) * (b - c))
        third = (x - a) * (x - b) / ((c - a) * (c - b))
        for k in range(3):
            found[j, k] = first * rows[0, k] + second * rows[1, k] + third * rows[2, k]
        v = vector(found, j)
        turned_N = scaled(arrival_s - TIME_OF_FLIGHT_S, cross(spin, combine(1.0, start_N, TIME_OF_FLIGHT_S, v)))
        for k in range(3):
            found[j, k] = speed * v[k] + turned_N[k] / arrival_s
    return found


def check_patches(spec: MissionSpec, patches: int) -> None:
    """Refuse so many patches that one would hold no cell of a mission's target.

    Raises:
        ScenarioError: The message names the mission.
    """
    if patches > PATCHES_FOR_ALL:
        scenario = load_scenario(flyby(spec, 1, patches)[0])
        try:
            make_patches(target_from(scenario, load_body_shape(scenario.body)), patches)
        except ScenarioError:
            raise ScenarioError(
                f"patches = {patches}: one would hold no cell of the target of mission {spec.name}; at most "
                f"{PATCHES_FOR_ALL} fit every mission, or take other missions"
            ) from None


def _ellipsoid() -> dict[str, Any]:
    """21 Lutetia as an ellipsoid of constant density; compiled flights know no point mass, so its field goes to degree 2."""
    body = packaged_body("lutetia")
    a, b, c = body["semi_axes_m"]
    # Unnormalised C20 and C22 of a homogeneous ellipsoid (Balmino 1994, Celest. Mech. 60, 331), over their normalisations.
    c20 = (c**2 - 0.5 * (a**2 + b**2)) / (5.0 * a**2) / 5.0**0.5
    c22 = (a**2 - b**2) / (20.0 * a**2) / (10.0 / 24.0) ** 0.5
    field = {"gm": body["gravity"]["parameters"]["gm"], "reference_radius_m": a}
    field["coefficients"] = [[2, 0, c20, 0.0], [2, 1, 0.0, 0.0], [2, 2, c22, 0.0]]
    return body | {"gravity": {"model": "spherical_harmonics", "parameters": field}}


def flyby(spec: MissionSpec, spacecraft: int, patches: int) -> tuple[dict[str, Any], float, float]:
    """The scenario of a mission, its imaging altitude and the half-width of its target [m]."""
    up = directions(spec.latitude_deg, spec.longitude_deg)
    body = _ellipsoid() if spec.body == "ellipsoid" else spec.body
    base: dict[str, Any] = {"body": body, "epoch": "2018-01-01T00:00:00"}
    plain = load_scenario({**base, "name": spec.name, "target": _target(spec, 10.0, None)})
    vertices = load_body_shape(plain.body).vertices
    radius = np.linalg.norm(vertices, axis=1)
    ground = float(radius[np.argmax(vertices @ up / radius)])
    altitude = (CLEARANCE * float(radius.max()) - ground) / ALTITUDES[0]
    half_angle = min(degrees(atan(TARGET_OVER_ALTITUDE * altitude / ground)), MOST_HALF_ANGLE_DEG)
    half_width = ground * tan(radians(half_angle))
    patch = 2.0 * half_width / patches**0.5
    camera = degrees(atan(0.5 * spec.picture_over_patch * patch / altitude))
    east, north = np.cross([0.0, 0.0, 1.0], up), np.zeros(3)
    east /= np.linalg.norm(east)
    north = np.cross(up, east)
    heading = radians(spec.heading_deg)
    ahead = sin(heading) * east + cos(heading) * north
    way = TIME_OF_FLIGHT_S / CROSSING_S * altitude
    start = (ground + altitude) * up - way * ahead
    data = base | {
        "name": spec.name,
        "description": f"{spec.body}, {spec.latitude_deg:g} deg north, {spec.longitude_deg:g} deg east",
        "epoch": _epoch(plain, up),
        "duration_s": DURATION_S,
        "target": _target(spec, half_angle, 2.0 * half_width / 6.0),
        "design": {
            "visiting_points": list(range(1, spacecraft + 1)),
            "imaging_altitude_m": altitude,
            "time_of_flight_s": TIME_OF_FLIGHT_S,
        },
        "mothership": {"position_A_m": start.tolist()},
        "behavior": {"name": "adaptable_roles", "imaging_radius_m": float(np.linalg.norm(start)) * 3.0},
        "control": {"controller": "mrp_sliding_mode", "period_s": PERIOD_S},
        "physics": {"timestep_s": PERIOD_S, "stepper": "kernel"},
        "camera": {"half_angle_deg": camera, "shape": "square", "resolution_px": 512},
        "observation": {
            "criterion": "passage",
            "min_fraction": 0.5,
            "interval_s": PICTURE_INTERVAL_S,
            "max_gsd_m": REACH * altitude * 2.0 * tan(radians(camera)) / 512.0,
        },
        "safety": {"min_separation_m": 1e-3 * altitude},
        "link": {"max_range_m": 20.0 * altitude},
    }
    return data, altitude, half_width


def _target(spec: MissionSpec, half_angle_deg: float, cell_size_m: float | None) -> dict[str, Any]:
    return {
        "latitude_deg": spec.latitude_deg,
        "longitude_deg": spec.longitude_deg,
        "half_angle_deg": half_angle_deg,
        "edges": "side",
        "cell_size_m": cell_size_m,
    }


def _epoch(scenario: Scenario, up: Array) -> str:
    """When the swarm is released so that Earth stands as high over the target at the arrival as it should, or nearly."""
    around = epoch_state(scenario)
    best, found = np.inf, 0.0
    for k in range(72):
        later = k / 72.0 * 2.0 * np.pi / abs(around.spin_rate)
        earth_A = around.C_AN(later + TIME_OF_FLIGHT_S) @ around.earth.at(later)
        elevation = degrees(np.arcsin(earth_A @ up / np.linalg.norm(earth_A)))
        off = abs(elevation - EARTH_ELEVATION_DEG)
        if off < best - 1e-9:
            best, found = off, later
    return (datetime.fromisoformat(scenario.epoch) + timedelta(seconds=round(found))).isoformat()


def release_table(plan: Plan, altitude: float) -> Array:
    """Velocities at release to the visiting points, shape (P, altitudes, 3) [m/s], solved or from the cache."""
    region = plan.region
    which = np.linspace(0, region.n_visiting - 1, min(MOST_POINTS, region.n_visiting)).round().astype(int)
    points = np.array([region.visiting_points_A(share * altitude)[which] for share in ALTITUDES])
    text = f"{TABLE_VERSION} {plan.scenario.model_dump_json(include={'body', 'epoch', 'mothership', 'design'})}"
    file = cache_folder() / "ways" / f"{hash_of(text, points)}.npy"
    kept = load_array(file, (len(which), len(ALTITUDES), 3), np.float64)
    if kept is not None:
        return np.asarray(kept)
    environment = plan.environment
    destinations = points.transpose(1, 0, 2).reshape(-1, 3) @ environment.C_AN(TIME_OF_FLIGHT_S)
    try:
        v0, _ = solve_transfers(environment.acceleration_N, plan.deployment.r0_N, destinations, TIME_OF_FLIGHT_S)
    except (PathError, MissionError) as error:
        raise ScenarioError(f"mission {plan.scenario.name}: {error}") from None
    table = v0.reshape(len(which), len(ALTITUDES), 3)
    store_array(file, table, folder_bytes=2**24)
    return table
