"""The flight in Orekit (orekit-jcc, a Java machine in this process): its propagator, gravity, frames, ephemerides and parsers.

Python cannot give Orekit frames of its own here. The body's frame is made of Orekit's parts: a frame tilted to the pole, and in
it Orekit's HelmertTransformation, whose rotation about z grows linearly with time, without approximation for small angles.
"""

from __future__ import annotations

import os
from math import pi, radians
from pathlib import Path
from typing import Any

import numpy as np
import orekit_jcc

orekit_jcc.initVM()

from java.io import File  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from org.hipparchus.geometry.euclidean.threed import Rotation, RotationConvention, RotationOrder, Vector3D  # noqa: E402
from org.hipparchus.ode.nonstiff import DormandPrince853Integrator  # noqa: E402
from org.orekit.bodies import CelestialBodyFactory  # noqa: E402
from org.orekit.data import DataContext, DataSource, DirectoryCrawler  # noqa: E402
from org.orekit.files.ccsds.ndm import ParserBuilder  # noqa: E402
from org.orekit.files.ccsds.ndm.adm.aem import Aem, AemSegment  # noqa: E402
from org.orekit.files.ccsds.ndm.odm.oem import Oem, OemSegment  # noqa: E402
from org.orekit.forces.gravity import (  # noqa: E402
    HolmesFeatherstoneAttractionModel,
    NewtonianAttraction,
    SingleBodyAbsoluteAttraction,
)
from org.orekit.forces.gravity.potential import GravityFieldFactory, ICGEMFormatReader  # noqa: E402
from org.orekit.frames import Frame, FramesFactory, HelmertTransformation, StaticTransform, Transform  # noqa: E402
from org.orekit.orbits import CartesianOrbit, KeplerianOrbit, OrbitType, PositionAngleType  # noqa: E402
from org.orekit.propagation import SpacecraftState  # noqa: E402
from org.orekit.propagation.numerical import NumericalPropagator  # noqa: E402
from org.orekit.time import AbsoluteDate, TimeScalesFactory  # noqa: E402
from org.orekit.utils import (  # noqa: E402
    AbsolutePVCoordinates,
    IERSConventions,
    PVCoordinates,
    TimeStampedAngularCoordinates,
    TimeStampedPVCoordinates,
)

from benchmarks.agreement.coefficients import icgem  # noqa: E402
from benchmarks.agreement.job import DAY, Job, work  # noqa: E402

Array = NDArray[np.float64]
MILLIARCSECOND, JULIAN_YEAR = radians(1e-3 / 3600.0), 365.25 * DAY
PLANETS = ("Sun", "Mercury", "Venus", "Earth", "Moon", "Mars", "Jupiter", "Saturn", "Uranus", "Neptune")


def provide(folder: Path | str) -> None:
    """Let Orekit find data in a folder."""
    DataContext.getDefault().getDataProvidersManager().addProvider(DirectoryCrawler(File(str(folder))))


def numbers(vector: Any) -> list[float]:
    """Of a vector."""
    return [vector.getX(), vector.getY(), vector.getZ()]


def state_of(pv: Any) -> list[float]:
    """Position and velocity."""
    return [*numbers(pv.getPosition()), *numbers(pv.getVelocity())]


def matrix(frame: Any, other: Any, date: Any) -> Array:
    """From components in a frame to those in another, shape (3, 3)."""
    transform = StaticTransform.cast_(frame.getTransformTo(other, date))
    columns = [numbers(transform.transformVector(Vector3D(*axis))) for axis in np.eye(3).tolist()]
    return np.array(columns).T


