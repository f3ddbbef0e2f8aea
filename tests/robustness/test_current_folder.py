"""Whoever owns the current folder does not own the program that is started there."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from swarm_mj.cli.main import main

pytestmark = pytest.mark.robust


def test_no_module_of_the_current_folder_is_imported(tmp_path):
    """By MuJoCo's import either, which starts an interpreter that asks a library for its version."""
    for name in ("swarm_mj", "scipy", "numpy", "mujoco", "numba", "ctypes", "glfw", "argparse", "json"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'trap')!r}, 'w').close()\n")
    program = Path(sys.executable).with_name("swarm-mj")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"} | {
        "MUJOCO_GL": "glfw"
    }
    command = [program, "fly", "eros-quick", "--set", "seed=x"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 2 and "seed = 'x'" in done.stderr
    assert not (tmp_path / "trap").exists()


@pytest.mark.parametrize("name", [".numba_config.yaml", "matplotlibrc"])
def test_no_settings_of_the_current_folder_are_obeyed(tmp_path, name):
    """Numba would write a trace wherever that file says, Matplotlib start latex."""
    (tmp_path / name).write_text(f"CHROME_TRACE: {tmp_path / 'trace'}\n")
    program = Path(sys.executable).with_name("swarm-mj")
    done = subprocess.run([program, "available"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.startswith(f"swarm-mj: error: {name}: ")
    assert not (tmp_path / "trace").exists()
    (tmp_path / name).unlink()
    (tmp_path / name).mkdir()  # which is obeyed by neither
    assert subprocess.run([program, "available"], cwd=tmp_path, capture_output=True).returncode == 0


def test_what_mujoco_cannot_draw_with_is_refused_by_name(tmp_path):
    command = [sys.executable, "-m", "swarm_mj", "fly", "eros-quick", "--set", "seed=x"]
    done = subprocess.run(command, env=os.environ | {"MUJOCO_GL": "bad"}, capture_output=True, text=True)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("swarm-mj: error: MUJOCO_GL = 'bad': MuJoCo cannot be loaded with it")


def test_without_a_home_nothing_is_kept_and_everything_works(monkeypatch):
    from swarm_mj.io import cache

    for name in ("HOME", "XDG_CACHE_HOME", "SWARM_MJ_CACHE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # of a user whom the system does not know
    folder = cache.cache_folder()
    cache.store_array(folder / "a.npy", cache.np.zeros(3))
    assert folder.is_absolute() and not folder.parent.is_dir()
    assert cache.load_array(folder / "a.npy", (3,)) is None
    assert main(["available"]) == 0


@pytest.mark.parametrize("writable", [True, False])
def test_a_home_that_may_not_be_entered_is_none(monkeypatch, tmp_path, writable):
    """Machine code goes below the nearest folder that may be entered if that may be written to, else into a private one."""
    import swarm_mj

    def refuse(path, **_):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(swarm_mj.os, "access", lambda path, mode: writable and Path(path) == tmp_path)
    monkeypatch.setattr(Path, "exists", refuse)
    monkeypatch.setattr(swarm_mj.tempfile, "mkdtemp", lambda prefix: str(tmp_path / prefix))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "private" / "cache"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    swarm_mj._give_numba_a_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == ("" if writable else str(tmp_path / "swarm_mj-"))
