"""The model that is drawn: the body with its painted target, magnified spacecraft, the Sun's light; nothing moves by itself.

World frame N, metres. Everything hangs on mocap bodies: `place` puts them where an instant says. Spacecraft are the parts
of the CubeSat's MJCF, magnified, since at true size they would be far smaller than a pixel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from swarm_mj.flight.observe import camera_from
from swarm_mj.flight.plan import Plan
from swarm_mj.io.resources import asset_path
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel
from swarm_mj.rendering.frame import Instant
from swarm_mj.rendering.palette import GROUND, SEEN, SEEN_BORDER, UNSEEN_BORDER
from swarm_mj.smallbody.companion import Companion
from swarm_mj.spacecraft.template import HUB, TEMPLATE, compile_spec, read_spec
from swarm_mj.typing import Array, Indices, Ints, Ints32, Mask

#: Width of a border, on each side of an edge, over the side of a square as large as a mean face.
BORDER = 0.035
#: Width of a tile [texel] and of the whole picture at most; every OpenGL 3 driver takes the latter.
TILE, MAX_WIDTH = 64, 4096
#: Free texels along a tile's sides, which keep neighbours out of a filtered sample.
MARGIN = 2.0


class Atlas:
    """The picture painted on the body: one square tile for each cell of the target, so that a cell fills in one colour.

    Cells that were not observed show bare ground inside the border of their face of F_T; observed ones are filled. The border
    has the same width in metres everywhere. All other ground shares one bare tile.
    """

    def __init__(self, region: TargetRegion) -> None:
        self._columns = int(np.ceil(np.sqrt(region.n_cells + 1)))
        self._tile = int(np.clip(MAX_WIDTH // self._columns, 4, TILE))
        self.width = self._columns * self._tile
        self._border = _borders(region, self._tile)
        self._seen = np.zeros(region.n_cells, np.bool_)
        self.image = np.empty((self.width, self.width, 3), np.uint8)
        self.image[:] = GROUND
        self._paint(np.arange(region.n_cells))

    def show(self, seen: Mask) -> bool:
        """Paint the cells observed so far, shape (n_cells,); tells whether the picture changed."""
        changed = np.flatnonzero(seen != self._seen)
        self._seen[changed] = seen[changed]
        self._paint(changed)
        return changed.size > 0

    def coordinates(self, region: TargetRegion) -> tuple[Array, Ints32]:
        """Texture coordinates, shape (k, 2), and which of them each corner of the body's faces takes, shape (F, 3)."""
        n, tile = region.n_cells, self._tile
        corner = np.array([(MARGIN, MARGIN), (tile - MARGIN, MARGIN), (MARGIN, tile - MARGIN)])
        row, column = np.divmod(np.arange(n + 1), self._columns)
        place = tile * np.stack((column, row), axis=1)
        cells = (place[:n, None] + corner).reshape(-1, 2)
        bare = place[n] + 0.5 * tile
        index = np.full(region.faces.shape, 3 * n, np.int32)
        index[region.target] = np.arange(3 * n).reshape(n, 3)
        return np.vstack((cells, bare)) / self.width, index

    def _paint(self, cells: Indices) -> None:
        for cell in cells:
            row, column = divmod(int(cell), self._columns)
            fill, line = (SEEN, SEEN_BORDER) if self._seen[cell] else (GROUND, UNSEEN_BORDER)
            tile = np.where(self._border[cell][..., None], np.array(line, np.uint8), np.array(fill, np.uint8))
            top, left = row * self._tile, column * self._tile
            self.image[top : top + self._tile, left : left + self._tile] = tile


def _borders(region: TargetRegion, tile: int) -> Mask:
    """Texels of each cell's tile that are near to a border of its face, shape (n, tile, tile)."""
    texel = (np.arange(tile) + 0.5 - MARGIN) / (tile - 2.0 * MARGIN)
    second, third = np.meshgrid(texel, texel)  # shares of the second corner to the right, of the third downwards
    shares = np.stack((1.0 - second - third, second, third))
    width = BORDER * np.sqrt(region.total_area / region.n_faces)
    near = np.empty((region.n_cells, tile, tile), np.bool_)
    for cell, heights in enumerate(_heights(region)):
        # Distances to a line are linear on a cell: where no corner is near to it, nothing is.
        close = heights[(heights < width).any(axis=1)]
        near[cell] = (np.tensordot(close, shares, axes=1) < width).any(axis=0)
    return near