def body_frame(angles: tuple[float, float, float, float], date: Any, name: str) -> Any:
    """A by the angles of the IAU."""
    ra, dec, w, rate = angles
    tilt = Rotation(RotationOrder.ZXZ, RotationConvention.FRAME_TRANSFORM, pi / 2 + ra, pi / 2 - dec, 0.0)
    pole = Frame(FramesFactory.getEME2000(), Transform(date, tilt), f"pole {name}")
    # Its sense of rotation is the opposite of a frame's.
    angle, per_year = -w / MILLIARCSECOND, -rate / MILLIARCSECOND * JULIAN_YEAR
    turning = HelmertTransformation(date, 0.0, 0.0, 0.0, 0.0, 0.0, angle, 0.0, 0.0, 0.0, 0.0, 0.0, per_year)
    return Frame(pole, turning, name)


def propagator(longest_step_s: float = 100.0, tolerance_m: float = 1e-9) -> Any:
    """Numerical, with DormandPrince853."""
    made = NumericalPropagator(DormandPrince853Integrator(1e-6, longest_step_s, tolerance_m, 1e-13))
    made.setOrbitType(OrbitType.CARTESIAN)
    return made


def paths(job: Job, date: Any, body: Any) -> Array:
    """States in E, shape (t, n, 6)."""
    frame, times, gm = FramesFactory.getEME2000(), job.asked["times"].tolist(), job.facts["gm"]
    forces = [NewtonianAttraction(gm)]
    if job.facts["terms"]:
        folder = job.folder / "orekit_field"
        folder.mkdir(exist_ok=True)
        text = icgem("FIELD", gm, job.facts["radius"], job.facts["terms"])
        (folder / "field.gfc").write_text(text, encoding="utf-8")
        provide(folder)
        GravityFieldFactory.addPotentialCoefficientsReader(ICGEMFormatReader("field.gfc", True))
        degree = max(term[0] for term in job.facts["terms"])
        field = GravityFieldFactory.getConstantNormalizedProvider(degree, degree, date)
        forces.append(HolmesFeatherstoneAttractionModel(body, field))
    out = []
    for start in job.asked["start_E"].tolist():
        pv = PVCoordinates(Vector3D(*start[:3]), Vector3D(*start[3:]))
        made = propagator()
        for force in forces:
            made.addForceModel(force)
        made.setInitialState(SpacecraftState(CartesianOrbit(pv, frame, date, gm)))
        generator = made.getEphemerisGenerator()
        made.propagate(date.shiftedBy(times[-1]))
        ephemeris = generator.getGeneratedEphemeris()
        out.append([state_of(ephemeris.getPVCoordinates(date.shiftedBy(t), frame)) for t in times])
    return np.swapaxes(out, 0, 1)


def messages(job: Job, date: Any, generation: int) -> dict[str, Any]:
    """States of the OEMs, shape (t, n, 6), quaternions (w, x, y, z) of the AEMs, (t, n, 4), and the OEMs' times [s], (t,)."""
    states, attitudes, tdb = [], [], TimeScalesFactory.getTDB()
    builder = ParserBuilder().withMu(job.facts["gm"])
    for oem, aem in zip(job.files("oem", generation), job.files("aem", generation), strict=True):
        message = Oem.cast_(builder.buildOemParser().parseMessage(DataSource(oem)))
        rows, n = OemSegment.cast_(message.getSegments().get(0)).getCoordinates(), len(job.asked["all_times"])
        found = [TimeStampedPVCoordinates.cast_(rows.get(k)) for k in range(n)]
        states.append([state_of(pv) for pv in found])
        times = [pv.getDate().offsetFrom(date, tdb) for pv in found]  # durations in Orekit are of TT
        message = Aem.cast_(builder.buildAemParser().parseMessage(DataSource(aem)))
        rows = AemSegment.cast_(message.getSegments().get(0)).getAngularCoordinates()
        found = [TimeStampedAngularCoordinates.cast_(rows.get(k)).getRotation() for k in range(n)]
        attitudes.append([[q.getQ0(), q.getQ1(), q.getQ2(), q.getQ3()] for q in found])
    kind = "" if generation == 2 else "3"
    return {
        f"oem{kind}": np.swapaxes(states, 0, 1),
        f"aem{kind}_q_BE": np.swapaxes(attitudes, 0, 1),
        f"oem{kind}_times": times,
    }


