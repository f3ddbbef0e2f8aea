"""Where the mothership comes from: each way gives the state that it says, and what cannot be is refused in one line."""

import numpy as np
import pytest

from swarm_mj.errors import PathError, ScenarioError
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.flight.mothership import axes_in_N, check_approach, mothership_state, osculating_orbit
from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.mission.trajectories import propagate
from swarm_mj.scenarios.loading import load_scenario, parse_overrides, scenario_from
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.rotation import equatorial_from_ecliptic

OWN = {
    "name": "own",
    "body": {
        "name": "Own",
        "shape": "ellipsoid",
        "semi_axes_m": [300, 250, 200],
        "gravity": {"model": "point_mass", "parameters": {"gm": 5.0}},
    },
}
APPROACH = {
    "v_infinity_m_s": 5.0,
    "longitude_deg": 10.0,
    "latitude_deg": 20.0,
    "b_t_m": 1500.0,
    "b_r_m": 200.0,
    "closest_approach_s": 600.0,
}
ELEMENTS = {"periapsis_radius_m": 2000.0, "eccentricity": 3.0, "inclination_deg": 80.0, "true_anomaly_deg": -60.0}
SHAPE = load_body_shape(scenario_from(OWN).body)


def asked(**mothership):
    return scenario_from({**OWN, "mothership": mothership})


def surroundings(scenario) -> Environment:
    return environment_from(scenario, SHAPE)


def state(**mothership):
    scenario = asked(**mothership)
    return mothership_state(scenario, surroundings(scenario))


def refused(*words, **mothership):
    scenario = asked(**mothership)
    environment = surroundings(scenario)
    with pytest.raises(ScenarioError) as error:
        check_approach(scenario, SHAPE, environment, mothership_state(scenario, environment))
    text = str(error.value)
    assert "\n" not in text and all(word in text for word in words), text


@pytest.mark.parametrize("axes", ["ecliptic", "equatorial", "body_equator"])
@pytest.mark.parametrize("speed", [5.0, 10e3, 15e3])
def test_an_approach_comes_by_the_numbers_that_were_given(axes, speed):
    given = {**APPROACH, "axes": axes, "v_infinity_m_s": speed}
    scenario = asked(approach=given)
    environment = surroundings(scenario)
    r_N, v_N = mothership_state(scenario, environment)
    told = osculating_orbit(scenario, environment, r_N, v_N)
    assert told["way"] == "approach" and told["orbit"] == "hyperbola" and told["gm_m3_s2"] == 5.0
    assert told["v_infinity_m_s"] == pytest.approx(speed, rel=1e-9)
    assert told["v_infinity_longitude_deg"] == pytest.approx(10.0, rel=1e-9)
    assert told["v_infinity_latitude_deg"] == pytest.approx(20.0, rel=1e-9)
    assert (told["b_t_m"], told["b_r_m"]) == pytest.approx((1500.0, 200.0), rel=1e-9, abs=2e-15 * 600.0 * speed)
    assert told["closest_approach_s"] == pytest.approx(600.0, rel=1e-9)


def test_a_field_flies_the_hyperbola_to_its_periapsis_in_time():
    scenario = asked(approach=APPROACH)
    environment = surroundings(scenario)
    start = mothership_state(scenario, environment)
    r, v = propagate(environment.acceleration_N, start.r_N[None], start.velocity[None], np.array([0.0, 600.0]))
    assert abs(r[-1, 0] @ v[-1, 0]) < 1e-9 * np.linalg.norm(r[-1]) * np.linalg.norm(v[-1])
    told = osculating_orbit(scenario, environment, *start)
    assert np.linalg.norm(r[-1]) == pytest.approx(told["periapsis_radius_m"], rel=1e-9)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("speed", [0.0, -0.05, 0.04])
