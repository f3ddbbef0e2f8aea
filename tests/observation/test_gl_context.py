"""OpenGL contexts beside MuJoCo's, in spawned workers, after a fork and in threads; each case in its own process."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import swarm_mj
from swarm_mj.errors import ObserverError
from swarm_mj.observation import gl_context
from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.gl_context import gl_available
from swarm_mj.observation.observer import make_observer

from .scenes import eros_target

PRELUDE = """
import os
os.environ["MUJOCO_GL"] = "egl"
import numpy as np
from swarm_mj.errors import ObserverError
from swarm_mj.mission.target import build_target
from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.faceid import FaceIdObserver
from swarm_mj.smallbody.shape_harmonics import build_shape

def make():
    region = build_target(build_shape(), latitude_deg=0, longitude_deg=90, half_angle_deg=20, least_part=0.0)
    return FaceIdObserver(region, CameraModel(resolution_px=256))

def look(observer):
    pose = look_at([0.0, 21e3, 0.0], [0.0, 0.0, 0.0])
    return int((observer.visible_fraction(pose.r_A, pose.C_CA) >= 0.5).sum())
"""


def run(body, tmp_path):
    script = tmp_path / "case.py"
    script.write_text(PRELUDE + textwrap.dedent(body))
    package = str(Path(swarm_mj.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": package},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.gl
@pytest.mark.parametrize("mujoco_first", [True, False])
def test_face_id_pictures_and_mujoco_pictures_can_alternate(mujoco_first, tmp_path):
    body = f"""
    import mujoco
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><light pos='0 0 3'/><geom type='sphere' size='1' rgba='1 0 0 1'/></worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    def renderer():
        r = mujoco.Renderer(model, 64, 64)
        r.update_scene(data)
        return r
    def red(r):
        image = r.render().astype(int)
        return bool((image[..., 0] > image[..., 1] + 50).mean() > 0.05)
    if {mujoco_first}:
        r = renderer()
        assert red(r)
    observer = make()
    count = look(observer)
    assert count == 170, count
    if not {mujoco_first}:
        r = renderer()
    for _ in range(3):
        assert red(r)
        assert look(observer) == count
    r.close()
    assert look(observer) == count
    r = renderer()
    assert red(r)
    observer.close()
    assert red(r)
    assert look(make()) == count
    r.close()
    print("ok")
    """
    assert run(body, tmp_path) == ["ok"]


@pytest.mark.gl
def test_spawned_workers_see_what_the_parent_sees(tmp_path):
    body = """
    import multiprocessing
    def work(_):
        return look(make())
    if __name__ == "__main__":
        here = look(make())
        with multiprocessing.get_context("spawn").Pool(2) as pool:
            there = pool.map(work, range(2))
        print(here, *there)
    """
    assert run(body, tmp_path) == ["170", "170", "170"]


@pytest.mark.gl
def test_a_fork_is_noticed_instead_of_hanging_and_leaves_the_parent_alive(tmp_path):
    body = """
    observer = make()
    before = look(observer)
    child = os.fork()
    if child == 0:
        for attempt in (lambda: look(observer), make):
            try:
                attempt()
                print("nothing", flush=True)
            except ObserverError as error:
                print("forked" if "spawn" in str(error) else error, flush=True)
        observer.close()
        os._exit(0)
    os.waitpid(child, 0)
    print("parent" if look(observer) == before else "broken")
    """
    assert run(body, tmp_path) == ["forked", "forked", "parent"]


@pytest.mark.gl
def test_another_thread_is_told_that_the_context_is_not_its_own(tmp_path):
    body = """
    import threading
    observer = make()
    before, found = look(observer), []
    def work():
        try:
            found.append(look(observer))
        except ObserverError as error:
            found.append("thread" if "another thread" in str(error) else error)
    t = threading.Thread(target=work)
    t.start()
    t.join()
    print(*found, "owner" if look(observer) == before else "broken")
    """
    assert run(body, tmp_path) == ["thread", "owner"]


@pytest.mark.gl
def test_an_observer_left_open_does_not_disturb_the_end_of_the_program(tmp_path):
    assert run("keep = [make(), make()]; print(look(keep[0]))", tmp_path) == ["170"]


@pytest.fixture
def no_gl(monkeypatch):
    """A machine on which OpenGL cannot be loaded."""

    def fail(*args, **kwargs):
        raise OSError("libEGL.so.1: cannot open shared object file")

    monkeypatch.setattr("moderngl.create_context", fail)
    for name in ("context", "owner", "failure", "first"):
        monkeypatch.setattr(gl_context._Slot, name, None)


def test_without_gl_compiled_drawing_takes_over_and_says_why(no_gl):
    available, reason = gl_available()
    assert not available
    assert "libEGL.so.1" in reason
    assert "apt-get install libegl1 libgl1" in reason
    observer = make_observer(eros_target(), CameraModel())
    assert observer.name == "raster"
    assert "libEGL.so.1" in observer.note


def test_without_gl_asking_for_face_ids_is_an_error(no_gl):
    with pytest.raises(ObserverError, match=r"libEGL\.so\.1"):
        make_observer(eros_target(), CameraModel(), kind="faceid")


@pytest.mark.gl
def test_with_gl_face_ids_come_first_and_name_their_renderer():
    observer = make_observer(eros_target(), CameraModel(resolution_px=64))
    assert observer.name == "faceid"
    assert gl_available()[1] in observer.note
    assert make_observer(eros_target(), CameraModel(), kind="raycast").name == "raycast"


def test_an_unknown_observer_is_refused():
    with pytest.raises(ObserverError, match="'auto', 'faceid', 'raster', 'raycast' or 'horizon'"):
        make_observer(eros_target(), CameraModel(), kind="telescope")
