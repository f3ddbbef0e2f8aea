"""How the visit was flown, from telemetry."""

from __future__ import annotations

import numpy as np
import xarray as xr

from swarm_mj.flight.observe import visit_sample
from swarm_mj.flight.plan import Plan
from swarm_mj.typing import Array


def visit_miss_m(plan: Plan, telemetry: xr.Dataset) -> Array:
    """Distance of each spacecraft, as flown, from where it was to be at the time of flight [m], shape (n,)."""
    flown = telemetry["r_BN_N"].values[visit_sample(plan.scenario)]
    return np.asarray(np.linalg.norm(flown - plan.deployment.destination_N, axis=-1))
