"""Quality classes over the looks of a target: which faces are mapped, and how well looks determine their height and slope.

A look is one cell in one picture in which it counts by the scenario's criterion. Directions to camera and Sun are taken at the
cell's centroid, in A. The pixel's noise of one unit dilutes as sqrt(diag((H^T H)^-1)), H the partial derivatives of what
all looks of a cell measure:

- position by triangulation: each look measures the two components across its line of sight u, one pixel over its distance as
  noise s; H^T H is the sum of (1 - u u^T) / s^2 over the looks. The height is the component along the normal.
- slopes p, q and logarithm of the albedo by shading: the brightness of a Lambert face over that under the Sun in its zenith,
  n . s with n = (-p, -q, 1) / sqrt(1 + p^2 + q^2), has the partials (-s_x, -s_y, s_z) at zero slope, so that H^T H
  is the sum of s s^T over the directions s to the Sun, up to signs.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, radians
from typing import Any, NamedTuple

import numpy as np

from swarm_mj.compilation import jittable, kernel
from swarm_mj.mission.target import TargetRegion
from swarm_mj.scenarios.schema_quality import Angles, Demand, QualityClass
from swarm_mj.typing import Array, Array32, Ints, Ints32, Mask

#: Looks closer to the normal than this are from no side [-, sine of the emission angle].
LEAST_SLANT = 5e-3
#: Least over largest eigenvalue of H^T H that determines anything: directions are kept to 1e-7, their squares to 1e-14.
LEAST_CONDITION = 1e-10


class Looks(NamedTuple):
    """All looks of a flight or of a set of candidates, sorted by cell; `start` says where those of each cell begin.

    Attributes:
        start: Looks of cell c are those from start[c] up to start[c + 1], shape (n + 1,).
        normal_A: Outward unit normal of each cell in A, shape (n, 3).
        taker: Spacecraft or candidate that takes each, shape (L,).
        to_camera_A: Unit vector from the cell to the camera in A, shape (L, 3).
        to_sun_A: Unit vector to the Sun in A, shape (L, 3).
        gsd_m: Ground sampling distance, obliquity included [m], shape (L,).
        motion_blur_px: Motion of the cell's image during the exposure [px], shape (L,); NaN where it is not known.
        snr: Signal to noise of a pixel [-], shape (L,); NaN where it is not known.
    """

    start: Ints
    normal_A: Array
    taker: Ints32
    to_camera_A: Array32
    to_sun_A: Array32
    gsd_m: Array32
    motion_blur_px: Array32
    snr: Array32


class PictureLooks(NamedTuple):
    """The looks of one picture at the `cells` that count in it, shape (k,); the rest as in `Looks`, one Sun for all."""

    taker: int
    cells: Ints
    to_camera_A: Array32
    to_sun_A: Array
    gsd_m: Array
    motion_blur_px: Array | float = np.nan
    snr: Array | float = np.nan


def looks_in_picture(
    region: TargetRegion,
    taker: int,
    r_A: Array,
    sun_A: Array,
    cells: Ints,
    gsd_m: Array,
    *,
    motion_blur_px: Array | float = np.nan,
    snr: Array | float = np.nan,
) -> PictureLooks:
    """The looks at cells that count in a picture taken at `r_A` [m], the Sun in the direction `sun_A`, of any length."""
    away = r_A - region.centroid_A[cells]
    to_camera = (away / np.linalg.norm(away, axis=1, keepdims=True)).astype(np.float32)
    return PictureLooks(taker, cells, to_camera, sun_A / np.linalg.norm(sun_A), gsd_m, motion_blur_px, snr)


def gather(pictures: Sequence[PictureLooks], normal_A: Array) -> Looks:
    """Looks of pictures sorted by cell, those of a cell in the order of the pictures; `normal_A` of all cells, shape (n, 3)."""
    sizes = [len(picture.cells) for picture in pictures]
    cells = np.concatenate([np.empty(0, np.int64), *(picture.cells for picture in pictures)])
    order = np.argsort(cells, kind="stable")

    def column(name: str, dtype: Any = np.float32, *width: int) -> Any:
        parts = [
            np.broadcast_to(getattr(picture, name), (size, *width)).astype(dtype)
            for picture, size in zip(pictures, sizes, strict=True)
        ]
        return np.concatenate([np.empty((0, *width), dtype), *parts])[order]

    return Looks(
        start=np.concatenate([[0], np.cumsum(np.bincount(cells, minlength=len(normal_A)))]),
        normal_A=np.ascontiguousarray(normal_A),
        taker=column("taker", np.int32),
        to_camera_A=column("to_camera_A", np.float32, 3),
        to_sun_A=column("to_sun_A", np.float32, 3),
        gsd_m=column("gsd_m"),
        motion_blur_px=column("motion_blur_px"),
        snr=column("snr"),
    )


class Bounds(NamedTuple):
    """A demand in numbers: of each range of angles the cosines of its largest and least, infinite where nothing is asked.

    Attributes:
        paired: Whether two looks must converge, by `convergence` in light that is `alike`: its least cosine.
        varied: Whether the directions to the Sun of two looks must differ, by `light`.
    """

    looks: int
    max_gsd: float
    max_motion_blur: float
    min_snr: float
    emission: tuple[float, float]
    incidence: tuple[float, float]
    phase: tuple[float, float]
    paired: bool
    convergence: tuple[float, float]
    alike: float
    sectors: int
    varied: bool
    light: tuple[float, float]


def bounds_of(demand: Demand) -> Bounds:
    """A demand in numbers."""
    return Bounds(
        looks=demand.looks,
        max_gsd=demand.max_gsd_m or inf,
        max_motion_blur=demand.max_motion_blur_px or inf,
        min_snr=demand.min_snr or 0.0,
        emission=_cosines(demand.emission_deg),
        incidence=_cosines(demand.incidence_deg),
        phase=_cosines(demand.phase_deg),
        paired=demand.convergence_deg is not None,
        convergence=_cosines(demand.convergence_deg),
        alike=_cosines((0.0, demand.alike_light_deg))[0],
        sectors=demand.sectors,
        varied=demand.light_varied_deg is not None,
        light=_cosines(demand.light_varied_deg),
    )


def _cosines(angles: Angles | None) -> tuple[float, float]:
    """Least and largest cosine of a range [deg]; 0 and 180 deg bind nothing, whatever the rounding of unit vectors."""
    least, most = angles or (0.0, 180.0)
    return cos(radians(most)) if most < 180.0 else -inf, cos(radians(least)) if least > 0.0 else inf


@jittable
def _dot(a: Any, b: Any) -> Any:
    # Numba's products of single precision, and its `float` of one, stay single.
    return np.float64(a[0]) * b[0] + np.float64(a[1]) * b[1] + np.float64(a[2]) * b[2]


@jittable
def _within(cosine: Any, bounds: Any) -> Any:
    return (cosine >= bounds[0]) & (cosine <= bounds[1])


@jittable
def is_usable(bounds: Bounds, looks: Looks, cell: Any, k: Any) -> Any:
    """Whether look k of a cell keeps a demand's limits."""
    normal, camera, sun = looks.normal_A[cell], looks.to_camera_A[k], looks.to_sun_A[k]
    return (
        (looks.gsd_m[k] <= bounds.max_gsd)
        & ((bounds.max_motion_blur == inf) | (looks.motion_blur_px[k] <= bounds.max_motion_blur))
        & ((bounds.min_snr == 0.0) | (looks.snr[k] >= bounds.min_snr))
        & _within(_dot(normal, camera), bounds.emission)
        & _within(_dot(normal, sun), bounds.incidence)
        & _within(_dot(camera, sun), bounds.phase)
    )


