"""Devices, pipes, folders and huge files in the place of every file that the program reads: refused in one line, unopened."""

import os
import zipfile

import numpy as np
import pytest
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.policies.policy_files import open_policy

import swarm_mj as sm
from swarm_mj.errors import SwarmError
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.interop.external_flight import read_tracks
from swarm_mj.scenarios.bodies import packaged_body
from swarm_mj.spacecraft.own_spacecraft import load_part

from .limits import bounded

pytestmark = pytest.mark.robust

#: A hang; nothing here computes anything [s].
SOON_S = 30
MEMORY = 2**30
HUGE = 50 * 2**30


def kernels(path):
    scenario = sm.load({"name": "by-kernels", "ephemerides": {"kernels": [str(path)], "positions": False}})
    environment_from(scenario, load_body_shape(scenario.body))


def meta_kernel(path):
    meta = path.with_name("meta.tm")
    meta.write_text(f"KPL/MK\n\\begindata\nPATH_VALUES = ('{path.parent}')\nPATH_SYMBOLS = ('HERE')\n"
                    f"KERNELS_TO_LOAD = ('$HERE/+', '{path.name}')\n")  # fmt: skip
    kernels(meta)


def mesh_of_a_model(path):
    model = path.with_name("model.xml")
    model.write_text(
        f'<mujoco><compiler meshdir=".."/><asset><mesh file="{path.parent.name}/{path.name}"/></asset></mujoco>'
    )
    load_part(model)


def included(path):
    model = path.with_name("model.xml")
    model.write_text(f'<mujoco><include file="{path.name}"/></mujoco>')
    load_part(model)


READERS = {
    "file.yaml": sm.load,
    "campaign.yaml": sm.campaign,
    "file.obj": sm.load_shape,
    "file.stl": sm.load_shape,
    "file.bds": sm.load_shape,
    "file.bsp": kernels,
    "file.tpc": meta_kernel,
    "file.xml": load_part,
    "mesh.stl": mesh_of_a_model,
    "part.xml": included,
    "file.oem": lambda path: read_tracks([path], [], packaged_body("eros")["name"]),
    "file.npz": lambda path: open_policy(path, EnvConfig()),
    "file.onnx": lambda path: open_policy(path, EnvConfig()),
    "file.zip": lambda path: open_policy(path, EnvConfig()),
}


@pytest.mark.parametrize("kind", ["device", "pipe", "folder", "huge"])
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_file_of_believable_size_is_refused_unopened(tmp_path, name, kind):
    path = tmp_path / name
    if kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.touch()
        os.truncate(path, HUGE)
    words = {"device": "is a device", "pipe": "is a named pipe", "folder": "is a folder", "huge": "larger than"}[kind]
    with bounded(SOON_S, MEMORY), pytest.raises(SwarmError, match=words) as error:
        READERS[name](path)
    assert name in str(error.value) and "\n" not in str(error.value)


HUB = '<mujoco>{}<worldbody><body name="hub"><freejoint/><geom size=".1"/>{}</body></worldbody>{}</mujoco>'
PNG = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + 2 * (50_000).to_bytes(4) + b"\x08\2\0\0\0"
BOMBS = {
    "height field": ('<asset><hfield name="h" nrow="50000" ncol="50000" size="1 1 1 1"/></asset>', "", "", "numbers"),
    "texture": ('<asset><texture name="t" builtin="flat" width="5e4" height="50000"/></asset>', "", "", "numbers"),
    "picture": ('<asset><texture name="t" file="picture.png"/></asset>', "", "", "picture.png asks for 2.5e.09 pixels"),
    "surface": ('<asset><mesh name="m" builtin="supersphere" params="50000 .5 .5"/></asset>', "", "", "numbers"),
    "replicas": ("", '<replicate count="100000000"><geom size=".1"/></replicate>', "", "elements"),
    "nested replicas": ("", 3 * '<replicate count="999">' + "<site/>" + 3 * "</replicate>", "", "elements"),
    "copies of a model": ('<asset><model name="m" file="part.xml"/></asset>', 200 * '<attach model="m" body="b"/>', "",
                          "elements"),
    "soft body": ("", '<flexcomp name="f" type="grid" count="999 999 999" spacing="1 1 1"/>', "", "elements"),
    "keyframes": ('<size nkey="100000000"/>', "", "", "elements"),
    "memory": ('<size memory="100G"/>', "", "", "numbers"),
    "user data": ('<size nuser_geom="1000000000"/>', "", "", "numbers"),
    "sensor": ("", "", '<sensor><user dim="1000000000"/></sensor>', "numbers"),
    "doctype": ("<!DOCTYPE x>", "", "", "DOCTYPE"),
}  # fmt: skip


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_model_that_asks_for_all_memory_is_refused_before_it_is_compiled(tmp_path, bomb):
    *places, words = BOMBS[bomb]
    (tmp_path / "picture.png").write_bytes(PNG)
    (tmp_path / "part.xml").write_text(HUB.format("", 200 * "<site/>", ""))
    (tmp_path / "bomb.xml").write_text(HUB.format(*places))
    with bounded(SOON_S, MEMORY), pytest.raises(SwarmError, match=rf"bomb\.xml: MuJoCo cannot read it: [^\n]*{words}"):
        load_part(tmp_path / "bomb.xml")


ABOUT = '{"format": 3, "reads": "choice", "spacecraft": 1, "choices": 1}'


@pytest.mark.parametrize("module", ["policy_files", "policy_network"])
def test_policies_that_unpack_into_more_than_they_may_are_refused(tmp_path, monkeypatch, module):
    monkeypatch.setattr(f"swarm_mj.envs.policies.{module}.MAX_POLICY_BYTES", 50_000)
    zeros = np.zeros(20_000, np.float32)
    if module == "policy_files":
        with zipfile.ZipFile(tmp_path / "inner.pth", "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("data", zeros.tobytes())
        with zipfile.ZipFile(tmp_path / "policy", "w") as archive:
            archive.write(tmp_path / "inner.pth", "policy.pth")
        (tmp_path / "policy").rename(tmp_path / "policy.zip")
        words = "policy.zip: cannot be read .unpacks to 80000 bytes, larger than 50000"
    else:
        one = np.ones((1, 1), np.float32)
        arrays = {"mean": zeros[:6000], "scale": zeros[:6000], "W1": zeros[None, :6000], "b1": one[0]}
        arrays |= {"W2": one, "b2": one[0], "W3": one, "b3": one[0]}
        np.savez_compressed(tmp_path / "policy.npz", about=np.array(ABOUT), **arrays)
        words = "policy.npz: cannot be read .W1 has the shape .1, 6000.: the arrays would take more than 50000 bytes"
    with pytest.raises(SwarmError, match=words):
        open_policy(next(tmp_path.glob("policy.*")), EnvConfig())
