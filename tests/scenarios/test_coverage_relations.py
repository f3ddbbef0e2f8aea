import numpy as np
import pytest

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.scenarios.coverage_relations import (
    diffraction_altitude,
    horizon_angle_deg,
    nadir_angle_deg,
)
from swarm_mj.scenarios.loading import load_scenario, parse_overrides


def test_ten_centimetres_give_the_altitude_and_nearly_the_half_angle_of_the_paper():
    altitude = diffraction_altitude(0.1)
    assert altitude == pytest.approx(14_000, rel=2e-3)
    assert nadir_angle_deg(20.0, altitude_m=altitude, body_radius_m=17_200.0) == pytest.approx(21.5, abs=0.15)


def test_the_lens_that_resolves_ten_centimetres_from_fourteen_kilometres_fits_a_cubesat():
    assert diffraction_altitude(0.1, aperture_m=0.09394) == pytest.approx(14e3, rel=1e-9)


@pytest.mark.parametrize("radius", [500.0, 7_000.0, 17_200.0])
@pytest.mark.parametrize("share_of_horizon", [0.1, 0.6, 1.0])
def test_the_nadir_angle_is_the_one_drawn_in_the_triangle(radius, share_of_horizon):
    altitude = 14e3
    central = share_of_horizon * (90.0 - horizon_angle_deg(altitude_m=altitude, body_radius_m=radius))
    camera = np.array([0.0, radius + altitude])
    ground = radius * np.array([np.sin(np.radians(central)), np.cos(np.radians(central))])
    sight = (ground - camera) / np.linalg.norm(ground - camera)
    drawn = np.degrees(np.arccos(-sight[1]))
    assert nadir_angle_deg(central, altitude_m=altitude, body_radius_m=radius) == pytest.approx(drawn, rel=1e-9)


def test_at_the_horizon_the_nadir_angle_is_the_horizon_angle():
    rho = horizon_angle_deg(altitude_m=14e3, body_radius_m=8.42e3)
    assert nadir_angle_deg(90.0 - rho, altitude_m=14e3, body_radius_m=8.42e3) == pytest.approx(rho, rel=1e-12)
    assert rho == pytest.approx(22.06, abs=0.01)


def test_the_table_of_spheres_in_the_docstring_is_right():
    for radius, expected in ((5841, 7.9), (8420, 11.2), (17200, 21.4), (17330, 21.5), (17714, 21.9)):
        assert nadir_angle_deg(20.0, altitude_m=14e3, body_radius_m=radius) == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: diffraction_altitude(0.0), "ground_resolution_m"),
        (lambda: diffraction_altitude(0.1, aperture_m=-1.0), "aperture_m"),
        (lambda: diffraction_altitude(0.1, wavelength_m=float("nan")), "wavelength_m"),
        (lambda: horizon_angle_deg(altitude_m=1.0, body_radius_m=0.0), "body_radius_m"),
        (lambda: nadir_angle_deg(80.0, altitude_m=14e3, body_radius_m=17e3), "horizon"),
    ],
)
def test_impossible_values_are_named(call, name):
    with pytest.raises(MissionError, match=name):
        call()


RESOLUTION = {"name": "asked", "camera": {"ground_resolution_m": 0.1}}


def test_a_scenario_that_states_the_ground_resolution_gets_altitude_and_half_angle():
    found = load_scenario(RESOLUTION)
    # Rayleigh by hand: 0.1 m x 0.094 m / (1.22 x 550 nm).
    assert found.design.imaging_altitude_m == pytest.approx(14_008.94, abs=0.01)
    # Triangle of camera, centre and the ground 20 deg aside on a sphere of 17.2 km.
    aside, below = 17_200 * np.sin(np.radians(20)), 17_200 * np.cos(np.radians(20))
    seen_at = np.degrees(np.arctan2(aside, 17_200 + found.design.imaging_altitude_m - below))
    assert found.camera.half_angle_deg == pytest.approx(seen_at, rel=1e-12)
    coarser = load_scenario(RESOLUTION, {"camera.ground_resolution_m": 0.2, "camera.aperture_m": 0.047})
    assert coarser.design.imaging_altitude_m == pytest.approx(found.design.imaging_altitude_m, rel=1e-14)


@pytest.mark.parametrize(
    ("body", "half_length_m"),
    [("bennu", 565 / 2), ("itokawa", 535 / 2), ("lutetia", 60_500.0), ("eros", 17_200.0)],
)
def test_the_half_angle_follows_from_the_longest_extent_of_packaged_bodies_and_ellipsoids(body, half_length_m):
    found = load_scenario({**RESOLUTION, "body": body})
    aside, below = half_length_m * np.sin(np.radians(20)), half_length_m * np.cos(np.radians(20))
    seen_at = np.degrees(np.arctan2(aside, half_length_m + found.design.imaging_altitude_m - below))
    assert found.camera.half_angle_deg == pytest.approx(seen_at, rel=1e-12)


def test_what_a_scenario_gives_itself_is_kept_and_reading_it_again_changes_nothing():
    given = load_scenario(RESOLUTION, {"design.imaging_altitude_m": 9000, "camera.half_angle_deg": 4.1})
    assert (given.design.imaging_altitude_m, given.camera.half_angle_deg) == (9000.0, 4.1)
    found = load_scenario(RESOLUTION)
    assert load_scenario(found.model_dump(mode="json")) == found
    assert load_scenario({"name": "plain"}).design.imaging_altitude_m == 14_000.0


@pytest.mark.parametrize(
    ("overrides", "named"),
    [
        (["design.imaging_altitude_m=14100"], "design.imaging_altitude_m = 14100: must be at most 14008.9"),
        (["design.imaging_altitude_m=14000", "camera.aperture_m=0.05"], "camera.aperture_m = 0.05"),
        (["body.shape=own.obj"], "camera.half_angle_deg: missing"),
        (["target.half_angle_deg=80"], "camera.half_angle_deg: missing, .* beyond the horizon"),
        (["camera.ground_resolution_m=0"], "camera.ground_resolution_m = 0"),
    ],
)
def test_a_ground_resolution_that_does_not_fit_is_refused_by_the_keys_to_change(overrides, named):
    with pytest.raises(ScenarioError, match=named):
        load_scenario(RESOLUTION, parse_overrides(overrides))