def test_a_path_straight_up_or_down_is_no_parabola_and_flies_to_its_apoapsis(speed):
    scenario, r_N = asked(), np.array([0.0, 2000.0, 500.0])
    environment = surroundings(scenario)
    distance = np.linalg.norm(r_N)
    told = osculating_orbit(scenario, environment, r_N, speed * r_N / distance)
    assert told["orbit"] == "radial" and told["eccentricity"] == 1.0 and told["periapsis_radius_m"] == 0.0
    # Energy is all potential at the apoapsis.
    assert -5.0 / told["apoapsis_radius_m"] == pytest.approx(0.5 * speed**2 - 5.0 / distance, rel=1e-12)
    aside = osculating_orbit(scenario, environment, r_N, np.array([1e-3, 0.0, 0.0]))
    assert aside["orbit"] == "ellipse" and aside["eccentricity"] < 1.0


def test_angles_are_those_of_the_axes_by_name():
    environment = surroundings(asked())
    for name in ("ecliptic", "equatorial", "body_equator"):
        C = axes_in_N(name, environment)
        assert C @ C.T == pytest.approx(np.eye(3), abs=1e-14) and np.linalg.det(C) == pytest.approx(1.0)
    # The obliquity of rotation.py is rounded by 2e-7.
    assert axes_in_N("equatorial", environment) == pytest.approx(equatorial_from_ecliptic(), abs=1e-6)
    body = axes_in_N("body_equator", environment)
    assert body[2] == pytest.approx(environment.C_PN[2], abs=1e-15)
    assert body[0] == pytest.approx(environment.C_PN[0], abs=1e-6)  # P begins at the same node


def test_right_ascension_and_declination_are_equatorial():
    given = {**APPROACH, "axes": "equatorial", "longitude_deg": 0.0, "latitude_deg": 90.0 - 1e-6, "gm_m3_s2": 0.0}
    v_N = state(approach=given).velocity
    # The celestial pole stands at 90 deg longitude, 90 deg - obliquity latitude of the ecliptic.
    obliquity = np.radians(84381.448 / 3600.0)
    assert v_N / 5.0 == pytest.approx([0.0, np.sin(obliquity), np.cos(obliquity)], abs=1e-7)


def test_a_straight_line_needs_no_gm():
    r_N, v_N = state(approach={**APPROACH, "gm_m3_s2": 0.0})
    assert np.linalg.norm(r_N + 600.0 * v_N) == pytest.approx(np.hypot(1500.0, 200.0), rel=1e-12)


@pytest.mark.parametrize(
    ("e", "mean", "true"),
    [(0.5, 30.0, None), (2.0, 30.0, None), (0.0, 77.0, 77.0)],
)
def test_a_mean_anomaly_is_that_of_keplers_equation(e, mean, true):
    given = {key: value for key, value in ELEMENTS.items() if key != "true_anomaly_deg"}
    r_N, v_N = state(elements={**given, "eccentricity": e, "mean_anomaly_deg": mean})
    # Back by the radial velocity: r . v = sqrt(GM a) e sin E, or e sinh H, and r = a (1 - e cos E).
    a = 2000.0 / abs(1.0 - e)
    share = r_N @ v_N / np.sqrt(5.0 * a)
    if e == 0.0:
        assert abs(share) < 1e-12 and true == mean
        cosine = r_N @ state(elements={**given, "eccentricity": 0.0, "true_anomaly_deg": 0.0}).r_N / 2000.0**2
        assert np.degrees(np.arccos(cosine)) == pytest.approx(77.0)
        return
    distance = np.linalg.norm(r_N)
    if e < 1.0:
        anomaly = np.arctan2(share, 1.0 - distance / a)
        assert np.degrees(anomaly - share) == pytest.approx(mean, rel=1e-9)
    else:
        assert np.degrees(share - np.arcsinh(share / e)) == pytest.approx(mean, rel=1e-9)


def test_elements_by_their_semi_major_axis_are_the_same():
    by_periapsis = state(elements=ELEMENTS)
    by_axis = {key: value for key, value in ELEMENTS.items() if key != "periapsis_radius_m"}
    for mine, theirs in zip(by_periapsis, state(elements={**by_axis, "semi_major_axis_m": -1000.0}), strict=True):
        assert mine == pytest.approx(theirs, rel=1e-12)


