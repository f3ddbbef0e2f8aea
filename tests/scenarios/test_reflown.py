"""Encounters that were flown: posed in few lines, and as planned the straight lines that their published numbers make."""

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.scenarios.loading import load_scenario, packaged

reflown = pytest.importorskip("scripts.pages.reflown")
NAMES = [encounter.scenario for encounter in reflown.ENCOUNTERS]


@pytest.mark.parametrize("name", NAMES)
def test_an_encounter_is_posed_in_at_most_25_lines(name):
    lines = packaged(name).splitlines()
    assert len([line for line in lines if line.strip() and not line.lstrip().startswith("#")]) <= 25


@pytest.mark.parametrize("name", NAMES)
def test_the_planned_path_is_the_straight_line_of_the_published_numbers(name):
    """Phase within 0.3 deg all the way, distance within a thousandth, by the page's second witness."""
    plan = sm.load(name).plan()
    asked = load_scenario(name).initial_states[0].approach
    since = np.linspace(0.0, plan.scenario.duration_s, 61) - asked.closest_after(plan.scenario.epoch)
    r0, v0 = plan.deployment.release_r_N[0], plan.deployment.v0_N[0]
    r = r0 + v0 * (since - since[0])[:, None]
    sun = np.array([plan.environment.sun.at(t - since[0]) for t in since])
    phase = np.arccos(np.einsum("ij,ij->i", r, sun) / np.linalg.norm(r, axis=1) / np.linalg.norm(sun, axis=1))
    line = reflown.straight_phase(
        asked.phase.approach_deg, asked.phase.least_deg, asked.distance_m, asked.v_infinity_m_s, since
    )
    assert np.degrees(np.abs(phase - line)).max() < 0.3
    assert np.linalg.norm(r, axis=1) == pytest.approx(
        np.hypot(asked.distance_m, asked.v_infinity_m_s * since), rel=1e-3
    )


def test_a_row_fits_by_its_tolerance_alone():
    row = reflown.Row("x", "source", 10.0, 10.4, 0.5, "last digit", otherwise="why")
    assert row.fits and row.line().endswith("| fits |") and "+0.4" in row.line()
    assert not row._replace(ours=10.6).fits and row._replace(ours=10.6).line().endswith("**does not fit**: why |")
