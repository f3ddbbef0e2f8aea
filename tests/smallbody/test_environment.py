"""Everything that acts near the body, against finite differences of its rotation and sums of its parts."""

import numpy as np
import pytest

from swarm_mj.scenarios.constants import GM_SUN
from swarm_mj.smallbody.environment import Environment, LinearMotion
from swarm_mj.smallbody.perturbations import solar_radiation_pressure, solar_tide
from swarm_mj.smallbody.rotation import Rotation

R_N = np.array([[2e4, -3e4, 1e4], [5e3, 9e3, -4e4]])


class Lopsided:
    """A field that knows its axes: attraction along z of A alone, growing with x."""

    def acceleration(self, r_A):
        return np.column_stack([0.0 * r_A[:, 0], 0.0 * r_A[:, 0], 1e-6 * r_A[:, 0]])


@pytest.fixture
def environment():
    return Environment(
        gravity=Lopsided(),
        C_PN=Rotation().C_PN,
        phase0=0.7,
        spin_rate=3e-4,
        sun=LinearMotion(np.array([1.5e11, -4e10, 1e10]), np.array([-2e4, 1.5e4, 3e3])),
        earth=LinearMotion(np.array([3e10, 2e10, -1e10]), np.array([1e4, -5e3, 2e3])),
        solar_tide=True,
        srp_area_per_mass=0.02,
        srp_reflectivity=1.4,
    )


def test_sun_and_earth_move_on_straight_lines(environment):
    assert environment.sun.at(1000.0) == pytest.approx([1.5e11 - 2e7, -4e10 + 1.5e7, 1e10 + 3e6])
    assert (environment.earth.at(50.0) - environment.earth.at(-50.0)) / 100.0 == pytest.approx([1e4, -5e3, 2e3])


def test_the_angular_velocity_is_that_of_the_changing_attitude(environment):
    h, t = 1.0, 123.0
    rate = (environment.C_AN(t + h) - environment.C_AN(t - h)) / (2 * h)
    # C_NA' = [omega x] C_NA, all in N.
    tilde = rate.T @ environment.C_AN(t)
    assert environment.spin_N == pytest.approx([tilde[2, 1], tilde[0, 2], tilde[1, 0]], rel=1e-6)


def test_attraction_turns_with_the_body_and_the_rest_is_added(environment):
    t = 4000.0
    C_AN = environment.C_AN(t)
    along_z = 1e-6 * (R_N @ C_AN[0])[:, None] * C_AN[2]
    sun = environment.sun.position + t * environment.sun.velocity
    tide, push = solar_tide(R_N, sun, GM_SUN), solar_radiation_pressure(R_N, sun, 0.02, 1.0, 1.4)
    np.testing.assert_allclose(environment.acceleration_N(t, R_N), along_z + tide + push, rtol=1e-12)
    np.testing.assert_allclose(environment.perturbing_acceleration_N(t, R_N), tide + push, rtol=1e-12)
