"""The tool that plants faults, on a program of three lines: what dies, what survives, and that nothing else is touched."""

import subprocess
import textwrap

import pytest

from scripts.mutants.faults import Fault, read_faults
from scripts.mutants.page import page_of, share_of
from scripts.mutants.trees import copy_sources, importers, plant
from scripts.mutants.trial import BROKEN, DIED, SURVIVED, TIME_LIMIT, Runner, judge

FILES = {
    "swarm_mj/__init__.py": "",
    "swarm_mj/one.py": "def twice(x):\n    return 2 * x\n",
    "swarm_mj/two.py": "from swarm_mj import one\n\n\ndef four(x):\n    return one.twice(one.twice(x))\n",
    "swarm_mj/three.py": "def nothing():\n    import time\n",
    "envs/__init__.py": "",
    "envs/five.py": "from swarm_mj.two import four\n",
    "assets/__init__.py": "",
    "tests/test_one.py": """
        from swarm_mj.envs.five import four
        from swarm_mj.one import twice

        def test_twice_is_double():
            assert twice(3) == 6

        def test_four_is_double_double():
            assert four(3) == 12
    """,
    "faults/physics.toml": """
        [[module]]
        file = "swarm_mj/one.py"
        tests = ["tests/test_one.py"]
        [[module.fault]]
        what = "three times"
        old = "2 * x"
        new = "3 * x"
        [[module.fault]]
        what = "a sum of two"
        old = "2 * x"
        new = "x + x"
        equivalent = "it is the same"
    """,
}


@pytest.fixture
def root(tmp_path):
    folder = tmp_path / "root"
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(textwrap.dedent(text))
    for command in (["init", "-q"], ["add", "."]):
        subprocess.run(["git", *command], cwd=folder, check=True)
    return folder


def test_a_fault_dies_by_the_test_that_notices_it_and_an_equivalent_one_lives(root, tmp_path):
    faults = read_faults(root, root / "faults")
    copy_sources(root, tmp_path / "warm")
    outcomes = {}
    for k, fault in enumerate(faults):
        tree = tmp_path / str(k)
        plant(fault, tmp_path / "warm", tree)
        assert (tree / fault.file).read_text() == f"def twice(x):\n    return {fault.new}\n"
        outcomes[fault] = Runner().run(tree, fault.tests, 60.0)
    died, lived = outcomes.values()
    assert (died.outcome, died.test) == (DIED, "tests/test_one.py::test_twice_is_double")
    assert lived.outcome == SURVIVED
    assert (root / "swarm_mj/one.py").read_text() == FILES["swarm_mj/one.py"]
    page = page_of(outcomes)
    assert share_of(outcomes) == 0.5 and "1 of 2 died (50.0 %)" in page
    assert "three times | `tests/test_one.py`: twice is double |" in page
    assert "**survived**: it is the same" in page


def test_tests_that_never_end_are_ended(root, tmp_path):
    (root / "tests/test_one.py").write_text("def test_waits():\n    while True:\n        pass\n")
    copy_sources(root, tmp_path / "warm")
    assert Runner().run(tmp_path / "warm", ("tests/test_one.py",), 3.0).outcome == TIME_LIMIT


def test_compiled_code_of_all_that_imports_a_faulty_file_is_left_behind_and_other_code_kept(root, tmp_path):
    assert importers(root, "swarm_mj/one.py") == {
        "swarm_mj/one.py",
        "swarm_mj/two.py",
        "envs/five.py",
        "tests/test_one.py",
    }
    warm, tree = tmp_path / "warm", tmp_path / "tree"
    copy_sources(root, warm)
    kernels = [f"swarm_mj/__pycache__/{name}.f-1.py312.1.nbc" for name in ("one", "two", "three")]
    (warm / "swarm_mj/__pycache__").mkdir()
    for kernel in kernels:
        (warm / kernel).write_text("")
    plant(read_faults(root, root / "faults")[0], warm, tree)
    assert [(tree / kernel).exists() for kernel in kernels] == [False, False, True]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"old": "5 * x"}, "stands there 0 times"),
        ({"old": "x"}, "stands there 2 times"),
        ({"new": "2 * x"}, "old and new are the same"),
        ({"tests": ["tests/test_none.py"]}, "there is no test tests/test_none.py"),
    ],
)
def test_a_fault_that_does_not_fit_the_sources_is_refused(root, change, message):
    given = {"what": "it", "old": "2 * x", "new": "3 * x", "tests": ["tests/test_one.py"]} | change
    lines = ["[[module]]", 'file = "swarm_mj/one.py"', "[[module.fault]]", *(f"{k} = {v!r}" for k, v in given.items())]
    (root / "faults/physics.toml").write_text("\n".join(lines))
    with pytest.raises(ValueError, match=message):
        read_faults(root, root / "faults")


def test_what_is_no_program_counts_as_broken_and_not_as_noticed():
    failed = "E   {}: it\nFAILED tests/test_one.py::test_it - {}: it\n"
    assert judge(1, failed.format("AssertionError", "AssertionError"))[:2] == (DIED, "tests/test_one.py::test_it")
    assert judge(1, failed.format("NameError", "NameError"))[0] == BROKEN
    assert judge(1, "FAILED tests/test_one.py::test_it[two words] - it\n")[1] == "tests/test_one.py::test_it[two words]"
    assert judge(2, "ERROR tests/test_one.py\n")[0] == BROKEN
    assert judge(0, "3 passed")[0] == SURVIVED


def test_a_result_is_kept_until_the_fault_its_file_or_its_tests_change(root):
    (first, _) = read_faults(root, root / "faults")
    key = first.key(root)
    assert Fault(**vars(first)).key(root) == key
    (root / "tests/test_one.py").write_text("def test_it():\n    pass\n")
    assert first.key(root) != key


def test_every_listed_fault_fits_the_sources():
    from scripts.pages import ROOT

    faults = read_faults(ROOT)
    assert len(faults) >= 100
    assert {fault.room for fault in faults} == {file.stem for file in (ROOT / "scripts/mutants/faults").glob("*.toml")}
