import pytest

import swarm_mj as sm
from swarm_mj.scenarios.loading import parse_overrides

#: Coarse, so that a flight takes a second.
CHEAP = ("telemetry.interval_s=10", "observation.interval_s=60", "camera.resolution_px=128")


@pytest.fixture(scope="session")
def flight():
    return sm.fly(sm.load("eros-quick", parse_overrides(CHEAP)))


@pytest.fixture(scope="session")
def designed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("designs") / "quick"
    return sm.design(sm.load("eros-quick", parse_overrides(CHEAP)), out=folder, figures=False, workers=1)
