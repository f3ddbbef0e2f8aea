"""A spacecraft's own file: what is measured of it, what is refused by name, and how copies of it are put together."""

import mujoco
import numpy as np
import pytest

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import make_plan
from swarm_mj.flight.spacecraft import own_spacecraft_from, unused_keys
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.own_model import build_own_model
from swarm_mj.spacecraft.own_spacecraft import read_spacecraft
from swarm_mj.spacecraft.properties import WHEEL_AXES, SpacecraftProperties

from .files import MOTOR, ORTHOGONAL, SPIN, mjcf

PANEL = """<body name="panel" pos="0.05 0 0"><joint name="fold" axis="0 1 0" stiffness="0.05" damping="1e-3"/>
  <geom name="cells" type="box" size="0.15 0.1 0.002" pos="0.15 0 0" mass="0.5"/></body>"""


@pytest.fixture(scope="module")
def tetrahedron():
    vertices = 1e3 * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return ShapeModel(vertices, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))


@pytest.fixture
def write(tmp_path):
    def written(text):
        path = tmp_path / "own.xml"
        path.write_text(text)
        return path

    return written


def read(path, **planned):
    return read_spacecraft(path, SpacecraftProperties(**planned))


def test_mass_and_inertia_are_those_of_hub_wheels_and_panel_together(write):
    own = read(write(mjcf(PANEL)))
    masses = np.array([8.0, 0.5])
    places = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]])
    box = 0.5 / 3.0 * np.array([0.1**2 + 0.002**2, 0.15**2 + 0.002**2, 0.15**2 + 0.1**2])
    own_inertias = [SpacecraftProperties().inertia_B, np.diag(box)]
    centre = masses @ places / masses.sum()
    arms = places - centre
    expected = sum(
        inertia + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        for mass, arm, inertia in zip(masses, arms, own_inertias, strict=True)
    )
    assert own.properties.mass == pytest.approx(8.5, rel=1e-12)
    assert own.properties.centre_B == pytest.approx(centre, abs=1e-12)
    assert np.allclose(own.properties.inertia_B, expected, rtol=1e-9, atol=1e-12)
    assert own.properties.wheel_spin_inertia == pytest.approx(SPIN, rel=1e-9)
    assert np.allclose(own.properties.inertia_effective_B, expected - SPIN * np.eye(3), rtol=1e-9, atol=1e-12)
    assert [(joint.name, joint.kind) for joint in own.joints] == [("fold", "hinge")]


def test_four_wheels_are_found_in_the_files_order_about_their_axes(write):
    axes = {f"wheel_{k}": tuple(axis) for k, axis in enumerate(WHEEL_AXES["pyramid"])}
    own = read(write(mjcf(wheels=axes)), max_wheel_speed=100.0)
    assert own.wheels == tuple(axes) and own.properties.n_wheels == 4
    assert np.allclose(own.properties.wheel_axes_B, WHEEL_AXES["pyramid"], atol=1e-9)
    assert own.properties.max_wheel_torque == 0.004 and own.properties.max_wheel_speed == 100.0


def test_a_spacecraft_as_the_packaged_one_turns_as_that_does(write):
    own = read(write(mjcf()))
    assert np.allclose(own.properties.inertia_B, SpacecraftProperties().inertia_B, rtol=1e-9, atol=1e-12)


BESIDE = '<body name="other"><freejoint/><geom size="0.1"/></body>'
FIXED = '<body name="pole" pos="1 0 0"><geom size="0.1"/></body>'
GIMBAL = '<body name="gimbal"><joint name="tilt" axis="1 0 0"/><geom size="0.05"/>{}</body>'
ODD = '<body name="wheel_odd"><joint name="wheel_odd" type="slide"/><geom size="0.05"/></body>'

