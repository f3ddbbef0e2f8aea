"""The door of the package: every public name is there, documented, and imported only when it is used."""

import inspect
import subprocess
import sys

import pytest

import swarm_mj as sm


def test_every_public_name_is_there_and_documented():
    assert [name for name in sm.__all__ if not inspect.getdoc(getattr(sm, name)) or name not in dir(sm)] == []


def test_an_unknown_name_is_told_what_there_is():
    offered = "campaign, compare_classes, compare_studies, design, design_sweeps, explain, fly"
    with pytest.raises(AttributeError, match=f"it offers .*{offered}, .*load"):
        _ = sm.flly


def test_only_a_design_that_is_made_loads_the_genetic_algorithms():
    code = "import sys, swarm_mj as sm; sm.design, sm.open, sm.fly; print('pymoo' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_the_import_alone_loads_nothing_heavy():
    code = "import sys, swarm_mj; print({'numpy', 'pandas', 'mujoco', 'numba', 'gymnasium'} & set(sys.modules) or [])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr


def test_no_room_takes_the_place_of_a_public_name():
    """A submodule of that name would overwrite the function when it is imported."""
    for name in sm.__all__:
        assert not inspect.ismodule(getattr(sm, name))
        with pytest.raises(ModuleNotFoundError):
            __import__(f"swarm_mj.{name}.nothing")
