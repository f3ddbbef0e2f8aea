"""The books of E flights: what their cameras have seen and their radios sent, and what their software knows."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from swarm_mj.observation.capture import Picture, observe, pictures, pixels_on, sight, watching
from swarm_mj.typing import Array, Ints, Mask

from . import step_kernels
from .config import Setting
from .kinematics import Known, Now, learn, turn
from .step_kernels import EpisodeTotals


class Watched(Protocol):
    """E flights as the books need to see them; `CompiledBatch` says what each member is."""

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


class Ledger:
    """The books of E flights that something else flies.

    Args:
        setting: What they share.
        flights: Who flies them.

    Attributes:
        setting: What they share.
        flights: Who flies them.
        count: Number of flights E.
        books: What they have come to.
        now: The instant between two steps, in truth.
        before: The one a step earlier.
        known: Attitudes and rates at that instant as the flight software has them.
        observation: Of every flight, shape (E, F).
        percent: Seen share of the target, shape (E,) [%].
    """

    def __init__(self, setting: Setting, flights: Watched) -> None:
        self.setting, self.flights, self.count = setting, flights, flights.count
        plan, count, n = setting.plan, flights.count, setting.plan.n
        cells, wheels = plan.region.n_cells, len(plan.properties.wheel_axes_B)
        self.books = EpisodeTotals(
            seen=np.zeros((count, cells), np.bool_),
            first_seen=np.full((count, cells), np.nan),
            area=np.zeros(count),
            stored=np.zeros((count, n)),
            delivered=np.zeros(count),
            closed=np.zeros((count, n), np.bool_),
            lost=np.zeros((count, n), np.bool_),
        )
        self.before, self.now, self._picture = (_moment(count, n, wheels) for _ in range(3))
        self.known = Known(np.zeros((count, n, 4)), np.zeros((count, n, 3)), np.zeros((count, n, 3, 3)))
        space = setting.readings.space
        self.observation = np.zeros((count, *space.shape), np.float32)
        self._low, self._high = space.low, space.high
        self.percent = np.zeros(count)
        self._everyone = np.ones(count, np.bool_)

    def _look(self, now: Now, live: Mask) -> Mask:
        """Bring a moment up to date; returns which flights are finite."""
        self.flights.read(now.r, now.v, now.q, now.omega, now.wheel)
        now.t[:] = self.flights.tick * self.flights.period
        fine = np.zeros(self.count, np.bool_)
        step_kernels.orient(self.setting.mission, now, live, fine)
        return fine

    def _know(self, live: Mask) -> None:
        """Bring up to date what the flight software knows: bit for bit the truth where sensors are perfect."""
        learn(self.now, self.known, live)
        imperfect = self.flights.know(live, self.known.q, self.known.omega)
        if imperfect.any():
            turn(self.known, imperfect)

    def _take_pictures(self, due: Mask, area: Array) -> None:
        if not due.any():
            return
        setting, now = self.setting, self._picture
        self._look(now, due)
        kind, books = self.flights.kind, self.books
        if setting.scene is not None and not setting.criterion.needs_sun:
            singly = np.zeros(kind.shape, np.bool_)
            doubt = step_kernels.take_pictures(
                setting.scene, setting.mission, now, books, kind, self.flights.blind, due, area, singly
            )
            if not doubt:
                return
        else:
            camera_on = ~(books.lost | self.flights.blind)
            singly = due[:, None] & watching(setting.plan.n_observers, kind, camera_on)
        sun = setting.plan.environment.sun
        for e in np.flatnonzero(singly.any(axis=1)):
            t = float(now.t[e])
            for picture in pictures(t, singly[e], now.r[e], now.C_BN[e], now.C_AN[e], sun.at(t)):
                area[e] += self._judge_singly(int(e), picture)

    def _judge_singly(self, e: int, picture: Picture) -> float:
        """Enter what a picture adds by the observer itself: of any kind, in light that matters, or where the maps are in doubt.

        Returns:
            Newly seen area [m^2].
        """
        setting, books, region = self.setting, self.books, self.setting.plan.region
        seen = observe(setting.observer, picture.r_A, picture.C_CA, setting.criterion, picture.sun_A)
        new = seen & ~books.seen[e]
        gained = float(region.area[new].sum())
        if gained > 0.0:
            limits = setting.criterion.limits(setting.observer.camera)
            pixels = pixels_on(limits, region.area[new], *sight(region, picture.r_A, new)).sum()
            bits = float(pixels) * setting.radio.bits_per_pixel
            step_kernels.write_down(books, e, picture.spacecraft, new, picture.t, gained, bits)
        return gained

    def _end_step(self, live: Mask, step_s: float) -> tuple[Array, Mask]:
        measures, hit = np.zeros((self.count, 3)), np.zeros(self.books.lost.shape, np.bool_)
        self._know(live)
        step_kernels.end_step(
            self.setting.mission,
            self.before,
            self.now,
            self.known,
            self.books,
            self.flights.kind,
            self.flights.index,
            np.ascontiguousarray(self.flights.sigma_BR),
            live,
            step_s,
            self._low,
            self._high,
            measures,
            hit,
            self.observation,
        )
        return measures, hit

    def _count_seen(self, new: Array) -> None:
        """Bring the seen share up to date where there is new area; from the cells, so that their order does not matter."""
        if new.any():
            area = self.setting.plan.region.area
            for e in np.flatnonzero(new):
                self.percent[e] = 100.0 * float(area[self.books.seen[e]].sum() / area.sum())

    @property
    def time_s(self) -> Array:
        """Seconds past the epoch, shape (E,)."""
        return np.asarray(self.flights.tick * self.flights.period, np.float64)


def _moment(count: int, n: int, wheels: int) -> Now:
    return Now(
        t=np.zeros(count),
        r=np.zeros((count, n, 3)),
        v=np.zeros((count, n, 3)),
        q=np.zeros((count, n, 4)),
        omega=np.zeros((count, n, 3)),
        wheel=np.zeros((count, n, wheels)),
        C_AN=np.zeros((count, 3, 3)),
        r_A=np.zeros((count, n, 3)),
        C_BN=np.zeros((count, n, 3, 3)),
    )
