"""Maps of a run are read back by other libraries: PROJ by rasterio, pandas, trimesh, SPICE."""

import json

import numpy as np
import pandas as pd
import pytest
import trimesh

import swarm_mj as sm
from swarm_mj.errors import InteropError, OutputError
from swarm_mj.figures.cell_maps import scale_of, shown_columns
from swarm_mj.mission.target import whole_body
from swarm_mj.observation.coverage import Cause
from swarm_mj.products.grids import MOST_PIXELS, POLAR_FROM_DEG, map_grids
from swarm_mj.records.cells import QUANTITIES
from swarm_mj.reports.globe import RELIEF, globe_figure
from swarm_mj.smallbody.shape import ShapeModel

rasterio = pytest.importorskip("rasterio")
CHEAP = {"telemetry.interval_s": 5, "observation.interval_s": 60, "camera.resolution_px": 128}


@pytest.fixture(scope="module")
def flight():
    return sm.fly("eros-quick", CHEAP)


@pytest.fixture(scope="module")
def folder(flight, tmp_path_factory):
    place = tmp_path_factory.mktemp("maps") / "quick"
    flight.products(place)
    return place


def ball(radius=500.0):
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return ShapeModel(np.asarray(sphere.vertices), np.asarray(sphere.faces, np.int32), "ball")


@pytest.mark.parametrize("body", ["433 Eros", "101955 Bennu"])
def test_pixels_stand_where_proj_puts_them(body):
    for grid in map_grids(body, ball(), 40.0 if body != "433 Eros" else 1500.0):
        rows, columns = grid.shape
        row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
        x, y = rasterio.transform.xy(grid.transform, row.ravel(), column.ravel())
        base = rasterio.crs.CRS.from_user_input(json.dumps(grid.crs.to_dict(projjson=True)["base_crs"]))
        longitude, latitude = np.radians(rasterio.warp.transform(grid.crs, base, list(x), list(y)))
        expected = np.stack(
            (np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)), axis=-1
        )
        np.testing.assert_allclose(grid.directions_A.reshape(-1, 3), expected, atol=1e-9)


def test_the_iau_has_a_system_for_eros_and_none_for_bennu():
    eros, bennu = (
        map_grids(name, ball(), 1500.0 if name == "433 Eros" else 40.0) for name in ("433 Eros", "101955 Bennu")
    )
    assert eros[0].crs.to_string() == "IAU_2015:200043310"
    assert eros[0].radius == 17_000.0
    assert bennu[0].radius == pytest.approx(500.0, rel=5e-3)  # the sphere of the mesh's volume


def test_a_ball_covers_its_maps_and_polar_maps_reach_as_far_as_they_say():
    grids = map_grids("ball", ball(), 20.0)
    for grid in grids:
        assert (grid.faces(ball()) >= 0).all()
    middle = grids[1].directions_A[0, grids[1].shape[1] // 2]
    assert np.degrees(np.arcsin(middle[2])) == pytest.approx(POLAR_FROM_DEG, abs=2.0)
    assert grids[2].directions_A[..., 2].max() < 0.0


def test_shares_of_a_zone_on_the_map_are_those_of_the_sphere():
    shape = ball()
    zone = whole_body(shape).centroid_A[:, 2] > 250.0  # a quarter of a sphere's area lies above half the radius
    (grid, *_) = map_grids("ball", shape, 5.0)
    weight = np.hypot(*np.moveaxis(grid.directions_A[..., :2], -1, 0))
    share = (weight * zone[grid.faces(shape)]).sum() / weight.sum()
    assert share == pytest.approx(0.25, abs=0.01)
    assert share == pytest.approx(shape.face_areas[zone].sum() / shape.surface_area, abs=2e-3)


def test_maps_too_large_are_refused_with_a_size_that_is_not():
    with pytest.raises(InteropError, match="pixel_m = 0.001") as caught:
        map_grids("ball", ball(), 0.001)
    enough = float(str(caught.value).rsplit(", as ", 1)[1].split(" ")[0])
    assert np.prod(map_grids("ball", ball(), 1.05 * enough)[0].shape) <= MOST_PIXELS


def test_a_geotiff_shows_the_cell_below_each_pixel(flight, folder):
    region, cells = flight.plan.region, flight.cells
    with rasterio.open(folder / "equirectangular" / "gsd_m.tif") as tif:
        picture, transform = tif.read(1), tif.transform
        assert (tif.units, tif.descriptions) == (("m",), ("gsd_m",))
        assert tif.crs.to_string() == "IAU_2015:200043310"
        row, column = np.nonzero(np.isfinite(picture))
        some = np.linspace(0, len(row) - 1, 60).astype(int)
        x, y = (np.asarray(values) for values in rasterio.transform.xy(transform, row[some], column[some]))
    longitude, latitude = x / 17_000.0, y / 17_000.0
    out = np.stack(
        (np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)), axis=-1
    )
    corners = np.swapaxes(region.vertices[region.faces], 1, 2)  # not the tracer that drew the map
    for k, pixel in enumerate(some):
        weights = np.linalg.solve(corners, np.broadcast_to(out[k][:, None], (len(corners), 3, 1)))[..., 0]
        distance = np.where((weights >= -1e-12).all(axis=1), 1.0 / weights.sum(axis=1), 0.0)
        cell = int(np.flatnonzero(region.target == distance.argmax())[0])
        assert picture[row[pixel], column[pixel]] == pytest.approx(cells["gsd_m"][cell], rel=1e-6)


