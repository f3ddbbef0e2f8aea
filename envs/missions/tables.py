"""What an agent of SwarmObserve-v1 is shown: tables of spacecraft, patches and pairs, and which choices make sense; compiled.

Everything is told in the target's own frame: east, north and up at its middle, turning with the body. Lengths are in imaging
altitudes, times in those of a crossing, areas in those of the whole target, so that all bodies look alike. Nothing depends on
how many flights are handled together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.observation.capture import takes_picture
from swarm_mj.smallbody.occultation import Occluder, way_blocked
from swarm_mj.typing import Array, Array32, Ints, Mask, kernel

from ..kinematics import AttitudeEstimate, Kinematics, Tracking
from ..observations import RATE_SCALE
from ..totals import EpisodeTotals

#: Columns of the tables.
SPACECRAFT = (
    *("alive", "camera", "downlink", "imaging", "relaying", "talking", "holding", "link", "stored", "earth_in_sight"),
    *("east", "north", "up", "v_east", "v_north", "v_up", "boresight_east", "boresight_north", "boresight_up"),
    *("attitude_error", "rate", "wheel_speed", "in_reach", "in_reach_next"),
)
PATCHES = ("unseen", "lit", "east", "north", "up", "normal_east", "normal_north", "normal_up", "area")
PAIRS = ("worth", "worth_next", "gsd", "angle", "best", "others", "claimed", "peak", "peak_in")
GENERAL = (
    *("time_left", "seen", "delivered", "alive", "half_width", "picture", "turn", "heard"),
    *("sun_east", "sun_north", "sun_up", "earth_east", "earth_north", "earth_up"),
)
#: Decisions that are looked ahead for the peak of what a picture would be worth.
LOOKAHEAD = 10
#: No entry is larger than this.
BOUND = 5.0
_SPACECRAFT, _EARTH, _DIRECTION = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH), int(TargetKind.DIRECTION)


class TableConstants(NamedTuple):
    """What all tables of a mission share.

    Attributes:
        axes_A: East, north and up, shape (3, 3).
        centre_A: The target's middle, shape (3,) [m].
        altitude_m: Lengths are divided by this.
        crossing_s: Times are divided by this.
        spin_rate: Of the body [rad/s].
        step_s: Length of a decision [s].
        duration_s: Of a flight [s].
        half_width_m: Of the target [m].
        half_angle: Of the camera [rad].
        pixel_angle: Of the camera [rad].
        max_gsd: That counts [m].
        top_speed: Of a wheel [rad/s].
        patch_centre_A: Shape (K, 3) [m].
        patch_normal_A: Shape (K, 3).
        patch_area: Shape (K,) [m^2].
        of_cell: Patch of each cell, shape (C,).
        cell_area: Shape (C,) [m^2].
        nominal_bit: Volume of the whole target [bit].
        earth_bit_s: To Earth, of all spacecraft together [bit/s].
        body: As what hides.
        earth_r_N: At the epoch, shape (3,) [m].
        earth_v_N: Shape (3,) [m/s].
    """

    axes_A: Array
    centre_A: Array
    altitude_m: float
    crossing_s: float
    spin_rate: float
    step_s: float
    duration_s: float
    half_width_m: float
    half_angle: float
    pixel_angle: float
    max_gsd: float
    top_speed: float
    patch_centre_A: Array
    patch_normal_A: Array
    patch_area: Array
    of_cell: Ints
    cell_area: Array
    nominal_bit: float
    earth_bit_s: float
    body: Occluder
    earth_r_N: Array
    earth_v_N: Array


class EpisodeSheet(NamedTuple):
    """What was drawn for E episodes, and what follows from it.

    Attributes:
        lit_area: Of each patch, in the light of the episode, shape (E, K) [m^2].
        possible_area: What the swarm can see as it was let go, shape (E,) [m^2].
        sun_A: Direction of the Sun, shape (E, 3).
        present: Who flies from the start, shape (E, n).
        downlink: Whose link to Earth works, shape (E, n).
        fails_s: When spacecraft are lost, cameras go off, links go off, shape (E, n, 3) [s].
    """

    lit_area: Array
    possible_area: Array
    sun_A: Array
    present: Mask
    downlink: Mask
    fails_s: Array


class Standing(NamedTuple):
    """Where E episodes stand.

    Attributes:
        now: In truth.
        estimate: As the flight software has it.
        tracking: What the spacecraft track.
        totals: What the episodes have come to.
        sheet: What was drawn for them.
    """

    now: Kinematics
    estimate: AttitudeEstimate
    tracking: Tracking
    totals: EpisodeTotals
    sheet: EpisodeSheet


class Tables(NamedTuple):
    """Tables of E episodes of up to n spacecraft over K patches.

    Attributes:
        spacecraft: See `SPACECRAFT`, shape (E, n, .).
        patches: See `PATCHES`, shape (E, K, .).
        pairs: See `PAIRS`, shape (E, n, K, .).
        general: See `GENERAL`, shape (E, .).
        mask: Choices that make sense, shape (E, n, K + 1 + n).
    """

    spacecraft: Array32
    patches: Array32
    pairs: Array32
    general: Array32
    mask: NDArray[np.int8]


def no_sheet(count: int, n: int, patches: int) -> EpisodeSheet:
    """Of that many episodes."""
    return EpisodeSheet(
        lit_area=np.zeros((count, patches)),
        possible_area=np.ones(count),
        sun_A=np.zeros((count, 3)),
        present=np.zeros((count, n), np.bool_),
        downlink=np.zeros((count, n), np.bool_),
        fails_s=np.full((count, n, 3), np.inf),
    )


def no_tables(count: int, n: int, patches: int) -> Tables:
    """Of that many episodes."""
    return Tables(
        spacecraft=np.zeros((count, n, len(SPACECRAFT)), np.float32),
        patches=np.zeros((count, patches, len(PATCHES)), np.float32),
        pairs=np.zeros((count, n, patches, len(PAIRS)), np.float32),
        general=np.zeros((count, len(GENERAL)), np.float32),
        mask=np.zeros((count, n, patches + 1 + n), np.int8),
    )


@kernel
def write_tables(constants: TableConstants, standing: Standing, live: Mask, tables: Tables) -> None:
    """Fill the rows of the live flights, shape (E,)."""
    now, totals, sheet = standing.now, standing.totals, standing.sheet
    for e in range(live.shape[0]):
        if live[e]:
            _write_patches(constants, totals, sheet, e, tables.patches[e])
            _write_general(constants, now, totals, sheet, e, tables.general[e])
            for j in range(sheet.present.shape[1]):
                _write_spacecraft(constants, standing, e, j, tables.spacecraft[e, j])
                _write_pairs(constants, standing, e, j, tables)
            for j in range(sheet.present.shape[1]):
                _write_choice(e, j, tables)
                _write_mask(totals, sheet, e, j, tables)


@kernel
def _write_patches(constants: TableConstants, totals: EpisodeTotals, sheet: EpisodeSheet, e: int, out: Array32) -> None:
    patches, total = constants.patch_area.shape[0], constants.patch_area.sum()
    unseen = np.zeros(patches)
    for i in range(constants.of_cell.shape[0]):
        if not totals.seen[e, i]:
            unseen[constants.of_cell[i]] += constants.cell_area[i]
    axes, centre = constants.axes_A, constants.centre_A
    for k in range(patches):
        out[k, 0] = unseen[k] / constants.patch_area[k]
        out[k, 1] = sheet.lit_area[e, k] / constants.patch_area[k]
        for i in range(3):
            place = normal = 0.0
            for m in range(3):
                place += axes[i, m] * (constants.patch_centre_A[k, m] - centre[m])
                normal += axes[i, m] * constants.patch_normal_A[k, m]
            out[k, 2 + i] = place / constants.altitude_m
            out[k, 5 + i] = normal
        out[k, 8] = constants.patch_area[k] / total * patches


@kernel
def _write_general(
    constants: TableConstants, now: Kinematics, totals: EpisodeTotals, sheet: EpisodeSheet, e: int, out: Array32
) -> None:
    n, alive, possible = sheet.present.shape[1], 0, sheet.possible_area[e]
    for j in range(n):
        alive += not totals.lost[e, j]
    total = constants.patch_area.sum()
    out[0] = 1.0 - now.t[e] / constants.duration_s
    out[1] = min(totals.area[e] / possible, BOUND)
    nominal = constants.nominal_bit * possible / total
    out[2] = min(totals.delivered[e] / nominal, BOUND)
    out[3] = alive / n
    out[4] = constants.half_width_m / constants.altitude_m
    out[5] = np.tan(constants.half_angle) * constants.altitude_m / constants.half_width_m
    out[6] = constants.spin_rate * constants.crossing_s
    out[7] = min(constants.earth_bit_s * constants.step_s / nominal, BOUND)
    earth = constants.earth_r_N + now.t[e] * constants.earth_v_N
    far = np.sqrt(earth[0] * earth[0] + earth[1] * earth[1] + earth[2] * earth[2])
    for i in range(3):
        sun = to_earth = 0.0
        for m in range(3):
            C = now.C_AN[e, m]
            sun += constants.axes_A[i, m] * sheet.sun_A[e, m]
            to_earth += constants.axes_A[i, m] * (C[0] * earth[0] + C[1] * earth[1] + C[2] * earth[2]) / far
        out[8 + i], out[11 + i] = sun, to_earth


@kernel
def _write_spacecraft(constants: TableConstants, standing: Standing, e: int, j: int, out: Array32) -> None:
    now, estimate, tracking, totals, sheet = standing
    out[:] = 0.0
    if totals.lost[e, j]:
        return
    kind, n = tracking.kind[e, j], sheet.present.shape[1]
    out[0], out[1], out[2] = 1.0, not tracking.blind[e, j], sheet.downlink[e, j]
    out[3] = takes_picture(j, n, kind, not tracking.blind[e, j])
    out[4], out[5], out[6] = kind == _SPACECRAFT, kind == _EARTH, kind == _DIRECTION
    out[7] = totals.closed[e, j]
    nominal = constants.nominal_bit * sheet.possible_area[e] / constants.patch_area.sum()
    out[8] = min(totals.stored[e, j] / nominal, BOUND)
    out[9] = _earth_in_sight(constants, now, e, j)
    r, v = _motion(constants, now, e, j)
    C_BN, C_AN = estimate.C_BN[e, j], now.C_AN[e]
    for i in range(3):
        a = constants.axes_A[i]
        place = (a[0] * r[0] + a[1] * r[1] + a[2] * r[2]) / constants.altitude_m
        speed = (a[0] * v[0] + a[1] * v[1] + a[2] * v[2]) * constants.crossing_s / constants.altitude_m
        out[10 + i], out[13 + i] = min(max(place, -BOUND), BOUND), min(max(speed, -BOUND), BOUND)
        ahead = 0.0
        for m in range(3):
            ahead += a[m] * (C_BN[2, 0] * C_AN[m, 0] + C_BN[2, 1] * C_AN[m, 1] + C_BN[2, 2] * C_AN[m, 2])
        out[16 + i] = ahead
    sigma, omega = tracking.sigma_BR[e, j], estimate.omega[e, j]
    out[19] = min(np.sqrt(sigma[0] ** 2 + sigma[1] ** 2 + sigma[2] ** 2), 1.0)
    out[20] = min(np.sqrt(omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2) / RATE_SCALE, BOUND)
    for w in range(now.wheel.shape[2]):
        out[21] = max(out[21], min(abs(now.wheel[e, j, w]) / constants.top_speed, 1.0))


@kernel
def _motion(constants: TableConstants, now: Kinematics, e: int, j: int) -> tuple[Array, Array]:
    """Place relative to the target's middle and velocity relative to the turning body, in A [m, m/s]."""
    r_A, v, C = now.r_A[e, j], now.v[e, j], now.C_AN[e]
    r, velocity = np.empty(3), np.empty(3)
    for k in range(3):
        r[k] = r_A[k] - constants.centre_A[k]
        velocity[k] = C[k, 0] * v[0] + C[k, 1] * v[1] + C[k, 2] * v[2]
    velocity[0] += constants.spin_rate * r_A[1]
    velocity[1] -= constants.spin_rate * r_A[0]
    return r, velocity


