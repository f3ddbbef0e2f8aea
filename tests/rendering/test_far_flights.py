"""Films show the body whatever its size and however far the flight begins: nothing is cut off by a clipping plane."""

from itertools import pairwise

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.rendering.cameras import overview
from swarm_mj.rendering.picture import Drawing
from swarm_mj.rendering.replay import Replay
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_io import save_obj

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("gl")]


def flown(folder, radius_m, start_radii, speed_m_s):
    """One observer past a ball from so many radii away; the flight ends as far out on the other side."""
    directions, faces = geodesic_icosahedron(6)
    save_obj(ShapeModel(radius_m * directions, faces), folder / "ball.obj")
    to_visit = 10.0 * round(start_radii * radius_m / speed_m_s / 10.0)
    scenario = {
        "name": "ball",
        "duration_s": 2 * to_visit,
        "body": {
            "name": "Ball", "shape": str(folder / "ball.obj"), "radius_range_m": [0.5 * radius_m, 2.0 * radius_m],
            "gravity": {"model": "point_mass", "parameters": {"gm": 1e-7 * radius_m**3}},
            "rotation": {"pole_ra_deg": 0.0, "pole_dec_deg": 90.0, "w0_deg": 0.0, "w_rate_deg_per_day": 100.0},
        },
        "target": {"latitude_deg": 0.0, "longitude_deg": 90.0, "half_angle_deg": 20.0},
        "mothership": {"position_A_m": [0.0, 0.0, -start_radii * radius_m]},
        "design": {"visiting_points": [2], "imaging_altitude_m": 3.0 * radius_m, "time_of_flight_s": to_visit},
        "behavior": {"name": "adaptable_roles", "imaging_radius_m": 6.0 * radius_m},
        "camera": {"half_angle_deg": 10.0, "resolution_px": 64},
        "physics": {"timestep_s": 0.5},
        "telemetry": {"interval_s": to_visit / 10.0},
        "observation": {"interval_s": to_visit / 10.0},
    }  # fmt: skip
    flight = sm.fly(sm.load(scenario))
    return Replay(flight.plan, flight.telemetry, flight.coverage.first_seen_s)


@pytest.mark.parametrize(
    ("radius_m", "start_radii", "speed_m_s"), [(50.0, 60.0, 5.0), (250.0, 20.0, 5.0), (10e3, 100.0, 1000.0)]
)
def test_the_body_is_in_the_first_the_middle_and_the_last_picture(tmp_path, radius_m, start_radii, speed_m_s):
    replay = flown(tmp_path, radius_m, start_radii, speed_m_s)
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
    for picture in pictures:
        patch = picture[y - half : y + half + 1, x - half : x + half + 1].max(axis=-1)
        assert np.median(patch) > 8, "the sky stands where the body is"
    assert all(not np.array_equal(a, b) for a, b in pairwise(pictures))
