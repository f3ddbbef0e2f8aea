"""The compiled model: names, masses, inertia, wheels, and the asteroid as drawn."""

import subprocess
import sys

import mujoco
import numpy as np
import pytest

from swarm_mj.errors import MissionError
from swarm_mj.io.resources import asset_path
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Spacecraft
from swarm_mj.spacecraft.model import build_model
from swarm_mj.spacecraft.properties import SpacecraftProperties


@pytest.fixture(scope="module")
def swarm(eros):
    return build_model(3, shape=eros)


@pytest.fixture(scope="module")
def data(swarm):
    data = mujoco.MjData(swarm.mjmodel)
    mujoco.mj_forward(swarm.mjmodel, data)
    return data


def test_a_warning_of_mujoco_reaches_the_console_and_writes_no_file(tmp_path):
    code = (
        "import mujoco, numpy as np\n"
        "from swarm_mj.smallbody.shape_harmonics import load_eros\n"
        "from swarm_mj.spacecraft.model import build_model\n"
        "model = build_model(1, shape=load_eros()).mjmodel\n"
        "data = mujoco.MjData(model)\n"
        "data.qvel[0] = np.nan\n"
        "mujoco.mj_step(model, data)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "Nan, Inf or huge value" in done.stdout + done.stderr
    assert not list(tmp_path.iterdir())


def test_a_spacecraft_of_ones_own_with_a_bad_number_writes_no_log(tmp_path):
    (tmp_path / "nan.xml").write_text("<mujoco><worldbody><body pos='nan 0 0'><freejoint/></body></worldbody></mujoco>")
    code = (
        "from pathlib import Path; from swarm_mj.spacecraft.own_spacecraft import load_part; load_part(Path('nan.xml'))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert "NaN" in done.stdout + done.stderr and [path.name for path in tmp_path.iterdir()] == ["nan.xml"]


def test_a_log_file_that_somebody_named_is_kept(tmp_path, eros):
    log = mujoco.MjLogConfig.get()
    kept = (log.logto_file, log.logfile)
    try:
        log.logto_file, log.logfile = True, str(tmp_path / "mine.txt")
        log.set()
        build_model(1, shape=eros)
        assert mujoco.MjLogConfig.get().logto_file
    finally:
        log.logto_file, log.logfile = kept
        log.set()


def test_every_element_is_named(swarm):
    model = swarm.mjmodel
    for kind in ("body", "jnt", "geom", "site", "cam", "light", "actuator", "sensor", "mesh", "mat"):
        for i in range(getattr(model, {"actuator": "nu", "jnt": "njnt"}.get(kind, f"n{kind}"))):
            assert getattr(model, kind)(i).name, f"{kind} {i} has no name"


def test_each_spacecraft_weighs_eight_kilograms_and_balances_at_its_free_joint(swarm, data):
    for hub in swarm.hub_body:
        assert swarm.mjmodel.body_subtreemass[hub] == pytest.approx(8.0, rel=1e-12)
        assert np.allclose(data.subtree_com[hub], data.xpos[hub], atol=1e-15)
        assert np.allclose(swarm.mjmodel.body_ipos[hub], 0.0, atol=1e-15)


def test_the_whole_has_the_inertia_of_a_uniform_box(swarm, data):
    # From the mass matrix, which MuJoCo builds from the parts: rotation block of the free joint.
    model = swarm.mjmodel
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    expected = 8.0 / 12.0 * np.diag([0.1**2 + 0.34**2, 0.1**2 + 0.34**2, 0.1**2 + 0.1**2])
    assert np.allclose(mass[3:6, 3:6], expected, rtol=1e-12, atol=1e-15)
    assert np.allclose(mass[0:3, 3:6], 0.0, atol=1e-15)


def test_wheels_are_orthogonal_and_carry_fifteen_millinewtonmetreseconds(swarm, data):
    model = swarm.mjmodel
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    axes = [data.xaxis[model.joint(f"sc1_{w}").id] for w in ("wheel_x", "wheel_y", "wheel_z")]
    assert np.allclose(axes, np.eye(3))
    assert np.diag(mass)[6:9] * 6000 * 2 * np.pi / 60 == pytest.approx(0.015, rel=1e-3)
    assert model.actuator("sc1_wheel_x").ctrlrange == pytest.approx([-0.004, 0.004])


def test_the_mjcf_part_equals_the_defaults_of_the_scenario(eros):
    file = mujoco.MjModel.from_xml_path(str(asset_path("mjcf/cubesat.xml")))
    built = build_model(1, shape=eros).mjmodel
    for body in ("cubesat", "wheel_x", "wheel_y", "wheel_z"):
        ours, theirs = file.body(body), built.body(f"sc1_{body}")
        assert ours.mass == pytest.approx(theirs.mass, rel=1e-9)
        assert ours.inertia == pytest.approx(theirs.inertia, rel=1e-9)
        assert ours.pos == pytest.approx(theirs.pos)
    assert file.camera("camera").fovy == pytest.approx(built.camera("sc1_camera").fovy)


def test_the_defaults_of_scenario_and_properties_agree():
    from swarm_mj.flight.spacecraft import properties_from

    assert properties_from(load_scenario("eros-quick")) == SpacecraftProperties()
    assert Spacecraft().mass_kg == SpacecraftProperties().mass


def test_the_drawn_mesh_coincides_with_the_shape_to_five_millimetres(swarm, data, eros):
    model = swarm.mjmodel
    geom, mesh = model.geom("asteroid").id, model.mesh("asteroid").id
    start = model.mesh_vertadr[mesh]
    drawn = model.mesh_vert[start : start + model.mesh_vertnum[mesh]].astype(float)
    placed = drawn @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    assert np.abs(placed - eros.vertices).max() < 5e-3
    start = model.mesh_faceadr[mesh]
    assert np.array_equal(model.mesh_face[start : start + model.mesh_facenum[mesh]], eros.faces)


def test_the_camera_looks_along_the_spacecrafts_z(swarm, data):
    camera = swarm.mjmodel.camera("sc1_camera").id
    assert np.allclose(-data.cam_xmat[camera].reshape(3, 3)[:, 2], [0, 0, 1])


def test_sensors_give_attitude_rates_and_wheel_speeds(eros):
    model = mujoco.MjModel.from_xml_path(str(asset_path("mjcf/cubesat.xml")))
    data = mujoco.MjData(model)
    data.qpos[3:7] = [0.5, 0.5, 0.5, 0.5]
    data.qvel[3:9] = [0.1, 0.2, 0.3, 10, 20, 30]
    mujoco.mj_forward(model, data)
    assert np.allclose(data.sensor("attitude").data, 0.5)
    assert np.allclose(data.sensor("rates").data, [0.1, 0.2, 0.3])
    assert [data.sensor(f"wheel_{w}_speed").data[0] for w in "xyz"] == [10, 20, 30]


def test_the_scene_file_opens_on_its_own_and_integrates_with_rk4():
    model = mujoco.MjModel.from_xml_path(str(asset_path("mjcf/scene.xml")))
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert model.mesh("asteroid").vertnum[0] == 4002


def test_a_hundred_spacecraft_compile(eros):
    assert build_model(100, shape=eros).mjmodel.nq == 1000


def test_no_spacecraft_and_impossible_wheels_are_refused(eros):
    with pytest.raises(MissionError, match="at least one"):
        build_model(0, shape=eros)
    with pytest.raises(MissionError, match="impossible inertia"):
        build_model(1, shape=eros, properties=SpacecraftProperties(size=(0.01, 0.01, 0.01)))
