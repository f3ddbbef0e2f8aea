"""Spacecraft on their way: phase geometry in closed form, tables of Horizons, states in any axes, and what is refused."""

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.errors import InteropError, ScenarioError
from swarm_mj.flight.plan import make_plan
from swarm_mj.io.times import epoch_of, instant, text_of
from swarm_mj.scenarios.constants import AU, DAY
from swarm_mj.tracks.frames import C_EN, axes_of_pole

CLOSEST, SPEED, MISS = 900.0, 8600.0, 802_600.0
POINT = {"shape": "ellipsoid", "semi_axes_m": [3300, 2900, 2200], "gravity": {"model": "point_mass"}}


def scenario_of(*states, body=POINT, gm=6000.0, **keys):
    given = {**body, "gravity": {"model": "point_mass", "parameters": {"gm": gm}}} if isinstance(body, dict) else body
    return {
        "name": "coming",
        "epoch": "2008-09-05T18:23:20Z",
        "duration_s": 2 * CLOSEST,
        "body": given,
        "target": {"region": "body"},
        "initial_states": list(states),
        "behavior": {"name": "body_tracking"},
        "observation": {"observer": "raster"},
        **keys,
    }


def by_phase(phase, **keys):
    passing = {"v_infinity_m_s": SPEED, "closest_approach_s": CLOSEST, "distance_m": MISS, "gm_m3_s2": 0.0, **keys}
    return {"approach": {**passing, "phase": phase}}


def planned(*args, **keys):
    plan = make_plan(sm.load(scenario_of(*args, **keys)))
    return plan, plan.deployment.release_r_N, plan.deployment.v0_N


def angle_deg(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))


@pytest.mark.parametrize(("body", "clock"), [("steins", 0.0), ("lutetia", 84.2), ("itokawa", 200.0)])
@pytest.mark.parametrize(
    ("approach", "least"), [(38.6, 0.27), (38.6, -5.0), (11.0, 0.0), (70.0, 3.0), (59.8, 43.0), (139.0, -39.0)]
)
def test_a_flyby_by_its_phases_shows_them_on_a_straight_line(body, approach, least, clock):
    phase = {"approach_deg": approach, "least_deg": least, "clock_deg": clock}
    plan, r0, v0 = planned(by_phase(phase), body=body)
    r, v, sun = r0[0], v0[0], plan.environment.sun.at(CLOSEST)
    at = r + v * CLOSEST
    assert np.linalg.norm(v) == pytest.approx(SPEED) and np.linalg.norm(at) == pytest.approx(MISS, rel=1e-6)
    assert at @ v == pytest.approx(0.0, abs=1e-3 * MISS)
    assert angle_deg(-v, sun) == pytest.approx(approach, abs=1e-6)
    beside = np.cross(v, at) @ sun / np.linalg.norm(np.cross(v, at)) / np.linalg.norm(sun)
    assert np.degrees(np.arcsin(beside)) == pytest.approx(least, abs=1e-5)
    # Before the Sun's side of the body the plane's distance from the Sun is the least phase; on a grid of 1 s, and from closer.
    times = np.arange(-40_000.0, 40_000.0)[:, None]
    places = at + v * times
    cosines = places @ sun / np.linalg.norm(places, axis=1) / np.linalg.norm(sun)
    assert np.degrees(np.arccos(cosines.max())) == pytest.approx(abs(least), abs=0.4)
    assert np.degrees(np.arccos(cosines.max())) >= abs(least) - 1e-5


def test_the_clock_tells_from_where_about_the_sun_the_spacecraft_comes():
    for clock in (0.0, 90.0, 180.0):
        plan, _, v0 = planned(by_phase({"approach_deg": 40.0, "closest_deg": 60.0, "clock_deg": clock}))
        s = plan.environment.sun.at(CLOSEST)
        s /= np.linalg.norm(s)
        origin = -v0[0] / SPEED
        aside = (origin - (origin @ s) * s) / np.sin(np.radians(40.0))
        north = np.array([0.0, 0.0, 1.0]) - s[2] * s
        north /= np.linalg.norm(north)
        assert (aside @ north, aside @ np.cross(s, north)) == pytest.approx(
            (np.cos(np.radians(clock)), np.sin(np.radians(clock))), abs=1e-9
        )


def test_the_phase_at_the_closest_approach_is_what_was_asked_for():
    plan, r0, v0 = planned(by_phase({"approach_deg": 139.0, "closest_deg": 80.0}))
    assert angle_deg(r0[0] + v0[0] * CLOSEST, plan.environment.sun.at(CLOSEST)) == pytest.approx(80.0, abs=1e-5)


