"""Pictures with true light: how bright each pixel of a detector is, shadows included, by compiled code.

A picture is a map of radiance factors I/F (see `photometry`), averaged over the area of each pixel. What is drawn:

1. Face numbers of a grid of samples, several along each pixel, by the rasteriser. Small bodies get more of them, up to `MOST`
   along a pixel, and where the lens spreads them first, 4 times as many, so that a body of five pixels is as well
   sampled as one that fills the picture.
2. The same from the Sun, over what of the body the picture shows, see `shadows`.
3. For each sample the point where its line of sight meets the plane of its face, in double precision, and whether it lies in
   shadow.
4. The radiance factor there, linear between those at the corners of the face.
5. Between two samples that an edge of the mesh parts, their areas as the edge parts them: along rows where it is steep, along
   columns where it is flat. What samples leave then is left at shadows alone. Not where the lens bends.

Faces are flat and as bright as their law says at their own incidence and emission. The Sun is a point: under a high Sun, what
its disc would soften is less than a pixel wherever a shadow is cast from less than a hundred pixels away. Faces send no light
to each other.
"""

from __future__ import annotations

from functools import lru_cache
from math import ceil, floor, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.special import ndtr

from swarm_mj.compilation import allocation_free, jittable, kernel
from swarm_mj.observation.camera import CameraPose
from swarm_mj.observation.lens import Lens
from swarm_mj.observation.photometry import Surface, radiance_factor
from swarm_mj.observation.raster import (
    NEAREST,
    Canvas,
    Mesh,
    View,
    corner,
    draw_faces,
    make_canvas,
    make_mesh,
    twice_area,
)
from swarm_mj.observation.shadows import SunMap, draw_from_sun, find_clear, frame, is_lit, make_sun_map, turn_to
from swarm_mj.typing import Array, Array32, Ints32, Mask

#: Samples along a side of the grid that is drawn at once, and of the smaller one for what fits on it.
GRID, SMALL_GRID = 1040, 400
#: Fewest and most samples along a pixel.
FEWEST, MOST = 2, 64
#: Samples along a pixel for labels where the lens bends.
BENT = 8
#: Up to so many pixels a body is spread by the lens before pixels collect its light: of parts of a pixel, so many along one at
#: least and at most, of so many samples each at least, and so many samples along a pixel: with fewer, shadows of a bright
#: crescent err by more than its light's noise.
SMALL_PX, PARTS, PART_SAMPLES, SMALL_SAMPLES = 32, (4, 64), 4, 32
#: Places along a side of the map from the Sun, and of that for the smaller grid.
SUN_GRID, SMALL_SUN_GRID = 1280, 640
#: Share of the body's extent across the Sun's direction from which on that map shows all of it: of its places along a side a
#: quarter is lost at most.
WHOLE = 0.75
#: Places of that map for each face from which on it always shows all of the body: what shades a place is one of the faces about
#: it (`is_lit`), however many samples fall there.
MAPPED = 50


class Labels(NamedTuple):
    """What is under the centre of each pixel, row 0 on top; shape (height, width).

    Attributes:
        face: Number of the face, -1 for the sky.
        depth: Distance along the axis of the camera, Z in C [m], 0 for the sky.
        normal: Outward unit normal in A, shape (height, width, 3), 0 for the sky.
        incidence: Angle between normal and Sun [deg], NaN for the sky.
        emission: Angle between normal and camera [deg], NaN for the sky.
        phase: Angle between Sun and camera [deg], NaN for the sky.
        lit: Whether the Sun shines on it.
    """

    face: Ints32
    depth: Array
    normal: Array32
    incidence: Array32
    emission: Array32
    phase: Array32
    lit: Mask


class _Light(NamedTuple):
    """Faces under the Sun.

    Attributes:
        surface: Reflectance law.
        albedo: Factor of each face, shape (f,).
        normals: Outward unit normals in A, shape (f, 3).
        mu0: Cosine of each face's incidence, shape (f,).
        sun: The body as the Sun sees it.
    """

    surface: Surface
    albedo: Array
    normals: Array
    mu0: Array
    sun: SunMap


