"""Where the mothership, or who flies without one, comes from: states at the epoch, by whichever of the ways a scenario gives.

Approach and elements give the state by a two-body orbit; from the epoch on the full field acts.
"""

from __future__ import annotations

from contextlib import suppress
from itertools import count
from math import asin, atan2, degrees, inf, radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from swarm_mj.errors import InteropError, MissionError, ScenarioError
from swarm_mj.io.times import epoch_of, text_of
from swarm_mj.mission.safety import check_times, find_impacts
from swarm_mj.mission.trajectories import MAX_EVALUATIONS
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_mothership import (
    Approach,
    KnownState,
    Mothership,
    OrbitalState,
    PathOfFile,
    PhaseGeometry,
)
from swarm_mj.smallbody.conic import (
    ConicElements,
    Hyperbola,
    elements_of_state,
    hyperbola_of_state,
    hyperbolic_anomaly,
    state_of_elements,
    state_of_hyperbola,
)
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.ephemeris import eccentric_anomaly, ephemeris_time
from swarm_mj.smallbody.kernel_ephemeris import KernelEphemeris
from swarm_mj.smallbody.naif import BodyName
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.solid_angle import points_inside
from swarm_mj.tracks.ccsds_in import read_oem
from swarm_mj.tracks.frames import axes_of_pole
from swarm_mj.tracks.horizons_in import read_horizons
from swarm_mj.typing import Array

#: How to keep the mothership out of the body, by the key that says where it comes from.
REMEDIES = {
    "position_A_m": "change mothership.position_A_m or mothership.velocity",
    "approach": "change b_t_m, b_r_m or closest_approach_s of mothership.approach",
    "elements": "change mothership.elements",
    "ephemeris": "give another file in mothership.ephemeris, or another epoch",
}
#: Relative difference that rounding makes of an orbit that is radial, or parabolic.
ROUNDING = 1e-12


class MothershipState(NamedTuple):
    """State of the mothership at the epoch."""

    r_N: Array  #: position relative to the body's centre, shape (3,) [m]
    velocity: Array | str  #: in N, shape (3,) [m/s]; 'mean' of the deployed velocities; or 'rest' in N


def mothership_state(scenario: Scenario, environment: Environment) -> MothershipState:
    """The mothership at the epoch, before it releases anybody.

    Raises:
        ScenarioError: The scenario's way gives no state; the message names the keys.
        InteropError: Its file cannot be read.
    """
    asked = scenario.mothership
    if (known := _known_state(asked, "mothership", scenario, environment)) is not None:
        return known
    velocity = asked.velocity if isinstance(asked.velocity, str) else np.array(asked.velocity)
    return MothershipState(np.array(asked.position_A_m) @ environment.C_AN(0.0), velocity)


def known_states(scenario: Scenario, environment: Environment) -> tuple[Array, Array]:
    """Positions [m] and velocities [m/s] in N at the epoch of spacecraft that are on their way, each of shape (n, 3).

    Raises:
        ScenarioError: An entry of `initial_states` gives no state; the message names the keys.
        InteropError: Its file cannot be read.
    """
    r_N, v_N = [], []
    for k, asked in enumerate(scenario.initial_states):
        found = _known_state(asked, f"initial_states.{k}", scenario, environment)
        if found is None:
            assert asked.state is not None  # the schema sees to that
            C = axes_in_N(asked.state.axes, environment)
            found = MothershipState(np.array(asked.state.position_m) @ C, np.array(asked.state.velocity_m_s) @ C)
        r_N.append(found.r_N)
        v_N.append(found.velocity)
    return np.array(r_N), np.array(v_N)


def _known_state(
    asked: Mothership | KnownState, key: str, scenario: Scenario, environment: Environment
) -> MothershipState | None:
    """State by approach, elements or ephemeris, those of a section called `key`; None where there is none of them."""
    if asked.approach is not None:
        return _by_approach(asked.approach, f"{key}.approach", scenario, environment)
    if asked.elements is not None:
        return _by_elements(asked.elements, f"{key}.elements", scenario, environment)
    if asked.ephemeris is not None:
        return _by_file(asked.ephemeris, f"{key}.ephemeris", scenario)
    return None


def axes_in_N(name: str, environment: Environment) -> Array:
    """Axes by their name in a scenario: the rows are their unit vectors x, y, z in N, shape (3, 3)."""
    return axes_of_pole(name, environment.C_PN[2])


