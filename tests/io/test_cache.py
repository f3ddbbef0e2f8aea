"""The folder of kept arrays: bounded, oldest use first, with any number of processes at once."""

import multiprocessing
import os
import time

import numpy as np

from swarm_mj.io import cache
from swarm_mj.scenarios.loading import parse_overrides

SHAPE = (64, 128)
#: A stored array with its header [bytes].
SIZE = 64 * 128 * 4 + 128


def array(value):
    return np.full(SHAPE, value, np.float32)


def names(folder):
    return sorted(p.name for p in folder.iterdir())


def test_what_was_used_longest_ago_makes_room(tmp_path):
    for k in range(4):
        cache.store_array(tmp_path / f"{k}.npy", array(k), folder_bytes=4 * SIZE)
        os.utime(tmp_path / f"{k}.npy", (1000 + k, 1000 + k))
    assert names(tmp_path) == ["0.npy", "1.npy", "2.npy", "3.npy"]
    assert cache.load_array(tmp_path / "0.npy", SHAPE)[0, 0] == 0.0  # used again, so that 1 is now the oldest
    cache.store_array(tmp_path / "4.npy", array(4), folder_bytes=4 * SIZE)
    assert names(tmp_path) == ["0.npy", "2.npy", "3.npy", "4.npy"]


def test_an_array_larger_than_the_bound_is_kept_alone(tmp_path):
    for k in range(3):
        cache.store_array(tmp_path / f"{k}.npy", array(k), folder_bytes=SIZE // 2)
    assert names(tmp_path) == ["2.npy"]


def test_files_of_others_stay_and_those_of_killed_processes_go(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    for name, age in ((".a.npy.1.partial", 2 * cache.ABANDONED_S), (".b.npy.2.partial", 0.0)):
        (tmp_path / name).write_bytes(b"half")
        os.utime(tmp_path / name, (time.time() - age,) * 2)
    cache.store_array(tmp_path / "k.npy", array(1), folder_bytes=1)
    assert names(tmp_path) == [".b.npy.2.partial", "k.npy", "notes.txt"]


def test_a_folder_that_is_no_longer_there_costs_nothing(tmp_path, monkeypatch):
    def gone(path):
        raise FileNotFoundError(path)

    monkeypatch.setattr("pathlib.Path.iterdir", gone)
    cache.store_array(tmp_path / "k.npy", array(1), folder_bytes=1)


def busy(folder, seed):
    """Load and store arrays of a few names, as campaigns' workers do; ends with 0 unless something is wrong."""
    rng = np.random.default_rng(seed)
    for k in rng.integers(0, 20, 150):
        found = cache.load_array(folder / f"{k}.npy", SHAPE)
        if found is None:
            cache.store_array(folder / f"{k}.npy", array(k), folder_bytes=5 * SIZE)
        elif not (found == k).all():
            os._exit(1)


def test_several_processes_share_a_bounded_folder(tmp_path):
    context = multiprocessing.get_context("fork")
    processes = [context.Process(target=busy, args=(tmp_path, seed)) for seed in range(4)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60)
        assert process.exitcode == 0
    cache.store_array(tmp_path / "last.npy", array(0), folder_bytes=5 * SIZE)
    assert len(names(tmp_path)) == 5 and "last.npy" in names(tmp_path)


def test_horizon_maps_are_kept_within_their_bound(tmp_path, monkeypatch):
    from swarm_mj.flight.environment import load_body_shape
    from swarm_mj.flight.targets import target_from
    from swarm_mj.observation import horizon
    from swarm_mj.scenarios.loading import load_scenario

    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path))
    monkeypatch.setattr(horizon, "MAX_CACHE_BYTES", 1)
    for latitude in (-56.0, -57.0):
        scenario = load_scenario(
            "eros-quick", parse_overrides([f"target.latitude_deg={latitude}", "target.half_angle_deg=8"])
        )
        region = target_from(scenario, load_body_shape(scenario.body))
        horizon.HorizonMap(region, samples=1)
        assert len(names(tmp_path / "horizons")) == 1
