"""Files of spacecraft that leave late: they begin at the release, as readers of others find them."""

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.mission.trajectories import propagate
from swarm_mj.scenarios.loading import parse_overrides
from swarm_mj.smallbody.naif import BodyName

from .conftest import CHEAP

LATE = {"sc1": 0.0, "sc2": 60.0}


@pytest.fixture(scope="module")
def late():
    """A flight whose second spacecraft leaves after the first."""
    stops = ", ".join(f"{{time_of_flight_s: {300 - release}, release_s: {release}}}" for release in LATE.values())
    return sm.fly(
        sm.load(
            "eros-quick",
            parse_overrides([*CHEAP, "duration_s=300", "design.time_of_flight_s=300", f"design.observers=[{stops}]"]),
        )
    )


@pytest.fixture(scope="module")
def folder(late, tmp_path_factory):
    pytest.importorskip("spiceypy")
    folder = tmp_path_factory.mktemp("late") / "export"
    late.export(folder)
    return folder


def epoch(spice, folder):
    """Seconds of TDB past J2000 of the flight's first instant, from the first spacecraft's message."""
    return spice.str2et(times_of(folder, "oem", "sc1")[0].replace("T", " ") + " TDB")


def times_of(folder, kind, name):
    lines = (folder / kind / f"{name}.{kind}").read_text().splitlines()
    return [line.split()[0] for line in lines if line[:2] == "20" and "=" not in line]


def test_spice_knows_each_from_its_release_on_and_right_after_it(late, folder, monkeypatch):
    import spiceypy as spice

    monkeypatch.chdir(folder / "spice")
    spice.kclear()
    spice.furnsh("swarm.tm")
    deployment, environment = late.plan.deployment, late.plan.environment
    start, body = epoch(spice, folder), str(BodyName.of(late.plan.scenario.body.name).code)
    for j, release in enumerate(LATE.values()):
        code = -900_001 - j
        first, last = spice.wnfetd(spice.spkcov("swarm.bsp", code), 0)
        assert (first - start, last - start) == pytest.approx((release, 300.0), abs=1e-5)
        # Half a sample after the release, where a fit across the push would be wrong by metres.
        r, v = propagate(
            environment.acceleration_N,
            deployment.release_r_N[j : j + 1],
            deployment.v0_N[j : j + 1],
            np.array([release, release + 2.5]),
        )
        state, _ = spice.spkezr(str(code), start + release + 2.5, "ECLIPJ2000", "NONE", body)
        assert np.linalg.norm(1e3 * state[:3] - r[-1, 0]) < 0.01
        assert np.linalg.norm(1e3 * state[3:] - v[-1, 0]) < 1e-3
        if release:
            with pytest.raises(spice.exceptions.SpiceyError):
                spice.spkezr(str(code), start + release - 2.5, "ECLIPJ2000", "NONE", body)
    frames = [
        spice.wnfetd(spice.ckcov("swarm.bc", c, False, "INTERVAL", 0.0, "TDB"), 0) for c in spice.ckobj("swarm.bc")
    ]
    begins = sorted(round(a - start, 3) for a, _ in frames)
    assert begins == pytest.approx(sorted([*LATE.values(), *[0.0] * (late.plan.n - len(LATE))]), abs=1e-2)
    spice.kclear()


def test_messages_tables_and_scene_begin_at_the_release(late, folder):
    import trimesh

    scene = trimesh.load(folder / "gltf" / "scene.glb")
    for j, (name, release) in enumerate(LATE.items()):
        samples = round((300.0 - release) / 5.0) + 1
        for kind in ("oem", "aem"):
            assert len(times_of(folder, kind, name)) == samples
        path = np.asarray(scene.geometry[f"{name}_path"].vertices)
        assert np.allclose(path[0], late.plan.deployment.release_r_N[j], atol=0.1)