def _heights(region: TargetRegion) -> Iterator[Array]:
    """Of each cell, how far its corners are from the lines that bound its face, shape (k, 3) [m].

    A cell may touch such a line with one corner alone, and still a part of the border's width lies in it.
    """
    cell, side = np.nonzero(_on_border(region))
    corners, group = region.corners_A, region.group[cell]
    start, end = corners[cell, side - 2], corners[cell, side - 1]
    along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    for own, points in zip(region.group, corners, strict=True):
        lines = group == own
        yield np.linalg.norm(np.cross(points - start[lines, None], along[lines, None]), axis=2)


def _on_border(region: TargetRegion) -> Mask:
    """Whether the side of each cell that faces each corner bounds a face of F_T, shape (n, 3)."""
    faces = region.faces[region.target]
    sides = np.sort(np.stack((np.roll(faces, -1, axis=1), np.roll(faces, -2, axis=1)), axis=2), axis=2).reshape(-1, 2)
    _, side, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    group = np.repeat(region.group, 3)
    lowest, highest = np.full(len(count), group.max()), np.zeros(len(count), group.dtype)
    np.minimum.at(lowest, side, group)
    np.maximum.at(highest, side, group)
    return ((count == 1) | (lowest != highest))[side].reshape(-1, 3)


#: Groups of geoms, to be hidden in the view of a camera.
BODY_GROUP, SPACECRAFT_GROUP = 0, 1
#: Of geoms that touch nothing.
PASSABLE: dict[str, Any] = {"contype": 0, "conaffinity": 0}
#: Light besides the Sun's, so that the night side and what is painted on it can be made out.
AMBIENT = 0.24
#: Light of the spacecraft themselves: their panels are dark.
GLOW = 0.35
#: Vertical field of view of the overview and the chase camera [deg].
FIELD_OF_VIEW_DEG = 32.0
#: Clipping planes over the body's radius. The first camera to be cut off would be one that skims the ground.
NEAR, FAR = 5e-4, 40.0
#: Spacecraft in greater number are drawn as plain boxes.
MAX_DETAILED = 60
#: Corners of a square field of view, and of what stands for a round one.
ROUND_CORNERS = 24


@dataclass(frozen=True, eq=False)
class DrawingModel:
    """A compiled model and the places of its parts.

    Attributes:
        mjmodel: The model.
        data: Its state.
        atlas: What is painted on the body.
        texture: Id of the texture that shows it.
        body: Mocap id of the body.
        spacecraft: Mocap ids of the spacecraft, shape (n,).
        cameras: Ids of the spacecraft's cameras, shape (n,).
        rim_C: Corners of the camera's field of view in its frame at unit distance, counter-clockwise seen from the
            spacecraft's far side, shape (k, 3).
        magnification: How many times larger than they are spacecraft are drawn.
        companion: Mocap id of the body's companion, and where it is; None: there is none.
    """

    mjmodel: mujoco.MjModel
    data: mujoco.MjData
    atlas: Atlas
    texture: int
    body: int
    spacecraft: Ints
    cameras: Ints
    rim_C: Array
    magnification: float
    companion: tuple[int, Companion] | None = None

    def magnified(self, magnification: float) -> DrawingModel:
        """The same with spacecraft drawn so many times larger than they are; the model itself changes."""
        own, ratio = self.mjmodel.geom_group == SPACECRAFT_GROUP, magnification / self.magnification
        self.mjmodel.geom_size[own] *= ratio
        self.mjmodel.geom_pos[own] *= ratio
        return replace(self, magnification=magnification)

    def place(self, instant: Instant) -> bool:
        """Move everything to an instant; tells whether the texture has to be uploaded again."""
        data = self.data
        mujoco.mju_mat2Quat(data.mocap_quat[self.body], np.ascontiguousarray(instant.C_AN.T).ravel())
        if self.companion is not None:
            mocap, companion = self.companion
            data.mocap_pos[mocap] = companion.position(instant.t)
            mujoco.mju_mat2Quat(data.mocap_quat[mocap], np.ascontiguousarray(companion.C_AN(instant.t).T).ravel())
        data.mocap_pos[self.spacecraft] = instant.r_BN_N
        for mocap, C_BN in zip(self.spacecraft, instant.C_BN, strict=True):
            mujoco.mju_mat2Quat(data.mocap_quat[mocap], np.ascontiguousarray(C_BN.T).ravel())
        if instant.C_CN is not None:  # MuJoCo's cameras look along their -z, with y up
            for camera, C_CB in zip(self.cameras, instant.C_CN @ np.swapaxes(instant.C_BN, 1, 2), strict=True):
                mujoco.mju_mat2Quat(self.mjmodel.cam_quat[camera], (C_CB.T * (1.0, -1.0, -1.0)).ravel())
        data.time = instant.t
        mujoco.mj_kinematics(self.mjmodel, data)
        mujoco.mj_camlight(self.mjmodel, data)
        changed = self.atlas.show(instant.seen)
        if changed:
            start = self.mjmodel.tex_adr[self.texture]
            self.mjmodel.tex_data[start : start + self.atlas.image.size] = self.atlas.image.reshape(-1)
        return changed


