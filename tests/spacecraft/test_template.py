"""The packaged CubeSat has the scenario's masses and wheels; once its file is changed, it flies as a spacecraft of its own."""

import mujoco
import numpy as np
import pytest

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight import spacecraft as flown_spacecraft
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.io.resources import asset_path
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft import model as swarm_model
from swarm_mj.spacecraft import template
from swarm_mj.spacecraft.measurement import measure
from swarm_mj.spacecraft.model import build_model
from swarm_mj.spacecraft.properties import WHEEL_AXES, SpacecraftProperties

SENSORS, FELT = "  <sensor>", '  <sensor><accelerometer name="felt" site="imu"/>'


@pytest.fixture(scope="module")
def tetrahedron():
    vertices = 1e3 * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return ShapeModel(vertices, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))


@pytest.fixture
def change_asset(tmp_path, monkeypatch):
    """Puts a changed file in the place of a packaged one."""

    def change(name, before, after):
        text = asset_path(f"mjcf/{name}").read_text("utf-8")
        assert text.count(before) == 1
        file = tmp_path / name
        file.write_text(text.replace(before, after))
        found = {f"mjcf/{name}": file}
        for module in (swarm_model, template, flown_spacecraft):
            monkeypatch.setattr(module, "asset_path", lambda asset: found.get(asset, asset_path(asset)))
        return file

    return change


@pytest.mark.parametrize("layout", WHEEL_AXES)
def test_the_packaged_spacecraft_weighs_and_turns_as_the_scenario_says_with_any_layout_of_wheels(layout):
    properties = SpacecraftProperties(wheel_layout=layout, mass=12.0, size=(0.1, 0.2, 0.3), max_wheel_torque=0.01)
    model = template.compile_spec(template.make_template(properties, 0.1, 21.5))
    wheels = template.wheel_names(properties)
    found = measure(model, template.HUB, wheels)
    assert found.mass == pytest.approx(12.0, rel=1e-9)
    assert np.allclose(found.centre_B, 0.0, atol=1e-9)
    assert np.allclose(found.inertia_B, properties.inertia_B, rtol=0, atol=1e-9 * np.trace(properties.inertia_B))
    spin = properties.wheel_spin_inertia
    assert np.allclose(found.wheel_momentum_B, spin * properties.wheel_axes_B, rtol=0, atol=1e-9 * spin)
    for wheel in wheels:
        assert model.actuator(wheel).ctrlrange.tolist() == [-0.01, 0.01]


def test_the_file_is_the_one_that_is_shipped_and_a_changed_one_is_no_template(tetrahedron, change_asset):
    assert template.is_shipped(), "put the new digest of cubesat.xml into SHIPPED"
    change_asset("cubesat.xml", SENSORS, FELT)
    with pytest.raises(MissionError, match=r"cubesat\.xml was changed: .*spacecraft\.mjcf"):
        build_model(2, shape=tetrahedron)


def test_mass_inertia_and_wheels_are_measured_as_a_sum_over_the_bodies_gives_them():
    properties = SpacecraftProperties()
    model = mujoco.MjModel.from_xml_path(str(asset_path("mjcf/cubesat.xml")))
    turned = np.array([5.0, 6.0, 7.0, 0.5, 0.5, 0.5, 0.5, 1.0, 2.0, 3.0])
    for qpos in (None, turned):  # where it stands and how its wheels stand does not matter
        found = measure(model, "cubesat", template.WHEELS, qpos)
        assert found.mass == pytest.approx(8.0, rel=1e-12)
        assert np.allclose(found.inertia_B, properties.inertia_B, rtol=1e-10, atol=1e-12)
        assert np.allclose(found.wheel_momentum_B, properties.wheel_spin_inertia * np.eye(3), atol=1e-17)
        assert np.allclose(found.centre_B, 0.0, atol=1e-12)


def test_a_scene_that_holds_more_than_the_asteroid_is_refused(tetrahedron, change_asset):
    moon = '<body name="moon"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>\n  </worldbody>'
    change_asset("scene.xml", "  </worldbody>", moon)
    with pytest.raises(MissionError, match=r"scene\.xml holds body moon"):
        build_model(2, shape=tetrahedron)


def test_a_changed_template_is_flown_by_mujoco_with_all_that_it_holds(change_asset):
    change_asset("cubesat.xml", SENSORS, FELT)
    telemetry = simulate(make_plan(load_scenario("eros-quick", {"duration_s": 600})))
    assert telemetry["felt"].dims == ("time", "spacecraft", "xyz") and telemetry["felt"].attrs["units"] == "m s-2"
    assert telemetry.attrs["stepper"] == "mujoco"
    with pytest.raises(ScenarioError, match=r"physics\.stepper = kernel: .*cubesat.xml"):
        make_plan(load_scenario("eros-quick", {"physics.stepper": "kernel"}))
