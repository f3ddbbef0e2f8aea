"""Sweeping a target with a camera too narrow to see it at once: a behaviour that leads the observers through its parts.

The target's pyramid is divided into rows x rows equal parts along its east and north tangents. Each observer goes through
their middles row by row, to and fro, from a starting place of its own, and stays on each for a while. With one row all look
at the target's middle. Points lie at one distance from the body's centre along each direction: relief is not followed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import atan, cos, degrees, isfinite, radians, sin, sqrt, tan
from typing import ClassVar

import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.mission.behaviors import AdaptableRoles, SwarmView, TargetKind, Targets
from swarm_mj.mission.target import Pyramid
from swarm_mj.scenarios.schema import Target
from swarm_mj.typing import Array


@dataclass(frozen=True)
class TargetSweep:
    """As `AdaptableRoles`, but inside the imaging radius the observers look at parts of the target in turn.

    Attributes:
        n_observers: Number of spacecraft.
        imaging_radius_m: R_im [m].
        surface_radius_m: Distance of the target's surface from the body's centre [m].
        latitude_deg: Of the middle of what is swept; None: of the scenario's target.
        longitude_deg: Of the middle of what is swept, east; None: of the scenario's target.
        half_angle_deg: Between the swept pyramid's axis and its corner edges [deg]; None: of the scenario's target.
        rows: Parts along one side.
        dwell_s: How long an observer looks at one part [s]; turning takes some of it.
        election: Who relays to Earth, see `AdaptableRoles`.

    Raises:
        MissionError: A value is impossible.
    """

    n_observers: int
    imaging_radius_m: float
    surface_radius_m: float
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    half_angle_deg: float | None = None
    rows: int = 4
    dwell_s: float = 30.0
    election: str = "first"
    dedicated_communications: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse impossible sweeps."""
        _ = self._inner
        for name in ("surface_radius_m", "dwell_s"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0.0):
                raise MissionError(f"behavior.parameters.{name} = {value}: must be a positive number")
        if self.half_angle_deg is not None and not 0.0 < self.half_angle_deg < 90.0:
            raise MissionError(
                f"behavior.parameters.half_angle_deg = {self.half_angle_deg}: must be above 0 and below 90"
            )
        if isinstance(self.rows, bool) or not isinstance(self.rows, int) or self.rows < 1:
            raise MissionError(f"behavior.parameters.rows = {self.rows!r}: must be a whole number of at least 1")

    def aimed_at(self, target: Target | Pyramid) -> TargetSweep:
        """See `AimedBehavior`: what the parameters do not give is taken from the target."""
        corner_deg = target.half_angle_deg
        if target.edges == "side":
            corner_deg = degrees(atan(sqrt(2.0) * tan(radians(corner_deg))))  # of a square pyramid
        return replace(
            self,
            latitude_deg=target.latitude_deg if self.latitude_deg is None else self.latitude_deg,
            longitude_deg=target.longitude_deg if self.longitude_deg is None else self.longitude_deg,
            half_angle_deg=corner_deg if self.half_angle_deg is None else self.half_angle_deg,
        )

    @cached_property
    def _inner(self) -> AdaptableRoles:
        return AdaptableRoles(self.n_observers, self.imaging_radius_m, self.election)

    @cached_property
    def points_A(self) -> Array:
        """Middles of the parts in the order of the sweep, shape (rows^2, 3) [m]."""
        side = tan(radians(self._told("half_angle_deg"))) / np.sqrt(2.0)
        middle = (2.0 * np.arange(self.rows) + 1.0) / self.rows - 1.0
        north, east = np.meshgrid(middle, middle, indexing="ij")
        east[1::2] = east[1::2, ::-1].copy()
        ahead = np.column_stack([side * east.ravel(), side * north.ravel(), np.ones(self.rows**2)]) @ self._axes_A
        return self.surface_radius_m * ahead / np.linalg.norm(ahead, axis=1, keepdims=True)

    def _told(self, name: str) -> float:
        value = getattr(self, name)
        if value is None:
            raise MissionError(f"behavior.parameters.{name}: give it, or let a scenario's target give it (`aimed_at`)")
        return float(value)

    @property
    def _axes_A(self) -> Array:
        """East, north and outward, as rows."""
        latitude, longitude = radians(self._told("latitude_deg")), radians(self._told("longitude_deg"))
        c, s = cos(longitude), sin(longitude)
        out = [cos(latitude) * c, cos(latitude) * s, sin(latitude)]
        return np.array([[-s, c, 0.0], [-sin(latitude) * c, -sin(latitude) * s, cos(latitude)], out])

    def targets(self, view: SwarmView, memory: int | None) -> tuple[Targets, int | None]:
        """See `Behavior`; the memory is that of `AdaptableRoles`."""
        targets, memory = self._inner.targets(view, memory)
        count = len(self.points_A)
        start = np.arange(self.n_observers) * count // self.n_observers
        points = self.points_A[(start + int(view.t / self.dwell_s)) % count]
        observing = targets.kind == TargetKind.ASTEROID
        kind = np.where(observing, int(TargetKind.SURFACE), targets.kind)
        return Targets(kind, targets.spacecraft, np.where(observing[:, None], points, targets.vector)), memory
