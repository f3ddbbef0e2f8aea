"""The figures of a run, one PNG each, and a PDF of each where asked for.

Every picture is composed by a function `compose_NAME(plan, telemetry, result) -> Figure` and saved under `NAME.png`. They
use Matplotlib's Figure objects directly: no display, no global state, so that figures can be drawn in threads. Who draws
them for a run is told in `figures/drawing.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import xarray as xr
from matplotlib.figure import Figure

from swarm_mj.figures.behaviors import compose_behaviors
from swarm_mj.figures.curves import compose_coverage, compose_formation, compose_propulsion
from swarm_mj.figures.data import compose_data, compose_delivered_map
from swarm_mj.figures.histories import (
    compose_navigation,
    compose_pointing_error,
    compose_tracking_error,
    compose_wheel_momentum,
    compose_wheel_speed,
)
from swarm_mj.figures.illumination import compose_illumination
from swarm_mj.figures.links import compose_contacts, compose_links
from swarm_mj.figures.map_figures import compose_footprints, compose_ground_track
from swarm_mj.figures.operation import compose_operation, compose_trajectories
from swarm_mj.figures.style import write
from swarm_mj.figures.target import compose_target
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan

Compose = Callable[[Plan, xr.Dataset, ObservationResult], Figure]


#: File stem of every figure and what composes it; `figures_of` in `figures/drawing.py` says which of them a flight has.
COMPOSERS: dict[str, Compose] = {
    "behaviors": compose_behaviors,
    "trajectories": compose_trajectories,
    "target": compose_target,
    "tracking_error": compose_tracking_error,
    "pointing_error": compose_pointing_error,
    "navigation": compose_navigation,
    "operation": compose_operation,
    "coverage": compose_coverage,
    "ground_track": compose_ground_track,
    "footprints": compose_footprints,
    "illumination": compose_illumination,
    "wheel_speed": compose_wheel_speed,
    "wheel_momentum": compose_wheel_momentum,
    "propulsion": compose_propulsion,
    "links": compose_links,
    "contacts": compose_contacts,
    "data": compose_data,
    "delivered_map": compose_delivered_map,
    "formation": compose_formation,
}


def draw(
    name: str, folder: Path, plan: Plan, telemetry: xr.Dataset, result: ObservationResult, *, pdf: bool = False
) -> None:
    """Write a figure to NAME.png in a folder, and with `pdf` to NAME.pdf beside it."""
    write(COMPOSERS[name](plan, telemetry, result), folder / f"{name}.png", pdf=pdf)
