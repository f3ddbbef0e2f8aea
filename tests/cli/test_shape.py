"""The command `swarm-mj build-shape` and `load-shape`: sizes that small bodies keep, and advice in its own words."""

import pickle
import re

import numpy as np
import pytest
import yaml

from swarm_mj.cli.main import main
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.gravity import Polyhedron
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_check import BodySizeError, shown_size
from swarm_mj.smallbody.shape_io import save_shape


def ellipsoid(folder, *semi_axes_m):
    directions, faces = geodesic_icosahedron(6)
    save_shape(ShapeModel(directions * semi_axes_m, faces), folder / "body.obj")
    return str(folder / "body.obj")


@pytest.mark.parametrize(
    ("semi_axes_m", "words"),
    [
        ((300.0, 250.0, 200.0), ["0.06187 km^3", "0.7747 km^2", "300 m"]),
        ((88.0, 87.0, 58.0), ["0.001832 km^3", "0.07485 km^2", "88 m"]),
        ((17e3, 6e3, 5e3), ["2,104 km^3", "17 km"]),
    ],
)
def test_small_bodies_are_not_rounded_away(tmp_path, capsys, semi_axes_m, words):
    assert main(["load-shape", ellipsoid(tmp_path, *semi_axes_m)]) == 0
    said = capsys.readouterr().out
    assert all(word in said for word in words), said


@pytest.mark.parametrize(
    ("value", "power", "words"),
    [
        (23.4, 1, "23.4 m"),
        (1234.56, 1, "1.235 km"),
        (5140.2, 2, "5,140 m^2"),
        (15.5e3, 2, "0.0155 km^2"),
        (34149.6, 3, "34,150 m^3"),
        (62.7e6, 3, "0.0627 km^3"),
        (2.518154e12, 3, "2,518 km^3"),
    ],
)
def test_sizes_keep_four_digits_in_the_unit_that_fits(value, power, words):
    assert shown_size(value, power) == words


def test_a_file_in_metres_or_kilometres_is_asked_about_by_the_command_and_by_a_scenario(tmp_path, capsys):
    file = ellipsoid(tmp_path, 135.0, 60.0, 45.0)
    bare = "".join(line for line in open(file).readlines() if not line.startswith("#"))
    (tmp_path / "body.obj").write_text(bare)
    assert main(["load-shape", file]) == 2
    said = capsys.readouterr().err
    assert "give --unit km, or m if that is meant" in said
    assert main(["load-shape", file, "--unit", "km"]) == 0
    assert "135 km" in capsys.readouterr().out
    gravity = "body.gravity={model: point_mass, parameters: {gm: 1.98e8}}"
    given = [
        "--set",
        f"body.shape={file}",
        "--set",
        gravity,
        "--out",
        str(tmp_path / "out"),
        "--no-figures",
        "--no-report",
    ]
    assert main(["fly", "eros-quick", *given]) == 2
    assert "give body.shape_unit: km, or m if that is meant" in " ".join(capsys.readouterr().err.split())


def test_a_body_of_23_m_is_refused_in_the_words_of_the_command_and_taken_when_told(tmp_path, capsys):
    file = ellipsoid(tmp_path, 23.0, 20.0, 18.0)
    assert main(["load-shape", file]) == 2
    said = capsys.readouterr().err
    assert "--unit km" in said and "--radius-range LOW HIGH" in said and "expect_radius_m" not in said
    assert main(["load-shape", file, "--radius-range", "10", "40"]) == 0
    assert "34,150 m^3" in capsys.readouterr().out
    for wrong in (["40", "10"], ["nan", "40"], ["0", "40"]):
        assert main(["load-shape", file, "--radius-range", *wrong]) == 2
        assert "--radius-range" in capsys.readouterr().err


def test_a_size_error_survives_the_way_between_processes():
    error = BodySizeError("it lies 23 m from the origin", "km")
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    assert 'pass unit="km"' in str(error) and "1000" in str(error)


def test_fitted_harmonics_fly_as_the_polyhedron_does_and_their_errors_are_told(tmp_path, capsys):
    file, out = ellipsoid(tmp_path, 300.0, 200.0, 150.0), tmp_path / "gravity.yaml"
    assert main(["fit-harmonics", file, "--degree", "12", "--gm", "4.5", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "at 1 radii (300 m)" in said and "beyond the reference radius" in said
    written = yaml.safe_load(out.read_text())
    scenario = load_scenario("eros-quick", {"body": {"shape": file, "shape_unit": "m", "gravity": written}})
    shape = load_body_shape(scenario.body)
    field, body = environment_from(scenario, shape).gravity, Polyhedron(shape, gm=4.5)
    told = dict(re.findall(r"at (\S+) radii .* off by up to (\S+) of", said))
    for radii, most in told.items():
        r_A = float(radii) * 300.0 * geodesic_icosahedron(7)[0]
        true = body.sums(r_A)[:, 1:4]
        off = np.linalg.norm(field.acceleration(r_A) - true, axis=1) / np.linalg.norm(true, axis=1)
        assert off.max() == pytest.approx(float(most), rel=0.1, abs=1e-14)
    assert float(told["1"]) > 1e-4 > 1e-9 > float(told["5"])


def test_a_degree_that_cannot_be_fitted_is_refused(tmp_path, capsys):
    file = ellipsoid(tmp_path, 300.0, 200.0, 150.0)
    assert main(["fit-harmonics", file, "--degree", "61", "--density", "2000"]) == 2
    assert "--degree 61: must be from 2 to 60" in capsys.readouterr().err
