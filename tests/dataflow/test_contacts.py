"""Contacts: capacities by range, role, beam and occultation, each against a case that can be drawn on paper."""

import numpy as np
import pytest
import trimesh

from swarm_mj.dataflow.contacts import Instants, Radios, find_contacts, samples_of
from swarm_mj.dataflow.ground import EarthSchedule
from swarm_mj.dataflow.link_budget import RateTable
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import Antennas, Obstacle
from swarm_mj.smallbody.occultation import occluder_of
from swarm_mj.smallbody.shape import ShapeModel

EARTH_N = np.array([1.5e11, 0.0, 0.0])
#: 100 bit/s up to 10 km, 10 bit/s up to 40 km; Earth hears 8 bit/s by one station and 2 by the other.
SWARM = RateTable(np.array([10e3, 40e3]), np.array([100.0, 10.0]))
EARTH = RateTable(np.full((2, 1), 2e11), np.array([[2.0], [8.0]]))
ALONG_X = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # +z of B along x of N: to Earth


@pytest.fixture(scope="module")
def body():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=1e3)
    return occluder_of(ShapeModel(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32), "ball"))


def contacts(body, r_N, *, omnidirectional=True, mode=None, tracked=None, works=None, station=1, slots=1):
    """Contacts of a swarm that stands still for some slots of 10 s, looked at twice in each."""
    r_N, n = np.asarray(r_N, float), len(r_N)
    edges_s = 10.0 * np.arange(slots + 1)
    t = samples_of(edges_s, 2).ravel()
    m = len(t)
    antennas = Antennas(
        dish_half_angle=0.1,
        hemispherical_boresight_B=np.array([0.0, 0.0, -1.0]),
        hemispherical_half_angle=np.pi / 2,
        max_range=1e9,
        omnidirectional=omnidirectional,
    )
    mode = [TargetKind.EARTH] + [TargetKind.SPACECRAFT] * (n - 1) if mode is None else mode
    instants = Instants(
        t=t,
        r_BN_N=np.tile(r_N, (m, 1, 1)),
        C_BN=np.tile(ALONG_X, (m, n, 1, 1)),
        C_AN=np.tile(np.eye(3), (m, 1, 1)),
        earth_N=np.tile(EARTH_N, (m, 1)),
        mode=np.tile(np.array(mode, np.int64), (m, 1)),
        tracked=np.tile(np.array([-1] + [0] * (n - 1) if tracked is None else tracked, np.int64), (m, 1)),
        works=np.ones((m, n), bool) if works is None else np.asarray(works, bool),
    )
    return find_contacts(
        edges_s,
        instants,
        radios=Radios(antennas, SWARM, EARTH),
        body=body,
        heard=EarthSchedule(np.full(m, station), np.full(m, 500.0)),
    )


def test_capacity_is_rate_by_range_times_time(body):
    found = contacts(body, [(20e3, 0, 0), (25e3, 0, 0), (20e3, 30e3, 0), (20e3, -60e3, 0)])
    assert found.swarm_bit[0, 1, 0] == found.swarm_bit[0, 0, 1] == 1000  # 5 km
    assert found.swarm_bit[0, 2, 0] == 100  # 30 km
    assert found.swarm_bit[0, 3, 0] == 0 and found.why_swarm[0, 3, 0] == Obstacle.RANGE  # 60 km
    assert found.distance_m[0, 2, 0] == pytest.approx(30e3)
    assert not found.swarm_bit[0].diagonal().any()


def test_the_body_hides_one_from_the_other_and_from_earth(body):
    found = contacts(body, [(5e3, 0, 0), (-3e3, 0, 0)], mode=[TargetKind.EARTH] * 2)
    assert found.swarm_bit[0, 1, 0] == 0 and found.why_swarm[0, 1, 0] == Obstacle.BODY
    assert found.earth_bit[0].tolist() == [80, 0] and found.why_earth[0].tolist() == [Obstacle.NONE, Obstacle.BODY]


def test_the_station_that_is_up_hears_who_turns_to_earth(body):
    place = [(20e3, 0, 0), (25e3, 0, 0)]
    found = contacts(body, place)
    assert found.earth_bit[0].tolist() == [80, 0] and found.station[0].tolist() == [1, -1]
    assert found.why_earth[0, 1] == Obstacle.ROLE
    found = contacts(body, place, station=0)
    assert found.earth_bit[0].tolist() == [20, 0] and found.station[0, 0] == 0
    found = contacts(body, place, station=-1)
    assert found.earth_bit[0].tolist() == [0, 0] and found.why_earth[0, 0] == Obstacle.STATION


def test_directed_antennas_ask_for_role_dish_and_hemisphere(body):
    # The relay's hemisphere opens away from Earth: it hears who is behind it and points at it.
    place = [(20e3, 0, 0), (15e3, 0, 0), (25e3, 0, 0)]
    found = contacts(body, place, omnidirectional=False)
    assert found.swarm_bit[0, 1, 0] == 1000
    assert found.swarm_bit[0, 2, 0] == 0 and found.why_swarm[0, 2, 0] == Obstacle.BEAM
    assert found.swarm_bit[0, 1, 2] == 0 and found.why_swarm[0, 1, 2] == Obstacle.ROLE
    assert found.swarm_bit[0, 0].tolist() == [0, 0, 0]


def test_who_works_for_half_a_slot_sends_half(body):
    works = [[True, True], [True, False], [True, False], [True, False]]
    found = contacts(body, [(20e3, 0, 0), (25e3, 0, 0)], works=works, slots=2)
    assert found.swarm_bit[:, 1, 0].tolist() == [500, 0]
    assert found.peak_bit[:, 1, 0].tolist() == [1000, 0]
    assert found.why_swarm[1, 1, 0] == Obstacle.LOST


def test_instants_stand_in_the_middles_of_equal_parts():
    assert samples_of(np.array([0.0, 10.0, 30.0]), 2).tolist() == [[2.5, 7.5], [15.0, 25.0]]
