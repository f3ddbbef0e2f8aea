"""How spacecraft pass a body: hyperbolas and straight lines in closed form, and instants in UTC by astropy."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import swarm_mj as sm
from swarm_mj.io.times import epoch_of, instant, utc_text
from swarm_mj.records.encounters import Path


def straight(distance, speed, closest_s, sun, times):
    r = np.stack([speed * (times - closest_s), np.full_like(times, distance), np.zeros_like(times)], axis=1)
    v = np.broadcast_to([speed, 0.0, 0.0], r.shape)
    return Path(times[0], times[-1], CubicHermiteSpline(times, r, v), lambda t: np.array(sun))


def test_on_a_straight_line_all_is_as_in_closed_form_between_samples():
    path = straight(8e5, 8600.0, 503.3, (-np.cos(0.5), np.sin(0.5), 0.0), np.arange(0.0, 1001.0, 10.0))
    assert path.least(path.distance) == pytest.approx(503.3, abs=1e-3)
    assert path.turning(503.3) == pytest.approx(8600.0 / 8e5)
    # The Sun stands in the plane of the flyby: the phase is 0 where the spacecraft is before it.
    least = path.least(path.phase)
    assert least == pytest.approx(503.3 - 8e5 / np.tan(0.5) / 8600.0, abs=1e-3)
    assert path.phase(least) < 1e-6
    assert path.phase(0.0) == pytest.approx(0.5 - np.arctan2(8e5, 8600.0 * 503.3), abs=1e-9)


def test_a_bent_hyperbola_passes_its_periapsis_when_it_should():
    """Of Kepler's orbit: GM / v^2 = 17.9 km and b = 44.4 km make a periapsis of 30 km."""
    approach = {
        "v_infinity_m_s": 5.0,
        "longitude_deg": 54,
        "latitude_deg": 68,
        "axes": "body_equator",
        "b_t_m": 0,
        "b_r_m": 44_400,
    }
    flight = sm.fly(
        {
            "name": "bent",
            "duration_s": 7200,
            "body": {"gravity": {"model": "point_mass", "parameters": {"gm": 4.4628e5}}},
            "target": {"region": "body"},
            "initial_states": [{"approach": {**approach, "closest_approach_s": 3600.0}}],
            "behavior": {"name": "body_tracking"},
            "telemetry": {"interval_s": 100},
            "observation": {"observer": "horizon", "interval_s": 3600},
            "spacecraft": {"sensors": "ideal"},
        }
    )
    found = flight.summary["encounters"]["sc1"]
    a = 4.4628e5 / 25.0
    periapsis = np.hypot(a, 44_400.0) - a
    assert found["distance_m"] == pytest.approx(periapsis, abs=0.1)
    assert found["closest_approach_s"] == pytest.approx(3600.0, abs=0.1)
    assert found["speed_m_s"] == pytest.approx(5.0 * 44_400.0 / periapsis, abs=1e-5)
    assert np.radians(found["peak_turn_rate_deg_s"]) == pytest.approx(5.0 * 44_400.0 / periapsis**2, rel=1e-6)


@pytest.mark.parametrize(
    "text",
    ["1972-01-01T00:00:00.000Z", "2008-09-05T18:38:20.125Z", "2016-12-31T23:59:59.000Z", "2017-01-01T00:00:00.000Z"],
)
def test_utc_of_an_instant_is_that_of_the_text_it_came_from(text):
    assert utc_text(instant(text, "UTC")) == text


def test_before_1972_there_is_no_utc():
    assert utc_text(epoch_of("1971-12-31T12:00:00")) is None
