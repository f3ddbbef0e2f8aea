"""One short flight, and all that is written of it."""

import pytest

import swarm_mj as sm
from swarm_mj.interop.states import FlightStates
from swarm_mj.scenarios.loading import parse_overrides

#: Coarse, so that a flight takes a second.
CHEAP = ("telemetry.interval_s=5", "observation.interval_s=60", "camera.resolution_px=128")


@pytest.fixture(scope="session")
def flown():
    return sm.fly(sm.load("eros-quick", parse_overrides(CHEAP)))


@pytest.fixture(scope="session")
def states(flown):
    return FlightStates(flown.plan, flown.telemetry)


@pytest.fixture(scope="session")
def exported(flown, tmp_path_factory):
    """Folder of an export in all formats."""
    pytest.importorskip("spiceypy")
    folder = tmp_path_factory.mktemp("export") / "quick"
    flown.export(folder)
    return folder


@pytest.fixture
def spice(exported, monkeypatch):
    """SpiceyPy with the exported kernels, by their meta-kernel and nothing of ours."""
    import spiceypy

    monkeypatch.chdir(exported / "spice")
    spiceypy.kclear()
    spiceypy.furnsh("swarm.tm")
    yield spiceypy
    spiceypy.kclear()
