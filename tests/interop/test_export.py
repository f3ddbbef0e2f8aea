"""The folder of an export: what is in it, what it replaces, and what is refused."""

import json
import sys

import pytest

from swarm_mj.cli import results as command
from swarm_mj.cli.main import main
from swarm_mj.errors import InteropError, OutputError
from swarm_mj.interop.export import FORMATS, chosen_formats

WITHOUT_KERNELS = ("oem", "aem", "csv", "gltf")


def test_the_command_knows_the_formats_that_there_are():
    assert command.FORMATS == tuple(FORMATS)


def test_the_manifest_lists_every_file_and_says_frames_and_time(exported):
    manifest = json.loads((exported / "export.json").read_text())
    there = sorted(p.relative_to(exported).as_posix() for p in exported.rglob("*") if p.is_file())
    assert sorted([*manifest["files"], "export.json"]) == there
    assert manifest["formats"] == list(FORMATS) and "TDB" in manifest["time"] and "EME2000" in str(manifest["frames"])


def test_an_export_replaces_an_earlier_one_and_keeps_what_is_not_its_own(flown, tmp_path):
    folder = tmp_path / "deep" / "out"
    flown.export(folder, ["csv", "oem"])
    (folder / "mine.txt").write_text("mine")
    files = flown.export(folder, ["aem"])
    names = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())
    assert names == ["aem/sc1.aem", "aem/sc2.aem", "export.json", "mine.txt"]
    assert [p.name for p in files] == ["sc1.aem", "sc2.aem", "export.json"]
    assert [p.name for p in folder.parent.iterdir() if p.name.endswith((".partial", "tmp"))] == []


def test_other_folders_and_unknown_formats_are_refused_and_nothing_is_written(flown, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(OutputError, match="is no earlier export .*; choose another folder with --out"):
        flown.export(tmp_path, ["oem"])
    with pytest.raises(InteropError, match="format 'ogg' is unknown; allowed are oem, aem"):
        flown.export(tmp_path / "new", ["ogg"])
    with pytest.raises(InteropError, match="ccsds = 4: must be 2"):
        flown.export(tmp_path / "new", ["oem"], ccsds=4)
    with pytest.raises(InteropError, match="name at least one of"):
        chosen_formats([])
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_a_manifest_that_names_files_elsewhere_removes_none_of_them(flown, tmp_path):
    (tmp_path / "victim").write_text("mine")
    folder = tmp_path / "out"
    folder.mkdir()
    listed = {"files": ["../victim", str(tmp_path / "victim"), 7]}
    (folder / "export.json").write_text(json.dumps(listed))
    flown.export(folder, ["oem"])
    assert (tmp_path / "victim").read_text() == "mine"


def test_without_spiceypy_one_line_names_the_extra_and_the_rest_works(flown, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "spiceypy", None)
    for formats in (["spk"], ["all"]):
        with pytest.raises(InteropError, match=r"^SPICE kernels need spiceypy, .*: pip install 'swarm_mj\[spice\]'$"):
            flown.export(tmp_path / "out", formats)
    assert not (tmp_path / "out").exists()
    flown.export(tmp_path / "out", WITHOUT_KERNELS)


def test_the_command_writes_beside_the_run(flown, tmp_path, capsys):
    flown.save(tmp_path / "run", figures=False, report=False)
    assert main(["export", str(tmp_path / "run"), "--format", "oem", "csv", "--ccsds", "3"]) == 0
    folder = tmp_path / "run-export"
    assert (folder / "oem" / "sc1.oem").read_text().startswith("CCSDS_OEM_VERS = 3.0")
    assert str(folder / "csv" / "sc1.csv") in capsys.readouterr().out
    assert main(["export", str(tmp_path / "none"), "--format", "oem"]) == 2
    assert "no such folder" in capsys.readouterr().err
