"""Nozzles of the packaged and of own spacecraft, and how forces are shared among them."""

import mujoco
import numpy as np
import pytest
from scipy.optimize import nnls

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight.spacecraft import own_spacecraft_from
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.scenarios.schema_propulsion import Thrusters
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.spacecraft.template import HUB, make_template
from swarm_mj.spacecraft.thrusters import CANT, Nozzles, ThrusterAllocation, packaged_nozzles, read_nozzles

SIZE = (0.1, 0.1, 0.34)


def random_nozzles(m, seed):
    rng = np.random.default_rng(seed)
    exhaust = rng.normal(size=(m, 3))
    return Nozzles(rng.uniform(-0.2, 0.2, (m, 3)), exhaust / np.linalg.norm(exhaust, axis=1)[:, None])


NOZZLES = {
    "six": packaged_nozzles("six", SIZE),
    "four_z": packaged_nozzles("four_z", SIZE),
    "five": random_nozzles(5, 1),
    "eight": random_nozzles(8, 2),
    "ten": random_nozzles(10, 3),
}


@pytest.mark.parametrize("name", NOZZLES)
def test_shares_are_the_non_negative_least_squares_of_scipy(name):
    nozzles = NOZZLES[name]
    allocation = ThrusterAllocation(nozzles, np.array([0.0, 0.01, 0.0]))
    wishes = np.random.default_rng(7).normal(size=(60, 3))
    found = allocation.thrusts(wishes)
    assert found.shape == (60, len(nozzles.exhaust_B)) and found.min() >= 0.0
    for wish, thrusts in zip(wishes, found, strict=True):
        best = nnls(-nozzles.exhaust_B.T, wish)[1]
        assert np.linalg.norm(-nozzles.exhaust_B.T @ thrusts - wish) == pytest.approx(best, abs=1e-6)


def test_six_nozzles_push_anywhere_without_torque_and_four_along_z():
    six, four = (ThrusterAllocation(NOZZLES[name], np.zeros(3)) for name in ("six", "four_z"))
    wish = np.random.default_rng(0).normal(size=(20, 3))
    assert six.thrusts(wish) @ six.force_B == pytest.approx(wish, rel=1e-9)
    assert np.abs(six.torque_B).max() == 0.0
    assert six.thrusts(wish).sum(axis=1) == pytest.approx(np.abs(wish).sum(axis=1))
    assert six.reaches_all and six.strength == pytest.approx(1.0)
    assert not four.reaches_all and four.axis_B == pytest.approx([0.0, 0.0, 1.0])
    assert four.strength == pytest.approx(4.0 * np.cos(CANT))
    shares = four.thrusts(np.array([[0.0, 0.0, 0.2]]))
    assert shares == pytest.approx(np.full((1, 4), 0.05 / np.cos(CANT)))
    assert shares @ four.torque_B == pytest.approx(np.zeros((1, 3)), abs=1e-12)
    assert four.thrusts(np.array([[0.0, 0.0, -1.0]])) == pytest.approx(np.zeros((1, 4)), abs=1e-12)


@pytest.mark.parametrize("layout", ["six", "four_z"])
@pytest.mark.parametrize("wheels", ["orthogonal", "pyramid"])
def test_the_template_has_a_site_for_every_nozzle_whose_z_axis_is_where_gas_leaves(layout, wheels):
    gas = Thrusters(layout=layout, thrust_n=0.05, propellant_kg=0.1, min_impulse_bit_n_s=0.0)
    properties = SpacecraftProperties(thrusters=gas, wheel_layout=wheels)
    model = make_template(properties, 0.1, 20.0).compile()
    found = read_nozzles(model, model.body(HUB).id)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for k, (position, exhaust) in enumerate(zip(found.position_B, found.exhaust_B, strict=True), 1):
        site = data.site(f"thruster_{k}")
        assert site.xpos == pytest.approx(position) and site.xmat.reshape(3, 3)[:, 2] == pytest.approx(exhaust)
        assert position @ exhaust > 0.0  # gas leaves outwards
    assert found.exhaust_B == pytest.approx(packaged_nozzles(layout, SIZE).exhaust_B)


OWN = """<mujoco><worldbody><body name="hub"><freejoint/><inertial pos="0 0 0.01" mass="5" diaginertia="0.05 0.05 0.02"/>
{sites}
<body name="a"><joint name="wheel_a" axis="1 0 0"/><inertial pos="0 0 0" mass="0.1" diaginertia="2e-5 1e-5 1e-5"/>{inner}</body>
<body name="b"><joint name="wheel_b" axis="0 1 0"/><inertial pos="0 0 0" mass="0.1" diaginertia="1e-5 2e-5 1e-5"/></body>
<body name="c"><joint name="wheel_c" axis="0 0 1"/><inertial pos="0 0 0" mass="0.1" diaginertia="1e-5 1e-5 2e-5"/></body>
</body></worldbody><actuator><motor name="wheel_a" joint="wheel_a" ctrlrange="-1e-3 1e-3"/>
<motor name="wheel_b" joint="wheel_b" ctrlrange="-1e-3 1e-3"/><motor name="wheel_c" joint="wheel_c" ctrlrange="-1e-3 1e-3"/>
</actuator></mujoco>"""
SITE = '<site name="thruster_main" pos="0 0 -0.1" zaxis="0 0 -1"/>'


def own(tmp_path, sites="", inner="", **thrusters):
    path = tmp_path / "own.xml"
    path.write_text(OWN.format(sites=sites, inner=inner))
    keys = {"layout": "sites", **thrusters}
    given = [f"spacecraft.mjcf={path}", *(f"spacecraft.thrusters.{key}={value}" for key, value in keys.items())]
    return own_spacecraft_from(load_scenario("eros-quick", parse_overrides(given)))


def test_an_own_spacecraft_has_its_nozzles_in_its_file(tmp_path):
    assert own(tmp_path, SITE).properties.thrusters.layout == "sites"
    for keys, words in (
        ({}, "has no nozzles; give it sites whose names begin with thruster_"),
        ({"sites": SITE, "inner": '<site name="thruster_2"/>'}, "site thruster_2 stands on body a: nozzles must be"),
        ({"sites": SITE, "propellant_kg": 5.5}, r"propellant_kg = 5\.5: must be below the hub's 5 kg"),
    ):
        with pytest.raises(ScenarioError, match=words):
            own(tmp_path, **keys)


@pytest.mark.parametrize(
    ("thrusters", "words"),
    [
        (
            "{propellant_kg: 7.7}",
            r"thrusters\.propellant_kg = 7\.7: is counted inside mass_kg and must be below",
        ),
        ("{propellant_kg: 0}", "propellant_kg"),
        ("{thrust_n: -1}", "thrust_n"),
        ("{layout: eight}", "layout"),
        ("{layout: sites}", r"layout = sites: must be six or four_z; sites are those of a spacecraft\.mjcf"),
        (
            "{min_impulse_bit_n_s: 0.1}",
            r"min_impulse_bit_n_s = 0\.1: must not exceed thrust_n \* control\.period_s = 0\.0275",
        ),
    ],
)
def test_thrusters_that_cannot_be_are_refused(thrusters, words):
    with pytest.raises(ScenarioError, match=words):
        load_scenario("eros-quick", parse_overrides([f"spacecraft.thrusters={thrusters}"]))


def test_a_model_without_nozzles_says_what_is_missing():
    model = make_template(SpacecraftProperties(), 0.1, 20.0).compile()
    with pytest.raises(MissionError, match="body cubesat has no nozzles"):
        read_nozzles(model, model.body(HUB).id)
