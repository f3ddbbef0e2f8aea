"""The packaged scenario with faults, from the command line to the files."""

import json

import numpy as np
import xarray as xr

from swarm_mj.cli.main import main
from swarm_mj.scenarios.loading import load_scenario

RUN = ["fly", "eros-faults", "--quiet", "--no-figures", "--set", "observation.observer=raycast"]


def test_a_run_with_faults_ends_with_its_result_and_the_list_of_events(tmp_path, capsys):
    assert main([*RUN, "--out", str(tmp_path / "run")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    kinds = [event["kind"] for event in summary["events"]]
    for fault in load_scenario("eros-faults").faults:
        assert fault.kind in kinds
        assert fault.kind.replace("_", " ") in printed
    assert {"detected", "elected", "over"} <= set(kinds)
    assert [event["time_s"] for event in summary["events"]] == sorted(event["time_s"] for event in summary["events"])
    assert summary["coverage_percent"] > 50
    telemetry = xr.load_dataset(tmp_path / "run" / "telemetry.nc")
    assert json.loads(telemetry.attrs["events"]) == summary["events"]
    assert summary["lost"] == [
        n for n, on in zip(telemetry.spacecraft.values, telemetry.operational[-1], strict=True) if not on
    ]
    assert telemetry["wheel_speed"].sizes["wheel"] == 4
    assert all({"units", "frame", "long_name"} <= set(telemetry[name].attrs) for name in telemetry.data_vars)
    assert np.isfinite(telemetry["attitude_knowledge_error"].values).all()
