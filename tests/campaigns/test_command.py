"""The command as a newcomer types it: what it lists, what it refuses, and what a refusal leaves behind."""

import shlex

import pytest

from swarm_mj.campaigns import runner
from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.campaigns.manifest import kept_runs, take_over
from swarm_mj.campaigns.store import read_results
from swarm_mj.cli.main import main
from swarm_mj.io.atomic import atomic_folder
from swarm_mj.io.lock import only_one

from .conftest import ONE


@pytest.fixture
def said(capsys, monkeypatch):
    """Run the command; returns its exit status and all that it said."""
    monkeypatch.setenv("COLUMNS", "200")

    def said(*arguments):
        status = main(["campaign", *map(str, arguments)])
        out, errors = capsys.readouterr()
        return status, out + errors

    return said


def begun(path, folder, runs):
    """A campaign that has begun and flown nothing yet."""
    with only_one(folder):
        take_over(load_campaign(path, runs=runs), folder, resume=False)


def test_a_refused_campaign_leaves_the_result_of_a_run_as_it_was(said, write, tmp_path):
    result = tmp_path / "fx"
    for _ in range(2):
        with atomic_folder(result) as partial:
            (partial / "summary.json").write_text('{"scenario": "x", "swarm_mj": "0"}')
        status, words = said(write(), "--out", result)
        assert status == 2 and "holds summary.json and no campaign" in words
        assert [p.name for p in result.iterdir()] == ["summary.json"]


def test_a_folder_is_judged_again_under_the_lock_which_is_removed_when_made_in_vain(said, write, tmp_path, monkeypatch):
    def meanwhile(folder, **_):
        folder.mkdir()
        (folder / "thesis.tex").write_text("years")

    monkeypatch.setattr(runner, "require_place", meanwhile)
    status, words = said(write(), "--out", tmp_path / "mine")
    assert status == 2 and "holds thesis.tex and no campaign" in words
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis.tex"]


def test_a_file_in_place_of_the_folder_is_named(said, write, tmp_path):
    (tmp_path / "fx").write_text("")
    status, words = said(write(), "--out", tmp_path / "fx")
    assert status == 2 and "fx: is a file; --out must name a folder" in words


@pytest.mark.parametrize("there", [False, True])
def test_there_must_be_a_campaign_to_go_on_with(said, write, tmp_path, there):
    out = tmp_path / "nothere"
    if there:
        out.mkdir()
    status, words = said(write(), "--resume", "--out", out)
    assert status == 2 and "nothere: holds no campaign to go on with" in words
    assert out.exists() == there and not (there and list(out.iterdir()))


@pytest.mark.slow
def test_the_printed_command_goes_on_with_as_many_runs_as_were_asked_for(said, write, tmp_path, monkeypatch):
    path, out = write(runs=40), tmp_path / "a folder"

    def interrupt(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(runner, "_collect", interrupt)
        status, words = said(path, "--out", out, "--runs", 2, "--workers", 1, "--no-figures", "--quiet")
    assert status == 130
    (command,) = [line.split("go on with ")[1] for line in words.splitlines() if "go on with " in line]
    program, name, *arguments = shlex.split(command)
    assert (program, name) == ("swarm-mj", "campaign")
    status, words = said(*arguments)
    assert status == 0 and "runs = 2, with which it began" in words
    assert read_results(out)["row"].to_pylist() == [0, 1]
    assert {p.name for p in out.iterdir()} == {"campaign.json", "results.parquet", "summary.json"}
    status, words = said(path, "--out", out, "--runs", 40, "--resume")
    assert status == 2 and "campaign.runs = 40, was 2" in words


def test_rows_of_a_folder_are_counted_as_it_began(said, write, tmp_path):
    path, out = write(runs=40), tmp_path / "out"
    begun(path, out, 3)
    for row in (3, 99999, -1):
        status, words = said(path, "--out", out, "--replay", row)
        assert status == 2 and f"--replay {row}: must be a row of this campaign, 0 to 2" in words
    status, words = said(path, "--out", out, "--runs", 5, "--replay", 5)
    assert status == 2 and "0 to 4" in words
    status, words = said(path, "--out", tmp_path / "absent", "--replay", 40)
    assert status == 2 and "0 to 39" in words


def test_the_runs_of_another_campaign_in_the_folder_count_for_nothing(write, tmp_path):
    path, out = write(ONE, runs=4), tmp_path / "out"
    begun(path, out, 2)
    campaign = load_campaign(path).campaign
    assert kept_runs(out, campaign) == 2
    assert kept_runs(out, campaign.model_copy(update={"name": "other"})) == 4
    assert kept_runs(out, campaign.model_copy(update={"method": "sobol"})) == 4
    (out / "campaign.json").write_text("{}")
    assert kept_runs(out, campaign) == 4 and kept_runs(tmp_path / "absent", campaign) == 4


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("campaign", "flights of each scenario"),
        ("design", "(default: eros-config1)"),
        ("view", "(default: eros-config1)"),
    ],
)
def test_the_help_says_what_is_meant_by_default(command, words, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit):
        main([command, "--help"])
    assert words in capsys.readouterr().out


@pytest.mark.parametrize("command", [["campaign", "eros-losses"], ["design", "eros-quick"]])
@pytest.mark.parametrize("workers", ["0", "-3"])
def test_less_than_one_worker_is_refused(command, workers, tmp_path, capsys):
    assert main([*command, "--workers", workers, "--out", str(tmp_path / "out")]) == 2
    assert f"workers = {workers} (--workers): must be at least 1" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
