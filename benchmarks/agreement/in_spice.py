"""The flight in SPICE (SpiceyPy): the exported kernels, by their meta-kernel and nothing else."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import spiceypy

from benchmarks.agreement.job import Job, work

FIRST_SPACECRAFT = -900_001


def compute(job: Job) -> dict[str, Any]:
    """All that is asked."""
    folder = job.file("spice")
    os.chdir(folder)
    spiceypy.furnsh("swarm.tm")
    et, code, n = job.asked["et"], str(job.facts["code"]), len(job.facts["names"])
    turn_et = job.facts["et"] + job.asked["turn_times"]
    states = [spiceypy.spkezr(str(FIRST_SPACECRAFT - j), et, "J2000", "NONE", code)[0] for j in range(n)]
    attitudes = [[spiceypy.pxform("J2000", f"SWARM_SC{1 + j}_BODY", t) for j in range(n)] for t in et.tolist()]
    fixed = f"SWARM_{job.facts['body']}_FIXED"
    handle = spiceypy.dasopr("body.bds")
    segment = spiceypy.dlabfs(handle)
    n_vertices, n_plates = spiceypy.dskz02(handle, segment)
    return {
        "spk": 1e3 * np.swapaxes(states, 0, 1),
        "ck_C_BE": attitudes,
        "C_AE_exported": [spiceypy.pxform("J2000", fixed, t) for t in turn_et],
        "C_EN": spiceypy.pxform("ECLIPJ2000", "J2000", 0.0),
        "vertices": 1e3 * np.asarray(spiceypy.dskv02(handle, segment, 1, n_vertices)),
        "plates": spiceypy.dskp02(handle, segment, 1, n_plates),
        "earth_from_sun": 1e3 * np.asarray([spiceypy.spkpos("399", t, "J2000", "NONE", "10")[0] for t in turn_et]),
        "sun_from_body": 1e3 * np.asarray([spiceypy.spkpos("10", t, "J2000", "NONE", code)[0] for t in turn_et]),
        "utc_s": spiceypy.str2et(job.facts["utc"]) - job.facts["et"],
    }


if __name__ == "__main__":
    work("spiceypy", compute)
