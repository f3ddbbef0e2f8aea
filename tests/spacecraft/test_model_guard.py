"""What the packaged spacecraft does not have is named: each of these was flown wrong without a word, or left out."""

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
from swarm_mj.spacecraft.model import build_model
from swarm_mj.spacecraft.model_guard import examine_spacecraft, measure
from swarm_mj.spacecraft.properties import SpacecraftProperties

HUB_END = "    </body>\n  </worldbody>"
MOTORS = "  <actuator>\n"
JOINT = '<joint name="wheel_y" type="hinge" axis="0 1 0"/>'
MOTOR = '<motor name="wheel_y" class="cubesat" joint="wheel_y"/>'
PANEL = '<body name="panel" pos="0.1 0 0"><inertial pos="0 0 0" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/>{}</body>'
BUS = '<geom name="bus" type="box" size="0.05 0.05 0.17" material="body"'

#: What is changed in cubesat.xml, and what the message must name.
CHANGES = {
    "an extra actuator, which drove the wrong wheel": (
        MOTORS,
        MOTORS + '    <motor name="boom" joint="wheel_x" ctrlrange="-1 1"/>\n',
        "actuator boom",
    ),
    "an extra body, which had no weight": (HUB_END, PANEL.format("") + HUB_END, "body panel: a body of 0.5 kg"),
    "a hinge": (HUB_END, PANEL.format('<joint name="fold" axis="0 0 1"/>') + HUB_END, "joint fold: a hinge joint"),
    "a sensor, which was left out": (
        "  <sensor>",
        '  <sensor><accelerometer name="felt" site="imu"/>',
        "sensor felt: accelerometer",
    ),
    "a geom that touches": (BUS, BUS + ' contype="1" conaffinity="1"', "geom bus: it may touch"),
    "a contact pair": (
        "  <actuator>",
        '  <contact><pair name="rub" geom1="bus" geom2="wheel_x"/></contact><actuator>',
        "contact pair rub",
    ),
    "a spring": (JOINT, JOINT.replace("/>", ' stiffness="1e-3"/>'), "joint wheel_y: a spring"),
    "a damper": (JOINT, JOINT.replace("/>", ' damping="1e-6"/>'), "joint wheel_y: a damper"),
    "dry friction": (JOINT, JOINT.replace("/>", ' frictionloss="1e-5"/>'), "joint wheel_y: dry friction"),
    "a limit": (JOINT, JOINT.replace("/>", ' range="-1 1"/>'), "joint wheel_y: a limit"),
    "an armature": (JOINT, JOINT.replace("/>", ' armature="1e-6"/>'), "joint wheel_y: an armature"),
    "a gear": (MOTOR, MOTOR.replace("/>", ' gear="-1"/>'), "actuator wheel_y: gear -1 0 0 0 0 0"),
    "a motor on another joint": (
        MOTOR,
        MOTOR.replace('joint="wheel_y"', 'joint="wheel_z"'),
        "actuator wheel_y: it does not drive the joint wheel_y",
    ),
    "a force range": (
        MOTOR,
        MOTOR.replace("/>", ' forcerange="-1e-3 1e-3"/>'),
        "actuator wheel_y: a torque of -0.001 to 0.001 N m",
    ),
    "a servo": (MOTOR, '<position name="wheel_y" joint="wheel_y" kp="1"/>', "actuator wheel_y: a bias"),
    "a slow motor": (
        MOTOR,
        '<general name="wheel_y" joint="wheel_y" dyntype="filter" dynprm="2" ctrlrange="-0.004 0.004"/>',
        "actuator wheel_y: dynamics",
    ),
    "a tendon": (
        "  <actuator>",
        '  <tendon><spatial name="rope" stiffness="1"><site site="imu"/><site site="dish"/></spatial></tendon><actuator>',
        "tendon rope",
    ),
    "an equality": (
        "  <actuator>",
        '  <equality><joint name="lock" joint1="wheel_x" joint2="wheel_y"/></equality><actuator>',
        "equality lock",
    ),
    "a medium": ('<option timestep="0.1"', '<option density="1.2" timestep="0.1"', "option: density"),
    "compensated gravity": ('<body name="wheel_y"', '<body name="wheel_y" gravcomp="1"', "body wheel_y: gravcomp"),
    "a keyframe": (
        "  <sensor>",
        '  <keyframe><key name="start" qpos="0 0 0 1 0 0 0 0 0 1"/></keyframe><sensor>',
        "keyframe start",
    ),
}


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


def test_the_packaged_spacecraft_holds_nothing_else_with_any_layout_of_wheels_and_any_mass():
    for layout in ("orthogonal", "orthogonal_and_skew", "pyramid"):
        properties = SpacecraftProperties(wheel_layout=layout, mass=12.0, size=(0.1, 0.2, 0.3), max_wheel_torque=0.01)
        assert template.examine_template(properties) == []


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_what_the_packaged_spacecraft_does_not_have_is_named(tetrahedron, change_asset, change):
    before, after, named = change
    change_asset("cubesat.xml", before, after)
    with pytest.raises(MissionError) as refused:
        build_model(2, shape=tetrahedron)
    assert named in str(refused.value)
    assert "allowed: " in str(refused.value) and "(spacecraft.mjcf)" in str(refused.value)


@pytest.mark.parametrize("part", [MOTOR, BUS + "/>"])
def test_a_part_that_the_template_lacks_is_named(tetrahedron, change_asset, part):
    change_asset("cubesat.xml", part, "")
    with pytest.raises(MissionError, match=r"(actuator wheel_y|geom bus) is missing.*spacecraft\.mjcf"):
        build_model(2, shape=tetrahedron)


def test_a_spacecraft_that_weighs_or_turns_otherwise_than_the_scenario_says_is_named():
    model = mujoco.MjModel.from_xml_path(str(asset_path("mjcf/cubesat.xml")))
    wheels = template.WHEELS
    assert not examine_spacecraft(model, SpacecraftProperties(), "cubesat", wheels)
    for properties, words in (
        (SpacecraftProperties(mass=8.001), "weighs 8 kg"),
        (SpacecraftProperties(size=(0.1, 0.1, 0.341)), "has the inertia"),
        (SpacecraftProperties(wheel_spin_inertia=2.4e-5), "joint wheel_x: carries"),
        (SpacecraftProperties(max_wheel_torque=0.005), "a torque of -0.004 to 0.004"),
    ):
        found = " ".join(map(str, examine_spacecraft(model, properties, "cubesat", wheels)))
        assert words in found


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
    before, after, _ = CHANGES["a sensor, which was left out"]
    change_asset("cubesat.xml", before, after)
    telemetry = simulate(make_plan(load_scenario("eros-quick", {"duration_s": 600})))
    assert telemetry["felt"].dims == ("time", "spacecraft", "xyz") and telemetry["felt"].attrs["units"] == "m s-2"
    assert telemetry.attrs["stepper"] == "mujoco"
    with pytest.raises(ScenarioError, match=r"physics\.stepper = kernel: .*sensor felt"):
        make_plan(load_scenario("eros-quick", {"physics.stepper": "kernel"}))
