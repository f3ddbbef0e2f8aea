"""Relations of the spacecraft designer: against closed forms, finite differences and numbers from elsewhere."""

import numpy as np
import pytest

from swarm_mj.ideas import sizing
from swarm_mj.scenarios.constants import AU
from swarm_mj.scenarios.coverage_relations import diffraction_altitude


def test_optics_follow_from_the_resolution():
    pixel = sizing.pixel_angle(0.1, 14_000.0, 1.0)
    assert pixel == pytest.approx(0.1 / 14_000.0)
    # The paper's 14 km are the altitude from which a lens of that size just resolves 0.1 m.
    lens = sizing.aperture(pixel, 550e-9)
    assert diffraction_altitude(0.1, aperture_m=lens, wavelength_m=550e-9) == pytest.approx(14_000.0)
    assert sizing.aperture(sizing.pixel_angle(0.1, 14_000.0, 1.4), 550e-9) == pytest.approx(1.4 * lens)
    # A pixel of 5.5 um behind that lens, seen from the ground: its width there.
    focal = sizing.focal_length(pixel, 5.5e-6)
    assert 5.5e-6 / focal * 14_000.0 == pytest.approx(0.1)
    assert sizing.optics_length(0.58, 0.095) == pytest.approx(0.176, rel=0.01)  # xScape100
    assert sizing.optics_length(0.05, 0.05) == pytest.approx(0.06)
    assert sizing.optics_mass(0.095) == pytest.approx(1.14, rel=0.01)


def test_the_ground_moves_by_a_pixel_in_the_longest_exposure():
    assert sizing.smear_exposure(2.0, 0.5, 50.0) * 50.0 == pytest.approx(0.5 * 2.0)


def test_no_fewer_pictures_than_area_over_footprint():
    assert sizing.pictures_needed(100.0, 10, 1.0) == 1 and sizing.pictures_needed(100.1, 10, 1.0) == 2
    assert sizing.pictures_needed(14.6e6, 4096, 0.1) == 88
    assert sizing.pictures_needed(1.0, 1024, 1000.0) == 1  # however small the target is


def test_lines_of_sight_turn_as_a_passage_makes_them():
    """Rate and acceleration by differences along a straight path."""
    speed, altitude = 60.0, 900.0
    t = np.linspace(-60.0, 60.0, 200_001)
    rate = np.gradient(np.arctan(speed * t / altitude), t)
    most = sizing.tracking(speed, altitude)
    assert rate.max() == pytest.approx(most[0], rel=1e-6)
    assert np.abs(np.gradient(rate, t)).max() == pytest.approx(most[1], rel=1e-5)


def test_turns_end_at_rest_where_they_should():
    """The torque given half the time forwards and half backwards, integrated."""
    inertia, angle, time = 0.08, np.pi, 90.0
    torque, momentum = sizing.turning(inertia, angle, time)
    t = np.linspace(0.0, time, 100_001)
    rate = np.cumsum(np.where(t < 0.5 * time, torque, -torque)) / inertia * (t[1] - t[0])
    assert rate[-1] == pytest.approx(0.0, abs=1e-4) and (rate * (t[1] - t[0])).sum() == pytest.approx(angle, rel=1e-4)
    assert inertia * rate.max() == pytest.approx(momentum, rel=1e-4)


def test_inertia_is_that_of_a_box():
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (200_000, 3)) * (0.1, 0.2263, 0.366)
    about = [8.0 * ((points**2).sum(axis=1) - points[:, k] ** 2).mean() for k in range(3)]
    assert sizing.box_inertia(8.0, (0.1, 0.2263, 0.366)) == pytest.approx(max(about), rel=0.01)


def test_the_rocket_equation_there_and_back():
    """Against a burn in small steps."""
    used = sizing.propellant(5.0, 200.0, 65.0)
    mass, speed = 5.0 + used, 0.0
    for _ in range(20_000):
        step = used / 20_000
        speed += 65.0 * 9.80665 * step / (mass - 0.5 * step)
        mass -= step
    assert mass == pytest.approx(5.0) and speed == pytest.approx(200.0, rel=1e-6)


def test_sunlight_and_heat_go_by_square_and_fourth_power():
    near, far = (sizing.panel_power(0.02, 0.3, k * AU, 0.8) for k in (1.0, 2.0))
    assert near == pytest.approx(0.02 * 0.3 * 0.8 * 1361.0) and far == pytest.approx(near / 4.0)
    cold, hot = (sizing.radiated_power((0.1, 0.1, 0.3), T, 0.8) for T in (200.0, 400.0))
    assert hot == pytest.approx(16.0 * cold)
    assert cold == pytest.approx(0.14 * 0.8 * 90.73, rel=1e-3)  # 90.7 W/m^2 of a black body of 200 K