class _Grid:
    """What pictures are drawn on, and the body as the Sun sees it.

    Args:
        samples: Along a side.
        places: Along a side of the map from the Sun.
        mesh: What is drawn.

    Attributes:
        canvas: The grid of samples.
        sun: The map from the Sun.
        clear: Faces on which that has no shadow, shape (f,).
        whole: Direction from which the map shows the whole body, with all clear faces known; None: it shows a part.
    """

    def __init__(self, samples: int, places: int, mesh: Mesh) -> None:
        sizes = len(mesh.vertices), len(mesh.faces)
        self.canvas, self.sun = make_canvas(samples, *sizes), make_sun_map(make_canvas(places, *sizes))
        self.clear = np.zeros(sizes[1], np.bool_)
        self.whole: bytes | None = None


class ShadedBody:
    """Draws pictures of a body in the light of the Sun.

    Args:
        vertices: In A [m], shape (v, 3).
        faces: Vertex indices, counter-clockwise seen from outside, shape (f, 3).
        surface: How it reflects.
        face_albedo: Factor of each face, shape (f,); None: 1.
    """

    def __init__(
        self, vertices: Array, faces: NDArray[np.integer], surface: Surface, face_albedo: Array | None = None
    ) -> None:
        self.surface = surface
        self._mesh = make_mesh(vertices, faces)
        self._albedo = np.ones(len(faces)) if face_albedo is None else np.array(face_albedo, np.float64)
        self._grids = [_Grid(*size, self._mesh) for size in ((SMALL_GRID, SMALL_SUN_GRID), (GRID, SUN_GRID))]
        self._use_grid(GRID)
        self._planes = np.empty((len(faces), 12))
        self._edges = _edges_of(self._mesh.faces)
        self._outermost = np.zeros((2, GRID**2), np.float32)
        self._seen, self._all, self._front = np.zeros((3, len(faces)), np.bool_)
        self._all[:] = True
        self.move(vertices)

    def move(self, vertices: Array) -> None:
        """Put the vertices elsewhere [m], shape (v, 3), as those of a companion on its way."""
        self._mesh.vertices[:] = vertices
        corners = self._mesh.vertices[self._mesh.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        self._normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0)
        self._extent = float(np.ptp(self._mesh.vertices, axis=0).max())
        for grid in self._grids:
            grid.whole = None

    def draw(
        self, lens: Lens, pose: CameraPose, sun_A: Array, *, samples: int | None = None, fewest: int = FEWEST
    ) -> Array32:
        """Radiance factors of a picture, row 0 on top, shape (height, width).

        Args:
            lens: The detector behind its lens.
            pose: Of the camera, in A.
            sun_A: Direction to the Sun in A, of any length, shape (3,).
            samples: Along each pixel; None: as many as fit, at least `fewest` and at most `MOST`.
            fewest: See `samples`.
        """
        out = np.zeros((lens.height, lens.width), np.float32)
        low, high = self._box(lens, pose)
        size = high - low
        if not (size > 0).all():
            return out
        along = samples or min(max(GRID // (int(size.max()) + 2), fewest), MOST)
        self._use_grid(GRID if lens.is_distorted else along * (int(size.max()) + 2))
        # A bent tile may be wider than a straight one; others are drawn with the pixels about them.
        step = max(1, int((GRID // along) * (0.9 if lens.is_distorted else 1.0)) - 2)
        light = self._light(sun_A)
        for top in range(low[1], high[1], step):
            for left in range(low[0], high[0], step):
                tile = left, top, min(left + step, high[0]), min(top + step, high[1])
                self._draw_tile(lens, pose, light, tile, along, out)
        # Shares of several edges in one way may come to a little more than all.
        return np.maximum(out, 0.0, out=out)

    def draw_spread(
        self, lens: Lens, pose: CameraPose, sun_A: Array, psf_px: float, *, fewest: int = FEWEST
    ) -> Array32:
        """Radiance factors of a picture spread by the lens, a Gaussian of some standard deviation [px]; else as `draw`.

        Where the body is but some pixels, it is spread before it falls on them, so that its place within a pixel is not lost.
        """
        low, high = self._box(lens, pose)
        size = int((high - low).max())
        if psf_px > 0.0 and 0 < size <= SMALL_PX:
            margin, most = int(np.ceil(5.0 * psf_px)), np.array([lens.width, lens.height])
            first, stop = np.maximum(low - margin, 0), np.minimum(high + margin, most)
            shown_px = self._extent * lens.focal_px / max(float(np.linalg.norm(pose.r_A)), self._extent)
            parts = int(np.clip((SMALL_GRID // PART_SAMPLES - 2) / shown_px, *PARTS))
            near = lens.zoomed(low.astype(np.float64), high.astype(np.float64), parts)
            samples = max(PART_SAMPLES, ceil(SMALL_SAMPLES / parts))
            fine = self.draw(near, pose, sun_A, samples=samples).astype(np.float64)
            across, down = (
                _pixel_shares(int(a - low[k]), int(b - low[k]), int(high[k] - low[k]), parts, psf_px)
                for k, (a, b) in enumerate(zip(first, stop, strict=True))
            )
            out = np.zeros((lens.height, lens.width), np.float32)
            out[first[1] : stop[1], first[0] : stop[0]] = down @ fine @ across.T
            return out
        drawn = self.draw(lens, pose, sun_A, fewest=fewest)
        if psf_px > 0.0 and size > 0:
            margin = int(np.ceil(5.0 * psf_px))
            rows, columns = (slice(max(low[k] - margin, 0), high[k] + margin) for k in (1, 0))
            drawn[rows, columns] = ndimage.gaussian_filter(drawn[rows, columns], psf_px, mode="nearest", truncate=5.0)
        return drawn

    def depths(self, lens: Lens, pose: CameraPose) -> Array:
        """Distance along the camera's axis under the centre of each pixel, Z in C [m], 0 for the sky; args as of `draw`."""
        return self._under_centres(lens, pose, -pose.C_CA[2], shadows=False)[1]

    def labels(self, lens: Lens, pose: CameraPose, sun_A: Array) -> Labels:
        """What is under the centre of each pixel; args as of `draw`."""
        found = self._under_centres(lens, pose, sun_A, shadows=True)
        return self._labelled(lens, pose, np.asarray(sun_A, np.float64), *found)

    def _under_centres(
        self, lens: Lens, pose: CameraPose, sun_A: Array, *, shadows: bool
    ) -> tuple[Ints32, Array, Mask]:
        """Face, depth and light under the centre of each pixel, see `Labels`; without shadows nothing is lit."""
        height, width = lens.height, lens.width
        face, depth = np.full((height, width), -1, np.int32), np.zeros((height, width))
        self._use_grid(GRID)
        lit, light = np.zeros((height, width), np.bool_), self._light(sun_A)
        # Where the lens bends, centres of pixels are no centres of samples, and samples must be fine.
        along = BENT if lens.is_distorted else 1
        step = int(0.9 * GRID // along) if lens.is_distorted else GRID
        low, high = self._box(lens, pose)
        for top in range(low[1], high[1], step):
            for left in range(low[0], high[0], step):
                tile = left, top, min(left + step, high[0]), min(top + step, high[1])
                view, places = self._draw_grid(lens, pose, light, tile, along, shadows=shadows)
                if view is not None:
                    _prepare(self._mesh, view, self._grid.canvas, light, self._seen, self._planes, shadows)
                    _label(
                        self._mesh,
                        self._grid.canvas,
                        light,
                        self._planes,
                        places,
                        tile,
                        along,
                        shadows,
                        face,
                        depth,
                        lit,
                    )
        return face, depth, lit

    def _labelled(self, lens: Lens, pose: CameraPose, sun_A: Array, face: Ints32, depth: Array, lit: Mask) -> Labels:
        hit = face >= 0
        normal = np.zeros((*face.shape, 3), np.float32)
        normal[hit] = self._normals[face[hit]]
        columns, rows = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
        image = lens.to_image(np.stack((columns, rows), -1)[hit])
        sight = np.column_stack((image, np.ones(len(image)))) @ pose.C_CA
        sight /= -np.linalg.norm(sight, axis=1, keepdims=True)
        to_sun = sun_A / np.linalg.norm(sun_A)
        cosines = (
            self._normals[face[hit]] @ to_sun,
            np.einsum("nk,nk->n", self._normals[face[hit]], sight),
            sight @ to_sun,
        )
        angles = []
        for cosine in cosines:
            angle = np.full(face.shape, np.nan, np.float32)
            angle[hit] = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
            angles.append(angle)
        return Labels(face, depth, normal, angles[0], angles[1], angles[2], lit)

    def _box(self, lens: Lens, pose: CameraPose) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First column and row that the body may have light in, and the first beyond, within the detector."""
        points = pose.to_camera(self._mesh.vertices)
        most = np.array([lens.width, lens.height])
        ahead = points[:, 2] > NEAREST * self._extent
        if not ahead.any():
            return np.zeros(2, np.int64), np.zeros(2, np.int64)
        if not ahead.all():
            return np.zeros(2, np.int64), most
        image = points[:, :2] / points[:, 2:]
        # Far outside the picture a distortion that was fitted within it may fold back.
        pixels = lens.to_pixels(points) if lens.is_distorted else lens.focal_px * image + lens.centre
        low, high = np.floor(pixels.min(axis=0)) - 1, np.ceil(pixels.max(axis=0)) + 1
        if lens.is_distorted and np.abs(lens.focal_px * image).max() > most.max():
            low, high = np.zeros(2), most
        return np.clip(low, 0, most).astype(np.int64), np.clip(high, 0, most).astype(np.int64)

    def _use_grid(self, needed: int) -> None:
        """Draw on the smallest grid with so many samples along a side, or the largest."""
        self._grid = self._grids[0 if needed <= SMALL_GRID else 1]

    def _light(self, sun_A: Array) -> _Light:
        to_sun = np.asarray(sun_A, np.float64) / np.linalg.norm(sun_A)
        turn_to(self._grid.sun, *to_sun)
        return _Light(self.surface, self._albedo, self._normals, self._normals @ to_sun, self._grid.sun)

    def _draw_grid(
        self,
        lens: Lens,
        pose: CameraPose,
        light: _Light,
        tile: tuple[int, int, int, int],
        along: int,
        *,
        shadows: bool = True,
        margin: int = 0,
    ) -> tuple[View | None, Array]:
        """Draw the faces of a tile from the camera and, for shadows, those from the Sun that may shade them.

        The first pixel of the tile is so many from the upper left corner of the grid as `margin` says, in both directions.

        Returns:
            The view, None where there is nothing; and where each pixel lies on the grid, shape (rows, columns, 6), see
            `_places`, or (0, 0, 6) where the lens bends nothing.
        """
        left, top, right, bottom = tile
        places, corner = np.empty((0, 0, 6)), (np.array([left, top]) - margin - lens.centre) / lens.focal_px
        if lens.is_distorted:
            places, corner = _places(lens, tile)
        scale = along * lens.focal_px  # samples at unit distance
        # Columns to the right; rows upward from the lower edge of the grid.
        pixel_from_C = np.array(
            [
                [scale, 0.0, -scale * corner[0]],
                [0.0, -scale, self._grid.canvas.row_span.shape[0] + scale * corner[1]],
                [0.0, 0.0, 1.0],
            ]
        )
        view = View(np.array(pose.r_A, np.float64), pixel_from_C @ pose.C_CA, NEAREST * self._extent)
        draw_faces(self._mesh, view, self._grid.canvas)
        box = np.empty(4)
        if _mark_seen(self._mesh, self._grid.canvas, light, self._seen, box) and shadows:
            self._draw_sun_map(box)
        return (view, places) if self._seen.any() else (None, places)

    def _draw_sun_map(self, box: Array) -> None:
        """Draw what may shade a box across the Sun's direction [m].

        Of all the body where the box is `WHOLE` of it or more, or faces are large (`MAPPED`): that serves all tiles, and all
        pictures in the same light.
        """
        grid = self._grid
        direction = grid.sun.axes[2].tobytes()
        across = self._mesh.vertices @ grid.sun.axes[:2].T
        low, high = across.min(axis=0), across.max(axis=0)
        places = grid.sun.canvas.row_span.shape[0] ** 2
        whole = places >= MAPPED * len(self._all) or max(box[2] - box[0], box[3] - box[1]) >= WHOLE * (high - low).max()
        if whole and grid.whole == direction:
            return
        grid.whole = direction if whole else None
        frame(grid.sun, *((*low, *high) if whole else box))
        draw_from_sun(self._mesh, grid.sun)
        find_clear(self._mesh, grid.sun.canvas, self._all if whole else self._seen, grid.clear)

    def _draw_tile(
        self, lens: Lens, pose: CameraPose, light: _Light, tile: tuple[int, int, int, int], along: int, out: Array32
    ) -> None:
        margin = 0 if lens.is_distorted else 1
        view, places = self._draw_grid(lens, pose, light, tile, along, margin=margin)
        if view is None:
            return
        canvas, clear = self._grid.canvas, self._grid.clear
        _prepare(self._mesh, view, canvas, light, self._seen, self._planes, True)
        if lens.is_distorted:
            _shade_bent(self._mesh, canvas, light, self._planes, clear, places, tile, along, out)
        else:
            _shade(self._mesh, canvas, light, self._planes, clear, tile, along, out)
            _part_at_edges(
                self._mesh,
                self._edges,
                self._outermost,
                self._front,
                canvas,
                light,
                self._seen,
                self._planes,
                clear,
                tile,
                along,
                out,
            )


def _edges_of(faces: Ints32) -> Ints32:
    """Edges of a mesh, shape (e, 4): from a vertex to another, the face on the left seen from outside, and that on the right.

    Where a mesh is open, or more than two faces meet, -1 stands for the face on the right.
    """
    start, stop = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    face, count = np.repeat(np.arange(len(faces)), 3), int(faces.max(initial=0)) + 1
    there, back = start.astype(np.int64) * count + stop, stop.astype(np.int64) * count + start
    order = np.argsort(there, kind="stable")
    at = np.minimum(np.searchsorted(there[order], back), len(order) - 1)
    right = np.where(there[order][at] == back, face[order][at], -1)
    once = (start < stop) | (right < 0)
    return np.column_stack((start, stop, face, right))[once].astype(np.int32)


@lru_cache(maxsize=256)
def _pixel_shares(first: int, stop: int, count: int, parts: int, sigma_px: float) -> Array:
    """Means over pixels of what parts of some pixels, counted from the first of these, send there through a Gaussian spread.

    Shape (stop - first, count * parts).
    """
    middle = (np.arange(count * parts) + 0.5) / parts
    return np.asarray(np.diff(ndtr((np.arange(first, stop + 1)[:, None] - middle) / sigma_px), axis=0) / parts)


def _places(lens: Lens, tile: tuple[int, int, int, int]) -> tuple[Array, Array]:
    """Where pixels of a tile lie on the ideal picture, in pixels from its upper left corner, and that corner's image point.

    Of each pixel: its centre's place (x, y), and how that moves with the detector's x and y (xx, xy, yx, yy).
    """
    left, top, right, bottom = tile
    columns, rows = np.meshgrid(np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5)
    image = lens.to_image(np.stack((columns, rows), -1))
    slope = np.linalg.inv(lens.distortion_jacobian(image))
    corner = image.reshape(-1, 2).min(axis=0) - 1.0 / lens.focal_px
    return np.concatenate((lens.focal_px * (image - corner), slope.reshape(*image.shape[:2], 4)), axis=-1), corner


@kernel
def _mark_seen(mesh: Mesh, canvas: Canvas, light: _Light, seen: Mask, box: Array) -> bool:
    """Mark the faces in a picture; the box of those that face the Sun, across its direction; whether there is any."""
    seen[:] = False
    picture = canvas.picture
    last = np.uint32(0)
    for i in range(canvas.row_span.shape[0] ** 2):
        number = picture[i]
        if number != last:
            last = number
            if number > 0:
                seen[number - 1] = True
    box[:2], box[2:] = np.inf, -np.inf
    axes = light.sun.axes
    for f in range(len(seen)):
        if not (seen[f] and light.mu0[f] > 0.0):
            continue
        for c in range(3):
            p = mesh.vertices[mesh.faces[f, c]]
            for k in range(2):
                at = axes[k, 0] * p[0] + axes[k, 1] * p[1] + axes[k, 2] * p[2]
                box[k], box[2 + k] = min(box[k], at), max(box[2 + k], at)
    return box[2] > box[0]


@kernel
def _prepare(mesh: Mesh, view: View, canvas: Canvas, light: _Light, seen: Mask, planes: Array, shadows: bool) -> None:
    """Write what is needed of each face that is seen, for a sample at a column and a row of the grid; without shadows 3 to 5.

    - 0 to 2: its radiance factor at (0, 0), and how that grows along columns and rows;
    - 3 to 5: the same of q, by how much the height above the face's plane falls along the line of sight where that goes on by
      1 along the camera's axis, over the camera's height; so that 1 / q is the distance along that axis, Z in C [m];
    - 6 to 8: the same of the column on the map from the Sun, times q; 9 to 11: of its row.
    """
    s, r, grid, axes = light.sun.axes[2], view.r_A, light.sun.grid, light.sun.axes
    A_from_pixel = np.linalg.inv(view.pixel_from_A)
    value, sun = np.empty(3), np.empty(2)
    for k in range(2):
        sun[k] = axes[k, 0] * r[0] + axes[k, 1] * r[1] + axes[k, 2] * r[2] - grid[k]
    for f in range(len(seen)):
        if not seen[f]:
            continue
        mu0, n, first = light.mu0[f], light.normals[f], mesh.vertices[mesh.faces[f, 0]]
        below = n[0] * (first[0] - r[0]) + n[1] * (first[1] - r[1]) + n[2] * (first[2] - r[2])
        for k in range(3):
            ray = A_from_pixel[:, (2, 0, 1)[k]]
            q = (n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2]) / below if below != 0.0 else 0.0
            planes[f, 3 + k] = q
            for i in range(2):
                along = axes[i, 0] * ray[0] + axes[i, 1] * ray[1] + axes[i, 2] * ray[2]
                planes[f, 6 + 3 * i + k] = (sun[i] * q + along) / grid[2]
        planes[f, 0] = planes[f, 1] = planes[f, 2] = 0.0
        if mu0 <= 0.0 or not shadows:
            continue
        ahead, mean = True, 0.0
        for c in range(3):
            p = mesh.vertices[mesh.faces[f, c]]
            x, y, z = r[0] - p[0], r[1] - p[1], r[2] - p[2]
            scale = 1.0 / sqrt(x * x + y * y + z * z)
            mu = scale * (n[0] * x + n[1] * y + n[2] * z)
            cos_phase = scale * (s[0] * x + s[1] * y + s[2] * z)
            value[c] = light.albedo[f] * radiance_factor(light.surface, mu0, mu, cos_phase)
            mean += value[c] / 3.0
            ahead = ahead and canvas.projected[mesh.faces[f, c], 2] > 0.0
        planes[f, 0] = mean
        a, b, d = (
            canvas.projected[mesh.faces[f, 0]],
            canvas.projected[mesh.faces[f, 1]],
            canvas.projected[mesh.faces[f, 2]],
        )
        area = (b[0] - a[0]) * (d[1] - a[1]) - (b[1] - a[1]) * (d[0] - a[0])
        if ahead and area > 0.0:
            along = ((value[1] - value[0]) * (d[1] - a[1]) - (value[2] - value[0]) * (b[1] - a[1])) / area
            up = ((value[2] - value[0]) * (b[0] - a[0]) - (value[1] - value[0]) * (d[0] - a[0])) / area
            planes[f, 0] = value[0] - along * a[0] - up * a[1]
            planes[f, 1], planes[f, 2] = along, up


@jittable
def _value_at(mesh: Mesh, light: _Light, planes: Array, clear: Mask, number: Any, at: float, high: float) -> float:
    """Radiance factor at a column and a row of the grid, with the face plus one, 0 for the sky."""
    if number == 0:
        return 0.0
    f = np.uintp(number - 1)
    value = planes[f, 0] + planes[f, 1] * at + planes[f, 2] * high
    if value <= 0.0:
        return 0.0
    if clear[f]:
        return float(value)
    t = 1.0 / (planes[f, 3] + planes[f, 4] * at + planes[f, 5] * high)
    u = t * (planes[f, 6] + planes[f, 7] * at + planes[f, 8] * high)
    v = t * (planes[f, 9] + planes[f, 10] * at + planes[f, 11] * high)
    return float(value) if is_lit(mesh, light.sun, f, u, v) else 0.0


@allocation_free
def _shade(
    mesh: Mesh,
    canvas: Canvas,
    light: _Light,
    planes: Array,
    clear: Mask,
    tile: tuple[int, int, int, int],
    along: int,
    out: Array32,
) -> None:
    """Mean radiance factor of each pixel of a tile, which begins a pixel from the corner of the grid."""
    size, share, picture = canvas.row_span.shape[0], 1.0 / along**2, canvas.picture
    for y in range(tile[1], tile[3]):
        for x in range(tile[0], tile[2]):
            total, left = 0.0, (x - tile[0] + 1) * along
            for down in range(along):
                row = size - 1 - ((y - tile[1] + 1) * along + down)
                start, across = np.uintp(row * size + left), 0
                while across < along:
                    number, first = picture[start + np.uintp(across)], across
                    if number == 0:
                        across += 1
                        continue
                    f = np.uintp(number - 1)
                    if not clear[f]:
                        total += _value_at(mesh, light, planes, clear, number, left + across + 0.5, row + 0.5)
                        across += 1
                        continue
                    # Brightness is linear on a face: the mean of samples side by side is that of their middle.
                    across += 1
                    while across < along and picture[start + np.uintp(across)] == number:
                        across += 1
                    at = left + 0.5 * (first + across)
                    value = planes[f, 0] + planes[f, 1] * at + planes[f, 2] * (row + 0.5)
                    total += (across - first) * max(value, 0.0)
            out[y, x] = total * share


@allocation_free
def _shade_bent(
    mesh: Mesh,
    canvas: Canvas,
    light: _Light,
    planes: Array,
    clear: Mask,
    places: Array,
    tile: tuple[int, int, int, int],
    along: int,
    out: Array32,
) -> None:
    """The same where the lens bends: samples of a pixel are looked for on the grid."""
    size, share = canvas.row_span.shape[0], 1.0 / along**2
    for y in range(tile[1], tile[3]):
        for x in range(tile[0], tile[2]):
            total, i, j = 0.0, y - tile[1], x - tile[0]
            for down in range(along):
                for across in range(along):
                    dx, dy = (across + 0.5) / along - 0.5, (down + 0.5) / along - 0.5
                    column = int((places[i, j, 0] + places[i, j, 2] * dx + places[i, j, 3] * dy) * along)
                    row = size - 1 - int((places[i, j, 1] + places[i, j, 4] * dx + places[i, j, 5] * dy) * along)
                    if column < 0 or row < 0 or column >= size or row >= size:
                        continue
                    number = canvas.picture[np.uintp(row * size + column)]
                    total += _value_at(mesh, light, planes, clear, number, column + 0.5, row + 0.5)
            out[y, x] = total * share


@allocation_free
def _part_at_edges(
    mesh: Mesh,
    edges: Ints32,
    outermost: Array32,
    front: Mask,
    canvas: Canvas,
    light: _Light,
    seen: Mask,
    planes: Array,
    clear: Mask,
    tile: tuple[int, int, int, int],
    along: int,
    out: Array32,
) -> None:
    """Have samples that an edge of the mesh parts share the way between their centres as the edge divides it.

    Along rows where it is steep, along columns where it is flat. Where the sky begins, that counts of the outlines on the way
    which is the outermost. It is looked for first: `outermost` is scratch, 0 before and after, for how far out it is, along
    rows and along columns, shape (2, size^2); `front` is scratch, for which faces turn their outer side to the camera.
    """
    size, share, at, picture = canvas.row_span.shape[0], 1.0 / along**2, canvas.projected, canvas.picture
    for f in range(len(front)):
        front[f] = _is_front(mesh, at, f)
    for turn in range(3):
        for e in range(edges.shape[0]):
            a, b, f, g = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
            ahead, behind = front[f], g >= 0 and front[g]
            rim = ahead != behind
            if not (rim or (ahead and turn == 1)) or at[a, 2] <= 0.0 or at[b, 2] <= 0.0:
                continue
            flat = abs(at[b, 1] - at[a, 1]) < abs(at[b, 0] - at[a, 0])
            for down in (False, True):
                # Edges are written to both, but parted along one.
                if turn == 1 and down != flat:
                    continue
                i, j = (1, 0) if down else (0, 1)
                rise, run = at[b, j] - at[a, j], at[b, i] - at[a, i]
                low, high = min(at[a, j], at[b, j]), max(at[a, j], at[b, j])
                if rise == 0.0 or high < 0.0 or low > size or max(at[a, i], at[b, i]) < 0.0:
                    continue
                # Face f is on the left of the way from a to b: whether that is the side of smaller numbers.
                first_f = (rise > 0.0) != down
                one, other = (f + 1, g + 1) if first_f else (g + 1, f + 1)
                sees_one = ahead if first_f else behind
                for line in range(max(int(ceil(low - 0.5)), 0), min(int(ceil(high - 0.5)), size)):
                    place = at[a, i] + (line + 0.5 - at[a, j]) * (run / rise)
                    k = int(floor(place - 0.5))
                    if k < 0 or k + 1 >= size:
                        continue
                    before = np.uintp(k * size + line if down else line * size + k)
                    p, q = picture[before], picture[before + np.uintp(size if down else 1)]
                    off = place - (k + 1)
                    if p == q:
                        continue
                    gained, mid = 0.0, line + 0.5
                    if rim:
                        # Of what bounds the body there: a face on which a sample may fall or not, as the edge lies.
                        if (p == 0) == (q == 0) or (q == 0) != sees_one:
                            continue
                        side = 1.0 if sees_one else -1.0
                        outward = np.float32(1.0 + side * off)
                        if turn == 0:
                            outermost[j, before] = max(outermost[j, before], outward)
                        if turn == 2:
                            outermost[j, before] = np.float32(0.0)
                        if turn != 1 or outward != outermost[j, before]:
                            continue
                        number = f + 1 if ahead else g + 1
                        number = number if seen[number - 1] else np.int64(max(p, q))
                        gained = side * _value_at(
                            mesh, light, planes, clear, number, mid if down else place, place if down else mid
                        )
                    elif p == one and q == other:
                        # Of faces narrower than the way between samples those alone would be parted on which a sample falls.
                        narrow = min(
                            _reach(mesh, at, one - 1, a, b, i, j, mid, place),
                            _reach(mesh, at, other - 1, a, b, i, j, mid, place),
                        )
                        if narrow < 1.0:
                            continue
                        gained = _value_at(
                            mesh, light, planes, clear, p, mid if down else place, place if down else mid
                        )
                        gained -= _value_at(
                            mesh, light, planes, clear, q, mid if down else place, place if down else mid
                        )
                    own = k if off < 0.0 else k + 1
                    column, row = (line, own) if down else (own, line)
                    x, y = column // along - 1 + tile[0], (size - 1 - row) // along - 1 + tile[1]
                    if x < tile[0] or y < tile[1] or x >= tile[2] or y >= tile[3]:
                        continue
                    out[y, x] += off * gained * share


@jittable
def _reach(mesh: Mesh, at: Array, f: int, a: int, b: int, i: int, j: int, line: float, place: float) -> float:
    """How far face f reaches from the place of its edge between two vertices, along a line of the grid."""
    c = mesh.faces[f, 0] + mesh.faces[f, 1] + mesh.faces[f, 2] - a - b
    d = a if (at[a, j] > line) != (at[c, j] > line) else b
    rise = at[c, j] - at[d, j]
    return abs(at[d, i] + (line - at[d, j]) * ((at[c, i] - at[d, i]) / rise) - place) if rise != 0.0 else 0.0


@jittable
def _is_front(mesh: Mesh, at: Array, f: int) -> bool:
    """Whether a face turns its outer side to the camera."""
    a, b, c = corner(at, mesh.faces[f, 0]), corner(at, mesh.faces[f, 1]), corner(at, mesh.faces[f, 2])
    return bool((a[2] > 0.0) & (b[2] > 0.0) & (c[2] > 0.0) & (twice_area(a, b, c) > 0.0))


@allocation_free
def _label(
    mesh: Mesh,
    canvas: Canvas,
    light: _Light,
    planes: Array,
    places: Array,
    tile: tuple[int, int, int, int],
    along: int,
    shadows: bool,
    face: Ints32,
    depth: Array,
    lit: Mask,
) -> None:
    """Write what is under the centres of a tile's pixels."""
    size = canvas.row_span.shape[0]
    for y in range(tile[1], tile[3]):
        for x in range(tile[0], tile[2]):
            at, high = x - tile[0] + 0.5, size - (y - tile[1] + 0.5)
            if places.shape[0] > 0:
                at, high = (
                    along * places[y - tile[1], x - tile[0], 0],
                    size - along * places[y - tile[1], x - tile[0], 1],
                )
            column, row = int(at), int(high)
            if column < 0 or row < 0 or column >= size or row >= size:
                continue
            number = canvas.picture[np.uintp(row * size + column)]
            if number == 0:
                continue
            f = np.uintp(number - 1)
            t = 1.0 / (planes[f, 3] + planes[f, 4] * at + planes[f, 5] * high)
            face[y, x], depth[y, x] = np.int32(f), t
            if not shadows:
                continue
            u = t * (planes[f, 6] + planes[f, 7] * at + planes[f, 8] * high)
            v = t * (planes[f, 9] + planes[f, 10] * at + planes[f, 11] * high)
            lit[y, x] = light.mu0[f] > 0.0 and is_lit(mesh, light.sun, f, u, v)
