"""The chain and the knowledge base: swarms that fly what was asked, proofs that none can, and what is kept of both."""

import json
import multiprocessing
import resource
import signal
import sqlite3
import sys

import numpy as np
import pytest
import yaml

import swarm_mj as sm
from swarm_mj.cli.main import main
from swarm_mj.designer.study import Verified
from swarm_mj.errors import OutputError, ScenarioError
from swarm_mj.ideas import chain
from swarm_mj.ideas.chain import run_study
from swarm_mj.ideas.components import DETECTORS
from swarm_mj.ideas.knowledge import KnowledgeBase, differences, identity
from swarm_mj.ideas.requirement import load_requirement
from swarm_mj.ideas.sensitivity import sobol_indices
from swarm_mj.scenarios.loading import packaged

#: A map of Bennu's target that a few spacecraft make.
CASE = {
    "name": "map",
    "scenario": "bennu-slow",
    "changes": {
        "duration_s": 700,
        "observation.interval_s": 60,
        "designer.max_points": 8,
        "observation.min_pixels": 0,
        "physics.stepper": "kernel",
        "physics.timestep_s": 0.5,
    },
    "resolution_m": 1.0,
    "share_percent": 90,
    "limits": {"units": [3, 6], "altitudes_m": [1000]},
}
PAPER = {"name": "paper", "scenario": "eros-config1", "resolution_m": 0.1, "limits": {"units": [3]}}


@pytest.fixture
def bare(monkeypatch):
    """Without what else could be chosen and what drives, which take longer than a small study."""
    monkeypatch.setattr(chain, "drivers", lambda *_: [])
    monkeypatch.setattr(chain, "alternatives", lambda *_: [])


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    return tmp_path_factory.mktemp("ideas") / "base.sqlite"


@pytest.fixture(scope="module")
def study(base):
    return sm.study(CASE, base=base)


def test_the_swarm_flies_what_was_asked(study, tmp_path):
    assert study.closed and set(study.checks["met"]) == {True}
    record, kinds = study.record, study.tried
    # One more only communicates.
    assert record["spacecraft_count"] == record["observers"] + 1
    assert record["swarm_kg"] == pytest.approx(record["spacecraft_count"] * record["spacecraft"]["mass_kg"])
    # Lighter ones are not among those that can be built, and all others would weigh as much or more.
    assert kinds["least_kg"].dropna().min() >= record["swarm_kg"] - 1e-9 or record["observers"] > 1
    assert len(kinds) == 6 and kinds["observers"].count() >= 1
    folder = study.save(tmp_path / "out")
    written = json.loads((folder / "study.json").read_text())
    assert written["id"] == study.kept.id and written["checks"] == record["checks"]
    # The file flies the swarm, with the masses and the camera that were sized.
    flight = sm.fly(folder / "scenario.yaml")
    assert flight.plan.n_observers == record["observers"]
    assert flight.plan.properties.mass == pytest.approx(record["spacecraft"]["mass_kg"], abs=1e-3)
    assert flight.coverage.percent >= 90.0
    shown = record["spacecraft"]["camera"]
    assert flight.scenario.camera.half_angle_deg == shown["half_angle_deg"]


def test_the_study_tells_what_drives_it_and_what_else_could_be_chosen(study, tmp_path):
    drivers, now = study.drivers.set_index("key"), study.record["least_kg"]
    # The margin of mass multiplies all masses, where nothing else gives way.
    row = drivers.loc["margins.mass"]
    assert row["higher"] == pytest.approx(0.24) and row["lower"] == pytest.approx(0.2 / 1.2)
    assert row["higher_kg"] == pytest.approx(now * 1.24 / 1.2)
    assert row["lower_kg"] <= now * (1.0 + row["lower"]) / 1.2 + 1e-9  # or of a smaller one that fits then
    known = drivers.dropna()
    swings = known[["lower_kg", "higher_kg"]].max(axis=1).clip(now) - known[["lower_kg", "higher_kg"]].min(axis=1).clip(
        None, now
    )
    assert (swings.diff().dropna() <= 1e-9).all()
    values = study.alternatives[["resolution_m", "mass_kg", "power_w", "send_h", "least_kg"]].to_numpy()
    assert len(values) >= 2
    for one in values:
        better = (values <= one + 1e-12).all(axis=1) & (values < one - 1e-9).any(axis=1)
        assert not better.any()
    page = study.report(tmp_path / "report.html").read_text()
    assert "meet it, as flown" in page and "Content-Security-Policy" in page and "<svg" in page
    assert "http" not in page.replace("http-equiv", "") and "NOT MET" not in page


