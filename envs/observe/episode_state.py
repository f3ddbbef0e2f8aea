"""The state of E episodes: what their cameras have seen and their radios sent, and what their software knows."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numba import types

from swarm_mj.observation.capture import Picture, lit_cells, observe, pictures, pixels_on, sight, watching
from swarm_mj.observation.smear import Motion
from swarm_mj.simulator.fast.bound_calls import BoundCall
from swarm_mj.typing import Array, Ints, Mask

from .kinematics import (
    Kinematics,
    Tracking,
    copy_truth,
    no_estimate,
    no_kinematics,
    update_estimated_rotations,
    update_rotations,
)
from .observations import write_observations
from .pictures import nothing_gained, take_pictures
from .state import SwarmState
from .task import Task
from .totals import no_totals, record_cells


class StateSource(Protocol):
    """E flights as their episodes need to see them; `Batch` says what each member is."""

    count: int
    period: float
    tick: Ints
    kind: Ints
    index: Ints
    lost: Mask
    blind: Mask

    @property
    def sigma_BR(self) -> Array:
        """Attitude errors at the last decision."""
        ...

    def read(self, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
        """Copy the states."""
        ...

    def know(self, live: Mask, q: Array, omega: Array) -> Mask:
        """Put what the flight software has in the place of the truth; returns where that is not the same."""
        ...


class EpisodeState:
    """The state of E episodes whose flights something else flies.

    Args:
        task: What they share.
        flights: Who flies them.

    Attributes:
        task: What they share.
        flights: Who flies them.
        count: Number of flights E.
        totals: What they have come to.
        now: The instant between two steps, in truth.
        before: The one a step earlier.
        estimate: Attitudes and rates at that instant as the flight software has them.
        observation: Of every flight, shape (E, F).
    """

    def __init__(self, task: Task, flights: StateSource) -> None:
        self.task, self.flights, self.count = task, flights, flights.count
        plan, count = task.plan, flights.count
        self.totals = no_totals(count, plan.n, plan.region.n_cells)
        wheels = len(plan.properties.wheel_axes_B)
        self.before, self.now, self._at_picture = (no_kinematics(count, plan.n, wheels) for _ in range(3))
        self.estimate = no_estimate(count, plan.n)
        self.observation = np.zeros((count, *task.observation_layout.space.shape), np.float32)
        self._all = np.ones(count, np.bool_)
        self._rotation, self._pictures = task.body_rotation, task.picture_constants
        self._observations = task.observation_constants
        # Bound, because handing over their arrays would take as long as what they do.
        flags, rotation = types.boolean[::1], self._rotation
        self._rotate_now = BoundCall(update_rotations, (rotation, self.now), (flags, flags))
        self._rotate_picture = BoundCall(update_rotations, (rotation, self._at_picture), (flags, flags))
        self._copy_truth = BoundCall(copy_truth, (self.now, self.estimate), (flags,))
        if task.scene is not None:
            self._looking, self._gained = np.zeros(count, np.bool_), nothing_gained(task.scene, np.zeros(count), plan.n)
            constants, now, totals = self._pictures, self._at_picture, self.totals
            given = (task.scene, constants, now, totals, flights.kind, flights.blind, self._looking, self._gained)
            self._judge_pictures = BoundCall(take_pictures, given)

    @property
    def time_s(self) -> Array:
        """Seconds past the epoch, shape (E,)."""
        return np.asarray(self.flights.tick * self.flights.period, np.float64)

    def swarm_state(self, e: int) -> SwarmState:
        """The swarm of flight e between two steps."""
        now = self.now
        return SwarmState(
            t=float(now.t[e]),
            r_BN_N=now.r[e].copy(),
            v_BN_N=now.v[e].copy(),
            C_BN=now.C_BN[e].copy(),
            omega_BN_B=now.omega[e].copy(),
            wheel_speed=now.wheel[e].copy(),
            C_AN=now.C_AN[e].copy(),
        )

    def info(self, e: int) -> dict[str, Any]:
        """What every step tells of flight e."""
        return {
            "time_s": float(self.time_s[e]),
            "coverage_percent": float(self.totals.percent[e]),
            "delivered_bit": float(self.totals.delivered[e]),
            "stored_bit": self.totals.stored[e].tolist(),
            "seen_bit": float(self.totals.seen_bit[e]),
            "lost_bit": float(self.totals.lost_bit[e]),
        }

    def _update_kinematics(self, now: Kinematics, live: Mask) -> Mask:
        """Bring an instant, `now` or that of pictures, up to date; returns which flights are finite."""
        self.flights.read(now.r, now.v, now.q, now.omega, now.wheel)
        now.t[:] = self.flights.tick * self.flights.period
        finite = np.zeros(self.count, np.bool_)
        rotate = self._rotate_now if now is self.now else self._rotate_picture
        rotate(live, finite)
        return finite

    def _shift_instants(self) -> None:
        """Let the instant between two steps be the one before."""
        for before, now in zip(self.before, self.now, strict=True):
            before[:] = now

    def _update_estimate(self, live: Mask) -> None:
        """Bring up to date what the flight software knows: bit for bit the truth where sensors are perfect."""
        self._copy_truth(live)
        imperfect = self.flights.know(live, self.estimate.q, self.estimate.omega)
        if imperfect.any():
            update_estimated_rotations(self.estimate, imperfect)

    def _take_pictures(self, due: Mask, area: Array) -> None:
        """Pictures of the flights in which they are due, shape (E,); `area` (E,) [m^2] grows by what is newly seen."""
        if not due.any():
            return
        task, flights = self.task, self.flights
        self._update_kinematics(self._at_picture, due)
        kind, blind, now, totals = flights.kind, flights.blind, self._at_picture, self.totals
        if task.scene is None:
            singly = due[:, None] & watching(task.plan.n_observers, kind, ~(totals.lost | blind))
        else:
            gained, dark = self._gained, self._dark(due)
            gained.area[:], gained.doubt[:], self._looking[:] = area, False, due
            if dark is None:
                self._judge_pictures()
            else:
                # What is dark counts as seen already while pictures are judged.
                judged = totals._replace(seen=totals.seen | dark)
                take_pictures(task.scene, self._pictures, now, judged, kind, blind, due, gained)
                totals.seen[:] |= judged.seen & ~dark
            area[:], singly = gained.area, gained.doubt
            if not singly.any():
                return
        self._judge_all(singly, area)

    def _judge_all(self, singly: Mask, area: Array) -> None:
        """Pictures that the observer itself must judge, shape (E, n), at the instant of pictures; `area` grows, see above."""
        task, now, sun = self.task, self._at_picture, self.task.plan.environment.sun
        for e in np.flatnonzero(singly.any(axis=1)):
            t = float(now.t[e])
            moving = Motion(now.v[e], now.omega[e], task.plan.environment.spin_N)
            for picture in pictures(t, singly[e], now.r[e], now.C_BN[e], now.C_AN[e], sun.at(t), moving):
                area[e] += self._judge_singly(int(e), picture)

    def _dark(self, due: Mask) -> Mask | None:
        """Cells without the light that the criterion asks for, where pictures are due, shape (E, C); None: it asks for none."""
        task, now = self.task, self._at_picture
        if not task.criterion.needs_sun:
            return None
        dark, known = np.zeros(self.totals.seen.shape, np.bool_), dict[float, Mask]()
        for e in np.flatnonzero(due):
            t = float(now.t[e])
            if t not in known:
                known[t] = ~lit_cells(task.observer, task.criterion, now.C_AN[e] @ task.plan.environment.sun.at(t))
            dark[e] = known[t]
        return dark

    def _judge_singly(self, e: int, picture: Picture) -> float:
        """Enter what a picture adds by the observer itself: of any kind, in light that matters, or where the maps are in doubt.

        Returns:
            Newly seen area [m^2].
        """
        task, totals, region = self.task, self.totals, self.task.plan.region
        seen = observe(task.observer, picture.r_A, picture.C_CA, task.criterion, picture.sun_A, picture.motion)
        new = seen & ~totals.seen[e]
        gained = float(region.area[new].sum())
        if gained > 0.0:
            limits = task.criterion.limits(task.observer.camera)
            pixels = pixels_on(limits, region.area[new], *sight(region, picture.r_A, new)).sum()
            bits, most = float(pixels) * self._pictures.bits_per_pixel, self._pictures.storage_bit
            record_cells(totals, e, picture.spacecraft, new, picture.t, gained, bits, most)
        return gained

    def _observe(self, live: Mask) -> None:
        """Write the observations of the live flights."""
        self._update_estimate(live)
        write_observations(
            self._observations, self.now, self.estimate, self._tracking(), self.totals, live, self.observation
        )

    def _tracking(self) -> Tracking:
        return Tracking(
            self.flights.kind, self.flights.index, np.ascontiguousarray(self.flights.sigma_BR), self.flights.blind
        )
