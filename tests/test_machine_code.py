"""Machine code that is kept on disk: it serves again, not beyond an upgrade, and lies where nobody else can write."""

import importlib.util
import json
import os
import pickle
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import swarm_mj
from swarm_mj import compilation

SOURCE = """
from swarm_mj.compilation import kernel

@kernel
def twice(x):
    return 2.0 * x
"""


@pytest.fixture
def load(tmp_path):
    file = tmp_path / "with_a_kernel.py"
    file.write_text(SOURCE)

    def load():
        spec = importlib.util.spec_from_file_location("with_a_kernel", file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        assert module.twice(21.0) == 42.0
        return module.twice.stats

    return load


def test_what_was_compiled_once_is_read_from_disk(load):
    assert not load().cache_hits
    assert load().cache_hits


def test_what_another_version_kept_may_name_types_that_are_gone(load, tmp_path, monkeypatch):
    load()
    [index] = tmp_path.glob("**/*.nbi")
    with index.open("rb") as file:
        version = pickle.load(file)
    index.write_bytes(pickle.dumps(version) + b"cno_such_module\nType\n.")
    with pytest.raises(ModuleNotFoundError):
        load()
    monkeypatch.setattr(compilation, "INSTALLATION", "the next one")
    assert not load().cache_hits
    assert load().cache_hits


def test_an_upgrade_in_place_is_another_installation(tmp_path):
    code = "import importlib.util, sys; spec = importlib.util.spec_from_file_location('compilation_', sys.argv[1]); "
    code += (
        "module = importlib.util.module_from_spec(spec); spec.loader.exec_module(module); print(module.INSTALLATION)"
    )
    (tmp_path / "compilation.py").write_text(Path(compilation.__file__).read_text())
    (tmp_path / "__init__.py").write_text("")
    names = set()
    for written in (1_000_000_000, 1_000_000_000, 2_000_000_000):
        os.utime(tmp_path / "__init__.py", (written, written))
        command = [sys.executable, "-c", code, str(tmp_path / "compilation.py")]
        names.add(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert len(names) == 2 and all(swarm_mj.__version__ in name for name in names)


#: Imports the package as if its folder and those of others could not be written; prints what Numba is told, and who may enter.
IMPORTED = """
import json, os, stat, sys
can_access, refused = os.access, json.loads(sys.argv[1])
os.access = lambda path, mode: not any(str(path).endswith(end) for end in refused) and can_access(path, mode)
import swarm_mj
import numba
given = numba.config.CACHE_DIR
print(json.dumps([given, given and stat.S_IMODE(os.stat(given).st_mode)]))
"""


def imported(refused, folder=None, **environment):
    kept = {
        name: value for name, value in os.environ.items() if name not in ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR")
    }
    command = [sys.executable, "-c", IMPORTED, json.dumps(["/swarm_mj", *refused])]
    done = subprocess.run(command, env=kept | environment, cwd=folder, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


@pytest.fixture
def home(tmp_path):
    (tmp_path / "home").mkdir(mode=0o700)
    return tmp_path / "home"


def test_numba_keeps_machine_code_in_the_home_folder_where_the_package_cannot_be_written(home):
    assert imported([], HOME=str(home)) == ["", ""]


def test_a_file_of_the_current_folder_names_no_folder_of_machine_code(home, tmp_path):
    (tmp_path / ".numba_config.yaml").write_text(f"cache_dir: {tmp_path}\n")
    assert imported([], tmp_path, HOME=str(home), PYTHONPATH=str(Path(swarm_mj.__file__).parents[1])) == ["", ""]


@pytest.mark.parametrize("case", ["cannot be written", "anyone may write", "of someone else", "no home"])
def test_without_a_safe_folder_machine_code_lies_in_a_private_one_that_goes_with_the_program(home, case):
    environment = {"HOME": str(home)}
    if case == "no home":
        environment = {"XDG_CACHE_HOME": "~/.cache"}  # "~" stays as it is where nobody knows a home folder
    elif case == "anyone may write":
        home.chmod(0o777)
    elif case == "of someone else" and os.getuid() == 0:
        os.chown(home, 12345, -1)
    elif case == "of someone else":
        environment["XDG_CACHE_HOME"] = "/"
    folder, mode = imported([str(home)] if case == "cannot be written" else [], **environment)
    assert mode == stat.S_IRWXU
    assert not Path(folder).exists()


def test_a_folder_that_the_user_names_is_left_alone(home):
    assert imported([str(home)], HOME=str(home), NUMBA_CACHE_DIR=str(home))[0] == str(home)