def test_where_none_can_the_nearest_is_found_and_kept(bare, tmp_path):
    asked = {
        **CASE,
        "name": "bright",
        "min_snr": 5000,
        "nearest": True,
        "limits": {"units": [6], "altitudes_m": [1000]},
    }
    found = sm.study(asked, base=tmp_path / "base.sqlite", out=tmp_path / "out")
    assert not found.closed and "signal" in found.record["forbids"] and found.nearest.closed
    way = next((way for way in found.record["relaxed"] if "resolution_m" in way), found.record["relaxed"][0])
    eased = found.nearest.kept.requirement
    assert all(eased.value(key) == value for key, value in way.items()) and not eased.nearest
    assert any("the nearest that can: bright, " in words for words in found.sentences)
    assert len(sm.studies(tmp_path / "base.sqlite")) == 2 and (tmp_path / "out" / "nearest" / "scenario.yaml").is_file()
    assert sm.open_study("bright", tmp_path / "base.sqlite").sentences == found.sentences
    assert load_requirement(CASE).eased({"limits.units": 12.0, "limits.spacecraft": 30.0}).limits.units == (12,)


def test_the_papers_requirement_is_proven_impossible_with_its_limit():
    """Ten centimetres of 14.6 km^2 in single pictures: pixels of 4096 x 4096 show 0.168 km^2 each."""
    found = run_study(load_requirement(PAPER))
    assert found.spacecraft is None and not found.closed
    assert "87 observers at least, 20 are allowed" in found.forbids
    assert {one.words.partition(":")[0] for one in found.tried} == {"pixels", "diffraction", "length"}
    # What it takes can be built; a hundredth finer cannot.
    way = next(way for way in found.relaxed if "resolution_m" in way)
    eased = {**PAPER, "resolution_m": way["resolution_m"], "limits": {"units": [int(way["limits.units"])]}}
    assert _can_be_built(eased) and not _can_be_built({**eased, "resolution_m": 0.98 * way["resolution_m"]})


def test_what_is_proposed_may_be_asked_for():
    """So fine a resolution from so far away takes 3U thousands of hours to send: more than may be asked for."""
    asked = load_requirement(
        {
            "name": "fine",
            "scenario": "bennu-slow",
            "resolution_m": 0.01,
            "deliver_within_h": 24,
            "limits": {"units": [3]},
        }
    )
    ways = run_study(asked).relaxed
    assert ways and all(asked.allows(key, value) for way in ways for key, value in way.items() if key != "limits.units")
    assert all("limits.units" in way for way in ways if "deliver_within_h" in way)
    assert not asked.allows("deliver_within_h", 1e4) and asked.allows("contact_h", 2.0)


def _can_be_built(given):
    from swarm_mj.ideas.chain import encounter_of
    from swarm_mj.ideas.spacecraft import Spacecraft, spacecraft_options

    asked = load_requirement(given)
    return any(isinstance(found, Spacecraft) for *_, found in spacecraft_options(asked, *encounter_of(asked)))


def test_a_like_study_gives_its_swarm_and_bounds_and_the_same_answer(study, base, bare, monkeypatch):
    near = {**CASE, "name": "near", "resolution_m": 0.95}
    with monkeypatch.context() as no_designs:
        # Harder to see, and the known swarm sees it: as few as were proven to be needed, and nothing is left to design.
        no_designs.setattr(chain, "study_design", None)
        warm = sm.study(near, base=base)
        assert len(sm.rerun_study("near", base)) == 0
    assert warm.kept.took == study.kept.id and warm.record["taken"].startswith("its swarm of")
    assert any(f"took its swarm of {warm.record['spacecraft']['kind']}" in words for words in warm.sentences)
    alone = run_study(load_requirement(near))
    assert alone.spacecraft is not None and alone.spacecraft.name == warm.record["spacecraft"]["kind"]
    assert (alone.observers, alone.taken) == (warm.record["observers"], "")
    kept = sm.studies(base)
    assert list(kept["name"]) == ["map", "near"] and list(kept["began_with"]) == ["", study.kept.id]
    table = sm.compare_studies("map", "near", base).set_index("key")
    assert list(table.loc["requirement.resolution_m"]) == [1.0, 0.95]


