"""Behaviours: who points its +z axis at what (AAS 19-144, "Attitude behaviors"), as plug-ins.

A behaviour sees the swarm's positions and answers with one target per spacecraft. Every decision is local to a spacecraft
(its own distance to the body), except the election of a communications spacecraft, which all make alike from positions
that all share. State goes in and comes out as `memory`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import inf, sqrt
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np

from swarm_mj.compilation import jittable, kernel
from swarm_mj.errors import MissionError
from swarm_mj.mission.target import Pyramid
from swarm_mj.scenarios.schema import Target
from swarm_mj.typing import Array, Ints, Mask

#: More than any small body pulls at its surface (Ceres 0.3, Eros 0.006) [m/s^2].
STRONGEST_PULL = 1.0


class TargetKind(IntEnum):
    """What a line of sight can follow."""

    ASTEROID = 0  #: the body's centre
    SPACECRAFT = 1  #: another spacecraft
    EARTH = 2
    SURFACE = 3  #: a point fixed in A
    DIRECTION = 4  #: a direction fixed in N


_ASTEROID, _SURFACE = int(TargetKind.ASTEROID), int(TargetKind.SURFACE)


@jittable
def looks_at_body(kind: Any) -> Any:
    """Whether lines of sight of these kinds, a number or an array of them, go to the body, so that its camera sees it."""
    return (kind == _ASTEROID) | (kind == _SURFACE)


class SwarmView(NamedTuple):
    """What a behaviour may look at.

    Attributes:
        t: Time past the epoch [s].
        r_BN_N: Positions, shape (n, 3) [m].
        v_BN_N: Velocities, shape (n, 3) [m/s].
        C_AN: Rotation from N to A, shape (3, 3).
        q_BN: Attitudes, shape (n, 4); None where trajectories are looked at without attitudes, and so are the next two.
        omega_BN_B: Body rates, shape (n, 3) [rad/s].
        wheel_speed: Shape (n, w) [rad/s].
        working: Who is not lost, shape (n,); None: nobody can be.
        camera_on: Whose camera takes pictures, shape (n,); None: everybody's.
    """

    t: float
    r_BN_N: Array
    v_BN_N: Array
    C_AN: Array
    q_BN: Array | None = None
    omega_BN_B: Array | None = None
    wheel_speed: Array | None = None
    working: Mask | None = None
    camera_on: Mask | None = None


class Targets(NamedTuple):
    """One line of sight per spacecraft.

    Attributes:
        kind: `TargetKind` values, shape (n,).
        spacecraft: The spacecraft to follow, from 0, where kind is SPACECRAFT, shape (n,).
        vector: Point in A [m] for SURFACE, or direction in N for DIRECTION, shape (n, 3).
    """

    kind: Ints
    spacecraft: Ints
    vector: Array


class Behavior(Protocol):
    """A rule that points the swarm; a plug-in is built with (n_observers, imaging_radius_m, **parameters)."""

    @property
    def dedicated_communications(self) -> bool:
        """Whether one more spacecraft than the observers flies along and only communicates; a class may just say so."""
        ...

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """Targets at this instant and the memory for the next; the first memory is None."""
        ...


@runtime_checkable
class SteadyBehavior(Protocol):
    """A behaviour that knows how long its answer lasts, so that it need not be asked at every instant."""

    def steady_for(self, view: SwarmView, memory: Any) -> float:
        """Time [s] from the view's instant on within which `targets`, given `memory`, answers the same and gives it back.

        Args:
            view: The instant at which `targets` was last asked.
            memory: What it gave back.
        """
        ...


@runtime_checkable
class MissionBehavior(Protocol):
    """A behaviour that must know the mission; its `targets` serve only after `for_flight`."""

    def for_flight(self, plan: Any) -> Behavior:
        """The behaviour of one flight of a `swarm_mj.flight.plan.Plan`."""
        ...


@runtime_checkable
class AimedBehavior(Protocol):
    """A behaviour that looks at the scenario's target, where its own parameters name no other."""

    def aimed_at(self, target: Target | Pyramid) -> Behavior:
        """The same behaviour, for the target of a scenario, or the pyramid about it."""
        ...


@runtime_checkable
class SelectiveBehavior(Protocol):
    """A behaviour that cannot fly every scenario, and says so before anything is planned."""

    def check_scenario(self, scenario: Any) -> None:
        """Refuse a `swarm_mj.scenarios.schema.Scenario` by a `SwarmError` that names key, value and what is allowed."""
        ...


