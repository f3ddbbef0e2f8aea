"""What every way of observing offers, and the choice between them."""

from typing import Literal, Protocol

from numpy.typing import ArrayLike

from swarm_mj.errors import ObserverError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.raycast import RayTracer
from swarm_mj.typing import Array

ObserverKind = Literal["auto", "faceid", "raster", "raycast", "horizon"]


class Observer(Protocol):
    """Looks at a target through a camera.

    Attributes:
        name: `faceid`, `raster`, `raycast` or `horizon`.
        note: Why this one was chosen, or what it runs on; one line for the reader of a run.
        region: The target whose cells are judged.
        camera: The camera through which they are seen.
        occlusion: Whether the body hides what lies behind it.
        counts_pixels: Whether it judges other cells by their pixels.
    """

    name: str
    note: str
    region: TargetRegion
    camera: CameraModel
    occlusion: bool
    counts_pixels: bool

    @property
    def samples(self) -> int:
        """Sample points of each cell that is judged by samples."""
        ...

    @property
    def tracer(self) -> RayTracer:
        """Ray tracer over the region's mesh."""
        ...

    def visible_fraction(self, r_A: ArrayLike, C_CA: ArrayLike) -> Array:
        """Share of each cell that is in the picture, neither hidden nor outside the field of view.

        Args:
            r_A: Camera position in A [m], shape (3,).
            C_CA: Rotation from A to the camera frame, shape (3, 3).

        Returns:
            Values from 0 to 1, shape (n,).

        Raises:
            MissionError: The pose is no position and rotation.
        """
        ...

    def close(self) -> None:
        """Release what the observer holds; it cannot look any more."""
        ...


def make_observer(
    region: TargetRegion, camera: CameraModel, *, kind: ObserverKind = "auto", occlusion: bool = True
) -> Observer:
    """Make an observer: face-ID buffers drawn by OpenGL where it loads, else by compiled code.

    Args:
        region: The target.
        camera: The camera.
        kind: `faceid` (face-ID buffers by OpenGL), `raster` (the same by compiled code), `raycast` (rays to sample points),
            `horizon` (maps, constant time per picture), or `auto` for the first of faceid and raster that this machine
            offers; `note` says why.
        occlusion: Whether the body hides what lies behind it; without it sample points are culled and clipped, no buffer
            is drawn and `kind` plays no part.

    Raises:
        ObserverError: The kind is unknown, or `faceid` was asked for and OpenGL cannot be loaded.
    """
    from swarm_mj.observation.faceid import FaceIdObserver
    from swarm_mj.observation.horizon import HorizonObserver
    from swarm_mj.observation.raycast import RayCastObserver

    if not occlusion:
        return RayCastObserver(
            region, camera, occlusion=False, note="culling and clipping of sample points, no occlusion"
        )
    if kind == "horizon":
        return HorizonObserver(region, camera)
    if kind == "raycast":
        return RayCastObserver(region, camera)
    if kind == "faceid":
        return FaceIdObserver(region, camera)
    if kind == "raster":
        return FaceIdObserver(region, camera, drawing="compiled")
    if kind != "auto":
        raise ObserverError(f"unknown observer {kind!r}: use 'auto', 'faceid', 'raster', 'raycast' or 'horizon'")
    try:
        return FaceIdObserver(region, camera)
    except ObserverError as error:
        return FaceIdObserver(region, camera, drawing="compiled", why=f", since OpenGL is not available: {error}")
