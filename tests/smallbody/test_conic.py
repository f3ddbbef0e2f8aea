"""Hyperbolas, B-planes and elements, against closed forms, a numeric integration and brahe."""

from dataclasses import replace
from math import asin, atan2, inf, radians, sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarm_mj.errors import MissionError
from swarm_mj.smallbody.conic import (
    ConicElements,
    Hyperbola,
    b_plane_axes,
    elements_of_state,
    hyperbola_of_state,
    hyperbolic_anomaly,
    state_of_elements,
    state_of_hyperbola,
)

POLE = np.array([0.0, 0.0, 1.0])
GM_EROS, GM_BENNU = 4.46275e5, 4.892
#: GM [m^3/s^2], speed [m/s], B.T and B.R [m], time of closest approach [s]: from 5 m/s to 15 km/s, e from 1.0001 to 1e15.
FLYBYS = [
    (GM_EROS, 5.0, 0.0, 44_400.0, 5_400.0),
    (GM_EROS, 5.0, -20e3, 30e3, -1_000.0),
    (GM_EROS, 0.1, 20e3, 30e3, 2e6),
    (GM_BENNU, 5.0, 1_000.0, -300.0, 600.0),
    (GM_BENNU, 10e3, 250e3, 10e3, 3_600.0),
    (1.1e8, 15e3, 3e6, -1e6, 172_800.0),
    (1e-9, 15e3, 3e6, -1e6, 172_800.0),
    (0.0, 10e3, 5e3, 7e3, 86_400.0),
]


def flyby(gm, speed, b_t, b_r, when, direction=(0.3, -0.5, 0.4)):
    S = np.array(direction) / np.linalg.norm(direction)
    return Hyperbola.of_components(gm, speed * S, POLE, (b_t, b_r), when)


def coasted(r, v, gm, t):
    """Two-body motion integrated numerically."""

    def rates(_, y):
        return np.concatenate([y[3:], -gm * y[:3] / np.linalg.norm(y[:3]) ** 3])

    end = solve_ivp(rates, (0.0, t), np.concatenate([r, v]), method="DOP853", rtol=1e-13, atol=1e-9).y[:, -1]
    return end[:3], end[3:]


@pytest.mark.parametrize("numbers", FLYBYS)
def test_a_b_plane_becomes_a_state_and_comes_back(numbers):
    asked = flyby(*numbers)
    found = hyperbola_of_state(*state_of_hyperbola(asked), asked.gm)
    assert found.v_infinity == pytest.approx(asked.v_infinity, rel=1e-9, abs=1e-9 * asked.speed)
    assert found.B == pytest.approx(asked.B, rel=1e-9, abs=1e-9 * asked.impact_parameter)
    assert found.closest_approach == pytest.approx(asked.closest_approach, rel=1e-9)
    assert found.components(POLE) == pytest.approx(numbers[2:4], rel=1e-9, abs=1e-9 * asked.impact_parameter)


@pytest.mark.parametrize("numbers", FLYBYS)
def test_energy_momentum_periapsis_and_turn_are_those_of_the_closed_forms(numbers):
    gm, V, *_ = numbers
    asked = flyby(*numbers)
    r, v = state_of_hyperbola(asked)
    h = np.cross(r, v)
    assert v @ v / 2.0 - gm / np.linalg.norm(r) == pytest.approx(V**2 / 2.0, rel=1e-9)
    assert h == pytest.approx(np.cross(asked.B, asked.v_infinity), rel=1e-9, abs=1e-9 * np.linalg.norm(h))
    r0, v0 = state_of_hyperbola(replace(asked, closest_approach=0.0))
    assert np.linalg.norm(r0) == pytest.approx(asked.periapsis_radius, rel=1e-9)
    assert np.linalg.norm(v0) == pytest.approx(asked.periapsis_speed, rel=1e-9)
    assert abs(r0 @ v0) < 1e-9 * np.linalg.norm(r0) * np.linalg.norm(v0)
    # b^2 = r_p^2 (1 + 2 GM / (r_p v_inf^2)), Vallado (2013), eq. 12-45.
    r_p = asked.periapsis_radius
    assert asked.impact_parameter == pytest.approx(r_p * sqrt(1.0 + 2.0 * gm / (r_p * V**2)), rel=1e-9)
    if gm > 0.0:
        e = 1.0 + r_p * V**2 / gm
        assert asked.eccentricity == pytest.approx(e, rel=1e-9)
        assert asked.impact_parameter == pytest.approx(asked.semi_major_axis * sqrt((e - 1.0) * (e + 1.0)), rel=1e-9)
        assert asked.turn_angle == pytest.approx(2.0 * asin(1.0 / e), rel=1e-7 if e < 1.01 else 1e-9)
    else:
        assert asked.eccentricity == inf and asked.turn_angle == 0.0


