"""What episodes have come to, entered picture by picture."""

import numpy as np
from swarm_mj.envs.observe.totals import no_totals, record_cells, reset_totals


def test_pictures_enter_their_cells_times_area_and_data_and_a_reset_forgets_one_episode():
    totals = no_totals(2, 3, 4)
    record_cells(totals, 1, 2, np.array([True, False, True, False]), 20.0, 7.0, 100.0, 130.0)
    record_cells(totals, 1, 0, np.array([False, True, False, False]), 30.0, 2.0, 40.0, 130.0)
    record_cells(totals, 1, 2, np.array([False, False, False, True]), 40.0, 1.0, 50.0, 130.0)
    assert totals.seen.tolist() == [[False] * 4, [True] * 4]
    np.testing.assert_array_equal(totals.first_seen, [[np.nan] * 4, [20.0, 30.0, 20.0, 40.0]])
    assert totals.area.tolist() == [0.0, 10.0]
    assert totals.stored.tolist() == [[0.0] * 3, [40.0, 0.0, 130.0]]
    assert totals.seen_bit.tolist() == [0.0, 190.0] and totals.lost_bit.tolist() == [0.0, 20.0]
    reset_totals(totals, 1)
    assert not totals.seen.any() and np.isnan(totals.first_seen).all() and not totals.stored.any()
    assert not totals.seen_bit.any() and not totals.lost_bit.any()