REFUSED = {
    "a syntax error": (mjcf()[:-20], r"own\.xml: MuJoCo cannot read it: own\.xml is no XML: .*line"),
    "an element that MJCF has not": (mjcf("<panel/>"), r"cannot read it.*unrecognized element"),
    "no mass": (mjcf('<body name="dust"><joint name="a"/></body>'), r"mass and inertia of moving bodies"),
    "no hub": (mjcf().replace('<freejoint name="free"/>', ""), r"the file has none of body hub.*<freejoint/>"),
    "two hubs": (mjcf(beside=BESIDE), r"one body with a free joint.*the file has body hub, body other"),
    "a body beside the hub": (mjcf(beside=FIXED), r"body pole: stands beside the hub"),
    "a floor": (mjcf(beside='<geom name="floor" type="plane" size="1 1 1"/>'), r"geom floor: fixed in space"),
    "a tie to space": (
        mjcf(rest='<equality><weld name="tie" body1="hub"/></equality>'),
        r"equality tie: ties the spacecraft",
    ),
    "a missing wheel": (
        mjcf(wheels={k: ORTHOGONAL[k] for k in ("wheel_x", "wheel_y")}),
        r"three reaction wheels or more.*it has wheel_x, wheel_y",
    ),
    "no wheels": (mjcf(wheels={}), r"hinge joints whose names begin with 'wheel'.*it has none"),
    "a motor named wrongly": (
        mjcf(
            motors="".join(MOTOR.format(name=n) for n in ("wheel_x", "wheel_y")) + '<motor name="z" joint="wheel_z"/>'
        ),
        r"joint wheel_z: there is no motor of its name; actuator z drives it: name it wheel_z",
    ),
    "a missing motor": (mjcf(motors=MOTOR.format(name="wheel_x")), r"joint wheel_y: there is no motor of its name"),
    "two motors on one wheel": (
        mjcf(motors="".join(MOTOR.format(name=n) for n in ORTHOGONAL) + '<motor name="more" joint="wheel_y"/>'),
        r"joint wheel_y: actuator more drives it besides its motor",
    ),
    "a gear": (
        mjcf(motors="".join(MOTOR.format(name=n).replace("/>", ' gear="10"/>') for n in ORTHOGONAL)),
        r"actuator wheel_x: gear 10 0 0 0 0 0, not 1; a wheel needs <motor",
    ),
    "a range to one side": (
        mjcf(motors="".join(MOTOR.format(name=n).replace("-0.004", "0") for n in ORTHOGONAL)),
        r"actuator wheel_x: a torque of 0 to 0\.004 N m.*symmetric",
    ),
    "motors that differ": (
        mjcf(motors="".join(MOTOR.format(name=n).replace("0.004", f"0.00{k}") for k, n in enumerate(ORTHOGONAL, 1))),
        r"must be alike, but have the torque limits wheel_x 0\.001, wheel_y 0\.002, wheel_z 0\.003 N m",
    ),
    "wheels in a plane": (
        mjcf(wheels={"wheel_x": (1.0, 0, 0), "wheel_y": (0, 1.0, 0), "wheel_xy": (1.0, 1.0, 0)}),
        r"axes of wheel_x, wheel_y, wheel_xy lie in one plane",
    ),
    "a wheel that slides": (mjcf(ODD), r"joint wheel_odd: a wheel turns on one hinge; this is a slide joint"),
    "a wheel on a gimbal": (
        mjcf(GIMBAL.format('<body name="w"><joint name="wheel_g" axis="0 0 1"/><geom size="0.02"/></body>')),
        r"joint wheel_g: its wheel hangs on body gimbal, which moves against the hub",
    ),
}


@pytest.mark.parametrize("refused", REFUSED.values(), ids=REFUSED)
def test_a_file_that_holds_no_such_spacecraft_is_refused_by_name(write, refused):
    text, words = refused
    path = write(text)
    with pytest.raises(ScenarioError, match=words) as error:
        read(path)
    assert str(error.value).startswith(f"spacecraft.mjcf = {path}: ")


def test_files_that_are_none_or_too_large_are_refused(tmp_path, monkeypatch):
    for path in (tmp_path / "nothing.xml", tmp_path):
        with pytest.raises(ScenarioError, match="cannot read it"):
            read(path)
    monkeypatch.setattr("swarm_mj.spacecraft.model_limits.MAX_XML_BYTES", 100)
    large = tmp_path / "large.xml"
    large.write_text(mjcf())
    with pytest.raises(ScenarioError, match="larger than 100 bytes"):
        read(large)


