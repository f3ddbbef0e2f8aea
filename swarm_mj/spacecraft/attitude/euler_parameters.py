"""Euler parameters (w, x, y, z) of matrices, and without jumps of sign over time."""

from __future__ import annotations

import numpy as np

from swarm_mj.typing import Array


def steady(q: Array) -> Array:
    """Quaternions over time, shape (t, ..., 4), each with the sign that is nearer to the one before."""
    flips = np.cumsum(np.sum(q[1:] * q[:-1], axis=-1) < 0.0, axis=0) % 2
    signs = np.concatenate([np.ones((1, *q.shape[1:-1])), 1.0 - 2.0 * flips])
    out: Array = q * signs[..., None]
    return out


def quaternions(C: Array) -> Array:
    """Euler parameters (w, x, y, z) of direction cosine matrices, v_B = C v_A, shape (..., 3, 3) to (..., 4)."""
    from scipy.spatial.transform import Rotation

    flat = Rotation.from_matrix(np.swapaxes(C.reshape(-1, 3, 3), 1, 2)).as_quat(scalar_first=True)
    out: Array = flat.reshape(*C.shape[:-2], 4)
    return out
