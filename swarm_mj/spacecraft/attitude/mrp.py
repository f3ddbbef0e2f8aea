"""Modified Rodrigues Parameters and Euler parameters: algebra and kinematics, vectorised over leading axes.

An MRP is sigma = e tan(Phi / 4) for the rotation by the principal angle Phi about the unit axis e. sigma_BN is the
attitude of frame B relative to frame N, C_BN its direction cosine matrix, which maps N components to B components
(v_B = C_BN v_N). Quaternions are (w, x, y, z) in MuJoCo's sense, v_N = R(q_BN) v_B; their components are the Euler
parameters beta_BN. Each attitude has two MRPs, sigma and its shadow -sigma / |sigma|^2; functions here return the one
with |sigma| <= 1 unless they say otherwise.

Source: Schaub & Junkins, Analytical Mechanics of Space Systems, section 3.5.
"""

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.typing import Array


def mrp_from_quaternion(q_BN: ArrayLike) -> Array:
    """Convert unit quaternions to MRPs.

    Args:
        q_BN: Quaternions (w, x, y, z), shape (..., 4), unit length.

    Returns:
        sigma_BN, shape (..., 3), with |sigma| <= 1.
    """
    q = np.asarray(q_BN, dtype=np.float64)
    scalar = q[..., :1]
    return np.where(scalar < 0.0, -1.0, 1.0) * q[..., 1:] / (1.0 + np.abs(scalar))


def quaternion_from_mrp(sigma_BN: ArrayLike) -> Array:
    """Convert MRPs of either set to unit quaternions.

    Args:
        sigma_BN: MRPs, shape (..., 3).

    Returns:
        q_BN (w, x, y, z), shape (..., 4); w >= 0 where |sigma| <= 1.
    """
    sigma = np.asarray(sigma_BN, dtype=np.float64)
    square = np.sum(sigma * sigma, axis=-1, keepdims=True)
    return np.concatenate([1.0 - square, 2.0 * sigma], axis=-1) / (1.0 + square)


def dcm(sigma_BN: ArrayLike) -> Array:
    """Return the direction cosine matrices C_BN (v_B = C_BN v_N) of MRPs of either set.

    Args:
        sigma_BN: MRPs, shape (..., 3).

    Returns:
        C_BN, shape (..., 3, 3): I + (8 [sigma x]^2 - 4 (1 - sigma^2) [sigma x]) / (1 + sigma^2)^2.
    """
    sigma = np.asarray(sigma_BN, dtype=np.float64)
    square = np.sum(sigma * sigma, axis=-1)[..., None, None]
    tilde = cross_matrix(sigma)
    return np.eye(3) + (8.0 * tilde @ tilde - 4.0 * (1.0 - square) * tilde) / (1.0 + square) ** 2


def cross_matrix(vector: ArrayLike) -> Array:
    """Return [v x], shape (..., 3, 3), so that [v x] u = v x u."""
    v = np.asarray(vector, dtype=np.float64)
    tilde = np.zeros((*v.shape, 3))
    tilde[..., 0, 1], tilde[..., 0, 2], tilde[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return tilde - np.swapaxes(tilde, -1, -2)


def add_mrp(sigma_BR: ArrayLike, sigma_RN: ArrayLike) -> Array:
    """Return sigma_BN of C_BN = C_BR C_RN, shape (..., 3).

    The composition runs through quaternions, so that it has none of the singularities of the direct MRP formula.
    """
    return mrp_from_quaternion(_product(quaternion_from_mrp(sigma_RN), quaternion_from_mrp(sigma_BR)))


def subtract_mrp(sigma_BN: ArrayLike, sigma_RN: ArrayLike) -> Array:
    """Return the relative attitude sigma_BR of C_BR = C_BN C_RN^T, shape (..., 3), without singularities."""
    q_NR = quaternion_from_mrp(-np.asarray(sigma_RN, dtype=np.float64))
    return mrp_from_quaternion(_product(q_NR, quaternion_from_mrp(sigma_BN)))


def mrp_rate(sigma_BN: ArrayLike, omega_BN_B: ArrayLike) -> Array:
    """Return the kinematics sigma_dot = B(sigma) omega / 4.

    Args:
        sigma_BN: MRPs, shape (..., 3).
        omega_BN_B: Angular velocity of B relative to N in B components [rad/s], shape (..., 3).

    Returns:
        d sigma_BN / dt [1/s], shape (..., 3), with B = (1 - sigma^2) I + 2 [sigma x] + 2 sigma sigma^T.
    """
    sigma, omega = np.asarray(sigma_BN, dtype=np.float64), np.asarray(omega_BN_B, dtype=np.float64)
    square = np.sum(sigma * sigma, axis=-1, keepdims=True)
    along = np.sum(sigma * omega, axis=-1, keepdims=True)
    return 0.25 * ((1.0 - square) * omega + 2.0 * np.cross(sigma, omega) + 2.0 * along * sigma)


def _product(a: Array, b: Array) -> Array:
    """Return the Hamilton product a b, shape (..., 4)."""
    scalar = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


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
