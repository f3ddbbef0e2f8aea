"""Compiled algebra of three-vectors and quaternions, which the attitude kernels share.

Vectors, quaternions and matrices are tuples of numbers, so that Numba inlines every function into the loops over spacecraft
and nothing is allocated. Quaternions are (w, x, y, z) with MuJoCo's meaning, v_N = R(q_BN) v_B.
"""

from math import atan2, cos, sin, sqrt
from typing import Any, TypeAlias

from swarm_mj.compilation import jittable
from swarm_mj.typing import Array

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]
#: Three rows.
Matrix: TypeAlias = tuple[Vector, Vector, Vector]
#: Squares of half an angle below which the series here are exact to rounding, their next terms below 1e-16.
SMALL = 0.01


@jittable
def vector(rows: Array, i: int) -> Vector:
    """Return row i of an array of shape (n, 3)."""
    return rows[i, 0], rows[i, 1], rows[i, 2]


@jittable
def quaternion(rows: Array, i: int) -> Quaternion:
    """Return row i of an array of shape (n, 4)."""
    return rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]


@jittable
def put_vector(rows: Array, i: int, v: Vector) -> None:
    """Write row i of an array of shape (n, 3)."""
    rows[i, 0], rows[i, 1], rows[i, 2] = v


@jittable
def put_quaternion(rows: Array, i: int, q: Quaternion) -> None:
    """Write row i of an array of shape (n, 4)."""
    rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3] = q


@jittable
def dot(a: Any, b: Any) -> Any:
    """Return a . b of vectors whose components are numbers, or arrays of them."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jittable
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@jittable
def scaled(p: float, a: Vector) -> Vector:
    """Return p a."""
    return p * a[0], p * a[1], p * a[2]


@jittable
def combine(p: float, a: Vector, r: float, b: Vector) -> Vector:
    """Return p a + r b."""
    return p * a[0] + r * b[0], p * a[1] + r * b[1], p * a[2] + r * b[2]


@jittable
def times(matrix: Array, v: Any) -> Any:
    """Return the product of a matrix of shape (3, 3) with v, whose components are numbers, or arrays of them."""
    return (
        matrix[0, 0] * v[0] + matrix[0, 1] * v[1] + matrix[0, 2] * v[2],
        matrix[1, 0] * v[0] + matrix[1, 1] * v[1] + matrix[1, 2] * v[2],
        matrix[2, 0] * v[0] + matrix[2, 1] * v[1] + matrix[2, 2] * v[2],
    )


@jittable
def relative_dcm(C_BN: Array, C_AN: Array, C_BA: Array) -> None:
    """Write C_BA = C_BN C_AN^T, the rotation from A to B, shape (3, 3); further axes at the end are so many rotations."""
    for i in range(3):
        for k in range(3):
            C_BA[i, k] = C_BN[i, 0] * C_AN[k, 0] + C_BN[i, 1] * C_AN[k, 1] + C_BN[i, 2] * C_AN[k, 2]


@jittable
def normalised(q: Quaternion) -> Quaternion:
    """Return the quaternion scaled to unit length."""
    scale = 1.0 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return scale * q[0], scale * q[1], scale * q[2], scale * q[3]


@jittable
def conjugate(q: Quaternion) -> Quaternion:
    """Return the quaternion of the opposite rotation."""
    return q[0], -q[1], -q[2], -q[3]


@jittable
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return Hamilton's product a b, which turns by b first and by a afterwards: R(a b) = R(a) R(b)."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@jittable
def rotate(q: Quaternion, v: Vector) -> Vector:
    """Return R(q) v: with q_BN, components in B to components in N."""
    axis = (q[1], q[2], q[3])
    t = cross(axis, v)
    u = cross(axis, t)
    return v[0] + 2.0 * (q[0] * t[0] + u[0]), v[1] + 2.0 * (q[0] * t[1] + u[1]), v[2] + 2.0 * (q[0] * t[2] + u[2])


@jittable
def z_axis(q: Quaternion) -> Vector:
    """Return R(q) (0, 0, 1): with q_BN, the direction of the body's +z axis in N."""
    w, x, y, z = q
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), (w * w - x * x) + (z * z - y * y)


