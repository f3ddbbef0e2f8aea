import numpy as np
import pytest

from swarm_mj.observation.capture import incidence, lit
from swarm_mj.observation.raycast import RayTracer

from .scenes import eros_target, ground_with_plate, on_ground


def test_incidence_on_flat_ground_is_the_sun_s_zenith_angle():
    region = ground_with_plate()
    angle = incidence(region, [3.0, 4.0, 0.0])[on_ground(region)]
    assert angle == pytest.approx(np.arctan2(3.0, 4.0))


def test_the_shadow_of_a_plate_under_the_zenith_is_the_plate():
    region = ground_with_plate()
    tracer = RayTracer(region.vertices, region.faces)
    dark = on_ground(region) & ~lit(region, [0.0, 1.0, 0.0], tracer=tracer)
    assert region.area[dark].sum() == pytest.approx(1.0, rel=0.03)
    assert np.linalg.norm(region.centroid_A[dark][:, [0, 2]], axis=1).max() < 0.75


def test_a_surface_does_not_shadow_itself():
    region = eros_target(600.0)
    tracer = RayTracer(region.vertices, region.faces)
    overhead = lit(region, [0.0, 1.0, 0.0], tracer=tracer)
    assert (overhead == lit(region, [0.0, 1.0, 0.0])).all()


def test_shadows_on_eros_only_take_light_away_and_embree_agrees_with_the_compiled_loop():
    region, sun = eros_target(), [-0.77, 0.64, 0.3]
    embree, compiled = (RayTracer(region.vertices, region.faces, use_embree=choice) for choice in (True, False))
    day, dark = lit(region, sun), lit(region, sun, tracer=embree)
    assert 0 < dark.sum() < day.sum()
    assert not (dark & ~day).any()
    assert (dark != lit(region, sun, tracer=compiled)).sum() <= 1


def test_the_incidence_limit_narrows_the_day():
    region = eros_target()
    sun = np.array([1.0, 1.0, 0.0])
    assert (lit(region, sun, max_incidence_deg=50.0) == (np.degrees(incidence(region, sun)) <= 50.0)).all()
