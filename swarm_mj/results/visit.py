"""How the visit was flown, from telemetry."""

from __future__ import annotations

import numpy as np
import xarray as xr

from swarm_mj.flight.plan import Plan
from swarm_mj.typing import Array


def visit_miss_m(plan: Plan, telemetry: xr.Dataset) -> Array:
    """Distance of each spacecraft, as flown, from where it was to be at its visit [m], shape (n,)."""
    visits = np.rint(plan.deployment.arrival_s / plan.scenario.telemetry.interval_s).astype(np.int64)
    flown = telemetry["r_BN_N"].values[visits, np.arange(plan.n)]
    return np.asarray(np.linalg.norm(flown - plan.deployment.destination_N, axis=-1))
