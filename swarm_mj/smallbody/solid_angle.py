"""Solid angles of triangles and closed meshes seen from points (Van Oosterom and Strackee 1983). Frame A, metres."""

from typing import Any

import numpy as np

from swarm_mj.compilation import jittable, kernel
from swarm_mj.typing import Array, Ints32, Mask

#: For no more points than these, such as the places of a swarm, NumPy has done before anything would be compiled.
FEW = 100


@jittable
def cast_rays(point: Array, vertices: Array, rays: Array) -> None:
    """Vectors from the point to the vertices and their lengths, shape (V, 4)."""
    for v in range(vertices.shape[0]):
        x, y, z = vertices[v, 0] - point[0], vertices[v, 1] - point[1], vertices[v, 2] - point[2]
        rays[v, 0], rays[v, 1], rays[v, 2] = x, y, z
        rays[v, 3] = np.sqrt(x * x + y * y + z * z)


@jittable
def solid_angle(p: Any, q: Any, s: Any) -> Any:
    """Signed solid angle of the triangle at the ends of three rays (x, y, z, length): numbers, or arrays of them."""
    cx, cy, cz = q[1] * s[2] - q[2] * s[1], q[2] * s[0] - q[0] * s[2], q[0] * s[1] - q[1] * s[0]
    triple = p[0] * cx + p[1] * cy + p[2] * cz
    pq = p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
    qs = q[0] * s[0] + q[1] * s[1] + q[2] * s[2]
    sp = s[0] * p[0] + s[1] * p[1] + s[2] * p[2]
    return 2.0 * np.arctan2(triple, p[3] * q[3] * s[3] + p[3] * qs + q[3] * sp + s[3] * pq)


def solid_angles(r_A: Array, vertices: Array, faces: Ints32) -> Array:
    """Solid angle of the whole surface seen from each point (n, 3), shape (n,): 0 outside, 4 pi inside."""
    if len(r_A) > FEW:
        return np.asarray(_solid_angles(r_A, vertices, faces))
    out = np.empty(len(r_A))
    for i, point in enumerate(r_A):
        rays = (vertices - point).T
        corners = np.vstack((rays, np.sqrt((rays * rays).sum(axis=0))))[:, faces]
        out[i] = solid_angle(corners[..., 0], corners[..., 1], corners[..., 2]).sum()
    return out


@kernel
def _solid_angles(r_A: Array, vertices: Array, faces: Ints32) -> Array:
    out = np.zeros(r_A.shape[0])
    rays = np.empty((vertices.shape[0], 4))
    for i in range(r_A.shape[0]):
        cast_rays(r_A[i], vertices, rays)
        for f in range(faces.shape[0]):
            out[i] += solid_angle(rays[faces[f, 0]], rays[faces[f, 1]], rays[faces[f, 2]])
    return out


def points_inside(points_A: Array, vertices: Array, faces: Ints32) -> Mask:
    """Whether points (n, 3) [m] lie inside a closed mesh, shape (n,); the surface itself counts as inside."""
    inside = np.einsum("ij,ij->i", points_A, points_A) <= np.einsum("ij,ij->i", vertices, vertices).max()
    # Only what is nearer than the farthest vertex needs the sum over all faces.
    inside[inside] = solid_angles(points_A[inside], vertices, faces) > np.pi
    return inside
