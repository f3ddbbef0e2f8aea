"""Tiles: cells grouped by who saw them when, and what they take."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarm_mj.dataflow.tiles import grade, make_tiles

AREA = np.array([2.0, 3.0, 5.0, 7.0])
#: Cells 0 and 1 in one picture of spacecraft 0; 2 also in one of spacecraft 1; 3 unseen.
SEEN_S = np.array([[10.0, 10.0, 10.0, np.nan], [np.nan, np.nan, 20.0, np.nan]])
BITS = np.array([[4.0, 6.0, 10.0, np.nan], [np.nan, np.nan, 30.0, np.nan]])
GSD_M = np.array([[1.0, 2.0, 3.0, np.nan], [np.nan, np.nan, 0.5, np.nan]])


def test_cells_of_the_same_pictures_make_a_tile():
    tiles = make_tiles(AREA, SEEN_S, BITS, GSD_M)
    assert tiles.of_cell[0] == tiles.of_cell[1] != tiles.of_cell[2]
    assert tiles.of_cell[3] == -1
    pair, shared = tiles.of_cell[0], tiles.of_cell[2]
    assert tiles.area[pair] == 5.0 and tiles.area[shared] == 5.0
    assert tiles.bits[:, pair].tolist() == [10, 0] and tiles.bits[:, shared].tolist() == [10, 30]
    assert tiles.ready_s[:, pair].tolist() == [10.0, np.inf] and tiles.ready_s[:, shared].tolist() == [10.0, 20.0]
    # Weighted with the areas 2 and 3 of the pair.
    assert tiles.gsd_m[:, pair].tolist() == [1.6, np.inf] and tiles.gsd_m[:, shared].tolist() == [3.0, 0.5]


def test_bits_are_whole():
    tiles = make_tiles(AREA, SEEN_S, 0.33 * BITS, GSD_M)
    assert tiles.bits[0, tiles.of_cell[0]] == 4  # 3.3 bit


def test_grades_of_ground_sampling_distance_differ_by_a_tenth():
    assert (np.diff(grade(1.1 ** np.arange(-20.5, 20.5))) == 1).all()
    assert grade(1.0001) == grade(1.0999) == grade(1.1001) - 1


def test_nobody_saw_anything():
    tiles = make_tiles(AREA, np.full((2, 4), np.nan), BITS, GSD_M)
    assert tiles.count == 0 and (tiles.of_cell == -1).all() and tiles.bits.shape == (2, 0)


@settings(deadline=None)
@given(
    arrays(np.float64, (3, 12), elements=st.sampled_from([np.nan, 1.0, 2.0, 3.0])),
    arrays(np.float64, (3, 12), elements=st.floats(0.1, 50.0)),
)
def test_tiles_are_disjoint_and_hold_all_that_was_seen(seen_s, size):
    area = np.arange(1.0, 13.0)
    tiles = make_tiles(area, seen_s, size, size)
    seen = ~np.isnan(seen_s)
    assert ((tiles.of_cell >= 0) == seen.any(axis=0)).all()
    assert tiles.area.sum() == pytest.approx(area[seen.any(axis=0)].sum())
    for j in range(3):
        bits = size[j, seen[j]].sum()
        assert bits - 1e-6 <= tiles.bits[j].sum() <= bits + tiles.count
        for cell in np.flatnonzero(tiles.of_cell >= 0):
            when = tiles.ready_s[j, tiles.of_cell[cell]]
            assert when == seen_s[j, cell] if seen[j, cell] else np.isinf(when)
