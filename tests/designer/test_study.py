"""The command `swarm-mj design`: proof and evolution on flown candidates, files, and bad input."""

import json
import shlex
import shutil

import numpy as np
import pytest

from swarm_mj.cli.main import main
from swarm_mj.cli.tables import design_table
from swarm_mj.designer.candidates.pictures import Judge
from swarm_mj.designer.candidates.visibility import flight_variants
from swarm_mj.designer.exact import solve_exact
from swarm_mj.designer.problem import CoverProblem
from swarm_mj.designer.study import extensions, growth, study_design
from swarm_mj.errors import TooFewObserversError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.observation.capture import lit
from swarm_mj.scenarios.loading import design_section, load_scenario, parse_overrides

FAST = ["observation.criterion=arrival", "observation.observer=raycast", "target.cell_size_m=null", "camera.half_angle_deg=6",
        "designer.max_generations=30"]  # fmt: skip


def arguments(*overrides):
    return [part for override in (*FAST, *overrides) for part in ("--set", override)]


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SWARM_MJ_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("design") / "quick"
    assert main(["design", "eros-quick", "--quiet", "--pareto", "--out", str(out), *arguments()]) == 0
    return out


def test_a_design_writes_its_record_matrix_history_and_pictures(folder):
    names = {p.name for p in folder.iterdir()}
    assert {"design.json", "summary.json", "sightings.npz", "scenario.yaml", "pareto.json", "history.png", "gene_map.png",
            "cover.png", "pareto.png"} <= names  # fmt: skip


def test_the_record_is_consistent_with_its_matrix(folder):
    record = json.loads((folder / "design.json").read_text())
    with np.load(folder / "sightings.npz") as data:
        sees, area = data["sees"], data["area"]
        problem = CoverProblem(sees=sees, area=area)
        assert solve_exact(problem).n_observers == record["proof"]["minimum"]
        chosen = np.array(record["visiting_points"]) - 1
        covered = 100 * area[sees[chosen].any(axis=0)].sum() / area.sum()
        history = data["history_repair"]
    assert covered == pytest.approx(record["covered_percent"], abs=1e-4)
    assert covered >= 99.9
    assert record["n_observers"] == len(chosen) == record["gene_map"][0] == record["proof"]["minimum"]
    assert record["proof"]["status"] == "optimal"
    assert record["gap"] == record["genetic"]["repair"]["n_observers"] - record["proof"]["minimum"] >= 0
    assert (np.diff(history[:, 0]) <= 0).all()
    assert history[-1, 2] == record["genetic"]["repair"]["designs_explored"]


def test_the_command_run_takes_a_design(folder, tmp_path):
    sets = [part for override in FAST for part in ("--set", override)]
    design = str(folder / "design.json")
    flight = ["fly", "eros-quick", "--design", design, "--quiet", "--no-figures", "--out", str(tmp_path / "o")]
    assert main([*flight, *sets[:8]]) == 0
    summary = json.loads((tmp_path / "o" / "summary.json").read_text())
    record = json.loads((folder / "design.json").read_text())
    assert summary["visiting_points"] == record["visiting_points"]
    assert summary["coverage_percent"] >= 99.9
    assert np.shape(record["visiting_points_A_m"]) == (record["n_observers"], 3)
    assert len(record["delta_v_m_s"]) == record["n_observers"]
    assert record["versions"]["pymoo"]
    assert main(["fly", "eros-quick", "--design", str(tmp_path / "none.json"), "--quiet"]) == 2


def test_the_record_tells_what_the_design_was_made_for_and_run_says_where_that_is_another_case(
    folder, tmp_path, capsys
):
    made = json.loads((folder / "design.json").read_text())["made_for"]
    assert made["body.volume_m3"] == pytest.approx(2.518e12, rel=1e-3) and made["target.longitude_deg"] == 90.0
    flight = ["--design", str(folder / "design.json"), "--quiet", "--no-figures", "--no-report", *arguments()]
    assert main(["fly", "eros-quick", "--out", str(tmp_path / "same"), *flight]) == 0
    assert "does not hold" not in capsys.readouterr().out
    other = ["--set", "target.longitude_deg=95", "--set", "body.rotation.w_rate_deg_per_day=1000"]
    assert main(["fly", "eros-quick", "--out", str(tmp_path / "other"), *flight, *other]) == 0
    said = capsys.readouterr().out
    assert "does not hold for this run: body.rotation.w_rate_deg_per_day: 1639.389232 there, 1000.0 here" in said
    assert "target.longitude_deg: 90.0 there, 95.0 here" in said and "its visiting points lie elsewhere" in said