def check_approach(scenario: Scenario, shape: ShapeModel, environment: Environment, state: MothershipState) -> None:
    """See that the mothership is outside the body at the epoch, and that its path does not lead into it.

    A hyperbola is followed until its closest approach at least, where its velocity is known.

    Raises:
        ScenarioError: It does; the message says when, where and what to change.
    """
    mothership, C_AN = scenario.mothership, environment.C_AN(0.0)
    position = C_AN @ state.r_N
    if points_inside(position[None], shape.vertices, shape.faces).any():
        raise ScenarioError(
            f"mothership.position_A_m = {list(mothership.position_A_m)}: lies inside {shape.name}; {REMEDIES['position_A_m']}"
            if mothership.way == "position_A_m"
            else f"mothership.{mothership.way}: lies inside {shape.name} at the epoch, at {position.round(3).tolist()} m in A; "
            f"{REMEDIES[mothership.way]}"
        )
    if isinstance(state.velocity, str) and state.velocity == "mean":
        return
    velocity = np.zeros(3) if isinstance(state.velocity, str) else state.velocity
    closest = 0.0 if mothership.approach is None else mothership.approach.closest_after(scenario.epoch)
    times, r_N = _coasted(shape, environment, state.r_N, velocity, max(scenario.duration_s, closest))
    legs = np.linalg.norm(np.diff(r_N, axis=0), axis=1).max(initial=0.0)
    if np.linalg.norm(r_N, axis=1).min() > shape.max_radius + legs:
        return
    r_A = np.array([environment.C_AN(t) @ r for t, r in zip(times.tolist(), r_N, strict=True)])
    for impact in find_impacts(shape, times, r_A[:, None]):
        raise ScenarioError(
            f"mothership.{mothership.way}: the mothership hits {scenario.body.name} on its way at t = {impact.time:g} s, "
            f"latitude {impact.latitude_deg:.1f} deg, longitude {impact.longitude_deg:.1f} deg; {REMEDIES[mothership.way]}"
        )


def osculating_orbit(scenario: Scenario, environment: Environment, r_N: Array, v_N: Array) -> dict[str, Any]:
    """How the mothership comes, in the numbers of the field: osculating at the epoch, in the scenario's axes.

    Args:
        scenario: What was asked for.
        environment: Of the flight.
        r_N: Position at the epoch, shape (3,) [m].
        v_N: Velocity, shape (3,) [m/s].
    """
    mothership = scenario.mothership
    given = mothership.approach or mothership.elements
    axes = "ecliptic" if given is None else given.axes
    out: dict[str, Any] = {
        "way": mothership.way,
        "distance_m": float(np.linalg.norm(r_N)),
        "speed_m_s": float(np.linalg.norm(v_N)),
    }
    gm = getattr(environment.gravity, "gm", None) if given is None or given.gm_m3_s2 is None else given.gm_m3_s2
    if gm is None:
        return out
    out |= {"axes": axes, "gm_m3_s2": float(gm)}
    C = axes_in_N(axes, environment)
    distance, speed = out["distance_m"], out["speed_m_s"]
    # Of the speed with which it would just escape, squared.
    share = speed**2 * distance / (2.0 * gm) if gm > 0.0 else inf
    if share < 1.0 and np.linalg.norm(np.cross(r_N, v_N)) <= ROUNDING * distance * speed:
        return out | _radial(distance / (1.0 - share))
    flyby = hyperbola_of_state(C @ r_N, C @ v_N, gm)
    if flyby is not None:
        return out | _passing(flyby)
    return out | _bound(elements_of_state(C @ r_N, C @ v_N, gm), "ellipse" if share < 1.0 - ROUNDING else "parabola")


def _passing(flyby: Hyperbola) -> dict[str, Any]:
    x, y, z = flyby.v_infinity / flyby.speed
    plane: tuple[float, float] | tuple[None, None] = (None, None)
    with suppress(MissionError):  # along the pole there is no B-plane
        plane = flyby.components(np.array([0.0, 0.0, 1.0]))
    return {
        "orbit": "hyperbola",
        "v_infinity_m_s": flyby.speed,
        "v_infinity_longitude_deg": degrees(atan2(y, x)) % 360.0,
        "v_infinity_latitude_deg": degrees(asin(max(-1.0, min(1.0, z)))),
        "b_m": flyby.impact_parameter,
        "b_t_m": plane[0],
        "b_r_m": plane[1],
        "closest_approach_s": flyby.closest_approach,
        "periapsis_radius_m": flyby.periapsis_radius,
        "periapsis_speed_m_s": flyby.periapsis_speed,
        "eccentricity": flyby.eccentricity if flyby.gm > 0.0 else None,
        "turn_angle_deg": degrees(flyby.turn_angle),
    }


