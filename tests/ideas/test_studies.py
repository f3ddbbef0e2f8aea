"""The chain and the knowledge base: swarms that fly what was asked, proofs that none can, and what is kept of both."""

import json
import multiprocessing
import sqlite3

import pytest
import yaml

import swarm_mj as sm
from swarm_mj.cli.main import main
from swarm_mj.errors import OutputError
from swarm_mj.ideas.chain import run_study
from swarm_mj.ideas.knowledge import KnowledgeBase, identity
from swarm_mj.ideas.requirement import load_requirement

#: A map of Bennu's target that a few spacecraft make.
CASE = {
    "name": "map",
    "scenario": "bennu-slow",
    "changes": {"duration_s": 700, "observation.interval_s": 60, "designer.max_points": 8},
    "resolution_m": 1.0,
    "share_percent": 90,
    "limits": {"units": [3, 6], "altitudes_m": [1000]},
}
PAPER = {"name": "paper", "scenario": "eros-config1", "resolution_m": 0.1, "limits": {"units": [3]}}


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    return tmp_path_factory.mktemp("ideas") / "base.sqlite"


@pytest.fixture(scope="module")
def study(base):
    return sm.study(CASE, base=base)


def test_the_swarm_flies_what_was_asked(study, tmp_path):
    assert study.closed and set(study.checks["met"]) == {True}
    record, kinds = study.record, study.tried
    assert record["swarm_kg"] == pytest.approx(record["observers"] * record["spacecraft"]["mass_kg"])
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
    assert row["higher_kg"] == pytest.approx(now * 1.24 / 1.2) and row["lower_kg"] == pytest.approx(
        now * (1.0 + row["lower"]) / 1.2
    )
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


def _can_be_built(given):
    from swarm_mj.ideas.chain import encounter_of
    from swarm_mj.ideas.spacecraft import Spacecraft, spacecraft_options

    asked = load_requirement(given)
    return any(isinstance(found, Spacecraft) for *_, found in spacecraft_options(asked, *encounter_of(asked)))


def test_a_like_study_is_begun_with_and_gives_the_same_answer(study, base):
    near = {**CASE, "name": "near", "resolution_m": 1.05}
    warm = sm.study(near, base=base)
    assert warm.kept.took == study.kept.id
    alone = run_study(load_requirement(near))
    assert alone.spacecraft is not None and alone.spacecraft.name == warm.record["spacecraft"]["kind"]
    assert alone.observers == warm.record["observers"]
    kept = sm.studies(base)
    assert list(kept["name"]) == ["map", "near"] and list(kept["began_with"]) == ["", study.kept.id]
    table = sm.compare_studies("map", "near", base).set_index("key")
    assert list(table.loc["requirement.resolution_m"]) == [1.0, 1.05]


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


def test_the_command_tells_proofs_and_refuses_what_makes_no_sense(tmp_path, capsys):
    file, base = tmp_path / "paper.yaml", ["--base", str(tmp_path / "base.sqlite"), "--quiet"]
    file.write_text(yaml.safe_dump(PAPER))
    assert main(["ideas", str(file), *base, "--out", str(tmp_path / "out")]) == 1
    told = capsys.readouterr().out
    assert "cannot be met" in told and "87 observers at least" in told and "it takes limits.units = 12" in told
    assert "87 observers at least" in (tmp_path / "out" / "report.html").read_text()
    assert (tmp_path / "out" / "study.json").exists() and not (tmp_path / "out" / "scenario.yaml").exists()
    assert main(["ideas", "list", *base]) == 0 and "paper" in capsys.readouterr().out
    assert main(["ideas", "show", "paper", *base]) == 1
    assert main(["ideas", "compare", "paper", *base]) == 2
    assert main(["ideas", "show", "nobody", *base]) == 2 and "there is no such study" in capsys.readouterr().err
    file.write_text("name: x\nscenario: eros-config1\nresolution: 3\n")
    assert main(["ideas", str(file), *base]) == 2 and "resolution" in capsys.readouterr().err
