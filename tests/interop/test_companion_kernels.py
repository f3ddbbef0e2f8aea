"""SPICE's own occultations and eclipses, by a binary's exported kernels with ellipsoids, against how pictures are judged."""

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.flight.observe import screen_of
from swarm_mj.interop.states import FlightStates
from tests.sample_missions.flights import mission

pytest.importorskip("spiceypy")
STEP_S = 5.0
#: An ellipsoid for each, and an orbit that is no circle: nothing may hide behind symmetry.
UNEVEN = {
    "body.semi_axes_m": [430.0, 400.0, 350.0],
    # A is N at the arrival.
    "body.rotation.w_rate_deg_per_day": 3823.0,
    "body.rotation.w0_deg": 69.24,
    "companion.body.semi_axes_m": [110.0, 85.0, 60.0],
    "companion.orbit.eccentricity": 0.04,
    "companion.orbit.inclination_deg": 2.0,
    "companion.orbit.node_deg": 94.9,
    "companion.orbit.mean_anomaly_deg": 61.0,
    "telemetry.interval_s": STEP_S,
}


@pytest.fixture(scope="module", params=["locked", "own"])
def binary(request, tmp_path_factory):
    import spiceypy

    folder = tmp_path_factory.mktemp("binary")
    changes = UNEVEN | {"companion.rotation": request.param}
    flight = sm.fly(sm.load(mission("binary", folder), changes))
    flight.export(folder / "kernels", ("spk", "ck"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder / "kernels" / "spice")
        spiceypy.kclear()
        spiceypy.furnsh("swarm.tm")
        yield spiceypy, FlightStates(flight.plan, flight.telemetry)
        spiceypy.kclear()


def test_both_bodies_stand_and_turn_in_spice_as_in_the_flight(binary):
    spice, states = binary
    around = states.plan.environment
    for t in np.linspace(0.0, states.times[-1], 41):
        et = states.epoch / 1e9 + t
        state = 1e3 * spice.spkezr("MOON", et, "ECLIPJ2000", "NONE", "SPHERE")[0]
        assert state == pytest.approx(np.concatenate(around.companion.path.state(t)), abs=1e-4)
        assert np.abs(spice.pxform("ECLIPJ2000", "SWARM_MOON_FIXED", et) - around.companion.C_AN(t)).max() < 1e-6
        assert np.abs(spice.pxform("ECLIPJ2000", "SWARM_SPHERE_FIXED", et) - around.C_AN(t)).max() < 1e-6
    assert 1e3 * spice.bodvrd("MOON", "RADII", 3)[1] == pytest.approx([110.0, 85.0, 60.0])
    assert 1e9 * spice.bodvrd("MOON", "GM", 1)[1][0] == pytest.approx(0.3)


def judged(states, t, observer):
    """Whether the moon stands before the body's centre and before any of its cells, seen from the spacecraft or the Sun."""
    around, region = states.plan.environment, states.plan.region
    shade, C_AN = screen_of(around).at(t), around.C_AN(t)
    points = region.corners_A.reshape(-1, 3)
    if observer == "SUN":
        sun = C_AN @ around.sun.at(t)
        turned = np.repeat(region.normal_A @ sun > 0.0, 3)
        sun /= np.linalg.norm(sun)
        return shade.shades(np.zeros((1, 3)), sun)[0], shade.shades(points[turned], sun).any()
    r_A = C_AN @ states.states_N[round(t / STEP_S), 0, :3]
    turned = np.repeat(((r_A - region.centroid_A) * region.normal_A).sum(axis=1) > 0.0, 3)
    return shade.hides(np.zeros((1, 3)), r_A)[0], shade.hides(points[turned], r_A).any()


@pytest.mark.parametrize("observer", ["SUN", "SWARM_SC1"])
def test_occultations_begin_and_end_when_spice_says_so(binary, observer):
    """Eclipses are occultations for the Sun; by `occult` at every sample, and by the windows of `gfoclt`."""
    spice, states = binary
    ours = np.array([judged(states, t, observer) for t in states.times])
    front, back = ("MOON", "ELLIPSOID", "SWARM_MOON_FIXED"), ("SPHERE", "ELLIPSOID", "SWARM_SPHERE_FIXED")
    of_centre = (*("SPHERE", "POINT", " "), *front)
    theirs = np.array(
        [
            [spice.occult(*of_centre, "NONE", observer, et) < 0, spice.occult(*back, *front, "NONE", observer, et) < 0]
            for et in states.et
        ]
    )
    for column, target in enumerate((of_centre[:3], back)):
        assert ours[:, column].any() and not ours[:, column].all()
        # Facets flatten both limbs by half a metre: a sample at a transition may go either way.
        differing = np.flatnonzero(ours[:, column] != theirs[:, column])
        changes = np.flatnonzero(np.diff(theirs[:, column]))
        assert len(changes) and all(np.abs(changes + 0.5 - k).min() <= 1.0 for k in differing), observer
        window = spice.cell_double(40)
        confine = spice.cell_double(2)
        spice.wninsd(states.et[0], states.et[-1], confine)
        spice.gfoclt("ANY", *front, *target, "NONE", observer, STEP_S, confine, window)
        edges = [edge for w in range(spice.wncard(window)) for edge in spice.wnfetd(window, w)]
        inner = [edge for edge in edges if states.et[0] + 1e-3 < edge < states.et[-1] - 1e-3]
        flips = states.et[np.flatnonzero(np.diff(ours[:, column]))] + 0.5 * STEP_S
        assert len(flips) == len(inner)
        assert np.abs(flips - inner).max() <= 1.5 * STEP_S


def test_a_companion_by_an_spk_is_where_the_elements_had_it(binary, tmp_path):
    _, states = binary
    path = {"spk": "swarm.bsp", "target": str(states.companion.code), "body": str(states.body.code)}
    changes = {key: value for key, value in UNEVEN.items() if not key.startswith("companion.orbit")}
    given = sm.load(mission("binary", tmp_path), changes | {"companion.orbit": None, "companion.ephemeris": path})
    around = environment_from(given, load_body_shape(given.body))
    for t in (0.0, 17.0, 700.0, 1100.0):
        expected = states.plan.environment.companion.path.state(t)
        assert around.companion.position(t) == pytest.approx(expected[0], abs=1e-3)
        assert around.companion.path.state(t)[1] == pytest.approx(expected[1], abs=1e-4)
