"""Readers against files written by trimesh, and against files that are wrong in every way."""

import math
import os
import stat

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarm_mj.errors import OutputError, ShapeError
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_io import load_shape, save_shape


def potato(frequency=3) -> ShapeModel:
    directions, faces = geodesic_icosahedron(frequency)
    return ShapeModel(directions * [1700.0, 812.3456789, 600.1], faces, "potato")


def write(shape: ShapeModel, path, form: str, base: int = 0):
    """Write by another program (trimesh), or by hand where it does not know the format."""
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    if form == "tab":
        lines = [f"v {x / 1e3:.17g} {y / 1e3:.17g} {z / 1e3:.17g}" for x, y, z in shape.vertices]
        lines += [f"f {i} {j} {k}" for i, j, k in shape.faces + base]
        data = "\r\n".join(lines).encode()
    elif form == "ply_ascii":
        data = mesh.export(file_type="ply", encoding="ascii")
    elif form == "ply_doubles":
        data = doubles_ply(shape)
    else:
        data = mesh.export(file_type=form)
    path = path / f"potato.{form.partition('_')[0]}"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def doubles_ply(shape: ShapeModel) -> bytes:
    header = (
        f"ply\nformat binary_big_endian 1.0\nelement vertex {len(shape.vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(shape.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.zeros(len(shape.faces), dtype=[("n", "u1"), ("f", ">i4", 3)])
    rows["n"], rows["f"] = 3, shape.faces
    return header.encode() + shape.vertices.astype(">f8").tobytes() + rows.tobytes()


def same_surface(shape: ShapeModel, other: ShapeModel, tolerance: float) -> bool:
    """Whether both list the same triangles, whatever the numbers of their vertices."""
    corners = [s.vertices[s.faces].reshape(-1, 9) for s in (shape, other)]
    return corners[0].shape == corners[1].shape and np.abs(corners[0] - corners[1]).max() <= tolerance


@pytest.mark.parametrize(
    ("form", "tolerance"),
    [
        ("obj", 1e-5),
        ("ply", 1e-3),
        ("ply_ascii", 1e-3),
        ("ply_doubles", 0.0),
        ("stl", 1e-3),
        ("stl_ascii", 1e-3),
        ("tab", 1e-9),
    ],
)
def test_every_format_gives_the_surface_that_another_program_wrote(tmp_path, form, tolerance):
    shape = potato()
    loaded = load_shape(write(shape, tmp_path, form))
    assert same_surface(shape, loaded, tolerance)
    assert len(loaded.vertices) == len(shape.vertices)
    assert loaded.volume == pytest.approx(shape.volume, rel=1e-6)
    assert loaded.name == f"potato.{form.partition('_')[0]}"


@pytest.mark.parametrize("base", [0, 1])
def test_plate_tables_may_count_from_zero_or_one(tmp_path, base):
    shape = potato()
    np.testing.assert_array_equal(load_shape(write(shape, tmp_path, "tab", base)).faces, shape.faces)


def test_unit_is_metres_except_for_plate_tables_and_can_be_given(tmp_path):
    shape = potato()
    small = ShapeModel(shape.vertices / 1e3, shape.faces)
    path = write(small, tmp_path, "obj")
    assert load_shape(path, unit="km").max_radius == pytest.approx(shape.max_radius, rel=1e-6)
    with pytest.raises(ShapeError, match='potato.obj: .*pass unit="km"'):
        load_shape(path)
    assert load_shape(path, expect_radius_m=(1.0, 2.0), name="pebble").name == "pebble"
    with pytest.raises(ShapeError, match="unit 'mm' is unknown; use one of 'm', 'km'"):
        load_shape(path, unit="mm")
    with pytest.raises(ShapeError, match='pass unit="km"'):
        load_shape(write(shape, tmp_path, "tab"), unit="m")


def test_saved_obj_is_read_back_bit_for_bit_and_written_the_same_again(tmp_path):
    rng = np.random.default_rng(1)
    shape = potato()
    rough = ShapeModel(shape.vertices * (1.0 + 1e-3 * rng.standard_normal((len(shape.vertices), 1))), shape.faces)
    save_shape(rough, tmp_path / "a.obj")
    loaded = load_shape(tmp_path / "a.obj", name=rough.name)
    np.testing.assert_array_equal(loaded.vertices, rough.vertices)
    np.testing.assert_array_equal(loaded.faces, rough.faces)
    save_shape(loaded, tmp_path / "b.obj")
    assert (tmp_path / "a.obj").read_bytes() == (tmp_path / "b.obj").read_bytes()
    assert sorted(os.listdir(tmp_path)) == ["a.obj", "b.obj"]
    assert stat.S_IMODE((tmp_path / "a.obj").stat().st_mode) & 0o044 == 0o044


def test_failed_save_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "eros.obj"
    path.write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OutputError, match="eros.obj: cannot be written .No space left"):
        save_shape(potato(), path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["eros.obj"]
    with pytest.raises(OutputError, match="No such file"):
        save_shape(potato(), tmp_path / "missing" / "eros.obj")


def test_obj_decorations_negative_indices_and_polygons_are_understood(tmp_path):
    path = tmp_path / "box.obj"
    corners = [(x, y, z) for x in (-100, 100) for y in (-100, 100) for z in (-100, 100)]
    quads = ["1/1/1 2/2/1 4/3/1 3/4/1", "5//2 7//2 8//2 6//2", "-8 -4 -3 -7", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    text = "# box\nmtllib x.mtl\no box\n" + "".join(f"v {x} {y} {z} 0.5 0.5 0.5\n" for x, y, z in corners)
    path.write_text(text + "vt 0 0\nvn 0 0 1\ns off\n" + "".join(f"f {quad} # side\n" for quad in quads))
    shape = load_shape(path, unit="m")
    assert len(shape.faces) == 12
    assert shape.volume == pytest.approx(8e6)


def bare_ellipsoid(folder, axes, ending="obj"):
    """An ellipsoid whose file says nothing of its unit."""
    directions, faces = geodesic_icosahedron(6)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (directions * axes).tolist()]
    lines += [f"f {i} {j} {k}" for i, j, k in (faces + 1).tolist()]
    (folder / f"body.{ending}").write_text("\n".join(lines) + "\n")
    return folder / f"body.{ending}"


#: About 216 Kleopatra, in kilometres, and its mass by Marchis et al. 2021 (A&A 653, A57).
KLEOPATRA, KLEOPATRA_GM = (135.0, 60.0, 45.0), 2.97e18 * 6.6743e-11


def test_numbers_that_may_be_metres_or_kilometres_are_asked_about_and_never_guessed(tmp_path):
    path = bare_ellipsoid(tmp_path, KLEOPATRA)
    with pytest.raises(
        ShapeError, match='farthest vertex is 135 from the origin.*pass unit="km", or m if that is meant'
    ):
        load_shape(path)
    assert load_shape(path, unit="km").max_radius == pytest.approx(135e3)
    assert load_shape(path, unit="m").max_radius == pytest.approx(135.0)
    # Nobody takes a body of 1.7 km for one of 1,700 km, and who says how large it is has said the unit.
    assert load_shape(bare_ellipsoid(tmp_path, (1700.0, 800.0, 600.0))).max_radius == pytest.approx(1700.0)
    assert load_shape(bare_ellipsoid(tmp_path, KLEOPATRA), expect_radius_m=(50.0, 500.0)).max_radius == pytest.approx(
        135.0
    )


def test_a_gravitational_parameter_says_the_unit_by_the_density(tmp_path):
    path = bare_ellipsoid(tmp_path, KLEOPATRA)
    with pytest.raises(ShapeError, match=r'in m its density.* kg/m\^3, in km 1\.9\d.*pass unit="km"'):
        load_shape(path, gm=KLEOPATRA_GM)
    pebble_gm = 2000.0 * 6.6743e-11 * 4 / 3 * np.pi * np.prod(KLEOPATRA)
    assert load_shape(path, gm=pebble_gm).max_radius == pytest.approx(135.0)
    # 250 m written into a file whose numbers are kilometres by custom.
    with pytest.raises(ShapeError, match=r'in km its density.*pass unit="m"'):
        load_shape(bare_ellipsoid(tmp_path, (250.0, 240.0, 230.0), "tab"), gm=4.89)
    assert load_shape(path, unit="m", gm=KLEOPATRA_GM).max_radius == pytest.approx(135.0)


def test_a_file_of_our_own_says_that_it_holds_metres(tmp_path):
    save_shape(load_shape(bare_ellipsoid(tmp_path, KLEOPATRA), unit="m"), tmp_path / "saved.obj")
    assert load_shape(tmp_path / "saved.obj").max_radius == pytest.approx(135.0)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_an_obj_line_goes_on_after_a_backslash(tmp_path, end):
    shape = potato()
    lines = [f"v {x!r} \\{end} {y!r}\\{end} {z!r}" for x, y, z in shape.vertices.tolist()]
    lines += [f"f {i} {j} \\{end}{k}" for i, j, k in shape.faces + 1]
    (tmp_path / "a.obj").write_bytes(end.join(["# a comment that \\", "goes on", "g a \\", "b", *lines, ""]).encode())
    read = load_shape(tmp_path / "a.obj")
    np.testing.assert_array_equal(read.vertices, shape.vertices)
    np.testing.assert_array_equal(read.faces, shape.faces)
    (tmp_path / "b.obj").write_text("v 1 2 3\nv 1 \\\n2 \\\nx\n")
    with pytest.raises(ShapeError, match="line 2, "):
        load_shape(tmp_path / "b.obj")


@pytest.mark.parametrize("form", ["obj", "tab"])
def test_a_mark_of_byte_order_before_the_first_line_hides_nothing(tmp_path, form):
    shape = potato()
    path = write(shape, tmp_path, form)
    lines = [line for line in path.read_bytes().splitlines(keepends=True) if line[:1] in b"vf"]
    path.write_bytes(b"\xef\xbb\xbf" + b"".join(lines))
    np.testing.assert_array_equal(load_shape(path).faces, shape.faces)


def test_plate_tables_may_begin_with_the_numbers_of_vertices_and_faces(tmp_path):
    shape = potato()
    path = write(shape, tmp_path, "tab")
    text = path.read_text()
    path.write_text(f"# plates\n {len(shape.vertices)} {len(shape.faces)}\n{text}")
    np.testing.assert_array_equal(load_shape(path).faces, shape.faces)
    path.write_text(f"{len(shape.vertices) + 1} {len(shape.faces)}\n{text}")
    with pytest.raises(ShapeError, match=f"promises {len(shape.vertices) + 1} vertices and .* but holds"):
        load_shape(path)


BAD_TEXT = {
    "no such file": ("obj", None, "no such file"),
    "unknown ending": ("glb", b"x", r"ending '.glb' is unknown; use one of .obj, .ply, .stl, .tab"),
    "empty": ("obj", b"", "no vertices"),
    "blank": ("obj", b"\n\n", "no faces"),
    "not text": ("obj", b"v 1 2 3\n\xff\xfe\n", "byte 8 is not UTF-8"),
    "utf-16": ("tab", "v 1 2 3".encode("utf-16"), "not UTF-8"),
    "number": ("obj", b"v 1 2 3\nv 1 x 3\n", "line 2, 'v 1 x 3'"),
    "short vertex": ("tab", b"v 1 2\n", "line 1, .*three coordinates, this one has 2"),
    "tab of words": ("tab", b"hello\n", "line 1, 'hello': neither a vertex .v x y z. nor a face .f i j k."),
    "tab of two words": ("tab", b"hello world\n", "line 1, 'hello world': neither"),
    "tab without letters": ("tab", b"4 4\n1 0.1 0.2 0.3\n", "line 2, '1 0.1 0.2 0.3': neither a vertex"),
    "tab of numbers alone": ("tab", b"4 4\n", "no vertices .* and no faces"),
    "tab with numbers twice": ("tab", b"4 4\n4 4\nv 1 2 3\n", "line 2, '4 4': neither"),
    "tab with wrong numbers": ("tab", b"4 4\nv 1 2 3\nf 0 0 0\n", "promises 4 vertices and 4 faces, but holds 1 and 1"),
    "obj of words": ("obj", b"hello\n", "no vertices .* and no faces .* so this is no shape model"),
    "points": ("obj", b"v 1 2 3\n", "no faces; the file may be a point cloud"),
    "short continued face": ("obj", b"v 1 2 3\nf 1 \\\n 1\n", "line 2, .*at least three vertices, this one has 2"),
    "endless continuation": ("obj", b"v 1 \\\n" + b"\\\n" * 100_001, "line 1 is longer than 100000"),
    "short face": ("obj", b"v 1 2 3\nf 1 1\n", "line 2, .*at least three vertices, this one has 2"),
    "zero index": ("obj", b"v 1 2 3\nf 0 1 2\n", "counts vertices from 1"),
    "huge index": ("obj", b"v 1 2 3\nf 1 2 99999999999999999999\n", "line 2"),
    "not ply": ("ply", b"hello", "PLY header"),
    "endless ply": ("ply", b"ply\nformat ascii 1.0\n" + b"comment x\n" * 10, "PLY header"),
    "ply of points": ("ply", b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n1 2 3\n", "no face"),
    "lying ply": ("ply", b"ply\nelement vertex 99999999999\nelement face 9\nend_header\n", "promises 99999999999 vertex"),
    "not stl": ("stl", b"hello" * 100, "not STL"),
    "short stl": ("stl", b"\0" * 80 + b"\xff\xff\xff\x7f" + b"\0" * 50, "not STL"),
    "empty stl": ("stl", b"solid x\nendsolid x\n", "no faces"),
    "torn stl": ("stl", b"solid x\nfacet\nouter loop\nvertex 1 2 3\n", "cut short"),
    "bad stl": ("stl", b"solid x\n" + b"vertex 1 2 q\n" * 3 + b"endfacet\nendsolid\n", "three numbers"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_TEXT)
def test_unreadable_file_gives_an_error_that_names_it_and_the_cause(tmp_path, case):
    ending, data, message = BAD_TEXT[case]
    path = tmp_path / f"file.{ending}"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(ShapeError, match=message) as caught:
        load_shape(path)
    assert path.name in str(caught.value)


def test_folder_and_unreadable_and_oversized_files_are_refused(tmp_path, monkeypatch):
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(ShapeError, match="is a folder"):
        load_shape(tmp_path / "folder.obj")
    path = write(potato(), tmp_path, "obj")
    monkeypatch.setattr("swarm_mj.smallbody.shape_io.MAX_FILE_BYTES", 1000)
    with pytest.raises(ShapeError, match="larger than 1000 bytes"):
        load_shape(path)


@pytest.mark.parametrize("form", ["obj", "tab", "ply_ascii", "stl_ascii", "ply_doubles"])
def test_nan_in_a_file_is_found_in_every_format(tmp_path, form):
    shape = potato()
    vertices = shape.vertices.copy()
    vertices[7, 2] = math.nan
    path = write(ShapeModel(vertices, shape.faces), tmp_path, form)
    with pytest.raises(ShapeError, match="not finite"):
        load_shape(path)


@pytest.mark.parametrize("form", ["obj", "ply", "ply_ascii", "stl", "stl_ascii", "tab"])
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(fraction=st.floats(0.0, 1.0, exclude_max=True))
def test_cut_file_is_either_refused_or_still_whole(tmp_path, form, fraction):
    shape = potato(2)
    path = write(shape, tmp_path, form)
    data = path.read_bytes()
    path.write_bytes(data[: int(fraction * len(data))])
    try:
        loaded = load_shape(path)
    except ShapeError as error:
        assert path.name in str(error)
    else:
        # Only the closing lines were lost, or digits of the last number that leave it what it was.
        assert same_surface(shape, loaded, 1e-3)


@pytest.mark.parametrize("form", ["obj", "ply", "ply_ascii", "stl", "stl_ascii", "tab"])
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_corrupted_bytes_never_escape_as_another_error(tmp_path, form, seed):
    rng = np.random.default_rng(seed)
    path = write(potato(1), tmp_path, form)
    data = np.frombuffer(path.read_bytes(), dtype=np.uint8).copy()
    data[rng.integers(0, len(data), 3)] = rng.integers(0, 256, 3)
    path.write_bytes(data.tobytes())
    try:
        shape = load_shape(path)
    except ShapeError:
        return
    assert shape.volume > 0.0
