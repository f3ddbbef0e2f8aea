"""The tool that plants faults, on a program of three lines: what dies, what survives, and that nothing else is touched."""

import os
import signal
import subprocess
import textwrap

import pytest

from scripts.import_graph import forget_stale, importers
from scripts.mutants.faults import read_faults
from scripts.mutants.findings import finding_of, read_findings, write_findings
from scripts.mutants.page import page_of
from scripts.mutants.trees import copy_sources, plant
from scripts.mutants.trial import BROKEN, DIED, SURVIVED, TIME_LIMIT, Runner, Trial, judge

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


def rewrite(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


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
    findings = {fault.name: finding_of(fault, trial, root) for fault, trial in outcomes.items()}
    page = page_of(faults, findings, root)
    assert "1 of 2 died (50.0 %)" in page
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


def test_machine_code_older_than_a_source_that_it_came_from_is_removed(root):
    kernels = {name: root / f"swarm_mj/__pycache__/{name}.f-1.py312.1.nbc" for name in ("one", "two", "three")}
    (root / "swarm_mj/__pycache__").mkdir()
    for kernel in kernels.values():
        kernel.write_text("")
        os.utime(kernel, (2e9, 2e9))
    assert forget_stale(root) == set()
    # Two imports one.
    os.utime(root / "swarm_mj/one.py", (2.1e9, 2.1e9))
    assert forget_stale(root) == {"swarm_mj/one.py", "swarm_mj/two.py"}
    assert [name for name, kernel in kernels.items() if kernel.exists()] == ["three"]


def test_a_copy_that_is_brought_up_to_date_keeps_what_is_compiled_of_sources_that_did_not_change(root, tmp_path):
    warm = tmp_path / "warm"
    copy_sources(root, warm)
    kernels = {name: warm / f"swarm_mj/__pycache__/{name}.f-1.py312.1.nbc" for name in ("one", "two", "three")}
    (warm / "swarm_mj/__pycache__").mkdir()
    for kernel in kernels.values():
        kernel.write_text("")
    (root / "swarm_mj/three.py").touch()
    copy_sources(root, warm)
    assert all(kernel.exists() for kernel in kernels.values())
    rewrite(root / "swarm_mj/one.py", "2 * x", "x + x")
    (root / "tests/test_one.py").unlink()
    copy_sources(root, warm)
    assert [name for name, kernel in kernels.items() if kernel.exists()] == ["three"]
    assert (warm / "swarm_mj/one.py").read_text() == (root / "swarm_mj/one.py").read_text()
    assert not (warm / "tests/test_one.py").exists()


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
    assert judge(-signal.SIGXCPU, "")[0] == TIME_LIMIT


NOTICED = Trial(DIED, "tests/test_one.py::test_twice_is_double", "AssertionError", 1.0)


@pytest.mark.parametrize(
    ("name", "old", "new", "holds"),
    [
        ("swarm_mj/one.py", "def twice(x):", "def twice(x):\n    assert x", False),
        ("swarm_mj/one.py", "def twice(x):", "def other():\n    pass\n\n\ndef twice(x):", True),
        ("tests/test_one.py", "assert twice(3) == 6", "assert twice(4) == 8", False),
        ("tests/test_one.py", "def test_twice_is_double", "def test_twice", False),
        ("tests/test_one.py", "assert four(3) == 12", "assert four(4) == 16", True),
        ("faults/physics.toml", "3 * x", "4 * x", False),
    ],
)
def test_a_finding_holds_until_the_fault_its_function_or_the_test_that_noticed_it_change(root, name, old, new, holds):
    fault = read_faults(root, root / "faults")[0]
    finding = finding_of(fault, NOTICED, root)
    assert finding.holds(fault, root)
    rewrite(root / name, old, new)
    changed = read_faults(root, root / "faults")[0]
    assert finding.holds(changed, root) is holds
    page = page_of([changed], {changed.name: finding}, root)
    assert ("1 of 1 died" in page, "1 more were run before" in page) == (holds, not holds)


def test_that_a_fault_survives_holds_until_a_file_of_its_tests_changes(root):
    fault = read_faults(root, root / "faults")[1]
    finding = finding_of(fault, Trial(SURVIVED, "", "2 passed", 1.0), root)
    rewrite(root / "swarm_mj/two.py", "four", "fourfold")
    assert finding.holds(fault, root)
    rewrite(root / "tests/test_one.py", "four(3) == 12", "four(4) == 16")
    assert not finding.holds(fault, root)


def test_findings_of_listed_faults_come_back_and_trials_that_say_nothing_are_not_kept(root, tmp_path):
    faults, file = read_faults(root, root / "faults"), tmp_path / "kept.json"
    assert read_findings(file) == {}
    assert finding_of(faults[0], Trial(TIME_LIMIT, "", "ran longer", 3.0), root) is None
    first = finding_of(faults[0], NOTICED, root)
    write_findings(file, {faults[0].name: first, "gone: it was": first}, faults)
    assert read_findings(file) == {faults[0].name: first}
    assert "1 are listed and were not run yet" in page_of(faults, read_findings(file), root)


def test_every_listed_fault_fits_the_sources():
    from scripts.pages import ROOT

    faults = read_faults(ROOT)
    assert len(faults) >= 100
    assert {fault.room for fault in faults} == {file.stem for file in (ROOT / "scripts/mutants/faults").glob("*.toml")}
