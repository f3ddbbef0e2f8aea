"""Shared fixtures: the packaged body, a quick plan, and a summary of what was skipped."""

import ctypes
import gc
import os

import pytest


def _egl_loads():
    try:
        ctypes.CDLL("libEGL.so.1")
        ctypes.CDLL("libGL.so.1")
    except OSError:
        return False
    return True


# MuJoCo fails on import when it is told to use a library that is not there.
if _egl_loads():
    os.environ.setdefault("MUJOCO_GL", "egl")


@pytest.fixture(scope="module", autouse=True)
def older_objects_are_left_alone():
    """Take what is there when a module begins out of the search for garbage, which else goes through all of it again and again.

    These are modules, thousands of collected tests and fixtures of the session; a search for them all takes a second and more.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def eros():
    from swarm_mj.smallbody.shape_harmonics import load_eros

    return load_eros()


@pytest.fixture(scope="session")
def quick_plan():
    from swarm_mj.flight.plan import make_plan
    from swarm_mj.scenarios.loading import load_scenario

    return make_plan(load_scenario("eros-quick"))


@pytest.fixture(scope="session")
def config_flights():
    """Both configurations of the paper, flown once: name -> (plan, telemetry)."""
    from swarm_mj.flight.fly import simulate
    from swarm_mj.flight.plan import make_plan
    from swarm_mj.scenarios.loading import load_scenario

    plans = {name: make_plan(load_scenario(name)) for name in ("eros-config1", "eros-config2")}
    return {name: (plan, simulate(plan)) for name, plan in plans.items()}


#: Markers that whole folders of tests carry.
FOLDER_MARKERS = {"envs": "env", "robust": "robust", "faults": "robust", "campaigns": "robust"}


def pytest_collection_modifyitems(items):
    for item in items:
        marker = FOLDER_MARKERS.get(item.path.parent.name)
        if marker:
            item.add_marker(marker)


def pytest_terminal_summary(terminalreporter):
    reports = terminalreporter.stats.get("skipped", [])
    reasons = {}
    for report in reports:
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        reasons[reason] = reasons.get(reason, 0) + 1
    terminalreporter.write_line(f"skipped tests: {len(reports)}")
    for reason, count in sorted(reasons.items()):
        terminalreporter.write_line(f"  {count} x {reason}")
