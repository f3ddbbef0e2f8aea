"""The face-ID observer: draws the number of the face under each pixel, and counts pixels.

The whole body is drawn with depth test and back-face culling into a 32-bit integer picture, so that occlusion is the
renderer's work: OpenGL, or compiled code that needs no driver. A cell's visible share is the number of its pixels found over
the number expected of it, which is its projected area in pixels; at most 1, so that a threshold may be put on it, while a
sum of shares would lose the surplus of some cells and is biased low. The picture is normally confined to the window that
holds the target, which spends all pixels where they are needed.

Counts say little about slivers. A triangle of area A and perimeter P pixels that is seen whole gets between A - P/2 and
A + P/2 + 1 pixels (Nosarzewska 1948), hence at least half of the expected A when its inscribed circle, of radius
2 A / P, has 2 pixels. Cells below that, made by clipping at the target's border or seen at grazing angles, are sampled
by rays instead; they are few, and are then neither lost nor counted for the pixels of their neighbours.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarm_mj.errors import ObserverError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraPose, camera_pose
from swarm_mj.observation.gl_faces import OpenGlFaces
from swarm_mj.observation.projection import WHOLE_PICTURE, PictureWindow, project
from swarm_mj.observation.raster import CompiledFaces, box_pixels, count_pixels
from swarm_mj.observation.raycast import MeshObserver, faces_camera, sampled_fraction
from swarm_mj.typing import Array, Ints, Ints32, Mask

Drawing = Literal["opengl", "compiled"]

#: Radius of the inscribed circle [px] from which pixel counts decide, see above.
MIN_INRADIUS_PX = 2.0
#: Pixels to look through for the counted cells, over those of the picture, from which the whole picture is counted instead:
#: thin cells askew have boxes far larger than themselves.
MAX_BOX_PIXELS = 8.0
#: Rays to each cell that is too small for that.
SLIVER_SAMPLES = 16


class FaceIdObserver(MeshObserver):
    """Share of each cell in view, by counting pixels of a face-ID buffer.

    Args:
        region: The target; its whole mesh is drawn.
        camera: The camera; its resolution is that of the buffer.
        crop: Spend the buffer on the part of the picture that holds the target, instead of on the whole picture.
        drawing: `opengl`, or `compiled` code, which shows the same faces and needs neither a driver nor its own thread.
        why: Said of the drawing in `note`.

    Raises:
        ObserverError: OpenGL is asked for and cannot be loaded, or this is a forked child or another thread.
    """

    occlusion = True
    counts_pixels = True
    samples = SLIVER_SAMPLES

    def __init__(
        self,
        region: TargetRegion,
        camera: CameraModel,
        *,
        crop: bool = True,
        drawing: Drawing = "opengl",
        why: str = "",
    ) -> None:
        self.region, self.camera, self.crop = region, camera, crop
        self.name = "faceid" if drawing == "opengl" else "raster"
        draw = OpenGlFaces if drawing == "opengl" else CompiledFaces
        self._drawer: OpenGlFaces | CompiledFaces | None = draw(region.vertices, region.faces, camera)
        self.note = self._drawer.note + why

    def visible_fraction(self, r_A: ArrayLike, C_CA: ArrayLike) -> Array:
        """Share of each cell in view, see `Observer.visible_fraction`."""
        self._open_drawer()
        pose = camera_pose(r_A, C_CA)
        cells = project(pose.to_camera(self.region.corners_A), self.camera)
        candidate = cells.in_picture & faces_camera(self.region, pose)
        fraction = np.zeros(self.region.n_cells)
        if not candidate.any():
            return fraction
        window = cells.window(candidate) if self.crop else WHOLE_PICTURE
        area, inradius = cells.pixels(window, self.camera.resolution_px)
        countable = candidate & cells.ahead & (inradius >= MIN_INRADIUS_PX)
        if countable.any():
            found = self._count(self.face_ids(pose, window), cells.boxes(window, self.camera.resolution_px), countable)
            fraction[countable] = np.minimum(found / area[countable], 1.0)
        slivers = np.flatnonzero(candidate & ~countable)
        if len(slivers):
            fraction[slivers] = sampled_fraction(self.tracer, self.region, slivers, self.camera, pose, SLIVER_SAMPLES)
        return fraction

    def _count(self, picture: NDArray[np.uint32], boxes: Ints32, cells: Mask) -> Ints:
        """Count the pixels of some cells, looking for each only in the box that it may cover."""
        numbers, boxes = self.region.target[cells] + 1, boxes[cells]
        if box_pixels(boxes) > MAX_BOX_PIXELS * picture.size:
            return np.bincount(picture.ravel(), minlength=len(self.region.faces) + 1)[numbers]
        counts = np.empty(len(numbers), np.int64)
        count_pixels(picture, numbers.astype(np.uint32), boxes, counts)
        return counts

    def face_ids(self, pose: CameraPose, window: PictureWindow = WHOLE_PICTURE) -> NDArray[np.uint32]:
        """Draw the face under each pixel of a window of the picture.

        Returns:
            Face of the region's mesh plus one, 0 for the sky; bottom row first, shape (resolution, resolution). The
            array is reused by the next call.

        Raises:
            ObserverError: The observer was closed; or OpenGL draws, and this is a forked child or another thread.
        """
        picture = self._open_drawer().draw(pose, window)
        return picture if min(self.camera.sides) == 1.0 else _cut(picture, window, self.camera.sides)

    def _open_drawer(self) -> OpenGlFaces | CompiledFaces:
        if self._drawer is None:
            raise ObserverError("this face-ID observer was closed: make a new one")
        return self._drawer

    def close(self) -> None:
        """Release what the drawing holds; safe to call twice, in a forked child and at interpreter exit."""
        drawer, self._drawer = self.__dict__.get("_drawer"), None
        if drawer is not None:
            drawer.close()

    def __del__(self) -> None:
        """Close, if nobody did."""
        self.close()


def _cut(picture: NDArray[np.uint32], window: PictureWindow, sides: tuple[float, float]) -> NDArray[np.uint32]:
    """Leave sky where the centre of a pixel of a square picture's window lies outside a rectangle in it; in place."""
    size = len(picture)
    across, down = (window.high - window.low) / size
    x, y = window.low[0] + (np.arange(size) + 0.5) * across, window.high[1] - (np.arange(size) + 0.5) * down
    picture[:, np.abs(x) > sides[0]] = 0
    picture[np.abs(y) > sides[1]] = 0
    return picture
