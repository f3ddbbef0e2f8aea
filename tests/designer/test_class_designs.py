"""Designs for a quality class from the scenario to the flight."""

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.cli.tables import design_table
from swarm_mj.designer.candidates.visibility import visibility
from swarm_mj.designer.study import cover_problem
from swarm_mj.errors import ScenarioError
from swarm_mj.figures.design_figures import compose_cover
from swarm_mj.observation.quality import mapped
from swarm_mj.scenarios.loading import load_scenario

STEREO = {
    "observation.criterion": "passage",
    "observation.observer": "horizon",
    "observation.interval_s": 60,
    "camera.half_angle_deg": 4,
    "designer.population": 20,
    "designer.max_generations": 10,
}


@pytest.fixture(scope="module")
def design():
    return sm.design("eros-quick", {**STEREO, "designer.tolerance_percent": 3}, quality_class="stereo", workers=1)


def test_a_design_maps_at_its_class_what_the_rule_of_the_class_says_of_its_looks(design):
    study = design.study
    there = mapped(study.scenario.designed_class, study.visibility.looks, chosen_of(study))
    share = 100.0 * study.visibility.area[there].sum() / study.visibility.area.sum()
    assert design.covered_percent == pytest.approx(share, abs=1e-5)
    assert 97.0 <= share < design.record["seen_percent"]
    assert design.proven and design.n_observers >= 2
    assert {"quality_class", "mappable_percent", "not_mappable"} <= set(design.record)


def chosen_of(study):
    return np.isin(np.arange(len(study.visibility.candidates)), study.selected - 1)


def test_table_and_picture_of_a_design_name_its_class(design):
    assert "mapped at class stereo" in str(design_table(design.record).caption)
    figure = compose_cover(design.study)
    assert "class stereo" in figure.get_suptitle()
    assert {text.get_text() for text in figure.legends[0].get_texts()} >= {"mapped", "visited point"}


def test_the_flight_of_a_design_maps_at_its_class_what_was_promised(design):
    flight = sm.fly(design.to_scenario(), figures=False, report=False)
    assert flight.summary["classes"]["stereo"]["percent"] >= design.covered_percent - 1.0


def test_a_tolerance_below_what_can_be_mapped_is_refused_with_the_demands_that_fail():
    scenario = load_scenario("eros-quick", {**STEREO, "designer.quality_class": "shape"})
    problem = cover_problem(scenario, visibility(scenario, workers=1))
    assert sum(problem.causes().values()) == pytest.approx(100.0 - problem.coverable_percent, abs=1e-6)
    with pytest.raises(sm.SwarmError, match=r"at class shape, 99\.9 % is asked for.*lack looks within the limits"):
        problem.require_coverable()


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"designer.quality_class": "sharp"}, "must be one of seen, resolved, stereo, shape"),
        ({"designer.quality_class": "stereo", "designer.fold": 2}, "must be 1 with designer.quality_class"),
        ({"designer.quality_class": "stereo", "designer.deliver_within_h": 1}, "must be null with"),
    ],
)
def test_what_goes_not_with_a_class_is_refused(overrides, words):
    with pytest.raises(ScenarioError, match=words):
        load_scenario("eros-quick", overrides)