def test_a_study_of_a_scenario_that_stands_otherwise_by_now_is_not_begun_with(study, tmp_path):
    file, base = tmp_path / "place.yaml", KnowledgeBase(tmp_path / "base.sqlite")
    file.write_text(packaged("bennu-slow"), encoding="utf-8")
    asked = load_requirement({**CASE, "scenario": str(file), "changes": {}})
    kept, near = base.keep(asked, study.record, "", 1.0), asked.with_value("resolution_m", 0.95)
    assert base.nearest(near) == kept
    file.write_text(packaged("bennu-slow") + "\nseed: 77\n", encoding="utf-8")
    assert base.nearest(near) is None


def test_a_known_swarm_that_does_not_do_is_not_taken(study, bare):
    record, asked = study.record, load_requirement({**CASE, "share_percent": 99})
    elsewhere = {"visiting_points": [85], "observers": []}  # which sees 97 %
    known = chain.Known(asked, record["spacecraft"]["kind"], {}, elsewhere)
    warm = run_study(asked, known=known)
    assert (warm.observers, warm.taken) == (record["observers"], "")
    assert warm.spacecraft.name == record["spacecraft"]["kind"] and warm.design is not None
    assert len({one.kind for one in warm.tried}) == len(warm.tried)


def test_a_known_swarm_that_is_heavier_only_bounds(study, bare):
    record, asked = study.record, load_requirement(CASE)
    heaviest = max((one for one in record["tried"] if one["mass_kg"]), key=lambda one: one["mass_kg"])["kind"]
    design = {key: record["scenario"]["design"][key] for key in ("visiting_points", "observers")}
    found = run_study(asked, known=chain.Known(asked, heaviest, {}, design))
    assert heaviest != record["spacecraft"]["kind"] == found.spacecraft.name
    assert found.observers == record["observers"] and found.taken.startswith("as a bound the weight of its swarm of")
    assert [one.observers for one in found.tried if one.kind == heaviest] == [None]


def test_what_is_proven_of_easier_studies_bounds_harder_ones(study, bare):
    record, harder = study.record, load_requirement({**CASE, "resolution_m": 0.95})
    design = {key: record["scenario"]["design"][key] for key in ("visiting_points", "observers")}
    others = [one["kind"] for one in record["tried"] if one["mass_kg"] and one["kind"] != record["spacecraft"]["kind"]]
    known = chain.Known(load_requirement(CASE), record["spacecraft"]["kind"], {others[0]: 5}, design)
    for asked, needed in ((harder, 5), (load_requirement({**CASE, "resolution_m": 1.05}), 1)):
        found = run_study(asked, known=known)
        row = next(one for one in found.tried if one.kind == others[0])
        # Those that observe, and one that only communicates.
        assert row.least_kg == pytest.approx((needed + 1) * row.mass_kg)


def test_a_study_does_not_begin_with_itself(study, base):
    place = KnowledgeBase(base)
    kept = place.find("map")
    like = place.nearest(kept.requirement)
    assert like is None or like.id != kept.id


def test_studies_are_compared_value_by_value():
    one = {"checks": [{"requirement": "a", "met": True}], "parts": [{"name": "x", "mass_kg": 1.0}], "spacecraft": None}
    other = {
        "checks": [{"requirement": "b", "met": False}, {"requirement": "a", "met": False}],
        "parts": [{"name": "x", "mass_kg": 2.0}],
        "spacecraft": {"mass_kg": 3.0},
    }
    assert differences(one, other) == [
        ("checks.a.met", True, False),
        ("checks.b.requirement", None, "b"),
        ("checks.b.met", None, False),
        ("parts.x.mass_kg", 1.0, 2.0),
        ("spacecraft.mass_kg", None, 3.0),
    ]


