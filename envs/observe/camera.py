"""Pixels for SwarmObserve-v0: what each spacecraft's camera sees, with what the swarm has seen of the target already."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swarm_mj.typing import Pixels

from ..pixels import IMAGE_SPACE, BodyPictures, Poses

if TYPE_CHECKING:
    from .episodes import Episodes


class SwarmCameras:
    """The cameras of all episodes.

    Args:
        episodes: Which.
    """

    def __init__(self, episodes: Episodes) -> None:
        self._episodes = episodes
        self._bodies: dict[int, BodyPictures] = {}

    def images(self) -> Pixels:
        """What they see now, see `SwarmObserveEnv`, shape (E, n, 3, 64, 64); nothing in episodes that have not begun."""
        episodes = self._episodes
        out = np.zeros((episodes.count, episodes.n, *IMAGE_SPACE.shape), np.uint8)
        for e in range(episodes.count):
            if episodes.draws[e] is not None:
                out[e] = self._images_of(e)
        return out

    def _images_of(self, e: int) -> Pixels:
        episodes, number = self._episodes, int(self._episodes.mission[e])
        mission = episodes.mission_of(e)
        region, config, n = mission.plan.region, episodes.config, episodes.n
        if number not in self._bodies:
            angle = config.camera_half_angle_deg or mission.plan.scenario.camera.half_angle_deg
            self._bodies[number] = BodyPictures(mission.plan, angle, config.light, mesh=region.mesh)
        body = self._bodies[number]
        body.sun = episodes.sun_of(e)
        now = episodes.now if episodes.flights.finite[e] else episodes.before
        poses = Poses(now.r[e], now.q[e], np.tile(now.C_AN[e], (n, 1, 1)), np.full(n, now.t[e]))
        marked = np.zeros((1, len(region.mesh.faces)), np.bool_)
        marked[0, region.target] = episodes.totals.seen[e, : region.n_cells]
        return body.images(body.draw(poses, marked))
