"""Checks of the installed program as tables."""

import swarm_mj as sm


def test_validation_is_a_table_with_a_row_a_check():
    table = sm.validate(["gravity-point-mass", "gravity-harmonics"])
    assert table["passed"].notna().any() and table.loc[table["passed"].notna(), "passed"].all()
    assert {"measured", "tolerance", "unit", "reference"} <= set(table.columns)
