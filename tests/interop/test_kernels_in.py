"""Flights by the user's SPICE kernels: rotation, Sun and Earth, shape; what is missing in them is refused in one line."""

import sys

import numpy as np
import pytest
import yaml

import swarm_mj as sm
from swarm_mj.errors import InteropError, ScenarioError, ShapeError, SwarmError
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import parse_overrides
from tests.interop.conftest import CHEAP
from tests.interop.test_kernels import angle

spiceypy = pytest.importorskip("spiceypy")

#: Eros as the scenario has it, in the words of a PCK, and with a pole that wanders by 50 deg a century.
EROS_PCK = """KPL/PCK
\\begindata
BODY2000433_POLE_RA = ( 11.363 0 0 )
BODY2000433_POLE_DEC = ( 17.232 0 0 )
BODY2000433_PM = ( 326.08 1639.389232 0 )
"""


@pytest.fixture
def kernels(exported):
    """Of the exported flight: how the body turns and where Sun and Earth stand."""
    return [str(exported / "spice" / name) for name in ("body.tpc", "swarm.tf", "sun_earth.bsp")]


def by(kernels, *overrides, **keys):
    names = [str(kernel) for kernel in kernels]
    return sm.load({"name": "by-kernels", "ephemerides": {"kernels": names, **keys}}, parse_overrides(overrides))


def environment(scenario):
    return environment_from(scenario, load_body_shape(scenario.body))


def test_a_flight_by_its_own_exported_kernels_is_the_same_flight(flown, kernels):
    again = sm.fly(sm.load("eros-quick", parse_overrides([*CHEAP, f"ephemerides.kernels={kernels}"])))
    ours, theirs = flown.plan.environment, again.plan.environment
    for t in (0.0, 600.0, 1200.0):
        assert angle(ours.C_AN(t) @ theirs.C_AN(t).T) < 1e-9
        assert np.linalg.norm(ours.sun.at(t) - theirs.sun.at(t)) < 1e-2
        assert np.linalg.norm(ours.earth.at(t) - theirs.earth.at(t)) < 1e-2
    assert theirs.spin_rate == pytest.approx(ours.spin_rate, rel=1e-12)
    assert np.abs(again.telemetry["r_BN_N"].values - flown.telemetry["r_BN_N"].values).max() < 1e-3
    assert np.array_equal(again.coverage.seen, flown.coverage.seen)
    assert "body.tpc" in again.telemetry.attrs["scenario_yaml"]


def test_a_pck_in_the_words_of_the_iau_turns_eros_as_the_scenario_does(tmp_path):
    """But for the obliquity, which the scenario rounds: 84381.448 arcsec is 23.4392911 deg, and not 23.43928."""
    path = tmp_path / "eros.tpc"
    path.write_text(EROS_PCK)
    built_in, theirs = environment(sm.load("eros-quick")), environment(by([path], positions=False))
    for t in (0.0, 5000.0):
        difference = angle(built_in.C_AN(t) @ theirs.C_AN(t).T)
        assert difference == pytest.approx(np.radians(84381.448 / 3600 - 23.43928), rel=0.05)
    assert theirs.spin_N @ built_in.spin_N > 0
    assert np.array_equal(theirs.sun.position, built_in.sun.position)


def test_sun_and_earth_stand_where_a_hand_made_spk_says(tmp_path):
    """A body at rest at 1.5 au in the equatorial frame, the Earth at 1 au across from it."""
    path, au = tmp_path / "made.bsp", 149_597_870.7
    handle = spiceypy.spkopn(str(path), "made", 0)
    et = np.array([5.6e8, 5.8e8])
    for target, center, state in (
        (10, 0, np.zeros(6)),
        (399, 10, np.array([0.0, au, 0.0, 1.0, 0.0, 0.0])),
        (-77, 10, np.array([1.5 * au, 0.0, 0.0, 0.0, 0.0, 2.0])),
    ):
        states = np.array([np.concatenate([state[:3] + state[3:] * (t - et[0]), state[3:]]) for t in et])
        spiceypy.spkw13(handle, target, center, "J2000", et[0], et[1], "made", 3, 2, states, et)
    spiceypy.spkcls(handle)
    made = environment(by([path], body="-77", rotation=False))
    past = 568048500.0 - et[0]  # 2018-01-01T03:15:00
    e = np.radians(84381.448 / 3600)
    to_N = np.array([[1, 0, 0], [0, np.cos(e), np.sin(e)], [0, -np.sin(e), np.cos(e)]])
    sun = -to_N @ np.array([1.5 * au, 0.0, 2.0 * past])
    earth = sun + to_N @ np.array([past, au, 0.0])
    assert np.linalg.norm(made.sun.position / 1e3 - sun) < 1e-3
    assert np.linalg.norm(made.earth.position / 1e3 - earth) < 1e-3
    assert np.abs(made.sun.velocity - to_N @ [0, 0, -2e3]).max() < 1e-9
    assert np.abs(made.earth.velocity - to_N @ [1e3, 0, -2e3]).max() < 1e-9


