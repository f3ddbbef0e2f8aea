"""Every file of a result, spoilt in hundreds of ways, is read or refused in one line."""

import json
import os
import shutil
from dataclasses import replace
from importlib import resources
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from swarm_mj.envs.policies.policy_network import load_network

import swarm_mj as sm
from swarm_mj.campaigns.config import Campaign
from swarm_mj.campaigns.manifest import campaign_in
from swarm_mj.cli.main import main
from swarm_mj.errors import OutputError, SwarmError
from swarm_mj.io.atomic import result_in
from swarm_mj.io.records import read_record, reading
from swarm_mj.records import findings
from swarm_mj.records.run_files import read_coverage
from swarm_mj.records.run_record import read_run
from swarm_mj.records.summary_schema import RunSummary, contradiction
from swarm_mj.reports import compare, sections
from swarm_mj.scenarios.loading import design_section
from swarm_mj.simulator.telemetry import read_telemetry

from .limits import bounded
from .spoilt_results import spoilt_json, spoilt_npz, spoilt_telemetry

pytestmark = pytest.mark.robust


@pytest.fixture(scope="module")
def record(run):
    return read_run(run)


def answers(path, variants, read):
    """How many variants of a file are read and how many refused, each in one line that names the file."""
    accepted = refused = 0
    for content in variants:
        path.write_bytes(content)
        with bounded():
            try:
                read(path)
                accepted += 1
            except SwarmError as error:
                refused += 1
                assert "\n" not in str(error) and path.name in str(error), str(error)
                str(error).encode()
    return accepted, refused


def test_summaries_are_refused_in_one_line_or_shown_in_a_report(run, record, tmp_path):
    def read(path):
        summary = read_record(path, RunSummary, "fly it again")
        with reading(path, "fly it again"):
            if why := contradiction(summary, record.names):
                raise ValueError(why)
        changed = replace(record, summary=summary)
        sections.summary_section(changed)
        sections.spacecraft_section([changed], ["A"])
        sections.design_section([changed], ["A"])
        sections.parameters_section([changed, record], ["A", "B"])
        compare.comparison_section([changed, record], ["A", "B"])
        findings.findings(changed)

    accepted, refused = answers(tmp_path / "summary.json", spoilt_json((run / "summary.json").read_bytes()), read)
    assert refused > 300 and accepted > 50


def test_coverage_is_refused_in_one_line_or_has_the_shapes_it_must_have(run, tmp_path):
    def read(path):
        arrays = read_coverage(path)
        assert arrays["faces"].max() < len(arrays["vertices"]) and arrays["faces"].min() >= 0
        assert arrays["seen_by"].shape == arrays["first_seen_by_s"].shape
        assert (arrays["area"] > 0.0).all()

    accepted, refused = answers(tmp_path / "coverage.npz", spoilt_npz((run / "coverage.npz").read_bytes()), read)
    assert refused > 120 and accepted >= 3


def test_telemetry_is_refused_in_one_line_or_has_numbers_only(run, tmp_path):
    def read(path):
        telemetry = read_telemetry(path)
        assert np.isfinite(telemetry["r_BN_N"].values).all()
        assert set(np.unique(telemetry["mode"].values)) <= set(range(5))

    variants = spoilt_telemetry((run / "telemetry.nc").read_bytes(), every=19)
    accepted, refused = answers(tmp_path / "telemetry.nc", variants, read)
    assert refused > 12 and accepted >= 1


def test_designs_are_refused_in_one_line_or_flown(tmp_path):
    packaged = (resources.files("swarm_mj.scenarios") / "designs" / "eros-visit.json").read_bytes()
    accepted, refused = answers(
        tmp_path / "design.json", islice(spoilt_json(packaged), 0, None, 3), lambda path: design_section(str(path))
    )
    assert refused > 40 and accepted > 20


