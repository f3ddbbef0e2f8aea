"""The figures of a run, one PNG each.

Every picture is composed by a function `compose_NAME(plan, telemetry, result) -> Figure` and saved under `NAME.png`. They
use Matplotlib's Figure objects directly: no display, no global state, so that figures can be drawn in threads.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import xarray as xr
from matplotlib.figure import Figure

from swarm_mj.flight import ObservationResult
from swarm_mj.output.figures.coverage import compose_coverage
from swarm_mj.output.figures.histories import compose_pointing_error, compose_tracking_error, compose_wheel_speed
from swarm_mj.output.figures.links import compose_links
from swarm_mj.output.figures.operation import compose_operation
from swarm_mj.output.figures.style import save
from swarm_mj.output.figures.target import compose_target
from swarm_mj.planning import Plan

Compose = Callable[[Plan, xr.Dataset, ObservationResult], Figure]
Draw = Callable[[Path, Plan, xr.Dataset, ObservationResult], None]

#: File stem of every figure and what composes it.
COMPOSERS: dict[str, Compose] = {
    "target": compose_target,
    "tracking_error": compose_tracking_error,
    "pointing_error": compose_pointing_error,
    "operation": compose_operation,
    "coverage": compose_coverage,
    "wheel_speed": compose_wheel_speed,
    "links": compose_links,
}


def _writer(compose: Compose) -> Draw:
    def draw(path: Path, plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> None:
        save(compose(plan, telemetry, result), path)

    return draw


#: File stem of every figure and the function that writes it to a path.
FIGURES: dict[str, Draw] = {name: _writer(compose) for name, compose in COMPOSERS.items()}
