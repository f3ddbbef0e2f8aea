"""The table that `swarm-mj fly` ends with."""

from swarm_mj.cli.tables import _ROWS

SUMMARY = {
    "spacecraft": 5,
    "observers": 5,
    "lost": ["sc3"],
    "pointing_error_deg_before_switch": {"sc1": 0.0132, "sc5": 112.34},
    "pointing_error_deg_final": {"sc1": 0.0116, "sc3": 5.28, "sc4": 1.2e-5},
}


def test_lost_spacecraft_are_counted_and_left_out_of_the_pointing_error_at_the_end():
    assert _ROWS["spacecraft (of them observers)"](SUMMARY) == "5 (5), 1 lost"
    assert _ROWS["spacecraft (of them observers)"]({**SUMMARY, "lost": []}) == "5 (5)"
    assert _ROWS["pointing error at the end, at most [deg]"](SUMMARY) == "0.0116"


def test_numbers_have_a_power_of_ten_only_where_they_need_one():
    assert _ROWS["pointing error before a switch, at most [deg]"](SUMMARY) == "112"
    assert _ROWS["pointing error at the end, at most [deg]"]({**SUMMARY, "lost": ["sc1", "sc3"]}) == "1.2e-05"


def test_sensors_are_named_where_the_pointing_error_stands_with_what_they_know():
    cell = _ROWS["sensors; attitude known at the visit, at worst to [deg]"]
    assert cell({"sensors": "ideal"}) == "ideal; -"
    known = {"sc1": 0.0132, "sc2": 0.0171}
    assert cell({"sensors": "cubesat", "attitude_knowledge_error_deg_visit": known}) == "cubesat; 0.0171"
