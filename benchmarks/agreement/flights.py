"""The flights that all programs are asked about: flown and exported by swarm_mj, and written down as jobs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from math import degrees
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import swarm_mj as sm
from benchmarks.agreement.coefficients import terms
from swarm_mj.interop.kernels import rotation_constants
from swarm_mj.interop.states import FlightStates
from swarm_mj.io.times import SECOND, TT_TAI, tai_minus_utc, tdb_minus_tt
from swarm_mj.scenarios.constants import AU, DAY, GM_SUN
from swarm_mj.scenarios.loading import NO_OVERRIDES
from swarm_mj.smallbody.ephemeris import julian_date
from swarm_mj.smallbody.gravity import SphericalHarmonics
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.tracks.frames import C_EN

Array = NDArray[np.float64]
FORMATS: Final = ("oem", "aem", "spk", "ck", "dsk")
#: Most instants at which paths are compared; files are compared at all of theirs.
MOST_TIMES: Final = 2401
TURNS: Final = 25


@dataclass(frozen=True)
class Mission:
    """One of the flights.

    Attributes:
        scenario: Its name.
        title: For the page.
        changes: Of the scenario, for more samples.
        elements_epoch: At which the asteroid's elements osculate, TDB (JPL; see the scenario's body).
        basilisk_step_s: Of Basilisk's RK4.
        wheels: Whether the wheels' torques are recorded at every control period and are flown again.
    """

    scenario: str
    title: str
    changes: Mapping[str, Any]
    elements_epoch: str
    basilisk_step_s: float
    wheels: bool


MISSIONS: Final = {
    "eros-config1": Mission(
        "eros-config1", "The paper's flight", {"telemetry.interval_s": 0.5}, "2019-05-02T00:00:00.000", 0.5, True
    ),
    "fast-flyby": Mission("fast-flyby", "The fast flyby", {}, "2019-04-27T00:00:00.000", 5.0, False),
}


@dataclass(frozen=True)
class Flown:
    """A flight by swarm_mj, the other side of every comparison.

    Attributes:
        mission: Which.
        states: All that was recorded.
    """

    mission: Mission
    states: FlightStates

    @property
    def stride(self) -> int:
        """Of the samples at which paths are compared."""
        return -(-(len(self.states.times) - 1) // (MOST_TIMES - 1))

    @property
    def turn_times(self) -> Array:
        """Whole seconds at which rotation and ephemerides are compared, shape (k,)."""
        return np.unique(np.round(np.linspace(0.0, self.states.times[-1], TURNS)))


def utc_of(ns: int) -> datetime:
    """Date and time in UTC of an instant, cut to microseconds; during a leap second that of the second after it."""
    tt = ns - round(tdb_minus_tt(ns / SECOND) * SECOND)
    tai = tt - round(TT_TAI * SECOND)
    moment = datetime(2000, 1, 1, 12) + timedelta(microseconds=tai // 1000)
    utc = moment - timedelta(seconds=tai_minus_utc(moment.date()))
    return utc if utc.date() == moment.date() else moment - timedelta(seconds=tai_minus_utc(utc.date()))


def fly(mission: Mission, folder: Path, changes: Mapping[str, Any] = NO_OVERRIDES) -> Flown:
    """Fly, export into the folder and write the job down."""
    flight = sm.fly(mission.scenario, {**mission.changes, **changes})
    flight.export(folder / "export", formats=FORMATS)
    flight.export(folder / "export3", formats=["oem", "aem"], ccsds=3)
    flown = Flown(mission, FlightStates(flight.plan, flight.telemetry))
    (folder / "job.json").write_text(json.dumps(facts(flown), indent=1) + "\n", encoding="utf-8")
    np.savez(folder / "asked.npz", **asked(flown, folder))
    return flown


def facts(flown: Flown) -> dict[str, Any]:
    """Constants of a flight, as numbers of JSON."""
    states, environment = flown.states, flown.states.plan.environment
    gravity, scenario = environment.gravity, states.plan.scenario
    rate = degrees(environment.spin_rate) * DAY
    published = scenario.body.rotation
    out: dict[str, Any] = {
        "names": states.plan.names,
        "body": states.body.name,
        "code": states.body.code,
        "epoch": scenario.epoch,
        "et": states.epoch / 1e9,
        "utc": utc_of(states.epoch).isoformat(timespec="microseconds"),
        "gm": float(gravity.gm),  # type: ignore[attr-defined]
        "radius": getattr(gravity, "reference_radius", 0.0),
        "terms": terms(gravity.c, gravity.s) if isinstance(gravity, SphericalHarmonics) else [],
        "rotation": {
            "exported": (*rotation_constants(states), rate),
            "published": (
                published.pole_ra_deg,
                published.pole_dec_deg,
                published.w0_deg,
                published.w_rate_deg_per_day,
            ),
        },
        "orbit": orbit(flown),
        "C_EN": C_EN.tolist(),
        "basilisk_step_s": flown.mission.basilisk_step_s,
    }
    if flown.mission.wheels:
        properties = states.plan.properties
        out["wheels"] = {
            "mass": properties.mass,
            "inertia_B": properties.inertia_B.tolist(),
            "axes_B": properties.wheel_axes_B.tolist(),
            "spin_inertia": properties.wheel_spin_inertia,
            "max_torque": properties.max_wheel_torque,
            "max_speed": properties.max_wheel_speed,
            "period_s": scenario.control.period_s,
        }
    return out


def orbit(flown: Flown) -> dict[str, Any]:
    """The asteroid's elements at their own epoch, SI and degrees."""
    given, epoch = flown.states.plan.scenario.body.orbit, flown.mission.elements_epoch
    a = given.semi_major_axis_au * AU
    motion = np.sqrt(GM_SUN / a**3)
    return {
        "epoch": epoch,
        "a": a,
        "e": given.eccentricity,
        "inclination_deg": given.inclination_deg,
        "node_deg": given.node_deg,
        "argument_deg": given.argument_of_perihelion_deg,
        "anomaly_deg": degrees(motion * (julian_date(epoch) - given.perihelion_jd) * DAY),
        "gm_sun": GM_SUN,
    }


def asked(flown: Flown, folder: Path) -> dict[str, Array]:
    """Times, and starts as the exported files have them."""
    states = flown.states
    out = {
        "all_times": states.times,
        "et": states.et,
        "times": states.times[:: flown.stride],
        "turn_times": flown.turn_times,
        "start_E": np.array([first_state(folder / "export" / "oem" / f"{name}.oem") for name in states.plan.names]),
    }
    if flown.mission.wheels:
        telemetry = states.telemetry
        out |= {
            "q0": states.q_BN[0, 0],
            "omega0": telemetry["omega_BN_B"].values[0, 0],
            "wheel_speed0": telemetry["wheel_speed"].values[0, 0],
            "torques": telemetry["wheel_torque"].values[:, 0],
        }
    return out


def first_state(oem: Path) -> Array:
    """The first line of data of an OEM in SI, shape (6,)."""
    lines = oem.read_text(encoding="utf-8").partition("META_STOP")[2].split("\n")
    row = next(line for line in lines if line.strip())
    return 1e3 * np.array([float(word) for word in row.split()[1:7]])


def attitudes_E(states: FlightStates) -> Array:
    """C_BE of every sample and spacecraft, shape (t, n, 3, 3)."""
    return np.asarray(dcm(states.telemetry["sigma_BN"].values) @ C_EN.T)