def _radial(apoapsis_radius: float) -> dict[str, Any]:
    """A path straight up or down that does not escape: an ellipse without width, of which only the apoapsis has a direction."""
    return {"orbit": "radial", "eccentricity": 1.0, "periapsis_radius_m": 0.0, "apoapsis_radius_m": apoapsis_radius}


def _bound(orbit: ConicElements, kind: str) -> dict[str, Any]:
    return {
        "orbit": kind,
        "periapsis_radius_m": orbit.periapsis_radius,
        "eccentricity": orbit.eccentricity,
        "inclination_deg": degrees(orbit.inclination),
        "node_deg": degrees(orbit.node),
        "argument_of_periapsis_deg": degrees(orbit.argument),
        "true_anomaly_deg": degrees(orbit.true_anomaly),
    }


def _by_approach(asked: Approach, key: str, scenario: Scenario, environment: Environment) -> MothershipState:
    gm = _gm(asked.gm_m3_s2, key, scenario, environment)
    if asked.phase is not None:
        return _state_of(_by_phase(asked, asked.phase, gm, scenario, environment), key)
    assert asked.longitude_deg is not None and asked.latitude_deg is not None  # the schema sees to that, and to these:
    assert asked.b_t_m is not None and asked.b_r_m is not None
    C = axes_in_N(asked.axes, environment)
    longitude, latitude = radians(asked.longitude_deg), radians(asked.latitude_deg)
    S = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    try:
        flyby = Hyperbola.of_components(
            gm,
            asked.v_infinity_m_s * S,
            np.array([0.0, 0.0, 1.0]),
            (asked.b_t_m, asked.b_r_m),
            asked.closest_after(scenario.epoch),
        )
    except MissionError as error:
        raise ScenarioError(
            f"{key}.latitude_deg = {asked.latitude_deg:g}: {error}; choose other axes than {asked.axes}"
        ) from None
    r, v = _state_of(flyby, key)
    return MothershipState(r @ C, np.asarray(v) @ C)


def _by_phase(
    asked: Approach, phase: PhaseGeometry, gm: float, scenario: Scenario, environment: Environment
) -> Hyperbola:
    """The flyby in N that passes the body and the Sun as `PhaseGeometry` says, at the distance that is asked for."""
    closest = asked.closest_after(scenario.epoch)
    sun = environment.sun.at(closest)
    s = sun / np.linalg.norm(sun)
    north = np.array([0.0, 0.0, 1.0]) - s[2] * s
    north /= np.linalg.norm(north)
    clock = radians(phase.clock_deg)
    aside = np.cos(clock) * north + np.sin(clock) * np.cross(s, north)
    against, b_s, n_s = phase.sun
    across = np.hypot(b_s, n_s)  # sine of the phase on the approach
    u = against * s + across * aside  # from where it comes
    p = across * s - against * aside  # across u, towards the Sun
    x, y = (b_s / across, n_s / across) if across > 0.0 else (1.0, 0.0)
    assert asked.distance_m is not None  # the schema sees to that
    B = asked.distance_m * np.sqrt(1.0 + 2.0 * gm / (asked.v_infinity_m_s**2 * asked.distance_m))
    return Hyperbola(
        gm=gm, v_infinity=-asked.v_infinity_m_s * u, B=B * (x * p + y * np.cross(u, p)), closest_approach=closest
    )


def _state_of(flyby: Hyperbola, key: str) -> MothershipState:
    try:
        return MothershipState(*state_of_hyperbola(flyby))
    except MissionError as error:
        raise ScenarioError(f"{key}: {error}; change where or when it passes") from None


def _by_elements(asked: OrbitalState, key: str, scenario: Scenario, environment: Environment) -> MothershipState:
    gm = _gm(asked.gm_m3_s2, key, scenario, environment)
    e = asked.eccentricity
    if asked.periapsis_radius_m is not None:
        least = asked.periapsis_radius_m
    else:
        assert asked.semi_major_axis_m is not None  # the schema sees to that
        least = asked.semi_major_axis_m * (1.0 - e)
    try:
        r, v = state_of_elements(
            ConicElements(
                periapsis_radius=least,
                eccentricity=e,
                inclination=radians(asked.inclination_deg),
                node=radians(asked.node_deg),
                argument=radians(asked.argument_of_periapsis_deg),
                true_anomaly=_true_anomaly(asked),
            ),
            gm,
        )
    except MissionError as error:
        raise ScenarioError(
            f"{key}.true_anomaly_deg = {asked.true_anomaly_deg:g} with eccentricity = {e:g}: {error}"
        ) from None
    C = axes_in_N(asked.axes, environment)
    return MothershipState(r @ C, v @ C)