def test_reading_makes_no_knowledge_base(tmp_path, capsys):
    for verb in (["list"], ["show", "x"], ["compare", "x", "y"], ["rerun", "x"]):
        assert main(["ideas", *verb, "--base", str(tmp_path / "no" / "base.sqlite"), "--quiet"]) == 2
        assert "there is no such knowledge base" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()
    assert main(["ideas", "keys", "--quiet"]) == 0
    told = capsys.readouterr().out
    assert "limits.units" in told and "margins.relief" in told and "[m/s]" in told


def test_a_rerun_gives_the_same_bits_or_tells_what_changed(study, base):
    assert len(sm.rerun_study("map", base)) == 0
    with sqlite3.connect(base) as connection:
        record = json.loads(connection.execute("SELECT record FROM studies WHERE name = 'map'").fetchone()[0])
        record["observers"] += 1
        connection.execute("UPDATE studies SET record = ? WHERE name = 'map'", (json.dumps(record),))
    changed = sm.rerun_study("map", base)
    assert list(changed["key"]) == ["observers"]
    with pytest.raises(OutputError, match="there is no such study"):
        sm.open_study("nobody", base)


def test_pictures_reach_earth_as_late_as_the_flight_sends_them(study):
    flight = sm.fly(study.record["scenario"])
    check = study.checks.set_index("requirement").loc["all pictures on Earth after"]
    delivery = flight.delivered
    # What Earth heard, over what it can hear in a second, a third of the time.
    rates = (delivery.earth_contact_bit.sum(axis=1) / np.diff(delivery.edges_s)).max()
    busy_h = delivery.earth_bit.sum(axis=0).max() / rates / 3600.0
    visible_h = (delivery.full_s - flight.scenario.duration_s) / 3600.0
    assert check["reached"] == pytest.approx(max(visible_h, 3.0 * busy_h), rel=0.05)


def test_a_link_that_is_too_slow_in_flight_is_sized_anew(bare):
    one_kind = {**CASE, "limits": {"units": [6], "altitudes_m": [1000]}}
    slow = run_study(load_requirement(one_kind))
    late = next(check for check in slow.checks if check.requirement == chain.ON_EARTH)
    fast = run_study(load_requirement({**one_kind, "deliver_within_h": 0.8 * late.reached}))
    again = next(check for check in fast.checks if check.requirement == chain.ON_EARTH)
    assert again.met and again.reached < 0.8 * late.reached and fast.spacecraft.link != slow.spacecraft.link
    assert fast.spacecraft.name == slow.spacecraft.name
    # So it is where the swarm is known: it is sized anew, not designed.
    swarm = {key: getattr(fast.scenario.design, key) for key in ("visiting_points", "observers")}
    known = chain.Known(fast.requirement, fast.spacecraft.name, {}, swarm)
    again = run_study(fast.requirement, known=known)
    assert (again.design, again.spacecraft.link) == (None, fast.spacecraft.link) and again.taken


def test_too_light_a_limit_is_told_with_the_mass_that_can_be_built():
    limits = {"units": [6], "altitudes_m": [1000], "spacecraft_kg": 3.0}
    found = run_study(load_requirement({**CASE, "limits": limits}))
    way = next(way for way in found.relaxed if "limits.spacecraft_kg" in way)
    assert not found.closed and set(way) == {"limits.spacecraft_kg"} and "limits.spacecraft_kg = " in found.forbids
    eased = {**CASE, "limits": {**limits, **{"spacecraft_kg": way["limits.spacecraft_kg"]}}}
    assert _can_be_built(eased)
    assert not _can_be_built({**eased, "limits": {**limits, "spacecraft_kg": 0.98 * way["limits.spacecraft_kg"]}})


