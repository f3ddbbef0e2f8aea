"""gymnasium knows the environments by name, and importing the package costs nothing."""

import subprocess
import sys

import pytest

from swarm_mj import envs

MADE = "; assert type(env.unwrapped).__name__ == 'SwarmObserveEnv'; print('made')"


def output(code):
    done = subprocess.run([sys.executable, "-W", "error::UserWarning", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize(
    "code",
    [
        "import gymnasium; env = gymnasium.make('swarm_mj:SwarmObserve-v0')",
        "import gymnasium, swarm_mj; env = gymnasium.make('SwarmObserve-v0')",
        "import gymnasium, swarm_mj.envs; env = gymnasium.make('SwarmObserve-v0')",
        "import swarm_mj.envs, gymnasium; env = gymnasium.make('SwarmObserve-v0')",
        "import swarm_mj, gymnasium; env = gymnasium.make('swarm_mj.envs:SwarmObserve-v0')",
    ],
)
def test_gymnasium_finds_the_environment(code):
    assert output(code + MADE) == "made"


@pytest.mark.parametrize(
    ("name", "module"), [("SwarmObserveV1VecEnv", "stable_baselines3"), ("SwarmObserveV1ParallelEnv", "pettingzoo")]
)
def test_a_class_whose_extra_is_missing_names_it(name, module):
    tried = f"try:\n    from swarm_mj.envs import {name}\nexcept ImportError as error:\n    print(error)"
    assert "pip install 'swarm_mj[rl]'" in output(f"import sys; sys.modules['{module}'] = None\n{tried}")


def test_classes_are_found_where_their_names_are_offered():
    names = [name for name in envs.__all__ if not any(extra in name for extra in ("VecEnv", "Parallel", "Gpu"))]
    assert "SwarmObserveV1Env" in names and [getattr(envs, name).__name__ for name in names] == names


def test_importing_the_package_loads_no_heavy_module_and_leaves_gymnasium_as_it_is():
    code = (
        "import sys, swarm_mj\n"
        "print([m for m in ('numpy', 'mujoco', 'numba', 'gymnasium') if m in sys.modules])\n"
        "import gymnasium\n"
        "print('exec_module' in vars(gymnasium.__spec__.loader), 'SwarmObserve-v0' in gymnasium.registry)"
    )
    assert output(code).split("\n") == ["[]", "False False"]