def test_the_hint_at_the_end_repeats_what_was_typed(tmp_path, capsys):
    file, out = tmp_path / "mine too.yaml", tmp_path / "o"
    file.write_text("name: mybody\nphysics: {timestep_s: 0.5}\nbehavior: {name: adaptable_roles}\n")
    typed = ["--quiet", "--no-figures", "--out", str(out), *arguments("camera.half_angle_deg=12")]
    assert main(["design", str(file), *typed]) == 0
    hint = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("To fly it: "))
    words = shlex.split(hint.removeprefix("To fly it: "))
    assert words[:3] == ["swarm-mj", "fly", str(file)] and "camera.half_angle_deg=12" in words
    assert words[-2:] == ["--design", str(out / "design.json")]
    assert main([*words[1:], "--quiet", "--no-figures", "--no-report", "--out", str(tmp_path / "flown")]) == 0
    assert "does not hold" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "freedom",
    [
        "designer.altitudes_m=[18000]",
        "designer.extra_targets=[{latitude_deg: 0, longitude_deg: 60, half_angle_deg: 10}]",
    ],
)
def test_a_design_of_other_altitudes_or_targets_is_flown_by_run(tmp_path, freedom):
    out, flown = tmp_path / "o", tmp_path / "r"
    assert main(["design", "eros-quick", "--quiet", "--no-figures", "--out", str(out), *arguments(freedom)]) == 0
    design = json.loads((out / "design.json").read_text())
    assert design["observers"]
    asked = ["fly", "eros-quick", "--quiet", "--no-figures", "--design", str(out / "design.json"), *arguments(freedom)]
    assert main([*asked, "--out", str(flown)]) == 0
    summary = json.loads((flown / "summary.json").read_text())
    assert summary["coverage_percent"] >= design["covered_percent"] - 1e-6
    assert [stop["altitude_m"] for stop in summary["itinerary"].values()] == [
        entry["imaging_altitude_m"] for entry in design["observers"]
    ]


def test_a_swarm_designed_for_two_fold_coverage_loses_any_one_in_flight_and_still_sees_the_whole_target():
    demands = ["observation.criterion=arrival", "observation.observer=raycast", "target.cell_size_m=null", "designer.fold=2",
               "camera.half_angle_deg=6"]  # fmt: skip
    study = study_design(load_scenario("eros-quick", parse_overrides(demands)))
    assert study.exact.n_observers > study_design(load_scenario("eros-quick", parse_overrides(FAST))).exact.n_observers
    points = [study.visibility.candidates[p - 1].point for p in study.selected]
    plan = make_plan(
        load_scenario("eros-quick", parse_overrides([*demands, f"design.visiting_points={points}", "seed=5"]))
    )
    result = observe_flight(plan, simulate(plan))
    area = plan.region.area
    for lost in range(plan.n):
        rest = np.delete(result.coverage.seen_by, lost, axis=0).any(axis=0)
        assert 100 * area[rest].sum() / area.sum() >= 99.9


def test_self_shadowing_and_the_sun_take_candidates_away():
    # An hour of rotation after the default epoch the Sun still stands over the target's faces, but a lobe over the Sun.
    low_sun = ["epoch=2018-01-01T04:15:00", "observation.max_incidence_deg=89", "designer.tolerance_percent=90"]
    scenario = load_scenario("eros-quick", parse_overrides([*FAST, *low_sun]))
    plan = make_plan(scenario)
    sun_A = plan.environment.C_AN(600.0) @ plan.environment.sun.at(600.0)
    day = plan.region.area[lit(plan.region, sun_A, max_incidence_deg=89.0)].sum() / plan.region.total_area
    for kind in ("raycast", "horizon"):
        dark = study_design(load_scenario(scenario, {"observation.observer": kind})).problem
        assert 60.0 < dark.percent(int(dark.weights[dark.coverable].sum())) < 100.0 * day - 20.0


def test_the_trade_off_holds_the_proven_minimum_and_no_dominated_design(folder):
    record = json.loads((folder / "design.json").read_text())
    front = json.loads((folder / "pareto.json").read_text())
    full = [d["n_observers"] for d in front if d["covered_percent"] >= 99.9]
    assert min(full) == record["proof"]["minimum"]
    values = np.array([[d["n_observers"], d["delta_v_m_s"], -d["covered_percent"]] for d in front])
    for row in values:
        better = (values <= row).all(axis=1) & (values < row).any(axis=1)
        assert not better.any()


def test_the_packaged_design_is_still_a_proven_minimum_of_five():
    # The face-ID observer made it; rays decide alike but for a few faces at the edge, which may not change the number.
    scenario = load_scenario("eros-config1")
    study = study_design(scenario)
    assert study.exact.n_observers == 5
    assert study.exact.status == "optimal"
    assert study.problem.covered_percent(design_section("eros-visit")["visiting_points"]) >= 99.9


