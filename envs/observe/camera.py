"""Pixels for SwarmObserve-v0: what each spacecraft's camera sees, with what the swarm has seen of the target already."""

from __future__ import annotations

import numpy as np

from swarm_mj.smallbody.environment import LinearMotion
from swarm_mj.typing import Mask, Pixels

from ..pixels import BodyPictures, Poses
from .config import EnvConfig
from .mission import Mission


class SwarmCameras:
    """The cameras of the swarms of episodes.

    Args:
        config: The environment's arguments.
    """

    def __init__(self, config: EnvConfig) -> None:
        self._config = config
        self._bodies: dict[int, BodyPictures] = {}

    def look(self, number: int, mission: Mission, sun: LinearMotion, poses: Poses, seen: Mask) -> Pixels:
        """What the cameras of one episode see, see `SwarmObserveEnv`, shape (n, 3, 64, 64).

        Args:
            number: Of the mission.
            mission: It itself.
            sun: Where the Sun is.
            poses: Of the n spacecraft.
            seen: Cells of the target that have been seen, shape (n_cells,).
        """
        region, config = mission.plan.region, self._config
        if number not in self._bodies:
            angle = config.camera_half_angle_deg or mission.plan.scenario.camera.half_angle_deg
            self._bodies[number] = BodyPictures(mission.plan, angle, config.light, mesh=region.mesh)
        body = self._bodies[number]
        body.sun = sun
        marked = np.zeros((1, len(region.mesh.faces)), np.bool_)
        marked[0, region.target] = seen
        return body.images(body.draw(poses, marked))
