"""Shared fixtures: the packaged body, a quick plan, and a summary of what was skipped."""

import ctypes
import gc
import os
from pathlib import Path

import pytest

from swarm_mj.io.machine import keep_algebra_on_one_thread

# As the command line does: cores are shared with other workers here.
keep_algebra_on_one_thread()


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
FOLDER_MARKERS = {"envs": "env", "robustness": "robust", "faults": "robust", "campaigns": "robust"}

#: Files whose tests have nearly all kernels compiled; one worker runs them, lest two compile the same kernels at once.
COMPILE = (
    "api/test_flight.py",
    "envs/test_actions.py",
    "api/test_design.py",
    "campaigns/test_classes.py",
    "smallbody/gravity/test_polyhedron.py",
    "simulator/faults/test_attitude_filter.py",
    "envs/test_candidates.py",
)
#: What other workers do meanwhile, which needs no kernels or has its own, and then files that take long: the last ones to
#: run should be short, so that no worker waits for another in the end.
EARLY = (
    "docs/test_site.py",
    "designer/test_genetic.py",
    "designer/test_pareto.py",
    "designer/test_exact.py",
    "test_layers.py",
    "docs/test_scenario_keys.py",
    "campaigns/test_campaign.py",
    "campaigns/test_dask.py",
    "verification/test_validation.py",
    "figures/test_missions.py",
    "figures/test_every_figure.py",
    "designer/test_designs_fly.py",
    "robustness/test_long.py",
    "benchmarks/test_performance.py",
    "test_extending.py",
    "test_spacecraft_page.py",
    "test_distribution.py",  # takes what is compiled by then
)
#: Files that share figures which are drawn once for all of them; one worker runs them.
FIGURES = ("figures/test_missions.py", "figures/test_every_figure.py")
ORDER = {name: k for k, name in enumerate((*COMPILE, *EARLY))}


def _place(item):
    return ORDER.get(item.path.relative_to(Path(__file__).parent).as_posix(), len(ORDER))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Hand out whole files, and those that compile, or share figures, as if they were one."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            together = {"compile": COMPILE, "figures": FIGURES}
            return next((name for name, files in together.items() if file.removeprefix("tests/") in files), file)

    return Scheduling(config, log)


def pytest_collection_modifyitems(items):
    items.sort(key=_place)
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
