"""Flights that are kept on disk: an interrupted design goes on with them, bit for bit, and what is spoilt is flown again."""

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.designer.candidates import kept_flights, visibility
from swarm_mj.designer.candidates.flights import Unreachable, fly_candidates
from swarm_mj.designer.candidates.kept_flights import FLOWN, flights_from, fly, keep, kept
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.smallbody.shape import ShapeModel
from tests.designer.candidates.test_visibility import scenario

ALTITUDES = "designer.altitudes_m=[12000,14000,16000]"


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture(scope="module")
def arrays():
    return fly(scenario())


def counted(monkeypatch, stop_after=99):
    """How often candidates are flown; after so many times an interruption comes."""
    flown = []

    def count(*arguments):
        if len(flown) == stop_after:
            raise KeyboardInterrupt
        flown.append(arguments)
        return fly(*arguments)

    monkeypatch.setattr(visibility, "fly", count)
    return flown


def test_flights_come_back_from_disk_bit_for_bit(arrays):
    expected = fly_candidates(scenario())
    assert kept(scenario()) is None
    keep(scenario(), arrays)
    found = flights_from(scenario(), kept(scenario()))
    for name in (*FLOWN, "times", "counts", "delta_v", "beyond"):
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name
    assert (found.points, found.left_out) == (expected.points, expected.left_out)
    for name in ("v0_N", "miss_m", "mothership_velocity_N", "arrival_s"):
        assert np.array_equal(getattr(found.plan.deployment, name), getattr(expected.plan.deployment, name))
    assert np.array_equal(found.plan.least_radius, expected.plan.least_radius)


def test_insertion_burns_come_back_too():
    burning = load_scenario(scenario(), {
        "spacecraft.thrusters": {"thrust_n": 50, "propellant_kg": 1}, "mothership.velocity": "rest"
    })  # fmt: skip
    expected = fly_candidates(burning)
    keep(burning, fly(burning))
    found = flights_from(burning, kept(burning))
    burns = [
        [(b.spacecraft, b.t, *b.delta_v_N) for b in flights.plan.deployment.burns] for flights in (found, expected)
    ]
    assert burns[0] == burns[1] and len(burns[0]) > 0
    assert np.array_equal(found.delta_v, expected.delta_v)
    assert found.plan.deployment.push == expected.plan.deployment.push


def test_an_interrupted_design_goes_on_with_what_is_flown_and_is_the_same(monkeypatch):
    asked = scenario(ALTITUDES)
    with monkeypatch.context() as patch:
        flown = counted(patch, stop_after=2)
        with pytest.raises(KeyboardInterrupt):
            visibility.visibility(asked, workers=1)
        assert len(flown) == 2
    flown = counted(monkeypatch)
    resumed = visibility.visibility(asked, workers=1)
    assert len(flown) == 1
    assert resumed.resumed.startswith(
        "kept from before: the flights of 2 of 3 sets of candidates, the pictures of 0 of "
    )
    monkeypatch.setenv("SWARM_MJ_CACHE", "/dev/null")
    whole = visibility.visibility(asked, workers=1)
    assert whole.resumed == "" and len(flown) == 4
    assert whole.candidates == resumed.candidates
    for name in ("sees", "delta_v", "point_A", "why"):
        assert np.array_equal(getattr(whole, name), getattr(resumed, name))


@pytest.mark.parametrize("spoil", ["cut", "bit", "empty", "other"])
def test_a_spoilt_file_is_not_believed(arrays, own_cache, spoil):
    keep(scenario(), arrays)
    (file,) = own_cache.glob("flights/*.npz")
    raw = bytearray(file.read_bytes())
    if spoil == "bit":
        raw[len(raw) // 2] ^= 1
    if spoil == "other":
        np.savez(file, **{**arrays, "r_A": arrays["r_A"][:-1]})
    else:
        file.write_bytes({"cut": raw[:-200], "bit": raw, "empty": b""}[spoil])
    assert kept(scenario()) is None


def test_what_cannot_be_flown_to_is_kept_with_its_reasons(monkeypatch):
    asked = scenario("mothership.position_A_m=[20000, -18000, 0]")
    first = pytest.raises(Unreachable, visibility.visibility, asked, workers=1).value
    flown = counted(monkeypatch)
    second = pytest.raises(Unreachable, visibility.visibility, asked, workers=1).value
    assert not flown and (str(first), first.left_out) == (str(second), second.left_out)
    why = {"left_out": np.array([3, 8]), "why": np.array(["too far", "inside the body"]), "refused": np.array("none")}
    keep(asked, why)
    found = kept(asked)
    assert found is not None
    told = pytest.raises(Unreachable, flights_from, asked, found).value
    assert str(told) == "none" and told.left_out == {3: "too far", 8: "inside the body"}


def test_flights_depend_on_the_scenario_its_files_and_the_program(arrays, tmp_path, monkeypatch):
    body = {"shape": str(tmp_path / "body.obj"), "gravity": {"model": "point_mass", "parameters": {"gm": 4e5}}}
    for size in (1.0, 1.001):
        shape = sm.build_shape("eros", 6)
        sm.save_shape(ShapeModel(size * shape.vertices, shape.faces), body["shape"])
        own = load_scenario(scenario(), {"body": body})
        assert kept(own) is None
        keep(own, arrays)
        assert kept(own) is not None
    keep(scenario(), arrays)
    assert kept(scenario("duration_s=1700")) is None
    monkeypatch.setattr(kept_flights, "_program", lambda: "another one")
    assert kept(scenario()) is None


def test_flights_under_plug_ins_of_others_are_not_kept(tmp_path, own_cache):
    (tmp_path / "mine.py").write_text(
        "class Point:\n"
        "    def __init__(self, shape, gm=4.46e5):\n        self.gm = gm\n"
        "    def acceleration(self, r_A):\n"
        "        return -self.gm * r_A / (r_A**2).sum(axis=1, keepdims=True) ** 1.5\n"
    )
    own = load_scenario(scenario(), {"body.gravity": {"model": f"{tmp_path / 'mine.py'}:Point"}})
    keep(own, {})
    assert kept(own) is None
    assert not list(own_cache.glob("flights/*"))