def test_what_could_be_seen_at_most_refuses_before_pictures_are_judged(monkeypatch):
    scenario = load_scenario("eros-quick", parse_overrides(FAST))
    fewest = study_design(scenario).exact.n_observers
    assert study_design(scenario, at_most=fewest).exact.n_observers == fewest > 2
    monkeypatch.setattr(Judge, "seen", None)
    with pytest.raises(TooFewObserversError) as refused:
        study_design(scenario, at_most=1)
    assert 1 < refused.value.needed <= fewest


def test_whom_no_design_of_so_few_has_is_not_judged(monkeypatch):
    scenario = load_scenario("eros-quick", parse_overrides([*FAST, "designer.tolerance_percent=30"]))
    whole, few = study_design(scenario), study_design(scenario, at_most=1)
    assert few.exact.n_observers == whole.exact.n_observers == 1
    assert 0 < few.visibility.too_little == 51 - len(few.visibility.candidates)
    enough = {c for c, row in zip(whole.visibility.candidates, whole.problem.sees, strict=True)
              if whole.problem.is_enough(int(row @ whole.problem.weights))}  # fmt: skip
    assert enough <= set(few.visibility.candidates)
    # Pictures that show less than could be seen: none of those that are left is enough, which proves nothing of more than two.
    seen = Judge.seen
    monkeypatch.setattr(Judge, "seen", lambda *given, **also: ((j, row & (np.arange(len(row)) > len(row) // 2))
                                                               for j, row in seen(*given, **also)))  # fmt: skip
    with pytest.raises(TooFewObserversError) as refused:
        study_design(scenario, at_most=1)
    assert refused.value.needed == 2


def test_the_literal_reading_needs_one():
    assert study_design(load_scenario("eros-literal", {"observation.interval_s": 100})).exact.n_observers == 1


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["camera.half_angle_deg=0.5"], ["cover"]),
        (["designer.max_observers=1"], ["max_observers"]),
        (["designer.max_observers=0"], ["designer.max_observers", "0"]),
        (["designer.fold=60"], ["cover"]),
        (["designer.altitudes_m=[-5]"], ["imaging_altitude_m", "-5"]),
        (["designer.times_of_flight_s=[5000]"], ["time_of_flight_s", "5000"]),
        (["designer.extra_targets=[{latitude_deg: 0}]"], ["longitude_deg"]),
    ],
)
def test_a_design_that_cannot_be_is_a_clear_error_and_leaves_nothing(tmp_path, capsys, overrides, words):
    assert main(["design", "eros-quick", "--quiet", "--out", str(tmp_path / "o"), *arguments(*overrides)]) == 2
    message = capsys.readouterr().err
    assert "Traceback" not in message
    for word in words:
        assert word in message
    assert not list(tmp_path.iterdir())


def interrupt(*arguments, **keywords):
    raise KeyboardInterrupt