def _true_anomaly(asked: OrbitalState) -> float:
    """At the epoch [rad], by way of Kepler's equation where the mean one is given."""
    if asked.true_anomaly_deg is not None:
        return radians(asked.true_anomaly_deg)
    assert asked.mean_anomaly_deg is not None  # the schema sees to that
    e, mean = asked.eccentricity, radians(asked.mean_anomaly_deg)
    if e < 1.0:
        half = 0.5 * eccentric_anomaly(mean, e)
        return 2.0 * atan2(np.sqrt(1.0 + e) * np.sin(half), np.sqrt(1.0 - e) * np.cos(half))
    half = 0.5 * hyperbolic_anomaly(mean, e - 1.0, 1.0)
    return 2.0 * atan2(np.sqrt(e + 1.0) * np.tanh(half), np.sqrt(e - 1.0))


def _gm(given: float | None, key: str, scenario: Scenario, environment: Environment) -> float:
    if given is not None:
        return given
    gm = getattr(environment.gravity, "gm", None)
    if gm is None:
        raise ScenarioError(
            f"{key}.gm_m3_s2 = null: the field of body.gravity.model = {scenario.body.gravity.model} has no attribute gm; give "
            f"{key}.gm_m3_s2"
        )
    return float(gm)


def _by_file(asked: PathOfFile, key: str, scenario: Scenario) -> MothershipState:
    if asked.spk is not None:
        kernels = (*scenario.ephemerides.kernels, asked.spk)
        reader = KernelEphemeris(kernels, scenario.body.name, body=scenario.ephemerides.body)
        remedy = f"give in {key}.spk (and ephemerides.kernels) what holds {asked.target} relative to it then"
        assert asked.target is not None  # the schema sees to that
        return MothershipState(*reader.state_N(asked.target, ephemeris_time(scenario.epoch), f"{key}.spk", remedy))
    name, read = ("oem", read_oem) if asked.horizons is None else ("horizons", read_horizons)
    file = Path(getattr(asked, name))
    try:
        track = read(file, BodyName.of(scenario.body.name))
    except InteropError as error:
        raise InteropError(f"{key}.{name}: {error}") from None
    state = track.state_at(epoch_of(scenario.epoch))
    if state is None:
        raise InteropError(
            f"{key}.{name} = {file}: covers {text_of(track.first)} to {text_of(track.last)} TDB and not the "
            f"epoch {scenario.epoch}; set epoch, or give another file"
        )
    return MothershipState(*state)


def _coasted(
    shape: ShapeModel, environment: Environment, r0_N: Array, v0_N: Array, duration_s: float
) -> tuple[Array, Array]:
    """Instants and places of the mothership under the full field, until deep inside the body at most."""
    times = check_times(duration_s)
    deep = 0.8 * float(np.linalg.norm(shape.vertices, axis=1).min())

    evaluations = count(1)

    def rates(t: float, y: Array) -> Array:
        if next(evaluations) > MAX_EVALUATIONS:
            raise ScenarioError(
                f"mothership: its path cannot be integrated beyond t = {t:g} s, {np.linalg.norm(y[:3]):g} m from the centre; "
                "change where it comes from, or body.gravity"
            )
        return np.concatenate([y[3:], environment.acceleration_N(t, y[None, :3])[0]])

    def inside(t: float, y: Array) -> float:
        return float(np.linalg.norm(y[:3])) - deep

    inside.terminal = True  # type: ignore[attr-defined]
    solution = solve_ivp(
        rates,
        (0.0, float(times[-1])),
        np.concatenate([r0_N, v0_N]),
        method="DOP853",
        t_eval=times,
        rtol=1e-10,
        atol=1e-6,
        events=inside,
    )
    if not len(solution.t_events[0]):
        return solution.t, solution.y[:3].T
    return np.append(solution.t, solution.t_events[0]), np.vstack([solution.y[:3].T, solution.y_events[0][:, :3]])
