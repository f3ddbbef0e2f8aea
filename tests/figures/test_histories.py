"""Curves over time are those of the telemetry, with modes, switches and limits marked."""

import numpy as np
import pytest
import xarray as xr

from swarm_mj.figures.curves import percent_over_time
from swarm_mj.figures.histories import angular_momenta_B
from swarm_mj.figures.run_figures import COMPOSERS
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.observation.coverage import percent_digits
from swarm_mj.records.modes import intervals, runs
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.spacecraft.attitude.mrp import dcm

from .sheets import assert_nothing_is_cut_off, swarm_of


@pytest.mark.parametrize(("n", "panels"), [(1, 1), (7, 7), (25, 20)])
def test_each_spacecraft_has_a_panel_up_to_twenty(flown, n, panels):
    figure = COMPOSERS["wheel_speed"](*swarm_of(flown, n))
    shown = [ax for ax in figure.axes if ax.get_visible()]
    assert len(shown) == panels
    assert shown[-1].get_title(loc="left").startswith(f"sc{n}:")
    assert ("of 25 spacecraft" in figure.get_suptitle()) == (n > panels)


@pytest.mark.parametrize("n", [1, 2, 5, 7, 13])
def test_the_lowest_panel_of_every_column_names_its_time_axis(flown, n):
    figure = COMPOSERS["pointing_error"](*swarm_of(flown, n))
    assert_nothing_is_cut_off(figure)
    lowest = {}
    for ax in (ax for ax in figure.axes if ax.get_visible()):
        place = ax.get_subplotspec()
        lowest[place.colspan.start] = max(
            lowest.get(place.colspan.start, (-1, "")), (place.rowspan.start, ax.get_xlabel())
        )
    assert all(words.startswith("time") for _, words in lowest.values())
    assert sum(bool(ax.get_xlabel()) for ax in figure.axes) == len(lowest)


def test_tracking_errors_are_those_of_the_telemetry(flown, composed):
    plan, telemetry, _ = flown
    for j, ax in enumerate(composed["tracking_error"].axes[: plan.n]):
        for k in range(3):
            assert np.array_equal(ax.lines[k].get_ydata(), telemetry["sigma_BR"].values[:, j, k])
            assert ax.lines[k].get_xdata() == pytest.approx(telemetry["time"].values / 60.0)


def test_curves_stay_below_the_band_that_names_the_modes(composed):
    for name in ("tracking_error", "wheel_speed", "pointing_error"):
        for ax in (ax for ax in composed[name].axes if ax.get_visible()):
            band = min(ax.transAxes.inverted().transform(text.get_window_extent())[0, 1] for text in ax.texts)
            for line in ax.lines:
                if len(line.get_xdata()) > 2:
                    top = ax.transData.transform(np.column_stack((line.get_xdata(), line.get_ydata())))[:, 1].max()
                    assert ax.transAxes.inverted().transform((0.0, top))[1] < band


def test_panels_mark_the_arrival_and_every_switch(flown, composed):
    plan, telemetry, _ = flown
    mode = telemetry["mode"].values
    times = telemetry["time"].values / 60.0
    for j, ax in enumerate(composed["tracking_error"].axes[: plan.n]):
        marks = sorted(float(line.get_xdata()[0]) for line in ax.lines if len(line.get_xdata()) == 2)
        switches = [float(times[k]) for k in range(1, len(times)) if mode[k, j] != mode[k - 1, j]]
        assert switches
        assert marks == pytest.approx(sorted([10.0, *switches]))


def test_modes_are_named_as_in_the_paper(composed):
    names = [{text.get_text() for text in ax.texts} for ax in composed["tracking_error"].axes]
    assert names == [{"TO", "ET"}, {"TO", "CT"}]


def test_wheel_limits_are_drawn(composed, flown):
    limit = flown[0].scenario.spacecraft.wheel.max_speed_rpm
    for ax in composed["wheel_speed"].axes:
        level = [line.get_ydata()[0] for line in ax.lines if len(set(line.get_ydata())) == 1]
        assert min(level) == pytest.approx(-limit)
        assert max(level) == pytest.approx(limit)


def test_share_of_each_spacecraft_ends_at_its_total_as_it_is_written(flown, composed):
    _, telemetry, result = flown
    beside = [text.get_text() for text in composed["coverage"].axes[1].texts]
    assert beside == [percent_digits(total) for total in result.coverage.percent_by_spacecraft]
    for j, total in enumerate(result.coverage.percent_by_spacecraft):
        assert percent_over_time(result.coverage, j, telemetry["time"].values)[-1] == pytest.approx(total, abs=1e-9)


def test_flight_without_a_switch_marks_none(flown):
    plan, telemetry, result = flown
    calm = telemetry.assign(
        mode=xr.zeros_like(telemetry["mode"]), tracked_spacecraft=telemetry["tracked_spacecraft"] * 0
    )
    figure = COMPOSERS["tracking_error"](plan, calm, result)
    legend = {text.get_text() for text in figure.legends[0].get_texts()}
    assert "switch" not in legend
    assert "arrival" in legend
    assert_nothing_is_cut_off(figure)


def test_runs_and_intervals_cover_the_flight_once():
    mode = np.array([[0], [0], [2], [2], [1], [1]], np.int8)
    tracked = np.array([[0], [0], [0], [0], [3], [4]], np.int16)
    telemetry = xr.Dataset(
        {"mode": (("time", "spacecraft"), mode), "tracked_spacecraft": (("time", "spacecraft"), tracked)},
        {"time": [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]},
    )
    assert runs(telemetry, 0) == [(0.0, 20.0, 0), (20.0, 40.0, 2), (40.0, 50.0, 1), (50.0, 50.0, 1)]
    flag = np.array([True, False, True, True, False, True])
    assert intervals(flag, telemetry["time"].values) == [(0.0, 10.0), (20.0, 20.0), (50.0, 0.0)]
    assert intervals(np.zeros(6, bool), telemetry["time"].values) == []


def test_drawn_momentum_of_the_wheels_is_that_of_their_speeds(flown, composed):
    plan, telemetry, _ = flown
    wheel = plan.scenario.spacecraft.wheel
    for j, ax in enumerate(composed["wheel_momentum"].axes[: plan.n]):
        stored = wheel.spin_inertia_kg_m2 * np.linalg.norm(telemetry["wheel_speed"].values[:, j], axis=1)
        assert ax.lines[1].get_ydata() == pytest.approx(1e3 * stored)
        assert ax.lines[3].get_ydata()[0] == pytest.approx(15.0, abs=0.01)  # a wheel of 15 mN m s


def test_momentum_of_the_whole_spacecraft_is_conserved_without_outer_torques():
    plan = make_plan(
        load_scenario("eros-quick", {"perturbations.gravity_gradient_torque": False, "physics.timestep_s": 0.1})
    )
    telemetry = simulate(plan)
    body, wheels = angular_momenta_B(telemetry, plan.properties)
    C_BN = dcm(telemetry["sigma_BN"].values)
    whole_N = np.einsum("...ij,...i->...j", C_BN, body + wheels)
    largest = np.linalg.norm(wheels, axis=-1).max()
    assert largest > 2e-3  # the wheels do turn the spacecraft
    assert np.abs(whole_N - whole_N[0]).max() < 1e-4 * largest
