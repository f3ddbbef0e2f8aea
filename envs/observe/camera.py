"""Pixels for SwarmObserve-v0: what each spacecraft's camera sees, with what the swarm has seen of the target already."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array32, Pixels

from ..arguments import is_number
from ..pixels import IMAGE_SPACE, LIGHTS, BodyPictures, Poses
from .draws import EpisodeDraw
from .episodes import Episodes
from .rendering import lit_plan
from .single import SwarmObserveEnv


class CameraObservation(gymnasium.ObservationWrapper[dict[str, Any], Any, Array32]):
    """Adds the pictures of the n spacecraft to the observation of `SwarmObserve-v0`.

    The observation is a Dict: `state`, what the environment observes, and `image`, uint8, (n, 3, 64, 64), +x of the
    spacecraft to the right and +y down:

    | channel | meaning |
    |---|---|
    | 0 | grey: 255 times the cosine of the light's angle of incidence; the body casts no shadow on itself |
    | 1 | mask: 255 where the cell of the target has been seen by anybody |
    | 2 | nearness: 255 times the body's largest radius over depth along +z, at most 255; 0 in the sky |

    Attitudes and positions are the true ones at the end of the step, whatever sensors are flown. The mesh is that of the
    target's cells, unsimplified.

    Args:
        env: A single `SwarmObserve-v0`.
        half_angle_deg: Of the camera; None: of the mission's.
        light: `sun` or `headlight`.

    Raises:
        ScenarioError: It is another environment, or an argument is not allowed.
    """

    def __init__(
        self, env: gymnasium.Env[Array32, Any], half_angle_deg: float | None = None, light: str = "sun"
    ) -> None:
        super().__init__(env)
        inner = env.unwrapped
        if not isinstance(inner, SwarmObserveEnv):
            raise ScenarioError(f"CameraObservation: must be given a SwarmObserve-v0, not {type(inner).__name__}")
        if light not in LIGHTS:
            raise ScenarioError(f"light = {light!r}: must be one of {', '.join(LIGHTS)}")
        if half_angle_deg is not None and not (is_number(half_angle_deg) and 0.0 < half_angle_deg < 90.0):
            raise ScenarioError(f"half_angle_deg = {half_angle_deg!r}: must be a number above 0 and below 90")
        self._inner, self._angle, self._light = inner, half_angle_deg, light
        self._drawn: EpisodeDraw | None = None
        image = spaces.Box(0, 255, (inner.batch.n, *IMAGE_SPACE.shape), np.uint8)
        self.observation_space = spaces.Dict({"image": image, "state": env.observation_space})

    def observation(self, observation: Array32) -> dict[str, Any]:
        """The observation with what the cameras see now."""
        return {"image": self.image(), "state": observation}

    def image(self) -> Pixels:
        """What the cameras see now, shape (n, 3, 64, 64)."""
        episodes = self._inner.batch
        if self._drawn is not episodes.draws[0]:
            self._begin(episodes)
        now, region = (
            episodes.now if episodes.flights.finite[0] else episodes.before,
            episodes.mission_of(0).plan.region,
        )
        n = episodes.n
        poses = Poses(now.r[0], now.q[0], np.tile(now.C_AN[0], (n, 1, 1)), np.full(n, now.t[0]))
        self._marked[0, region.target] = episodes.totals.seen[0, : region.n_cells]
        return self._pictures.images(self._pictures.draw(poses, self._marked))

    def _begin(self, episodes: Episodes) -> None:
        """Take the body and the light of the episode."""
        mission = episodes.mission_of(0)
        plan, self._drawn = lit_plan(episodes, 0), episodes.draws[0]
        angle = plan.scenario.camera.half_angle_deg if self._angle is None else self._angle
        self._pictures = BodyPictures(plan, angle, self._light, mesh=mission.plan.region.mesh)
        self._marked = np.zeros((1, len(mission.plan.region.mesh.faces)), np.bool_)
