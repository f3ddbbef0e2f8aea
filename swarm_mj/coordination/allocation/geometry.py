"""From geometry to a problem: aims on a target, what pictures of them show, and the time that slews take.

What a picture shows is what counts in it by the observation criterion (`capture.cells_that_count`), seen from where the
spacecraft will be, with the camera pointed at the aim and following it. The angle about the line of sight is left open: give an
observer whose camera is the cone in its field of view, and what any angle shows is counted. A slew goes from rest to rest about
the eigenaxis with the largest acceleration and rate that the wheels give about the worst axis (`Agility`).
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.coordination.allocation.problem import AllocationProblem
from swarm_mj.errors import MissionError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import look_at
from swarm_mj.observation.capture import (
    ObservationCriterion,
    cells_that_count,
    keeps_limits,
    lit_cells,
    sight,
    visible_share,
)
from swarm_mj.observation.observer import Observer
from swarm_mj.observation.smear import CameraMotion, smear_px
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Ints, Mask

#: Least share of a patch's area that a picture must show to show the patch.
MOST_OF_IT = 0.9


class Patches(NamedTuple):
    """Cells of a target in groups, and where cameras aim.

    Attributes:
        of: The group of each cell, shape (cells,).
        aim_A: Mean of the cells' centroids by area, shape (m, 3) [m].
        area: Of each group, shape (m,) [m^2].
    """

    of: Ints
    aim_A: Array
    area: Array


class Track(NamedTuple):
    """Where everything will be in the middle of each slot.

    Attributes:
        r_A: Positions of the spacecraft in A, shape (k, a, 3) [m].
        v_A: Their velocities relative to A, in A, shape (k, a, 3) [m/s].
        C_AN: Rotations from N to A, shape (k, 3, 3).
        sun_A: Direction to the Sun in A, of any length, shape (k, 3).
    """

    r_A: Array
    v_A: Array
    C_AN: Array
    sun_A: Array


class Agility(NamedTuple):
    """How fast a spacecraft turns about any axis.

    Attributes:
        acceleration: Largest [rad/s^2].
        rate: Largest [rad/s].
        settle_s: Until the camera is still after a slew [s].
    """

    acceleration: float
    rate: float
    settle_s: float = 0.0

    def slew_s(self, angle: ArrayLike) -> Array:
        """Time of slews by angles [rad] from rest to rest, bang-bang, with a coast where the rate is reached [s]; none by 0."""
        turn = np.asarray(angle, np.float64)
        quick = turn * self.acceleration <= self.rate**2
        time = np.where(
            quick, 2.0 * np.sqrt(turn / self.acceleration), turn / self.rate + self.rate / self.acceleration
        )
        return np.asarray(np.where(turn > 0.0, time + self.settle_s, 0.0))


def agility_of(properties: SpacecraftProperties, *, settle_s: float = 0.0, share: float = 1.0) -> Agility:
    """How fast wheels turn a spacecraft about the axis that is worst for them, from wheels at rest.

    To accelerate by alpha about the unit axis e the wheels' torques are A^+ J e alpha, with spin axes A as columns; the largest
    over all e of the i-th is the norm of row i of A^+ J. The same holds of rates and the wheels' momenta.

    Args:
        properties: Of the spacecraft.
        settle_s: See `Agility`.
        share: Of torque and speed that is free for slews, above 0 to 1.
    """
    if not 0.0 < share <= 1.0:
        raise MissionError(f"share = {share}: must be above 0 and at most 1")
    needed = np.linalg.pinv(properties.wheel_axes_B.T) @ properties.inertia_effective_B
    worst = float(np.linalg.norm(needed, axis=1).max())
    momentum = properties.wheel_spin_inertia * properties.max_wheel_speed
    return Agility(share * properties.max_wheel_torque / worst, share * momentum / worst, settle_s)


def patches_of(region: TargetRegion, radius_m: float) -> Patches:
    """Group cells so that all centroids of a group lie within a radius [m] of one of them.

    Centres are chosen one after the other, from the cell nearest to the target's middle on, each the cell farthest from all
    before it (Gonzalez 1985, "Clustering to minimize the maximum intercluster distance"); every cell joins the nearest.

    Raises:
        MissionError: The radius is not positive.
    """
    if not radius_m > 0.0:
        raise MissionError(
            f"radius_m = {radius_m}: must be positive; half the width of a picture on the ground is a good one"
        )
    centroid, area = region.centroid_A, region.area
    middle = area @ centroid / area.sum()
    first = int(np.linalg.norm(centroid - middle, axis=1).argmin())
    of, distance = np.zeros(len(centroid), np.int64), np.linalg.norm(centroid - centroid[first], axis=1)
    groups = 1
    while distance.max() > radius_m:
        to_new = np.linalg.norm(centroid - centroid[int(distance.argmax())], axis=1)
        nearer = to_new < distance
        of[nearer], distance[nearer] = groups, to_new[nearer]
        groups += 1
    total = np.bincount(of, area, groups)
    aim = np.stack([np.bincount(of, area * x, groups) / total for x in centroid.T], axis=1)
    return Patches(of, aim, np.asarray(total, np.float64))


def encounter_problem(
    observer: Observer,
    criterion: ObservationCriterion,
    patches: Patches,
    track: Track,
    agility: Agility,
    *,
    slot_s: float,
    budget: ArrayLike,
    each_cell: bool = True,
) -> AllocationProblem:
    """The problem of an encounter.

    Args:
        observer: Looks at the target through the camera; `horizon` is the quick one.
        criterion: What counts.
        patches: Where cameras aim.
        track: Where everything will be, slot by slot.
        agility: How fast spacecraft turn.
        slot_s: From one slot to the next [s].
        budget: Most pictures of each, a number or shape (a,).
        each_cell: Whether cells have their areas as weights, one by one; otherwise whole patches, shown by pictures that show
            at least `MOST_OF_IT` of those of their cells that any picture shows.
    """
    cells = shown_cells(observer, criterion, patches, track)
    shows, weight = cells, observer.region.area
    if not each_cell:
        shows, weight = _by_patch(cells, patches, observer.region.area)
    return AllocationProblem(
        weight=weight,
        shows=shows,
        slew=slew_slots(patches, track, agility, slot_s, np.asarray(cells.any(axis=3))),
        budget=np.broadcast_to(np.asarray(budget, np.int64), len(cells)),
    )


def shown_cells(observer: Observer, criterion: ObservationCriterion, patches: Patches, track: Track) -> Mask:
    """Whether agent a's picture of aim m in slot k shows a cell, as the criterion has it, shape (a, m, k, cells)."""
    (slots, agents, _), region = track.r_A.shape, observer.region
    limits = criterion.limits(observer.camera)
    shows = np.zeros((agents, len(patches.aim_A), slots, region.n_cells), np.bool_)
    for k in range(slots):
        light = lit_cells(observer, criterion, track.sun_A[k]) if criterion.needs_sun else np.ones(region.n_cells, bool)
        for a in range(agents):
            r_A = track.r_A[k, a]
            possible = keeps_limits(limits, *sight(region, r_A)) & light
            for m in np.flatnonzero(np.bincount(patches.of, possible, len(patches.aim_A))):
                C_CA = look_at(r_A, patches.aim_A[m]).C_CA
                motion = following(patches.aim_A[m] - r_A, track.v_A[k, a], C_CA)
                shows[a, m, k] = cells_that_count(
                    observer,
                    criterion,
                    r_A,
                    partial(np.asarray, light),
                    partial(visible_share, observer, r_A, C_CA, whole=criterion.whole),
                    partial(smear_px, region, observer.camera, r_A, C_CA, motion),
                )
    return shows


