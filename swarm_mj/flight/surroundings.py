"""How the body turns, and where the Sun and the Earth stand: by the scenario's elements, or by its SPICE kernels."""

from __future__ import annotations

from typing import NamedTuple

from swarm_mj.scenarios.schema import Body, Scenario
from swarm_mj.smallbody.environment import LinearMotion
from swarm_mj.smallbody.ephemeris import Ephemeris, ephemeris_time, julian_date
from swarm_mj.smallbody.kepler import OrbitalElements
from swarm_mj.smallbody.kernel_ephemeris import KernelEphemeris
from swarm_mj.smallbody.rotation import Rotation
from swarm_mj.typing import Array


class Surroundings(NamedTuple):
    """What of an `Environment` follows from the epoch; see there."""

    C_PN: Array
    phase0: float
    spin_rate: float
    sun: LinearMotion
    earth: LinearMotion


def surroundings_from(scenario: Scenario) -> Surroundings:
    """Rotation, Sun and Earth at the scenario's epoch.

    Raises:
        ScenarioError: The scenario's kernels cannot be read, or do not say.
        InteropError: It names kernels, and SpiceyPy is not installed.
    """
    ephemeris, jd, asked = ephemeris_from(scenario.body), julian_date(scenario.epoch), scenario.ephemerides
    built_in = Surroundings(
        C_PN=ephemeris.rotation.C_PN,
        phase0=ephemeris.rotation.phase(jd),
        spin_rate=ephemeris.spin_rate,
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
        C_AN, spin_rate = kernels.turning(et, scenario.duration_s)
        changed = changed._replace(C_PN=C_AN, phase0=0.0, spin_rate=spin_rate)
    return changed


def ephemeris_from(body: Body) -> Ephemeris:
    """Where the Sun and Earth stand as seen from the scenario's body, by its elements."""
    elements = OrbitalElements(**body.orbit.model_dump())
    return Ephemeris(orbit=elements, rotation=Rotation(**body.rotation.model_dump()))
