"""Fills the tables of what agents are shown, compiled. Nothing depends on how many flights are handled together."""

from __future__ import annotations

import numpy as np

from swarm_mj.compilation import allocation_free, inlined, kernel
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.observation.capture import takes_picture
from swarm_mj.smallbody.occultation import way_blocked
from swarm_mj.typing import Array, Array32, Ints, Mask

from .kinematics import Kinematics, PerMission
from .tables import BOUND, LOOKAHEAD, EpisodeArrays, EpisodeSheet, TableConstants, Tables
from .totals import EpisodeTotals

#: Body rates are told over this [rad/s].
RATE_SCALE = 0.1
_SPACECRAFT, _EARTH, _DIRECTION = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH), int(TargetKind.DIRECTION)


@kernel
def write_tables(
    constants: PerMission[TableConstants], mission: Ints, arrays: EpisodeArrays, live: Mask, tables: Tables
) -> None:
    """Fill the rows of the live flights, shape (E,); `mission` is that of each, shape (E,), and `constants` are by mission."""
    for m in range(len(constants)):
        some = False
        for e in range(live.shape[0]):
            some = some or (live[e] and mission[e] == m)
        if some:
            of = constants[m]
            for e in range(live.shape[0]):
                if live[e] and mission[e] == m:
                    _write_flight(of, arrays, e, tables)


@inlined
def _write_flight(constants: TableConstants, arrays: EpisodeArrays, e: int, tables: Tables) -> None:
    n = arrays.sheet.present.shape[1]
    _write_patches(constants, arrays, e, tables.patches[e])
    _write_general(constants, arrays, e, tables.general[e])
    for j in range(n):
        _write_spacecraft(constants, arrays, e, j, tables.spacecraft[e, j])
        _write_pairs(constants, arrays, e, j, tables)
    for j in range(n):
        _write_choice(e, j, tables)
        _write_mask(arrays.totals, arrays.sheet, e, j, tables)


@allocation_free
def _earth(constants: TableConstants, t: float) -> tuple[float, float, float]:
    """Position of Earth in N [m]."""
    r, v = constants.earth_r_N, constants.earth_v_N
    return r[0] + t * v[0], r[1] + t * v[1], r[2] + t * v[2]


@allocation_free
def _sun(constants: TableConstants, arrays: EpisodeArrays, e: int, ahead_s: float) -> tuple[float, float, float]:
    """Direction of the Sun in A some time ahead, a unit vector."""
    if constants.drawn_light:
        sun_A = arrays.sheet.sun_A[e]
        return sun_A[0], sun_A[1], sun_A[2]
    C, r, v, t = arrays.now.C_AN[e], constants.sun_r_N, constants.sun_v_N, arrays.now.t[e] + ahead_s
    x, y, z = r[0] + t * v[0], r[1] + t * v[1], r[2] + t * v[2]
    far = np.sqrt(x * x + y * y + z * z)
    a = (C[0, 0] * x + C[0, 1] * y + C[0, 2] * z) / far
    b = (C[1, 0] * x + C[1, 1] * y + C[1, 2] * z) / far
    c, s = np.cos(constants.spin_rate * ahead_s), np.sin(constants.spin_rate * ahead_s)
    return c * a + s * b, c * b - s * a, (C[2, 0] * x + C[2, 1] * y + C[2, 2] * z) / far


@allocation_free
def _is_lit(constants: TableConstants, sun_A: tuple[float, float, float], k: int) -> bool:
    """Whether a patch as a whole counts as lit where the Sun moves; where it was drawn, cells without light do not count."""
    if constants.drawn_light or constants.lowest_sun < -1.0:
        return True
    normal = constants.patch_normal_A[k]
    return normal[0] * sun_A[0] + normal[1] * sun_A[1] + normal[2] * sun_A[2] >= constants.lowest_sun


@kernel
def _write_patches(constants: TableConstants, arrays: EpisodeArrays, e: int, out: Array32) -> None:
    patches, totals, sun_A = constants.patch_area.shape[0], arrays.totals, _sun(constants, arrays, e, 0.0)
    unseen, counts = np.zeros(patches), np.zeros(patches)
    for i in range(constants.of_cell.shape[0]):
        if totals.target[e, i]:
            counts[constants.of_cell[i]] += constants.cell_area[i]
            if not totals.seen[e, i]:
                unseen[constants.of_cell[i]] += constants.cell_area[i]
    axes, centre = constants.axes_A, constants.centre_A
    for k in range(patches):
        out[k, 0] = unseen[k] / constants.patch_area[k]
        out[k, 1] = counts[k] / constants.patch_area[k] if _is_lit(constants, sun_A, k) else 0.0
        for i in range(3):
            place = normal = 0.0
            for m in range(3):
                place += axes[i, m] * (constants.patch_centre_A[k, m] - centre[m])
                normal += axes[i, m] * constants.patch_normal_A[k, m]
            out[k, 2 + i] = place / constants.altitude_m
            out[k, 5 + i] = normal
        out[k, 8] = constants.patch_area[k] / constants.total_area * patches