@kernel
def _earth_in_sight(constants: TableConstants, now: Kinematics, e: int, j: int) -> bool:
    """Whether the body is not in the way to Earth."""
    r_A, C = now.r_A[e, j], now.C_AN[e]
    earth = constants.earth_r_N + now.t[e] * constants.earth_v_N
    far = np.sqrt(earth[0] * earth[0] + earth[1] * earth[1] + earth[2] * earth[2])
    reach = 2.0 * np.sqrt(r_A[0] * r_A[0] + r_A[1] * r_A[1] + r_A[2] * r_A[2])
    end = np.empty(3)
    for k in range(3):
        end[k] = r_A[k] + reach * (C[k, 0] * earth[0] + C[k, 1] * earth[1] + C[k, 2] * earth[2]) / far
    return not way_blocked(r_A, end, constants.body)


@kernel
def _write_pairs(constants: TableConstants, standing: Standing, e: int, j: int, tables: Tables) -> None:
    """What pictures would bring half a decision ahead, when the spacecraft has turned, and a decision later."""
    now, estimate, tracking, totals, sheet = standing
    out = tables.pairs[e, j]
    out[:] = 0.0
    if totals.lost[e, j]:
        return
    C_BN, C_AN, boresight_A = estimate.C_BN[e, j], now.C_AN[e], np.empty(3)
    for m in range(3):
        boresight_A[m] = C_BN[2, 0] * C_AN[m, 0] + C_BN[2, 1] * C_AN[m, 1] + C_BN[2, 2] * C_AN[m, 2]
    works, left_s = not tracking.blind[e, j], constants.duration_s - now.t[e]
    place = np.empty((LOOKAHEAD, 3))
    for m in range(LOOKAHEAD):
        _go_on(constants, now, e, j, (m + 0.5) * constants.step_s, place[m])
    for k in range(out.shape[0]):
        area = tables.patches[e, k, 0] * constants.patch_area[k] / sheet.possible_area[e]
        value, gsd = _look(constants, place[0], k)
        out[k, 2], out[k, 3] = min(gsd, 2.0), _off(constants, place[0], boresight_A, k)
        if not works:
            continue
        scale = 4.0 * area  # of order 1 for a patch
        out[k, 0] = out[k, 7] = min(scale * value * (gsd <= 1.0), BOUND)
        for m in range(1, LOOKAHEAD):
            value, gsd = _look(constants, place[m], k)
            found = min(scale * value * (gsd <= 1.0), BOUND)
            if m == 1:
                out[k, 1] = found
            if found > out[k, 7] and (m + 0.5) * constants.step_s < left_s:
                out[k, 7], out[k, 8] = found, m / LOOKAHEAD