def test_an_interrupted_design_keeps_the_best_so_far_and_says_that_it_is_not_proven(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("swarm_mj.designer.study.solve_exact", interrupt)
    out = tmp_path / "run"
    assert main(["design", "eros-quick", "--quiet", "--out", str(out), *arguments()]) == 130
    assert "best design so far, not proven" in capsys.readouterr().out.replace("\n", " ")
    record, kept = json.loads((out / "design.json").read_text()), np.load(out / "sightings.npz")
    assert (record["interrupted"], record["proof"]["status"], record["selected_by"]) == (
        "proof", "interrupted", "genetic algorithm",
    )  # fmt: skip
    assert record["gap"] is None
    table = design_table(record)
    assert table.caption.startswith("nothing proven: the design was interrupted (proof); selected")
    assert list(table.columns[0].cells)[0] == "interrupted" and "too little" not in table.caption
    assert (
        kept["area"][kept["sees"][np.array(record["gene_map"][1:]) - 1].any(axis=0)].sum() > 0.999 * kept["area"].sum()
    )


def test_a_proof_whose_time_is_up_leaves_no_gap_to_it(tmp_path, capsys, monkeypatch):
    def one_more_in_time(problem, *limits):
        found = solve_exact(problem)
        spare = np.setdiff1d(np.arange(1, problem.n_points + 1), found.points)[:1]
        points = np.sort(np.append(found.points, spare))
        return found._replace(n_observers=len(points), points=points, status="time limit")

    monkeypatch.setattr("swarm_mj.designer.study.solve_exact", one_more_in_time)
    out = tmp_path / "run"
    assert main(["design", "eros-quick", "--quiet", "--no-figures", "--out", str(out), *arguments()]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "nothing proven: the time was up" in said and "covers too little" not in said
    record = json.loads((out / "design.json").read_text())
    assert record["gap"] is None and record["n_observers"] < record["proof"]["minimum"]


def test_an_interrupted_design_does_not_take_the_place_of_a_finished_one(folder, capsys, monkeypatch):
    before = (folder / "design.json").read_bytes()
    monkeypatch.setattr("swarm_mj.designer.genetic.evolve", interrupt)
    assert main(["design", "eros-quick", "--quiet", "--out", str(folder), *arguments()]) == 130
    assert f"the earlier design in {folder} stays" in capsys.readouterr().out.replace("\n", " ")
    assert (folder / "design.json").read_bytes() == before


@pytest.mark.parametrize(
    ("what", "compare"),
    [("swarm_mj.api.design.growth", ["--compare"]), ("swarm_mj.figures.design_figures.draw_all", [])],
)
def test_an_interruption_after_the_design_is_finished_leaves_it_in_its_place(
    folder, tmp_path, capsys, monkeypatch, what, compare
):
    # An earlier design stands there, with pictures that would not be those of the new one.
    out = shutil.copytree(folder, tmp_path / "run")
    (out / "mine.png").write_bytes(b"")
    monkeypatch.setattr(what, interrupt)
    typed = ["design", "eros-quick", "--quiet", *compare, "--seed", "3", "--out", str(out), *arguments()]
    assert main(typed) == 130
    record = json.loads((out / "design.json").read_text())
    said = " ".join(capsys.readouterr().out.split())
    assert f"interrupted after the design was finished: {record['n_observers']} observers at points" in said
    assert (record["seed"], record["interrupted"], record["proof"]["status"]) == (3, None, "optimal")
    assert {p.name for p in out.iterdir()} == {
        "design.json", "summary.json", "sightings.npz", "scenario.yaml", "mine.png",
    }  # fmt: skip
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_an_interruption_before_there_is_a_design_leaves_none(tmp_path, tmp_path_factory, monkeypatch):
    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path_factory.mktemp("cache")))  # no flights are kept yet
    monkeypatch.setattr("swarm_mj.designer.candidates.visibility.fly", interrupt)
    assert main(["design", "eros-quick", "--quiet", "--out", str(tmp_path / "run"), *arguments()]) == 130
    assert not list(tmp_path.iterdir())


def test_what_is_asked_beyond_the_paper_goes_with_the_scenario():
    """For Eros what the page on the reproduction has; on another body its own altitudes and times."""
    eros, bennu = extensions(load_scenario("eros-config1")), extensions(load_scenario("bennu-slow"))
    assert eros["altitude free among 10, 14 and 18 km"] == {"designer.altitudes_m": [10e3, 14e3, 18e3]}
    assert eros["time of flight free among 480, 600 and 720 s"]["designer.times_of_flight_s"] == [480.0, 600.0, 720.0]
    assert eros["one more target at 0 N, 60 E, 15 deg"]["designer.extra_targets"][0]["longitude_deg"] == 60.0
    altitudes = next(v for k, v in bennu.items() if "altitude" in k)["designer.altitudes_m"]
    assert load_scenario("bennu-slow").design.imaging_altitude_m in altitudes and max(altitudes) < 3e3
    assert "every face seen by 4" in extensions(load_scenario("eros-config1", {"designer.fold": 2}))


def test_what_is_asked_beyond_the_paper_fits_every_scenario_and_is_more_than_it_asks_already():
    """A flight that ends soon after the arrival, a target near the edge of the map, another target, low sun excluded."""
    given = {"latitude_deg": 0.0, "longitude_deg": 60.0, "half_angle_deg": 5.0}
    asked = {"duration_s": 650, "target.longitude_deg": -350, "designer.extra_targets": [given],
             "designer.releases_s": [0, 50], "observation.max_incidence_deg": 60}  # fmt: skip
    scenario = load_scenario("eros-quick", asked)
    grown = {change: load_scenario(scenario, overrides) for change, overrides in extensions(scenario).items()}
    assert all(flight_variants(chosen) for chosen in grown.values())
    assert grown["time of flight free among 480, 600 and 720 s"].duration_s == 770.0
    first, second = grown["one more target at 0 N, -20 E, 15 deg"].designer.extra_targets
    assert (first.longitude_deg, second.longitude_deg) == (60.0, -20.0)
    assert grown["incidence of sunlight at most 60 deg"].observation.max_incidence_deg == 60.0


def test_a_demand_that_no_scenario_can_have_is_a_row_that_says_why(monkeypatch):
    impossible = {"too short": {"duration_s": 1.0}, "too low": {"designer.altitudes_m": [-5.0]}}
    monkeypatch.setattr("swarm_mj.designer.study.extensions", lambda scenario: impossible)
    rows = growth(load_scenario("eros-quick"))
    assert [row.n_observers for row in rows] == [None, None]
    assert "duration_s" in rows[0].note and "imaging_altitude_m" in rows[1].note
