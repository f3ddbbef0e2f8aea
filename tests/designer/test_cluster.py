"""Designs whose candidates fly on a Dask cluster: the same bits as here, and clear words when there is none."""

import json

import numpy as np
import pytest

pytest.importorskip("distributed")

import swarm_mj as sm  # noqa: E402
from swarm_mj.errors import OutputError  # noqa: E402

pytestmark = pytest.mark.slow

SMALL = {
    "observation.observer": "raycast",
    "observation.criterion": "arrival",
    "target.cell_size_m": None,
    "camera.half_angle_deg": 6,
    "designer.altitudes_m": [12000, 14000],
    "designer.max_generations": 5,
}


def without_seconds(record):
    if isinstance(record, dict):
        return {key: without_seconds(value) for key, value in record.items() if key not in ("seconds", "wall_s")}
    return [without_seconds(value) for value in record] if isinstance(record, list) else record


def flown_here(*_):
    raise AssertionError("flown in this process")


def test_a_design_on_a_local_cluster_is_that_of_this_machine_bit_for_bit(tmp_path, monkeypatch):
    from distributed import LocalCluster

    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path / "here"))
    here = sm.design("eros-quick", SMALL, out=tmp_path / "a", figures=False, workers=1)
    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path / "there"))
    monkeypatch.setattr("swarm_mj.designer.candidates.visibility.fly", flown_here)
    with LocalCluster(n_workers=1, threads_per_worker=2, dashboard_address=None) as cluster:
        there = sm.design("eros-quick", SMALL, out=tmp_path / "b", figures=False, scheduler=cluster.scheduler_address)
    assert not there.study.visibility.resumed
    for own, other in zip(*(np.load(tmp_path / name / "sightings.npz").items() for name in "ab"), strict=True):
        assert own[0] == other[0] and np.array_equal(own[1], other[1])
    records = [json.loads((tmp_path / name / "design.json").read_text()) for name in "ab"]
    assert without_seconds(records[0]) == without_seconds(records[1])
    assert here.points == there.points


def test_nobody_at_the_address_is_said_before_anything_is_flown(tmp_path, monkeypatch):
    monkeypatch.setattr("swarm_mj.io.cluster.CONNECT_S", 1.0)
    with pytest.raises(OutputError, match="no Dask scheduler answers"):
        sm.design("eros-quick", out=tmp_path / "out", scheduler="tcp://127.0.0.1:9")
    assert not (tmp_path / "out").exists()
