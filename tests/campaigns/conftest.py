"""Small campaigns of quick flights, and how to run one as a user does."""

import os
import signal
import subprocess
import sys
import textwrap

import pytest

pytest.importorskip("pyarrow")

#: A quarter of a second a flight: two spacecraft, coarse steps, an observer without OpenGL.
QUICK = """\
name: small
seed: 5
runs: {runs}
method: {method}
scenarios:
  - {{scenario: eros-quick, name: one}}
  - {{scenario: eros-quick, name: two, set: {{design.visiting_points: [9, 30]}}}}
set: {{observation.observer: raycast, telemetry.interval_s: 10}}
parameters:
  camera.half_angle_deg: {{distribution: truncated_normal, mean: 16, std: 0.5, low: 15, high: 17}}
  behavior.imaging_radius_m: {{distribution: choice, values: [33000.0, 34000.0, 35000.0]}}
{more}
"""
#: The camera's angle decides how finely the target is cut, which takes a while; these runs change nothing in the plan.
PLAIN = """\
name: plain
seed: 5
runs: {runs}
scenarios: [eros-quick]
set: {{observation.observer: raycast, telemetry.interval_s: 10}}
{more}
"""
#: One scenario, called one; what is added comes last.
ONE = """\
name: alone
seed: 5
runs: {runs}
method: {method}
scenarios: [{{scenario: eros-quick, name: one}}]
{more}
"""


def rows(folder):
    """Results of a campaign but for how long they took."""
    from swarm_mj.campaigns.store import read_results

    return read_results(folder).drop(["wall_s"])


@pytest.fixture(scope="session")
def reference(tmp_path_factory):
    """A campaign of ten plain runs that nothing disturbed, and its rows."""
    from swarm_mj.campaigns.loading import load_campaign
    from swarm_mj.campaigns.runner import run_campaign

    folder = tmp_path_factory.mktemp("reference")
    path = folder / "campaign.yaml"
    path.write_text(PLAIN.format(runs=10, more=""))
    run_campaign(load_campaign(path), folder / "out", workers=2, figures=False)
    return path, rows(folder / "out")


@pytest.fixture
def write(tmp_path):
    """Write a campaign file; returns its path."""

    def write(text=PLAIN, *, runs=4, method="monte_carlo", more="", name="campaign.yaml"):
        path = tmp_path / name
        path.write_text(text.format(runs=runs, method=method, more=textwrap.dedent(more)))
        return path

    return write


@pytest.fixture
def start():
    """Start `swarm-mj campaign` in a process of its own; what is still running at the end is killed."""
    started = []

    def start(*arguments, **options):
        code = "import sys; from swarm_mj.cli.main import main; sys.exit(main(['campaign', *sys.argv[1:]]))"
        process = subprocess.Popen(
            [sys.executable, "-c", code, *map(str, arguments), "--quiet"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # A shell starts what it puts in the background deaf to Ctrl-C, and the tests with it.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            env={**os.environ, "COLUMNS": "200"},
            **options,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()