@dataclass(frozen=True)
class DedicatedCommunications:
    """Configuration 1: the last spacecraft relays to Earth, the others observe and then talk to it.

    Observers track the asteroid inside the imaging radius and the communications spacecraft outside; the communications
    spacecraft tracks Earth throughout.
    """

    n_observers: int
    imaging_radius_m: float
    dedicated_communications: ClassVar[bool] = True

    def targets(self, view: SwarmView, memory: None) -> tuple[Targets, None]:
        """See `Behavior`; nothing is remembered."""
        relay = self.n_observers
        targets = _empty(relay + 1)
        _track_inside(view.r_BN_N, self.imaging_radius_m, relay, targets.kind, targets.spacecraft)
        targets.kind[relay] = TargetKind.EARTH
        return targets, None

    def steady_for(self, view: SwarmView, memory: None) -> float:
        """See `SteadyBehavior`."""
        return _time_to_sphere(view.r_BN_N, view.v_BN_N, self.imaging_radius_m)


@dataclass(frozen=True)
class AdaptableRoles:
    """Configuration 2: all observe inside the imaging radius; outside, an elected one relays to Earth.

    The election is held once, when the first spacecraft leaves the imaging region.

    Attributes:
        n_observers: Number of spacecraft.
        imaging_radius_m: R_im [m].
        election: 'first' takes spacecraft 1, as the paper does; 'medoid' the one with the least sum of distances to the
            others, the medoid of a single cluster of positions (Kaufman and Rousseeuw 1990).
    """

    n_observers: int
    imaging_radius_m: float
    election: str = "first"
    dedicated_communications: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.election not in ELECTIONS:
            raise MissionError(
                f"behavior.parameters.election = {self.election!r}: must be one of {', '.join(ELECTIONS)}"
            )

    def targets(self, view: SwarmView, memory: int | None) -> tuple[Targets, int | None]:
        """See `Behavior`; the memory is the number of the elected spacecraft, counted from 0, or None before."""
        targets = _empty(self.n_observers)
        candidate = 0 if memory is None else memory
        outside = _track_inside(view.r_BN_N, self.imaging_radius_m, candidate, targets.kind, targets.spacecraft)
        if outside and memory is None:
            memory = ELECTIONS[self.election](view.r_BN_N)
            _track_inside(view.r_BN_N, self.imaging_radius_m, memory, targets.kind, targets.spacecraft)
        return targets, memory

    def steady_for(self, view: SwarmView, memory: int | None) -> float:
        """See `SteadyBehavior`."""
        return _time_to_sphere(view.r_BN_N, view.v_BN_N, self.imaging_radius_m)


@dataclass(frozen=True)
class PointAims:
    """A behaviour whose observers look at points on the ground where it has them look at the body's centre.

    Attributes:
        inner: The behaviour.
        points_A: Of each observer, NaN: it looks at the centre, shape (n_obs, 3) [m].
    """

    inner: Behavior
    points_A: Array

    @property
    def dedicated_communications(self) -> bool:
        """See `Behavior`."""
        return self.inner.dedicated_communications

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """See `Behavior`."""
        targets, memory = self.inner.targets(view, memory)
        kind, vector = targets.kind.copy(), targets.vector.copy()
        own = np.flatnonzero((kind[: len(self.points_A)] == _ASTEROID) & ~np.isnan(self.points_A[:, 0]))
        kind[own], vector[own] = _SURFACE, self.points_A[own]
        return Targets(kind, targets.spacecraft, vector), memory

    def steady_for(self, view: SwarmView, memory: Any) -> float:
        """See `SteadyBehavior`."""
        return self.inner.steady_for(view, memory) if isinstance(self.inner, SteadyBehavior) else 0.0


@dataclass(frozen=True)
class BodyOnApproach:
    """A behaviour whose observers look at the body until they first do so by themselves, so that cameras can navigate.

    Attributes:
        inner: The behaviour.
        n_observers: Number of spacecraft that observe; they come first.
    """

    inner: Behavior
    n_observers: int

    @property
    def dedicated_communications(self) -> bool:
        """See `Behavior`."""
        return self.inner.dedicated_communications

    def targets(self, view: SwarmView, memory: tuple[Any, Mask] | None) -> tuple[Targets, tuple[Any, Mask]]:
        """See `Behavior`; the memory is the inner behaviour's, and who has looked at the body by itself."""
        inner, looked = (None, np.zeros(self.n_observers, np.bool_)) if memory is None else memory
        targets, inner = self.inner.targets(view, inner)
        looked = looked | looks_at_body(targets.kind[: self.n_observers])
        kind, approach = targets.kind.copy(), np.flatnonzero(~looked)
        kind[approach] = _ASTEROID
        return Targets(kind, targets.spacecraft, targets.vector), (inner, looked)

    def steady_for(self, view: SwarmView, memory: tuple[Any, Mask]) -> float:
        """See `SteadyBehavior`."""
        return self.inner.steady_for(view, memory[0]) if isinstance(self.inner, SteadyBehavior) else 0.0


