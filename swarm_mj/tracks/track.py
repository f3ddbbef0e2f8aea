"""Paths and attitudes as files hold them: stretches of samples with a rule of interpolation, asked for at any time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swarm_mj.tracks.interpolation import interpolate, slerp, slopes
from swarm_mj.typing import Array, Ints, Mask


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Consecutive samples that belong together.

    Attributes:
        ns: Instants in nanoseconds of TDB past J2000, rising, shape (k,).
        first: From where on it may be used.
        last: Until when.
        values: Position [m] and velocity [m/s] in N, shape (k, 6); or Euler parameters (w, x, y, z) of B relative to N,
            without jumps of sign, shape (k, 4).
        method: HERMITE, LAGRANGE or LINEAR.
        degree: Of the polynomial.
    """

    ns: Ints
    first: int
    last: int
    values: Array
    method: str
    degree: int

    def at(self, ns: Ints) -> Array:
        """Values at instants inside, shape (q, 3) or (q, 4): velocities are only there to interpolate positions."""
        # Relative to the first: seconds past J2000 are rounded to 0.1 us, which at 15 km/s is a millimetre.
        t, times = (self.ns - self.ns[0]) / 1e9, (ns - self.ns[0]) / 1e9
        if self.values.shape[1] == 4:
            if self.method == "LINEAR":
                return slerp(t, self.values, times)
            q = interpolate(t, self.values, times, degree=self.degree)
            turned: Array = q / np.linalg.norm(q, axis=1, keepdims=True)
            return turned
        r, v = self.values[:, :3], self.values[:, 3:]
        return interpolate(t, r, times, degree=self.degree, rates=v if self.method == "HERMITE" else None)

    def velocity_at(self, ns: Ints) -> Array:
        """Velocities at instants inside [m/s], shape (q, 3).

        With Hermite's polynomial they are its slope, otherwise the file's, interpolated as the positions are.
        """
        t, times = (self.ns - self.ns[0]) / 1e9, (ns - self.ns[0]) / 1e9
        r, v = self.values[:, :3], self.values[:, 3:]
        if self.method == "HERMITE":
            return slopes(t, r, times, degree=self.degree, rates=v)
        return interpolate(t, v, times, degree=self.degree)


@dataclass(frozen=True)
class Track:
    """What one file says of one spacecraft.

    Attributes:
        source: The file, for messages.
        name: Of the spacecraft in it.
        stretches: In order of time.
        notes: What was assumed in reading it, one sentence each.
    """

    source: str
    name: str
    stretches: Sequence[Stretch]
    notes: tuple[str, ...] = ()

    @property
    def first(self) -> int:
        """Instant from which on something is known."""
        return min(stretch.first for stretch in self.stretches)

    @property
    def last(self) -> int:
        """Instant until which something is known."""
        return max(stretch.last for stretch in self.stretches)

    def at(self, ns: Ints) -> tuple[Array, Mask]:
        """Values at instants, and where they are known, shapes (q, m) and (q,); NaN where not.

        Where two stretches meet, the later one counts.
        """
        width = 4 if self.stretches[0].values.shape[1] == 4 else 3
        out, known = np.full((len(ns), width), np.nan), np.zeros(len(ns), dtype=bool)
        for stretch in self.stretches:
            inside = (ns >= stretch.first) & (ns <= stretch.last)
            if inside.any():
                out[inside] = stretch.at(ns[inside])
                known |= inside
        return out, known

    def state_at(self, ns: int) -> tuple[Array, Array] | None:
        """Position [m] and velocity [m/s] at an instant, each of shape (3,); None where they are not known."""
        instant = np.array([ns])
        for stretch in reversed(self.stretches):
            if stretch.first <= ns <= stretch.last:
                return stretch.at(instant)[0], stretch.velocity_at(instant)[0]
        return None