@jittable
def is_pair(bounds: Bounds, looks: Looks, i: Any, k: Any) -> Any:
    """Whether two looks of a cell converge as a demand asks, in light alike enough."""
    alike = _dot(looks.to_sun_A[i], looks.to_sun_A[k]) >= bounds.alike
    return alike & _within(_dot(looks.to_camera_A[i], looks.to_camera_A[k]), bounds.convergence)


@jittable
def is_varied(bounds: Bounds, looks: Looks, i: Any, k: Any) -> Any:
    """Whether the light of two looks of a cell differs as a demand asks."""
    return _within(_dot(looks.to_sun_A[i], looks.to_sun_A[k]), bounds.light)


@jittable
def sector_of(looks: Looks, cell: Any, k: Any) -> Any:
    """Quadrant of the face's horizon that a look comes from: 0 north, 1 east, 2 south, 3 west; -1: from the face's zenith.

    North is the part of A's z across the normal n, or of its x where n is along z; with a for that axis, east is along a x n.
    """
    n, u = looks.normal_A[cell], looks.to_camera_A[k]
    polar = abs(n[2]) > 1.0 - 1e-12
    along = n[0] if polar else n[2]
    north = (u[0] if polar else u[2]) - _dot(n, u) * along
    east = n[1] * u[2] - n[2] * u[1] if polar else n[0] * u[1] - n[1] * u[0]
    if north * north + east * east < LEAST_SLANT * LEAST_SLANT * (1.0 - along * along):
        return -1
    if abs(north) >= abs(east):
        return 0 if north > 0.0 else 2
    return 1 if east > 0.0 else 3


