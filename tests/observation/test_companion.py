"""What a companion shades and hides of a sphere, against the overlap of two discs, and against segments tested face by face."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import swarm_mj as sm
from swarm_mj.flight.observe import camera_from, screen_of
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import camera_pose
from swarm_mj.observation.capture import causes, lit
from swarm_mj.observation.companion import Screen, Shade
from swarm_mj.observation.coverage import Cause
from swarm_mj.observation.observer import make_observer
from swarm_mj.observation.raycast import RayTracer
from swarm_mj.smallbody.occultation import segments_blocked
from swarm_mj.smallbody.shape_harmonics import build_ellipsoid
from tests.sample_missions.flights import mission

RADIUS, MOON = 400.0, 90.0


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return sm.load(mission("binary", tmp_path_factory.mktemp("binary"))).plan()


def overlap(apart):
    """Area that discs of both radii share when their centres are so far apart."""
    if apart >= RADIUS + MOON:
        return 0.0
    if apart <= RADIUS - MOON:
        return np.pi * MOON**2
    first = (apart**2 + RADIUS**2 - MOON**2) / (2.0 * apart)
    second = apart - first
    wide, narrow = (r**2 * np.arccos(x / r) - x * np.sqrt(r**2 - x**2) for r, x in ((RADIUS, first), (MOON, second)))
    return wide + narrow


@pytest.mark.parametrize("t", [0.0, 30.0, 50.0, 100.0, 250.0, 400.0, 470.0, 540.0, 900.0])
def test_the_eclipsed_share_of_sunlight_is_the_overlap_of_two_discs(plan, t):
    region, around = plan.region, plan.environment
    shade = screen_of(around).at(t)
    sun = around.C_AN(t) @ around.sun.at(t)
    sun /= np.linalg.norm(sun)
    tracer = RayTracer(region.vertices, region.faces)
    bright, less = lit(region, sun, tracer=tracer), lit(region, sun, tracer=tracer, shade=shade)
    assert not (less & ~bright).any()
    across = region.area * (region.normal_A @ sun)
    along = shade.centre_A @ sun
    expected = overlap(np.linalg.norm(shade.centre_A - along * sun)) if along > 0.0 else 0.0
    # A cell counts as dark by half of its samples; there are some 150 below the moon, and the mesh is inscribed.
    assert across[bright & ~less].sum() == pytest.approx(expected, abs=0.004 * np.pi * RADIUS**2)


def test_a_moon_behind_the_body_or_beside_the_sun_shades_nothing(plan):
    shade = screen_of(plan.environment).at(0.0)
    towards = shade.centre_A / np.linalg.norm(shade.centre_A)
    assert shade.may_shade(towards, RADIUS)
    assert not shade.may_shade(-towards, RADIUS)
    points = RADIUS * np.array([towards, -towards])
    assert shade.shades(points, towards).all()
    assert not shade.shades(points, -towards).any()


def test_points_are_hidden_as_segments_to_the_camera_meet_the_moons_mesh(plan):
    """Cameras before, beside, behind and far from the moon, and between it and the body."""
    region, companion = plan.region, plan.environment.companion
    shade = screen_of(plan.environment).at(600.0)
    points = region.centroid_A[::40]
    towards = shade.centre_A / np.linalg.norm(shade.centre_A)
    across = np.cross(towards, [0.0, 0.0, 1.0])
    found = 0
    for r_A in (5e3 * towards, 700.0 * towards, 2e3 * towards + 300.0 * across, -5e3 * towards, 2e3 * across):
        start, end = ((np.atleast_2d(p) - shade.centre_A) @ shade.C_2A.T for p in (points, r_A))
        faces = companion.shape.faces
        blocked = segments_blocked(start, np.broadcast_to(end, start.shape), companion.shape.vertices, faces, MOON)
        assert (shade.hides(points, r_A) == blocked).all()
        assert blocked.any() <= shade.may_hide(r_A, RADIUS)
        found += blocked.sum()
    assert found > 10


def test_only_what_lies_between_hides_even_right_beside_a_flat_moon():
    """Cameras and points inside the sphere around its mesh, before and behind it."""
    axes = np.array([110.0, 85.0, 60.0])
    shape = build_ellipsoid(tuple(axes), "flat moon", 8)
    turn = Rotation.from_euler("xyz", [0.3, -0.7, 1.1]).as_matrix()
    centre, rng = np.array([500.0, 200.0, -100.0]), np.random.default_rng(3)
    shade = Shade(RayTracer(shape.vertices, shape.faces), 110.0, centre, turn)

    def near(count):
        places = rng.uniform(-140.0, 140.0, (count, 3))
        return places[((places / axes) ** 2).sum(axis=1) > 1.02]

    ours, theirs = [], []
    for camera in near(60):
        points = near(200)
        ends = np.broadcast_to(camera, points.shape)
        theirs.append(segments_blocked(points, ends, shape.vertices, shape.faces, 110.0))
        ours.append(shade.hides(points @ turn + centre, camera @ turn + centre))
    found, expected = np.concatenate(ours), np.concatenate(theirs)
    assert 0.1 < expected.mean() < 0.6
    assert (found != expected).mean() < 2e-4  # single precision at an edge


@pytest.mark.parametrize("kind", ["raycast", "faceid", "horizon"])
def test_hidden_cells_and_shaded_ones_are_told_by_their_causes_whoever_observes(plan, kind):
    region, around, criterion = plan.region, plan.environment, plan.scenario.observation
    t, where = 600.0, plan.points_A[0]
    shade, sun = screen_of(around).at(t), around.C_AN(t) @ around.sun.at(t)
    z = -where / np.linalg.norm(where)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    pose = camera_pose(where, np.stack([x, np.cross(z, x), z]))
    try:
        observer = make_observer(region, camera_from(plan.scenario), kind=kind)
    except sm.SwarmError as error:
        pytest.skip(str(error))
    try:
        alone = causes(observer, pose, criterion, sun)
        beside = causes(observer, pose, criterion, sun, shade=shade)
    finally:
        observer.close()
    hidden = shade.hides(region.centroid_A, where)
    seen = alone == Cause.NONE
    whole = np.array([shade.hides(corners, where).all() for corners in region.corners_A])
    assert (beside[seen & whole] == Cause.HIDDEN).all() and (seen & whole).sum() > 50
    assert (beside[~hidden & (beside != alone)] == Cause.HIDDEN).sum() < 40  # cells at the moon's edge
    assert ((beside == alone) | (beside == Cause.HIDDEN)).all()


def test_a_picture_in_an_eclipse_tells_dark(plan):
    region, around, criterion = plan.region, plan.environment, plan.scenario.observation
    t = 250.0
    shade, sun = screen_of(around).at(t), around.C_AN(t) @ around.sun.at(t)
    z = -sun / np.linalg.norm(sun)
    x = np.cross([0.0, 0.0, 1.0], z) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], z))
    # From beside the moon, under the Sun.
    where = -1.1e3 * z + 700.0 * x
    z = -where / np.linalg.norm(where)
    x = np.cross([0.0, 0.0, 1.0], z) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], z))
    observer = make_observer(region, camera_from(plan.scenario.changed({"camera.half_angle_deg": 40})), kind="raycast")
    beside = causes(observer, camera_pose(where, np.stack([x, np.cross(z, x), z])), criterion, sun, shade=shade)
    shaded = shade.shades(region.centroid_A, sun / np.linalg.norm(sun)) & (region.normal_A @ sun > 0.0)
    assert (beside[shaded] == Cause.DARK).mean() > 0.8


def test_a_screen_stands_where_the_companion_does(plan):
    around, t = plan.environment, 321.0
    shade = Screen(around.companion, around).at(t)
    assert around.C_AN(t).T @ shade.centre_A == pytest.approx(around.companion.position(t))
    assert shade.C_2A @ around.C_AN(t) == pytest.approx(around.companion.C_AN(t))
    assert isinstance(plan.region, TargetRegion)
