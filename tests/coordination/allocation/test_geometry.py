"""Aims cover the target, pictures show what the criterion counts, and slews take the time that the wheels need."""

from functools import cache

import numpy as np
import pytest

from swarm_mj.coordination.allocation.geometry import (
    Agility,
    Patches,
    Track,
    agility_of,
    encounter_problem,
    following,
    patches_of,
    shown_cells,
    slew_slots,
)
from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.errors import MissionError
from swarm_mj.mission.target import build_target
from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.capture import ObservationCriterion, observe
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.observation.smear import smear_px
from swarm_mj.smallbody.shape_harmonics import build_ellipsoid
from swarm_mj.spacecraft.properties import SpacecraftProperties

CAMERA = CameraModel(half_angle_deg=3.0, shape="cone", exposure_s=0.01)
LIMITED = ObservationCriterion(max_gsd_m=0.35, max_emission_deg=60.0, max_incidence_deg=80.0, max_smear_px=1.0)


@cache
def target():
    shape = build_ellipsoid((600.0, 500.0, 400.0), "ball", frequency=12)
    return build_target(shape, latitude_deg=0, longitude_deg=90, half_angle_deg=35)


@cache
def track():
    """Three spacecraft that pass by in a row, four slots; the last is too far away for the resolution."""
    k = np.arange(4)[:, None]
    r_A = np.stack(
        [300.0 * (k - 1.5) + 150.0 * np.arange(3), 1500.0 + 800.0 * np.arange(3) + 0 * k, 0 * k + [0, 60, 0]], 2
    )
    v_A = np.broadcast_to([30.0, 0.0, 0.0], r_A.shape)
    return Track(r_A, v_A, np.repeat(np.eye(3)[None], 4, axis=0), np.tile([1.0, 1.0, 0.2], (4, 1)))


def test_groups_are_a_partition_within_the_radius():
    region = target()
    for radius in (60.0, 120.0, 1e6):
        patches = patches_of(region, radius)
        assert patches.area.sum() == pytest.approx(region.total_area)
        assert set(patches.of) == set(range(len(patches.aim_A)))
        for group, aim in enumerate(patches.aim_A):
            own = patches.of == group
            distance = np.linalg.norm(region.centroid_A[own][:, None] - region.centroid_A[own], axis=2)
            assert distance.max(axis=1).min() <= radius
            np.testing.assert_allclose(np.average(region.centroid_A[own], axis=0, weights=region.area[own]), aim)
    assert len(patches.aim_A) == 1
    with pytest.raises(MissionError, match="radius_m = 0"):
        patches_of(region, 0.0)


@pytest.mark.parametrize("criterion", [ObservationCriterion(), LIMITED], ids=["any", "limited"])
def test_a_picture_shows_what_counts_in_it(criterion):
    region, observer = target(), HorizonObserver(target(), CAMERA)
    patches = patches_of(region, 80.0)
    shows = shown_cells(observer, criterion, patches, track())
    for k in range(4):
        for a in range(3):
            for m, aim in enumerate(patches.aim_A):
                pose, v_A = look_at(track().r_A[k, a], aim), track().v_A[k, a]
                motion = following(aim - pose.r_A, v_A, pose.C_CA)
                seen = observe(observer, pose.r_A, pose.C_CA, criterion, track().sun_A[k], motion)
                if seen[patches.of == m].any():
                    np.testing.assert_array_equal(shows[a, m, k], seen)
                else:
                    assert not (shows[a, m, k] & ~seen).any()
    assert shows[0].any()
    assert criterion is not LIMITED or (not shows[2].any() and 0.1 < shows[0].any(axis=2).mean() < 0.9)


def test_a_camera_that_follows_its_aim_does_not_smear_it():
    region, pose = target(), look_at([300.0, 1500.0, 100.0], target().centroid_A[7])
    v_A = np.array([100.0, -20.0, 30.0])
    still = following(region.centroid_A[7] - pose.r_A, v_A, pose.C_CA)
    smear = smear_px(region, CAMERA, pose.r_A, pose.C_CA, still)
    fixed = smear_px(region, CAMERA, pose.r_A, pose.C_CA, still._replace(omega_C=np.zeros(3)))
    assert smear[7] < 1e-9 < 1.0 < fixed[7]


