"""A small real result, flown once for all tests that spoil its files."""

import pytest


@pytest.fixture(scope="session")
def run(tmp_path_factory):
    from swarm_mj.cli.main import main

    folder = tmp_path_factory.mktemp("runs") / "run"
    # One sample in ten seconds keeps the files small.
    short = ["--set", "telemetry.interval_s=10", "--quiet", "--no-figures"]
    assert main(["fly", "eros-quick", *short, "--out", str(folder)]) == 0
    return folder
