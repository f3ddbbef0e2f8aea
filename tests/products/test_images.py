"""Pictures of a run in files: read back, and where their labels say they are."""

import json

import numpy as np
import pytest
from astropy.io import fits
from PIL import Image

import swarm_mj as sm
from swarm_mj.errors import InteropError


@pytest.fixture(scope="module")
def flight():
    return sm.fly("eros-quick")


@pytest.fixture(scope="module")
def written(flight, tmp_path_factory):
    folder = tmp_path_factory.mktemp("images") / "pictures"
    files = flight.images(folder, ["all"], every_s=300.0, spacecraft=[1])
    return folder, files


def test_every_picture_is_listed_with_its_pose(written, flight):
    folder, files = written
    told = json.loads((folder / "images.json").read_text())
    rows = told["pictures"]
    assert len(rows) >= 3 and {row["spacecraft"] for row in rows} == {1}
    assert sorted(p.relative_to(folder).as_posix() for p in files if p.name != "images.json") == told["files"]
    k = round(rows[1]["t_s"] / flight.plan.scenario.telemetry.interval_s)
    r_N = flight.telemetry["r_BN_N"].values[k, 0]
    assert np.allclose(rows[1]["r_A_m"], flight.plan.environment.C_AN(rows[1]["t_s"]) @ r_N)
    assert "torch" in (folder / "README.md").read_text()


def test_labels_are_of_the_pixels_of_the_counts(written, flight):
    folder, _ = written
    told = json.loads((folder / "images.json").read_text())
    row, lens = told["pictures"][1], told["lens"]
    counts = np.array(Image.open(folder / f"{row['file']}.png"))
    labels = np.load(folder / f"{row['file']}.npz")
    assert counts.dtype == np.uint16 and counts.shape == labels["face"].shape == (lens["height"], lens["width"])
    hit = labels["face"] >= 0
    bright = counts > row["bias_dn"] + 10
    assert (labels["lit"] & hit & (labels["incidence"] < 70.0)).sum() > 100
    assert (
        bright[labels["lit"] & hit & (labels["incidence"] < 70.0)].mean() > 0.99 and bright[~hit].mean() < 0.15
    )  # of the sky, what the lens spreads
    # The centroid of the most seen face lies on its pixels.
    face = np.bincount(labels["face"][hit]).argmax()
    C = np.array(row["C_CA"]) @ (flight.plan.shape.face_centroids[face] - row["r_A_m"])
    at = lens["focal_px"] * C[:2] / C[2] + [lens["centre_x"], lens["centre_y"]]
    if 0 <= at[0] < lens["width"] and 0 <= at[1] < lens["height"]:
        assert labels["face"][int(at[1]), int(at[0])] == face
    assert labels["target"].any() and not labels["target"][~hit].any()


def test_fits_hold_the_same_upside_down(written):
    folder, _ = written
    told = json.loads((folder / "images.json").read_text())
    stem = folder / told["pictures"][0]["file"]
    with fits.open(f"{stem}.fits") as units:
        assert np.array_equal(units[0].data[::-1], np.array(Image.open(f"{stem}.png")))
        assert units[0].header["EXPTIME"] == told["pictures"][0]["exposure_s"]
        labels = np.load(f"{stem}.npz")
        assert np.array_equal(units["FACE"].data[::-1], labels["face"])
        assert np.allclose(np.moveaxis(units["NORMAL"].data, 0, -1)[::-1], labels["normal"])


def test_what_nobody_took_is_refused(flight, tmp_path):
    with pytest.raises(InteropError, match="spacecraft = 9: must be one of 1 to"):
        flight.images(tmp_path / "none", spacecraft=[9])
    with pytest.raises(InteropError, match="format 'tiff' is unknown"):
        flight.images(tmp_path / "none", ["tiff"])
    assert not (tmp_path / "none").exists()
