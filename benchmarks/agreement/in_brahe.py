"""The flight in brahe: its gravity, rotations and integrator RKF78, and its reader of CCSDS messages."""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import Any

import brahe
import numpy as np
from brahe import ccsds
from numpy.typing import NDArray

from benchmarks.agreement.coefficients import icgem
from benchmarks.agreement.job import Job, work

Array = NDArray[np.float64]
LONGEST_STEP_S = 100.0


def body_attitude(angles: tuple[float, float, float, float], t: float) -> Array:
    """C_AE by brahe's elementary rotations."""
    ra, dec, w, rate = angles
    turn = brahe.RotationMatrix
    radians = brahe.AngleFormat.RADIANS
    whole = turn.Rz(w + rate * t, radians) * turn.Rx(pi / 2 - dec, radians) * turn.Rz(pi / 2 + ra, radians)
    return np.asarray(whole.to_matrix())


def attraction(job: Job) -> Callable[[float, Array], Array]:
    """Acceleration in E [m/s^2] of time and position in E."""
    gm, terms, angles = job.facts["gm"], job.facts["terms"], job.angles("exported")
    if not terms:
        return lambda t, r: np.asarray(brahe.accel_point_mass_gravity(r, np.zeros(3), gm))
    file = job.folder / "field_brahe.gfc"
    file.write_text(icgem("FIELD", gm, job.facts["radius"], terms), encoding="utf-8")
    model = brahe.GravityModel.from_file(str(file))
    degree = model.n_max
    return lambda t, r: np.asarray(
        brahe.accel_gravity_spherical_harmonics(r, body_attitude(angles, t), model, degree, degree)
    )


def paths(job: Job) -> Array:
    """States in E, shape (t, n, 6)."""
    acceleration, times = attraction(job), job.asked["times"]
    config = brahe.IntegratorConfig.adaptive(1e-9, 1e-13)

    def rates(t: float, state: Array) -> Array:
        return np.concatenate([state[3:], acceleration(t, state[:3])])

    out = np.empty((len(times), *job.asked["start_E"].shape))
    for j, state in enumerate(job.asked["start_E"]):
        integrator = brahe.RKF78Integrator(6, rates, config=config)
        t, y = 0.0, state
        for k, end in enumerate(times):
            while t < end:
                result = integrator.step(t, y, min(end - t, LONGEST_STEP_S))
                t, y = (end if result.dt_used == end - t else t + result.dt_used), result.state
            out[k, j] = y
    return out


def messages(job: Job) -> dict[str, Any]:
    """States of the OEMs and quaternions (w, x, y, z) of the AEMs 2.0 (it reads no 1.0), shapes (t, n, 6) and (t, n, 4)."""
    out = {}
    for generation, key in ((2, "oem"), (3, "oem3")):
        files = [ccsds.OEM.from_file(name).segments[0].states for name in job.files("oem", generation)]
        out[key] = np.swapaxes([[[*state.position, *state.velocity] for state in file] for file in files], 0, 1)
    attitudes = []
    for name in job.files("aem", 3):
        quaternions = [state.quaternion for state in ccsds.AEM.from_file(name).segments[0].states]
        attitudes.append([[q.w, q.x, q.y, q.z] for q in quaternions])
    return {**out, "aem3_q_BE": np.swapaxes(attitudes, 0, 1)}


def compute(job: Job) -> dict[str, Any]:
    """All that is asked."""
    out = {"path": paths(job), **messages(job), "C_EI": brahe.rotation_gcrf_to_eme2000()}
    for which in ("exported", "published"):
        out[f"C_AE_{which}"] = [body_attitude(job.angles(which), t) for t in job.asked["turn_times"]]
    try:
        brahe.spk_state_from_kernel(job.file("spice/swarm.bsp"), -900001, job.facts["code"], epoch(job))
        out["spk_error"] = ""
    except Exception as error:  # whatever brahe says is told on the page
        out["spk_error"] = str(error)
    return out


def epoch(job: Job) -> Any:
    """Of the flight."""
    date, clock = job.facts["epoch"].split("T")
    hour, minute, second = clock.split(":")
    day = [int(part) for part in date.split("-")]
    return brahe.Epoch.from_datetime(*day, int(hour), int(minute), float(second), 0.0, brahe.TimeSystem.TDB)


if __name__ == "__main__":
    work("brahe", compute)
