"""The packaged scenarios flown once each, with a sample at every decision, whatever is observed in them."""

from dataclasses import replace
from functools import cache

import pytest

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario, parse_overrides


@cache
def _flown(name):
    period = load_scenario(name).control.period_s
    # Cells that are not clipped further, where there would be many: how they are judged does not depend on their number.
    few = ["target.cell_size_m=null"] if name == "eros-faults" else []
    plan = make_plan(load_scenario(name, parse_overrides([f"telemetry.interval_s={period}", *few])))
    return plan, simulate(plan)


@pytest.fixture(scope="session")
def flight():
    """Plan and telemetry of a packaged scenario, observed as told: the flight itself does not depend on that."""

    def observed(name, **observation):
        plan, telemetry = _flown(name)
        told = plan.scenario.observation.model_copy(update=observation)
        return replace(plan, scenario=plan.scenario.model_copy(update={"observation": told})), telemetry

    return observed
