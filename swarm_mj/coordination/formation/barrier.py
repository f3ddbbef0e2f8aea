"""Control barrier functions of pairs: the wished accelerations, changed as little as keeps every pair able to brake in time.

For the distance d of a pair and A = a_i + a_j, the accelerations that both set aside for braking,

    h = sqrt(2 A (d - d_min)) + d'

is not negative exactly if relative braking with A along the line between them stops the approach before d_min. Where
h' >= -c h, h stays not negative and d never falls below d_min (Borrmann, Wang, Ames and Egerstedt 2015, IFAC-PapersOnLine
48-27, 68; higher order: Xiao and Belta 2019). As d'' = e (w_j - w_i) + |v_across|^2 / d with e along the line, this is a half
space for the accelerations:

    e (w_j - w_i) >= -c h - A d' / sqrt(2 A (d - d_min)) - |v_across|^2 / d.

While h >= 0 the right side is at most A, so a pair alone always has a solution within its thrust: braking along the line. With
more pairs the half spaces may exclude each other, and accelerations are held for a period; therefore what comes out here is
only a proposal, which `separation.safe_moves` holds to its proof. The nearest point of the half spaces and of the balls of what
thrusters give is found by Dykstra's alternating projections (Boyle and Dykstra 1986).
"""

from __future__ import annotations

import numpy as np

from swarm_mj.coordination.formation.separation import Moves
from swarm_mj.coordination.formation.tracking import cut
from swarm_mj.typing import Array, Ints, Mask

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
