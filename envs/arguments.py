"""Checks of the environment's arguments; every refusal is a `ScenarioError` that says what is allowed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema import Scenario, is_multiple


def checked_render_mode(mode: str | None, modes: Sequence[str]) -> str | None:
    """The render mode, if it is None or one of those given."""
    if mode is not None and mode not in modes:
        raise ScenarioError(f"render_mode = {mode!r}: must be None or one of {', '.join(modes)}")
    return mode


def checked_share(percent: float) -> float:
    """The share of the target that counts as complete [%]."""
    if not 0.0 < percent <= 100.0:
        raise ScenarioError(f"complete = {percent}: must be above 0 and at most 100 percent")
    return percent


def checked_step(scenario: Scenario, step_s: float) -> tuple[int, int]:
    """Control periods in a step of that length [s] and in the flight."""
    period, duration = scenario.control.period_s, scenario.duration_s
    if not step_s > 0.0 or not is_multiple(step_s, period) or not is_multiple(duration, step_s):
        raise ScenarioError(
            f"step_s = {step_s}: must be a whole multiple of control.period_s = {period:g} s and divide the scenario's "
            f"duration_s = {duration:g} s"
        )
    return round(step_s / period), round(duration / period)


def flight_seed(options: dict[str, Any] | None, drawn: int) -> int:
    """The seed that `reset` options ask for, else the one drawn."""
    given = dict(options or {})
    seed = given.pop("flight_seed", drawn)
    if given:
        raise ScenarioError(f"reset options {sorted(given)}: unknown; allowed: flight_seed")
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ScenarioError(f"reset option flight_seed = {seed!r}: must be a whole number of at least 0")
    return int(seed)