def test_a_bound_orbit_is_told_by_its_elements():
    scenario = asked(elements={**ELEMENTS, "eccentricity": 0.3, "axes": "body_equator"})
    environment = surroundings(scenario)
    told = osculating_orbit(scenario, environment, *mothership_state(scenario, environment))
    assert told["orbit"] == "ellipse" and told["eccentricity"] == pytest.approx(0.3)
    assert told["inclination_deg"] == pytest.approx(80.0) and told["periapsis_radius_m"] == pytest.approx(2000.0)


def test_position_and_velocity_stay_the_default_way():
    scenario = asked(velocity=[1.0, 2.0, 3.0])
    environment = surroundings(scenario)
    r_N, v_N = mothership_state(scenario, environment)
    assert environment.C_AN(0.0) @ r_N == pytest.approx([0.0, 0.0, -30e3], abs=1e-9) and v_N.tolist() == [1.0, 2.0, 3.0]
    again = scenario_from(asked(approach=APPROACH).model_dump(mode="json"))
    assert again.mothership.way == "approach"


@pytest.mark.parametrize(
    ("mothership", "words"),
    [
        ({"approach": APPROACH, "elements": ELEMENTS}, ["approach, elements", "one way only"]),
        ({"approach": APPROACH, "velocity": "rest"}, ["approach, velocity"]),
        ({"elements": ELEMENTS, "position_A_m": [0, 0, -1e3]}, ["elements, position_A_m"]),
        ({"approach": {**APPROACH, "v_infinity_m_s": 0}}, ["v_infinity_m_s = 0", "greater than 0"]),
        (
            {"elements": {**ELEMENTS, "semi_major_axis_m": 1.0}},
            ["semi_major_axis_m, periapsis_radius_m", "exactly one"],
        ),
        ({"elements": {**ELEMENTS, "mean_anomaly_deg": 1.0}}, ["true_anomaly_deg, mean_anomaly_deg"]),
        (
            {"elements": {"semi_major_axis_m": 1e3, "eccentricity": 2, "inclination_deg": 0, "true_anomaly_deg": 0}},
            ["semi_major_axis_m = 1000", "below 0"],
        ),
        (
            {"elements": {"periapsis_radius_m": 1e3, "eccentricity": 1, "inclination_deg": 0, "mean_anomaly_deg": 0}},
            ["mean_anomaly_deg", "parabola"],
        ),
        ({"ephemeris": {}}, ["oem, spk", "exactly one"]),
        ({"ephemeris": {"spk": "a.bsp"}}, ["target", "needs the name"]),
        ({"ephemeris": {"oem": "a.oem", "target": "X"}}, ["target = X", "leave it out"]),
    ],
)
def test_what_contradicts_itself_is_refused_by_its_keys(mothership, words):
    with pytest.raises(ScenarioError) as error:
        asked(**mothership)
    assert all(word in str(error.value) for word in ["mothership", *words]), error.value


def test_what_gives_no_state_is_refused_by_its_keys():
    with pytest.raises(
        ScenarioError, match=r"approach.latitude_deg = 90: .* parallel to the pole .* axes than ecliptic"
    ):
        state(approach={**APPROACH, "latitude_deg": 90.0})
    with pytest.raises(
        ScenarioError, match=r"elements.true_anomaly_deg = 130 with eccentricity = 3: beyond the asymptote"
    ):
        state(elements={**ELEMENTS, "true_anomaly_deg": 130.0})
    with pytest.raises(ScenarioError, match=r"approach: the hyperbola leads through the body's centre"):
        state(approach={**APPROACH, "b_t_m": 0.0, "b_r_m": 0.0, "closest_approach_s": 0.0})


def test_a_field_without_gm_asks_for_it(monkeypatch):
    class Field:
        def acceleration(self, r_A):
            return np.zeros_like(r_A)

    scenario = asked(approach=APPROACH)
    environment = surroundings(scenario)
    object.__setattr__(environment, "gravity", Field())
    with pytest.raises(ScenarioError, match=r"point_mass has no attribute gm; give mothership.approach.gm_m3_s2"):
        mothership_state(scenario, environment)
    given = asked(approach={**APPROACH, "gm_m3_s2": 0.0})
    assert "b_t_m" in osculating_orbit(given, environment, *mothership_state(given, environment))
    plain = asked()
    assert "b_t_m" not in osculating_orbit(plain, environment, np.ones(3), np.ones(3))