@kernel
def _go_on(constants: TableConstants, now: Kinematics, e: int, j: int, ahead_s: float, out: Array) -> None:
    """Place some time ahead without forces, relative to the target's middle, in A, which turns meanwhile [m]."""
    v, C, centre = now.v[e, j], now.C_AN[e], constants.centre_A
    for k in range(3):
        out[k] = now.r_A[e, j, k] + ahead_s * (C[k, 0] * v[0] + C[k, 1] * v[1] + C[k, 2] * v[2])
    cosine, sine = np.cos(constants.spin_rate * ahead_s), np.sin(constants.spin_rate * ahead_s)
    x, y = out[0], out[1]
    out[0], out[1], out[2] = cosine * x + sine * y - centre[0], cosine * y - sine * x - centre[1], out[2] - centre[2]


@kernel
def _look(constants: TableConstants, place: Array, k: int) -> tuple[float, float]:
    """What a look at a patch from a place would bring by area, and ground sampling distance over the limit.

    It brings 1 in seen area and as much in data as it has pixels.
    """
    square = height = 0.0
    for m in range(3):
        way = place[m] - (constants.patch_centre_A[k, m] - constants.centre_A[m])
        square += way * way
        height += way * constants.patch_normal_A[k, m]
    distance = np.sqrt(square)
    cosine = max(height / distance, 1e-3)
    pixels = (constants.altitude_m / distance) ** 2 * cosine
    return 1.0 + pixels, distance * constants.pixel_angle / cosine / constants.max_gsd


