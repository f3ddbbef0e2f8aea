"""A result folder appears whole or not at all."""

import json
import os
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from swarm_mj.cli.main import main
from swarm_mj.errors import OutputError
from swarm_mj.io.atomic import FIGURES, FILES, KINDS, MARKER, Result, atomic_file, atomic_folder, write_text

FIRST, SECOND = (json.dumps({"scenario": name, "versions": {"swarm_mj": "0"}}) for name in ("first", "the second"))


def leftovers(parent):
    return [p.name for p in parent.iterdir() if p.name.startswith(".")]


def test_the_folder_appears_when_all_is_done(tmp_path):
    with atomic_folder(tmp_path / "deep" / "run") as partial:
        (partial / MARKER).write_text(FIRST)
        assert not (tmp_path / "deep" / "run").exists()
    assert (tmp_path / "deep" / "run" / MARKER).read_text() == FIRST
    assert leftovers(tmp_path / "deep") == []


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt])
def test_a_failure_leaves_nothing_and_the_earlier_result_intact(tmp_path, failure):
    run = tmp_path / "run"
    with atomic_folder(run) as partial:
        (partial / MARKER).write_text(FIRST)
    with pytest.raises(failure), atomic_folder(run) as partial:
        (partial / MARKER).write_text(SECOND)
        raise failure
    assert (run / MARKER).read_text() == FIRST
    assert leftovers(tmp_path) == []


def test_an_earlier_result_is_replaced_whole(tmp_path):
    for text in (FIRST, SECOND):
        with atomic_folder(tmp_path / "run") as partial:
            (partial / MARKER).write_text(text)
            (partial / ("links.png" if text == FIRST else "target.png")).touch()
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == [MARKER, "target.png"]
    assert leftovers(tmp_path) == []


def test_a_folder_that_is_no_result_is_never_touched(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputError, match="not an earlier result"), atomic_folder(tmp_path):
        pass
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("summary.json", "{}"),
        ("summary.json", '{"scenario": "a"}'),
        ("summary.json", '{"scenario": "a", "versions": null}'),
        ("summary.json", '{"scenario": "a", "versions": 3}'),
        ("summary.json", '{"scenario": "a", "versions": ["swarm_mj"]}'),
        ("thesis.txt", ""),
        ("notes.json", "{}"),
    ],
)
def test_a_folder_that_only_looks_like_a_result_is_not_replaced(tmp_path, name, content):
    run = tmp_path / "run"
    run.mkdir()
    if name != MARKER:
        (run / MARKER).write_text("{}" if name == "notes.json" else FIRST)
    (run / name).write_text(content)
    with pytest.raises(OutputError, match="not an earlier result"), atomic_folder(run):
        pass
    assert (run / name).read_text() == content


def test_a_result_with_a_folder_inside_and_the_current_folder_are_not_replaced(tmp_path, monkeypatch):
    run = tmp_path / "run"
    (run / "inner").mkdir(parents=True)
    (run / MARKER).write_text(FIRST)
    with pytest.raises(OutputError, match="inner"), atomic_folder(run):
        pass
    monkeypatch.chdir(run / "inner")
    with pytest.raises(OutputError, match="folder you are in"), atomic_folder(run):
        pass


def test_a_link_to_a_result_stays_a_link(tmp_path):
    with atomic_folder(tmp_path / "run") as partial:
        (partial / MARKER).write_text(FIRST)
    (tmp_path / "link").symlink_to(tmp_path / "run")
    with atomic_folder(tmp_path / "link") as partial:
        (partial / MARKER).write_text(SECOND)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "run" / MARKER).read_text() == SECOND


def test_a_file_in_the_place_is_refused(tmp_path):
    (tmp_path / "run").write_text("")
    with pytest.raises(OutputError, match="is a file"), atomic_folder(tmp_path / "run"):
        pass


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_parent_is_a_clear_error(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="cannot be written"), atomic_folder(tmp_path / "run"):
        pass


def test_an_unwritable_place_is_a_clear_error():
    with pytest.raises(OutputError, match="cannot be written"), atomic_folder(Path("/proc/nowhere/run")):
        pass


def summary(result):
    proof = {"proof": {}} if result.kind == "design" else {}
    return json.dumps({"scenario": result.scenario, "versions": {"swarm_mj": "0"}, **proof})


def put(folder, result, files=(), kept=None):
    with atomic_folder(folder, result, None if kept is None else kept.append) as partial:
        (partial / MARKER).write_text(summary(result))
        for name in files:
            (partial / name).write_text("new")


RESULTS = [Result("run", "a"), Result("run", "b"), Result("design", "a"), Result("design", "b")]


