"""Whatever lies in a result folder, it is read or refused by those who read such folders."""

import io
import pickle
import shutil
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_mj.errors import SwarmError

from .limits import bounded, examples
from .mesh_files import spoiled

pytestmark = pytest.mark.robust

FILES = ("summary.json", "scenario.yaml", "telemetry.nc", "coverage.npz")


#: Who reads result folders.
READERS = ["report", "replay"]


def readers():
    from swarm_mj.records.run_record import read_run
    from swarm_mj.rendering.replay import load_replay

    return {"report": read_run, "replay": load_replay}


@pytest.fixture(scope="module")
def spoilt(run, tmp_path_factory):
    """A function that gives a copy of the folder with one file replaced."""
    place = tmp_path_factory.mktemp("spoilt") / "run"

    def copy(name, content):
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(run, place)
        (place / name).write_bytes(content)
        return place

    return copy


def read_or_refused(reader, folder):
    with bounded():
        try:
            reader(folder)
        except SwarmError as error:
            assert str(folder) in str(error)


@pytest.mark.parametrize("reader", READERS)
def test_the_unspoiled_folder_is_read(reader, run):
    readers()[reader](run)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("reader", READERS)
@examples(5)
@given(data=st.data())
def test_any_bytes_in_any_file_are_read_or_refused(run, spoilt, reader, name, data):
    content = (run / name).read_bytes()
    changed = data.draw(st.binary(max_size=200) | spoiled(content) | spoiled(content) | spoiled(content))
    read_or_refused(readers()[reader], spoilt(name, changed))


class Trap:
    """Writes a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


@pytest.mark.parametrize("reader", READERS)
def test_pickles_among_the_arrays_are_not_opened(run, spoilt, tmp_path, reader):
    trap = tmp_path / "trap"
    with np.load(run / "coverage.npz") as file:
        arrays = dict(file)
    hostile = dict.fromkeys(arrays, np.array([Trap(trap)], dtype=object))
    content = io.BytesIO()
    np.savez(content, **hostile)
    for data in (content.getvalue(), pickle.dumps(Trap(trap))):
        folder = spoilt("coverage.npz", data)
        with bounded(), pytest.raises(SwarmError, match="cannot be read"):
            readers()[reader](folder)
    assert not trap.exists()


def test_an_archive_that_unfolds_into_gigabytes_is_refused(run, spoilt):
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1250000000,), }"
    header += b" " * (118 - len(header) - 1) + b"\n"
    start = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    content = io.BytesIO()
    with (
        np.load(run / "coverage.npz") as file,
        zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        for name in file.files:
            with archive.open(f"{name}.npy", "w") as member:
                member.write(start)
                member.write(bytes(50_000_000))
    for reader in READERS:
        with bounded(), pytest.raises(SwarmError, match="cannot be read"):
            readers()[reader](spoilt("coverage.npz", content.getvalue()))


@pytest.mark.parametrize("reader", READERS)
def test_telemetry_that_promises_terabytes_is_refused(run, spoilt, reader):
    folder = spoilt("telemetry.nc", (run / "telemetry.nc").read_bytes())
    with h5py.File(folder / "telemetry.nc", "a") as file:
        del file["wheel_speed"]
        file.create_dataset("wheel_speed", shape=(10**7, 10**4, 3), chunks=(1000, 10, 3), dtype="f8")
    read_or_refused(readers()[reader], folder)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("reader", READERS)
def test_a_missing_file_or_a_folder_in_its_place_is_refused(run, spoilt, reader, name):
    folder = spoilt("summary.json", (run / "summary.json").read_bytes())
    (folder / name).unlink()
    needed = reader == "report" or name != "summary.json"
    if needed:
        with pytest.raises(SwarmError, match=str(folder)):
            readers()[reader](folder)
    (folder / name).mkdir()
    if needed:
        with pytest.raises(SwarmError, match=str(folder)):
            readers()[reader](folder)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("place", ["/dev/null", "/nowhere", "x" * 5000])
def test_a_place_that_is_no_folder_is_refused(reader, place):
    with bounded(), pytest.raises(SwarmError):
        readers()[reader](Path(place))
