"""Radio links: range, beams and occultation, each against a case that can be drawn on paper."""

import numpy as np
import pytest
import trimesh

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import Antennas, Obstacle, links_closed, obstacle_between
from swarm_mj.smallbody.occultation import occluder_of, segments_blocked
from swarm_mj.smallbody.shape import ShapeModel

EARTH = np.array([[1.5e11, 0.0, 0.0]])


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=8e3)
    return ShapeModel(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32), "ball")


def along(z):
    """An attitude C_BN with +z along a direction in N."""
    z = np.asarray(z, float) / np.linalg.norm(z)
    x = np.cross([0.3, 0.5, 0.8], z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def closed(ball, r_talker, r_relay, z_talker, z_relay=(1, 0, 0), **changes):
    """Link states of a talker (number 1) that tracks a relay (number 0) that tracks Earth."""
    antennas = Antennas(
        **{
            "dish_half_angle": np.radians(5.0),
            "hemispherical_boresight_B": np.array([0.0, 0.0, 1.0]),
            "hemispherical_half_angle": np.pi / 2,
            "max_range": 50e3,
            **changes,
        }
    )
    return links_closed(
        antennas=antennas,
        shape=ball,
        mode=np.array([[TargetKind.EARTH, TargetKind.SPACECRAFT]], np.int8),
        tracked=np.array([[-1, 0]], np.int16),
        r_BN_N=np.array([[r_relay, r_talker]], float),
        C_BN=np.array([[along(z_relay), along(z_talker)]]),
        C_AN=np.eye(3)[None],
        earth_N=EARTH,
    )[0].tolist()


def test_a_link_in_range_with_both_antennas_pointed_is_closed(ball):
    assert closed(ball, (30e3, 20e3, 0), (20e3, 20e3, 0), (-1, 0, 0)) == [True, True]


def test_a_dish_off_by_more_than_its_beam_loses_the_link(ball):
    off = np.radians(5.1)
    z = (-np.cos(off), np.sin(off), 0)
    assert closed(ball, (30e3, 20e3, 0), (20e3, 20e3, 0), z) == [True, False]
    near = np.radians(4.9)
    assert closed(ball, (30e3, 20e3, 0), (20e3, 20e3, 0), (-np.cos(near), np.sin(near), 0)) == [True, True]


def test_a_talker_behind_the_relays_hemisphere_is_not_heard(ball):
    assert closed(ball, (10e3, 20e3, 0), (20e3, 20e3, 0), (1, 0, 0)) == [True, False]
    assert closed(ball, (10e3, 20e3, 0), (20e3, 20e3, 0), (1, 0, 0), hemispherical_half_angle=np.pi) == [True, True]


def test_omnidirectional_ends_hear_each_other_however_they_are_turned(ball):
    away = {"z_talker": (0, 0, 1), "z_relay": (1, 0, 0)}
    assert closed(ball, (10e3, 20e3, 0), (20e3, 20e3, 0), **away) == [True, False]
    assert closed(ball, (10e3, 20e3, 0), (20e3, 20e3, 0), **away, omnidirectional=True) == [True, True]
    assert closed(ball, (71e3, 20e3, 0), (20e3, 20e3, 0), **away, omnidirectional=True) == [True, False]  # too far
    assert closed(ball, (-20e3, 1e3, 0), (20e3, 0, 0), **away, omnidirectional=True) == [True, False]  # behind the body


def test_what_is_in_the_way_is_named(ball):
    def named(r_talker, r_relay, z_talker, **changes):
        given = {"dish_half_angle": 0.1, "hemispherical_boresight_B": np.array([0.0, 0.0, 1.0])}
        antennas = Antennas(**given, hemispherical_half_angle=np.pi / 2, **{"max_range": 50e3, **changes})
        r_N, C_BN = np.array([r_relay, r_talker], float), np.array([along((1, 0, 0)), along(z_talker)])
        return Obstacle(obstacle_between(antennas, occluder_of(ball), r_N, C_BN, np.eye(3), 1, 0))

    assert named((30e3, 20e3, 0), (20e3, 20e3, 0), (-1, 0, 0)) is Obstacle.NONE
    assert named((30e3, 20e3, 0), (20e3, 20e3, 0), (0, 1, 0)) is Obstacle.BEAM
    assert named((10e3, 20e3, 0), (20e3, 20e3, 0), (1, 0, 0)) is Obstacle.BEAM  # behind the relay's hemisphere
    assert named((71e3, 20e3, 0), (20e3, 20e3, 0), (-1, 0, 0)) is Obstacle.RANGE
    assert named((20e3, 0, 0), (-20e3, 1e3, 0), (-40, 1, 0)) is Obstacle.BODY


def test_a_link_longer_than_its_range_is_open(ball):
    assert closed(ball, (71e3, 20e3, 0), (20e3, 20e3, 0), (-1, 0, 0)) == [True, False]


def test_the_asteroid_hides_the_relay_from_the_talker_and_earth_from_the_relay(ball):
    assert closed(ball, (20e3, 0, 0), (-20e3, 1e3, 0), (-40, 1, 0)) == [False, False]


def test_earth_is_lost_when_the_relay_points_elsewhere(ball):
    assert closed(ball, (30e3, 20e3, 0), (20e3, 20e3, 0), (-1, 0, 0), z_relay=(1, 0.2, 0))[0] is False


def test_blocked_segments_agree_with_a_sphere(ball):
    rng = np.random.default_rng(1)
    start, end = rng.normal(size=(2, 400, 3)) * 15e3
    keep = (np.linalg.norm(start, axis=1) > 8.1e3) & (np.linalg.norm(end, axis=1) > 8.1e3)
    start, end = start[keep], end[keep]
    d = end - start
    s = np.clip(-(start * d).sum(1) / (d * d).sum(1), 0, 1)
    nearest = np.linalg.norm(start + s[:, None] * d, axis=1)
    blocked = segments_blocked(start, end, ball.vertices, ball.faces, ball.max_radius)
    assert blocked[nearest < 7.9e3].all()
    assert not blocked[nearest > 8.001e3].any()
    assert 50 < blocked.sum() < len(blocked) - 50
