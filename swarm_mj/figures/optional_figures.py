"""Which figures of a run are drawn: a figure that would have nothing to show is not.

Nothing heavy is imported here.
"""

from __future__ import annotations

from collections.abc import Callable

import xarray as xr

from swarm_mj.io.atomic import FIGURES


def thrusters_fired(telemetry: xr.Dataset) -> bool:
    """Whether any spacecraft of a flight used thrusters."""
    return "delta_v_m_s" in telemetry and bool((telemetry["delta_v_m_s"].values[-1] > 0.0).any())


def formation_flown(telemetry: xr.Dataset) -> bool:
    """Whether a flight's thrusters held a formation."""
    return "formation_error" in telemetry


#: Figures that not every flight has something for, and whether one has; the others are always drawn.
OPTIONAL: dict[str, Callable[[xr.Dataset], bool]] = {
    "propulsion": thrusters_fired,
    "formation": formation_flown,
}


def figures_of(telemetry: xr.Dataset) -> tuple[str, ...]:
    """Stems of the figures that are drawn of a flight, in their order."""
    return tuple(name for name in FIGURES["run"] if name not in OPTIONAL or OPTIONAL[name](telemetry))