def test_too_few_spacecraft_are_told_with_how_many_are_needed(bare, monkeypatch):
    monkeypatch.setattr("swarm_mj.ideas.spacecraft.DETECTORS", DETECTORS[:1])
    limits = {"units": [6], "altitudes_m": [500], "spacecraft": 1}
    asked = load_requirement({**CASE, "share_percent": 99.9, "resolution_m": 0.25, "limits": limits})
    found = run_study(asked)
    assert not found.closed and found.relaxed == ({"limits.spacecraft": 2},)
    assert "limits.spacecraft = 1 is too small" in found.forbids and found.forbids.endswith("= 2, as designed")
    assert run_study(asked.eased(found.relaxed[0])).observers == 2


CORRECTED = {
    "trajectory.corrections": [{"after_release_s": 20}, {"before_arrival_s": 60}],
    "dispersions.deployment_velocity_m_s": 0.1,
}


def test_thrusters_are_sized_for_what_corrections_take(bare, tmp_path, monkeypatch):
    limits = {"units": [6], "altitudes_m": [1000]}
    asked = {**CASE, "changes": {**CASE["changes"], **CORRECTED}, "delta_v_m_s": None, "limits": limits}
    found = sm.study(asked, base=tmp_path / "base.sqlite", out=tmp_path / "out")
    checks = found.checks.set_index("requirement")
    sized = checks.loc["velocity for corrections, 99 %"]
    assert (
        found.closed
        and 0.0 < checks.loc["velocity by thrusters", "reached"] < sized["reached"] <= sized["asked"] + 1e-9
    )
    # What navigation says of the swarm, by nozzles of which three may share the force.
    flown = sm.navigate(tmp_path / "out" / "scenario.yaml")
    assert sized["reached"] == pytest.approx(3.0**0.5 * flown.delta_v["percentile_99_m_s"].max())
    thrusters = flown.scenario.spacecraft.thrusters
    mass = found.record["spacecraft"]["mass_kg"]
    assert thrusters.propellant_kg == pytest.approx(
        mass * -np.expm1(-sized["asked"] / (9.80665 * thrusters.specific_impulse_s)), rel=1e-3
    )
    # A swarm that takes more than the scenario's own goes back for more.
    honest, calls = chain._corrections_m_s, []

    def half_at_first(plan):
        calls.append(plan)
        return honest(plan) * (0.5 if len(calls) == 1 else 1.0)

    monkeypatch.setattr(chain, "_corrections_m_s", half_at_first)
    again = run_study(load_requirement(asked))
    assert again.closed and again.spacecraft.propellant_kg == pytest.approx(found.record["spacecraft"]["propellant_kg"])
    # What is proven of an easier study bounds it, whatever the thrusters came to.
    swarm = {key: getattr(again.scenario.design, key) for key in ("visiting_points", "observers")}
    known = chain.Known(load_requirement({**asked, "resolution_m": 1.1}), again.spacecraft.name, {}, swarm)
    seen = chain.encounter_of(again.requirement)[1]
    resolved = again.requirement.with_value("delta_v_m_s", seen.corrections_m_s)
    assert chain._Search(resolved, again.requirement, seen, known, None, 1, print).harder
    # A velocity that is asked for is not raised.
    calls.clear()
    tight = run_study(load_requirement({**asked, "delta_v_m_s": 0.5 * sized["reached"]}))
    assert not tight.closed and tight.relaxed == ({"delta_v_m_s": pytest.approx(sized["reached"])},)


@pytest.mark.parametrize(("changes", "delta_v"), [({}, None), (CORRECTED, 0.0)])
def test_thrusters_and_corrections_belong_together(changes, delta_v):
    asked = load_requirement({**CASE, "changes": {**CASE["changes"], **changes}, "delta_v_m_s": delta_v})
    with pytest.raises(ScenarioError, match=r"delta_v_m_s = (null|0): must be"):
        run_study(asked)