@dataclass(frozen=True)
class BodyTracking:
    """All look at the body from the start of a flight on, however far it is, and later elsewhere.

    Attributes:
        n_observers: Number of spacecraft.
        imaging_radius_m: Of no meaning here.
        until_s: Past the epoch, until when they look at the body [s].
        then: Afterwards: 'hold' stays turned to where the body was then, 'earth' looks there, 'body' on at the body.
        bus: What the spacecraft is turned to until then: 'body'; 'velocity', where its +z stays on the velocity in N of
            the start; or a direction in N. The last two are for a camera that turns by itself (`camera.gimbal`).
    """

    n_observers: int
    imaging_radius_m: float
    until_s: float = inf
    then: str = "hold"
    bus: str | tuple[float, float, float] = "body"
    dedicated_communications: ClassVar[bool] = False

    def __post_init__(self) -> None:
        key = "behavior.parameters"
        if not isinstance(self.until_s, float | int) or not self.until_s >= 0.0:
            raise MissionError(f"{key}.until_s = {self.until_s!r}: must be a time past the epoch of 0 or more [s]")
        if self.then not in ("hold", "earth", "body"):
            raise MissionError(f"{key}.then = {self.then!r}: must be hold, earth or body")
        if isinstance(self.bus, str):
            if self.bus not in ("body", "velocity"):
                raise MissionError(f"{key}.bus = {self.bus!r}: must be body, velocity, or a direction [x, y, z] in N")
            return
        direction = np.asarray(self.bus, dtype=np.float64)
        if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
            raise MissionError(f"{key}.bus = {self.bus!r}: must be three finite numbers, not all zero")

    def targets(self, view: SwarmView, memory: tuple[Array, Array | None] | None) -> tuple[Targets, Any]:
        """See `Behavior`; the memory is the first velocities, and the directions to the body at the end of its tracking."""
        targets = _empty(self.n_observers)
        first_v, last = (view.v_BN_N.copy(), None) if memory is None else memory
        if view.t < self.until_s:
            if self.bus != "body":
                targets.kind[:] = TargetKind.DIRECTION
                targets.vector[:] = _unit_rows(first_v if isinstance(self.bus, str) else np.array([self.bus], float))
        elif self.then == "earth":
            targets.kind[:] = TargetKind.EARTH
        elif self.then == "hold":
            last = _unit_rows(-view.r_BN_N) if last is None else last
            targets.kind[:], targets.vector[:] = TargetKind.DIRECTION, last
        return targets, (first_v, last)

    def steady_for(self, view: SwarmView, memory: Any) -> float:
        """See `SteadyBehavior`."""
        return float(self.until_s - view.t) if view.t < self.until_s else inf


def _unit_rows(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def _empty(n: int) -> Targets:
    return Targets(np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros((n, 3)))


@kernel
def _track_inside(r: Array, radius: float, communications: int, kind: Ints, index: Ints) -> int:
    """Asteroid inside the radius; outside the communications spacecraft, and Earth for that one. Returns how many are out."""
    outside = 0
    for j in range(r.shape[0]):
        index[j] = 0
        if r[j, 0] ** 2 + r[j, 1] ** 2 + r[j, 2] ** 2 <= radius * radius:
            kind[j] = 0
            continue
        outside += 1
        kind[j] = 2 if j == communications else 1
        index[j] = 0 if j == communications else communications
    return outside


@kernel
def _time_to_sphere(r: Array, v: Array, radius: float) -> float:
    """Time before which no spacecraft can cross the sphere about the body's centre [s], however the body pulls."""
    shortest = inf
    for j in range(r.shape[0]):
        distance = sqrt(r[j, 0] ** 2 + r[j, 1] ** 2 + r[j, 2] ** 2)
        speed = sqrt(v[j, 0] ** 2 + v[j, 1] ** 2 + v[j, 2] ** 2)
        # gap = speed t + pull t^2 / 2
        gap = abs(distance - radius)
        shortest = min(shortest, (sqrt(speed * speed + 2.0 * STRONGEST_PULL * gap) - speed) / STRONGEST_PULL)
    return shortest


def elect_first(r_BN_N: Array) -> int:
    """The first spacecraft, as in the paper."""
    return 0


def elect_medoid(r_BN_N: Array) -> int:
    """The spacecraft with the least sum of distances to all others; the lowest number on a tie."""
    distances = np.linalg.norm(r_BN_N[:, None] - r_BN_N[None], axis=2)
    return int(np.argmin(distances.sum(axis=1)))


ELECTIONS = {"first": elect_first, "medoid": elect_medoid}
