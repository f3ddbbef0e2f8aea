"""The picture of an episode: MuJoCo's overview with a marker for each spacecraft and a line along what it looks at."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ObserverError
from swarm_mj.simulation.simulation import Simulation

from .state import SwarmState

#: Half the size of a spacecraft's marker [m]; a CubeSat itself would be far smaller than a pixel.
MARKER_M = 500.0
SIGHT_M = 6000.0
OBSERVES, TALKS, IDLE = (0.2, 0.8, 1.0, 1.0), (1.0, 0.7, 0.1, 1.0), (0.6, 0.6, 0.6, 1.0)


class Overview:
    """Draws the swarm from the model's camera `overview`; holds one OpenGL context until closed.

    Raises:
        ObserverError: OpenGL cannot be loaded here.
    """

    def __init__(self, simulation: Simulation, width: int, height: int) -> None:
        self._model = simulation.model.mjmodel
        self._mocap = simulation.model.asteroid_mocap
        self._data = mujoco.MjData(self._model)
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
        self._renderer.update_scene(self._data, camera="overview")
        for j, (r, sight) in enumerate(zip(state.r_BN_N, state.boresight_N, strict=True)):
            colour = OBSERVES if observing[j] else TALKS if talking[j] else IDLE
            self._marker(r, colour)
            self._line(r, r + SIGHT_M * sight, colour)
        return np.array(self._renderer.render(), dtype=np.uint8)

    def _geom(self) -> mujoco.MjvGeom | None:
        scene = self._renderer.scene
        if scene.ngeom >= scene.maxgeom:
            return None
        scene.ngeom += 1
        return scene.geoms[scene.ngeom - 1]

    def _marker(self, r_N: NDArray[np.float64], colour: tuple[float, ...]) -> None:
        geom = self._geom()
        if geom is not None:
            size, rgba = np.full(3, MARKER_M), np.array(colour, np.float32)
            mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_SPHERE, size, r_N, np.eye(3).ravel(), rgba)
            geom.emission = 1.0

    def _line(self, start: NDArray[np.float64], end: NDArray[np.float64], colour: tuple[float, ...]) -> None:
        geom = self._geom()
        if geom is not None:
            rgba = np.array(colour, np.float32)
            kind = mujoco.mjtGeom.mjGEOM_CAPSULE
            mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), rgba)
            mujoco.mjv_connector(geom, kind, 0.2 * MARKER_M, start, end)
            geom.emission = 1.0

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.close()