@pytest.mark.parametrize("axes", ["ecliptic", "equatorial", "body_equator"])
def test_a_state_is_given_along_any_axes(axes):
    state = {"position_m": [1e6, -2e6, 3e6], "velocity_m_s": [-500.0, 1000.0, -1490.0], "axes": axes}
    plan, r0, v0 = planned({"state": state, "arrival_s": 900})
    C = axes_of_pole(axes, plan.environment.C_PN[2])
    assert np.allclose(C @ r0[0], state["position_m"]) and np.allclose(C @ v0[0], state["velocity_m_s"])


def test_fifty_spacecraft_pass_one_after_another():
    states = [by_phase({"approach_deg": 38.6, "least_deg": 0.27}, distance_m=MISS + 2e4 * k) for k in range(50)]
    plan, r0, v0 = planned(*states)
    assert plan.n == plan.n_observers == 50
    assert np.linalg.norm(r0 + v0 * CLOSEST, axis=1) == pytest.approx(MISS + 2e4 * np.arange(50), rel=1e-6)


def test_bennu_at_six_metres_a_second_bends_by_its_gravity():
    phase = {"approach_deg": 60.0, "least_deg": 10.0}
    passing = {"v_infinity_m_s": 6.0, "distance_m": 2000.0, "gm_m3_s2": None}
    plan, r0, v0 = planned(by_phase(phase, **passing), body="bennu")
    energy = 0.5 * v0[0] @ v0[0] - plan.environment.gravity.gm / np.linalg.norm(r0[0])
    assert energy == pytest.approx(18.0, rel=1e-9)
    momentum = np.linalg.norm(np.cross(r0[0], v0[0]))
    assert momentum == pytest.approx(2000.0 * np.sqrt(36.0 + 2.0 * plan.environment.gravity.gm / 2000.0), rel=1e-9)


HEAD = """\
Target body name: Rosetta (spacecraft) (-226)     {source: ROS}
Center body name: Eros (2000433)                  {source: JPL#659}
Output units    : UNITS
Output type     : GEOMETRIC cartesian states
Reference frame : FRAME
$$SOE
"""
LINES = """\
JD = A.D. DATE TDB
 X = X Y = Y Z = Z
 VX= U VY= V VZ= W
 LT= 1.000000000000000E-02 RG= 2.0E+03 RR=-8.6E+00
"""
EROS = "2000433"


def table_of(path, times, r_N, v_N, *, units, frame, commas):
    """A table as Horizons saves it: blocks of lines, or comma-separated with the Julian date first."""
    metre, metre_s = {"KM-S": (1e3, 1e3), "AU-D": (AU, AU / DAY), "KM-D": (1e3, 1e3 / DAY)}[units]
    turn = C_EN if frame == "ICRF" else np.eye(3)
    rows = []
    for t, r, v in zip(times, r_N, v_N, strict=True):
        year, month, rest = text_of(instant("2008-09-05T18:23:20Z", "UTC") + round(t * 1e9)).split("-")
        month = ("Jan Feb Mar Apr May Jun Jul Aug Sep Oct Nov Dec").split()[int(month) - 1]
        date, numbers = f"{year}-{month}-{rest.replace('T', ' ')}", [*(turn @ r / metre), *(turn @ v / metre_s)]
        told = [f"{number:.15E}" for number in numbers]
        if commas:
            rows.append(
                ", ".join([f"{2454715.0 + t / DAY:.9f}", f"A.D. {date}", *told, "1.0E-02", "2.0E+03", "-8.6E+00", ""])
            )
        else:
            rows.append(
                f"{2454715.0 + t / DAY:.9f} = A.D. {date} TDB\n X ={told[0]} Y ={told[1]} Z ={told[2]}\n"
                f" VX={told[3]} VY={told[4]} VZ={told[5]}\n LT= 1.0E-02 RG= 2.0E+03 RR=-8.6E+00"
            )
    head = HEAD.replace("UNITS", f"{units}, deg").replace("FRAME", frame)
    path.write_text(head + "\n".join(rows) + "\n$$EOE\n")