def test_what_the_author_may_not_think_of_is_remarked(write):
    motors = "".join(f'<motor name="{name}" joint="{name}"/>' for name in ORTHOGONAL)
    text = mjcf(
        PANEL,
        motors=motors + '<position name="hold" joint="fold" kp="1"/>',
        option='<option integrator="implicitfast"/>',
        rest='<keyframe><key name="stowed"/></keyframe>',
    )
    own = read(write(text), max_wheel_torque=0.003)
    said = " ".join(own.remarks)
    assert own.properties.max_wheel_torque == 0.003
    for words in (
        "actuator hold belongs to no wheel",
        "spacecraft.wheel.max_torque_n_m = 0.003 N m is their limit",
        "integrator = IMPLICITFAST of the file is not used",
        "no keyframe of the file is named 'start'",
        "the centre of mass stands 11.8 mm off",
    ):
        assert words in said


def test_a_scenario_that_contradicts_the_file_is_refused_with_both_values_and_defaults_give_way(write):
    path = write(mjcf(PANEL))
    for key, given, found in (
        ("spacecraft.mass_kg", 12, "8.5"),
        ("spacecraft.wheel.spin_inertia_kg_m2", 3e-5, "2.387e-05"),
        ("spacecraft.wheel.max_torque_n_m", 0.01, "0.004"),
        ("spacecraft.wheel.mass_kg", 0.2, "0.13"),
    ):
        with pytest.raises(ScenarioError, match=rf"{key} = {given:g} in the scenario, {found} in .*own\.xml"):
            own_spacecraft_from(
                load_scenario("eros-quick", parse_overrides([f"spacecraft.mjcf={path}", f"{key}={given}"]))
            )
    with pytest.raises(ScenarioError, match=r"wheel_layout = pyramid in the scenario, the axes"):
        own_spacecraft_from(
            load_scenario("eros-quick", parse_overrides([f"spacecraft.mjcf={path}", "spacecraft.wheel_layout=pyramid"]))
        )
    for agreed in ("8.5", "8.0"):  # the file's, and the default that a written scenario gives
        scenario = load_scenario(
            "eros-quick", parse_overrides([f"spacecraft.mjcf={path}", f"spacecraft.mass_kg={agreed}"])
        )
        own = own_spacecraft_from(scenario)
        assert make_plan(scenario).properties.mass == pytest.approx(8.5)
        notes = unused_keys(scenario, own)
        assert notes == ([] if agreed == "8.5" else ["spacecraft.mass_kg = 8 is not used: it is 8.5 in own.xml"])


def test_keys_that_a_file_cannot_follow_are_refused(write):
    path = write(mjcf(PANEL))
    for override, words in (
        ("physics.stepper=kernel", r"physics\.stepper = kernel: flies the packaged CubeSat, not spacecraft\.mjcf"),
        ("dispersions.mass_percent=1", r"dispersions\.mass_percent = 1"),
        ("dispersions.inertia_percent=1", r"dispersions\.inertia_percent = 1"),
    ):
        with pytest.raises(ScenarioError, match=words):
            load_scenario("eros-quick", parse_overrides([f"spacecraft.mjcf={path}", override]))


def test_the_path_of_the_file_is_meant_relative_to_the_scenario(tmp_path, monkeypatch):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/own.xml").write_text(mjcf())
    (tmp_path / "mine.yaml").write_text("name: mine\nspacecraft: {mjcf: parts/own.xml}\n")
    monkeypatch.chdir(tmp_path.parent)
    scenario = load_scenario(tmp_path / "mine.yaml")
    assert scenario.spacecraft.mjcf == str(tmp_path / "parts/own.xml")


