"""Flights through the public API: the same numbers as the command line's, saved and read back whole."""

import json

import matplotlib.axes
import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.cli.main import main


@pytest.fixture(scope="module")
def saved(flight, tmp_path_factory):
    return flight.save(tmp_path_factory.mktemp("saved") / "mine", figures=False)


def test_a_flight_is_what_the_command_line_flies(flight, tmp_path):
    changes = ["telemetry.interval_s=10", "observation.interval_s=60", "camera.resolution_px=128"]
    asked = [part for change in changes for part in ("--set", change)]
    out = tmp_path / "run"
    assert main(["fly", "eros-quick", *asked, "--quiet", "--no-figures", "--no-report", "--out", str(out)]) == 0
    theirs = json.loads((out / "summary.json").read_text())
    differ = {key for key in theirs if theirs[key] != flight.summary[key]}
    assert differ <= {"wall_s"}
    again = sm.open(out)
    assert all(
        np.array_equal(again.telemetry[name], flight.telemetry[name], equal_nan=True) for name in again.telemetry
    )


def test_a_saved_flight_is_read_back_as_the_same_object(flight, saved):
    again = sm.open(saved)
    assert again.telemetry.identical(flight.telemetry.assign_attrs(again.telemetry.attrs))
    for one, other in ((again.coverage, flight.coverage), (again.passage, flight.passage)):
        assert np.array_equal(one.first_seen_by_s, other.first_seen_by_s, equal_nan=True)
    assert again.scenario == flight.scenario
    assert again.summary == json.loads((saved / "summary.json").read_text())
    assert again.findings == flight.findings and again.cells.equals(flight.cells)
    assert repr(again) == repr(flight)


def test_the_telemetry_alone_says_where_it_comes_from(saved, tmp_path):
    attributes = sm.open(saved).telemetry.attrs
    assert attributes["epoch_tdb"] == "2018-01-01T03:15:00" and attributes["scenario"] == "eros-quick"
    assert attributes["body"] == "433 Eros" and attributes["body_gm_m3_s2"] == pytest.approx(4.4627547e5, rel=1e-6)
    assert attributes["swarm_mj_version"] == sm.__version__
    (tmp_path / "again.yaml").write_text(attributes["scenario_yaml"])
    assert sm.load(tmp_path / "again.yaml") == sm.open(saved).scenario


def test_tables_and_telemetry_agree(flight):
    table, cells = flight.spacecraft, flight.cells
    assert list(table.index) == ["sc1", "sc2"] and list(table["visiting_point"]) == [12, 40]
    share = 100.0 * cells.loc[cells["seen"], "area_m2"].sum() / cells["area_m2"].sum()
    assert (
        share == pytest.approx(flight.coverage.percent) == pytest.approx(flight.summary["coverage_percent"], abs=1e-6)
    )
    assert flight.telemetry["coverage_percent"].values[-1] == flight.passage.percent
    final = np.degrees(flight.telemetry["pointing_error"].values[-1])
    assert table["pointing_error_deg"].to_numpy() == pytest.approx(final, abs=1e-9)
    assert flight.events.empty and not table["lost"].any()


def test_every_figure_is_a_method_that_returns_axes(flight):
    for name in ("coverage", "links"):
        axes = np.atleast_1d(getattr(flight.plot, name)())
        assert all(isinstance(ax, matplotlib.axes.Axes) for ax in axes)
    assert {"operation", "footprints", "wheel_speed"} <= set(dir(flight.plot))
    with pytest.raises(AttributeError, match="no figure 'colour'; there are behaviors, contacts, coverage"):
        flight.plot.colour()


def test_a_figure_belongs_to_pyplot_where_that_is_in_use(flight):
    from matplotlib import pyplot

    before = set(pyplot.get_fignums())
    flight.plot.links()
    (number,) = set(pyplot.get_fignums()) - before
    pyplot.close(number)


def test_a_flight_shows_itself(flight):
    assert repr(flight) == "Flight('eros-quick', 2 spacecraft, 100.00 % of the target observed in the passage)"
    html = flight._repr_html_()
    assert "100.00 %" in html and "data:image/png;base64," in html


def test_reports_of_flights_in_memory_and_of_folders_show_the_same(flight, saved, tmp_path):
    in_memory = flight.report(tmp_path / "memory.html").read_text("utf-8")
    on_disk = sm.report([saved], tmp_path / "disk.html").read_text("utf-8")
    start = in_memory.index("<main>")
    assert in_memory[start:] == on_disk[on_disk.index("<main>") :]
    assert "B: eros-quick" in sm.report([flight, saved], tmp_path / "two.html").read_text("utf-8")


@pytest.mark.gl
def test_a_flight_in_memory_can_be_filmed(flight, tmp_path):
    path = flight.video(tmp_path / "short.mp4", size=(160, 120), fps=5.0, speed=600.0)
    assert path.stat().st_size > 1000


def test_saving_takes_no_other_results_place_and_keeps_what_lies_there(flight, saved, tmp_path):
    (tmp_path / "thesis.tex").write_text("years")
    with pytest.raises(sm.SwarmError, match="is not an earlier result"):
        flight.save(tmp_path, figures=False)
    (saved / "my.mp4").write_text("a film")
    with pytest.warns(UserWarning, match="kept in .*my.mp4"):
        flight.save(saved, figures=False, report=False)
    assert (saved / "my.mp4").read_text() == "a film"


def test_what_is_no_result_is_not_opened(tmp_path):
    with pytest.raises(sm.SwarmError, match="no such folder"):
        sm.open(tmp_path / "none")
    (tmp_path / "summary.json").write_text("{")
    with pytest.raises(sm.SwarmError, match="cannot be read"):
        sm.open(tmp_path)


def test_a_simulation_is_mujocos_own_and_flies_as_the_flight_does(flight):
    sim = sm.simulation(flight.scenario)
    start = sim.data.qpos.copy()
    while sim.time < 10.0:
        sim.step()
    assert not np.array_equal(sim.data.qpos, start)
    r_N = flight.telemetry["r_BN_N"].sel(time=10.0).values
    assert np.array_equal(sim.data.qpos.reshape(2, -1)[:, :3], r_N)