@pytest.mark.parametrize("b_t_m", [0.0, 30.0])
@pytest.mark.parametrize("speed", [5.0, 10e3])
def test_a_mothership_that_hits_the_body_on_its_way_in_is_refused(b_t_m, speed):
    hitting = {**APPROACH, "v_infinity_m_s": speed, "b_t_m": b_t_m, "b_r_m": 0.0}
    words = ["mothership.approach: the mothership hits Own on its way at t = ", "latitude", "longitude", "change b_t_m"]
    refused(*words, approach=hitting)
    refused(
        *words, approach={**hitting, "closest_approach_s": 5_000.0}
    )  # after the flight's end, but before it is past


def test_a_mothership_that_falls_or_begins_inside_is_refused():
    low = {**ELEMENTS, "periapsis_radius_m": 100.0, "eccentricity": 3e3, "true_anomaly_deg": -89.0}
    refused("mothership.elements: the mothership hits Own", elements=low)
    refused("lies inside", "[10.0, 0.0, 0.0]", "position_A_m", position_A_m=[10.0, 0.0, 0.0])
    refused(
        "lies inside", "mothership.elements", elements={**ELEMENTS, "periapsis_radius_m": 10.0, "true_anomaly_deg": 0.0}
    )
    refused("mothership.position_A_m: the mothership hits Own", position_A_m=[0.0, 0.0, -210.0], velocity="rest")


def test_the_time_of_an_impact_is_that_of_the_closed_form():
    """Straight along +z from below: an ellipsoid of 200 m half height is reached when z = -200 m."""
    scenario = asked(position_A_m=[0.0, 0.0, -5_200.0], velocity="rest")
    environment = surroundings(scenario)
    up_N = 10.0 * environment.C_AN(0.0)[2]
    r_N = mothership_state(scenario, environment).r_N
    with pytest.raises(ScenarioError, match=r"t = 49\d s, latitude -9\d|t = 49\d s, latitude -8\d") as error:
        check_approach(scenario, SHAPE, environment, mothership_state(scenario, environment)._replace(velocity=up_N))
    assert "latitude -90.0" in str(error.value) and np.linalg.norm(r_N) == pytest.approx(5_200.0)


@pytest.fixture(scope="module")
def approach_plan() -> Plan:
    return make_plan(load_scenario("eros-approach"))


def test_the_packaged_approach_passes_over_its_target(approach_plan):
    deployment, environment = approach_plan.deployment, approach_plan.environment
    v_N = deployment.mothership_velocity_N
    told = osculating_orbit(approach_plan.scenario, environment, deployment.r0_N, v_N)
    assert told["v_infinity_m_s"] == pytest.approx(5.0, rel=1e-9) and told["b_r_m"] == pytest.approx(44_400.0, rel=1e-9)
    assert told["periapsis_radius_m"] == pytest.approx(30e3, rel=1e-3)
    assert told["turn_angle_deg"] == pytest.approx(44.0, abs=0.5)
    r_N, _ = propagate(environment.acceleration_N, deployment.r0_N[None], v_N[None], np.array([0.0, 5_400.0]))
    r_A = environment.C_AN(5_400.0) @ r_N[-1, 0]
    assert r_A / np.linalg.norm(r_A) == pytest.approx([0.0, 1.0, 0.0], abs=0.03)
    # The push is real: the velocity of the mothership does not follow from the swarm's.
    assert deployment.delta_v == pytest.approx(np.linalg.norm(deployment.v0_N - v_N, axis=1))
    assert 1.0 < deployment.delta_v.min() and deployment.delta_v.max() < 2.5


def test_a_spacecraft_that_hits_the_body_names_the_way_in():
    far = {**APPROACH, "longitude_deg": 1.0, "latitude_deg": 2.0}
    with pytest.raises(PathError, match=r"sc\d hits .* or mothership.approach"):
        make_plan(load_scenario("bennu-slow", parse_overrides([f"mothership={{approach: {far}}}"])))