def build_drawing_model(
    plan: Plan, magnification: float, width: int = 640, height: int = 480, reach: float = 0.0
) -> DrawingModel:
    """Compile the model of a plan for pictures of at most some width and height [pixel].

    Spacecraft are drawn `magnification` times larger than they are, and things up to `reach` [m] from a camera, see `reach_of`,
    but at least up to `FAR` body radii.
    """
    atlas = Atlas(plan.region)
    spec = mujoco.MjSpec()
    _look(spec, plan, width, height, reach)
    _add_body(spec, plan, atlas)
    companion = plan.environment.companion
    if companion is not None:
        _add_companion(spec, companion)
    for name in plan.names:
        _add_spacecraft(spec, name, plan, magnification)
    model = spec.compile()
    return DrawingModel(
        mjmodel=model,
        data=mujoco.MjData(model),
        atlas=atlas,
        texture=model.texture("target").id,
        body=int(model.body("asteroid").mocapid[0]),
        spacecraft=np.array([model.body(name).mocapid[0] for name in plan.names]),
        cameras=np.array([model.camera(name).id for name in plan.names]),
        rim_C=_rim(camera_from(plan.scenario)),
        magnification=magnification,
        companion=None if companion is None else (int(model.body("companion").mocapid[0]), companion),
    )