@pytest.mark.parametrize("there", RESULTS, ids=str)
@pytest.mark.parametrize("wanted", RESULTS, ids=str)
def test_a_result_is_replaced_only_by_one_of_its_kind_and_scenario(tmp_path, there, wanted):
    run = tmp_path / "run"
    put(run, there)
    if wanted == there:
        put(run, wanted)
        return
    begun = False
    with pytest.raises(OutputError, match=rf"run: holds {there}, which {wanted} does not replace; .*--out"):
        with atomic_folder(run, wanted):
            begun = True
    assert not begun
    assert (run / MARKER).read_text() == summary(there)
    assert leftovers(tmp_path) == []


EXTRAS = ("overview.mp4", "split.gif", "comparison.html", "arrival.png", "notes.json", "mine.pdf")


@pytest.mark.parametrize("linked", [True, False], ids=["by a second name", "where files have one name only"])
def test_films_and_files_of_ones_own_outlast_the_result_that_they_lie_with(tmp_path, monkeypatch, linked):
    if not linked:
        monkeypatch.setattr(os, "link", lambda *names, **how: (_ for _ in ()).throw(PermissionError("no links here")))
    run, kept = tmp_path / "run", []
    own = ("telemetry.nc", "coverage.png", "coverage.pdf", "report.html")
    put(run, RESULTS[0], own, kept)
    assert kept == []
    for name in EXTRAS:
        (run / name).write_text(f"old {name}")
    put(run, RESULTS[0], ("telemetry.nc", "arrival.png"), kept)
    names = sorted(set(EXTRAS) - {"arrival.png"})
    assert kept == [f"kept in {run}, but of the earlier run, not this one: {', '.join(names)}"]
    assert {p.name for p in run.iterdir()} == {MARKER, "telemetry.nc", *EXTRAS}
    assert {p.name for p in run.iterdir() if p.read_text() == "new"} == {"telemetry.nc", "arrival.png"}
    assert all((run / name).read_text() == f"old {name}" for name in names)
    assert leftovers(tmp_path) == []


def test_a_link_among_the_kept_files_stays_a_link_and_its_target_stays_where_it_is(tmp_path):
    (tmp_path / "film.mp4").write_text("a film")
    put(tmp_path / "run", RESULTS[0])
    (tmp_path / "run" / "film.mp4").symlink_to("../film.mp4")
    put(tmp_path / "run", RESULTS[0])
    assert (tmp_path / "run" / "film.mp4").is_symlink()
    assert (tmp_path / "run" / "film.mp4").read_text() == (tmp_path / "film.mp4").read_text() == "a film"


def test_what_is_put_into_the_folder_while_the_new_result_is_made_is_kept_too(tmp_path):
    run = tmp_path / "run"
    put(run, RESULTS[0])
    with atomic_folder(run, RESULTS[0]) as partial:
        (partial / MARKER).write_text(summary(RESULTS[0]))
        (run / "thesis.tex").write_text("years of work")
        (run / "chapters").mkdir()
        (run / "chapters" / "one.tex").write_text("more of it")
    assert (run / "thesis.tex").read_text() == "years of work"
    assert (run / "chapters" / "one.tex").read_text() == "more of it"
    assert leftovers(tmp_path) == []


#: Dies as by kill -9 before the step of that number that changes what stands in the place.
KILLED = """
import os, pathlib, shutil, sys
from swarm_mj.io.atomic import MARKER, Result, atomic_file, atomic_folder, write_text
left = int(sys.argv[2])
def deadly(step):
    def taken(*arguments, **keywords):
        global left
        left -= 1
        if left < 0:
            os._exit(9)
        return step(*arguments, **keywords)
    return taken
with atomic_folder(pathlib.Path(sys.argv[1]), Result("run", "a")) as partial:
    (partial / MARKER).write_text((pathlib.Path(sys.argv[1]) / MARKER).read_text())
    (partial / "telemetry.nc").write_text("new")
    pathlib.Path.rename, os.unlink, os.rmdir = map(deadly, (pathlib.Path.rename, os.unlink, os.rmdir))
    os.link = deadly(os.link) if sys.argv[3] == "links" else None
"""


@pytest.mark.parametrize("links", ["links", "no links"])
def test_a_film_outlasts_a_run_that_is_killed_at_any_step_of_the_exchange(tmp_path, links):
    code = KILLED if links == "links" else KILLED.replace("None", "lambda *n, **k: os.stat('/nowhere')")
    statuses = []
    for step in range(30):
        run = tmp_path / str(step) / "run"
        put(run, RESULTS[0], ["telemetry.nc", "links.png"])
        for name in ("overview.mp4", "my.mp4"):
            (run / name).write_text(f"old {name}")
        command = [sys.executable, "-c", code, str(run), str(step), links]
        statuses.append(subprocess.run(command, capture_output=True).returncode)
        put(run, RESULTS[0], ["telemetry.nc"])
        assert (run / "overview.mp4").read_text() == "old overview.mp4"
        assert (run / "my.mp4").read_text() == "old my.mp4"
        assert sorted(p.name for p in run.iterdir()) == ["my.mp4", "overview.mp4", MARKER, "telemetry.nc"]
        assert leftovers(run.parent) == []
        if statuses[-1] == 0:
            break
    assert statuses[-1] == 0 and set(statuses[:-1]) == {9} and len(statuses) > 5