@kernel
def _off(constants: TableConstants, place: Array, boresight_A: Array, k: int) -> float:
    """Angle between where the camera looks and where a patch stands from a place, over a right angle."""
    square = along = 0.0
    for m in range(3):
        way = place[m] - (constants.patch_centre_A[k, m] - constants.centre_A[m])
        square += way * way
        along -= way * boresight_A[m]
    return np.arccos(min(max(along / np.sqrt(square), -1.0), 1.0)) / (0.5 * np.pi)


@kernel
def _write_choice(e: int, j: int, tables: Tables) -> None:
    """What is best for one, whether there is anything, and what a patch is worth to the others; in order of the spacecraft."""
    pairs, best, later = tables.pairs[e], 0.0, 0.0
    for k in range(pairs.shape[1]):
        best, later = max(best, pairs[j, k, 0]), max(later, pairs[j, k, 1])
        for i in range(pairs.shape[0]):
            if i != j:
                pairs[j, k, 5] = max(pairs[j, k, 5], pairs[i, k, 0])
    if best > 0.0:
        for k in range(pairs.shape[1]):
            pairs[j, k, 4] = pairs[j, k, 0] / best
    for k in range(pairs.shape[1]):
        for i in range(j):
            pairs[j, k, 6] = max(pairs[j, k, 6], pairs[i, k, 4])
    tables.spacecraft[e, j, 22], tables.spacecraft[e, j, 23] = best > 0.0, later > 0.0


@kernel
def _write_mask(totals: EpisodeTotals, sheet: EpisodeSheet, e: int, j: int, tables: Tables) -> None:
    """What makes sense: unseen patches in reach soon, Earth for whom it hears, others to relay to; to hold always does."""
    out, patches, n = tables.mask[e, j], tables.patches.shape[1], sheet.present.shape[1]
    out[:] = 0
    out[patches + 1 + j] = 1
    if totals.lost[e, j]:
        return
    for k in range(patches):
        out[k] = tables.pairs[e, j, k, 0] > 0.0 or tables.pairs[e, j, k, 1] > 0.0
    aboard = totals.stored[e, j] > 0.0
    out[patches] = sheet.downlink[e, j] and aboard
    for i in range(n):
        if i != j:
            out[patches + 1 + i] = aboard and not totals.lost[e, i]
