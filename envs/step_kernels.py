"""What an episode does between two steps, compiled, flight by flight: radio, dangers, readings.

Nothing depends on how many flights are handled together, so that each comes out bit for bit as if it were alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import write_closed
from swarm_mj.observation.capture import takes_picture
from swarm_mj.observation.horizon_kernels import Scene, new_cells
from swarm_mj.smallbody.occultation import way_blocked
from swarm_mj.spacecraft.attitude.algebra import quaternion, relative_dcm
from swarm_mj.typing import Array, Array32, Ints, Ints32, Mask, kernel

from .kinematics import Known, Now, write_dcm

_SPACECRAFT, _EARTH = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH)

#: Wheel speed over its limit from which on saturation costs.
SATURATION_FROM = 0.9
#: Numbers for each spacecraft in an observation, besides its wheel speeds.
FEATURES_BUT_WHEELS = 26
#: The same with the usual three wheels.
FEATURES = FEATURES_BUT_WHEELS + 3
#: Body rates are divided by this [rad/s].
RATE_SCALE = 0.1


class Mission(NamedTuple):
    """What all flights share.

    Attributes:
        vertices: The body's mesh in A, shape (V, 3) [m].
        faces: Shape (F, 3).
        box: Least and largest coordinates of the mesh, shape (2, 3) [m].
        antennas: See `Antennas.numbers`.
        numbers: Largest vertex radius [m], rates to a spacecraft and to Earth [bit/s], bits per pixel, least separation [m],
            grace time [s], top wheel speed [rad/s], scales of position [m] and velocity [m/s], spin rate [rad/s], duration of
            the flight [s], nominal volume [bit], area of the target [m^2], number of observers, shape (14,).
        earth: Position [m] and velocity [m/s] of Earth in N at the epoch, shape (2, 3).
        C_PN: Rotation from N to the pole frame.
        phase0: Prime meridian angle at the epoch [rad].
        patch: Patch of each cell, shape (C,).
        cell_area: Shape (C,) [m^2].
        patch_area: Shape (K,) [m^2].
    """

    vertices: Array
    faces: Ints32
    box: Array
    antennas: Array
    numbers: Array
    earth: Array
    C_PN: Array
    phase0: float
    patch: Ints
    cell_area: Array
    patch_area: Array


class EpisodeTotals(NamedTuple):
    """What the flights have come to.

    Attributes:
        seen: Cells that the swarm has seen, shape (E, C).
        first_seen: When, NaN for never, shape (E, C) [s].
        area: Seen area, shape (E,) [m^2].
        stored: Aboard each spacecraft, shape (E, n) [bit].
        delivered: Received by Earth, shape (E,) [bit].
        closed: Whose link was closed at the end of the last step, shape (E, n).
        lost: Spacecraft that are no more, shape (E, n).
    """

    seen: Mask
    first_seen: Array
    area: Array
    stored: Array
    delivered: Array
    closed: Mask
    lost: Mask


@kernel
def orient(mission: Mission, now: Now, live: Mask, finite: Mask) -> None:
    """Work out C_AN, r_A and C_BN of the live flights from time, positions and attitudes, and whether all is finite."""
    for e in range(live.shape[0]):
        finite[e] = live[e] and _orient_one(mission, now, e)


@kernel
def _orient_one(mission: Mission, now: Now, e: int) -> bool:
    phase = mission.phase0 + mission.numbers[9] * now.t[e]
    c, s = np.cos(phase), np.sin(phase)
    C, P = now.C_AN[e], mission.C_PN
    for k in range(3):
        C[0, k], C[1, k], C[2, k] = c * P[0, k] + s * P[1, k], c * P[1, k] - s * P[0, k], P[2, k]
    total = 0.0
    for j in range(now.r.shape[1]):
        r = now.r[e, j]
        q = quaternion(now.q[e], j)
        write_dcm(q, now.C_BN[e, j])
        for k in range(3):
            now.r_A[e, j, k] = C[k, 0] * r[0] + C[k, 1] * r[1] + C[k, 2] * r[2]
            total += now.r_A[e, j, k] + now.v[e, j, k] + now.omega[e, j, k] + q[0] + now.C_BN[e, j, k, k]
        for w in range(now.wheel.shape[2]):
            total += now.wheel[e, j, w]
    return np.isfinite(total)


@kernel
def take_pictures(
    scene: Scene,
    mission: Mission,
    now: Now,
    books: EpisodeTotals,
    kind: Ints,
    blind: Mask,
    due: Mask,
    area: Array,
    doubt: Mask,
) -> bool:
    """Let every observer that looks at the body take its picture, one after another, and write down what is new.

    Args:
        scene: See `Scene`.
        mission: See `Mission`.
        now: At the instant of the pictures.
        books: Written to.
        kind: What each spacecraft tracks, shape (E, n).
        blind: Whose camera is off, shape (E, n).
        due: Flights in which pictures are due, shape (E,).
        area: Receives in addition the newly seen area of each flight, shape (E,) [m^2].
        doubt: Receives which pictures may show more than the maps could tell, shape (E, n).

    Returns:
        Whether there are such.
    """
    any_doubt, radius = False, mission.numbers[0]
    new, C_CA, observers = np.empty(books.seen.shape[1], np.bool_), np.empty((3, 3)), int(mission.numbers[13])
    for e in range(due.shape[0]):
        doubt[e] = False
        if not due[e]:
            continue
        for j in range(observers):
            if not takes_picture(j, observers, kind[e, j], not (books.lost[e, j] or blind[e, j])):
                continue
            relative_dcm(now.C_BN[e, j], now.C_AN[e], C_CA)
            r = now.r_A[e, j]
            inside = r[0] * r[0] + r[1] * r[1] + r[2] * r[2] < radius * radius
            gained, pixels, doubt[e, j] = new_cells(scene, r, C_CA, inside, books.seen[e], new)
            any_doubt = any_doubt or doubt[e, j]
            if gained > 0.0:
                write_down(books, e, j, new, now.t[e], gained, pixels * mission.numbers[3])
                area[e] += gained
    return any_doubt


@kernel
def write_down(books: EpisodeTotals, e: int, j: int, new: Mask, t: float, area: float, bits: float) -> None:
    """Enter newly seen cells and the data they brought."""
    for i in range(new.shape[0]):
        if new[i]:
            books.seen[e, i] = True
            books.first_seen[e, i] = t
    books.area[e] += area
    books.stored[e, j] += bits


@kernel
def end_step(
    mission: Mission,
    before: Now,
    now: Now,
    known: Known,
    books: EpisodeTotals,
    kind: Ints,
    index: Ints,
    sigma_BR: Array,
    live: Mask,
    step_s: float,
    low: Array32,
    high: Array32,
    measures: Array,
    hit: Mask,
    observation: Array32,
) -> None:
    """Radio, dangers and readings at the end of a step.

    Args:
        mission: See `Mission`.
        before: At the beginning of the step.
        now: At its end.
        known: The same as the flight software has it, for the readings.
        books: Written to.
        kind: What each spacecraft tracks, shape (E, n).
        index: Whom, where that is a spacecraft, shape (E, n).
        sigma_BR: Attitude errors at the last decision, shape (E, n, 3).
        live: Flights that flew this step, shape (E,).
        step_s: Its length [s]; 0 at a start: then only the readings are made.
        low: Bounds of the observation, shape (F,).
        high: Bounds of the observation, shape (F,).
        measures: Receives delivered bits, saturation, share of close pairs, shape (E, 3).
        hit: Receives which spacecraft hit the body, shape (E, n).
        observation: Receives the readings, shape (E, F).
    """
    for e in range(live.shape[0]):
        if not live[e]:
            continue
        if step_s > 0.0:
            measures[e, 0] = _transmit(mission, now, books, kind[e], index[e], e, step_s)
            measures[e, 1] = _saturation(mission, now, e)
            measures[e, 2] = _close_pairs(mission, before, now, books.lost[e], e)
            for j in range(kind.shape[1]):
                hit[e, j] = not books.lost[e, j] and way_blocked(
                    before.r_A[e, j], now.r_A[e, j], mission.vertices, mission.faces, mission.box
                )
        _read(mission, now, known, books, kind[e], sigma_BR[e], e, observation[e])
        for i in range(low.shape[0]):
            observation[e, i] = min(max(observation[e, i], low[i]), high[i])


@kernel
def _transmit(
    mission: Mission, now: Now, books: EpisodeTotals, kind: Ints, index: Ints, e: int, step_s: float
) -> float:
    """Send over the links that are closed now, taken to be so for the whole step; returns the bits that Earth received."""
    numbers, closed, stored = mission.numbers, books.closed[e], books.stored[e]
    earth = mission.earth[0] + now.t[e] * mission.earth[1]
    write_closed(
        mission.antennas,
        mission.vertices,
        mission.faces,
        mission.box,
        numbers[0],
        kind,
        index,
        now.r[e],
        now.C_BN[e],
        now.C_AN[e],
        earth,
        closed,
    )
    for j in range(kind.shape[0]):
        if books.lost[e, j] or (kind[j] == _SPACECRAFT and books.lost[e, index[j]]):
            closed[j] = False
        if closed[j] and kind[j] == _SPACECRAFT:
            sent = min(stored[j], numbers[1] * step_s)
            stored[j] -= sent
            stored[index[j]] += sent
    budget, received = numbers[2] * step_s, 0.0
    for j in range(kind.shape[0]):  # Earth hears one spacecraft at a time, in gene order
        if closed[j] and kind[j] == _EARTH:
            sent = min(stored[j], budget - received)
            stored[j] -= sent
            received += sent
    books.delivered[e] += received
    return received


@kernel
def _saturation(mission: Mission, now: Now, e: int) -> float:
    total, n, wheels = 0.0, now.wheel.shape[1], now.wheel.shape[2]
    for j in range(n):
        for w in range(wheels):
            share = abs(now.wheel[e, j, w]) / mission.numbers[6]
            total += min(1.0, max(0.0, (share - SATURATION_FROM) / (1.0 - SATURATION_FROM)))
    return total / (n * wheels)


@kernel
def _close_pairs(mission: Mission, before: Now, now: Now, lost: Mask, e: int) -> float:
    """Share of the pairs that came too close; the relative motion within the step is taken as straight."""
    n, least = now.r.shape[1], mission.numbers[4]
    if before.t[e] < mission.numbers[5] or n < 2:
        return 0.0
    near = 0
    for i in range(n):
        for j in range(i + 1, n):
            if lost[i] or lost[j]:
                continue
            along = square = first = 0.0
            for k in range(3):
                d = before.r[e, j, k] - before.r[e, i, k]
                s = (now.r[e, j, k] - now.r[e, i, k]) - d
                along, square, first = along + d * s, square + s * s, first + d * d
            share = min(1.0, max(0.0, -along / square)) if square > 0.0 else 0.0
            if first + share * (2.0 * along + share * square) < least * least:
                near += 1
    return near / (n * (n - 1) / 2)


@kernel
def _read(
    mission: Mission,
    now: Now,
    known: Known,
    books: EpisodeTotals,
    kind: Ints,
    sigma_BR: Array,
    e: int,
    out: Array32,
) -> None:
    numbers, n, C_AN, wheels = mission.numbers, kind.shape[0], now.C_AN[e], now.wheel.shape[2]
    features = FEATURES_BUT_WHEELS + wheels
    for j in range(n):
        at, r_A, v, C_BN = features * j, now.r_A[e, j], now.v[e, j], known.C_BN[e, j]
        out[at : at + features] = 0.0
        # Velocity as seen by somebody who turns with the body.
        turning = (-numbers[9] * r_A[1], numbers[9] * r_A[0], 0.0)
        for k in range(3):
            in_A = C_AN[k, 0] * v[0] + C_AN[k, 1] * v[1] + C_AN[k, 2] * v[2]
            out[at + k] = r_A[k] / numbers[7]
            out[at + 3 + k] = (in_A - turning[k]) / numbers[8]
            out[at + 6 + k] = sigma_BR[j, k]
            out[at + 9 + k] = C_BN[2, 0] * C_AN[k, 0] + C_BN[2, 1] * C_AN[k, 1] + C_BN[2, 2] * C_AN[k, 2]
            out[at + 12 + k] = C_BN[0, 0] * C_AN[k, 0] + C_BN[0, 1] * C_AN[k, 1] + C_BN[0, 2] * C_AN[k, 2]
            out[at + 15 + k] = known.omega[e, j, k] / RATE_SCALE
        for w in range(wheels):
            out[at + 18 + w] = now.wheel[e, j, w] / numbers[6]
        at += 18 + wheels
        out[at] = 1.0 if takes_picture(j, numbers[13], kind[j], not books.lost[e, j]) else 0.0
        out[at + 1] = 1.0 if books.closed[e, j] else 0.0
        out[at + 2] = books.stored[e, j] / numbers[11]
        out[at + 3 + kind[j]] = 1.0
    tail = features * n
    patches = mission.patch_area.shape[0]
    share = np.zeros(patches)
    for i in range(mission.patch.shape[0]):
        if books.seen[e, i]:
            share[mission.patch[i]] += mission.cell_area[i]
    for k in range(patches):
        out[tail + k] = share[k] / mission.patch_area[k]
    out[tail + patches] = 1.0 - now.t[e] / numbers[10]
    out[tail + patches + 1] = books.area[e] / numbers[12]
    out[tail + patches + 2] = books.delivered[e] / numbers[11]
