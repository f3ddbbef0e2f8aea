"""The door of the package: every public name is there, documented, and imported only when it is used."""

import inspect
import json
import subprocess
import sys
import warnings

import pytest

import swarm_mj as sm


@pytest.mark.parametrize("name", sm.__all__)
def test_every_public_name_is_there_and_documented(name):
    assert inspect.getdoc(getattr(sm, name))
    assert name in dir(sm)


def test_an_unknown_name_is_told_what_there_is():
    with pytest.raises(AttributeError, match="it offers .*campaign, compare_classes, design, explain, fly, load"):
        _ = sm.flly


def test_the_import_alone_loads_nothing_heavy():
    code = "import sys, swarm_mj; print({'numpy', 'pandas', 'mujoco', 'numba', 'gymnasium'} & set(sys.modules) or [])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr


@pytest.mark.parametrize("name", sm.__all__)
def test_no_room_takes_the_place_of_a_public_name(name):
    """A submodule of that name would overwrite the function when it is imported."""
    assert not inspect.ismodule(getattr(sm, name))
    with pytest.raises(ModuleNotFoundError):
        __import__(f"swarm_mj.{name}.nothing")


OLD = [
    ("swarm_mj.planning", "make_plan"),
    ("swarm_mj.flight", "simulate"),
    ("swarm_mj.flight", "observe_flight"),
    ("swarm_mj.attitude.controllers.base", "ControlInput"),
    ("swarm_mj.attitude.controllers.compiled", "CompiledLaw"),
    ("swarm_mj.attitude.mrp", "dcm"),
    ("swarm_mj.campaign.store", "read_results"),
    ("swarm_mj.envs.evaluation", "interval"),
    ("swarm_mj.envs.policy", "PatchGeometry"),
]


#: Imports every one in one process, and forgets the old modules after each, so that none is found because of another.
IMPORTS = """
import json, sys, warnings
import swarm_mj as sm
from swarm_mj.moved import new_path
for path, name in json.loads(sys.argv[1]):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        exec(f"pass\\nfrom {path} import {name}", found := {})
    words = [[w.category.__name__, str(w.message), w.filename, w.lineno] for w in told]
    print(json.dumps([found[name].__module__, callable(sm.campaign), words]))
    for module in [module for module in sys.modules if new_path(module)]:
        del sys.modules[module]
        parent, _, child = module.rpartition(".")
        vars(sys.modules[parent]).pop(child, None) if parent in sys.modules else None
    vars(sm).pop("campaign", None)
"""


@pytest.fixture(scope="module")
def imported():
    done = subprocess.run([sys.executable, "-c", IMPORTS, json.dumps(OLD)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return dict(zip(OLD, map(json.loads, done.stdout.splitlines()), strict=True))


@pytest.mark.parametrize(("module", "name"), OLD)
def test_documented_paths_of_the_last_version_work_and_warn(imported, module, name):
    where, callable_still, told = imported[module, name]
    assert not where.startswith(("swarm_mj.planning", "swarm_mj.attitude", "swarm_mj.campaign.")) and callable_still
    ours = [words for words in told if "the old path goes with version 0.3" in words[1]]
    assert ours and all(category == "DeprecationWarning" for category, *_ in ours)
    assert all(place == ["<string>", 2] for _, _, *place in ours), "the warning points at the import"


def test_what_never_was_is_not_found():
    with pytest.raises(ImportError), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from swarm_mj.flight import nothing_of_this_name  # noqa: F401
    with pytest.raises(ModuleNotFoundError), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import swarm_mj.attitude.nothing  # noqa: F401