def test_the_table_of_cells_says_what_the_run_says(flight, folder):
    table = pd.read_parquet(folder / "cells.parquet")
    seen = table["area_m2"][table["seen"]].sum() / table["area_m2"].sum()
    assert 100.0 * seen == pytest.approx(flight.coverage.percent, rel=1e-12)
    assert (table["cause"] == "").tolist() == (flight.result.why == Cause.NONE).tolist()
    arrived = table["area_m2"][table["arrives_s"].notna()].sum() / table["area_m2"].sum()
    assert 100.0 * arrived == pytest.approx(flight.summary["delivered_percent"], rel=1e-9)
    pyarrow = pytest.importorskip("pyarrow.parquet")
    schema = pyarrow.read_schema(folder / "cells.parquet")
    assert schema.field("gsd_m").metadata[b"unit"] == b"m"
    assert set(table.columns) - {"cell"} <= set(QUANTITIES)


def test_meshes_hold_the_body_and_what_was_seen(flight, folder):
    region = flight.plan.region
    body = trimesh.load(folder / "body.ply", process=False)
    assert body.volume == pytest.approx(region.mesh.volume, rel=1e-6)
    data = body.metadata["_ply_raw"]["face"]["data"]
    np.testing.assert_array_equal(
        np.isfinite(data["seen"].ravel()), np.isin(np.arange(len(region.faces)), region.target)
    )
    scene = trimesh.load(folder / "body.obj", process=False, split_object=True, group_material=False)
    assert flight.coverage.seen.all()  # two groups then
    target = region.area.sum()
    expected = [target, region.mesh.surface_area - target]
    np.testing.assert_allclose(sorted(part.area for part in scene.geometry.values()), expected, rtol=1e-5)


def test_spice_finds_the_plate_of_a_cell(flight, folder):
    spice = pytest.importorskip("spiceypy")
    region, cell = flight.plan.region, flight.plan.region.n_cells // 2
    centre = region.centroid_A[cell] / 1e3
    handle = spice.dasopr(str(folder / "body.bds"))
    plate, place, found = spice.dskx02(handle, spice.dlabfs(handle), 2.0 * centre, -centre)
    spice.dascls(handle)
    assert found
    np.testing.assert_allclose(place, centre, rtol=1e-6)
    assert plate - 1 == region.target[cell]


def test_products_are_replaced_and_nothing_else_is(flight, folder, tmp_path):
    own = tmp_path / "own"
    own.mkdir()
    (own / "thesis.tex").write_text("mine")
    with pytest.raises(OutputError, match="products.json"):
        flight.products(own, ["png"])
    (folder / "notes.txt").write_text("kept")
    files = flight.products(folder, ["obj"])
    assert {path.name for path in files} == {"body.obj", "body.mtl", "products.json"}
    assert (folder / "notes.txt").exists()
    assert not (folder / "cells.parquet").exists()


@pytest.mark.parametrize(("formats", "pixel_m"), [(["kml"], None), ([], None), (["png"], 0.0), (["png"], float("nan"))])
def test_what_cannot_be_is_refused(flight, tmp_path, formats, pixel_m):
    with pytest.raises(InteropError, match=r"kml|formats = \[\]|pixel_m"):
        flight.products(tmp_path / "never", formats, pixel_m=pixel_m)
    assert not (tmp_path / "never").exists()


def test_the_globe_has_the_colours_of_its_scale(flight):
    figure, cells = globe_figure(flight.record), flight.cells
    (menu,) = figure.layout.updatemenus
    assert len(menu.buttons) == len(shown_columns(cells))
    button = next(each for each in menu.buttons if each.label.startswith("ground sampling"))
    paint = button.args[0]["facecolor"][0]
    colours, scale = scale_of("gsd_m", cells["gsd_m"])
    finest = int(cells["gsd_m"].idxmin())
    shown = np.array([int(paint[finest][k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    light = shown / colours(scale(cells["gsd_m"][finest]))[:3]  # relief darkens all three alike
    assert RELIEF - 0.03 <= light.min() and light.max() <= 1.03 and np.ptp(light) < 0.06
    assert len(paint) == len(figure.data[1].i) == len(cells)


def test_what_no_cell_has_is_neither_drawn_nor_given_a_scale(flight):
    cells = flight.cells.assign(gsd_m=np.nan)
    assert "gsd_m" in shown_columns(flight.cells) and "gsd_m" not in shown_columns(cells)
