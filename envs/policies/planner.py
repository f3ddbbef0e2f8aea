"""A planner for SwarmObserve-v0: who looks at which patch at which decision, planned ahead and planned anew as things turn out.

From where the spacecraft are and how they fly it works out what a picture of each patch would show at every decision to come,
cell by cell, and allots pictures as `swarm_mj.coordination.allocation` does: cells are its patches, patches its aims, decisions
its slots. A cell is worth its area and its data; what only a near picture brings of the data is a weight of its own. Who has no
picture to take for some time sends. It knows what the flight software knows: the target, the coverage and who works now; not
what will fail.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import kernel
from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.coordination.allocation.optimum import optimum
from swarm_mj.coordination.allocation.problem import Allocation, AllocationProblem, Schedule
from swarm_mj.observation.capture import keeps_limits, pixels_on
from swarm_mj.observation.horizon import look_at_cell, sight_of
from swarm_mj.observation.horizon_kernels import Scene
from swarm_mj.typing import Array, Array32, Ints, Mask

from ..observe.episodes import Episodes
from ..observe.layout import Observed

#: Decisions from one plan to the next, where nothing fails in between.
EVERY = 3
#: Share of the most pixels that any picture to come has of a cell, from which on a picture counts as a near one.
NEAR = 0.85
#: Turns that take a decision more each [deg]: attitude errors fall to a third in 10 s, and large ones at 6 deg/s. These, `NEAR`
#: and `EVERY` are the best of some that were tried on flight seeds 0 to 319 of all missions of `train`.
TURNS_DEG, FIRST_TURNS_DEG = (40.0, 80.0), (40.0, 80.0, 130.0)
#: Decisions without a picture from which on a spacecraft turns to send; to Earth and back takes as many.
PAUSE = 6
#: No cell further than this from the line of sight is in a picture; the cosine.
ASIDE = 0.85


@dataclass
class PicturePlan:
    """Of one episode.

    Attributes:
        seed: Of the flight.
        works: Whose camera worked, shape (n,).
        made: Decision at which it was made.
        pictures: Of each spacecraft pairs (decision, patch).
        aims: What each does now.
        watching: Who was to take a picture, which is taken at the end of the decision, shape (n,).
    """

    seed: int
    works: Mask
    made: int
    pictures: tuple[Schedule, ...]
    aims: Ints
    watching: Mask


@dataclass
class Planner:
    """A policy that plans; for the episodes it is made for, whose state it reads.

    Args:
        episodes: Which it flies.
        prove_s: Time for the proof of the plan that an episode begins with [s]; None: no proof, and plans are made quickly.

    Attributes:
        first: Plans that episodes began with, with their bounds.
    """

    episodes: Episodes
    prove_s: float | None = None
    first: list[Allocation] = field(default_factory=list)
    _plans: dict[int, PicturePlan] = field(default_factory=dict)

    def __call__(self, observed: Observed) -> Ints:
        """Choices, shape (E, n)."""
        return np.array([self._choose(e) for e in range(self.episodes.count)])

    def _choose(self, e: int) -> Ints:
        episodes = self.episodes
        mission = episodes.mission_of(e)
        step = int(episodes.flights.tick[e]) // mission.ticks
        hold = episodes.patches + 1 + np.arange(episodes.n)
        if step * mission.ticks >= mission.last_tick:
            return hold
        plan = self._plan(e, step)
        choice = hold.copy()
        for j in np.flatnonzero(~episodes.totals.lost[e]):
            choice[j] = self._task_of(int(j), plan, e, step)
        plan.aims = choice
        return choice

    def _plan(self, e: int, step: int) -> PicturePlan:
        """The plan of an episode, made anew where it is old or wrong."""
        draw, works = self.episodes.draws[e], working(self.episodes, e)
        assert draw is not None
        plan = self._plans.get(e)
        if plan is None or step == 0 or plan.seed != draw.seed or plan.made > step:
            n = self.episodes.n
            plan = PicturePlan(draw.seed, works, step, ((),) * n, np.zeros(n, np.int64), np.zeros(n, np.bool_))
        else:
            left = any(s >= step for taken in plan.pictures for s, _ in taken)
            if (works == plan.works).all() and (step - plan.made < EVERY or not left):
                return plan
        problem = problem_of(self.episodes, e, step)
        if problem is not None and step == 0 and self.prove_s is not None:
            self.first.append(optimum(problem, self.prove_s))
        pictures = ((),) * self.episodes.n if problem is None else greedy(problem).pictures
        plan.pictures = tuple(tuple((s + step, patch) for s, patch in taken) for taken in pictures)
        plan.works, plan.made = works, step
        self._plans[e] = plan
        return plan

    def _task_of(self, j: int, plan: PicturePlan, e: int, step: int) -> int:
        """What spacecraft j does now: its picture, what leads to the next one, or to send what it has."""
        patches = self.episodes.patches
        ahead = [(s, patch) for s, patch in plan.pictures[j] if s >= step] if plan.works[j] else []
        pause = ahead[0][0] - step if ahead else PAUSE + 1
        was_watching, plan.watching[j] = plan.watching[j], pause == 0
        if ahead and (pause <= PAUSE or was_watching):
            return ahead[0][1]
        if was_watching:  # the picture is taken as this decision begins, by who goes on to look
            return int(plan.aims[j])
        totals = self.episodes.totals
        hears = self.episodes.sheet.downlink[e] & ~totals.lost[e]
        if totals.stored[e, j] > 0.0 and hears.any():
            return patches if hears[j] else patches + 1 + int(hears.argmax())
        return ahead[0][1] if ahead else patches + 1 + j


def working(episodes: Episodes, e: int) -> Mask:
    """Whose camera works now in episode e, shape (n,)."""
    return np.asarray(~episodes.totals.lost[e] & ~episodes.tracking.blind[e])


class Ahead(NamedTuple):
    """What pictures to come would show.

    Attributes:
        r_A: Places at the pictures, shape (S, n, 3) [m].
        C_CA: Attitudes of the cameras now, shape (n, 3, 3).
        pixels: Of each cell in the picture that a spacecraft takes at the end of a decision of a patch, shape (n, S, K, C).
    """

    r_A: Array
    C_CA: Array
    pixels: Array32


def problem_of(episodes: Episodes, e: int, step: int) -> AllocationProblem | None:
    """Pictures to come as a problem of allocation, its weights in units of the score; None where nothing is in reach."""
    mission = episodes.mission_of(e)
    seen_from = pictures_to_come(episodes, e, step)
    if seen_from is None:
        return None
    pixels, most = seen_from.pixels, seen_from.pixels.max(axis=(0, 1, 2))
    cells = np.flatnonzero(most > 0.0)
    pixels, most = pixels[..., cells], most[cells]
    least = np.minimum(np.where(pixels > 0.0, pixels, np.inf).min(axis=(0, 1, 2)), NEAR * most)
    yardstick = float(episodes.sheet.yardstick_area[e])
    bits = mission.bits_per_pixel / float(episodes.sheet.yardstick_bit[e])
    # A picture from far brings area and few data, a near one the rest.
    weight = np.concatenate([mission.patches.cell_area[cells] / yardstick + bits * least, bits * (NEAR * most - least)])
    shows = np.concatenate([pixels > 0.0, pixels >= NEAR * most], axis=3).transpose(0, 2, 1, 3)
    n, _, slots, _ = shows.shape
    aims, middle = mission.patches.centre_A, mission.centre_A
    slew = np.empty((n, len(aims), len(aims)), np.int64)
    for j in range(n):
        nearest = int(np.linalg.norm(seen_from.r_A[:, j] - middle, axis=1).argmin())
        toward = _unit(aims - seen_from.r_A[nearest, j])
        slew[j] = 1 + _beyond(toward @ toward.T, TURNS_DEG).sum(axis=0)
        first = _beyond(_unit(aims - episodes.now.r_A[e, j]) @ seen_from.C_CA[j, 2], FIRST_TURNS_DEG)
        for s in range(min(slots, len(FIRST_TURNS_DEG))):
            shows[j, first[s], s] = False
    available = np.repeat(working(episodes, e)[:, None], slots, axis=1)
    return AllocationProblem(weight=weight, shows=shows, slew=slew, budget=np.full(n, slots), available=available)


def pictures_to_come(episodes: Episodes, e: int, step: int) -> Ahead | None:
    """What pictures of episode e at the ends of this and later decisions would show; None where nothing is in reach."""
    mission, now = episodes.mission_of(e), episodes.now
    slots = mission.last_tick // mission.ticks - step
    later = mission.step_s * np.arange(1.0, slots + 1.0)
    # Straight on: gravity bends the ways by less than the planner is planned anew.
    r_N = now.r[e] + later[:, None, None] * now.v[e]
    C_AN = np.array([mission.plan.environment.C_AN(float(now.t[e]) + after) for after in later])
    r_A = np.einsum("tab,tjb->tja", C_AN, r_N)
    works, scene = working(episodes, e), mission.scene
    assert scene is not None, "missions are judged by their maps"
    farthest = scene.limits.max_gsd / scene.limits.pixel_angle + scene.radius
    near = np.flatnonzero(((np.linalg.norm(r_A, axis=2) <= farthest) & works).any(axis=1))
    if not len(near):
        return None
    r_A = np.ascontiguousarray(r_A[: near[-1] + 1])
    C_CA = np.ascontiguousarray(episodes.estimate.C_BN[e] @ now.C_AN[e].T)
    aims, totals, cells = mission.patches.centre_A, episodes.totals, mission.plan.region.n_cells
    wanted = (totals.target[e] & ~totals.seen[e])[:cells]
    pixels = np.zeros((len(C_CA), len(r_A), len(aims), len(scene.cells)), np.float32)
    count_pixels(scene, r_A, C_CA, aims, works, wanted, pixels)
    return Ahead(r_A, C_CA, pixels) if pixels.any() else None


def _unit(rows: Array) -> Array:
    return np.asarray(rows / np.linalg.norm(rows, axis=-1, keepdims=True))


def _beyond(cosine: Array, limits_deg: tuple[float, ...]) -> Mask:
    """Where an angle is beyond each limit, shape (limits, ...)."""
    return np.array([cosine < np.cos(np.radians(limit)) for limit in limits_deg])


@kernel
def count_pixels(
    scene: Scene, r_A: Array, C_CA: Array, aims: Array, works: Mask, wanted: Mask, pixels: Array32
) -> None:
    """Fill in how many pixels pictures have of cells.

    Args:
        scene: Cells, limits, horizon maps, camera.
        r_A: Places, shape (S, n, 3) [m].
        C_CA: Attitudes that cameras turn from by the shortest way, shape (n, 3, 3).
        aims: What they turn to, shape (K, 3) [m].
        works: Whose camera works, shape (n,).
        wanted: Cells of interest, shape (C,).
        pixels: Receives them, 0 where a picture does not show a cell, shape (n, S, K, C).
    """
    answer: NDArray[Any] = np.empty(scene.horizon.points.shape[1], np.int8)
    n, slots, patches, count = pixels.shape
    turned, toward = np.empty((patches, 3, 3)), np.empty((patches, 3))
    for j in range(n):
        if not works[j]:
            continue
        for s in range(slots):
            place = r_A[s, j]
            for k in range(patches):
                way = aims[k] - place
                toward[k] = way / np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
                turn_toward(C_CA[j], toward[k], turned[k])
            for i in range(count):
                x, y, z = place[0] - scene.cells[i, 0], place[1] - scene.cells[i, 1], place[2] - scene.cells[i, 2]
                height = x * scene.cells[i, 3] + y * scene.cells[i, 4] + z * scene.cells[i, 5]
                distance = np.sqrt(x * x + y * y + z * z)
                if not wanted[i] or height <= 0.0 or not keeps_limits(scene.limits, distance, height):
                    continue
                for k in range(patches):
                    if toward[k, 0] * x + toward[k, 1] * y + toward[k, 2] * z > -ASIDE * distance:
                        continue
                    camera = sight_of(place, turned[k], scene.optics, scene.radius)
                    shown, _ = look_at_cell(scene.horizon, camera, i, scene.samples, answer)
                    if shown >= scene.samples:
                        pixels[j, s, k, i] = pixels_on(scene.limits, scene.cells[i, 7], distance, height)


@kernel
def turn_toward(C: Array, aim: Array, out: Array) -> None:
    """Attitude after the shortest turn that brings the third axis of one along a unit vector; all of shape (3, 3)."""
    a, b, c = C[2, 0], C[2, 1], C[2, 2]
    cosine = max(a * aim[0] + b * aim[1] + c * aim[2], -1.0 + 1e-9)
    x, y, z = b * aim[2] - c * aim[1], c * aim[0] - a * aim[2], a * aim[1] - b * aim[0]
    for k in range(3):
        p, q, r = C[k, 0], C[k, 1], C[k, 2]
        # Rodrigues' formula with the axis not normalised: its length is the sine.
        along = (x * p + y * q + z * r) / (1.0 + cosine)
        out[k, 0] = cosine * p + (y * r - z * q) + along * x
        out[k, 1] = cosine * q + (z * p - x * r) + along * y
        out[k, 2] = cosine * r + (x * q - y * p) + along * z
