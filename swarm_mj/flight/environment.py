"""The body of a scenario and all that acts near it: shape, gravity, rotation, Sun and Earth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from swarm_mj import plugins
from swarm_mj.errors import ScenarioError, ShapeError
from swarm_mj.flight.companion import keplerian_path, path_from
from swarm_mj.scenarios.schema import Body, Scenario
from swarm_mj.smallbody.companion import Companion, facing_dcm
from swarm_mj.smallbody.environment import Environment, LinearMotion
from swarm_mj.smallbody.ephemeris import Ephemeris, OrbitalElements, ephemeris_time, julian_date
from swarm_mj.smallbody.kernel_ephemeris import KernelEphemeris
from swarm_mj.smallbody.rotation import Rotation, spin_dcm
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_check import BodySizeError
from swarm_mj.smallbody.shape_harmonics import BODIES, build_ellipsoid, load_body
from swarm_mj.smallbody.shape_io import load_shape
from swarm_mj.typing import Array

EROS_SHAPE = "eros"
#: What each built-in field takes from Eros where the scenario says nothing: a shape of one's own needs all of one choice.
OWN_GRAVITY = {
    "point_mass": (("gm",),),
    "polyhedron": (("gm",), ("density_kg_m3",)),
    "spherical_harmonics": (("gm", "reference_radius_m", "coefficients"),),
}


class EpochState(NamedTuple):
    """What of an `Environment` follows from the epoch; see there."""

    C_PN: Array
    phase0: float
    spin_rate: float
    sun: LinearMotion
    earth: LinearMotion

    def C_AN(self, t: float) -> Array:
        """Rotation from N to A at a time past the epoch [s], shape (3, 3)."""
        return spin_dcm(self.C_PN, self.phase0 + self.spin_rate * t)


def epoch_state(scenario: Scenario) -> EpochState:
    """Rotation, Sun and Earth at the scenario's epoch; a body that is locked to its companion is turned to it.

    Raises:
        SwarmError: As for `own_state`, or the companion's orbit has no period.
    """
    return _locked(scenario, own_state(scenario))


def own_state(scenario: Scenario) -> EpochState:
    """The same by the body's own elements or by SPICE kernels.

    Raises:
        ScenarioError: The scenario's kernels cannot be read, or do not say.
        InteropError: It names kernels, and SpiceyPy is not installed.
    """
    ephemeris, jd, asked = ephemeris_from(scenario.body), julian_date(scenario.epoch), scenario.ephemerides
    built_in = EpochState(
        C_PN=ephemeris.rotation.C_PN,
        phase0=ephemeris.rotation.phase(jd),
        spin_rate=ephemeris.rotation.spin_rate,
        sun=LinearMotion(*ephemeris.sun_state_N(jd)),
        earth=LinearMotion(*ephemeris.earth_state_N(jd)),
    )
    if not asked.kernels:
        return built_in
    kernels = KernelEphemeris(asked.kernels, scenario.body.name, body=asked.body, frame=asked.frame)
    et, changed = ephemeris_time(scenario.epoch), built_in
    if asked.positions:
        sun, earth = (LinearMotion(*kernels.state_N(target, et)) for target in ("SUN", "EARTH"))
        changed = changed._replace(sun=sun, earth=earth)
    if asked.rotation:
        C_AN, spin_rate = kernels.rotation(et, scenario.duration_s)
        changed = changed._replace(C_PN=C_AN, phase0=0.0, spin_rate=spin_rate)
    return changed


def _locked(scenario: Scenario, own: EpochState) -> EpochState:
    """The same with the body turned to its companion, where the scenario says so; the axes of the orbit are its own."""
    asked = scenario.companion
    if asked is None or asked.body_rotation == "own":
        return own
    assert asked.orbit is not None  # the schema sees to that
    path = keplerian_path(scenario.body, asked.body, asked.orbit, own.C_PN[2])
    r, v = path.state(0.0)
    return own._replace(C_PN=facing_dcm(-r, -v), phase0=0.0, spin_rate=path.mean_motion)


def companion_from(scenario: Scenario) -> Companion | None:
    """The companion of the scenario's body; None: there is none.

    Raises:
        SwarmError: Its shape, gravity or path cannot be had; the message says why.
    """
    asked = scenario.companion
    if asked is None:
        return None
    pole_N = own_state(scenario).C_PN[2]
    try:
        shape = load_body_shape(asked.body)
        _require_own_gravity(asked.body)
        with plugins.named("companion.body.gravity.model"):
            gravity = plugins.create(plugins.GRAVITY, asked.body.gravity.model, asked.body.gravity.parameters, shape)
    except (ScenarioError, ShapeError) as error:
        raise type(error)(f"companion: {error}") from None
    rotation, jd = ephemeris_from(asked.body).rotation, julian_date(scenario.epoch)
    return Companion(
        name=asked.body.name,
        shape=shape,
        gravity=gravity,
        path=path_from(scenario, asked, pole_N),
        C_PN=rotation.C_PN,
        phase0=rotation.phase(jd),
        own_rate=rotation.spin_rate,
        locked=asked.rotation == "locked",
    )


def ephemeris_from(body: Body) -> Ephemeris:
    """Where the Sun and Earth stand as seen from the scenario's body, by its elements."""
    elements = OrbitalElements(**body.orbit.model_dump())
    return Ephemeris(orbit=elements, rotation=Rotation(**body.rotation.model_dump()))


