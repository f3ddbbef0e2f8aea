"""Which cells count as observed, and the observed share of the target, P_TO.

AAS 19-144, equations 1 and 2: F_TO is the union over the swarm of the target faces each spacecraft observed, and
P_TO = 100 A(F_TO) / A(F_T).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.errors import MissionError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.illumination import lit
from swarm_mj.observation.observer import Observer
from swarm_mj.typing import Array, Mask


@dataclass(frozen=True, kw_only=True)
class ObservationCriterion:
    """What a picture must show of a cell. Limits are taken at the cell's centroid; None means no limit.

    Attributes:
        min_fraction: Least visible share of the cell, above 0 to 1.
        any_pixel: Take any visible part instead; overstates the area by the border of each picture.
        max_emission_deg: Largest angle between the cell's normal and the direction to the camera [deg].
        max_range_m: Largest distance to the camera [m].
        max_gsd_m: Largest ground sampling distance [m]: range times pixel angle over the cosine of emission.
        max_incidence_deg: Largest angle between the cell's normal and the Sun [deg]; 90 asks for daylight.
        shadows: Let the body's own shadow hide cells; asks for daylight too.

    Raises:
        MissionError: A value is out of its range.
    """

    min_fraction: float = 0.5
    any_pixel: bool = False
    max_emission_deg: float | None = None
    max_range_m: float | None = None
    max_gsd_m: float | None = None
    max_incidence_deg: float | None = None
    shadows: bool = False

    def __post_init__(self) -> None:
        """Refuse impossible limits."""
        if not 0.0 < self.min_fraction <= 1.0:
            raise MissionError(f"min_fraction {self.min_fraction} must be above 0 and at most 1")
        for name in ("max_emission_deg", "max_range_m", "max_gsd_m", "max_incidence_deg"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise MissionError(f"{name} {value} must be positive, or None for no limit")

    @property
    def needs_sun(self) -> bool:
        """Whether the direction to the Sun matters."""
        return self.shadows or self.max_incidence_deg is not None


def observe(
    observer: Observer,
    r_A: ArrayLike,
    C_CA: ArrayLike,
    criterion: ObservationCriterion,
    sun_A: ArrayLike | None = None,
) -> Mask:
    """Take one picture and tell which cells count as observed in it, shape (n,).

    Args:
        observer: Who looks, at which target, through which camera.
        r_A: Camera position in A [m], shape (3,).
        C_CA: Rotation from A to the camera frame, shape (3, 3).
        criterion: What counts.
        sun_A: Direction to the Sun in A, of any length, shape (3,); needed if the criterion asks for light.

    Raises:
        MissionError: The pose is impossible, or light is asked for without a Sun.
    """
    seen = within_limits(observer.region, observer.camera, np.asarray(r_A, dtype=np.float64), criterion)
    if criterion.needs_sun and seen.any():
        seen &= _lit(observer, criterion, sun_A)
    if not seen.any():
        return seen
    fraction = observer.visible_fraction(r_A, C_CA)
    return seen & (fraction > 0.0 if criterion.any_pixel else fraction >= criterion.min_fraction)


def within_limits(region: TargetRegion, camera: CameraModel, r_A: Array, criterion: ObservationCriterion) -> Mask:
    """Cells that keep the limits of emission angle, range and ground sampling distance, shape (n,)."""
    to_camera = r_A - region.centroid_A
    distance = np.linalg.norm(to_camera, axis=1)
    cosine = np.einsum("ij,ij->i", to_camera, region.normal_A) / distance
    allowed = cosine > 0.0
    if criterion.max_emission_deg is not None:
        allowed &= np.arccos(np.clip(cosine, -1.0, 1.0)) <= np.radians(criterion.max_emission_deg)
    if criterion.max_range_m is not None:
        allowed &= distance <= criterion.max_range_m
    if criterion.max_gsd_m is not None:
        allowed &= distance * camera.pixel_angle <= criterion.max_gsd_m * cosine
    return allowed


def _lit(observer: Observer, criterion: ObservationCriterion, sun_A: ArrayLike | None) -> Mask:
    if sun_A is None:
        raise MissionError("the observation criterion asks for sunlight: pass the direction to the Sun, sun_A")
    limit = 90.0 if criterion.max_incidence_deg is None else criterion.max_incidence_deg
    tracer = observer.tracer if criterion.shadows else None
    return lit(observer.region, sun_A, max_incidence_deg=limit, tracer=tracer)


@dataclass(eq=False)
class CoverageMap:
    """What a swarm has observed so far.

    Attributes:
        area: Area of each cell [m^2], shape (n,).
        n_spacecraft: Number of spacecraft.
        first_seen_by_s: First time [s] at which each spacecraft observed each cell, NaN for never, shape (N, n).
    """

    area: Array
    n_spacecraft: int
    first_seen_by_s: Array = field(init=False)

    def __post_init__(self) -> None:
        """Start with nothing observed."""
        self.first_seen_by_s = np.full((self.n_spacecraft, len(self.area)), np.nan)

    def add(self, t: float, spacecraft: int, seen: Mask) -> None:
        """Add one picture, in any order of time.

        Args:
            t: Time of the picture [s].
            spacecraft: Who took it, from 0.
            seen: Cells observed in it, shape (n,).

        Raises:
            MissionError: The spacecraft or the number of cells does not fit.
        """
        if not 0 <= spacecraft < self.n_spacecraft:
            raise MissionError(f"spacecraft {spacecraft} is not one of the {self.n_spacecraft}, counted from 0")
        if np.shape(seen) != self.area.shape:
            raise MissionError(f"picture of {np.shape(seen)} cells does not fit a target of {len(self.area)}")
        row = self.first_seen_by_s[spacecraft]
        row[seen] = np.fmin(row[seen], t)

    @property
    def seen_by(self) -> Mask:
        """Cells that each spacecraft observed, shape (N, n)."""
        return ~np.isnan(self.first_seen_by_s)

    @property
    def seen(self) -> Mask:
        """Cells that the swarm observed, F_TO, shape (n,)."""
        return np.asarray(np.any(self.seen_by, axis=0))

    @property
    def first_seen_s(self) -> Array:
        """Time [s] at which each cell was first observed, NaN for never, shape (n,)."""
        return np.fmin.reduce(self.first_seen_by_s, axis=0, initial=np.nan)

    @property
    def percent(self) -> float:
        """P_TO [%]."""
        return self._percent(self.seen)

    @property
    def percent_by_spacecraft(self) -> Array:
        """Share of the target that each spacecraft observed [%], shape (N,)."""
        return np.array([self._percent(seen) for seen in self.seen_by])

    def percent_over_time(self, times: ArrayLike) -> Array:
        """P_TO [%] at given times [s], pictures taken at that very time included; same shape as `times`."""
        seen = self.seen
        order = np.argsort(self.first_seen_s[seen])
        total = np.concatenate([[0.0], np.cumsum(self.area[seen][order])])
        total[-1] = self.area[seen].sum()  # the same rounding as in `percent`
        count = np.searchsorted(self.first_seen_s[seen][order], np.asarray(times, dtype=np.float64), side="right")
        return 100.0 * (total[count] / self.area.sum())

    def _percent(self, seen: Mask) -> float:
        return 100.0 * float(self.area[seen].sum() / self.area.sum())