def mapped(quality_class: QualityClass, looks: Looks, chosen: Mask | None = None) -> Mask:
    """Which cells a class maps, shape (n,); by the looks of `chosen` takers alone, shape (takers,), or of all."""
    takers = _all_takers(looks) if chosen is None else np.asarray(chosen, np.bool_)
    return np.logical_and.reduce([_fulfilled(bounds_of(demand), looks, takers) for demand in quality_class.all_demands])


def usable(demand: Demand, looks: Looks) -> Mask:
    """Which looks keep a demand's limits, shape (L,)."""
    return np.asarray(_usable(bounds_of(demand), looks, _all_takers(looks)))


def _all_takers(looks: Looks) -> Mask:
    return np.ones(looks.taker.max(initial=-1) + 1, np.bool_)


@kernel
def _usable(bounds: Bounds, looks: Looks, chosen: Mask) -> Mask:
    found = np.zeros(len(looks.taker), np.bool_)
    for cell in range(len(looks.start) - 1):
        for k in range(looks.start[cell], looks.start[cell + 1]):
            found[k] = chosen[looks.taker[k]] and is_usable(bounds, looks, cell, k)
    return found


@kernel
def _fulfilled(bounds: Bounds, looks: Looks, chosen: Mask) -> Mask:
    """Which cells fulfil a demand by the looks of chosen takers, shape (n,)."""
    found = np.zeros(len(looks.start) - 1, np.bool_)
    keep = _usable(bounds, looks, chosen)
    for cell in range(len(found)):
        first = looks.start[cell]
        held = first + np.flatnonzero(keep[first : looks.start[cell + 1]])
        found[cell] = len(held) >= bounds.looks and _conditions_hold(bounds, looks, cell, held)
    return found


@kernel
def _conditions_hold(bounds: Bounds, looks: Looks, cell: int, held: Ints) -> bool:
    """Whether the usable looks of a cell fulfil a demand's conditions together."""
    seen_from = np.zeros(4, np.bool_)
    if bounds.sectors > 0:
        for k in held:
            sector = sector_of(looks, cell, k)
            if sector >= 0:
                seen_from[sector] = True
    paired, varied = not bounds.paired, not bounds.varied
    for at, i in enumerate(held):
        if paired and varied:
            break
        for k in held[at + 1 :]:
            paired |= is_pair(bounds, looks, i, k)
            varied |= is_varied(bounds, looks, i, k)
    return bool(seen_from.sum() >= bounds.sectors and paired and varied)


class Quality(NamedTuple):
    """What a flight's looks come to: which cells each class maps, by its name, shape (n,), and the figures of the cells."""

    mapped: dict[str, Mask]
    figures: Figures


def quality_of(classes: Sequence[QualityClass], looks: Looks) -> Quality:
    """The classes' cells and the figures of all."""
    return Quality({each.name: mapped(each, looks) for each in classes}, figures_of(looks))