def test_policies_are_refused_in_one_line_or_act(tmp_path):
    packaged = (resources.files("swarm_mj.assets") / "policies" / "swarm-observe.npz").read_bytes()

    def read(path):
        network = load_network(path)
        assert network.logits(np.zeros((1, 5, 24, network.readings))).shape == (1, 5, 24)

    accepted, refused = answers(tmp_path / "policy.npz", islice(spoilt_npz(packaged), 0, None, 3), read)
    assert refused > 40 and accepted >= 1


def test_manifests_of_campaigns_are_refused_in_one_line_or_resumed(tmp_path):
    law = {"distribution": "uniform", "low": 3.0, "high": 6.0}
    campaign = Campaign.model_validate(
        {"name": "c", "runs": 4, "scenarios": ["eros-quick"], "parameters": {"camera.half_angle_deg": law}}
    )
    plain = {
        "fingerprint": "0",
        "campaign": campaign.model_dump(mode="json", by_alias=True),
        "versions": {"python": "3"},
    }
    read = {"campaign": campaign_in, "summary": result_in}
    for name, reader in read.items():
        path = tmp_path / f"{name}.json"
        accepted, refused = answers(path, spoilt_json(json.dumps(plain).encode()), lambda p, r=reader: r(p.parent))
        assert accepted > 10 and (refused > 50 or name == "summary")


SPOILT = {
    "summary.json": b'{"scenario": "eros-quick", "coverage_percent": {}}',
    "coverage.npz": b"PK\3\4",
    "telemetry.nc": b"\x89HDF\r\n",
    "scenario.yaml": b"name: [\xff",
}  # fmt: skip


@pytest.mark.parametrize("name", SPOILT)
def test_every_command_that_reads_a_run_refuses_it_in_one_line(run, tmp_path, capsys, name):
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    (folder / name).write_bytes(SPOILT[name])
    commands = [["report", str(folder)], ["report", str(run), str(folder)]]
    commands += [["video", str(folder), "--quiet"]] if name != "summary.json" else []
    for command in commands:
        assert main(command) == 2
        said = capsys.readouterr().err
        assert said.startswith("swarm-mj: error: ") and said.count("\n") == 1 and name in said
    with pytest.raises(OutputError, match=name.replace(".", r"\.")):
        sm.open(folder)


@pytest.mark.parametrize("name", ["delivery.npz", "design.json"])
@pytest.mark.parametrize("kind", ["folder", "pipe", "device"])
def test_a_file_that_a_run_may_lack_is_refused_where_it_is_none(run, tmp_path, name, kind):
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    (folder / name).unlink(missing_ok=True)
    if kind == "folder":
        (folder / name).mkdir()
    elif kind == "pipe":
        os.mkfifo(folder / name)
    else:
        (folder / name).symlink_to("/dev/zero")
    with bounded(), pytest.raises(OutputError, match=rf"{name}: cannot be read .is a.* {kind}, no regular file"):
        read_run(folder)


@pytest.mark.parametrize("change", [lambda s: s.pop("delivered_percent"), lambda s: s.update(delivered_percent=None)])
def test_a_summary_that_does_not_say_what_arrived_is_refused_where_something_did(run, tmp_path, change):
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    summary = json.loads((folder / "summary.json").read_text())
    change(summary)
    (folder / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(OutputError, match="delivered_percent is missing, but delivery.npz is there"):
        read_run(folder)


def test_a_summary_of_other_spacecraft_is_refused(run, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    summary = json.loads((folder / "summary.json").read_text())
    del summary["deployment_delta_v_m_s"]["sc2"]
    (folder / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(OutputError, match=r"deployment_delta_v_m_s\.sc2 is missing"):
        read_run(folder)


@pytest.mark.parametrize(
    "place", ["/nowhere/\udcff", "\udcff", "/dev/zero", "\0"], ids=["inside", "alone", "endless", "nul"]
)
def test_a_path_that_no_terminal_can_show_is_named_all_the_same(place, capsys):
    assert main(["report", place]) == 2
    assert main(["fly", "eros-quick", "--design", place, "--no-figures", "--quiet"]) == 2
    assert capsys.readouterr().err.count("\n") == 2
    with pytest.raises(SwarmError) as error:
        load_network(Path(place))
    str(error.value).encode()
