"""The most that an episode of SwarmObserve-v0 can bring: no policy does better, whatever it knows.

Paths do not depend on what spacecraft look at. So every cell of the target that some camera passes in light, within the limits
and with nothing in between could be seen, and counts as seen in the best of the pictures that are due; what is known of
slews, of pictures too small for the target, and of who takes which, is left out. Data count up to what Earth hears in the
time that is left from the first picture on, while somebody can talk to it.

Slews do not tighten it: the wheels' torque allows 60 deg in 9 s from rest, and a camera may still be turning as it takes its
picture, so that no time of a slew is certain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import kernel
from swarm_mj.observation.capture import keeps_limits, pixels_on
from swarm_mj.observation.horizon import look_at_cell, sight_of
from swarm_mj.observation.horizon_kernels import Scene
from swarm_mj.typing import Array, Ints, Mask

from ..observe.episodes import Episodes
from ..observe.layout import Observed
from .baselines import Flown, fly

#: Is told how far a long evaluation is.
Progress = Callable[[int], None]


class Path(NamedTuple):
    """Where n spacecraft are at the decisions of an episode.

    Attributes:
        t: Shape (T,) [s].
        r_N: Shape (T, n, 3) [m].
        v_N: Shape (T, n, 3) [m/s].
    """

    t: Array
    r_N: Array
    v_N: Array

    def at(self, t: Array) -> Array:
        """Places by Hermite's cubic between two decisions, straight on after the last, shape (len(t), n, 3) [m]."""
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 1)
        after = np.minimum(k + 1, len(self.t) - 1)
        step = np.where(after > k, self.t[after] - self.t[k], 1.0)[:, None, None]
        past = (t - self.t[k])[:, None, None]
        u = past / step
        a, b, va, vb = self.r_N[k], self.r_N[after], self.v_N[k], self.v_N[after]
        smooth = (2 * u**3 - 3 * u**2 + 1) * a + (u**3 - 2 * u**2 + u) * step * va
        smooth += (3 * u**2 - 2 * u**3) * b + (u**3 - u**2) * step * vb
        return np.asarray(np.where((after > k)[:, None, None], smooth, a + past * va))


def _paths(episodes: Episodes, seeds: Sequence[int]) -> list[Path]:
    """Fly episodes with everyone held as it is; where all were."""
    passed = [list[tuple[float, Array, Array]]() for _ in range(episodes.count)]

    def hold(observed: Observed) -> Ints:
        now = episodes.now
        for e, known in enumerate(passed):
            if not known or now.t[e] > known[-1][0]:
                known.append((float(now.t[e]), now.r[e].copy(), now.v[e].copy()))
        return np.tile(episodes.patches + 1 + np.arange(episodes.n), (episodes.count, 1))

    fly(episodes, hold, seeds)
    return [Path(*(np.array(part, np.float64) for part in zip(*known, strict=True))) for known in passed]


def bounds(episodes: Episodes, seeds: Sequence[int], progress: Progress | None = None) -> Flown:
    """The most of episodes of flight seeds, which are flown once for it, as many at once as `episodes` has room for.

    `progress` is called with the number of episodes that are done.
    """
    found = list[tuple[float, float]]()
    for start in range(0, len(seeds), episodes.count):
        some = seeds[start : start + episodes.count]
        # What fills up a short group is flown again and not counted.
        paths = _paths(episodes, [*some, *[some[0]] * (episodes.count - len(some))])
        for e in range(len(some)):
            found.append(_bound(episodes, e, paths[e]))
            if progress is not None:
                progress(len(found))
    seen, delivered = np.array(found).T
    return Flown(seen + delivered, seen, delivered)


def _bound(episodes: Episodes, e: int, path: Path) -> tuple[float, float]:
    mission, sheet, cells = episodes.mission_of(e), episodes.sheet, episodes.mission_of(e).plan.region.n_cells
    times = np.flatnonzero(mission.is_due).astype(np.float64) * mission.period_s
    fails = np.where(sheet.present[e, :, None], sheet.fails_s[e], 0.0)
    works = times[:, None] < fails[:, :2].min(axis=1)
    C_AN = np.array([mission.plan.environment.C_AN(t) for t in times])
    r_A = np.asarray(path.at(times) @ C_AN.swapaxes(1, 2))
    pixels, first = best_pixels(mission.scene, r_A, works, episodes.totals.target[e, :cells])
    found = np.isfinite(first)
    seen = float(mission.patches.cell_area[found].sum()) / float(sheet.yardstick_area[e])
    begins = times[int(first[found].min())] if found.any() else np.inf
    talks_s = max(0.0, min(mission.duration_s, float(fails[:, [0, 2]].min(axis=1).max())) - begins)
    bits = min(float(pixels.sum()) * mission.bits_per_pixel, mission.earth_bit_s * talks_s)
    return mission.weights.seen * seen, mission.weights.delivered * bits / float(sheet.yardstick_bit[e])


@kernel
def best_pixels(scene: Scene, r_A: Array, works: Mask, wanted: Mask) -> tuple[Array, Array]:
    """What the best picture of each cell holds of it, with the camera turned to it.

    Args:
        scene: Cells, limits, horizon maps, camera.
        r_A: Places at T pictures, shape (T, n, 3) [m].
        works: Whose camera works then, shape (T, n).
        wanted: Cells of interest, shape (C,).

    Returns:
        Pixels, 0 where no picture shows the cell, and the first picture that does, infinite for none, both of shape (C,).
    """
    cells, needed = scene.cells, scene.samples
    count = cells.shape[0]
    pixels, first = np.zeros(count), np.full(count, np.inf)
    answer: NDArray[Any] = np.empty(scene.horizon.points.shape[1], np.int8)
    C_CA = np.empty((3, 3))
    for t in range(r_A.shape[0]):
        for j in range(r_A.shape[1]):
            if not works[t, j]:
                continue
            for i in range(count):
                if not wanted[i]:
                    continue
                x, y, z = r_A[t, j, 0] - cells[i, 0], r_A[t, j, 1] - cells[i, 1], r_A[t, j, 2] - cells[i, 2]
                height = x * cells[i, 3] + y * cells[i, 4] + z * cells[i, 5]
                distance = np.sqrt(x * x + y * y + z * z)
                if height <= 0.0 or not keeps_limits(scene.limits, distance, height):
                    continue
                worth = pixels_on(scene.limits, cells[i, 7], distance, height)
                if worth <= pixels[i] and first[i] <= t:
                    continue
                _turn_to(-x / distance, -y / distance, -z / distance, C_CA)
                camera = sight_of(r_A[t, j], C_CA, scene.optics, scene.radius)
                shown, blocked = look_at_cell(scene.horizon, camera, i, needed, answer)
                # Inside the bounding sphere the maps may hide what is in view.
                if shown >= needed or (camera.inside and shown + blocked >= needed):
                    pixels[i], first[i] = max(pixels[i], worth), min(first[i], float(t))
    return pixels, first


@kernel
def _turn_to(x: float, y: float, z: float, C_CA: Array) -> None:
    """Axes of a camera that looks along a unit vector of A, with any roll."""
    flat = np.sqrt(x * x + y * y)
    right_x, right_y = (y / flat, -x / flat) if flat > 1e-9 else (1.0, 0.0)
    C_CA[0, 0], C_CA[0, 1], C_CA[0, 2] = right_x, right_y, 0.0
    C_CA[1, 0], C_CA[1, 1], C_CA[1, 2] = -z * right_y, z * right_x, x * right_y - y * right_x
    C_CA[2, 0], C_CA[2, 1], C_CA[2, 2] = x, y, z
