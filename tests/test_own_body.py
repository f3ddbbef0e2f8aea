"""Scenarios with a body of one's own: nothing of Eros is taken silently."""

import numpy as np
import pytest

from swarm_mj.cli.main import main
from swarm_mj.errors import ScenarioError, ShapeError
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_io import save_shape

GM, RADIUS_M, C20 = 2.0, 300.0, -0.05


@pytest.fixture
def own(tmp_path):
    """A function: the environment of an ellipsoid of 300 m with some gravity."""
    directions, faces = geodesic_icosahedron(4)
    save_shape(ShapeModel(directions * (300.0, 250.0, 200.0), faces), tmp_path / "mine.obj")

    def environment(gravity):
        scenario = load_scenario(
            "eros-quick", parse_overrides([f"body.shape={tmp_path / 'mine.obj'}", f"body.gravity={gravity}"])
        )
        return environment_from(scenario, load_body_shape(scenario.body))

    return environment


@pytest.mark.parametrize(
    "parameters",
    [
        "{}",
        "{coefficients: [[2, 0, -0.05, 0]]}",
        "{gm: 2.0, coefficients: [[2, 0, -0.05, 0]]}",
        "{gm: 2.0, reference_radius_m: 300}",
        "{gm: 2.0, reference_radius_m: 300, coefficients: null}",
        "{reference_radius_m: 300, coefficients: [[2, 0, -0.05, 0]]}",
    ],
)
def test_harmonics_of_a_body_of_ones_own_need_all_their_numbers(own, parameters):
    with pytest.raises(ScenarioError, match="needs gm, reference_radius_m and coefficients"):
        own(f"{{model: spherical_harmonics, parameters: {parameters}}}")


@pytest.mark.parametrize(("model", "words"), [("point_mass", "needs gm "), ("polyhedron", "needs gm or density_kg_m3")])
def test_the_other_fields_need_a_mass_of_their_own(own, model, words):
    with pytest.raises(ScenarioError, match=words):
        own(f"{{model: {model}}}")


def test_harmonics_that_are_given_whole_pull_as_they_should(own):
    coefficients = f"[[0, 0, 1, 0], [2, 0, {C20}, 0]]"
    field = own(
        f"{{model: spherical_harmonics, parameters: {{gm: {GM}, reference_radius_m: {RADIUS_M}, "
        f"coefficients: {coefficients}}}}}"
    ).gravity
    # On the pole U = GM/r (1 + sqrt(5) C20 (R/r)^2), so that the pull along z is -GM/r^2 (1 + 3 sqrt(5) C20 (R/r)^2).
    r = 900.0
    expected = -GM / r**2 * (1.0 + 3.0 * np.sqrt(5.0) * C20 * (RADIUS_M / r) ** 2)
    assert field.acceleration(np.array([[0.0, 0.0, r]]))[0, 2] == pytest.approx(expected, rel=1e-12)


def test_a_body_of_23_m_in_a_scenario_is_refused_in_the_words_of_the_scenario(tmp_path):
    directions, faces = geodesic_icosahedron(4)
    save_shape(ShapeModel(directions * 23.0, faces), tmp_path / "mine.obj")
    mine = [f"body.shape={tmp_path / 'mine.obj'}"]
    with pytest.raises(ShapeError) as refused:
        load_body_shape(load_scenario("eros-quick", parse_overrides(mine)).body)
    assert "body.shape_unit: km" in str(refused.value) and "body.radius_range_m: [" in str(refused.value)
    assert "expect_radius_m" not in str(refused.value)
    body = load_scenario("eros-quick", parse_overrides([*mine, "body.radius_range_m=[10, 40]"])).body
    assert load_body_shape(body).max_radius == pytest.approx(23.0)


def test_point_numbers_of_a_design_for_eros_are_not_taken_for_those_of_another_body_silently(tmp_path, capsys):
    directions, faces = geodesic_icosahedron(20)
    shape = ShapeModel(directions * (9000.0, 8000.0, 7000.0), faces)
    save_shape(shape, tmp_path / "mine.obj")
    (tmp_path / "mine.yaml").write_text(
        "name: mine\nbody: {shape: mine.obj, gravity: {model: point_mass, parameters: {gm: 280000}}}\n"
        "design: {reference: eros-visit}\nbehavior: {name: adaptable_roles}\nphysics: {timestep_s: 0.5}\n"
        "camera: {half_angle_deg: 4.1, resolution_px: 128}\nobservation: {criterion: arrival, interval_s: 600}\n"
    )
    out = ["--quiet", "--no-figures", "--no-report", "--out", str(tmp_path / "o")]
    assert main(["fly", str(tmp_path / "mine.yaml"), *out]) == 0
    said = capsys.readouterr().out
    area = f"body.area: 1,115 km^2 there, {shape.surface_area / 1e6:.4g} km^2 here"
    assert f"the proof of design eros-visit does not hold for this run: {area}" in said
    assert "its visiting points lie elsewhere, up to" in said
    assert "these are the values of 433 Eros: body.rotation (pole and spin), body.orbit (" in said
