"""What STK, Vizard, Cosmographia, viewers of glTF and readers of tables are given says what the telemetry says."""

import json
import struct

import numpy as np
import pandas as pd
import pytest

from swarm_mj.spacecraft.attitude.mrp import dcm
from tests.interop.test_ccsds import C_of_scalar_last
from tests.interop.test_kernels import MICRORADIAN, angle


def stk_table(path, table):
    """Keys and numbers of an STK file, read as its help describes them."""
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    start = lines.index(table)
    keys = dict(line.split(maxsplit=1) for line in lines[2:start])
    assert lines[0] == "stk.v.11.0" and lines[1].startswith("BEGIN ") and lines[-1] == lines[1].replace("BEGIN", "END")
    return keys, np.array([[float(x) for x in line.split()] for line in lines[start + 1 : -1]])


def test_stk_gets_path_and_attitude(exported, states, spice):
    keys, rows = stk_table(exported / "stk" / "sc1.e", "EphemerisTimePosVel")
    C = spice.pxform("ECLIPJ2000", "J2000", 0.0)
    assert (keys["CentralBody"], keys["CoordinateSystem"]) == ("Eros", "J2000")
    assert int(keys["NumberOfEphemerisPoints"]) == len(rows) == len(states.times)
    # Its epoch is in UTC: SPICE makes TDB of it with our leap seconds.
    assert spice.str2et(keys["ScenarioEpoch"]) == pytest.approx(states.et[0], abs=2e-6)
    assert np.array_equal(rows[:, 0], states.times)
    assert np.abs(rows[:, 1:4] - states.states_N[:, 0, :3] @ C.T).max() < 1e-3
    keys, rows = stk_table(exported / "stk" / "sc1.a", "AttitudeTimeQuaternions")
    C_BN = dcm(states.telemetry["sigma_BN"].values[:, 0])
    assert keys["CoordinateAxes"] == "J2000"
    assert angle(C_of_scalar_last(rows[:, 1:]) @ C @ np.swapaxes(C_BN, 1, 2)).max() < MICRORADIAN


def varint(data, at):
    value = shift = 0
    while True:
        value |= (data[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 0x80:
            return value, at


def fields(data):
    """Fields of a message of protocol buffers: number and content."""
    at = 0
    while at < len(data):
        key, at = varint(data, at)
        if key & 7 == 0:
            value, at = varint(data, at)
        elif key & 7 == 1:
            value, at = struct.unpack_from("<d", data, at)[0], at + 8
        else:
            assert key & 7 == 2
            length, at = varint(data, at)
            value, at = data[at : at + length], at + length
        yield key >> 3, value


def test_vizard_gets_a_message_a_sample(exported, states):
    data, at, messages = (exported / "vizard" / "flight.bin").read_bytes(), 0, []
    while at < len(data):
        length, at = varint(data, at)
        messages.append(list(fields(data[at : at + length])))
        at += length
    assert at == len(data) and len(messages) == len(states.times)
    k = 30
    craft = [dict(fields(content)) for number, content in messages[k] if number == 3]
    assert [c[1].decode() for c in craft] == list(states.names)
    assert np.abs(np.frombuffer(craft[1][2]) - states.states_E[k, 1, :3]).max() < 1e-9
    C_BE = dcm(np.frombuffer(craft[1][4]))
    assert np.abs(C_BE - C_of_scalar_last(states.q_BE[k, 1][[1, 2, 3, 0]])).max() < 1e-12
    bodies = [dict(fields(content)) for number, content in messages[k] if number == 2]
    assert [body[1].decode() for body in bodies] == ["eros", "sun"]
    time = dict(fields(messages[k][0][1]))
    assert (time[1], time[2]) == (k, states.times[k] * 1e9)
    assert 8 in dict(messages[0]) and 8 not in dict(messages[1])


def test_cosmographia_gets_names_that_spice_knows_and_files_that_exist(exported, states, spice):
    place = exported / "cosmographia"
    catalogues = {p.name: json.loads(p.read_text()) for p in place.glob("*.json")}
    assert all(catalogue["version"] == "1.0" for catalogue in catalogues.values())
    for name in catalogues["load.json"]["require"]:
        assert name in catalogues
    for name in catalogues["spice.json"]["spiceKernels"]:
        assert (place / name).is_file()
    for name in ("body.json", "spacecraft.json"):
        for item in catalogues[name]["items"]:
            spice.bods2c(item["trajectory"]["target"])
            spice.bods2c(item["trajectory"]["center"])
            assert spice.namfrm(item["bodyFrame"]["name"]) != 0
            assert abs(spice.str2et(item["startTime"]) - states.et[0]) < 1e-6
    for item in catalogues["sensors.json"]["items"]:
        spice.getfov(spice.bodn2c(item["geometry"]["instrName"]), 10)
        assert item["parent"] in [craft["name"] for craft in catalogues["spacecraft.json"]["items"]]
    words = (place / "body.cmod").read_text().split()
    count = int(words[words.index("vertices") + 1])
    assert words[0] == "#celmodel__ascii" and count == len(states.plan.shape.vertices)
    first = [float(x) for x in words[words.index("vertices") + 2 :][:3]]
    assert np.abs(1e3 * np.array(first) - states.plan.shape.vertices[0]).max() < 1e-2


def test_the_scene_shows_body_and_spacecraft_as_at_the_visit(exported, states):
    import trimesh

    scene = trimesh.load(exported / "gltf" / "scene.glb")
    k = states.visit
    up, _ = scene.graph["N"]
    assert np.abs(up[:3, :3] @ [0, 0, 1] - [0, 1, 0]).max() == 0  # z of N is up, which is y in glTF
    for j, name in enumerate(states.names):
        pose = np.linalg.inv(up) @ scene.graph[name][0]
        assert np.abs(pose[:3, 3] - states.states_N[k, j, :3]).max() < 1e-2
        assert np.abs(pose[:3, :3] - dcm(states.telemetry["sigma_BN"].values[k, j]).T).max() < 1e-6
        path = scene.geometry[f"{name}_path"]
        assert np.abs(path.vertices[0] - states.states_N[0, j, :3]).max() < 1e-2
    pose = np.linalg.inv(up) @ scene.graph["EROS"][0]
    assert np.abs(pose[:3, :3] - states.plan.environment.C_AN(states.times[k]).T).max() < 1e-6
    assert len(scene.geometry["EROS"].faces) == len(states.plan.shape.faces)


def test_tables_say_their_units_and_hold_every_bit(exported, states):
    place = exported / "csv"
    package = json.loads((place / "datapackage.json").read_text())
    assert [resource["path"] for resource in package["resources"]] == ["sc1.csv", "sc2.csv"]
    table = pd.read_csv(place / "sc2.csv")
    described = package["resources"][1]["schema"]["fields"]
    assert list(table.columns) == [field["name"] for field in described]
    assert all(
        field["description"] and field["name"] == f"{field['name'].split(' [')[0]} [{field['unit']}]"
        for field in described
    )
    r = table[[f"r_BN_N_{axis} [m]" for axis in "xyz"]].to_numpy()
    assert np.array_equal(r, states.states_N[:, 1, :3])
    assert table["tdb [ISO 8601]"][1] == "2018-01-01T03:15:05.000"
    r_A = table[[f"r_BN_A_{axis} [m]" for axis in "xyz"]].to_numpy()
    expected = [states.plan.environment.C_AN(t) @ x for t, x in zip(states.times, r, strict=True)]
    assert np.abs(r_A - expected).max() < 1e-6
