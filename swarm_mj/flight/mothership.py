"""Where the mothership comes from: its state at the epoch, by whichever of the ways the scenario gives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.solid_angle import points_inside
from swarm_mj.typing import Array


class MothershipState(NamedTuple):
    """State of the mothership at the epoch.

    Attributes:
        r_N: Position relative to the body's centre, shape (3,) [m].
        velocity: In N, shape (3,) [m/s]; 'mean' of the deployed velocities; or 'rest' in N.
    """

    r_N: Array
    velocity: Array | str


def mothership_state(scenario: Scenario, environment: Environment) -> MothershipState:
    """The mothership at the epoch, before it releases anybody."""
    asked = scenario.mothership
    velocity = asked.velocity if isinstance(asked.velocity, str) else np.array(asked.velocity)
    return MothershipState(np.array(asked.position_A_m) @ environment.C_AN(0.0), velocity)


def check_outside(scenario: Scenario, shape: ShapeModel) -> None:
    """See that the mothership is not inside the body at the epoch.

    Raises:
        ScenarioError: It is.
    """
    position = np.array([scenario.mothership.position_A_m])
    if points_inside(position, shape.vertices, shape.faces).any():
        raise ScenarioError(f"mothership.position_A_m = {position[0].tolist()}: lies inside {shape.name}")
