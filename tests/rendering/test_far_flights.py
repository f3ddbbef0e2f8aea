"""Films show the body whatever its size and however far the flight begins: nothing is cut off by a clipping plane."""

from itertools import pairwise

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.errors import OutputError
from swarm_mj.rendering import picture
from swarm_mj.rendering.cameras import overview
from swarm_mj.rendering.film import make_film
from swarm_mj.rendering.picture import Drawing
from swarm_mj.rendering.replay import Replay
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_io import save_shape

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("gl")]


def flown(folder, radius_m, start_radii, speed_m_s, samples=10):
    """One observer past a ball from so many radii away, sampled so often on the way; it ends as far out on the other side."""
    directions, faces = geodesic_icosahedron(6)
    save_shape(ShapeModel(radius_m * directions, faces), folder / "ball.obj")
    to_arrival = 10.0 * round(start_radii * radius_m / speed_m_s / 10.0)
    scenario = {
        "name": "ball",
        "duration_s": 2 * to_arrival,
        "body": {
            "name": "Ball", "shape": str(folder / "ball.obj"), "radius_range_m": [0.5 * radius_m, 2.0 * radius_m],
            "gravity": {"model": "point_mass", "parameters": {"gm": 1e-7 * radius_m**3}},
            "rotation": {"pole_ra_deg": 0.0, "pole_dec_deg": 90.0, "w0_deg": 0.0, "w_rate_deg_per_day": 100.0},
        },
        "target": {"latitude_deg": 0.0, "longitude_deg": 90.0, "half_angle_deg": 20.0},
        "mothership": {"position_A_m": [0.0, 0.0, -start_radii * radius_m]},
        "design": {"visiting_points": [2], "imaging_altitude_m": 3.0 * radius_m, "time_of_flight_s": to_arrival},
        "behavior": {"name": "adaptable_roles", "imaging_radius_m": 6.0 * radius_m},
        "camera": {"half_angle_deg": 10.0, "resolution_px": 64},
        "physics": {"timestep_s": 0.5},
        "telemetry": {"interval_s": to_arrival / samples},
        "observation": {"interval_s": to_arrival / 10.0},
    }  # fmt: skip
    return sm.fly(sm.load(scenario))


def replay_of(flight):
    return Replay(flight.plan, flight.telemetry, flight.coverage.first_seen_s)


@pytest.mark.parametrize(
    ("radius_m", "start_radii", "speed_m_s"), [(50.0, 60.0, 5.0), (250.0, 20.0, 5.0), (10e3, 100.0, 1000.0)]
)
def test_the_body_is_in_the_first_the_middle_and_the_last_picture(tmp_path, radius_m, start_radii, speed_m_s):
    replay = replay_of(flown(tmp_path, radius_m, start_radii, speed_m_s))
    width = height = 480
    times = np.linspace(replay.times[0], replay.times[-1], 3)
    with Drawing(replay.plan, replay.path_N, width=width, height=height) as drawing:
        pictures = [drawing.draw(replay.at(t)) for t in times]
    view = overview(replay.plan, replay.path_N, 1.0)
    assert view.distance > 40.0 * radius_m or start_radii < 40.0  # else nothing could have been cut off
    right, up = view.offsets(np.zeros((1, 3)))[0]
    tangent = np.tan(np.radians(16.0))
    depth = view.distance + float(view.lookat @ view.toward)
    x, y = (0.5 * width + np.array([right, -up]) / (depth * tangent) * 0.5 * width).astype(int)
    half = max(1, int(0.4 * radius_m / (depth * tangent) * width))
    for shown in pictures:
        patch = shown[y - half : y + half + 1, x - half : x + half + 1].max(axis=-1)
        assert np.median(patch) > 8, "the sky stands where the body is"
    assert all(not np.array_equal(a, b) for a, b in pairwise(pictures))