def surroundings(job: Job, date: Any) -> dict[str, Any]:
    """Earth from the Sun by DE-430, the Sun from the body by planets' attraction and by Kepler's equation, in E, (k, 3)."""
    icrf, elements = FramesFactory.getICRF(), job.facts["orbit"]
    bodies = {name: getattr(CelestialBodyFactory, f"get{name}")() for name in PLANETS}
    at = [date.shiftedBy(t) for t in job.asked["turn_times"].tolist()]

    def place(name: str, when: Any) -> Array:
        return np.array(state_of(bodies[name].getPVCoordinates(when, icrf)))

    gm_sun = elements["gm_sun"]
    tdb = TimeScalesFactory.getTDB()
    start = AbsoluteDate(elements["epoch"], tdb)
    angles = [radians(elements[key]) for key in ("inclination_deg", "argument_deg", "node_deg", "anomaly_deg")]
    # Numbers in axes of the ecliptic; the frame that Orekit holds them in does not matter to Kepler's equation.
    kepler = KeplerianOrbit(
        elements["a"], elements["e"], *angles, PositionAngleType.MEAN, FramesFactory.getEME2000(), start, gm_sun
    )
    kepler_N = [numbers(kepler.shiftedBy(when.offsetFrom(start, tdb)).getPVCoordinates().getPosition()) for when in at]
    C_EN = np.array(job.facts["C_EN"])
    state = np.array(state_of(kepler.getPVCoordinates()))
    first = np.concatenate([C_EN @ state[:3], C_EN @ state[3:]]) + place("Sun", start)
    made = propagator(2.0 * DAY, 1e-2)
    made.setOrbitType(None)
    for body in bodies.values():
        made.addForceModel(SingleBodyAbsoluteAttraction(body))
    pv = PVCoordinates(Vector3D(*first[:3].tolist()), Vector3D(*first[3:].tolist()))
    made.setInitialState(SpacecraftState(AbsolutePVCoordinates(icrf, start, pv)))
    flown = []
    for when in at:
        reached = made.propagate(when)
        flown.append(numbers(reached.getPVCoordinates(icrf).getPosition()))
    sun = np.array([place("Sun", when)[:3] for when in at])
    earth = np.array([place("Earth", when)[:3] for when in at])
    return {
        "earth_from_sun": earth - sun,
        "sun_from_body": sun - np.array(flown),
        "sun_from_body_kepler": -np.array(kepler_N) @ C_EN.T,
    }


def compute(job: Job) -> dict[str, Any]:
    """All that is asked."""
    provide(os.path.join(orekit_jcc.__module_dir__, "resources", "orekit-data"))
    tdb, utc, E = TimeScalesFactory.getTDB(), TimeScalesFactory.getUTC(), FramesFactory.getEME2000()
    date = AbsoluteDate(job.facts["epoch"], tdb)
    frames = {which: body_frame(job.angles(which), date, which) for which in ("exported", "published")}
    out = {"path": paths(job, date, frames["exported"]), **messages(job, date, 2), **messages(job, date, 3)}
    for which, frame in frames.items():
        out[f"C_AE_{which}"] = [matrix(E, frame, date.shiftedBy(t)) for t in job.asked["turn_times"].tolist()]
    j2000 = AbsoluteDate(2000, 1, 1, 12, 0, 0.0, tdb)
    for name in ("IERS_1996", "IERS_2003", "IERS_2010"):
        ecliptic = FramesFactory.getEcliptic(getattr(IERSConventions, name))
        out[f"C_EN_{name}"] = matrix(ecliptic, E, j2000)
    out["C_EI"] = matrix(FramesFactory.getGCRF(), E, j2000)
    out["utc_s"] = AbsoluteDate(job.facts["utc"], utc).durationFrom(date)
    return out | surroundings(job, date)


if __name__ == "__main__":
    work("orekit", compute)
