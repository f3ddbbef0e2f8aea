"""Whatever stands on the command line: an exit status, and one message without a traceback."""

import os
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_mj.cli.main import main

from .limits import bounded, examples
from .mesh_files import FORMS

pytestmark = pytest.mark.robust

#: argparse and the program itself refuse with these.
REFUSED = {1, 2}
LONG = "x" * 5000
COMMANDS = {
    "nothing": [],
    "no such command": ["frobnicate"],
    "no such option": ["fly", "eros-quick", "--fast"],
    "an empty name": ["fly", ""],
    "an endless name": ["fly", LONG],
    "a folder": ["fly", "."],
    "a device": ["fly", "/dev/zero"],
    "a seed that is none": ["fly", "eros-quick", "--seed", "lucky"],
    "a negative seed": ["fly", "eros-quick", "--seed", "-1"],
    "an endless seed": ["fly", "eros-quick", "--seed", "9" * 5000],
    "an override of nothing": ["fly", "eros-quick", "--set", ""],
    "an override with a bomb": ["fly", "eros-quick", "--set", "camera=[&a [1], *a]"],
    "a design that is a device": ["fly", "eros-quick", "--design", "/dev/zero"],
    "a design without end": ["fly", "eros-quick", "--design", LONG],
    "a folder that is the present one": ["fly", "eros-quick", "--out", "."],
    "a folder without end": ["fly", "eros-quick", "--out", LONG],
    "a folder inside a file": ["fly", "eros-quick", "--out", os.path.join(__file__, "run")],
    "two of one name": ["fly", "eros-quick", "eros-quick"],
    "a fold of none": ["design", "eros-quick", "--fold", "0"],
    "a scenario above": ["packaged", "../schema"],
    "a shape that is a device": ["load-shape", "/dev/zero"],
    "a shape that is a folder": ["load-shape", "."],
    "a shape without end": ["load-shape", LONG + ".obj"],
    "a mesh of no faces": ["build-shape", "--frequency", "0"],
    "a mesh of too many faces": ["build-shape", "--frequency", "1000000"],
    "a mesh that goes nowhere": ["build-shape", "--frequency", "2", "--out", ""],
    "a mesh that goes into a folder": ["build-shape", "--frequency", "2", "--out", "."],
    "harmonics of too high a degree": ["fit-harmonics", "body.obj", "--gm", "1", "--degree", "1000"],
    "harmonics of no mass": ["fit-harmonics", "body.obj"],
    "a check that is none": ["validate", "--only", "nonsense"],
}


def ended(arguments):
    with bounded():
        try:
            return main(arguments)
        except SystemExit as exit:  # argparse
            return exit.code


@pytest.mark.parametrize("case", COMMANDS)
def test_a_wrong_command_is_refused_with_one_message_and_no_file(case, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert ended(COMMANDS[case]) in REFUSED
    message = capsys.readouterr().err
    assert message.count("error:") == 1
    assert "Traceback" not in message
    assert not list(tmp_path.iterdir())


KNOWN = """fly design available explain packaged json-schema build-shape load-shape fit-harmonics validate --seed --set --out
    --design --fold --workers --quiet --no-figures --only --unit km nobody -1 1e9 . .. -- -h a=b""".split()
WORDS = st.sampled_from(["", *KNOWN]) | st.text(st.characters(exclude_characters="\0"), max_size=10)


@examples(100)
@given(words=st.lists(WORDS, max_size=5))
def test_any_words_end_in_an_exit_status(words, tmp_path_factory, monkeypatch_module):
    monkeypatch_module.chdir(tmp_path_factory.getbasetemp())
    # A mistake at the end, so that nothing flies for minutes.
    assert ended([*words, "--no-such-option"]) in {0, *REFUSED}
    if not {"fly", "design", "build-shape", "load-shape", "fit-harmonics", "validate"} & set(words):
        assert ended(words) in {0, *REFUSED}


@pytest.fixture(scope="module")
def monkeypatch_module():
    with pytest.MonkeyPatch.context() as patch:
        yield patch


def test_a_mesh_is_not_written_where_it_must_not_be(tmp_path, monkeypatch, capsys):
    (tmp_path / "ball.obj").write_bytes(FORMS["obj"][1])
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path / "folder")
    for place in ("", ".", "a/b/c.obj", "x" * 300):
        assert main(["load-shape", str(tmp_path / "ball.obj"), "--unit", "m", "--out", place]) in REFUSED
    assert not list((tmp_path / "folder").iterdir())
    assert capsys.readouterr().err.count("cannot be written") == 4


def test_the_program_itself_shows_no_traceback(tmp_path, monkeypatch, capsys):
    command = [sys.executable, "-m", "swarm_mj.cli.main", "fly", "eros-quick", "--set", b"description=\xff"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode in REFUSED
    assert done.stderr.startswith("swarm-mj: error: --set")
    assert "Traceback" not in done.stderr

    (tmp_path / "bad.yaml").write_bytes(b"name: !!timestamp soon\n")
    monkeypatch.chdir(tmp_path)
    assert main(["fly", "bad.yaml"]) in REFUSED
    assert capsys.readouterr().err.startswith("swarm-mj: error: bad.yaml: not valid YAML")