@pytest.mark.parametrize("numbers", [FLYBYS[k] for k in (0, 1, 3, 4)])
def test_the_state_arrives_at_periapsis_by_a_numeric_integration(numbers):
    asked = flyby(*numbers)
    r, v = coasted(*state_of_hyperbola(asked), asked.gm, asked.closest_approach)
    r0, v0 = state_of_hyperbola(replace(asked, closest_approach=0.0))
    assert r == pytest.approx(r0, abs=1e-8 * np.linalg.norm(r0))
    assert v == pytest.approx(v0, abs=1e-8 * np.linalg.norm(v0))


def test_far_out_it_moves_along_the_asymptote_that_b_leads_to():
    asked = replace(flyby(GM_EROS, 5.0, 20e3, 30e3, 0.0), closest_approach=1e12)
    r, v = state_of_hyperbola(asked)
    S = asked.v_infinity / asked.speed
    assert v / np.linalg.norm(v) == pytest.approx(S, abs=1e-7)
    # The asymptote is approached as 1 / r.
    assert r - (r @ S) * S == pytest.approx(asked.B, abs=1.0)


def test_axes_of_the_b_plane_have_their_directions():
    # Coming along +x, pole +z: T = x cross z = -y, R = x cross -y = -z.
    T, R = b_plane_axes(np.array([7.0, 0.0, 0.0]), 3.0 * POLE)
    assert T == pytest.approx([0.0, -1.0, 0.0]) and R == pytest.approx([0.0, 0.0, -1.0])
    with pytest.raises(MissionError, match="parallel to the pole"):
        b_plane_axes(np.array([0.0, 0.0, -2.0]), POLE)


def test_without_gm_the_path_is_a_straight_line():
    asked = flyby(0.0, 10e3, 5e3, 7e3, 100.0)
    r, v = state_of_hyperbola(asked)
    assert v == pytest.approx(asked.v_infinity, rel=1e-14)
    assert r == pytest.approx(asked.B - 100.0 * asked.v_infinity, rel=1e-12)
    through = flyby(0.0, 10e3, 0.0, 0.0, 100.0)
    r, v = state_of_hyperbola(through)
    assert r == pytest.approx(-100.0 * through.v_infinity) and through.periapsis_radius == 0.0
    assert hyperbola_of_state(r, v, 0.0).closest_approach == pytest.approx(100.0)


def test_a_fall_onto_the_centre_has_a_time_and_no_b():
    falling = flyby(GM_EROS, 5.0, 0.0, 0.0, 4_000.0)
    r, v = state_of_hyperbola(falling)
    assert np.linalg.norm(np.cross(r, v)) < 1e-9 * np.linalg.norm(r) * np.linalg.norm(v) and r @ v < 0.0
    found = hyperbola_of_state(r, v, GM_EROS)
    assert found.closest_approach == pytest.approx(4_000.0, rel=1e-6) and found.impact_parameter < 1.0
    with pytest.raises(MissionError, match="through the body's centre"):
        state_of_hyperbola(replace(falling, closest_approach=0.0))


def test_a_bound_state_has_no_hyperbola():
    assert hyperbola_of_state(np.array([30e3, 0, 0]), np.array([0, 3.0, 0]), GM_EROS) is None


