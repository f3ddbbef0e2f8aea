"""The table that `swarm-mj fly` ends with."""

from io import StringIO

import pytest
from rich.console import Console
from rich.table import Table

from swarm_mj.cli.common import show_table
from swarm_mj.cli.tables import _OBSERVED, _ROWS, results_tables

SUMMARY = {
    "spacecraft": 5,
    "observers": 5,
    "lost": ["sc3"],
    "pointing_error_deg_before_switch": {"sc1": 0.0132, "sc5": 112.34},
    "pointing_error_deg_final": {"sc1": 0.0116, "sc3": 5.28, "sc4": 1.2e-5},
}


def test_lost_spacecraft_are_counted_and_left_out_of_the_pointing_error_at_the_end():
    assert _OBSERVED["spacecraft (of them observers)"](SUMMARY) == "5 (5), 1 lost"
    assert _OBSERVED["spacecraft (of them observers)"]({**SUMMARY, "lost": []}) == "5 (5)"
    assert _ROWS["pointing error at the end, at most [deg]"](SUMMARY) == "0.0116"


def test_numbers_have_a_power_of_ten_only_where_they_need_one():
    assert _ROWS["pointing error before a switch, at most [deg]"](SUMMARY) == "112"
    assert _ROWS["pointing error at the end, at most [deg]"]({**SUMMARY, "lost": ["sc1", "sc3"]}) == "1.2e-05"


def test_sensors_are_named_where_the_pointing_error_stands_with_what_they_know():
    cell = _ROWS["sensors; attitude known at the arrival, at worst to [deg]"]
    assert cell({"sensors": "ideal"}) == "ideal; -"
    known = {"sc1": 0.0132, "sc2": 0.0171}
    assert cell({"sensors": "cubesat", "attitude_knowledge_error_deg_arrival": known}) == "cubesat; 0.0171"


def test_a_bound_on_what_is_delivered_is_rounded_up_and_left_out_where_none_is_proven():
    cell = _ROWS["of the target delivered to Earth [%]"]
    told = {"delivered_percent": 90.0, "delivered_percent_bound": 97.3192, "not_delivered": []}
    assert cell(told) == "90.00; at most 97.32" and cell({**told, "delivered_percent_bound": None}) == "90.00"


def printed(tables, width, terminal):
    console = Console(file=StringIO(), width=width, force_terminal=terminal, color_system=None)
    for table in tables(console) if callable(tables) else tables:
        show_table(console, table)
    return console.file.getvalue()


@pytest.mark.parametrize("terminal", [False, True])
def test_no_cell_of_a_wide_table_is_cut_off(terminal):
    table = Table(title="Wide")
    for k in range(12):
        table.add_column(f"heading-{k}", no_wrap=True)
    table.add_row(*(f"value-of-{k}" for k in range(12)))
    text = printed([table], 80, terminal)
    assert all(f"heading-{k} " in text and f"value-of-{k} " in text for k in range(12)) and "\u2026" not in text
    assert len({len(line) for line in text.splitlines()[1:]} - {0}) == 1


def test_results_of_many_runs_are_several_tables_in_a_terminal_and_one_elsewhere(monkeypatch):
    monkeypatch.setattr("swarm_mj.cli.tables._OBSERVED", {})
    monkeypatch.setattr("swarm_mj.cli.tables._ROWS", {"spacecraft": lambda s: "12,345,678"})
    runs = [{"scenario": f"scenario-{k}"} for k in range(9)]
    narrow = printed(lambda console: results_tables(console, runs), 80, True)
    assert narrow.count("Results") == 2 and max(map(len, narrow.splitlines())) <= 80
    assert all(f"scenario-{k} " in narrow for k in range(9)) and narrow.count("12,345,678") == 9
    assert printed(lambda console: results_tables(console, runs), 80, False).count("Results") == 1
