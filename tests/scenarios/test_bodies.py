"""Packaged bodies: published sizes, gravity of the shape itself, and a body by its name alone in a scenario."""

import numpy as np
import pytest
import yaml

import swarm_mj as sm
from swarm_mj.errors import ScenarioError, ShapeError
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.scenarios.bodies import PACKAGED_SHAPES, packaged_bodies, packaged_body
from swarm_mj.scenarios.constants import LONGEST_EXTENT_M
from swarm_mj.scenarios.loading import parse_overrides
from swarm_mj.smallbody.gravity.polyhedron import Polyhedron
from swarm_mj.smallbody.shape_harmonics import BODIES, build_shape

#: Volume [m^3], its tolerance, and the longest extent [m], its tolerance, as published: Eros, NEAR (Thomas et al. 2002); Bennu,
#: OSIRIS-REx (Barnouin et al. 2019); Itokawa, Hayabusa (Fujiwara et al. 2006; Gaskell's model); Lutetia, an ellipsoid.
PUBLISHED = {
    "eros": (2.535e12, 0.02e12, 34_400.0, 1_800.0),
    "bennu": (6.15e7, 0.01e7, 565.0, 10.0),
    "itokawa": (1.773e7, 0.01e7, 535.0, 40.0),
    # In closed form: abc 4 pi / 3 times the mean of (0.3 + 0.7 u_x^2)^3; the mesh is inscribed.
    "dumbbell": (0.72e9 * 4.0 * np.pi / 3.0 * (0.027 + 0.063 + 0.0882 + 0.049), 3e6, 2000.0, 1.0),
    # Before the impact of DART: Barnouin et al. 2024 and Daly et al. 2024, ellipsoids.
    "didymos": (np.pi / 6.0 * 819.0 * 801.0 * 607.0, 1.5e6, 819.0, 2.0),
    "dimorphos": (np.pi / 6.0 * 179.0 * 169.0 * 115.0, 1.5e4, 179.0, 0.5),
    # Keller et al. 2010 and Duxbury et al. 2004, ellipsoids.
    "steins": (np.pi / 6.0 * 6670.0 * 5810.0 * 4470.0, 4e8, 6670.0, 15.0),
    "wild2": (4.0 * np.pi / 3.0 * 2750.0 * 2000.0 * 1650.0, 2e8, 5500.0, 15.0),
    "lutetia": (np.pi / 6.0 * 121e3 * 101e3 * 75e3, 3e12, 121e3, 300.0),
}


def scenario(body, *changes):
    return sm.load({"name": "own", "body": body}, parse_overrides(changes))


def test_the_shapes_that_scenarios_name_are_those_that_are_built_and_every_one_has_a_size():
    assert set(PACKAGED_SHAPES) == {*BODIES, "ellipsoid"}
    assert LONGEST_EXTENT_M.keys() == BODIES.keys()


def test_the_description_of_the_body_lists_the_packaged_ones():
    assert all(name in type(scenario("eros")).model_fields["body"].description for name in packaged_bodies())
    assert all(name in sm.explain("body.shape")["meaning"].item() for name in PACKAGED_SHAPES)


@pytest.fixture(scope="module", params=["bennu", "itokawa"])
def named(request):
    given = scenario(request.param)
    return request.param, given, load_body_shape(given.body)


@pytest.mark.parametrize("body", packaged_bodies())
def test_a_packaged_body_has_its_published_size(body):
    shape, (volume, error, extent, tolerance) = load_body_shape(scenario(body).body), PUBLISHED[body]
    assert shape.volume == pytest.approx(volume, abs=error)
    assert np.ptp(shape.vertices, axis=0).max() == pytest.approx(extent, abs=tolerance)
    assert LONGEST_EXTENT_M.get(body, extent) == pytest.approx(extent)
    assert len(shape.faces) == 8000


def test_the_harmonics_are_those_of_the_shape_with_constant_density(named):
    """Degrees 2 to 4 of the potential of the polyhedron, which is summed over faces and edges, at four radii and more."""
    _, given, shape = named
    field = environment_from(given, shape).gravity
    polyhedron = Polyhedron(shape, gm=given.body.gravity.parameters["gm"])
    directions = np.random.default_rng(0).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    r_A = 5.0 * shape.max_radius * directions
    central = given.body.gravity.parameters["gm"] / np.linalg.norm(r_A, axis=1)
    # Degree 1, by which the centre of figure lies off the centre of mass, is left out of the field: take it out of the other.
    offset = polyhedron.far_field
    first = np.sqrt(3.0) * (directions @ [offset.c[1, 1], offset.s[1, 1], offset.c[1, 0]]) * offset.reference_radius
    theirs = polyhedron.potential(r_A) / central - first / np.linalg.norm(r_A, axis=1)
    assert np.abs(field.potential(r_A) / central - theirs).max() < 0.01 * np.abs(theirs - 1.0).max()


def test_an_axis_of_the_density_is_plausible(named):
    name, given, shape = named
    density = given.body.gravity.parameters["gm"] / 6.6743e-11 / shape.volume
    assert density == pytest.approx({"bennu": 1190.0, "itokawa": 1950.0}[name], rel=0.03)


@pytest.mark.parametrize("body", packaged_bodies())
def test_a_name_stands_for_its_keys_and_a_single_one_can_be_changed(body):
    by_name, by_keys = scenario(body), scenario(packaged_body(body))
    assert by_name.body == by_keys.body
    changed = scenario(body, "body.name=Mine")
    assert changed.body.name == "Mine" and changed.body.gravity == by_name.body.gravity
    assert sm.load("eros-quick", parse_overrides([f"body={body}"])).body == by_name.body


def test_an_ellipsoid_by_its_axes_has_the_volume_of_an_ellipsoid():
    axes = [300.0, 200.0, 150.0]
    body = {"shape": "ellipsoid", "semi_axes_m": axes, "gravity": {"model": "polyhedron", "parameters": {"gm": 3.0}}}
    shape = load_body_shape(scenario(body).body)
    assert shape.volume == pytest.approx(4.0 / 3.0 * np.pi * np.prod(axes), rel=5e-3)
    assert np.allclose(((shape.vertices / axes) ** 2).sum(axis=1), 1.0)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (
            "benu",
            r"body = 'benu' is no packaged body: did you mean 'bennu'\? there are bennu, didymos, dimorphos, dumbbell",
        ),
        ({"shape": "ellipsoid"}, "the shape 'ellipsoid' needs semi_axes_m"),
        ({"semi_axes_m": [1, 2, 3]}, "no other shape takes them"),
        ({"shape": "ellipsoid", "semi_axes_m": [1, 2, 0]}, "semi_axes_m"),
    ],
)
def test_bodies_that_do_not_exist_are_refused(body, words):
    with pytest.raises(ScenarioError, match=words):
        scenario(body)


def test_no_other_body_can_be_built():
    with pytest.raises(ShapeError, match="'ida': no packaged body; there are eros, bennu, itokawa"):
        build_shape("ida")


def test_every_number_of_a_packaged_body_has_a_source():
    from importlib.resources import files

    for body in packaged_bodies():
        text = (files("swarm_mj.scenarios") / "bodies" / f"{body}.yaml").read_text("utf-8")
        sections = set(yaml.safe_load(text)) & {"shape", "gravity", "rotation", "orbit"}
        comments = sum(line.lstrip().startswith("#") for line in text.splitlines())
        assert comments >= len(sections), body