def load_body_shape(body: Body) -> ShapeModel:
    """The body's mesh: packaged, an ellipsoid, or from a file."""
    if body.shape in BODIES:
        return load_body(body.shape)
    if body.semi_axes_m is not None:
        return build_ellipsoid(body.semi_axes_m, body.name)
    gm = body.gravity.parameters.get("gm")
    known = float(gm) if isinstance(gm, (int, float)) and gm > 0.0 else None
    try:
        return load_shape(
            body.shape, unit=body.shape_unit, name=body.name, expect_radius_m=body.radius_range_m, gm=known
        )
    except BodySizeError as error:
        advice = error.advised("give body.shape_unit: {unit}", "give body.radius_range_m: [LOWEST, HIGHEST]")
        raise ShapeError(f"body.shape = {body.shape}: {advice}") from None
    except ShapeError as error:
        raise ShapeError(f"body.shape = {body.shape} (with body.shape_unit, body.radius_range_m): {error}") from None


def environment_from(scenario: Scenario, shape: ShapeModel, mass: float | None = None) -> Environment:
    """Everything that acts near the body, for the scenario's epoch.

    Args:
        scenario: What is asked for.
        shape: The body's mesh in A [m].
        mass: Of a spacecraft, which radiation pressure accelerates [kg]; None: the scenario's.
    """
    body, perturbations = scenario.body, scenario.perturbations
    _require_own_gravity(body)
    with plugins.named("body.gravity.model"):
        gravity = plugins.create(plugins.GRAVITY, body.gravity.model, body.gravity.parameters, shape)
    area_per_mass = perturbations.srp_area_m2 / (mass or scenario.spacecraft.mass_kg)
    return Environment(
        gravity=gravity,
        **epoch_state(scenario)._asdict(),
        solar_tide=perturbations.solar_tide,
        srp_area_per_mass=area_per_mass if perturbations.solar_radiation_pressure else 0.0,
        srp_reflectivity=perturbations.srp_reflectivity,
        companion=companion_from(scenario),
    )


def _require_own_gravity(body: Body) -> None:
    given = {key for key, value in body.gravity.parameters.items() if value is not None}
    choices = OWN_GRAVITY.get(body.gravity.model, ())
    if body.shape != EROS_SHAPE and choices and not any(given.issuperset(choice) for choice in choices):
        raise ScenarioError(
            f"body.gravity.parameters = {body.gravity.parameters}: body.shape = {body.shape} would take the gravity of Eros; "
            f"{body.gravity.model} needs {' or '.join(map(_enumerated, choices))} (check body.rotation and body.orbit too)"
        )


def _enumerated(words: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))