@jittable
def short_mrp(q: Quaternion) -> Vector:
    """Return the MRP of a unit quaternion, of the set with |sigma| <= 1."""
    scale = 1.0 / (1.0 + abs(q[0]))
    if q[0] < 0.0:
        scale = -scale
    return scale * q[1], scale * q[2], scale * q[3]


@jittable
def matrix(matrices: Array, i: int) -> Matrix:
    """Return matrix i of an array of shape (n, 3, 3)."""
    return (
        (matrices[i, 0, 0], matrices[i, 0, 1], matrices[i, 0, 2]),
        (matrices[i, 1, 0], matrices[i, 1, 1], matrices[i, 1, 2]),
        (matrices[i, 2, 0], matrices[i, 2, 1], matrices[i, 2, 2]),
    )


@jittable
def transformed(matrix: Matrix, v: Vector) -> Vector:
    """Return the product of a matrix with v."""
    return dot(matrix[0], v), dot(matrix[1], v), dot(matrix[2], v)


@jittable
def half_angle_terms(x: float, gain: float) -> tuple[float, float]:
    """Return cos(h) and gain sin(h) / h for the square x = h^2 of half an angle."""
    if x >= SMALL:
        h = sqrt(x)
        return cos(h), gain * sin(h) / h
    c = 1.0 - x * (1.0 / 2.0 - x * (1.0 / 24.0 - x * (1.0 / 720.0 - x / 40_320.0)))
    share = gain * (1.0 - x * (1.0 / 6.0 - x * (1.0 / 120.0 - x * (1.0 / 5_040.0 - x / 362_880.0))))
    return c, share


@jittable
def turn(phi: Vector) -> Quaternion:
    """Return the quaternion of a rotation vector [rad]."""
    c, share = half_angle_terms(0.25 * dot(phi, phi), 0.5)
    return c, share * phi[0], share * phi[1], share * phi[2]


@jittable
def rotation_vector(q: Quaternion) -> Vector:
    """Return the rotation vector of a unit quaternion, taken the short way [rad]."""
    x = q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    if x >= SMALL:
        h = sqrt(x)
        scale = 2.0 * atan2(h, abs(q[0])) / h
    else:
        # 2 asin(h) / h by its series, h the sine of half the angle.
        scale = 143.0 / 10_240.0 * x + 231.0 / 13_312.0
        scale = (((scale * x + 63.0 / 2_816.0) * x + 35.0 / 1_152.0) * x + 5.0 / 112.0) * x + 3.0 / 40.0
        scale = 2.0 * ((scale * x + 1.0 / 6.0) * x + 1.0)
    if q[0] < 0.0:
        scale = -scale
    return scale * q[1], scale * q[2], scale * q[3]


@jittable
def product_transposed(a: Matrix, b: Matrix) -> Matrix:
    """Return a b^T of two matrices."""
    return transformed(b, a[0]), transformed(b, a[1]), transformed(b, a[2])


@jittable
def transposed(a: Matrix) -> Matrix:
    """Return a^T of a matrix."""
    x, y, z = a
    return (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])


@jittable
def symmetric_inverse(S: Matrix) -> Matrix:
    """Return the inverse of a symmetric matrix, by cofactors."""
    (a, d, e), (_, b, f), (_, _, c) = S
    x, y, z = b * c - f * f, e * f - c * d, d * f - b * e
    scale = 1.0 / (a * x + d * y + e * z)
    yy, yz, zz = scale * (a * c - e * e), scale * (d * e - a * f), scale * (a * b - d * d)
    return (scale * x, scale * y, scale * z), (scale * y, yy, yz), (scale * z, yz, zz)
