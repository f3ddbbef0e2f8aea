"""`sm.navigate`: numbers, findings, errors, the same by the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.stats import maxwell, norm

import swarm_mj as sm
from swarm_mj.cli.main import main
from swarm_mj.errors import SwarmError
from swarm_mj.flight.plan import as_planned, make_plan
from swarm_mj.flight.trajectory_corrections import analyse_corrections
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

ERRORS = (
    "dispersions.deployment_velocity_m_s=0.1",
    "navigation.position_m=5",
    "navigation.velocity_m_s=0.01",
    "dispersions.burn_magnitude_percent=2",
    "dispersions.burn_pointing_deg=1",
)
THRUSTERS = "spacecraft.thrusters={}"
TWO = "trajectory.corrections=[{after_release_s: 60}, {before_arrival_s: 120}]"


@pytest.fixture(scope="module")
def eros():
    return sm.navigate("eros-config1", parse_overrides([*ERRORS, THRUSTERS, TWO]), runs=300)


def test_corrections_narrow_the_spread_to_what_navigation_leaves(eros):
    widest = eros.table["position_3_sigma_m"].loc["sc1"]
    assert widest[0] == pytest.approx(3 * 0.1 * 600, rel=0.02)  # 1 % is gravity's
    # Known to 5 m and 0.01 m/s, burnt with an error of 2 % and 1 deg of some 0.1 m/s, 120 s before the arrival.
    assert widest[2] == pytest.approx(3 * np.hypot(5.0, 120 * 0.01), rel=0.02)
    assert list(eros.table.loc["sc1"]["time_s"])[1:] == [60.0, 480.0]
    assert eros.table.loc[("sc1", 2), "in_camera_percent"] > 99.9
    assert np.isnan(eros.table.loc[("sc6", 2), "in_camera_percent"])  # it only relays


def test_axes_and_lengths_of_the_table_belong_to_the_covariance(eros):
    row, covariance = eros.table.loc[("sc2", 2)], eros.covariance_RTS[2, 1]
    assert np.sqrt(np.diag(covariance)) == pytest.approx([row[f"sigma_{axis}_m"] for axis in "RTS"])
    assert np.linalg.eigvalsh(covariance) == pytest.approx(np.linalg.eigvalsh(eros.covariance_N[2, 1]))
    assert row["position_3_sigma_m"] / 3 == pytest.approx(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))


def test_burns_together_are_less_than_the_sum_of_their_percentiles(eros):
    both = eros.table.loc["sc1"]["delta_v_99_m_s"]
    assert max(both) < eros.delta_v.loc["sc1", "percentile_99_m_s"] < sum(both)
    assert eros.delta_v.loc["sc1", "mean_m_s"] == pytest.approx(
        sum(eros.table.loc["sc1"]["delta_v_mean_m_s"]), rel=0.02
    )


def test_findings_tell_each_stage_and_that_flights_agree(eros):
    assert eros.findings[0].startswith("without corrections: 3 sigma 181 m at the arrival")
    assert eros.findings[2].startswith("after correction 2: 3 sigma 15.5 m at the arrival")
    assert eros.findings[2].endswith("0.259 m/s (99 %)")
    assert eros.findings[-1] == "300 flights under all forces agree with linear covariance within sampling error"
    assert (eros.agreement["chance"] > 0.001 / 6).all()
    # Along an axis that is chosen before the flights, spreads differ by sampling alone, by 1 / sqrt(2 N) each.
    ratio = eros.agreement["flown_3_sigma_m"] / eros.agreement["linear_3_sigma_m"]
    assert ratio.mean() == pytest.approx(1.0, abs=3.0 / np.sqrt(2 * 300 * 6))


def test_the_command_prints_and_writes_the_same(eros, tmp_path, capsys):
    changes = [word for change in (*ERRORS, THRUSTERS, TWO) for word in ("--set", change)]
    file = tmp_path / "navigation.json"
    assert main(["navigate", "eros-config1", *changes, "--runs", "300", "--out", str(file), "--quiet"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert all(f"eros-config1: {words}" in printed for words in eros.findings)
    assert all(unit in printed for unit in ("[s]", "[m]", "[m/s]", "[deg]", "[%]"))
    assert "\N{HORIZONTAL ELLIPSIS}" not in printed
    assert json.loads(file.read_text()) == json.loads(json.dumps(eros.summary))


def test_a_late_correction_of_a_fast_flyby_takes_away_what_two_days_have_made():
    errors = ("dispersions.deployment_velocity_m_s=0.1", "navigation.position_m=50", "navigation.velocity_m_s=0.01")
    found = sm.navigate(
        "fast-flyby",
        parse_overrides(
            [*errors, THRUSTERS, "trajectory.corrections=[{after_release_s: 3600}, {before_arrival_s: 7200}]"]
        ),
    )
    left = found.table["position_3_sigma_m"].loc["sc1"]
    assert left[0] == pytest.approx(3 * 0.1 * 172_800, rel=1e-3)
    assert left[1] == pytest.approx(3 * np.hypot(50, 0.01 * 169_200), rel=1e-2)
    assert left[2] == pytest.approx(3 * np.hypot(50, 0.01 * 7200), rel=1e-2)
    assert found.table.loc[("sc1", 0), "in_camera_percent"] < 90 < found.table.loc[("sc1", 1), "in_camera_percent"]


def test_what_follows_a_burn_that_errs_has_the_tail_of_a_product():
    """With exact navigation a burn leaves its relative error g, normal, times its own size, Maxwell: s |g| chi_3 in all.

    Without forces the second burn is that times (T - t1) / (T - t2), and the position before it that times T - t1.
    """
    s, late, time = 0.05, 120.0, 600.0
    errors = {
        "spacecraft.thrusters": {},
        "dispersions.deployment_velocity_m_s": 0.1,
        "dispersions.burn_magnitude_percent": 100 * s,
    }
    two = "trajectory.corrections=[{after_release_s: 60}, {before_arrival_s: 120}]"
    rows = sm.navigate("eros-config1", {**errors, **parse_overrides([two])}).table.loc["sc1"]
    product = brentq(lambda q: 2.0 * quad(lambda g: norm.pdf(g) * maxwell.cdf(q / g), 0.0, 8.0)[0] - 0.99, 1.0, 20.0)
    first = 0.1 * time / (time - 60.0)
    assert rows["delta_v_99_m_s"][1] == pytest.approx(first * maxwell.ppf(0.99), rel=0.02)
    assert rows["position_99_m"][1] == pytest.approx(product * s * first * (time - 60.0), rel=0.03)
    assert rows["delta_v_99_m_s"][2] == pytest.approx(product * s * first * (time - 60.0) / late, rel=0.03)
    assert rows["delta_v_mean_m_s"][2] == pytest.approx(
        (2 / np.pi) ** 0.5 * maxwell.mean() * s * first * (time - 60.0) / late, rel=0.03
    )
    # A normal vector of the same covariance would say less.
    assert product > 1.15 * maxwell.ppf(0.99)


def test_exact_knowledge_leaves_numbers():
    """A burn without errors takes away all but rounding, whose variance may be below zero."""
    changes = (
        "dispersions.deployment_velocity_m_s=0.1",
        THRUSTERS,
        "trajectory.corrections=[{before_arrival_s: 7200}]",
    )
    after = sm.navigate("fast-flyby", parse_overrides(changes)).table.xs(1, level="corrections")
    assert (after[["sigma_R_m", "sigma_T_m", "sigma_S_m"]] >= 0.0).all(axis=None)
    assert (after["position_3_sigma_m"] < 0.01).all()


def test_the_mothership_errs_for_all_that_it_lets_go():
    found = sm.navigate(
        "bennu-slow", {"dispersions.mothership_position_m": 30, "dispersions.mothership_velocity_m_s": 0.02}
    )
    assert found.table["position_3_sigma_m"].loc["sc1"][0] == pytest.approx(3 * np.hypot(30, 12), rel=1e-3)


def test_a_release_that_comes_later_carries_the_mothership_there():
    plan = make_plan(load_scenario("bennu-slow", {"dispersions.mothership_velocity_m_s": 0.02}), check_separation=False)
    late = replace(plan, deployment=replace(plan.deployment, release_s=np.full(plan.n, 100.0)))
    deviation = np.sqrt(np.diagonal(analyse_corrections(late).spread.at_arrival[0, 0])[:3])
    assert deviation == pytest.approx(np.full(3, 0.02 * 600), rel=1e-3)


def test_what_is_not_worth_it_or_too_much_is_said():
    poor = [*ERRORS, THRUSTERS, TWO, "navigation.velocity_m_s=0.5"]
    assert any(
        "correction 1 does not pay" in words for words in sm.navigate("eros-config1", parse_overrides(poor)).findings
    )
    dear = [*ERRORS, TWO, "spacecraft.thrusters={propellant_kg: 0.001, thrust_n: 0.001, min_impulse_bit_n_s: 0}"]
    said = sm.navigate("eros-config1", parse_overrides(dear)).findings
    tank = next(words for words in said if "the tank may not do" in words)
    # 99 % of both burns of 8 kg at 65 s by the rocket equation; three nozzles that share an oblique force take sqrt(3) as much.
    burnt = sm.navigate("eros-config1", parse_overrides(dear)).delta_v["percentile_99_m_s"].max()
    needed = 8.0 * (1 - np.exp(-np.sqrt(3) * burnt / (65 * 9.80665)))
    assert f"burn up to {needed:.3g} kg" in tank and "propellant_kg = 0.001" in tank
    assert any("correction 2 of sc" in words and "longer than the 120 s" in words for words in said)
    assert sm.navigate("eros-config1").findings[0].startswith("nothing is said to err")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["trajectory.corrections=[{after_release_s: 60}]"], "give spacecraft.thrusters"),
        ([THRUSTERS, "trajectory.corrections=[{after_release_s: 600}]"], "corrections.0.after_release_s = 600.*600 s"),
        ([THRUSTERS, "trajectory.corrections=[{before_arrival_s: 700}]"], "corrections.0.before_arrival_s = 700.*less"),
        ([THRUSTERS, "trajectory.corrections=[{after_release_s: -5}]"], "after_release_s"),
        ([THRUSTERS, "trajectory.corrections=[{}]"], "none is given; must be one of both"),
        ([THRUSTERS, "trajectory.corrections=[{after_release_s: 1, before_arrival_s: 2}]"], "both are given"),
        ([THRUSTERS, "trajectory.corrections=[{after_release_s: 60.3}]"], "whole multiple of control.period_s = 0.5"),
        ([THRUSTERS, "trajectory.corrections=[{after_release_s: 60}, {before_arrival_s: 540}]"], "at the same time"),
        (["spacecraft.thrusters={layout: four_z}", TWO], "layout = four_z.*must be six"),
        (["spacecraft.thrusters={thrust_n: 0.5}"], "plan has insertion burns.*max_speed_m_s: null"),
    ],
)
def test_corrections_that_cannot_be_flown_are_refused(changes, words):
    with pytest.raises(SwarmError, match=words):
        sm.navigate("eros-config1", parse_overrides(changes))


def test_too_few_flights_judge_nothing():
    with pytest.raises(SwarmError, match="runs = 3: must be 0 or 30 to 100000"):
        sm.navigate("eros-config1", runs=3)


def test_a_design_counts_on_neither_errors_nor_their_corrections():
    planned = as_planned(load_scenario("eros-config1", parse_overrides([*ERRORS, THRUSTERS, TWO])))
    assert not planned.trajectory.corrections and planned.navigation.position_m == 0.0
