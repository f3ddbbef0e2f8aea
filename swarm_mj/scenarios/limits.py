"""Limits on what a scenario may hold and ask for, so that a mistyped or hostile one is refused and not suffered.

A schema says what each value may be, `swarm_mj.io.values` how deep and long a mapping; here stand the bounds of the
whole: how much time and memory its flight may take.
"""

from __future__ import annotations

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema import Scenario

#: An integer's characters in a file, in any notation: room for values that are refused by name for their size.
MAX_INTEGER_CHARACTERS = 1_000
#: A flight of more spacecraft: the model is compiled for hours.
MAX_SPACECRAFT = 5_000
#: Steps of the integration times spacecraft, about a day of computing at 8 us each.
MAX_SPACECRAFT_STEPS = 10_000_000_000
#: Samples of telemetry times spacecraft, each about 300 bytes and held three times while it is written.
MAX_SPACECRAFT_SAMPLES = 10_000_000
#: Designs of the genetic algorithm that are held at once.
MAX_POPULATION = 100_000


def check_work(scenario: Scenario, source: str) -> None:
    """Make sure that a scenario's flight can be held in memory and ends in the lifetime of a computer's owner.

    Raises:
        ScenarioError: It asks for more than a limit allows; the message names the keys and the limit.
    """
    n = len(scenario.design.visiting_points) + 1
    flight, physics = f"duration_s = {scenario.duration_s:g}", scenario.physics.timestep_s
    interval = scenario.telemetry.interval_s
    if n > MAX_SPACECRAFT:
        raise ScenarioError(
            f"{source}: design.visiting_points names {n - 1} spacecraft: at most {MAX_SPACECRAFT - 1} (MAX_SPACECRAFT)"
        )
    if n * scenario.duration_s / physics > MAX_SPACECRAFT_STEPS:
        raise ScenarioError(
            f"{source}: {flight} of {n} spacecraft in steps of physics.timestep_s = {physics:g}: at most "
            f"{MAX_SPACECRAFT_STEPS:g} steps of a spacecraft (MAX_SPACECRAFT_STEPS)"
        )
    if n * scenario.duration_s / interval > MAX_SPACECRAFT_SAMPLES:
        raise ScenarioError(
            f"{source}: {flight} of {n} spacecraft sampled every telemetry.interval_s = {interval:g}: at most "
            f"{MAX_SPACECRAFT_SAMPLES:g} samples of a spacecraft (MAX_SPACECRAFT_SAMPLES)"
        )
    if scenario.designer.population > MAX_POPULATION:
        raise ScenarioError(
            f"{source}: designer.population = {scenario.designer.population}: at most {MAX_POPULATION} (MAX_POPULATION)"
        )