def following(to_aim_A: Array, v_A: Array, C_CA: Array) -> CameraMotion:
    """The motion of a camera that keeps an aim in the middle of its picture and does not turn about the line of sight.

    Args:
        to_aim_A: From the camera to the aim, which is fixed in A, shape (3,) [m].
        v_A: Velocity of the camera relative to A, shape (3,) [m/s].
        C_CA: Rotation from A to the camera frame, shape (3, 3).
    """
    return CameraMotion(v_A, C_CA @ np.cross(to_aim_A, -v_A) / (to_aim_A @ to_aim_A))


def _by_patch(cells: Mask, patches: Patches, area: Array) -> tuple[Mask, Array]:
    """What shows whole patches, shape (a, m, k, m), and the area of each that any picture shows, shape (m,)."""
    ever = area * cells.any(axis=(0, 1, 2))
    member = np.zeros((len(area), len(patches.aim_A)))
    member[np.arange(len(area)), patches.of] = ever
    weight = member.sum(axis=0)
    return np.asarray((cells @ member >= MOST_OF_IT * weight) & (weight > 0.0)), weight


def slew_slots(patches: Patches, track: Track, agility: Agility, slot_s: float, usable: Mask) -> Ints:
    """Least number of slots from a picture of one aim to one of another, whenever both can be taken, shape (a, m, m).

    Between pictures of the same aim the camera follows it, which takes no slew.

    Args:
        patches: The aims.
        track: Where everything will be.
        agility: How fast spacecraft turn.
        slot_s: From one slot to the next [s].
        usable: Whether an agent's picture of an aim in a slot is of any use, shape (a, m, k).

    Raises:
        MissionError: The slots have no length.
    """
    if not slot_s > 0.0:
        raise MissionError(f"slot_s = {slot_s}: must be positive")
    slots = len(track.r_A)
    to_aim = patches.aim_A[:, None, None, :] - track.r_A[None]  # (m, k, a, 3)
    ahead_N = np.einsum("kji,mkaj->amki", track.C_AN, to_aim)
    ahead_N /= np.linalg.norm(ahead_N, axis=3, keepdims=True)
    needed = np.ones((len(ahead_N), len(to_aim), len(to_aim)), np.int64)
    same = np.eye(len(to_aim), dtype=np.bool_)[..., None]
    for agent, ahead in enumerate(ahead_N):
        for d in range(1, slots):
            cosine = np.einsum("pki,qki->pqk", ahead[:, :-d], ahead[:, d:])
            both = usable[agent][:, None, :-d] & usable[agent][None, :, d:]
            angle, free_s = np.arccos(np.clip(cosine, -1.0, 1.0)), d * slot_s
            late = np.where(same, angle > agility.rate * free_s, agility.slew_s(angle) > free_s) & both
            needed[agent][late.any(axis=2)] = d + 1
    return needed