def test_every_copy_in_a_swarm_is_the_spacecraft_of_the_file_with_nothing_left_out(write, tmp_path, tetrahedron):
    (tmp_path / "fin.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    text = mjcf(
        PANEL.replace('stiffness="0.05"', 'stiffness="0.05" range="-40 40" class="stiff"')
        + '<geom name="fin" type="mesh" mesh="fin" mass="0"/>',
        sensors='<jointpos name="angle" joint="fold"/><gyro site="imu"/>',
        option='<default><default class="stiff"><joint armature="1e-5"/></default></default>'
        '<asset><mesh name="fin" file="fin.obj" scale="0.1 0.1 0.1"/></asset>',
    ).replace('angle="radian"', 'angle="degree"')
    path = write(text)
    alone, own = mujoco.MjModel.from_xml_path(str(path)), read(path)
    swarm = build_own_model(6, own, shape=tetrahedron, timestep=0.1)
    model = swarm.mjmodel
    assert model.nsensor == 12 and model.nu == 18 and model.ngeom == 1 + 6 * alone.ngeom
    hinge = alone.joint("fold")
    for name in swarm.names:
        copy = model.joint(f"{name}_fold")
        assert copy.range == pytest.approx(np.radians([-40, 40])) and np.array_equal(copy.range, hinge.range)
        assert model.dof_armature[copy.dofadr[0]] == 1e-5
        assert model.body_subtreemass[model.body(f"{name}_hub").id] == pytest.approx(8.5)
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 and model.opt.timestep == 0.1
    assert not model.opt.disableflags & (mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_CONTACT)
    assert np.array_equal(model.opt.gravity, np.zeros(3))


def test_places_by_name_follow_the_names_whatever_the_order_of_the_file(write, tetrahedron):
    early = '<body name="first"><joint name="first" type="ball"/><geom size="0.01" mass="0.1"/></body>'
    text = mjcf(motors="".join(MOTOR.format(name=name) for name in reversed(ORTHOGONAL)))
    text = text.replace('<site name="imu"/>', '<site name="imu"/>' + early)
    swarm = build_own_model(2, read(write(text)), shape=tetrahedron, timestep=0.1)
    layout, model = swarm.layout, swarm.mjmodel
    data = mujoco.MjData(model)
    qpos, qvel = np.arange(20.0).reshape(2, 10), np.arange(18.0).reshape(2, 9)
    swarm.set_state(data, qpos, qvel)
    assert all(np.array_equal(*pair) for pair in zip(swarm.state(data), (qpos, qvel), strict=True))
    for j, name in enumerate(swarm.names):
        for w, wheel in enumerate(ORTHOGONAL):
            assert data.joint(f"{name}_{wheel}").qvel[0] == qvel[j, 6 + w]
            data.ctrl[layout.ctrl[j, w]] = 1 + w + 10 * j
            assert data.actuator(f"{name}_{wheel}").ctrl[0] == 1 + w + 10 * j
        assert np.array_equal(data.joint(f"{name}_free").qpos, qpos[j, :7])
        assert np.array_equal(data.joint(f"{name}_first").qvel, np.zeros(3))


def test_spacecraft_do_not_touch_each_other_but_a_panel_may_touch_its_hub(write, tetrahedron):
    # Both stand at one point; the flap of each, two joints away from its hub, reaches into it.
    flap = (
        '<geom name="bus" type="box" size="0.05 0.05 0.17"/><body name="arm" pos="0.1 0 0"><joint name="arm" axis="0 0 1"/>'
        '<geom name="arm" size="0.01" mass="0.1"/><body name="flap"><joint name="flap" axis="0 0 1"/>'
        '<geom name="flap" type="box" size="0.06 0.01 0.01" mass="0.1"/></body></body>'
    )
    swarm = build_own_model(2, read(write(mjcf(flap))), shape=tetrahedron, timestep=0.01)
    data = mujoco.MjData(swarm.mjmodel)
    mujoco.mj_forward(swarm.mjmodel, data)
    touching = {tuple(sorted(swarm.mjmodel.geom(g).name for g in pair)) for pair in data.contact.geom}
    assert touching == {("sc1_bus", "sc1_flap"), ("sc2_bus", "sc2_flap")}


def test_a_swarm_of_too_many_bodies_or_pairs_is_refused(write, tetrahedron, monkeypatch):
    own = read(write(mjcf(PANEL)))
    monkeypatch.setattr("swarm_mj.spacecraft.own_model.MAX_BODIES", 10)
    with pytest.raises(ScenarioError, match=r"3 spacecraft of 5 bodies: at most 10"):
        build_own_model(3, own, shape=tetrahedron, timestep=0.1)
    monkeypatch.undo()
    monkeypatch.setattr("swarm_mj.spacecraft.own_model.MAX_EXCLUDES", 2)
    with pytest.raises(ScenarioError, match="too many pairs to keep apart"):
        build_own_model(3, own, shape=tetrahedron, timestep=0.1)
