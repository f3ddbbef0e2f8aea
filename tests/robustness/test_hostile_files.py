"""No file that the program reads can run code, and none of its readers is one that could."""

import ast
import pickle
from pathlib import Path

import numpy as np
import pytest

from swarm_mj.cli.main import main
from swarm_mj.errors import ScenarioError
from swarm_mj.io import cache
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

pytestmark = pytest.mark.robust

ROOT = Path(__file__).parents[2]
SOURCES = sorted([*ROOT.glob("swarm_mj/**/*.py"), *ROOT.glob("envs/**/*.py")])
#: Modules that run what they read.
DANGEROUS_MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
#: Modules that pickle, between a process and the children that it started itself, through pipes that nobody else holds.
BETWEEN_OWN_PROCESSES = {"swarm_mj/figures/drawing.py"}
DANGEROUS_CALLS = {
    "eval",
    "exec",
    "compile",
    "yaml.load",
    "yaml.unsafe_load",
    "yaml.full_load",
    "os.system",
    "os.popen",
}


class Trap:
    """Writes a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def runs_what_it_reads(call):
    name, keywords = ast.unparse(call.func), {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
    if name == "yaml.load":
        return keywords.get("Loader") != "_Loader"  # a SafeLoader, see the test below
    unpickles = name.endswith(("np.load", "numpy.load", "read_array")) and keywords.get("allow_pickle") == "True"
    return name in DANGEROUS_CALLS or unpickles or keywords.get("shell") == "True"


def test_no_module_reads_files_with_what_could_run_them():
    for path in SOURCES:
        own = str(path.relative_to(ROOT))
        dangerous = DANGEROUS_MODULES - ({"pickle"} if own in BETWEEN_OWN_PROCESSES else set())
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            where = f"{own}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.Import):
                assert not dangerous & {alias.name.split(".")[0] for alias in node.names}, where
            elif isinstance(node, ast.ImportFrom):
                assert (node.module or "").split(".")[0] not in dangerous, where
            elif isinstance(node, ast.Call):
                assert not runs_what_it_reads(node), where


def test_every_process_is_begun_where_it_ends_with_the_one_that_asked_for_it():
    """tests/io/test_workers.py kills that one; a solver is a thread, which ends with its process anyway."""
    for path in SOURCES:
        if path == ROOT / "swarm_mj/io/workers.py":
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import | ast.ImportFrom) else []
            module = node.module if isinstance(node, ast.ImportFrom) else ""
            assert not {"subprocess", "multiprocessing", "ProcessPoolExecutor"} & {module, *names}, path
            assert not (isinstance(node, ast.Attribute) and node.attr in ("fork", "forkpty", "posix_spawn")), path


def test_the_reader_of_scenarios_is_a_safe_one():
    import yaml

    from swarm_mj.scenarios.loading import _Loader

    assert issubclass(_Loader, yaml.SafeLoader)


@pytest.mark.parametrize(
    "tag",
    ["!!python/object/apply:pathlib.Path.touch", "!!python/object/new:os.system", "!!python/name:os.system",
     "!!python/module:os", "!include", "!!python/tuple"],
)  # fmt: skip
def test_a_tag_that_would_run_code_is_refused(tmp_path, tag):
    trap = tmp_path / "trap"
    (tmp_path / "a.yaml").write_text(f"name: {tag} [{trap}]\n")
    with pytest.raises(ScenarioError, match="not valid YAML"):
        load_scenario(tmp_path / "a.yaml")
    with pytest.raises(ScenarioError, match="not valid YAML"):
        load_scenario("eros-quick", parse_overrides([f"name={tag} [{trap}]"]))
    assert not trap.exists()


def test_a_cached_array_that_is_a_pickle_is_not_opened(tmp_path):
    trap = tmp_path / "trap"
    np.savez(tmp_path / "zip.npy", np.zeros(3, np.float32))
    (tmp_path / "zip.npy.npz").rename(tmp_path / "zip.npy")
    assert cache.load_array(tmp_path / "zip.npy", (3,)) is None
    for name, content in (("pickle.npy", pickle.dumps(Trap(trap))), ("cut.npy", b"\x93NUMPY\x01"), ("empty.npy", b"")):
        (tmp_path / name).write_bytes(content)
        assert cache.load_array(tmp_path / name, (3,)) is None
    np.save(tmp_path / "objects.npy", np.array([Trap(trap)], dtype=object), allow_pickle=True)
    assert cache.load_array(tmp_path / "objects.npy", (1,)) is None
    assert not trap.exists()


def test_a_cached_array_that_promises_terabytes_is_not_believed(tmp_path):
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000,), }"
    header += b" " * (118 - len(header) - 1) + b"\n"
    (tmp_path / "huge.npy").write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + b"\0" * 64)
    assert cache.load_array(tmp_path / "huge.npy", (1_000_000_000_000,)) is None


@pytest.mark.parametrize("name", ["../escaped", "/tmp/escaped", "a/b", "..", "x" * 300])
def test_a_scenario_cannot_choose_to_write_elsewhere(tmp_path, monkeypatch, name):
    (tmp_path / "work").mkdir()
    (tmp_path / "hostile.yaml").write_text(f"name: '{name}'\n")
    monkeypatch.chdir(tmp_path / "work")
    assert main(["fly", str(tmp_path / "hostile.yaml"), "--quiet", "--no-figures"]) in {1, 2}
    assert main(["design", str(tmp_path / "hostile.yaml"), "--quiet", "--no-figures"]) in {1, 2}
    assert {p.name for p in tmp_path.rglob("*")} <= {"work", "hostile.yaml", "results"}
