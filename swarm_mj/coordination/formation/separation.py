"""Proof of separation: a move is allowed only if all could still stop after it without coming too close.

Let x_i'' = w_i be the motion relative to a point that is accelerated as the swarm is (differential gravity is cancelled by
thrust). To stop is to brake with a_b along one's own velocity until at rest, then to stay. A swarm is *stoppable* if, all
braking from now on, no guarded pair ever comes closer than d_min.

Theorem. Let the swarm be stoppable at the start, let every spacecraft be able to give a_b beyond differential gravity, and let
each period's accelerations either be ones after which the swarm is stoppable, with no pair closer than d_min on the way, or
braking. Then no guarded pair is ever closer than d_min.
Proof. By induction over periods. If the swarm is stoppable at t_k and moves as allowed, no pair is too close until t_(k+1), and
it is stoppable there. If all brake instead, they fly the first period of the stop that was found clear at t_k; what follows is
the rest of the same stop, so it is clear. A group may brake while others move: this is checked as any other move. `safe_moves`
adds those of every violated pair to the group that brakes until the check holds, at the latest when all brake. QED.

The stop that is checked is the one that is flown, in whole control periods: a_b for all but the last, which takes the rest of
the speed. Distances are bounded from below: between samples the relative path departs from its chord by at most
(|w_i| + |w_j|) h^2 / 8. The theorem holds for those that work and have propellant; others are counted as coasting for as long
as their partner takes to stop. Cf. Fraichard and Asama (2004, Advanced Robotics 18, 1001) on inevitable collision states, and
Gurriet, Mote, Singletary, Nilsson, Feron and Ames (2020, IEEE Access 8) on backup sets.

Control barrier functions of pairs: the wished accelerations, changed as little as keeps every pair able to brake in time.

For the distance d of a pair and A = a_i + a_j, the accelerations that both set aside for braking,

    h = sqrt(2 A (d - d_min)) + d'

is not negative exactly if relative braking with A along the line between them stops the approach before d_min. Where
h' >= -c h, h stays not negative and d never falls below d_min (Borrmann, Wang, Ames and Egerstedt 2015, IFAC-PapersOnLine
48-27, 68; higher order: Xiao and Belta 2019). As d'' = e (w_j - w_i) + |v_across|^2 / d with e along the line, this is a half
space for the accelerations:

    e (w_j - w_i) >= -c h - A d' / sqrt(2 A (d - d_min)) - |v_across|^2 / d.

While h >= 0 the right side is at most A, so a pair alone always has a solution within its thrust: braking along the line. With
more pairs the half spaces may exclude each other, and accelerations are held for a period; therefore what comes out here is
only a proposal, which `safe_moves` holds to its proof. The nearest point of the half spaces and of the balls of what
thrusters give is found by Dykstra's alternating projections (Boyle and Dykstra 1986).
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.coordination.formation.tracking import cut
from swarm_mj.typing import Array, Ints, Mask

#: Instants at which a stop is checked.
SAMPLES = 48
#: Rounds of projections: it ends when nothing moves more than this share of what thrusters give.
ROUNDS, STILL = 60, 1e-4
#: c h: how fast the reserve may be used up [1/s].
DECAY = 0.1
#: Share of the thrust with which those that are in each other's way also swerve, all to the same side: head-on they would stop.
SWERVE = 0.3
#: The barrier stands so much farther out than the proof's distance, so that who has been stopped there is led out again.
FARTHER = 1.1
#: Distances above d_min count as so much at least, for the square root in the denominator [m].
LEAST_GAP = 1e-3


class Moves(NamedTuple):
    """Relative motion of n spacecraft, and what each can do."""

    r: Array  #: places, shape (n, 3) [m]
    v: Array  #: velocities, shape (n, 3) [m/s]
    braking: Array  #: acceleration with which each stops, 0 for one that cannot, shape (n,) [m/s^2]
    period: float  #: for which accelerations are held [s]
    distance: float  #: that no pair may go below [m]

    def after(self, w: Array) -> Moves:
        """The same a period later, shape of w (n, 3) [m/s^2]."""
        T = self.period
        return self._replace(r=self.r + T * self.v + 0.5 * T * T * w, v=self.v + T * w)

    def stopping(self) -> Array:
        """What braking accelerations are, shape (n, 3) [m/s^2]; zeros for those that cannot."""
        speed = np.linalg.norm(self.v, axis=1)
        size = np.minimum(self.braking, speed / self.period)
        share = np.divide(size, speed, out=np.zeros_like(speed), where=speed > 0.0)
        return -self.v * share[:, None]

    def stop_time(self) -> Array:
        """Until each is at rest, in whole periods, shape (n,) [s]; 0 for those that cannot stop."""
        speed, able = np.linalg.norm(self.v, axis=1), self.braking > 0.0
        steps = np.divide(speed, self.braking * self.period, out=np.zeros_like(speed), where=able)
        return np.asarray(np.ceil(steps - 1e-12) * self.period)


@kernel
def stopping_path(moves: Moves, who: Ints, t: Array) -> Array:
    """Where they are after so long while they stop as they fly it; those that cannot coast on.

    Args:
        moves: All.
        who: Numbers, shape (k,).
        t: Times, shape (k, m) [s].

    Returns:
        Places, shape (k, m, 3) [m].
    """
    T, r_t = moves.period, np.empty((*t.shape, 3))
    for n in range(len(who)):
        r, v, braking = moves.r[who[n]], moves.v[who[n]], moves.braking[who[n]]
        speed = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        full = np.floor(speed / braking / T + 1e-12) if braking > 0.0 else np.inf
        rest = speed - full * braking * T if braking > 0.0 else 0.0
        for k in range(t.shape[1]):
            early = min(t[n, k], full * T)
            late = min(max(t[n, k] - early, 0.0), T)
            gone = speed * early - 0.5 * braking * early**2 + rest * late - 0.5 * rest / T * late**2
            share = gone / speed if speed > 0.0 else 0.0
            for axis in range(3):
                r_t[n, k, axis] = r[axis] + share * v[axis]
    return r_t


def least_on_stop(moves: Moves, pairs: Ints) -> Array:
    """A lower bound of the distance of pairs, shape (p, 2), while both stop, shape (p,) [m]."""
    if not len(pairs):
        return np.empty(0)
    until = moves.stop_time()[pairs].max(axis=1)
    t = until[:, None] * np.linspace(0.0, 1.0, SAMPLES + 1)
    first, second = (stopping_path(moves, pairs[:, k], t) for k in (0, 1))
    bend = moves.braking[pairs].sum(axis=1) * (until / SAMPLES) ** 2 / 8.0
    return np.asarray(least_of_chords(second - first) - bend)


@kernel
def least_of_chords(relative: Array) -> Array:
    """Least distance from the origin of polygons, shape (p,), of corners (p, m, 3) [m]."""
    least = np.full(len(relative), np.inf)
    for n in range(len(relative)):
        for k in range(relative.shape[1] - 1):
            start, end = relative[n, k], relative[n, k + 1]
            square = along = 0.0
            for axis in range(3):
                step = end[axis] - start[axis]
                square += step * step
                along -= start[axis] * step
            share = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
            distance = 0.0
            for axis in range(3):
                distance += (start[axis] + share * (end[axis] - start[axis])) ** 2
            least[n] = min(least[n], np.sqrt(distance))
    return least


def all_pairs(n: int) -> Ints:
    """Shape (p, 2)."""
    return np.array(list(combinations(range(n), 2)), np.int64).reshape(-1, 2)


@kernel
def may_meet(moves: Moves, later: Moves, stop_s: Array, w: Array, pairs: Ints) -> Mask:
    """Which pairs are near enough for a closer look: those that the motion of each along the line may bring too close, (p,).

    On the line from one to the other nobody comes nearer than by its velocity along it, for the period and for the whole
    stop, and by what the period's acceleration adds.

    Args:
        moves: All, now.
        later: A period later.
        stop_s: Until each is then at rest, shape (n,) [s].
        w: Accelerations in the period, shape (n, 3) [m/s^2].
        pairs: Shape (p, 2).
    """
    T, found = moves.period, np.zeros(len(pairs), np.bool_)
    for p in range(len(pairs)):
        line = moves.r[pairs[p, 1]] - moves.r[pairs[p, 0]]
        apart = np.sqrt(line[0] * line[0] + line[1] * line[1] + line[2] * line[2])
        left = apart
        for side in range(2):
            i, sign = pairs[p, side], 1.0 - 2.0 * side
            now = soon = pushed = 0.0
            for axis in range(3):
                along = sign * line[axis] / apart if apart > 0.0 else 0.0
                now += along * moves.v[i, axis]
                soon += along * later.v[i, axis]
                pushed += w[i, axis] ** 2
            left -= max(now, 0.0) * T + max(soon, 0.0) * stop_s[i] + np.sqrt(pushed) * T * T
            found[p] |= moves.braking[i] == 0.0
        found[p] |= left < moves.distance
    return found


def too_close_after(moves: Moves, w: Array, pairs: Ints) -> Mask:
    """Which pairs come too close in a period of these accelerations, or in the stop that would follow, shape (p,)."""
    later, T = moves.after(w), moves.period
    bad = np.zeros(len(pairs), np.bool_)
    near = np.flatnonzero(may_meet(moves, later, later.stop_time(), w, pairs))
    if len(near):
        first, second = pairs[near].T
        ends = np.stack([m.r[second] - m.r[first] for m in (moves, later)], axis=1)
        bend = np.linalg.norm(w[second] - w[first], axis=1) * T * T / 8.0
        bad[near] = np.minimum(least_of_chords(ends) - bend, least_on_stop(later, pairs[near])) < moves.distance
    return bad


def safe_moves(moves: Moves, wish: Array, pairs: Ints) -> tuple[Array, Mask]:
    """Accelerations that keep the theorem's condition: those wished, and braking for as few as are found to need it.

    Args:
        moves: All.
        wish: Accelerations, none above what thrusters give, shape (n, 3) [m/s^2].
        pairs: That are guarded, shape (p, 2).

    Returns:
        Accelerations, shape (n, 3) [m/s^2], and who brakes, shape (n,).
    """
    brake, able, w = np.zeros(len(wish), np.bool_), moves.braking > 0.0, wish
    for _ in range(len(wish)):
        close = too_close_after(moves, w, pairs)
        if not close.any():
            break
        bad = pairs[close]
        group = np.isin(np.arange(len(wish)), bad) & able & ~brake
        if not group.any():
            break
        brake |= group
        w = np.where(brake[:, None], moves.stopping(), wish)
    return w, brake


def half_spaces(moves: Moves, pairs: Ints) -> tuple[Array, Array]:
    """Directions e and bounds b of e (w_j - w_i) >= b, shapes (p, 3) and (p,) [m/s^2]."""
    relative = moves.r[pairs[:, 1]] - moves.r[pairs[:, 0]]
    velocity = moves.v[pairs[:, 1]] - moves.v[pairs[:, 0]]
    d = np.linalg.norm(relative, axis=1)
    e = relative / np.maximum(d, LEAST_GAP)[:, None]
    rate = np.einsum("pi,pi->p", e, velocity)
    across = np.einsum("pi,pi->p", velocity, velocity) - rate**2
    A = moves.braking[pairs].sum(axis=1)
    root = np.sqrt(2.0 * A * np.maximum(d - moves.distance, LEAST_GAP))
    h = root + rate
    bound = -DECAY * h - np.divide(A * rate, root, out=np.zeros_like(root), where=root > 0.0)
    # Outside of h >= 0 nothing is proven any more; as much as can be is asked for.
    return e, np.minimum(bound - across / np.maximum(d, LEAST_GAP), A)


def nearest_allowed(moves: Moves, wish: Array, most: Array, pairs: Ints) -> Array:
    """The accelerations nearest to those wished that obey all pairs' half spaces and limits, shape (n, 3) [m/s^2].

    Where there are none, near to all of them.

    Args:
        moves: All.
        wish: Shape (n, 3) [m/s^2].
        most: What thrusters give beside differential gravity, shape (n,) [m/s^2].
        pairs: That are guarded, shape (p, 2).
    """
    e, bound = half_spaces(moves._replace(distance=FARTHER * moves.distance), pairs)
    able = (most > 0.0).astype(np.float64)
    share = able[pairs]
    tight = (np.einsum("pi,pi->p", e, wish[pairs[:, 1]] - wish[pairs[:, 0]]) < bound) & (share.sum(axis=1) > 0.0)
    if not tight.any():
        return wish
    wish = cut(swerved(wish, SWERVE * most, e, pairs, tight), np.where(most > 0.0, most, np.inf))
    # Of pairs far apart any accelerations do.
    reach = np.maximum(most, np.linalg.norm(wish, axis=1))[pairs].sum(axis=1)
    busy = np.flatnonzero((share.sum(axis=1) > 0.0) & (bound > -reach))
    w, tolerance = wish.copy(), STILL * float(most.max())
    pushed, trimmed = np.zeros(len(pairs)), np.zeros_like(w)
    for _ in range(ROUNDS):
        before = w.copy()
        for p in busy:
            i, j = pairs[p]
            parts = share[p].sum()
            # Dykstra: undo this half space's last push, then push as far as is needed now.
            need = bound[p] - (e[p] @ (w[j] - w[i]) - pushed[p] * parts)
            now = max(need / parts, 0.0)
            w[i] -= share[p, 0] * (now - pushed[p]) * e[p]
            w[j] += share[p, 1] * (now - pushed[p]) * e[p]
            pushed[p] = now
        free = w + trimmed
        w = np.where(able[:, None] > 0.0, cut(free, most), wish)
        trimmed = free - w
        if np.abs(w - before).max() <= tolerance:
            break
    return w


def swerved(wish: Array, push: Array, e: Array, pairs: Ints, tight: Mask) -> Array:
    """Wishes with a push across the line to those that are in the way, so that the pair turns about its middle, (n, 3) [m/s^2].

    Args:
        wish: Shape (n, 3) [m/s^2].
        push: How much each adds, shape (n,) [m/s^2].
        e: Along the lines, shape (p, 3).
        pairs: Shape (p, 2).
        tight: Which are in each other's way, shape (p,).
    """
    up = np.where(np.abs(e[:, 2:]) < 0.9, np.eye(3)[2], np.eye(3)[0])
    side = np.cross(up, e)
    side = np.where(tight[:, None], side / np.linalg.norm(side, axis=1, keepdims=True), 0.0)
    added = np.zeros_like(wish)
    np.subtract.at(added, pairs[:, 0], side)
    np.add.at(added, pairs[:, 1], side)
    return np.asarray(wish + push[:, None] * added)
