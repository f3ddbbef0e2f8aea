"""Transfers in parts, where shooting in one does not find them: against another integrator and closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarm_mj.errors import MissionError
from swarm_mj.mission.deployment import deploy
from swarm_mj.mission.multiple_shooting import shoot_in_parts
from swarm_mj.mission.trajectories import solve_transfers

#: Gravitational parameters of Bennu and of Eros [m^3/s^2].
BENNU, EROS = 4.89, 4.46e5
CASES = {
    "half a day about Bennu": (BENNU, [1000.0, 0.0, 0.0], [-600.0, 300.0, 50.0], 43_200.0),
    "six hours about Bennu, nearly opposite": (BENNU, [1000.0, 0.0, 0.0], [-600.0, 300.0, 50.0], 21_600.0),
    "deep round Eros": (EROS, [-40e3, 0.0, 0.0], [18e3, 9e3, 1e3], 20_000.0),
}


def kepler(gm):
    return lambda t, r: -gm * r / np.linalg.norm(r, axis=1, keepdims=True) ** 3


@pytest.mark.parametrize("case", CASES)
def test_parts_find_what_shooting_in_one_does_not(case):
    gm, start, end, time = CASES[case]
    r0, destination = np.array(start), np.array(end)
    with pytest.raises(MissionError):
        solve_transfers(kepler(gm), r0, destination[None], time)
    v0, miss = shoot_in_parts(kepler(gm), r0, destination, time)
    assert miss < 1e-4

    def rates(t, y):
        return np.concatenate((y[3:], -gm * y[:3] / np.linalg.norm(y[:3]) ** 3))

    flown = solve_ivp(rates, (0.0, time), np.concatenate((r0, v0)), method="LSODA", rtol=1e-12, atol=1e-9)
    assert np.linalg.norm(flown.y[:3, -1] - destination) < 0.01


def test_parts_and_one_agree_where_both_find_it():
    r0, destination = np.array([25e3, 3e3, -4e3]), np.array([8e3, 24e3, 1e3])
    together, _ = solve_transfers(kepler(EROS), r0, destination[None], 4000.0)
    assert np.allclose(shoot_in_parts(kepler(EROS), r0, destination, 4000.0)[0], together[0], atol=1e-8)


def test_where_there_is_no_way_nothing_is_found():
    def beyond_ten_kilometres(t, r):
        return np.where(np.linalg.norm(r, axis=1, keepdims=True) > 1e4, np.nan, 0.0 * r)

    assert shoot_in_parts(beyond_ten_kilometres, np.zeros(3), np.array([5e5, 0.0, 0.0]), 3.0) is None


class Still:
    """A body that does not turn."""

    def __init__(self, gm):
        self.acceleration_N = kepler(gm)

    def C_AN(self, t):
        return np.eye(3)


def test_a_deployment_falls_back_on_parts_and_keeps_the_others():
    gm, start, end, time = CASES["half a day about Bennu"]
    points = np.array([end, [900.0, 450.0, 0.0]])
    found = deploy(
        Still(gm),
        mothership_N=np.array(start),
        mothership_velocity=np.zeros(3),
        points_A=points,
        release_s=np.zeros(2),
        time_of_flight=np.array([time, 600.0]),
    )
    assert found.miss_m.max() < 1e-4
    alone, _ = solve_transfers(kepler(gm), np.array(start), points[1:], 600.0)
    assert np.array_equal(found.v0_N[1:], alone)


def growing(t, r):
    """A force that grows with time, whose flights are cubic in time."""
    return np.broadcast_to([2e-3 * t, 0.0, 0.0], r.shape)


def test_parts_and_later_releases_know_the_time_of_the_forces():
    r0, destination, time = np.array([9e3, 0.0, 0.0]), np.array([8e3, 2e3, 1e3]), 60.0
    straight = (destination - r0) / time
    bent = np.array([2e-3 * time**2 / 6.0, 0.0, 0.0])
    v0, _ = shoot_in_parts(growing, r0, destination, time)
    assert np.allclose(v0, straight - bent, atol=1e-6)
    body, release = Still(1.0), 100.0
    body.acceleration_N = growing
    found = deploy(
        body,
        mothership_N=r0,
        mothership_velocity=np.zeros(3),
        points_A=destination[None],
        release_s=np.array([release]),
        time_of_flight=np.array([time]),
    )
    coasted = r0 + np.array([2e-3 * release**3 / 6.0, 0.0, 0.0])
    assert np.allclose(found.release_r_N[0], coasted, atol=1e-6)
    expected = (destination - coasted) / time - bent - np.array([2e-3 * release * time / 2.0, 0.0, 0.0])
    assert np.allclose(found.v0_N[0], expected, atol=1e-6)
