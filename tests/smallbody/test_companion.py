"""A companion's path, rotation and pull, against three bodies flown in inertial axes, and the Jacobi constant."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import swarm_mj as sm
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.environment import environment_from, load_body_shape

GM_BODY, GM_MOON = 35.741, 0.287
HOURS = 4.0 * 3600.0


def environment(orbit=None, **companion):
    orbit = {"semi_major_axis_m": 1189.0, "axes": "body_equator", "mean_anomaly_deg": 30.0} | (orbit or {})
    keys = {"body": "dimorphos", "orbit": orbit} | companion
    scenario = sm.load({"name": "pair", "epoch": "2022-09-26T23:00:00", "body": "didymos", "companion": keys})
    return environment_from(scenario, load_body_shape(scenario.body))


def flown(slope, state, times):
    return solve_ivp(slope, (0.0, times[-1]), state, "DOP853", times, rtol=1e-13, atol=1e-10).y.T


def relative(around, r, v, times):
    return flown(lambda t, y: np.r_[y[3:], around.acceleration_N(t, y[None, :3])[0]], np.r_[r, v], times)


@pytest.mark.parametrize("eccentricity", [0.0, 0.03])
def test_a_path_near_the_pair_is_that_of_three_bodies_about_their_barycentre(eccentricity):
    around = environment({"eccentricity": eccentricity})
    r, v = np.array([900.0, -1500.0, 700.0]), np.array([0.05, 0.02, -0.1])
    s, w = around.companion.path.state(0.0)
    share, times = -GM_MOON / (GM_BODY + GM_MOON), np.linspace(0.0, HOURS, 30)

    def slope(_, y):
        pull = [d / np.linalg.norm(d) ** 3 for d in (y[3:6] - y[0:3], y[0:3] - y[6:9], y[3:6] - y[6:9])]
        own = [GM_MOON * pull[0], -GM_BODY * pull[0], GM_BODY * pull[1] + GM_MOON * pull[2]]
        return np.concatenate([y[9:], *own])

    start = [share * s, share * s + s, share * s + r, share * w, share * w + w, share * w + v]
    inertial = flown(slope, np.concatenate(start), times)
    ours = relative(around, r, v, times)
    assert np.abs(ours[:, :3] - (inertial[:, 6:9] - inertial[:, :3])).max() < 1e-6
    paths = np.array([around.companion.position(t) for t in times])
    assert np.abs(paths - (inertial[:, 3:6] - inertial[:, :3])).max() < 1e-6


def test_the_jacobi_constant_is_kept_beside_a_circular_pair():
    around, times = environment(), np.linspace(0.0, HOURS, 40)
    ours = relative(around, np.array([600.0, 900.0, 200.0]), np.array([-0.12, 0.1, 0.05]), times)
    constant = []
    share = GM_MOON / (GM_BODY + GM_MOON)
    for t, y in zip(times, ours, strict=True):
        s, w = around.companion.path.state(t)
        omega = np.cross(s, w) / (s @ s)
        r, v = y[:3] - share * s, y[3:] - share * w  # about the barycentre
        potential = GM_BODY / np.linalg.norm(y[:3]) + GM_MOON / np.linalg.norm(y[:3] - s)
        constant.append(2.0 * potential + 2.0 * omega @ np.cross(r, v) - v @ v)
    assert np.ptp(constant) < 1e-9 * abs(constant[0])


def test_a_locked_companion_turns_its_x_to_the_body_and_its_z_along_the_orbits_normal():
    companion = environment({"eccentricity": 0.1}, rotation="locked").companion
    for t in (0.0, 5_000.0):
        (s, w), C = companion.path.state(t), companion.C_AN(t)
        assert C @ s == pytest.approx([-np.linalg.norm(s), 0.0, 0.0], abs=1e-9)
        assert C @ np.cross(s, w) == pytest.approx([0.0, 0.0, np.linalg.norm(np.cross(s, w))], abs=1e-9)
        assert np.linalg.det(C) == pytest.approx(1.0)


def test_a_locked_body_turns_its_x_to_the_companion_all_the_time():
    around = environment(body_rotation="locked")
    for t in (0.0, 3_000.0, 40_000.0):
        assert around.C_AN(t) @ around.companion.position(t) == pytest.approx([1189.0, 0.0, 0.0], abs=1e-6)


def test_the_period_follows_from_both_gravitational_parameters_and_is_that_published():
    motion = environment().companion.path.mean_motion
    assert motion**2 * 1189.0**3 == pytest.approx(GM_BODY + GM_MOON)
    assert 2.0 * np.pi / motion / 3600.0 == pytest.approx(11.9215, abs=1e-3)


def test_the_orbit_has_its_elements_in_the_axes_that_are_named():
    around = environment({"mean_anomaly_deg": 0.0, "node_deg": 40.0, "inclination_deg": 0.0})
    s, w = around.companion.path.state(0.0)
    pole = around.C_PN[2]
    assert np.cross(s, w) / np.linalg.norm(np.cross(s, w)) == pytest.approx(pole)
    ecliptic = environment({"axes": "ecliptic", "mean_anomaly_deg": 0.0, "node_deg": 40.0}).companion.position(0.0)
    assert ecliptic / 1189.0 == pytest.approx([np.cos(np.radians(40.0)), np.sin(np.radians(40.0)), 0.0])


@pytest.mark.parametrize(
    ("companion", "words"),
    [
        ({"body": "dimorphos"}, "orbit, ephemeris: give exactly one of them"),
        ({"body": "dimorfos", "orbit": {"semi_major_axis_m": 1}}, "did you mean 'dimorphos'"),
        (
            {"body": "dimorphos", "orbit": {"semi_major_axis_m": 1e3, "eccentricity": 0.1}, "body_rotation": "locked"},
            "body_rotation = locked: needs companion.orbit with eccentricity = 0",
        ),
    ],
)
def test_what_is_no_companion_is_refused(companion, words):
    with pytest.raises(ScenarioError, match=words):
        sm.load({"name": "pair", "body": "didymos", "companion": companion})