@pytest.mark.parametrize("commas", [False, True])
@pytest.mark.parametrize("units", ["KM-S", "AU-D", "KM-D"])
@pytest.mark.parametrize("frame", ["Ecliptic of J2000.0", "ICRF"])
def test_a_table_of_horizons_gives_the_state_at_the_epoch(tmp_path, units, frame, commas):
    times = np.array([-600.0, -300.0, 300.0, 600.0, 1200.0])
    r0, v = np.array([1.1e6, -2.2e7, 3.3e6]), np.array([10.0, 8600.0, -20.0])
    table_of(
        tmp_path / "vectors.txt",
        times,
        r0 + times[:, None] * v,
        np.tile(v, (5, 1)),
        units=units,
        frame=frame,
        commas=commas,
    )
    coming = {"ephemeris": {"horizons": str(tmp_path / "vectors.txt")}, "arrival_s": 900}
    _, r_N, v_N = planned(coming, body="eros")
    # Texts of dates end at a microsecond.
    assert np.abs(r_N[0] - r0).max() < 1e-6 * SPEED and np.abs(v_N[0] - v).max() < 1e-6


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("$$EOE", "", "between"),
        ("2000433", "2101955", "must be EROS"),
        ("KM-S", "FT-S", "Output units"),
        ("Ecliptic", "B1950", "Reference frame"),
        ("Center body name", "Centre", "does not say its Center"),
        ("Sep", "Foo", "month"),
    ],
)
def test_a_table_that_is_none_is_refused_with_its_name(tmp_path, old, new, says):
    path, times = tmp_path / "vectors.txt", np.array([-600.0, 600.0])
    r = np.array([[0.0, 0.0, 1e6], [0.0, 1e6, 1e6]])
    table_of(path, times, r, r, units="KM-S", frame="Ecliptic of J2000.0", commas=False)
    path.write_text(path.read_text().replace(old, new).replace("Eros (2101955)", "Bennu (2101955)"))
    with pytest.raises((InteropError, ScenarioError), match=says) as error:
        planned({"ephemeris": {"horizons": str(path)}, "arrival_s": 900}, body="eros")
    assert "vectors.txt" in str(error.value)


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ({"arrival_s": 5}, "exactly one of them"),
        ({"state": {"position_m": [1, 2, 3], "velocity_m_s": [1, 2, 3]}}, "arrival_s: must be given"),
        (by_phase({"approach_deg": 38.6}), "least_deg, closest_deg"),
        (by_phase({"approach_deg": 38.6, "least_deg": 39}), "must be from -38.6 to 38.6"),
        (by_phase({"approach_deg": 139, "closest_deg": 20}), "closest_deg = 20: must be from 49 to 131"),
        (by_phase({"approach_deg": 38.6, "least_deg": 0}, b_t_m=1e5), "must be longitude_deg"),
        (
            by_phase({"approach_deg": 38.6, "least_deg": 0}, closest_approach="2008-09-05T18:38:20Z"),
            "exactly one of them",
        ),
        (by_phase({"approach_deg": 38.6, "least_deg": 0}, distance_m=0), "distance_m"),
    ],
)
def test_a_state_that_says_too_much_or_too_little_is_refused_by_its_key(entry, says):
    with pytest.raises(ScenarioError, match="initial_states") as error:
        sm.load(scenario_of(entry))
    assert says in str(error.value)


def test_a_design_refuses_spacecraft_that_are_on_their_way():
    with pytest.raises(ScenarioError, match="initial_states: a design chooses paths from a mothership"):
        sm.design("refly-steins", progress=False)


def test_a_body_in_the_way_is_refused_with_its_spacecraft():
    with pytest.raises(sm.SwarmError, match="sc1"):
        planned(by_phase({"approach_deg": 38.6, "least_deg": 0.27}, distance_m=1000.0))


def test_dates_in_utc_are_brought_to_tdb_by_the_leap_seconds_of_their_day():
    """On 2008-09-05 TAI is 33 s ahead of UTC, and TT 32.184 s ahead of TAI (IERS, Bulletin C)."""
    assert sm.load(scenario_of(by_phase({"approach_deg": 10, "least_deg": 0}))).epoch.startswith(
        "2008-09-05T18:24:25.18"
    )
    assert instant("2008-09-05T18:38:20Z", "UTC") - epoch_of("2008-09-05T18:38:20") == pytest.approx(65.184e9, abs=2e6)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"mothership.position_A_m": [0, 0, -2e4]}, "mothership: cannot go with initial_states"),
        ({"behavior.name": "dedicated_communications"}, "adds a spacecraft for communications"),
        (
            {
                "camera.gimbal": {"axis_B": [0, 1, 0], "from_deg": 0, "to_deg": 90, "rate_deg_s": 1},
                "swarm": {"class": 3},
            },
            "gimbal",
        ),
    ],
)
def test_what_cannot_be_with_a_flyby_that_was_flown_is_refused_by_its_key(changes, says):
    with pytest.raises(sm.SwarmError, match=says):
        planned = sm.load("refly-steins", changes)
        sm.fly(planned, figures=False, report=False)
