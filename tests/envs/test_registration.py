"""gymnasium knows the environments by name, and importing the package costs nothing."""

import subprocess
import sys

import pytest

from swarm_mj import envs


def output(code, *arguments):
    command = [sys.executable, "-W", "error::UserWarning", "-c", code, *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


#: Each in a process of its own, forked from one that has loaded what takes long and is neither gymnasium nor this program.
EACH = """
import os, sys
import mujoco, numba, numpy, pydantic, scipy.optimize, scipy.spatial, trimesh, xarray
assert not {"gymnasium", "swarm_mj"} & set(sys.modules)
for code in sys.argv[1:]:
    child = os.fork()
    if not child:
        exec(code)
        assert type(env.unwrapped).__name__ == "SwarmObserveEnv"
        sys.exit()
    print("made" if os.waitpid(child, 0)[1] == 0 else code, flush=True)
"""


def test_gymnasium_finds_the_environment():
    orders = [
        "import gymnasium; env = gymnasium.make('swarm_mj:SwarmObserve-v0')",
        "import gymnasium, swarm_mj; env = gymnasium.make('SwarmObserve-v0')",
        "import gymnasium, swarm_mj.envs; env = gymnasium.make('SwarmObserve-v0')",
        "import swarm_mj.envs, gymnasium; env = gymnasium.make('SwarmObserve-v0')",
        "import swarm_mj, gymnasium; env = gymnasium.make('swarm_mj.envs:SwarmObserve-v0')",
    ]
    assert output(EACH, *orders).split("\n") == len(orders) * ["made"]


@pytest.mark.parametrize(
    ("name", "module"), [("SwarmObserveVecEnv", "stable_baselines3"), ("SwarmObserveParallelEnv", "pettingzoo")]
)
def test_a_class_whose_extra_is_missing_names_it(name, module):
    tried = f"try:\n    from swarm_mj.envs import {name}\nexcept ImportError as error:\n    print(error)"
    assert "pip install 'swarm_mj[rl]'" in output(f"import sys; sys.modules['{module}'] = None\n{tried}")


def test_classes_are_found_where_their_names_are_offered():
    names = [name for name in envs.__all__ if not any(extra in name for extra in ("VecEnv", "Parallel"))]
    assert "SwarmObserveEnv" in names and [getattr(envs, name).__name__ for name in names] == names


def test_importing_the_package_loads_no_heavy_module_and_leaves_gymnasium_as_it_is():
    code = (
        "import sys, swarm_mj\n"
        "print([m for m in ('numpy', 'mujoco', 'numba', 'gymnasium') if m in sys.modules])\n"
        "import gymnasium\n"
        "print('exec_module' in vars(gymnasium.__spec__.loader), 'SwarmObserve-v0' in gymnasium.registry)"
    )
    assert output(code).split("\n") == ["[]", "False False"]