def test_an_interruption_between_the_two_renames_puts_the_earlier_result_back(tmp_path, monkeypatch):
    run = tmp_path / "run"
    put(run, RESULTS[0], ["links.png"])
    rename = Path.rename

    def interrupted(path, target):
        if path.suffix == ".partial":
            raise KeyboardInterrupt
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        put(run, RESULTS[0])
    assert (run / "links.png").exists()
    assert leftovers(tmp_path) == []


def test_folders_that_were_made_for_a_result_go_with_it_and_others_stay(tmp_path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "mine" / "new" / "newer" / "run"):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == [tmp_path / "mine"]
    assert list((tmp_path / "mine").iterdir()) == []


def test_the_names_of_a_results_files_are_those_that_are_written(tmp_path, monkeypatch):
    from swarm_mj.figures.design_figures import COMPOSERS as OF_DESIGNS
    from swarm_mj.figures.drawing import OPTIONAL
    from swarm_mj.figures.run_figures import COMPOSERS
    from swarm_mj.reports import REPORT_NAME

    assert set(FIGURES["run"]) == set(COMPOSERS) and set(FIGURES["design"]) == set(OF_DESIGNS)
    assert REPORT_NAME in FILES["run"] and all(Path(name).suffix in KINDS for name in sum(FILES.values(), ()))
    # Only names matter here, and other processes would not know of that.
    monkeypatch.setattr("swarm_mj.figures.style.save", lambda figure, path: path.touch())
    monkeypatch.setattr("swarm_mj.figures.drawing.usable_cores", lambda: 1)
    run, design = tmp_path / "run", tmp_path / "design"
    assert main(["design", "eros-quick", "--quiet", "--pareto", "--compare", "--pdf", "--out", str(design)]) == 0
    flown = ["--design", str(design / "design.json"), "--quiet", "--pdf", "--out", str(run)]
    assert main(["fly", "eros-quick", *flown]) == 0
    for folder, result in ((run, Result("run", "eros-quick")), (design, Result("design", "eros-quick"))):
        written = {p.name for p in folder.iterdir()}
        assert not [name for name in written if not result.owns(name)]
        assert written >= set(FILES[result.kind])
        assert written >= {
            f"{stem}.{kind}" for stem in {*FIGURES[result.kind]} - {*OPTIONAL, "certainty"} for kind in ("png", "pdf")
        }
        assert not [name for name in written if name.rpartition(".")[0] in OPTIONAL]  # nothing was fired


def test_the_command_keeps_films_and_says_which(tmp_path, capsys):
    run = tmp_path / "run"
    quick = ["fly", "eros-quick", "--quiet", "--no-figures", "--no-report", "--out"]
    assert main([*quick, str(run)]) == 0
    (run / "overview.mp4").write_text("a film")
    (run / "my.mp4").write_text("my film")
    capsys.readouterr()
    assert main([*quick, str(run)]) == 0
    said = f"kept in {run}, but of the earlier run, not this one: my.mp4, overview.mp4\n"
    assert capsys.readouterr().out.count(said) == 1
    assert (run / "overview.mp4").read_text() == "a film" and (run / "my.mp4").read_text() == "my film"


def test_the_command_refuses_the_place_of_another_result_before_anything_is_flown(tmp_path, capsys, monkeypatch):
    shutil.rmtree(tmp_path)
    put(tmp_path / "eros-config2", RESULTS[0], ["report.html"])
    monkeypatch.setattr("swarm_mj.api.flight.make_plan", lambda scenario: pytest.fail("was flown"))
    monkeypatch.setattr("swarm_mj.api.design.study_design", lambda *a, **k: pytest.fail("was designed"))
    # The first of two would have its place.
    assert main(["fly", "eros-quick", "eros-config2", "--out", str(tmp_path)]) == 2
    assert "holds a run of a, which a run of eros-config2 does not replace" in capsys.readouterr().err
    assert main(["design", "eros-quick", "--out", str(tmp_path / "eros-config2")]) == 2
    assert "holds a run of a, which a design of eros-quick does not replace" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["eros-config2"]
    assert sorted(p.name for p in (tmp_path / "eros-config2").iterdir()) == ["report.html", MARKER]


def through_atomic_file(path, text):
    with atomic_file(path) as partial:
        partial.write_text(text)


@pytest.mark.parametrize("write", [write_text, through_atomic_file])
def test_no_link_that_waits_beside_a_file_leads_what_is_written_elsewhere(tmp_path, write):
    mine = tmp_path / "mine"
    mine.write_text("mine")
    for name in (".a.json.partial", f".a.json.{os.getpid()}.partial", ".a.json.lock"):
        (tmp_path / name).symlink_to(mine)
    with suppress(OutputError):  # of the link in the place of the lock
        write(tmp_path / "a.json", "theirs")
    assert mine.read_text() == "mine"
