"""Designs through the public API: points, bound and proof; flown, saved and read back."""

import matplotlib.axes
import numpy as np
import pytest

import swarm_mj as sm


def test_a_design_says_its_points_its_bound_and_what_is_proven(designed):
    assert designed.proven and designed.bound == designed.n_observers == len(designed.points)
    table = designed.table
    assert table.loc["proof", "observers"] == designed.n_observers
    assert (table["observers"] >= designed.bound).all()
    assert designed.covered_percent > 99.0


def test_what_is_designed_is_flown_and_its_record_travels_along(designed, tmp_path):
    scenario = designed.to_scenario()
    assert list(scenario.design.visiting_points) == designed.points
    flight = sm.fly(scenario, out=tmp_path / "flown", figures=False, report=False)
    assert flight.design["visiting_points"] == designed.points
    assert sm.open(tmp_path / "flown").design == flight.design
    assert flight.coverage.percent >= designed.covered_percent - 0.1


def test_a_design_is_read_back_and_says_what_it_has_not(designed):
    again = sm.open_design(designed.folder)
    assert (again.points, again.bound, again.proven) == (designed.points, designed.bound, designed.proven)
    assert again.table.equals(designed.table) and again.scenario == designed.scenario
    with pytest.raises(sm.SwarmError, match="read back has no plot"):
        _ = again.plot
    for words, name in (("pareto=True", "front"), ("compare=True", "compared")):
        with pytest.raises(sm.SwarmError, match=words):
            getattr(designed, name)


def test_a_design_draws_and_shows_itself(designed, tmp_path):
    assert all(isinstance(ax, matplotlib.axes.Axes) for ax in np.atleast_1d(designed.plot.cover()))
    assert "pareto" not in dir(designed.plot)
    html = designed._repr_html_()
    assert "data:image/png;base64," in html and "minimal" in html
    assert repr(designed).endswith("proven minimal)")
    assert {"cover.png", "history.png", "design.json"} <= {p.name for p in designed.save(tmp_path / "d").iterdir()}


def test_workers_below_one_are_refused():
    with pytest.raises(sm.SwarmError, match="workers = 0 .*must be at least 1"):
        sm.design(sm.load("eros-quick"), workers=0)
