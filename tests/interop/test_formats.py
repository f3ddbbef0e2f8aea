"""What viewers of glTF and readers of tables are given says what the telemetry says."""

import json

import numpy as np
import pandas as pd

from swarm_mj.spacecraft.attitude.mrp import dcm


def test_the_scene_shows_body_and_spacecraft_as_at_the_arrival(exported, states):
    import trimesh

    scene = trimesh.load(exported / "gltf" / "scene.glb")
    k = states.arrival
    up, _ = scene.graph["N"]
    assert np.abs(up[:3, :3] @ [0, 0, 1] - [0, 1, 0]).max() == 0  # z of N is up, which is y in glTF
    for j, name in enumerate(states.plan.names):
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