@pytest.fixture(scope="module")
def far_flight(tmp_path_factory):
    """A body of 250 m passed at 50 m/s, 2,000 s after the release 100 km away, with a sample every 8 s."""
    return flown(tmp_path_factory.mktemp("far"), 250.0, 400.0, 50.0, samples=250)


@pytest.fixture(scope="module")
def far(far_flight):
    return replay_of(far_flight)


def test_a_film_of_a_long_flight_shows_the_encounter_and_names_the_speck(far, tmp_path, monkeypatch):
    replay, radius_m, arrival_s = far, 250.0, 2000.0
    begin, end = replay.encounter()
    # Within ten radii, at the arrival four, on a nearly straight path.
    speed = np.linalg.norm(replay.at(arrival_s + 1.0).r_BN_N - replay.at(arrival_s - 1.0).r_BN_N) / 2.0
    half = np.sqrt(10.0**2 - 4.0**2) * radius_m / speed
    assert begin == pytest.approx(arrival_s - half, abs=10.0) and end == pytest.approx(arrival_s + half, abs=10.0)

    whole = make_film(replay, tmp_path / "whole.mp4", size=(160, 120), fps=1.0, span_s=(None, None))
    facts = make_film(replay, tmp_path / "near.mp4", size=(160, 120), fps=1.0)
    assert whole.part_s is None or whole.part_s == (0.0, 4000.0)
    assert facts.part_s == (begin, end) and "--start, --end" in str(facts)
    # The body fills more of the picture than where all of the flight must fit.
    near = replay.between(begin, end)
    distances = [
        overview(part.plan, part.path_N, 1.0, (part.times[0], part.times[-1])).distance for part in (replay, near)
    ]
    assert distances[1] < 0.1 * distances[0]
    with Drawing(replay.plan, replay.path_N, width=480, height=480) as drawing:
        named = drawing.draw(replay.at(arrival_s))
        monkeypatch.setattr(picture, "SPECK", 0.0)
        assert not np.array_equal(named, drawing.draw(replay.at(arrival_s)))


def is_ground(picture):
    """Where bare ground is drawn, in the light and in the dark: nearly grey, neither sky nor words."""
    low, high = picture.min(axis=-1).astype(int), picture.max(axis=-1).astype(int)
    return (low > 20) & (high < 190) & (high - low < 30)


@pytest.mark.parametrize("camera", ["overview", "chase"])
def test_a_body_that_is_a_speck_is_shown_enlarged_and_spacecraft_stay_small(far, camera):
    side = 480
    with Drawing(far.plan, far.path_N, camera=camera, width=side, height=side) as drawing:
        pictures = [drawing.draw(far.at(t)) for t in (0.0, 1500.0, 2000.0, 4000.0)]
    # A disc of two thirds of a corner that is a third of the picture, or at the arrival the body itself.
    assert all(is_ground(shown).sum() > 0.6 * np.pi / 4 * (0.65 * 0.34 * side) ** 2 for shown in pictures)
    assert all((shown.max(axis=-1) > 8).mean() < 0.6 for shown in pictures), "spacecraft hide the picture"


def test_a_pass_between_a_few_samples_is_filmed_with_some_around_it(far_flight):
    plan, coverage = far_flight.plan, far_flight.coverage
    sparse = Replay(plan, far_flight.telemetry.isel(time=slice(None, None, 2)), coverage.first_seen_s)
    begin, end = sparse.encounter()
    assert begin < 2000.0 < end and 9 * 16.0 <= end - begin <= 11 * 16.0


def test_an_eros_flight_is_shown_whole_and_parts_without_samples_are_refused(replay):
    assert replay.encounter() is None
    part = replay.between(100.0, None)
    assert part.times[0] == 100.0 and part.times[-1] == replay.times[-1]
    assert np.array_equal(part.at(300.0).r_BN_N, replay.at(300.0).r_BN_N)
    with pytest.raises(OutputError, match=r"start 2000 s, end 1200 s: fewer than two samples .* from 0 to 1200 s"):
        replay.between(2000.0, None)
