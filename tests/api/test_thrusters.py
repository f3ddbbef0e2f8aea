"""A run with thrusters from end to end: written, read back, exported, reported; and nozzles of a file of one's own."""

import json
from dataclasses import replace

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.campaigns.flying import outcome, pick
from swarm_mj.records.propulsion import KEYS, propulsion_findings
from swarm_mj.records.run_record import read_run
from swarm_mj.reports.page import report_html
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from tests.spacecraft.own.files import mjcf

KEPT = (
    "duration_s=620",
    "telemetry.interval_s=5",
    "observation.interval_s=60",
    "camera.resolution_px=128",
    "mothership.deployer={max_speed_m_s: 0.5, insertion_after_s: 40}",
)
#: Six nozzles of a file, in the middle of the faces of a box of 10 x 10 x 34 cm; gas leaves along the sites' +z.
SITES = "".join(
    f'<site name="thruster_{k}" pos="{" ".join(str(half * c) for c in axis)}" zaxis="{" ".join(map(str, axis))}"/>'
    for k, (axis, half) in enumerate(
        (((s * (i == 0), s * (i == 1), s * (i == 2)), 0.17 if i == 2 else 0.05) for i in range(3) for s in (1, -1)), 1
    )
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The flight and its folder."""
    out = tmp_path_factory.mktemp("thrust") / "quick"
    thrusters = "spacecraft.thrusters={thrust_n: 0.5, propellant_kg: 0.3}"
    return sm.fly(sm.load("eros-quick", parse_overrides([*KEPT, thrusters])), out=out, figures=False, report=False), out


def test_a_run_is_read_back_as_it_was_flown(run):
    flight, out = run
    again = sm.open(out)
    for name in ("thrust_N", "propellant_kg", "mass_kg", "delta_v_m_s"):
        assert np.array_equal(again.telemetry[name].values, flight.telemetry[name].values)
    assert [again.summary[key] for key in KEYS] == [flight.summary[key] for key in KEYS]
    for ours, theirs in zip(again.plan.deployment.burns, flight.plan.deployment.burns, strict=True):
        assert ours.t == theirs.t and np.array_equal(ours.delta_v_N, theirs.delta_v_N)
    assert "propulsion" in dir(again.plot) and again.findings == flight.findings
    written = json.loads((out / "summary.json").read_text())
    assert pick(written, "propellant_used_kg.sum", again.plan.names) == pytest.approx(
        sum(written["propellant_used_kg"].values())
    )


def test_the_report_tells_of_burns_and_tanks_and_the_findings_of_oblique_nozzles(run):
    _, out = run
    record = read_run(out)
    page = report_html([record])
    assert '<section id="propulsion"' in page and 'href="#propulsion"' in page
    table = page.split('<section id="propulsion"')[1].split("</section>")[0]
    for name in record.names:
        assert name in table and f"{1e3 * record.summary['propellant_left_kg'][name]:.3g}" in table
    said = [words for words in sm.open(out).findings if "do not point along the force" in words]
    gained = np.array(list(record.summary["thrust_delta_v_m_s"].values()))
    least = 8.0 * (1.0 - np.exp(-gained / (65.0 * 9.80665)))
    used = np.array(list(record.summary["propellant_used_kg"].values()))
    assert (used < np.sqrt(3.0) * least * 1.001).all() and (used > least * 0.999).all()
    assert bool(said) == bool((used > 1.05 * least).any())


def test_campaigns_have_columns_of_it_which_are_empty_for_flights_without_thrusters(run):
    flight, _ = run
    record = {"gas": "propellant_used_kg.max", "speed": "thrust_delta_v_m_s.sum"}
    row = outcome(flight.plan, flight.telemetry, flight.result, record)
    assert row["gas"] == max(flight.summary["propellant_used_kg"].values()) > 0.0
    assert row["speed"] == pytest.approx(sum(flight.summary["thrust_delta_v_m_s"].values()))
    without = flight.telemetry.drop_vars(["thrust_N", "propellant_kg", "mass_kg", "delta_v_m_s"])
    row = outcome(flight.plan, without, flight.result, record)
    assert row["gas"] is None and row["speed"] is None


def test_exports_hold_the_path_with_burns(run, tmp_path):
    flight, _ = run
    files = flight.export(tmp_path / "out", ["oem", "csv"])
    oem = next(path for path in files if path.name == "sc1.oem").read_text().splitlines()
    rows = [line.split() for line in oem if line[:2] == "20" and len(line.split()) >= 7]
    speed = [np.linalg.norm(np.array(row[4:7], float)) for row in rows]
    v = np.linalg.norm(flight.telemetry["v_BN_N"].values[:, 0], axis=1) / 1e3
    # The axes are others, the speed is the same; the burn changes it by metres a second.
    assert speed == pytest.approx(v, abs=1e-8) and np.ptp(v) > 1e-3


def test_a_tank_that_runs_empty_is_told(run):
    flight, out = run
    record = read_run(out)
    empty = record.telemetry.copy(deep=True)
    empty["propellant_kg"].values[40:, 1] = 0.0
    found = propulsion_findings(replace(record, telemetry=empty))
    assert found[0].startswith("tanks ran empty: sc2 at t = 200 s")


def test_nozzles_of_a_file_of_ones_own_reach_the_point(tmp_path):
    path = tmp_path / "own.xml"
    path.write_text(mjcf(SITES))
    thrusters = "spacecraft.thrusters={layout: sites, thrust_n: 0.5, propellant_kg: 0.3, min_impulse_bit_n_s: 0}"
    flight = sm.fly(load_scenario("eros-quick", parse_overrides([*KEPT, f"spacecraft.mjcf={path}", thrusters])))
    assert len(flight.plan.deployment.burns) == 2
    assert max(flight.summary["arrival_miss_mm"].values()) < 5e3
    for name, planned in flight.summary["planned_burns_m_s"].items():
        assert flight.summary["thrust_delta_v_m_s"][name] == pytest.approx(planned, rel=1e-3)
