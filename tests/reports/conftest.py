import pytest

from swarm_mj.api.flight import fly
from swarm_mj.records.run_record import read_run
from swarm_mj.reports.page import write_report
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

#: Text that would run if it were not escaped.
HOSTILE = "</script><script>document.title='hacked'</script><img src=x onerror=alert(1)> & \"quoted\""


@pytest.fixture(scope="session")
def hostile():
    return HOSTILE


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A finished run with its report; its description would do harm if a page took it for HTML."""
    out = tmp_path_factory.mktemp("report") / "quick"
    given = {"observation.criterion": "passage", "spacecraft.sensors": "ideal"}
    scenario = load_scenario("eros-quick", given).model_copy(update={"description": HOSTILE})
    fly(scenario, out=out, figures=False)
    return out


@pytest.fixture(scope="session")
def other_folder(tmp_path_factory):
    """The same flight with another camera and control law."""
    out = tmp_path_factory.mktemp("report") / "other"
    changes = ["camera.half_angle_deg=6", "control.controller=mrp_feedback", "observation.criterion=arrival"]
    fly(load_scenario("eros-quick", parse_overrides(changes)), out=out, figures=False, report=False)
    return out


@pytest.fixture(scope="session")
def comparison(folder, other_folder, tmp_path_factory):
    return write_report([read_run(folder), read_run(other_folder)], tmp_path_factory.mktemp("report") / "two.html")


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    from .browser import start

    window = start(tmp_path_factory.mktemp("profile"))
    yield window
    window.quit()


@pytest.fixture
def report(browser, folder):
    from .browser import load

    load(browser, folder / "report.html")
    return browser