def _rim(camera: CameraModel) -> Array:
    flat = camera.outline(1 if camera.shape == "square" else ROUND_CORNERS // 4)
    return np.hstack((flat, np.ones((len(flat), 1))))


def _look(spec: mujoco.MjSpec, plan: Plan, width: int, height: int, reach: float) -> None:
    visual, radius = spec.visual, plan.shape.max_radius
    spec.stat.extent, spec.stat.center = radius, np.zeros(3)
    visual.map.znear, visual.map.zfar = NEAR, max(FAR, reach / radius)
    visual.global_.offwidth, visual.global_.offheight = width, height
    visual.global_.fovy = FIELD_OF_VIEW_DEG
    visual.quality.shadowsize, visual.quality.offsamples = 0, 4
    visual.headlight.ambient, visual.headlight.diffuse = np.full(3, AMBIENT), np.zeros(3)
    visual.headlight.specular = np.zeros(3)
    sun_N = plan.environment.sun.position / np.linalg.norm(plan.environment.sun.position)
    parallel = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    sun = spec.worldbody.add_light(name="sun", type=parallel, dir=-sun_N, pos=3.0 * radius * sun_N, castshadow=False)
    sun.ambient, sun.diffuse, sun.specular = np.zeros(3), np.full(3, 0.9), np.full(3, 0.1)


def _add_body(spec: mujoco.MjSpec, plan: Plan, atlas: Atlas) -> None:
    region = plan.region
    coordinates, index = atlas.coordinates(region)
    spec.add_mesh(
        name="asteroid",
        uservert=region.vertices.ravel(),
        userface=region.faces.ravel(),
        usernormal=_normals(plan).ravel(),
        userfacenormal=region.faces.ravel(),
        usertexcoord=coordinates.ravel(),
        userfacetexcoord=index.ravel(),
    ).inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    texture = spec.add_texture(name="target", type=mujoco.mjtTexture.mjTEXTURE_2D)
    texture.width, texture.height, texture.nchannel = atlas.width, atlas.width, 3
    texture.data = atlas.image.tobytes()
    material = spec.add_material(name="asteroid", rgba=[1, 1, 1, 1], specular=0.0, shininess=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "target"
    body, mesh = spec.worldbody.add_body(name="asteroid", mocap=True), mujoco.mjtGeom.mjGEOM_MESH
    body.add_geom(name="asteroid", type=mesh, meshname="asteroid", material="asteroid", group=BODY_GROUP, **PASSABLE)


def _add_companion(spec: mujoco.MjSpec, companion: Companion) -> None:
    """A mocap body of bare ground, lit by the Sun; what it shades is not drawn."""
    shape = companion.shape
    spec.add_mesh(
        name="companion",
        uservert=shape.vertices.ravel(),
        userface=shape.faces.ravel(),
        usernormal=shape.vertex_normals.ravel(),
        userfacenormal=shape.faces.ravel(),
    ).inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    rgba = [*(np.array(GROUND) / 255.0), 1.0]
    spec.add_material(name="companion", rgba=rgba, specular=0.0, shininess=0.0)
    body, mesh = spec.worldbody.add_body(name="companion", mocap=True), mujoco.mjtGeom.mjGEOM_MESH
    body.add_geom(name="companion", type=mesh, meshname="companion", material="companion", group=BODY_GROUP, **PASSABLE)


def _normals(plan: Plan) -> Array:
    """Normals at the vertices of the cut mesh, shape (V, 3): those of the body, interpolated where it was cut.

    The cut mesh's own would show every cut as a crease.
    """
    region, shape = plan.region, plan.shape
    normals = np.empty_like(region.vertices)
    normals[: len(shape.vertices)] = shape.vertex_normals
    new = np.arange(len(shape.vertices), len(region.vertices))
    face_of = np.empty(len(region.vertices), np.intp)
    face_of[region.faces] = region.parent[:, None]
    corner = shape.faces[face_of[new]]
    a, b, c = np.moveaxis(shape.vertices[corner], 1, 0)
    double = np.cross(b - a, c - a)
    scale = np.einsum("ij,ij->i", double, double)
    p = region.vertices[new]
    second = np.einsum("ij,ij->i", np.cross(p - a, c - a), double) / scale
    third = np.einsum("ij,ij->i", np.cross(b - a, p - a), double) / scale
    shares = np.stack((1.0 - second - third, second, third), axis=1)
    normals[new] = np.einsum("ij,ijk->ik", shares, shape.vertex_normals[corner])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _add_spacecraft(spec: mujoco.MjSpec, name: str, plan: Plan, magnification: float) -> None:
    """A mocap body with the geoms of the CubeSat's hub, magnified, and its camera at true place."""
    part = compile_spec(read_spec(asset_path(TEMPLATE)))
    stretch = np.array(plan.properties.size) / (2.0 * part.geom("bus").size)
    body = spec.worldbody.add_body(name=name, mocap=True)
    for k in np.flatnonzero(part.geom_bodyid == part.body(HUB).id):
        if plan.n > MAX_DETAILED and k != part.geom("bus").id:
            continue
        colour = part.mat_rgba[part.geom_matid[k]]
        longer = stretch if part.geom_type[k] == mujoco.mjtGeom.mjGEOM_BOX else 1.0
        body.add_geom(
            type=part.geom_type[k],
            size=magnification * part.geom_size[k] * longer,
            pos=magnification * part.geom_pos[k] * stretch,
            quat=part.geom_quat[k],
            rgba=np.append(GLOW + (1.0 - GLOW) * colour[:3], 1.0),
            group=SPACECRAFT_GROUP,
            **PASSABLE,
        )
    body.add_camera(name=name, quat=[0, 1, 0, 0], fovy=2.0 * plan.scenario.camera.half_angle_deg)
