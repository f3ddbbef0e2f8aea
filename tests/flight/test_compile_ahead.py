"""What is compiled ahead is what a flight calls."""

import subprocess
import sys

import pytest

from swarm_mj.api import flight
from swarm_mj.scenarios.loading import load_scenario

#: Tells which functions of a flight were compiled ahead, and which were not, or for other types.
FLY = """
import sys
from numba.core.dispatcher import Dispatcher
from swarm_mj.flight.compile_ahead import compile_ahead
from swarm_mj.flight.downlink import deliver
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario

def signatures():
    modules = [module for name, module in sys.modules.items() if name.startswith("swarm_mj")]
    kernels = {kernel for module in modules for kernel in vars(module).values() if isinstance(kernel, Dispatcher)}
    return {f"{kernel.__module__}.{kernel.__name__}": set(kernel.signatures) for kernel in kernels}

plan = make_plan(load_scenario("eros-quick"))
planned = signatures()
compile_ahead(plan)
ahead = signatures()
telemetry = simulate(plan)
deliver(plan, telemetry, observe_flight(plan, telemetry).kept)
flown = signatures()
print(*(name for name in ahead if ahead[name] > planned.get(name, set()) and ahead[name] == flown[name]))
print(*(name for name in flown if flown[name] > ahead.get(name, set())))
"""


def test_links_deliveries_and_pictures_need_nothing_more_than_was_compiled_ahead():
    done = subprocess.run([sys.executable, "-c", FLY], capture_output=True, text=True, check=True)
    ahead, late = (line.split() for line in done.stdout.splitlines())
    assert "swarm_mj.mission.links.closed_links" in ahead
    assert any(name.startswith("swarm_mj.observation.") for name in ahead)
    rooms = ("swarm_mj.observation.", "swarm_mj.mission.links.", "swarm_mj.dataflow.")
    assert not [name for name in late if name.startswith(rooms)]


@pytest.mark.parametrize("cold", [True, False])
def test_only_a_first_flight_has_anything_compiled_ahead(cold, monkeypatch):
    asked, found = [], iter((3, 4 if cold else 3))
    monkeypatch.setattr(flight, "kernels_compiled", lambda: next(found))
    monkeypatch.setattr(flight, "compile_in_background", lambda plan: asked.append(plan.scenario.name))
    flight.fly(load_scenario("eros-quick"))
    assert asked == ["eros-quick"] * cold