def test_the_pool_is_as_before_and_scenarios_without_kernels_need_no_spiceypy(kernels, monkeypatch):
    spiceypy.kclear()
    spiceypy.furnsh(kernels[1])
    environment(by(kernels))
    assert [spiceypy.kdata(0, "ALL")[0]] == [kernels[1]] and spiceypy.ktotal("ALL") == 1
    assert not spiceypy.expool("BODY2000433_POLE_RA")
    spiceypy.kclear()
    monkeypatch.setitem(sys.modules, "spiceypy", None)
    environment(sm.load("eros-quick"))
    with pytest.raises(InteropError, match=r"pip install 'swarm_mj\[spice\]'"):
        environment(by(kernels))


def test_what_kernels_do_not_say_is_refused_with_the_remedy(kernels, tmp_path):
    wandering = tmp_path / "wandering.tpc"
    wandering.write_text(EROS_PCK.replace("( 11.363 0 0 )", "( 11.363 1e7 0 )"))
    text = tmp_path / "notes.txt"
    text.write_text("no kernel\n")
    cut = tmp_path / "cut.bsp"
    cut.write_bytes(open(kernels[2], "rb").read()[:1500])
    pck, fk, spk = kernels
    cases = [
        (
            by(["none.bsp"]),
            r"ephemerides.kernels = none.bsp: cannot be read .no such file.; give the path of a SPICE kernel",
        ),
        (by([text]), r"ephemerides.kernels = .*notes.txt: is no SPICE kernel"),
        (by([cut]), r"(ephemerides.kernels = .*cut.bsp|ephemerides.body = ).*"),
        (
            by([pck, fk]),
            r"ephemerides.body = 2000433: SUN as seen from it .*add SPKs of body, Sun and Earth .*positions: false",
        ),
        (by([spk]), r"ephemerides.frame = IAU_EROS: SPICE says .*add a PCK or CK .*rotation: false"),
        (
            by(kernels, frame="IAU_ERSO"),
            r"ephemerides.frame = IAU_ERSO: unknown to SPICE and to the kernels; name a frame",
        ),
        (by(kernels, body="ERSO"), r"ephemerides.body = ERSO: .*"),
        (
            by(kernels, "epoch=2030-01-01T00:00:00"),
            r"ephemerides.body = 2000433: SUN as seen .* SPICE\(SPKINSUFFDATA\).*",
        ),
        (by([wandering], positions=False), r"leaves a uniform rotation about its axis z by .* rad .*rotation: false"),
    ]
    for scenario, words in cases:
        with pytest.raises(ScenarioError, match=rf"^[^\n]*{words}[^\n]*$"):
            environment(scenario)
        assert spiceypy.ktotal("ALL") == 0 and not spiceypy.failed()


def test_kernels_are_found_beside_the_scenarios_file(kernels, tmp_path, monkeypatch):
    folder = tmp_path / "mission"
    folder.mkdir()
    (folder / "eros.tpc").write_text(EROS_PCK)
    content = {"name": "mine", "ephemerides": {"kernels": ["eros.tpc"], "positions": False}}
    (folder / "mine.yaml").write_text(yaml.safe_dump(content))
    monkeypatch.chdir(tmp_path)
    assert sm.load("mission/mine.yaml").ephemerides.kernels == (str(folder / "eros.tpc"),)


def test_a_shape_kernel_is_a_shape(exported, states):
    shape = sm.load_shape(exported / "spice" / "body.bds")
    assert np.abs(shape.vertices - states.plan.shape.vertices).max() < 1e-9
    assert np.array_equal(shape.faces, states.plan.shape.faces)
    scenario = sm.load(
        "eros-quick",
        parse_overrides(
            [
                f"body.shape={exported / 'spice' / 'body.bds'}",
                "body.gravity.model=point_mass",
                "body.gravity.parameters={gm: 446275}",
            ]
        ),
    )
    assert len(make_plan(scenario).shape.faces) == len(shape.faces)


@pytest.mark.parametrize(
    "spoil", [lambda raw: b"", lambda raw: b"DAS/DSK ", lambda raw: raw[:3000], lambda raw: b"\0" * 4096]
)
def test_a_broken_shape_kernel_is_refused(exported, tmp_path, spoil):
    path = tmp_path / "broken.bds"
    path.write_bytes(spoil((exported / "spice" / "body.bds").read_bytes()))
    with pytest.raises(ShapeError, match=r"^[^\n]*broken.bds: [^\n]*; [^\n]*$"):
        sm.load_shape(path)
    other = tmp_path / "swarm.bds"
    other.write_bytes((exported / "spice" / "swarm.bsp").read_bytes())
    with pytest.raises(SwarmError, match="swarm.bds: SPICE says"):
        sm.load_shape(other)