def test_slews_from_rest_to_rest_reach_their_angle_in_time():
    agility = Agility(0.05, 0.2, 3.0)
    for angle in (0.01, 0.3, 0.8, 0.81, 3.0):
        time = float(agility.slew_s(angle)) - 3.0
        t = np.linspace(0.0, time, 200_001)
        rate = np.minimum(np.minimum(0.05 * t, 0.05 * (time - t)), 0.2)  # the fastest that starts and ends at rest
        assert np.trapezoid(rate, t) == pytest.approx(angle, rel=1e-6)
    assert agility.slew_s(0.0) == 0.0


@pytest.mark.parametrize("layout", ["orthogonal", "orthogonal_and_skew", "pyramid"])
def test_wheels_can_turn_the_spacecraft_so_fast_about_any_axis(layout):
    properties, rng = SpacecraftProperties(wheel_layout=layout), np.random.default_rng(1)
    agility = agility_of(properties)
    axes = rng.normal(size=(20_000, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    needed = axes @ properties.inertia_effective_B @ np.linalg.pinv(properties.wheel_axes_B.T).T
    for limit, most in [
        (properties.max_wheel_torque, agility.acceleration),
        (properties.wheel_spin_inertia * properties.max_wheel_speed, agility.rate),
    ]:
        used = np.abs(needed).max() * most / limit
        assert 0.98 < used <= 1.0 + 1e-12
    half = agility_of(properties, settle_s=2.0, share=0.5)
    assert half == pytest.approx((0.5 * agility.acceleration, 0.5 * agility.rate, 2.0))
    with pytest.raises(MissionError, match="share = 0"):
        agility_of(properties, share=0.0)


def test_slots_between_pictures_are_those_of_the_slew_in_the_inertial_frame():
    # A camera at the origin and aims 0.2 rad apart. Fixed in N, a slew takes 2 sqrt(0.2 / 0.05) = 4 s.
    angle = np.array([0.0, 0.2])
    aims = Patches(np.arange(2), 1e3 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1), np.ones(2))
    still = np.repeat(np.eye(3)[None], 5, axis=0)
    zeros, usable = np.zeros((5, 1, 3)), np.ones((1, 2, 5), bool)
    agility = Agility(0.05, 1.0)

    def needed(C_AN, slot_s, usable=usable):
        return slew_slots(aims, Track(zeros, zeros, C_AN, zeros[:, 0]), agility, slot_s, usable)[0]

    for slot_s, slots in [(5.0, 1), (4.01, 1), (3.99, 2), (1.01, 4), (0.5, 5)]:
        assert needed(still, slot_s).tolist() == [[1, slots], [slots, 1]]
    # The body turns by 0.2 rad a slot about +z: the second aim is then where the first was, seen from N, or farther off.
    turn = 0.2 * np.arange(5)
    forward = still.copy()
    forward[:, 0, 0] = forward[:, 1, 1] = np.cos(turn)
    forward[:, 0, 1], forward[:, 1, 0] = np.sin(turn), -np.sin(turn)
    there, back = needed(forward, 4.5)[[0, 1], [1, 0]]
    assert back == 1 and there > 1
    assert needed(still, 0.5, usable & (np.arange(5) < 1)).max() == 1  # never both of use
    with pytest.raises(MissionError, match="slot_s = 0"):
        needed(still, 0.0)


def test_an_encounter_is_a_problem_by_cells_or_by_patches():
    observer, patches = HorizonObserver(target(), CAMERA), patches_of(target(), 80.0)
    given = (observer, ObservationCriterion(), patches, track(), Agility(0.05, 0.2))
    cells = encounter_problem(*given, slot_s=10.0, budget=2)
    whole = encounter_problem(*given, slot_s=10.0, budget=[1, 2, 0], each_cell=False)
    found = greedy(cells)
    assert 0.0 < found.value <= target().total_area and found.value == target().area[found.who >= 0].sum()
    assert whole.n_patches == len(patches.aim_A) and whole.budget.tolist() == [1, 2, 0]
    assert whole.coverable <= cells.coverable * (1 + 1e-12)
    a, m, k, p = (index[0] for index in np.nonzero(whole.shows))
    inside = (patches.of == p) & cells.shows.any(axis=(0, 1, 2))
    assert target().area[inside & cells.shows[a, m, k]].sum() >= 0.9 * target().area[inside].sum()
