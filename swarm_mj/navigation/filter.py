"""The filter that keeps what spacecraft know of where they are: sequential, linearised about its own estimate, square roots.

The state of n spacecraft is, one after the other, position and velocity in N, and the turn by which each one's camera is
mounted otherwise than believed; then what all share of the body: its gravitational parameter over the believed one less one,
and the small rotation by which it is turned otherwise than believed, in N, and the rate of its spin. Shared or not, all is one
state with one covariance, so that a range between two spacecraft tells both what it should and nothing is counted twice.

The covariance is kept as a triangular root, P = S S^T, and both updates are orthogonal triangularisations (Kaminski, Bryson,
Schmidt 1971, IEEE Transactions on Automatic Control 16, 727): P stays positive however many measurements there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from swarm_mj.mission.corrections import gravity_gradient
from swarm_mj.mission.trajectories import AccelerationN
from swarm_mj.navigation.picture import Fix
from swarm_mj.spacecraft.attitude.mrp import cross_matrix
from swarm_mj.typing import Array, Ints

#: Places in the state of one spacecraft, and how many they are.
POSITION, VELOCITY, MOUNT, OWN = slice(0, 3), slice(3, 6), slice(6, 9), 9
#: The same of what is shared, counted from the end of the spacecraft's.
GM, ROTATION, SPIN, SHARED = 0, slice(1, 4), 4, 5
#: Longest step of the integration over the time in which a body's pull changes much, sqrt(r^3 / GM), and over anything [s].
STEP, LONGEST_S = 0.05, 600.0
#: Chance with which a measurement as unlikely as one that is rejected would be a true one: one in a million.
GATE = 1e-6
#: How many times what a range varies beyond first order counts in the estimate: it does not become less as others follow, since
#: it comes of the same errors in all of them. Chosen so that estimates of drawn flights err as they say, in the mean and in the
#: tail (`docs/results/optical.md`).
SECOND_ORDER = 6.0


@dataclass(frozen=True, kw_only=True)
class FilterNoise:
    """What the filter believes to err, 1 sigma.

    Attributes:
        acceleration: White noise of the acceleration, each component [m/s^1.5].
        attitude: White error of a camera's attitude about each axis, anew in every picture, where that tells none [rad].
        mount: Constant turn of a camera about each axis [rad].
        gm: Of the gravitational parameter, over it [-].
        rotation: Of the body's orientation about each axis at the epoch [rad].
        spin: Of its spin rate [rad/s].
    """

    acceleration: float = 0.0
    attitude: float = 0.0
    mount: float = 0.0
    gm: float = 0.0
    rotation: float = 0.0
    spin: float = 0.0


class Update(NamedTuple):
    """What a measurement did.

    Attributes:
        nis: Innovation squared over its covariance.
        dof: Number of its components.
        accepted: Whether it was believed.
    """

    nis: float
    dof: int
    accepted: bool


class SwarmFilter:
    """Estimates the states of n spacecraft relative to the body.

    Args:
        acceleration: Forces as believed, function (t, r (k, 3)) -> (k, 3) [m/s^2] in N.
        gm: Gravitational parameter of the body [m^3/s^2], by which its error acts.
        spin_N: Believed angular velocity of A in N [rad/s], shape (3,).
        noise: What errs.
        t: Time of the start past the epoch [s].
        r_N: Believed positions, shape (n, 3) [m].
        v_N: Believed velocities, shape (n, 3) [m/s].
        P: Covariance of each, shape (n, 6, 6).
    """

    def __init__(
        self,
        acceleration: AccelerationN,
        gm: float,
        spin_N: Array,
        noise: FilterNoise,
        t: float,
        r_N: Array,
        v_N: Array,
        P: Array,
    ) -> None:
        self._acceleration, self._gm, self.noise, self.t = acceleration, gm, noise, t
        self._axis_N = spin_N / max(float(np.linalg.norm(spin_N)), 1e-300)
        self.n = len(r_N)
        self.x = np.zeros(OWN * self.n + SHARED)
        self.S = np.zeros((len(self.x), len(self.x)))
        for j in range(self.n):
            own = OWN * j
            self.x[own : own + 3], self.x[own + 3 : own + 6] = r_N[j], v_N[j]
            self.S[own : own + 6, own : own + 6] = _root(P[j])
            self.S[own + 6 : own + 9, own + 6 : own + 9] = noise.mount * np.eye(3)
        shared = OWN * self.n
        self.S[shared, shared] = noise.gm
        self.S[shared + 1 : shared + 4, shared + 1 : shared + 4] = noise.rotation * np.eye(3)
        self.S[shared + 4, shared + 4] = noise.spin
        # States without any uncertainty are left out of the arithmetic, but for those that move.
        active = (self.S != 0.0).any(axis=1)
        active[[OWN * j + k for j in range(self.n) for k in range(6)]] = True
        self._active: Ints = np.flatnonzero(active)

    @property
    def r_N(self) -> Array:
        """Estimated positions, a copy, shape (n, 3) [m]."""
        return self._own()[:, POSITION].copy()

    @property
    def v_N(self) -> Array:
        """Estimated velocities, a copy, shape (n, 3) [m/s]."""
        return self._own()[:, VELOCITY].copy()

    @property
    def mount(self) -> Array:
        """Estimated turns of the cameras, a copy, shape (n, 3) [rad]."""
        return self._own()[:, MOUNT].copy()

    def _own(self) -> Array:
        return self.x[: OWN * self.n].reshape(self.n, OWN)

    @property
    def P(self) -> Array:
        """Covariance of the whole state."""
        return self.S @ self.S.T

    def covariance(self, j: int) -> Array:
        """Of position and velocity of spacecraft j, shape (6, 6)."""
        rows = self.S[OWN * j : OWN * j + 6]
        return rows @ rows.T

    def position_sigma(self, j: int) -> float:
        """Standard deviation of the position of spacecraft j along its widest axis [m]."""
        return float(np.linalg.norm(self.S[OWN * j : OWN * j + 3], ord=2))

    def rotation_error(self, t: float) -> Array:
        """Estimated rotation by which the body is turned otherwise than believed, in N [rad], shape (3,)."""
        shared = self.x[OWN * self.n :]
        return shared[ROTATION] + self._axis_N * (shared[SPIN] * t)

    def advance(self, t: float) -> Array:
        """Carry the estimate to a later time [s]; gives the transition matrix of the whole state."""
        phi = np.eye(len(self.x))
        while (left := t - self.t) > 1e-9:
            phi = self._step(min(left, self._longest_step())) @ phi
        self.t = max(t, self.t)
        return phi

    def _longest_step(self) -> float:
        distance = float(np.linalg.norm(self.r_N, axis=1).min())
        pace = float(np.sqrt(distance**3 / self._gm)) if self._gm > 0.0 else np.inf
        speed = float(np.linalg.norm(self.v_N, axis=1).max())
        passing = distance / speed if speed > 0.0 else np.inf
        return max(min(STEP * pace, STEP * passing, LONGEST_S), 1e-3)

    def _step(self, h: float) -> Array:
        """One step of Runge and Kutta's fourth order of states and their transition matrices; gives that of the whole state."""
        n, t = self.n, self.t
        more = np.zeros((n, 6, 8))
        more[:, :, 0], more[:, :, 1:] = self._own()[:, :6], np.eye(6, 7)
        k1 = self._rate(t, more)
        k2 = self._rate(t + 0.5 * h, more + 0.5 * h * k1)
        k3 = self._rate(t + 0.5 * h, more + 0.5 * h * k2)
        k4 = self._rate(t + h, more + h * k3)
        more = more + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        self._own()[:, :6] = more[:, :, 0]
        phi, noise = np.eye(len(self.x)), np.zeros((len(self.x), 6 * n))
        for j in range(n):
            own = slice(OWN * j, OWN * j + 6)
            phi[own, own], phi[own, OWN * n + GM] = more[j, :, 1:7], more[j, :, 7]
            # White acceleration over the step: its covariance has this root.
            q = self.noise.acceleration * np.sqrt(h)
            noise[OWN * j : OWN * j + 3, 6 * j : 6 * j + 3] = q * h / np.sqrt(12.0) * np.eye(3)
            noise[OWN * j : OWN * j + 3, 6 * j + 3 : 6 * j + 6] = 0.5 * q * h * np.eye(3)
            noise[OWN * j + 3 : OWN * j + 6, 6 * j + 3 : 6 * j + 6] = q * np.eye(3)
        S = phi @ self.S
        self._triangularise(np.hstack((S, noise)) if self.noise.acceleration > 0.0 else S)
        self.t = t + h
        return phi

    def _rate(self, t: float, y: Array) -> Array:
        """Rates of states, their transition matrices and their derivatives by the error of GM, shape (n, 6, 8)."""
        n, r = self.n, y[:, :3, 0]
        a, gradient = gravity_gradient(self._acceleration, t, r)
        pull = -self._gm * r / np.linalg.norm(r, axis=1, keepdims=True) ** 3
        rate = np.empty_like(y)
        rate[:, :3] = y[:, 3:]
        rate[:, 3:, 0] = a + self.x[OWN * n + GM] * pull
        rate[:, 3:, 1:] = gradient @ y[:, :3, 1:]
        rate[:, 3:, 7] += pull
        return rate

    def _triangularise(self, wide: Array) -> None:
        """Put a square root of wide wide^T in the place of S."""
        keep = self._active
        S = np.zeros_like(self.S)
        S[np.ix_(keep, keep)] = _triangle(wide[keep])[:, : len(keep)]
        self.S = S

    def push(self, j: int, change_N: Array, covariance: Array) -> None:
        """Tell of a change of position and velocity [m, m/s], shape (6,), known with some covariance, shape (6, 6)."""
        own = slice(OWN * j, OWN * j + 6)
        self.x[own] += change_N
        wide = np.zeros((len(self.S), 6))
        wide[own] = _root(covariance)
        self._triangularise(np.hstack((self.S, wide)))

    def use_fix(self, j: int, fix: Fix, C_AN: Array, attitude: float | None = None) -> Update:
        """Use what a picture of spacecraft j told, whose believed position was the estimate.

        Args:
            j: Whose.
            fix: What it told.
            C_AN: Rotation from N to A.
            attitude: White error of the camera's attitude about each axis [rad]; None: that of the filter's noise.
        """
        H = np.zeros((len(fix.y), len(self.x)))
        own, shared = OWN * j, OWN * self.n
        H[:, own : own + 3] = fix.H @ C_AN
        H[:, own + 6 : own + 9] = fix.turn
        # A body that is turned otherwise by phi shows what it would from -phi x r elsewhere.
        turned = C_AN @ cross_matrix(self.x[own : own + 3])
        H[:, shared + 1 : shared + 4] = fix.H @ turned
        H[:, shared + 4] = fix.H @ turned @ self._axis_N * self.t
        # It was measured as if camera and body were turned as believed at first.
        others = H.copy()
        others[:, own : own + 3] = 0.0
        return self._use(
            fix.y - others @ self.x, H, fix.covariance(self.noise.attitude if attitude is None else attitude)
        )

    def use_range(self, i: int, j: int, measured: float, sigma: float) -> Update:
        """Use a range between two spacecraft [m], known to `sigma`."""
        between = self.x[OWN * j : OWN * j + 3] - self.x[OWN * i : OWN * i + 3]
        distance = float(np.linalg.norm(between))
        H = np.zeros((1, len(self.x)))
        H[0, OWN * j : OWN * j + 3] = between / distance
        H[0, OWN * i : OWN * i + 3] = -between / distance
        # To second order the distance is longer by x^T x / 2 d of what lies across: by its mean, and known as it varies.
        rows = self.S[OWN * j : OWN * j + 3] - self.S[OWN * i : OWN * i + 3]
        u = between / distance
        across = (rows - np.outer(u, u @ rows)) / np.sqrt(distance)
        spread = across @ across.T
        longer, more = 0.5 * float(np.trace(spread)), 0.5 * float(np.trace(spread @ spread))
        R = np.array([[sigma**2 + more]])
        return self._use(np.array([measured - distance - longer]), H, R, (SECOND_ORDER - 1.0) * more)

    def _use(self, y: Array, H: Array, R: Array, beyond: float = 0.0) -> Update:
        """Measurement update, unless it is a wild one; less is believed of it by a variance `beyond` what it errs by now."""
        keep, m = self._active, len(y)
        S = self.S[np.ix_(keep, keep)]
        HS = H[:, keep] @ S
        innovation = HS @ HS.T + R
        nis = float(y @ np.linalg.solve(innovation, y))
        if not nis < chdtri(m, GATE):
            return Update(nis, m, False)
        array = np.zeros((m + len(keep), m + len(keep)))
        array[:m, :m], array[:m, m:], array[m:, m:] = _root(R + beyond * np.eye(m)), HS, S
        triangle = _triangle(array)
        gain = triangle[m:, :m] @ np.linalg.solve(triangle[:m, :m], y)
        self.x[keep] += gain
        self.S[np.ix_(keep, keep)] = triangle[m:, m:]
        return Update(nis, m, True)

    def coast(self, t: float, pushes: Sequence[tuple[float, int, Array]] = ()) -> SwarmFilter:
        """A copy carried to a later time [s]: what is believed of then.

        Args:
            t: Later than the filter's own.
            pushes: Changes of position and velocity on the way, in order: time [s], spacecraft, and the change, shape (6,).
        """
        copy = object.__new__(SwarmFilter)
        copy.__dict__.update(self.__dict__)
        copy.x, copy.S = self.x.copy(), self.S.copy()
        for at, j, change_N in pushes:
            copy.advance(max(at, copy.t))
            copy.x[OWN * j : OWN * j + 6] += change_N
        copy.advance(t)
        return copy


def _triangle(wide: Array) -> Array:
    """Lower triangular root of wide wide^T."""
    upper: Array = np.linalg.qr(wide.T, mode="r")  # type: ignore[assignment]
    return upper.T


def _root(covariance: Array) -> Array:
    """A square root of a covariance that may be singular."""
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
