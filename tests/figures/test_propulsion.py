"""The figure of thrusters: what it draws is what tanks gave, and it is drawn only where there is something to show."""

import numpy as np
import pytest

from swarm_mj.figures.curves import mean_thrust
from swarm_mj.figures.drawing import OPTIONAL, composers, figures_of
from swarm_mj.figures.run_figures import COMPOSERS
from swarm_mj.io.atomic import FIGURES


def test_a_figure_that_has_nothing_to_show_is_not_drawn(flown):
    _, telemetry, _ = flown
    idle = telemetry.assign(delta_v_m_s=0.0 * telemetry["delta_v_m_s"])
    without = telemetry.drop_vars("delta_v_m_s")
    unseen = idle.drop_vars("r_BN_N_estimate")
    assert set(COMPOSERS) == set(FIGURES["run"])
    assert set(composers(telemetry)) == set(figures_of(telemetry)) == set(COMPOSERS) - {"formation"}
    for calm in (idle, without):
        assert set(figures_of(calm)) == set(COMPOSERS) - {"propulsion", "formation"}
    assert list(composers(unseen)) == [name for name in COMPOSERS if name not in OPTIONAL]


def test_mean_thrust_is_that_of_the_nozzles_and_of_pulses_between_samples(flown):
    _, telemetry, _ = flown
    every = np.arange(telemetry.sizes["time"])
    burning = telemetry["thrust_N"].values[..., 0]
    # Where a burn neither begins nor ends between two samples the mean is the thrust.
    steady = burning[:-1] == burning[1:]
    assert mean_thrust(telemetry, every)[:-1][steady] == pytest.approx(burning[:-1][steady], abs=1e-7)
    few = every[::40]
    impulse = np.einsum("tj,t->j", mean_thrust(telemetry, few)[:-1], np.diff(telemetry["time"].values[few]))
    assert impulse == pytest.approx(0.055 * 0.1 * float(telemetry["time"][-1]), rel=1e-3)


def test_the_figure_shows_what_tanks_gave(flown):
    plan, telemetry, result = flown
    thrust, gained, used = COMPOSERS["propulsion"](plan, telemetry, result).axes
    names = [text.get_text() for text in gained.figure.legends[0].get_texts()]
    assert names[: plan.n] == list(plan.names)
    for j in range(plan.n):
        assert thrust.lines[j].get_ydata().max() == pytest.approx(55.0, rel=1e-3)
        assert gained.lines[j].get_ydata()[-1] == float(telemetry["delta_v_m_s"][-1, j])
        assert used.lines[j].get_ydata()[-1] == pytest.approx(200.0 - 1e3 * float(telemetry["propellant_kg"][-1, j]))