def test_campaigns_decide_whether_a_probability_is_kept(bare):
    asked = load_requirement({**CASE, "quality": "resolved", "share_percent": 10, "probability": 0.9, "flights": 10})
    flown = []

    def campaign(covered):
        def fly(scenario, given):
            flown.append((scenario.designer.tolerance_percent, given.flights, scenario.designer.quality_class))
            return Verified(10, 0, covered, 0.5, 0.98, 0.9), "campaign-1"

        return fly

    kept = run_study(asked, campaign=campaign(9))
    assert flown[0] == (90.0, 10, "resolved") and kept.closed
    check = next(check for check in kept.checks if check.requirement.startswith("probability"))
    assert (check.reached, check.met, check.shown) == (0.9, True, "campaign-1")
    # That the truth may be higher does not meet it.
    broken = run_study(asked, campaign=campaign(8))
    assert not broken.closed and "no swarm of any of them meets it" in broken.forbids
    assert any("probability of that share 0.8, not 0.9" in one.words for one in broken.tried)
    assert broken.relaxed == ({"probability": 0.8},) and broken.forbids.endswith("it takes probability = 0.8, as flown")


def test_what_is_not_flown_or_not_proven_is_said(study, bare, monkeypatch, tmp_path):
    one_kind = {**CASE, "limits": {"units": [6], "altitudes_m": [1000]}}
    monkeypatch.setattr(chain, "deliver", lambda *_, **__: None)  # as of more spacecraft than are looked at
    found = run_study(load_requirement(one_kind))
    check = next(check for check in found.checks if check.requirement == chain.ON_EARTH)
    assert check.reached == found.spacecraft.send_h and check.evidence.startswith("as sized")
    assert "the lightest swarm among" in study.sentences[0]
    # A kind whose swarm failed, where the proof left room for a lighter one.
    record = json.loads(json.dumps(study.record))
    record["tried"].append({**record["tried"][-1], "kind": "another", "proven": 0, "mass_kg": 0.9 * record["swarm_kg"]})
    KnowledgeBase(tmp_path / "base.sqlite").keep(study.kept.requirement, record, "", 0.0)
    doubtful = sm.open_study("map", tmp_path / "base.sqlite").sentences[0]
    assert "the lightest found, lighter ones of another are not ruled out, among" in doubtful


def test_room_and_deployers_limit_swarms(bare):
    limits = {**CASE["limits"], "swarm_u": 3}
    small = run_study(load_requirement({**CASE, "limits": limits}))
    assert not small.closed and any("U, 3 U are allowed" in one.words for one in small.tried)
    changes = {**CASE["changes"], "mothership.velocity": "rest"}
    limits = {**CASE["limits"], "units": [6], "deployer_m_s": 1.0}
    weak = run_study(load_requirement({**CASE, "changes": changes, "limits": limits}))
    assert not weak.closed and any("velocity by the deployer" in one.words for one in weak.tried)
    assert weak.relaxed[0]["limits.deployer_m_s"] > 1.0


def test_sobol_indices_tell_what_drives_and_what_does_not():
    asked = load_requirement({**CASE, "sobol": 4, "limits": {"units": [6], "altitudes_m": [1000]}})
    found, unbuilt = sobol_indices(asked, *chain.encounter_of(asked), workers=2, tell=lambda share: None)
    total = {(row.outcome, row.key): row.total for row in found}
    assert unbuilt == 0.0 and "can_be_built" not in {row.outcome for row in found}
    # The time of the pictures' way: their number by the overlap, and the contacts; the turn has nothing to do with it.
    assert total["send_h", "contact_h"] > 0.05 and total["send_h", "turn_s"] == pytest.approx(0.0, abs=1e-12)
    assert total["swarm_kg", "margins.mass"] > 0.05 and total["swarm_kg", "margins.overlap"] == pytest.approx(
        0.0, abs=1e-12
    )


def _keep(path, numbers):
    place = KnowledgeBase(path)
    for k in numbers:
        asked = load_requirement({**PAPER, "name": f"n{k}", "resolution_m": 1.0 + k})
        place.keep(asked, {"closed": False, "observers": 0, "swarm_kg": None, "spacecraft": None}, "", 0.0)


