"""Incidence, emission and phase against closed forms and against the observer's own incidence."""

import numpy as np
import pytest

from swarm_mj.figures.illumination import best_angles, cell_angles
from swarm_mj.figures.scene import scene_from
from swarm_mj.observation.capture import incidence

ARRIVAL = 120  # sample of the quick flight: 600 s at 5 s


def test_angles_of_a_level_cell_are_those_of_sun_and_spacecraft():
    origin, up = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    sun = 1e11 * np.array([np.sin(np.radians(30.0)), 0.0, np.cos(np.radians(30.0))])
    west = 1e4 * np.array([-np.sin(np.radians(20.0)), 0.0, np.cos(np.radians(20.0))])
    found = cell_angles(origin, up, sun, west)
    assert found.incidence[0] == pytest.approx(30.0)
    assert found.emission[0] == pytest.approx(20.0)
    assert found.phase[0] == pytest.approx(50.0)
    assert cell_angles(origin, up, -sun, west).incidence[0] == pytest.approx(150.0)


def test_incidence_is_the_observers(flown):
    plan, _, _ = flown
    sun_A = plan.environment.C_AN(600.0) @ plan.environment.sun.at(600.0)
    drawn = cell_angles(plan.region.centroid_A, plan.region.normal_A, sun_A, np.array([0.0, 2e4, 0.0])).incidence
    assert drawn == pytest.approx(np.degrees(incidence(plan.region, sun_A)), abs=1e-4)


def test_phase_obeys_the_spherical_triangle(flown):
    plan, telemetry, _ = flown
    scene = scene_from(plan, telemetry)
    sun_A = plan.environment.C_AN(600.0) @ plan.environment.sun.at(600.0)
    i, e, phase = cell_angles(plan.region.centroid_A, plan.region.normal_A, sun_A, scene.r_A[ARRIVAL, 0])
    assert (phase <= i + e + 1e-9).all()
    assert (phase >= np.abs(i - e) - 1e-9).all()


def test_maps_show_each_cell_as_the_spacecraft_that_looks_most_steeply(flown, composed):
    plan, telemetry, _ = flown
    region, scene = plan.region, scene_from(plan, telemetry)
    sun_A = plan.environment.C_AN(600.0) @ plan.environment.sun.at(600.0)
    best = best_angles(region, sun_A, scene.r_A[ARRIVAL])
    each = [cell_angles(region.centroid_A, region.normal_A, sun_A, r) for r in scene.r_A[ARRIVAL]]
    assert best.emission == pytest.approx(np.minimum(each[0].emission, each[1].emission))
    chosen = np.where(each[0].emission <= each[1].emission, each[0].phase, each[1].phase)
    assert best.phase == pytest.approx(chosen)
    maps = [ax for ax in composed["illumination"].axes if "mean" in ax.get_title(loc="left")]
    for ax, values in zip(maps, best, strict=True):
        assert np.asarray(ax.collections[0].get_array()) == pytest.approx(values)


def test_histories_at_the_arrival_are_the_means_over_the_target(flown, composed):
    plan, telemetry, _ = flown
    region, scene = plan.region, scene_from(plan, telemetry)
    sun_A = plan.environment.C_AN(600.0) @ plan.environment.sun.at(600.0)
    for j in range(plan.n):
        found = cell_angles(region.centroid_A, region.normal_A, sun_A, scene.r_A[ARRIVAL, j])
        for ax, values in zip(composed["illumination"].axes[1:3], (found.emission, found.phase), strict=True):
            x, y = ax.lines[j].get_data()
            assert np.interp(10.0, x, y) == pytest.approx(np.average(values, weights=region.area), abs=0.01)
