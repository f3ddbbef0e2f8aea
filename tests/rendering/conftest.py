import numpy as np
import pytest

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.observation.gl_context import gl_available
from swarm_mj.rendering.replay import Replay
from swarm_mj.scenarios.loading import load_scenario


@pytest.fixture(scope="session")
def gl():
    available, reason = gl_available()
    if not available:
        pytest.skip(reason)


@pytest.fixture(scope="session")
def flown():
    """A quick flight: plan, telemetry, result, by ray casting."""
    plan = make_plan(load_scenario("eros-quick", {"observation.observer": "raycast"}))
    telemetry = simulate(plan)
    return plan, telemetry, observe_flight(plan, telemetry)


@pytest.fixture(scope="session")
def replay(flown):
    plan, telemetry, result = flown
    return Replay(plan, telemetry, result.coverage.first_seen_s)


@pytest.fixture
def rng():
    return np.random.default_rng(5)
