"""Machine code that is kept on disk serves again, and what lies there and is of no use harms nobody."""

import importlib.util
import pickle

import pytest

SOURCE = """
from swarm_mj.typing import kernel

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


@pytest.mark.parametrize(
    "body",
    [
        b"cno_such_module\nType\n.",
        b"cswarm_mj.typing\nNoSuchType\n.",
        b"",
        b"cut off",
        pickle.dumps(("one", "two", "three")),
    ],
    ids=["a module that is gone", "a type that is gone", "nothing", "rubbish", "of another form"],
)
def test_what_cannot_be_read_is_compiled_anew_and_kept(load, tmp_path, body):
    load()
    [index] = tmp_path.glob("**/*.nbi")
    with index.open("rb") as file:
        version = pickle.load(file)
    index.write_bytes(pickle.dumps(version) + body)
    assert not load().cache_hits
    assert load().cache_hits