class Figures(NamedTuple):
    """What the looks of each cell come to, NaN where there is none, shape (n,) each.

    Attributes:
        looks: Number of looks.
        best_gsd_m: Least ground sampling distance [m].
        least_emission_deg: Least angle between normal and camera [deg].
        least_incidence_deg: Least angle between normal and Sun [deg].
        convergence_deg: Largest angle between two lines of sight [deg], NaN where there is one look.
        light_varied_deg: Largest angle between two directions to the Sun [deg], likewise.
        height_dop: Standard deviation of the height over `best_gsd_m` for a noise of one pixel in each picture [-].
        slope_dop: Root sum of squares of the standard deviations of both slopes for a noise of the brightness of 1 [-], see
            the module; NaN where the Sun's directions do not determine slopes and albedo.
        albedo_dop: Standard deviation of the albedo over itself, likewise [-].
    """

    looks: Ints32
    best_gsd_m: Array32
    least_emission_deg: Array32
    least_incidence_deg: Array32
    convergence_deg: Array32
    light_varied_deg: Array32
    height_dop: Array32
    slope_dop: Array32
    albedo_dop: Array32


def figures_of(looks: Looks) -> Figures:
    """The figures of the looks of each cell."""
    cosines, sight, light = _cosines_and_sums(looks)
    cosines[~np.isfinite(cosines)] = np.nan
    gsd = _best_gsd(looks)
    emission, incidence, convergence, varied = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))).T
    _, _, height = _deviations(sight, looks.normal_A)
    north, east, albedo = _deviations(light, looks.normal_A)
    columns = (gsd, emission, incidence, convergence, varied, height / gsd, np.hypot(north, east), albedo)
    return Figures(np.diff(looks.start).astype(np.int32), *(column.astype(np.float32) for column in columns))


def _best_gsd(looks: Looks) -> Array:
    best = np.full(len(looks.start) - 1, np.inf)
    np.fmin.at(best, np.repeat(np.arange(len(best)), np.diff(looks.start)), looks.gsd_m)
    return np.where(np.isinf(best), np.nan, best)


@kernel
def _cosines_and_sums(looks: Looks) -> tuple[Array, Array, Array]:
    """Cosines and sums over the looks of each cell, shape (n, 4) and twice (n, 3, 3).

    - largest cosine of emission and incidence, least cosine between lines of sight and between directions to the Sun;
    - sum of (1 - u u^T) / s^2 over the lines of sight u, s the width of a pixel across them [m];
    - sum of s s^T over the directions s to the Sun.
    """
    n = len(looks.start) - 1
    cosines = np.empty((n, 4))
    sight, light = np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    for cell in range(n):
        cosines[cell] = -np.inf, -np.inf, np.inf, np.inf
        for i in range(looks.start[cell], looks.start[cell + 1]):
            u, s = looks.to_camera_A[i], looks.to_sun_A[i]
            cos_emission = _dot(looks.normal_A[cell], u)
            cosines[cell, 0] = max(cosines[cell, 0], cos_emission)
            cosines[cell, 1] = max(cosines[cell, 1], _dot(looks.normal_A[cell], s))
            weight = 1.0 / (looks.gsd_m[i] * cos_emission) ** 2
            for a in range(3):
                sight[cell, a, a] += weight * _dot(u, u)  # not 1, so that nothing is left along u
                for b in range(3):
                    sight[cell, a, b] -= weight * u[a] * u[b]
                    light[cell, a, b] += np.float64(s[a]) * s[b]
            for k in range(i + 1, looks.start[cell + 1]):
                cosines[cell, 2] = min(cosines[cell, 2], _dot(u, looks.to_camera_A[k]))
                cosines[cell, 3] = min(cosines[cell, 3], _dot(s, looks.to_sun_A[k]))
    return cosines, sight, light


def _deviations(H_T_H: Array, normal_A: Array) -> Array:
    """Square roots of the diagonals of inverses along two axes across the normals and the normals, NaN where there is none.

    `H_T_H` has the shape (n, 3, 3), the result (3, n).
    """
    values, vectors = np.linalg.eigh(H_T_H)
    values[~(values[:, 0] > LEAST_CONDITION * values[:, 2])] = np.nan
    axes = np.stack([*_across(normal_A), normal_A], axis=1)
    along = np.einsum("cij,cjk->cik", axes, vectors)
    return np.sqrt((along**2 / values[:, None, :]).sum(axis=2)).T


def _across(normal_A: Array) -> tuple[Array, Array]:
    """Two unit vectors across each normal and each other, shape (n, 3) each."""
    axis = np.eye(3)[np.abs(normal_A).argmin(axis=1)]
    first = np.cross(axis, normal_A)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normal_A, first)
