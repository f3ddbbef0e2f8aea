"""Any mesh file is read as a closed body or refused; any body that is accepted can be flown past, or is refused."""

import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_mj.errors import ShapeError, SwarmError
from swarm_mj.smallbody import mesh_files, shape_check
from swarm_mj.smallbody.shape_check import check_shape
from swarm_mj.smallbody.shape_io import load_shape

from .hostile_scenarios import BASE, changed
from .limits import bounded, examples
from .mesh_files import FORMS, as_obj, ball, spoiled
from .test_scenarios import flown, scenario_from

pytestmark = pytest.mark.robust


def unit_of(ending):
    """Of the ball, which is so small that it is asked for."""
    return "km" if ending == "tab" else "m"


@pytest.mark.parametrize("form", FORMS)
def test_the_unspoiled_files_are_the_same_ball(tmp_path, form):
    ending, content = FORMS[form]
    (tmp_path / f"ball.{ending}").write_bytes(content)
    vertices, faces = ball()
    read = load_shape(tmp_path / f"ball.{ending}", unit=unit_of(ending))
    assert read.volume == pytest.approx(check_shape(vertices, faces).volume, rel=1e-6)


@pytest.mark.parametrize("form", FORMS)
@examples(300)
@given(data=st.data())
def test_any_mesh_file_is_a_closed_body_or_refused(tmp_path_factory, form, data):
    ending, content = FORMS[form]
    path = tmp_path_factory.getbasetemp() / f"fuzzed.{ending}"
    path.write_bytes(data.draw(spoiled(content)))
    with bounded():
        try:
            shape = load_shape(path, unit=unit_of(ending))
        except ShapeError as error:
            assert "fuzzed" in str(error)
            return
    assert np.isfinite(shape.vertices).all()
    assert 0.0 < shape.volume < np.inf
    edges = np.sort(shape.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


@examples(20)
@given(
    seed=st.integers(0, 2**32 - 1),
    roughness=st.sampled_from([0.0, 0.1, 0.5, 1.5]),
    radius=st.sampled_from([60.0, 5e3, 1e5, 1e6]),
    model=st.sampled_from(["point_mass", "polyhedron"]),
)
def test_any_body_is_flown_past_or_refused(tmp_path_factory, seed, roughness, radius, model):
    vertices, faces = ball(3, radius)
    vertices = vertices * np.exp(roughness * np.random.default_rng(seed).normal(size=(len(vertices), 1)))
    path = tmp_path_factory.getbasetemp() / "body.obj"
    path.write_bytes(as_obj(vertices, faces))
    # A body of 2,000 kg/m^3.
    parameters = {"density_kg_m3": 2000.0} if model == "polyhedron" else {"gm": 5.6e-7 * radius**3}
    gravity = {"model": model, "parameters": parameters}
    changes = {
        ("body",): {"shape": str(path), "shape_unit": "m", "gravity": gravity},
        ("mothership", "position_A_m"): [0.0, 0.0, -4.0 * radius],
        ("design", "imaging_altitude_m"): radius,
        ("design", "visiting_points"): [1],
        ("behavior", "imaging_radius_m"): 5.0 * radius,
    }
    with bounded():
        try:
            telemetry, summary = flown(scenario_from(changed(BASE, changes.items())))
        except SwarmError as error:
            assert str(error).strip()
            return
    assert np.isfinite(telemetry["r_BN_N"].values).all()
    assert 0.0 <= summary["coverage_percent"] <= 100.0 + 1e-6


def test_a_text_stl_of_empty_lines_takes_time_in_proportion_to_its_size(tmp_path):
    def seconds(count):
        path = tmp_path / "empty.stl"
        path.write_bytes(b"solid x\n" + b"\n" * count)
        start = time.process_time()
        with pytest.raises(ShapeError):
            load_shape(path)
        return time.process_time() - start

    seconds(1000)
    # A pattern that crosses ends of lines takes minutes here.
    with bounded(60):
        seconds(300_000)


def test_a_line_without_end_is_refused_before_it_fills_the_memory(tmp_path):
    path = tmp_path / "line.obj"
    path.write_bytes(b"v 1 1 1\nf" + b" 1" * 5_000_000)
    tracemalloc.start()
    try:
        with pytest.raises(ShapeError, match="MAX_LINE_CHARACTERS"):
            load_shape(path)
        assert tracemalloc.get_traced_memory()[1] < 50 * mesh_files.MAX_LINE_CHARACTERS
    finally:
        tracemalloc.stop()


def test_a_mesh_of_too_many_faces_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(shape_check, "MAX_FACES", 10)
    path = tmp_path / "ball.obj"
    path.write_bytes(FORMS["obj"][1])
    with pytest.raises(ShapeError, match="MAX_FACES"):
        load_shape(path)


PLY_HEADERS = {
    "a count that hides behind another word": b"xelement face 4000000000",
    "a count of five thousand digits": b"element edge " + b"9" * 5000,
    "a name that is not text": b"element \xff\xfe 5000000000",
}


@pytest.mark.parametrize("case", PLY_HEADERS)
def test_a_lying_ply_header_is_refused(tmp_path, case):
    path = tmp_path / "ball.ply"
    path.write_bytes(FORMS["ply"][1].replace(b"comment a ball", PLY_HEADERS[case]))
    with bounded(), pytest.raises(ShapeError, match=r"ball\.ply"):
        load_shape(path)


def test_no_picture_that_a_ply_names_is_opened(tmp_path, monkeypatch, caplog):
    opened = []
    monkeypatch.setattr("trimesh.resolvers.FilePathResolver.get", lambda self, name: opened.append(name))
    path = tmp_path / "ball.ply"
    path.write_bytes(FORMS["ply"][1].replace(b"comment a ball", b"comment TextureFile texture.png"))
    assert load_shape(path, unit="m").volume > 0
    assert not opened
    assert not caplog.records


@pytest.mark.parametrize("name", ["x" * 5000 + ".obj", "a\0b.obj", "..", ".obj", "no\nsuch.ply"])
def test_a_path_that_is_none_is_refused(name):
    with pytest.raises(ShapeError):
        load_shape(name)