@allocation_free
def _write_general(constants: TableConstants, arrays: EpisodeArrays, e: int, out: Array32) -> None:
    now, totals, sheet = arrays.now, arrays.totals, arrays.sheet
    n, alive, delivered = sheet.present.shape[1], 0, 0.0
    for j in range(n):
        alive += not totals.lost[e, j]
        delivered += totals.delivered[e, j]
    out[0] = 1.0 - now.t[e] / constants.duration_s
    out[1] = min(totals.area[e] / sheet.yardstick_area[e], BOUND)
    out[2] = min(delivered / sheet.yardstick_bit[e], BOUND)
    out[3] = alive / n
    out[4] = constants.half_width_m / constants.altitude_m
    out[5] = np.tan(constants.half_angle) * constants.altitude_m / constants.half_width_m
    out[6] = constants.spin_rate * constants.crossing_s
    out[7] = min(constants.earth_bit_s * constants.step_s / sheet.yardstick_bit[e], BOUND)
    earth = _earth(constants, now.t[e])
    far = np.sqrt(earth[0] * earth[0] + earth[1] * earth[1] + earth[2] * earth[2])
    sun_A = _sun(constants, arrays, e, 0.0)
    for i in range(3):
        axis, to_earth = constants.axes_A[i], 0.0
        sun = axis[0] * sun_A[0] + axis[1] * sun_A[1] + axis[2] * sun_A[2]
        for m in range(3):
            C = now.C_AN[e, m]
            to_earth += constants.axes_A[i, m] * (C[0] * earth[0] + C[1] * earth[1] + C[2] * earth[2]) / far
        out[8 + i], out[11 + i] = sun, to_earth


@kernel
def _write_spacecraft(constants: TableConstants, arrays: EpisodeArrays, e: int, j: int, out: Array32) -> None:
    now, estimate, tracking, totals, sheet = arrays
    out[:] = 0.0
    if totals.lost[e, j]:
        return
    kind = tracking.kind[e, j]
    out[0], out[1], out[2] = 1.0, not tracking.blind[e, j], sheet.downlink[e, j]
    out[3] = takes_picture(j, constants.n_observers, kind, not tracking.blind[e, j])
    out[1] = out[1] * (j < constants.n_observers)
    out[4], out[5], out[6] = kind == _SPACECRAFT, kind == _EARTH, kind == _DIRECTION
    out[7] = totals.closed[e, j]
    out[8] = min(totals.stored[e, j] / sheet.yardstick_bit[e], BOUND)
    out[9] = _earth_in_sight(constants, now, e, j)
    r, v = np.empty(3), np.empty(3)
    _motion(constants, now, e, j, 0.0, r, v)
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


@allocation_free
def _motion(constants: TableConstants, now: Kinematics, e: int, j: int, ahead_s: float, r: Array, v: Array) -> None:
    """Write place relative to the target's middle [m] and velocity [m/s] without forces some time ahead, in A, which turns."""
    v_N, C, spin = now.v[e, j], now.C_AN[e], constants.spin_rate
    for k in range(3):
        v[k] = C[k, 0] * v_N[0] + C[k, 1] * v_N[1] + C[k, 2] * v_N[2]
        r[k] = now.r_A[e, j, k] + ahead_s * v[k]
    cosine, sine = np.cos(spin * ahead_s), np.sin(spin * ahead_s)
    r[0], r[1] = cosine * r[0] + sine * r[1], cosine * r[1] - sine * r[0]
    v[0], v[1] = cosine * v[0] + sine * v[1] + spin * r[1], cosine * v[1] - sine * v[0] - spin * r[0]
    for k in range(3):
        r[k] -= constants.centre_A[k]