def test_two_processes_lose_nothing_and_what_is_killed_leaves_nothing_half(tmp_path):
    path, context = tmp_path / "both.sqlite", multiprocessing.get_context("spawn")
    workers = [context.Process(target=_keep, args=(path, range(first, 12, 2))) for first in (0, 1)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert sorted(one.name for one in KnowledgeBase(path).kept()) == sorted(f"n{k}" for k in range(12))
    victim = context.Process(target=_keep, args=(path, range(12, 4000)))
    victim.start()
    while len(KnowledgeBase(path).kept()) < 14:
        pass
    victim.kill()
    victim.join()
    kept = KnowledgeBase(path).kept()
    assert [one for one in kept if identity(one.requirement) != one.id] == [] and 14 <= len(kept) < 4000
    broken = tmp_path / "broken.sqlite"
    broken.write_text("no database at all, but long enough to be taken for one" * 20)
    with pytest.raises(OutputError, match=r"broken\.sqlite: the knowledge base cannot be used"):
        KnowledgeBase(broken)


def _fill(path):
    """Keep studies until the disk is full, which a limit of the size of files stands for."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 60_000,) * 2)
    try:
        _keep(path, range(100, 4000))
    except OutputError as error:
        path.with_suffix(".said").write_text("")  # no byte more than a limit allows
        sys.exit(0 if "the knowledge base cannot be used" in str(error) else 3)


@pytest.mark.skipif(sys.platform == "win32", reason="no limits of resources")
def test_a_full_disk_loses_nothing_that_was_kept(tmp_path):
    path = tmp_path / "full.sqlite"
    _keep(path, range(3))
    filler = multiprocessing.get_context("spawn").Process(target=_fill, args=(path,))
    filler.start()
    filler.join()
    assert filler.exitcode == 0 and path.with_suffix(".said").exists()
    names = {one.name for one in KnowledgeBase(path).kept()}
    assert {"n0", "n1", "n2", "n100"} <= names and len(names) < 3900
    _keep(path, [9])  # with room again it goes on
    assert KnowledgeBase(path).find("n9").name == "n9"


def test_an_interrupted_study_leaves_nothing_half_and_begins_anew(tmp_path, bare, monkeypatch, capsys):
    file, base, out = tmp_path / "map.yaml", tmp_path / "base.sqlite", tmp_path / "out"
    file.write_text(yaml.safe_dump({**CASE, "limits": {"units": [6], "altitudes_m": [1000]}}))
    command = ["ideas", str(file), "--base", str(base), "--out", str(out), "--quiet"]
    with monkeypatch.context() as interrupted:
        interrupted.setattr(chain, "verify", raises_interrupt)
        assert main(command) == 130
    assert KnowledgeBase(base).kept() == [] and list(out.iterdir()) == []
    assert main(command) == 0
    told = capsys.readouterr().out
    assert f"begin with {out / 'report.html'}" in told.replace("\n", "")
    # The report points to what shows it.
    page = (out / "report.html").read_text()
    for shown in ("flight/report.html", "design/design.json"):
        assert f'href="{shown}"' in page and (out / shown).is_file()


def raises_interrupt(*_):
    raise KeyboardInterrupt


def test_the_command_tells_proofs_and_refuses_what_makes_no_sense(tmp_path, capsys):
    file, base = tmp_path / "paper.yaml", ["--base", str(tmp_path / "base.sqlite"), "--quiet"]
    file.write_text(yaml.safe_dump(PAPER))
    assert main(["ideas", str(file), *base, "--out", str(tmp_path / "out")]) == 1
    told = capsys.readouterr().out
    assert "cannot be met" in told and "87 observers at least" in told and "it takes limits.units = 6" in told
    page = (tmp_path / "out" / "report.html").read_text()
    assert "87 observers at least" in page and "What it would take" in page and "limits.units, resolution_m" in page
    assert (tmp_path / "out" / "study.json").exists() and not (tmp_path / "out" / "scenario.yaml").exists()
    assert main(["ideas", "list", *base]) == 0 and "paper" in capsys.readouterr().out
    assert main(["ideas", "show", "paper", *base]) == 1
    assert main(["ideas", "compare", "paper", *base]) == 2
    assert main(["ideas", "show", "nobody", *base]) == 2 and "there is no such study" in capsys.readouterr().err
    file.write_text("name: x\nscenario: eros-config1\nresolution: 3\n")
    assert main(["ideas", str(file), *base]) == 2 and "resolution" in capsys.readouterr().err
