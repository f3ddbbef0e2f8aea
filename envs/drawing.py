"""The picture of an episode: an overview by MuJoCo with a marker for each spacecraft and a line along its boresight.

The camera looks onto the plane of the flyby from its sunlit side and draws back as the swarm spreads.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ObserverError
from swarm_mj.planning import Plan
from swarm_mj.simulation.simulation import Simulation

from .state import SwarmState

#: Radius of a spacecraft's marker and length of its line of sight over the camera's distance; a CubeSat itself would be far
#: smaller than a pixel.
MARKER, SIGHT = 0.009, 0.08
#: Distance of the camera from the body's centre over that of the farthest spacecraft, and least over the body's radius.
BACK_OFF, LEAST = 2.9, 3.2
OBSERVES, TALKS, IDLE = (0.2, 0.8, 1.0, 1.0), (1.0, 0.7, 0.1, 1.0), (0.6, 0.6, 0.6, 1.0)


class Overview:
    """Draws the swarm; holds one OpenGL context until closed.

    Raises:
        ObserverError: OpenGL cannot be loaded here.
    """

    def __init__(self, plan: Plan, simulation: Simulation, width: int, height: int) -> None:
        self._model = simulation.model.mjmodel
        self._mocap = simulation.model.asteroid_mocap
        self._data = mujoco.MjData(self._model)
        self._from_N, self._least = _view_direction(plan), LEAST * plan.shape.max_radius
        try:
            self._renderer = mujoco.Renderer(self._model, height=height, width=width)
        except Exception as error:  # whatever the platform's OpenGL loader raises
            raise ObserverError(
                f"render_mode 'rgb_array' needs OpenGL, which cannot be loaded here ({type(error).__name__}: {error}); "
                "install libegl1 and set MUJOCO_GL=egl before starting Python"
            ) from error

    def draw(
        self,
        simulation: Simulation,
        state: SwarmState,
        observing: NDArray[np.bool_],
        talking: NDArray[np.bool_],
    ) -> NDArray[np.uint8]:
        """A picture, shape (height, width, 3). The simulation is only read."""
        self._data.qpos[:] = simulation.data.qpos
        mujoco.mju_mat2Quat(self._data.mocap_quat[self._mocap], np.ascontiguousarray(state.C_AN.T).ravel())
        mujoco.mj_fwdPosition(self._model, self._data)
        distance = max(self._least, BACK_OFF * float(np.linalg.norm(state.r_BN_N, axis=1).max()))
        self._renderer.update_scene(self._data, camera=self._camera(distance))
        for j, (r, sight) in enumerate(zip(state.r_BN_N, state.boresight_N, strict=True)):
            colour = OBSERVES if observing[j] else TALKS if talking[j] else IDLE
            self._marker(r, MARKER * distance, colour)
            self._line(r, r + SIGHT * distance * sight, 0.25 * MARKER * distance, colour)
        return np.array(self._renderer.render(), dtype=np.uint8)

    def _camera(self, distance: float) -> mujoco.MjvCamera:
        camera = mujoco.MjvCamera()
        x, y, z = -self._from_N
        camera.azimuth, camera.elevation = np.degrees([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])
        camera.distance = distance
        return camera

    def _geom(self) -> mujoco.MjvGeom | None:
        scene = self._renderer.scene
        if scene.ngeom >= scene.maxgeom:
            return None
        scene.ngeom += 1
        return scene.geoms[scene.ngeom - 1]

    def _marker(self, r_N: NDArray[np.float64], radius: float, colour: tuple[float, ...]) -> None:
        geom = self._geom()
        if geom is not None:
            size, rgba = np.full(3, radius), np.array(colour, np.float32)
            mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_SPHERE, size, r_N, np.eye(3).ravel(), rgba)
            geom.emission = 1.0

    def _line(
        self, start: NDArray[np.float64], end: NDArray[np.float64], radius: float, colour: tuple[float, ...]
    ) -> None:
        geom = self._geom()
        if geom is not None:
            rgba = np.array(colour, np.float32)
            kind = mujoco.mjtGeom.mjGEOM_CAPSULE
            mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), rgba)
            mujoco.mjv_connector(geom, kind, radius, start, end)
            geom.emission = 1.0

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.close()


def _view_direction(plan: Plan) -> NDArray[np.float64]:
    """Across the plane of the flyby, on the side of the Sun; along the Sun's light if the flyby has no plane."""
    sun_N = plan.environment.sun.position / np.linalg.norm(plan.environment.sun.position)
    start, velocity = plan.deployment.r0_N, plan.deployment.v0_N.mean(axis=0)
    across = np.cross(start, velocity)
    size = float(np.linalg.norm(across))
    if size < 1e-6 * float(np.linalg.norm(start) * np.linalg.norm(velocity)):
        return sun_N
    return across / size * (1.0 if across @ sun_N >= 0.0 else -1.0)
