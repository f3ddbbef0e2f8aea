"""Numbers side by side are rounded as the numbers alone: kernels against their own Python, which takes one at a time."""

from math import atan2, cos, exp, log, sin, sqrt

import numpy as np
import pytest

from swarm_mj.spacecraft.attitude.guidance import (
    LineOfSight,
    Reference,
    TrackingError,
    attitude_error,
    track_line_of_sight,
)
from swarm_mj.spacecraft.attitude.lanes import (
    WIDTH,
    abreast,
    cell,
    chosen,
    column,
    every,
    number,
    put_abreast,
    put_columns,
    put_numbers,
    room,
    select,
    some,
    width,
)
from swarm_mj.typing import Array, Mask, kernel


@kernel
def reckon(rows: Array, tensors: Array, flat: Array, wanted: Mask, out: Array, rest: Array) -> int:
    """All that lanes can do; rows of four numbers each, of which `flat` has three."""
    asked = 0
    for i in range(0, rows.shape[0], width()):
        a, b, c = column(rows, i, 1, 0), column(rows, i, 1, 3), cell(tensors, i, 1, 1, 0)
        d, flag = number(flat, 3 * i + 1, 3), chosen(wanted, i, 1)
        small = (a < b) & (b <= 2.0) | (c > 0.5) & (0.25 >= d) | (a != a)
        if some(flag):
            asked += 1
        mixed = max(-0.5, min(a, b)) / (2.0 + abs(c)) - sqrt(abs(d)) * cos(a) + 1.0
        put_columns(out, i, 1, (mixed, select(flag, -a, 3.0), sin(b), select(small, a, b)))
        put_numbers(rest, 2 * i, 2, (a - b, min(a, b)))
    return asked


@kernel
def reckon_abreast(values: Array, wanted: Mask, out: Array) -> int:
    """The same where numbers stand side by side."""
    asked = 0
    for i in range(0, wanted.shape[0], width()):
        a, b, flag = abreast(values[0], i), abreast(values[1], i), abreast(wanted, i)
        if every(flag):
            asked += 1
        put_abreast(out, i, (a, 2.5))
        put_abreast(out[2:], i, (select(flag, atan2(a, b), exp(b)), log(abs(b))))
    return asked


@pytest.mark.parametrize("n", [1, WIDTH, 2 * WIDTH + 3])
def test_numbers_side_by_side_are_read_and_written_whole(n):
    assert room(n) % WIDTH == 0 and n <= room(n) < n + WIDTH
    values, found = np.random.default_rng(n).normal(size=(2, room(n))), []
    wanted = np.arange(room(n)) // WIDTH != 1
    wanted[-1] = False
    for function in (reckon_abreast, reckon_abreast.py_func):
        out = np.full((5, room(n)), 7.0)
        found.append((function(values, wanted, out), out))
    # One spacecraft at a time, Python counts flags one by one.
    assert found[0][0] == wanted.reshape(-1, WIDTH).all(axis=1).sum() and found[1][0] == wanted.sum()
    assert np.array_equal(found[0][1], found[1][1]) and (found[0][1][4] == 7.0).all()


@pytest.mark.parametrize("n", [1, WIDTH - 1, WIDTH, 2 * WIDTH + 3])
def test_each_lane_is_rounded_as_the_number_alone(n):
    rng = np.random.default_rng(n)
    rows, tensors, flat = rng.normal(size=(n, 8))[:, ::2], rng.normal(size=(n, 2, 2)), rng.normal(size=3 * n)
    rows[0, 0], wanted = np.nan, np.arange(n) % WIDTH == 2
    found = [(np.full((n, 4), 7.0), np.full(2 * n, 7.0)) for _ in range(2)]
    groups = reckon(rows, tensors, flat, wanted, *found[0])
    one_by_one = reckon.py_func(rows, tensors, flat, wanted, *found[1])
    assert groups == one_by_one == wanted.sum()
    for ours, theirs in zip(*found, strict=True):
        assert np.array_equal(ours, theirs, equal_nan=True)


def test_rows_that_are_not_there_stay_unwritten():
    out, rest = np.full((3 * WIDTH, 4), 7.0), np.full(6 * WIDTH, 7.0)
    reckon(
        np.ones((WIDTH + 1, 4)),
        np.ones((WIDTH + 1, 2, 2)),
        np.ones(3 * WIDTH + 3),
        np.ones(WIDTH + 1, bool),
        out[: WIDTH + 1],
        rest[: 2 * WIDTH + 2],
    )
    assert (out[WIDTH + 1 :] == 7.0).all() and (rest[2 * WIDTH + 2 :] == 7.0).all()
    assert not (out[WIDTH] == 7.0).any()


def test_a_rare_case_in_one_lane_leaves_its_neighbours_alone():
    n, rng = WIDTH + 3, np.random.default_rng(5)
    q, base = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in rng.normal(size=(2, n, 4)))
    rho, rho_dot, rho_ddot = rng.normal(size=(3, n, 3)) * [[[1e4]], [[10.0]], [[0.1]]]
    # Beside each other: all but at the target, and a line of sight straight against the base's +z axis.
    rho[1], base[2], rho[2] = 0.3, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1e4)
    restart, results = np.arange(n) % 3 == 0, []
    for track, compare in (
        (track_line_of_sight, attitude_error),
        (track_line_of_sight.py_func, attitude_error.py_func),
    ):
        reference = Reference(base.copy(), *np.full((3, n, 3), np.nan))
        error = TrackingError(*np.full((4, n, 3), np.nan))
        with np.errstate(invalid="ignore", divide="ignore"):
            track(LineOfSight(rho, rho_dot, rho_ddot), q, restart, reference)
            compare(q, rho_dot, reference, error)
        results.append((*reference, *error))
    for ours, theirs in zip(*results, strict=True):
        assert np.isfinite(ours).all() and np.array_equal(ours, theirs)
    assert not results[0][1][1].any() and results[0][1][3].any()