@kernel
def _earth_in_sight(constants: TableConstants, now: Kinematics, e: int, j: int) -> bool:
    """Whether the body is not in the way to Earth."""
    r_A, C = now.r_A[e, j], now.C_AN[e]
    earth = _earth(constants, now.t[e])
    far = np.sqrt(earth[0] * earth[0] + earth[1] * earth[1] + earth[2] * earth[2])
    reach = 2.0 * np.sqrt(r_A[0] * r_A[0] + r_A[1] * r_A[1] + r_A[2] * r_A[2])
    end = np.empty(3)
    for k in range(3):
        end[k] = r_A[k] + reach * (C[k, 0] * earth[0] + C[k, 1] * earth[1] + C[k, 2] * earth[2]) / far
    return not way_blocked(r_A, end, constants.body)


@kernel
def _write_pairs(constants: TableConstants, arrays: EpisodeArrays, e: int, j: int, tables: Tables) -> None:
    """What pictures would bring half a decision ahead, when the spacecraft has turned, and a decision later."""
    now, estimate, tracking, totals, sheet = arrays
    out = tables.pairs[e, j]
    out[:] = 0.0
    if totals.lost[e, j]:
        return
    C_BN, C_AN, boresight_A = estimate.C_BN[e, j], now.C_AN[e], np.empty(3)
    for m in range(3):
        boresight_A[m] = C_BN[2, 0] * C_AN[m, 0] + C_BN[2, 1] * C_AN[m, 1] + C_BN[2, 2] * C_AN[m, 2]
    works = not tracking.blind[e, j] and j < constants.n_observers
    left_s = constants.duration_s - now.t[e]
    place, velocity, sun_A = np.empty((LOOKAHEAD, 3)), np.empty(3), np.empty((LOOKAHEAD, 3))
    for m in range(LOOKAHEAD):
        sun_A[m, 0], sun_A[m, 1], sun_A[m, 2] = _sun(constants, arrays, e, (m + 0.5) * constants.step_s)
        _motion(constants, now, e, j, (m + 0.5) * constants.step_s, place[m], velocity)
    for k in range(out.shape[0]):
        area = tables.patches[e, k, 0] * constants.patch_area[k] / sheet.yardstick_area[e]
        value, gsd = _picture_value(constants, place[0], k)
        out[k, 2], out[k, 3] = min(gsd, 2.0), _off_boresight(constants, place[0], boresight_A, k)
        if not works:
            continue
        scale = 4.0 * area  # of order 1 for a patch
        lit = _is_lit(constants, (sun_A[0, 0], sun_A[0, 1], sun_A[0, 2]), k)
        out[k, 0] = out[k, 7] = min(scale * value * (gsd <= 1.0 and lit), BOUND)
        for m in range(1, LOOKAHEAD):
            value, gsd = _picture_value(constants, place[m], k)
            lit = _is_lit(constants, (sun_A[m, 0], sun_A[m, 1], sun_A[m, 2]), k)
            found = min(scale * value * (gsd <= 1.0 and lit), BOUND)
            if m == 1:
                out[k, 1] = found
            if found > out[k, 7] and (m + 0.5) * constants.step_s < left_s:
                out[k, 7], out[k, 8] = found, m / LOOKAHEAD


@allocation_free
def _picture_value(constants: TableConstants, place: Array, k: int) -> tuple[float, float]:
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


@allocation_free
def _off_boresight(constants: TableConstants, place: Array, boresight_A: Array, k: int) -> float:
    """Angle between where the camera looks and where a patch stands from a place, over a right angle."""
    square = along = 0.0
    for m in range(3):
        way = place[m] - (constants.patch_centre_A[k, m] - constants.centre_A[m])
        square += way * way
        along -= way * boresight_A[m]
    return np.arccos(min(max(along / np.sqrt(square), -1.0), 1.0)) / (0.5 * np.pi)


@allocation_free
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


@allocation_free
def _write_mask(totals: EpisodeTotals, sheet: EpisodeSheet, e: int, j: int, tables: Tables) -> None:
    """What makes sense: unseen patches in reach within `LOOKAHEAD`, Earth for whom it hears, relays; to hold always does."""
    out, patches, n = tables.mask[e, j], tables.patches.shape[1], sheet.present.shape[1]
    out[:] = 0
    out[patches + 1 + j] = 1
    if totals.lost[e, j]:
        return
    for k in range(patches):
        out[k] = tables.pairs[e, j, k, 7] > 0.0
    aboard = totals.stored[e, j] > 0.0
    out[patches] = sheet.downlink[e, j] and aboard
    for i in range(n):
        if i != j:
            out[patches + 1 + i] = aboard and not totals.lost[e, i]