@pytest.mark.parametrize("least", [0.0, 1e-6, 1.0, 1e6])
@pytest.mark.parametrize("a", [0.0, 1e-9, 1.0, 1e7])
@pytest.mark.parametrize("path", [0.0, 1e-9, 1.0, -3e5, 1e12])
def test_keplers_equation_of_a_hyperbola_is_solved(least, a, path):
    if least == a == 0.0:
        return
    H = hyperbolic_anomaly(path, least, a)
    small = H**3 / 6.0 * (1.0 + H**2 / 20.0 * (1.0 + H**2 / 42.0)) if abs(H) < 0.1 else np.sinh(H) - H
    assert least * np.sinh(H) + a * small == pytest.approx(path, rel=1e-12)


ORBITS = [(40e3, 0.0), (30e3, 0.4), (30e3, 0.999), (30e3, 1.0), (30e3, 1.7), (30e3, 50.0)]


@pytest.mark.parametrize(("least", "e"), ORBITS)
def test_elements_become_a_state_and_come_back(least, e):
    asked = ConicElements(
        periapsis_radius=least, eccentricity=e, inclination=1.1, node=2.2, argument=0.7, true_anomaly=0.9
    )
    r, v = state_of_elements(asked, GM_EROS)
    found = elements_of_state(r, v, GM_EROS)
    if e == 0.0:  # a circle has no periapsis: argument and anomaly together are the argument of latitude
        assert found.argument == pytest.approx(0.0, abs=1e-12) and found.true_anomaly == pytest.approx(1.6, rel=1e-9)
        found = replace(found, argument=0.7, true_anomaly=0.9)
    assert vars(found) == pytest.approx(vars(asked), rel=1e-9, abs=1e-9)
    # vis-viva, with 1 / a = (1 - e) / r_p
    assert v @ v == pytest.approx(GM_EROS * (2.0 / np.linalg.norm(r) - (1.0 - e) / least), rel=1e-9)


def test_a_true_anomaly_beyond_the_asymptote_is_refused():
    beyond = ConicElements(
        periapsis_radius=30e3, eccentricity=2.0, inclination=0.1, node=0.0, argument=0.0, true_anomaly=radians(121.0)
    )
    with pytest.raises(MissionError, match="asymptote"):
        state_of_elements(beyond, GM_EROS)


@pytest.mark.parametrize(("least", "e"), ORBITS[1:2])
def test_brahe_has_the_same_states(least, e):
    brahe = pytest.importorskip("brahe")
    # brahe's elements are about the Earth: scaled by its GM, an orbit of the same shape.
    scale = (GM_EROS / brahe.GM_EARTH) ** (1.0 / 3.0)
    nu = 0.9
    E = 2.0 * atan2(sqrt(1.0 - e) * np.sin(nu / 2.0), sqrt(1.0 + e) * np.cos(nu / 2.0))
    theirs = np.array([least / (1.0 - e) / scale, e, *np.degrees([1.1, 2.2, 0.7, E - e * np.sin(E)])])
    state = brahe.state_koe_to_eci(theirs, brahe.AngleFormat.DEGREES)
    ours = ConicElements(
        periapsis_radius=least, eccentricity=e, inclination=1.1, node=2.2, argument=0.7, true_anomaly=nu
    )
    r, v = state_of_elements(ours, GM_EROS)
    assert r == pytest.approx(scale * state[:3], rel=1e-9) and v == pytest.approx(scale * state[3:], rel=1e-9)


def test_spice_has_the_same_hyperbola():
    spice = pytest.importorskip("spiceypy")
    asked = flyby(*FLYBYS[1])
    r, v = state_of_hyperbola(asked)
    least, e, inclination, node, argument, _, _, _ = spice.oscelt(np.concatenate([r, v]) / 1e3, 0.0, asked.gm / 1e9)
    ours = elements_of_state(r, v, asked.gm)
    assert (1e3 * least, e) == pytest.approx((asked.periapsis_radius, asked.eccentricity), rel=1e-9)
    assert (ours.inclination, ours.node, ours.argument) == pytest.approx((inclination, node, argument), rel=1e-9)
    later = 1e3 * np.array(spice.prop2b(asked.gm / 1e9, np.concatenate([r, v]) / 1e3, 7_000.0))
    moved = state_of_hyperbola(replace(asked, closest_approach=asked.closest_approach - 7_000.0))
    assert np.concatenate(moved) == pytest.approx(later, rel=1e-9)
